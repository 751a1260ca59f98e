//! Steps from recorded samples: `cargo run -p pedestrian --example recorded [FILE]`.
//!
//! A line of the file is a sample: milliseconds, acceleration x y z (m/s^2), angular rate x y z (rad/s), magnetic field
//! x y z (any unit), with spaces between. Without a file it takes a person who stands, walks nine steps, turns to the
//! left and walks nine more.

use std::{f64::consts::FRAC_PI_2, time::Duration};

use pedestrian::{ImuSample, Pedestrian, PedestrianSettings, nalgebra::Vector3};

type Recorded = (Duration, ImuSample<f64>);

/// A sample from a line.
fn parse(line: &str) -> Result<Recorded, Box<dyn std::error::Error>> {
    let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
    let numbers: [f64; 10] = numbers?
        .try_into()
        .map_err(|_| format!("ten numbers are wanted, not \"{line}\""))?;
    let [ms, parts @ ..] = numbers;
    let vector = |from: usize| Vector3::from_column_slice(&parts[from..from + 3]);
    let sample = ImuSample {
        acceleration: vector(0),
        angular_rate: vector(3),
        magnetic_field: Some(vector(6)),
    };
    Ok((Duration::try_from_secs_f64(ms / 1e3)?, sample))
}

/// A walk of 22 seconds, 50 samples a second.
fn walk() -> Vec<Recorded> {
    let sample = |i: u64| {
        let time = i as f64 / 50.0;
        let walks = (3.0..8.0).contains(&time) || (12.0..17.0).contains(&time);
        let bounce = if walks {
            3.0 * (11.3 * time).sin()
        } else {
            0.0
        };
        // A quarter turn within two seconds.
        let rate = if (9.0..11.0).contains(&time) {
            FRAC_PI_2 / 2.0
        } else {
            0.0
        };
        let turned = FRAC_PI_2 * ((time - 9.0) / 2.0).clamp(0.0, 1.0);
        let sample = ImuSample {
            acceleration: Vector3::new(0.0, 0.0, 9.81 + bounce),
            angular_rate: Vector3::new(0.0, 0.0, rate),
            magnetic_field: Some(Vector3::new(
                20.0 * turned.cos(),
                -20.0 * turned.sin(),
                -43.0,
            )),
        };
        (Duration::from_millis(20 * i), sample)
    };
    (0..1100).map(sample).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1);
    let samples = match &file {
        Some(file) => std::fs::read_to_string(file)?
            .lines()
            .map(parse)
            .collect::<Result<_, _>>()?,
        None => walk(),
    };
    let mut person = Pedestrian::new(PedestrianSettings::default())?;
    let (mut east, mut north, mut steps) = (0.0, 0.0, 0);
    for (time, sample) in &samples {
        if let Some(step) = person.update(*time, sample)? {
            steps += 1;
            east += step.distance * step.heading.cos();
            north += step.distance * step.heading.sin();
            let heading = step.heading.to_degrees();
            println!("step {steps}: {:.2} m to {heading:.0} deg", step.distance);
        }
    }
    println!("{steps} steps, {east:.2} m to the east and {north:.2} m to the north");
    if file.is_none() {
        // As far to the north as to the west.
        assert!(steps >= 16 && north > 5.0 && (north + east).abs() < 1.0);
    }
    Ok(())
}
