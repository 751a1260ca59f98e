//! Where a camera hangs that looks down and leans: `cargo run -p calib-core --example tilted`.
//!
//! It hangs three metres high, and saw a target on the floor at five places, in columns and rows. Its height is known
//! from a tape; heading, pitch, roll and place are not.

use calib_core::{
    Limits, Status,
    camera::Projection,
    nalgebra::{Point3, Vector2, Vector3},
    space::{self, Lens, Pose, Priors, Sighting, Told},
};

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let lens = Lens {
        projection: Projection::PinHole,
        focal: Vector2::new(280.0, 280.0),
        principal: Vector2::new(157.5, 103.5),
        distortion: Vector2::zeros(),
        sigmas: Vector3::zeros(),
    };
    let truth = Pose {
        position: Point3::new(1.0, 2.0, 3.0),
        heading: 0.4,
        pitch: 35_f64.to_radians(),
        roll: 4_f64.to_radians(),
    };
    let floor = [[4.0, 3.0], [5.5, 4.0], [6.0, 2.8], [4.5, 4.4], [7.0, 4.5]];
    let mut sightings = Vec::new();
    for [x, y] in floor {
        let target = Point3::new(x, y, 0.0);
        let pixel = lens.pixel(&(truth.axes() * (target - truth.position)));
        sightings.push(Sighting {
            target,
            target_sigma: Vector3::repeat(0.02),
            // A camera tells whole pixels.
            pixel: pixel.ok_or("out of view")?.map(f64::round),
            pixel_sigma: 0.5,
        });
    }
    let priors = Priors {
        height: Some(Told {
            value: 3.0,
            sigma: 0.02,
        }),
        ..Priors::default()
    };
    let solution = space::solve(&sightings, &lens, &priors)?;
    let (pose, sigmas) = (solution.pose, solution.sigmas());
    println!(
        "x {:.2}, y {:.2}, z {:.2} m",
        pose.position.x, pose.position.y, pose.position.z
    );
    let angles = [pose.heading, pose.pitch, pose.roll].map(f64::to_degrees);
    println!(
        "heading {:.1}, pitch {:.1}, roll {:.1} deg",
        angles[0], angles[1], angles[2]
    );
    let limits = Limits {
        position: 0.3,
        heading: 2_f64.to_radians(),
    };
    println!("{}", solution.status(&limits));
    assert_eq!(solution.status(&limits), Status::Calibrated);
    let off = pose.position - truth.position;
    assert!((0..3).all(|axis| off[axis].abs() < 4.0 * sigmas[axis]));
    Ok(())
}
