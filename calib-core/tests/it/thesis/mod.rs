//! The thesis's own equations, kept as documented originals: what the library does instead agrees
//! with them where they hold, and these tests show where they do not.

mod printed_residuals;
use crate::scene;
mod slope_form;
use crate::two_cameras;

use calib_core::{Ray, Refusal, Sighting, resection::three_point};
use nalgebra::{Point2, Vector6};
use printed_residuals::Offsets;
use proptest::prelude::*;
use scene::{regular_scene, sighting};
use test_support::{Truth, generator, normal, turn};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn exact_sightings_give_the_exact_pose(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        let slope = slope_form::solve(&sightings).unwrap();
        prop_assert!((slope.position - truth.position()).norm() < 1e-7);
        prop_assert!(turn(slope_form::fix_up(&slope, &sightings), truth.heading).abs() < 1e-7);
    }

    /// Both closed forms are the same function of the same noisy bearings.
    #[test]
    fn slopes_and_rays_agree(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let mut rng = generator(seed ^ 1);
        let sightings = targets.map(|t| sighting(&truth, t, 0.002 * normal(&mut rng), 0.002));
        let Ok(pose) = three_point::solve(&sightings) else { return Ok(()) };
        prop_assume!(pose.sigma_position() < 1.0);
        let slope = slope_form::solve(&sightings).unwrap();
        prop_assert!((slope.position - pose.position).norm() < 1e-6);
        prop_assert!(turn(slope_form::fix_up(&slope, &sightings), pose.heading).abs() < 1e-6);
    }

    #[test]
    fn whatever_is_seen_no_answer_is_not_a_number(
        numbers in prop::array::uniform3(prop::array::uniform4(any_number())),
    ) {
        let sightings = numbers.map(|[x, y, forward, left]| {
            Sighting::new(Point2::new(x, y), Ray { forward, left }, 0.01)
        });
        match slope_form::solve(&sightings) {
            Ok(fix) => prop_assert!(fix.theta.is_finite() && fix.position.coords.iter().all(|v| v.is_finite())),
            Err(why) => prop_assert!(matches!(
                why,
                Refusal::NotFinite | Refusal::TargetBehind | Refusal::DangerCircle
            )),
        }
    }
}

/// Ordinary numbers, awkward ones, and a few that many inputs share.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        1 => any::<f64>(),
        2 => prop::sample::select(vec![0.0, 1.0, -1.0, 0.01, f64::NAN, f64::INFINITY, 1e-300, 1e300]),
    ]
}

/// The two flaws of the printed quadrant rule; the fix-up has neither.
#[test]
fn printed_quadrant_rule_is_wrong_twice() {
    let degrees = f64::to_degrees;
    // Heading 95 degrees, the target nearest to the axis at a bearing of 85.
    let truth = Truth {
        x: 1.0,
        y: 1.0,
        heading: 95_f64.to_radians(),
    };
    let targets = [(4.0, -10.0), (3.0, 20.0), (6.0, -25.0)]
        .map(|(range, off): (f64, f64)| truth.place(range, off.to_radians()));
    let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
    let fix = slope_form::solve(&sightings).unwrap();
    assert!((degrees(fix.theta) + 85.0).abs() < 1e-9);
    assert!((degrees(slope_form::fix_up_as_printed(&fix, &sightings)) + 85.0).abs() < 1e-9);
    assert!((degrees(slope_form::fix_up(&fix, &sightings)) - 95.0).abs() < 1e-9);

    // The target exactly above: its bearing is returned, and not the heading of 80 degrees. An
    // exact zero in floating point needs numbers without rounding.
    let above = slope_form::SlopeFix {
        position: Point2::new(0.0, 0.0),
        theta: 80_f64.to_radians(),
    };
    let at = |x: f64, y: f64, off: f64| {
        Sighting::new(Point2::new(x, y), Ray::from_bearing(off.to_radians()), 0.01)
    };
    let sightings = [at(0.0, 3.0, 10.0), at(1.0, 2.0, -16.6), at(-1.0, 2.0, 36.6)];
    assert!((degrees(slope_form::fix_up_as_printed(&above, &sightings)) - 90.0).abs() < 1e-9);
    assert!((degrees(slope_form::fix_up(&above, &sightings)) - 80.0).abs() < 1e-9);
}

/// A heading of exactly 90 degrees makes the slope infinite.
#[test]
fn slope_form_survives_the_vertical() {
    for quarter in 0..4 {
        let truth = Truth {
            x: 0.5,
            y: -1.0,
            heading: f64::from(quarter) * core::f64::consts::FRAC_PI_2,
        };
        let targets = [(4.0, -0.2), (3.0, 0.3), (6.0, 0.4)].map(|(r, b)| truth.place(r, b));
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        let fix = slope_form::solve(&sightings).unwrap();
        let heading = slope_form::fix_up(&fix, &sightings);
        assert!(turn(heading, truth.heading).abs() < 1e-9);
    }
}

/// The six residuals in print determine four unknowns, at every geometry; and every pair of
/// headings, however wrong, makes all of them zero.
#[test]
fn printed_residuals_have_rank_four() {
    for seed in 0..200 {
        let scene = two_cameras::scene(seed, 2);
        let bearing = |k: usize, n: usize| scene.cameras[k].bearing_of(scene.stops[n]);
        let offsets = Offsets {
            camera0: [bearing(0, 0), bearing(0, 1)],
            camera1: [bearing(1, 0), bearing(1, 1)],
            baseline: scene.baseline,
        };
        let solution = |headings: [f64; 2]| {
            // Each stop by the sine rule, from whatever headings are claimed.
            let ranges = |n: usize| {
                let b0 = headings[0] + bearing(0, n);
                let b1 = headings[1] + bearing(1, n);
                let apex = (b1 - b0).sin();
                [
                    scene.baseline * b1.sin() / apex,
                    scene.baseline * b0.sin() / apex,
                ]
            };
            let ([l00, l10], [l01, l11]) = (ranges(0), ranges(1));
            Vector6::new(headings[0], headings[1], l00, l01, l10, l11)
        };
        let truth = solution([scene.cameras[0].heading, scene.cameras[1].heading]);
        let range = (scene.stops[0].coords).norm();
        assert!(
            (truth.z - range).abs() < 1e-6 * range,
            "the truth is a solution"
        );
        for x in [truth, solution([0.3, 1.9]), solution([4.0, 2.5])] {
            let size = x.amax().max(1.0);
            assert!(offsets.residuals(&x).amax() < 1e-9 * size, "a perfect zero");
            let singular = offsets.jacobian(&x).singular_values();
            assert!(
                singular[4] < 1e-9 * singular[0] && singular[3] > 1e-9 * singular[0],
                "{singular}"
            );
        }
        // The Jacobian is the derivative of the residuals, also away from a solution.
        let x = truth + Vector6::new(0.1, -0.2, 0.3, 0.5, -0.4, 0.2);
        for i in 0..6 {
            let mut h = Vector6::zeros();
            h[i] = 1e-6;
            let numeric = (offsets.residuals(&(x + h)) - offsets.residuals(&(x - h))) / 2e-6;
            assert!((numeric - offsets.jacobian(&x).column(i)).amax() < 1e-6 * x.amax());
        }
    }
}
