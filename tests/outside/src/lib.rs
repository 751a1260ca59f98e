//! Each library used once, over a board of which only the traits of its HAL are known.
#![no_std]
#![forbid(unsafe_code)]

pub mod board;

use board::{Flash, Ticks, Uart};
use calib_core::{Sighting, camera::Camera, nalgebra::Point2, resection};
use cmucam2_driver::{Cmucam2, colour::ColourBounds, session::Policy};
use core::time::Duration;
use flash_log::{Entry, Log, LogError};
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    liveness::Liveness,
    run::run,
};
use pedestrian::{ImuSample, InvalidSetting, Pedestrian, PedestrianSettings, nalgebra::Vector3};
use pixy_driver::{Model, Pixy, packet::Signatures};
use spinel_radio::SpinelRadio;
use zigbee_link::{
    radio::{PSDU_MAX, Radio, RadioConfig},
    runner::{Clock, Delay},
};

/// Place of a camera that saw a target at three places.
///
/// # Errors
/// There is none.
pub fn place(columns: [f32; 3]) -> Result<[f32; 2], calib_core::Error> {
    let camera = Camera::pin_hole(88, 1.0_f32)?;
    let places = [[6.0, 2.0], [7.0, -1.5], [3.0, -0.5]];
    let seen: [_; 3] = core::array::from_fn(|n| {
        let (ray, sigma) = (camera.ray(columns[n]), camera.whole_pixel_sigma(columns[n]));
        Sighting::new(Point2::from(places[n]), ray, sigma)
    });
    Ok(resection::solve(&seen)?.pose.position.into())
}

/// The column in which a CMUcam2 sees an orange ball.
pub async fn orange(uart: Uart) -> Option<u8> {
    let orange = ColourBounds::new([170, 240, 60, 180, 16, 100]).ok()?;
    // One clock serves the link, the delay and the driver.
    let clock = || Ticks.now().0;
    let mut camera = Cmucam2::with_clock(uart, Delay(Ticks), clock, Policy::default());
    camera.track_colour(orange).run().await.ok()?;
    let tracking = camera.next_tracking().run().await.ok()??;
    tracking.centroid().map(|(x, _)| x)
}

/// The column in which a Pixy2 sees its first signature.
pub async fn signature(uart: Uart) -> Option<u16> {
    let mut camera = Pixy::new(Model::Pixy2, uart, Delay(Ticks));
    let mut blocks = camera.blocks(Signatures::one(1), 1).run().await.ok()?;
    blocks.next().map(|block| block.x)
}

/// Steps until a sample is refused.
///
/// # Errors
/// A setting is refused.
pub fn steps(samples: impl Iterator<Item = (Duration, [f32; 9])>) -> Result<usize, InvalidSetting> {
    let mut person = Pedestrian::new(PedestrianSettings::default())?;
    let steps = samples.map_while(|(at, [ax, ay, az, gx, gy, gz, mx, my, mz])| {
        let sample = ImuSample {
            acceleration: Vector3::new(ax, ay, az),
            angular_rate: Vector3::new(gx, gy, gz),
            magnetic_field: Some(Vector3::new(mx, my, mz)),
        };
        person.update(at, &sample).ok()
    });
    Ok(steps.flatten().count())
}

/// Counts the starts of a board.
///
/// # Errors
/// The flash fails.
pub async fn starts(flash: Flash) -> Result<u8, LogError<board::Failed>> {
    let mut log = Log::<_, 32>::new(flash, 0..2 * board::PAGE)?;
    log.open().await?;
    let before = log.find(1).await?;
    let count = before.and_then(|entry| entry.value().first().copied());
    let count = count.unwrap_or(0).wrapping_add(1);
    let entry = Entry::new(1, &[count]).ok_or(LogError::Full)?;
    log.append(&entry).await?;
    Ok(count)
}

/// Length of the next frame that a radio co-processor hears.
pub async fn hear(uart: Uart, config: &RadioConfig) -> Option<usize> {
    let mut radio = SpinelRadio::<_, _>::new(uart, Ticks);
    radio.configure(config).await.ok()?;
    let mut buffer = [0; PSDU_MAX];
    Some(radio.receive(&mut buffer).await.ok()?.len)
}

/// A whole node, until it cannot go on.
pub async fn node(
    config: &CheckedConfig,
    peripherals: Peripherals<impl Hardware>,
    liveness: &Liveness,
) {
    run(config, peripherals, liveness).await;
}
