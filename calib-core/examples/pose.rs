//! Where a camera stands, from four sightings: `cargo run -p calib-core --example pose`.
//!
//! The camera has 88 columns and a view of 60 degrees. A target with a ball stood at four known places, and was seen
//! in these whole columns.

use calib_core::{Limits, Sighting, Status, camera::Camera, nalgebra::Point2, resection};

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let camera = Camera::pin_hole(88, 60_f64.to_radians())?;
    let seen = [
        (6.0, 2.0, 19.0),
        (7.0, -1.5, 60.0),
        (3.0, -0.5, 56.0),
        (4.0, 1.0, 24.0),
    ];
    let sightings = seen.map(|(x, y, column)| {
        let (ray, sigma) = (camera.ray(column), camera.whole_pixel_sigma(column));
        // The places themselves were measured to 2 cm.
        Sighting::new(Point2::new(x, y), ray, sigma).with_target_sigma(0.02)
    });
    let solution = resection::solve(&sightings)?;
    println!("{}", solution.pose);

    // Sigmas alone are a promise. The fit tells if the sightings agree with it.
    let limits = Limits {
        position: 0.2,
        heading: 2_f64.to_radians(),
    };
    let status = Status::of(&solution.pose, &solution.fit(), &limits);
    println!("{status}, from {} sightings", sightings.len());
    assert_eq!(status, Status::Calibrated);

    // Three sightings of one place answer nothing, and that is said.
    let [first, ..] = sightings;
    let refusal = resection::solve(&[first; 3]).unwrap_err();
    println!("refused: {refusal}");
    Ok(())
}
