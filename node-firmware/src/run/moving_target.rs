//! A target and its step sensor.

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embedded_storage_async::nor_flash::NorFlash;
use flash_log::LogError;
use zigbee_link::runner::Clock;

use super::{
    apart::Apart,
    drive::{Actor, AtDesk, Desk, Events, Surroundings, drive},
};
use crate::{
    config::TargetConfig,
    hardware::{Indicator, Observer, StepSensor},
    log::warning,
    message::StopNumber,
    role::moving_target::{TargetEvent, TargetRole},
};

/// After a failure of the sensor.
const PAUSE_US: u64 = 1_000_000;

pub(super) async fn run<C, F, O, S, I>(
    (id, first_stop): (u16, StopNumber),
    config: &TargetConfig,
    surroundings: Surroundings<'_, C, F, O, I>,
    mut steps: S,
) -> LogError<F::Error>
where
    C: Clock,
    F: NorFlash,
    O: Observer,
    S: StepSensor,
    I: Indicator,
{
    let clock = surroundings.clock;
    let desk = Desk::new();
    let mut role = TargetRole::new(id, *config, first_stop);
    let driven = drive(Actor::Target(AtDesk::new(&mut role, &desk)), surroundings);
    let sensed = sense(&mut steps, clock, desk.events.sender());
    match select(pin!(driven), Apart(pin!(sensed))).await {
        Either::First(error) => error,
        Either::Second(never) => match never {},
    }
}

async fn sense<C: Clock, S: StepSensor>(
    steps: &mut S,
    clock: &C,
    events: Events<'_, TargetEvent>,
) -> core::convert::Infallible {
    loop {
        match steps.next().await {
            Ok(step) => events.send(TargetEvent::Step(step)).await,
            Err(_) => {
                warning!("the step sensor failed: the target is lost");
                events.send(TargetEvent::SensorFailed).await;
                let now = clock.now().0;
                let then = zigbee_link::Instant(now.saturating_add(PAUSE_US));
                clock.sleep_until(then).await;
            }
        }
    }
}
