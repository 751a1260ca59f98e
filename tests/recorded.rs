//! Recorded blobs in, poses out: what `host-sim solve` does with a file, from the library.

use std::{fs::File, io::BufReader};

use answers::accuracy::Comparisons;
use answers::answer::{Settings, Solver};
use answers::recorded::{self, sightings::Assumptions};
use calib_core::camera::Camera;
use test_support::data;

fn open(name: &str) -> BufReader<File> {
    BufReader::new(File::open(data(name)).unwrap())
}

/// Eleven cameras of Table 4.1 from Stage's blobs, decoded as what they are and as what the thesis
/// took them for: the camera model alone makes its errors.
#[test]
fn the_camera_model_makes_the_difference() {
    let view = 60_f64.to_radians();
    let accuracy = |camera: Camera<f64>| {
        let assumptions = Assumptions {
            camera: Some(camera),
            ..Assumptions::default()
        };
        let recording = recorded::sightings::read(
            open("stage13/seed1_sightings.csv"),
            &assumptions,
            |complaint| panic!("{complaint}"),
        )
        .unwrap();
        let truths = recorded::truth::read(
            open("thesis/table_4_1_truth.csv"),
            &recording,
            |complaint| panic!("{complaint}"),
        )
        .unwrap();
        let mut solver = Solver::new(Settings::default());
        let (mut comparisons, mut chi_squared, mut freedom) = (Comparisons::default(), 0.0, 0);
        for ((id, case), truth) in recording.cases().zip(&truths) {
            let answer = solver.answer(id, case);
            // Of the wrong model, doubtful.
            assert!(answer.is_kept(), "node {id}");
            let solution = answer.solution.unwrap();
            comparisons.add(&solution.pose, truth.as_ref());
            chi_squared += solution.chi_squared;
            freedom += solution.degrees_of_freedom();
        }
        let accuracy = comparisons.finish().unwrap();
        assert_eq!(accuracy.compared, 11);
        (accuracy, chi_squared / freedom as f64)
    };
    let (equal_angle, fit) = accuracy(Camera::equal_angle(88, view).unwrap());
    assert!(equal_angle.position.median < 0.08, "{equal_angle:?}");
    assert!(equal_angle.heading_degrees.median < 1.0, "{equal_angle:?}");
    assert!(equal_angle.position.rms < 0.1, "{equal_angle:?}");
    // Whole-pixel sigmas explain the residuals of the right model, and not those of the wrong one.
    let (pin_hole, misfit) = accuracy(Camera::pin_hole(88, view).unwrap());
    assert!(
        pin_hole.position.median > 2.0 * equal_angle.position.median,
        "{pin_hole:?}"
    );
    assert!(fit < 3.0 && misfit > 2.0 * fit, "{fit} {misfit}");
}
