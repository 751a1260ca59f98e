//! Blobs of the real Stage 4.3, and those of host-sim's ray scan for the same cameras and places.

use nalgebra::Point2;
use site::world::{Target, Variant, World};
use site::{Overrides, Scenario};

/// Radius of a disc that holds the body, a square of 0.3 units.
const RADIUS: f64 = 0.2122;

/// The middles of whole blobs. Their widths are not compared: Stage's body is square, has any direction,
/// and is drawn in cells of a grid.
#[test]
fn blobs_are_where_stage_has_them() {
    let changes = Overrides {
        variant: Some(Variant::Stage),
        ..Overrides::default()
    };
    let scenario = Scenario::load("thesis-13", &changes).unwrap();
    let cameras = scenario.put_up().unwrap().world.cameras().to_vec();
    let target = Target {
        place: Point2::origin(),
        above: 0.0,
        radius: RADIUS,
        colour: [230, 105, 35],
    };
    let mut world = World::new(cameras, vec![], vec![target]);
    let text = std::fs::read_to_string(test_support::data("stage13/blobs_seed1.csv")).unwrap();
    let mut differences = Vec::new();
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        let [_, x, y, node, left, right, ..] = numbers[..] else {
            panic!("{line}");
        };
        if left == 0.0 || right == 87.0 {
            continue;
        }
        world.move_target(0, Point2::new(x, y));
        let view = world.look(node as usize - 1);
        let extent = view.patches()[0].extent;
        let ours = [extent.left * 88.0, extent.right * 88.0 - 1.0];
        let difference = (left + right - ours[0] - ours[1]) / 2.0;
        assert!(difference.abs() <= 1.0, "{line}: {ours:?}");
        differences.push(difference);
    }
    assert!(differences.len() > 30, "{}", differences.len());
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    assert!(mean.abs() < 0.15, "the middles are {mean} columns apart");
}
