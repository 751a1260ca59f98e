//! Accuracy of a ball's bearing, measured in video.

use std::path::Path;

use cmucam2_emulator::{Background, Configuration, Emulator, Lens, Scene, Sensor, Time};
use host_sim::video::Video;

use super::film::{BOUNDS, Shot, lit_ball, played, room};

const SECOND: Time = 1_000_000_000;
const BEARINGS: usize = 40;
/// Number of times a second that the ball's place changes: the video lingers.
const RATE: usize = 2;
const HALF_BALL: f64 = 0.07;

/// Bearing from one side to the other, in steps of no whole number of columns.
fn bearing(index: usize) -> f64 {
    (index as f64 / (BEARINGS - 1) as f64 - 0.5) * 32_f64.to_radians()
}

fn scene(lens: Lens, index: usize) -> Scene {
    let elevation = 0.1 * (index as f64).sin();
    let ball = lens.extent(bearing(index), elevation, 2.0 * HALF_BALL, 2.0 * HALF_BALL);
    Scene {
        background: room(1),
        objects: lit_ball(ball.unwrap()),
        ..Scene::default()
    }
}

/// Errors of the bearings that packets tell, the mean of both edges, radians.
fn errors(sensor: Sensor, lens: Lens, mut video: Video) -> Vec<f64> {
    let configuration = Configuration {
        sensor,
        ..Configuration::default()
    };
    let mut camera = Emulator::new(configuration, Scene::default());
    let mut time = SECOND;
    let say = |camera: &mut Emulator, time: Time, command: &str| {
        command
            .bytes()
            .chain(*b"\r")
            .for_each(|byte| camera.receive(byte, time));
        let until = time + SECOND / 4;
        let mut said = Vec::new();
        while let Some((_, byte)) = camera.transmit(until) {
            said.push(byte);
        }
        String::from_utf8(said).unwrap()
    };
    // The room's colours stay as they are, so that bounds are those of the drawing.
    say(&mut camera, time, "CR 19 32");
    say(&mut camera, time + SECOND / 2, "PM 1");
    let mut errors = Vec::new();
    for index in 0..BEARINGS {
        time += SECOND;
        let picture = video.at((index as f64 + 0.5) / RATE as f64).unwrap();
        camera.scene_mut().background = Background::Picture(picture);
        let said = say(&mut camera, time, &format!("TC {BOUNDS}"));
        let packet = said
            .split('T')
            .nth(1)
            .unwrap_or_else(|| panic!("{index}: {said:?}"));
        let numbers: Vec<f64> = { packet.split_whitespace() }
            .map_while(|number| number.parse().ok())
            .collect();
        // Columns count from 1; edges are half a column outside of the middles.
        let edges = [numbers[2] - 1.5, numbers[4] - 0.5].map(|column| lens.bearing(column));
        errors.push((edges[0] + edges[1]) / 2.0 - bearing(index));
    }
    errors
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// A column of the OV6620 is 0.54 degrees wide at 45 degrees, one of the OV7620 0.3. Whole columns
/// alone give a standard deviation of `1 / sqrt(24)` of that for the mean of two edges: 0.11 and 0.06
/// degrees.
#[test]
fn a_ball_in_video_is_where_it_was_filmed() {
    let folder = tempfile::tempdir().unwrap();
    for (sensor, columns, rows, limit) in [
        (Sensor::Ov6620, 88, 143, 0.17_f64),
        (Sensor::Ov7620, 160, 239, 0.10),
    ] {
        // The drawing is the same for all sensors: twice as wide pixels as tall ones, in its height too.
        let lens = Lens::new(45_f64.to_radians(), columns, rows).unwrap();
        let shot = |noise| Shot {
            width: 640,
            height: 360,
            rate: RATE,
            noise,
        };
        let filmed = |name: &str, noise, quality: Option<u8>| {
            let path = folder.path().join(name);
            let drawn = |index| scene(lens, index);
            match quality {
                Some(quality) => shot(noise).compressed(&path, quality, BEARINGS, drawn),
                None => shot(noise).file(&path, BEARINGS, drawn),
            }
            path
        };
        let open = |path: &Path| Video::open(path).unwrap();
        let clean = errors(sensor, lens, open(&filmed("clean.y4m", 0, None)));
        let noisy = errors(sensor, lens, open(&filmed("noisy.y4m", 30, None)));
        let usual = errors(sensor, lens, played(&filmed("usual.mp4", 12, Some(23))));
        let coarse = errors(sensor, lens, played(&filmed("coarse.mp4", 12, Some(38))));
        for (name, errors, limit) in [
            ("clean", &clean, limit),
            ("noise of 30 levels", &noisy, limit),
            ("H.264 at 23", &usual, limit),
            ("H.264 at 38", &coarse, 1.3 * limit),
        ] {
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            let rms = rms(errors);
            println!(
                "{sensor:?}, {name}: rms {:.3} deg, mean {:.3} deg",
                rms.to_degrees(),
                mean.to_degrees()
            );
            assert!(
                rms < limit.to_radians(),
                "{sensor:?}, {name}: {}",
                rms.to_degrees()
            );
            assert!(mean.abs() < 0.08_f64.to_radians(), "{sensor:?}, {name}");
        }
    }
}
