//! Speed of the way from video to packets, on one core:
//! `cargo run --release -p host-sim --example video`.
//!
//! 1280 x 720 pixels in 4:2:0, read from memory as from a pipe. Every picture is scaled, adapted to and
//! tracked in, 50 of them a second.

use std::{
    io::Cursor,
    sync::Arc,
    time::{Duration, Instant},
};

use cmucam2_emulator::{Background, Configuration, Emulator, Extent, Scene, Sensor, Shape, Time};
use host_sim::video::Video;

const SECOND: Time = 1_000_000_000;
const FRAMES: usize = 500;
/// Number of pictures that are kept in memory.
const CLIP: usize = 20;
const PERIOD: Time = SECOND / 50;

fn main() {
    let (width, height) = (1280, 720);
    let ball = Scene::with_object(
        [220, 110, 40],
        Shape::Disc,
        Extent::centred(0.4, 0.5, 0.1, 0.18),
    );
    let Some(picture) = ball.picture(0.0, width, height) else {
        return;
    };
    let mut one = b"FRAME\n".to_vec();
    one.extend(picture.luminance.samples());
    for plane in picture.chrominance.iter().flatten() {
        one.extend(plane.scaled(width as u16 / 2, height as u16 / 2).samples());
    }
    let header = format!("YUV4MPEG2 W{width} H{height} F50:1 C420jpeg XCOLORRANGE=FULL\n");
    for (name, sensor, high) in [
        ("88 x 143", Sensor::Ov6620, false),
        ("176 x 255", Sensor::Ov6620, true),
        ("160 x 239", Sensor::Ov7620, false),
    ] {
        for command in ["TC 150 240 50 200 16 100\r", "FD 10\r", "GM\r"] {
            let film = [header.as_bytes(), &one.repeat(CLIP)].concat();
            let mut camera = Emulator::new(
                Configuration {
                    sensor,
                    ..Configuration::default()
                },
                Scene::default(),
            );
            let mut now = SECOND;
            let mut say = |camera: &mut Emulator, line: &str| {
                line.bytes().for_each(|byte| camera.receive(byte, now));
                now += SECOND;
                while camera.transmit(now).is_some() {}
            };
            if high {
                say(&mut camera, "HR 1\r");
            }
            say(&mut camera, command);
            let mut packets = 0;
            let mut spent = Duration::ZERO;
            for _ in 0..FRAMES / CLIP {
                let mut video = match Video::new(Cursor::new(film.clone())) {
                    Ok(video) => video,
                    Err(error) => return println!("{error}"),
                };
                let begun = Instant::now();
                while let Ok(Some(picture)) = video.next_picture() {
                    camera.scene_mut().background = Background::Picture(Arc::new(picture));
                    now += PERIOD;
                    while let Some((_, byte)) = camera.transmit(now) {
                        packets += u32::from(byte == b'\r');
                    }
                }
                spent += begun.elapsed();
            }
            let rate = FRAMES as f64 / spent.as_secs_f64();
            let command = command.trim();
            println!("{name}, {command}: {packets} packets, {rate:.0} pictures/s");
        }
    }
}
