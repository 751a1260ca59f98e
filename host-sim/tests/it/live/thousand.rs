//! A page with very many cameras, whose view zooms and moves about.

use calib_core::{Pose, Status};
use host_sim::network::{Options, Simulation};
use nalgebra::{Matrix3, Point2};
use results::record::{Estimate, RunRecord, Stop, event};
use site::{Overrides, Scenario};

/// Zooms and moves on before each frame. Tells for each the time of its scripts, the number of paths that they
/// drew if `paths` counts them, and its time.
pub(super) const MOVES: &str = "
    const map = document.getElementById('map');
    const own = window.requestAnimationFrame.bind(window);
    const moves = {frames: 0, paths: [], script: [], times: [], errors: 0, stop: () => { moves.ended = true; }};
    window.addEventListener('error', () => { moves.errors += 1; });
    window.moves = moves;
    window.requestAnimationFrame = work => own(now => {
        const [begun, paths] = [performance.now(), window.paths];
        if (!moves.ended) {
            const {left, top} = map.getBoundingClientRect();
            map.dispatchEvent(new WheelEvent('wheel', {
                deltaY: 24 * Math.sin(moves.frames / 15), clientX: left + 200, clientY: top + 150, cancelable: true,
            }));
            const key = moves.frames % 40 < 20 ? 'ArrowLeft' : 'ArrowRight';
            map.dispatchEvent(new KeyboardEvent('keydown', {key, cancelable: true}));
        }
        work(now);
        if (moves.ended) return;
        moves.frames += 1;
        moves.times.push(now);
        moves.script.push(performance.now() - begun);
        moves.paths.push((window.paths ?? 0) - (paths ?? 0));
    });";

/// A report of a network of so many cameras, all of which know their poses.
pub(super) fn report(cameras: usize) -> String {
    with_stops(cameras, 0)
}

/// The same, with so many stops of each target, whose numbers are as long as those of a node that ran before.
pub(super) fn with_stops(cameras: usize, stops: u32) -> String {
    let overrides = Overrides {
        nodes: Some(cameras),
        ..Overrides::default()
    };
    let scenario = Scenario::load("grid", &overrides).unwrap();
    let simulation = Simulation::new(scenario, Options::default()).unwrap();
    let mut record = simulation.record();
    for (n, node) in record.nodes.iter_mut().enumerate() {
        let Some(truth) = node.truth.filter(|_| node.is_camera()) else {
            continue;
        };
        let pose = Pose {
            position: Point2::new(truth.x, truth.y),
            heading: truth.heading_deg.to_radians(),
            covariance: Matrix3::from_diagonal(&[1e-3, 4e-3, 1e-5].into()),
        };
        node.estimate = Estimate::new(&pose);
        node.status = Some(match n % 5 {
            0 => Status::Weak,
            _ => Status::Calibrated,
        });
        node.address = u16::try_from(n).ok();
    }
    for target in &mut record.targets {
        let mut cameras = { record.nodes.iter() }.filter(|node| node.network == target.network);
        let Some(place) = cameras.find_map(|node| node.estimate) else {
            continue;
        };
        target.stops = (0..stops)
            .map(|n| {
                let angle = f64::from(n);
                Stop {
                    stop: 62_200 + n,
                    seconds: None,
                    x: place.x + angle / 8.0 * angle.cos(),
                    y: place.y + angle / 8.0 * angle.sin(),
                    believed: None,
                }
            })
            .collect();
    }
    let record: RunRecord = record;
    host_sim::live::report(&event::of_record(&record, None)).unwrap()
}
