//! `host-sim solve-network`, from thirteen cameras and a hundred stops to a thousand and ten thousand.
//!
//! Cameras stand anywhere in a hall, and a target walks through it. A factor graph library (GTSAM 4.2) took 0.013,
//! 0.047, 0.095 and 0.40 s for the optimum of such networks of 13, 100, 200 and 1,000 cameras with 100 stops,
//! on the computer on which the goals were set.

use std::{fs, hint::black_box};

use anyhow::{Context, ensure};
use nalgebra::Point2;
use rand::RngExt;
use results::network::{self, NetworkSolution, Settings};
use results::record::sightings::{Bearing, Carrier, Leg, References, Sightings};
use rustix::time::{ClockId, clock_gettime};
use test_support::{
    Random, Truth, generator,
    walk::{CarrierErrors, Walk, sees},
};

use crate::figure::{Goal, Sheet};

const BEARING_SIGMA: f64 = 0.0024;
const BASELINE: f64 = 10.0;
/// Stops that both references see, at the beginning.
const FIRST: usize = 8;
const TARGET: u16 = 1;

/// A network to be solved: cameras, stops, and the side of the hall.
const SIZES: [(usize, usize, f64); 5] = [
    (13, 100, 12.0),
    (100, 100, 14.0),
    (200, 100, 14.0),
    (1000, 100, 14.0),
    (1000, 10_000, 60.0),
];

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    sheet.heading("solve-network by size, processor time");
    for (cameras, stops, side) in SIZES {
        let sightings = sightings(&hall(cameras, stops, side));
        let name = format!(
            "{cameras} cameras, {stops} stops, {} bearings",
            sightings.bearings.len()
        );
        let is_goal = (cameras, stops) == (1000, 100);
        for (what, poses_only, most) in [
            ("poses", true, 0.8),
            ("with residuals and protection levels", false, 2.0),
        ] {
            let settings = Settings {
                poses_only,
                ..Settings::default()
            };
            let begin = processor_seconds();
            let solved = network::solve(&sightings, &settings)?;
            let seconds = processor_seconds() - begin;
            judge(&solved, cameras).with_context(|| name.clone())?;
            let goal = if is_goal {
                Goal::AtMost(most)
            } else {
                Goal::None
            };
            sheet.figure(&format!("{name}: {what}"), seconds, "s", &goal);
            if !poses_only {
                let begin = processor_seconds();
                black_box(serde_json::to_string(&solved)?);
                sheet.figure(
                    &format!("{name}: told as JSON"),
                    processor_seconds() - begin,
                    "s",
                    &Goal::None,
                );
            }
        }
        if let Some(megabytes) = most_memory() {
            sheet.figure(
                &format!("{name}: most memory so far"),
                megabytes,
                "MB",
                &Goal::None,
            );
        }
    }
    Ok(())
}

/// Checks that the solution is one.
fn judge(solved: &[NetworkSolution], cameras: usize) -> anyhow::Result<()> {
    let [solution] = solved else {
        anyhow::bail!("there is one walk");
    };
    ensure!(solution.is_good(), "{:?}", solution.reason);
    let with_pose = solution
        .cameras
        .iter()
        .filter(|camera| camera.estimate.is_some());
    let share = with_pose.count() as f64 / cameras as f64;
    ensure!(share > 0.7, "only {share:.2} of the cameras have a pose");
    Ok(())
}

/// Cameras anywhere in a hall, and a walk through it that begins before the references.
fn hall(cameras: usize, stops: usize, side: f64) -> Walk {
    let mut random = generator(2001);
    let camera = |x: f64, y: f64, heading: f64| Truth { x, y, heading };
    let mut all = vec![camera(0.0, 0.0, 0.75), camera(BASELINE, 0.0, 2.4)];
    while all.len() < cameras {
        let place = anywhere(&mut random, side);
        let towards = anywhere(&mut random, side) - place;
        all.push(camera(place.x, place.y, towards.y.atan2(towards.x)));
    }
    let mut places: Vec<Point2<f64>> = Vec::new();
    while places.len() < stops {
        let place = match places.last() {
            Some(last) if places.len() >= FIRST => {
                let way = anywhere(&mut random, 6.0);
                *last + (way - Point2::new(3.0, 3.0))
            }
            _ => anywhere(&mut random, BASELINE),
        };
        let is_inside = [place.x, place.y].iter().all(|at| (0.0..side).contains(at));
        let is_first = places.len() < FIRST;
        let before_references = all[..2].iter().all(|reference| sees(reference, place));
        let apart = places.last().is_none_or(|last| (place - last).norm() > 0.7);
        if is_inside && apart && (before_references || !is_first) {
            places.push(place);
        }
    }
    Walk::measured(
        &mut random,
        all,
        places,
        CarrierErrors::UNKNOWN,
        BEARING_SIGMA,
    )
}

fn anywhere(random: &mut Random, side: f64) -> Point2<f64> {
    Point2::new(
        random.random_range(0.0..side),
        random.random_range(0.0..side),
    )
}

/// As a file for `solve-network` has it.
fn sightings(walk: &Walk) -> Sightings {
    let number = |index: usize| u16::try_from(index + 1).expect("few cameras");
    let stop = |index: usize| u32::try_from(index + 1).expect("few stops");
    Sightings {
        network: 1,
        references: Some(References {
            cameras: [1, 2],
            baseline: Some(BASELINE),
        }),
        frame_heading_deg: Some(0.0),
        carriers: vec![Carrier {
            target: TARGET,
            systematic_scale: walk.errors.scale,
            systematic_heading_deg: walk.errors.compass.to_degrees(),
            standing_sigma: 0.0,
        }],
        bearings: { walk.bearings.iter() }
            .map(|seen| Bearing {
                target: TARGET,
                stop: stop(seen.stop),
                camera: number(seen.camera),
                bearing_deg: seen.bearing.to_degrees(),
                sigma_deg: seen.sigma.to_degrees(),
                elevation_deg: None,
            })
            .collect(),
        legs: { walk.legs.iter().enumerate() }
            .map(|(n, leg)| Leg {
                target: TARGET,
                stop: stop(n + 1),
                dx: leg.displacement.x,
                dy: leg.displacement.y,
                covariance: [leg.covariance.m11, leg.covariance.m12, leg.covariance.m22],
            })
            .collect(),
        ..Sightings::default()
    }
}

fn processor_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// The most memory that this process has taken, where the system tells it.
fn most_memory() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}
