//! Blobs of the real Stage 4.3 simulator for the thesis's 13 cameras (Table 4.1), true stops.
//!
//! Stage spaces its rays at equal angles; the middle of a blob is `(left + right) / 2`. Blobs that
//! touch the border are clipped and left out.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use calib_core::{
    Sighting, angle,
    camera::Camera,
    reference::{self, Known, ReferenceSettings, Stop},
    resection,
};
use nalgebra::{Matrix2, Point2};
use results::record::{Place, published::Published};
use serde::Deserialize;

use crate::figure::{Estimate, Goal, Sheet, full_data, quantile, rms, worst};

const LAST_COLUMN: u8 = 87;
/// Stage measures (left + right) / 2 in whole or half columns, of a body 0.3 units wide.
const COLUMN_SIGMA: f64 = 0.4;

#[derive(Deserialize)]
struct Blob {
    stop: usize,
    target_x: f64,
    target_y: f64,
    node: usize,
    left: u8,
    right: u8,
}

impl Blob {
    fn is_whole(&self) -> bool {
        self.left > 0 && self.right < LAST_COLUMN
    }

    fn column(&self) -> f64 {
        f64::midpoint(f64::from(self.left), f64::from(self.right))
    }

    /// Stops 3, 4, 5 were planned for node 3, the next three for node 4, and so on.
    fn was_planned(&self) -> bool {
        self.node >= 3 && self.stop / 3 == self.node - 2
    }
}

/// True place of a camera of Table 4.1.
fn truth(node: usize) -> anyhow::Result<Place> {
    let thesis = Published::named("thesis-4.1", Some(1)).context("there is no Table 4.1")?;
    let node = u16::try_from(node)?;
    let camera = thesis.node(node);
    Ok(camera.with_context(|| format!("node {node}"))?.truth)
}

/// Errors of one camera: distance, x, y in units, heading in degrees.
struct Errors {
    distance: f64,
    x: f64,
    y: f64,
    heading: f64,
}

pub(crate) fn run(sheet: &mut Sheet, is_brief: bool) -> anyhow::Result<()> {
    let camera = Camera::equal_angle(88, 60_f64.to_radians())?;
    sheet.heading("Stage blobs, 13 cameras of the thesis, equal angles");

    let mut errors = Vec::new();
    let mut reference_errors = Vec::new();
    for seed in [1, 2, 3] {
        let name = format!("stage13/blobs_seed{seed}.csv");
        let own = Some(test_support::data(&name)).filter(|path| path.is_file());
        let Some(path) = full_data(&name, is_brief).or(own) else {
            sheet.note(&format!("{name} is not there: left out"));
            continue;
        };
        let blobs = read(&path)?;
        errors.extend(solve(&blobs, &camera, Some(3))?);
        reference_errors.push(worst_reference_heading(&blobs, &camera)?);
    }
    let quantile = |of: fn(&Errors) -> f64, p| {
        let mut values: Vec<_> = errors.iter().map(of).collect();
        quantile(&mut values, p)
    };
    let name = "three planned stops,";
    let median = |of| quantile(of, 0.5);
    let distance = median(|e| e.distance);
    // Of a Rayleigh distribution, about that of distances.
    let distance = Estimate {
        value: distance,
        standard_error: 0.72 * distance / (errors.len() as f64).sqrt(),
    };
    sheet.estimate(
        &format!("{name} median distance"),
        distance,
        "units",
        &Goal::AtMost(0.08),
        is_brief,
    );
    sheet.figure(
        &format!("{name} median heading"),
        median(|e| e.heading.abs()),
        "deg",
        &Goal::AtMost(1.0),
    );
    sheet.figure(
        &format!("{name} rms x"),
        rms(errors.iter().map(|e| e.x)),
        "units",
        &Goal::None,
    );
    sheet.figure(
        &format!("{name} rms y"),
        rms(errors.iter().map(|e| e.y)),
        "units",
        &Goal::None,
    );
    sheet.figure(
        &format!("{name} rms heading"),
        rms(errors.iter().map(|e| e.heading)),
        "deg",
        &Goal::None,
    );
    sheet.figure(
        "reference headings from three stops, worst",
        worst(reference_errors),
        "deg",
        &Goal::AtMost(1.0),
    );

    let Some(path) = full_data("stage13/blobs_seed11.csv", is_brief) else {
        sheet.note("stage13/blobs_seed11.csv is not there: left out");
        return Ok(());
    };
    let errors = solve(&read(&path)?, &camera, None)?;
    let name = "all sightings (about 19 a camera),";
    sheet.figure(
        &format!("{name} rms x"),
        rms(errors.iter().map(|e| e.x)),
        "units",
        &Goal::AtMost(0.02),
    );
    sheet.figure(
        &format!("{name} rms y"),
        rms(errors.iter().map(|e| e.y)),
        "units",
        &Goal::AtMost(0.02),
    );
    sheet.figure(
        &format!("{name} rms heading"),
        rms(errors.iter().map(|e| e.heading)),
        "deg",
        &Goal::AtMost(0.16),
    );
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<Vec<Blob>> {
    csv::Reader::from_path(path)
        .and_then(|mut reader| reader.deserialize().collect())
        .with_context(|| format!("cannot read {}", path.display()))
}

/// Every camera but the references, from its whole blobs: all, or at most so many. Those planned for it come
/// first; if one of them was clipped, another blob that it saw takes its place.
fn solve(blobs: &[Blob], camera: &Camera<f64>, most: Option<usize>) -> anyhow::Result<Vec<Errors>> {
    let mut whole: Vec<_> = blobs
        .iter()
        .filter(|b| b.is_whole() && b.node >= 3)
        .collect();
    whole.sort_by_key(|blob| !blob.was_planned());
    let mut by_node = BTreeMap::<_, Vec<_>>::new();
    for blob in whole {
        let seen = by_node.entry(blob.node).or_default();
        if most.is_some_and(|most| seen.len() == most) {
            continue;
        }
        let target = Point2::new(blob.target_x, blob.target_y);
        let sigma = camera.bearing_sigma(blob.column(), COLUMN_SIGMA);
        let sighting = Sighting::new(target, camera.ray(blob.column()), sigma);
        seen.push(sighting);
    }
    by_node
        .into_iter()
        .map(|(node, sightings)| {
            let pose = resection::solve(&sightings)
                .with_context(|| format!("node {node}"))?
                .pose;
            let truth = truth(node)?;
            let d = pose.position - truth.position();
            let turned = angle::wrap_signed(pose.heading - truth.heading_deg.to_radians());
            Ok(Errors {
                distance: d.norm(),
                x: d.x,
                y: d.y,
                heading: turned.to_degrees(),
            })
        })
        .collect()
}

/// Nodes 1 and 2 from the first three stops and the displacements between them; degrees.
fn worst_reference_heading(blobs: &[Blob], camera: &Camera<f64>) -> anyhow::Result<f64> {
    let find = |node, stop| blobs.iter().find(|b| b.node == node && b.stop == stop);
    let mut stops = Vec::new();
    let mut previous: Option<Point2<f64>> = None;
    for stop in 0..3 {
        let (Some(a), Some(b)) = (find(1, stop), find(2, stop)) else {
            anyhow::bail!("stop {stop} was not seen by both reference cameras");
        };
        let place = Point2::new(a.target_x, a.target_y);
        stops.push(Stop {
            rays: [a, b].map(|blob| camera.ray(blob.column())),
            bearing_sigmas: [a, b].map(|blob| camera.bearing_sigma(blob.column(), COLUMN_SIGMA)),
            displacement: place - previous.unwrap_or(place),
            displacement_covariance: Matrix2::zeros(),
        });
        previous = Some(place);
    }
    let known = Known {
        baseline: Some(10.0),
        frame_heading: Some(0.0),
    };
    let best = reference::solve(&stops, &known, &ReferenceSettings::default())?.best;
    let [first, second] = best.headings;
    let error = |node: usize, heading: f64| {
        let truth = truth(node)?.heading_deg.to_radians();
        let error = angle::wrap_signed(heading - truth).to_degrees();
        anyhow::Ok(error.abs())
    };
    Ok(error(1, first)?.max(error(2, second)?))
}
