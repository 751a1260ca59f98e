//! A target and its step sensor.

use core::{convert::Infallible, pin::pin, time::Duration};

use calib_core::joint::{BearingStorage, StopStorage, UnknownStorage};
use embassy_futures::select::{Either3, select3};
use embedded_storage_async::nor_flash::NorFlash;
use zigbee_link::runner::Clock;

use super::{
    drive::{AnyDriver, DeviceChannels, Events, RoleDriver, Services, drive},
    outlined::Outlined,
};
use crate::{
    config::TargetConfig,
    hardware::{Hardware, StepSensor},
    limits::{ESTIMATED_STOPS, WALK_BEARINGS},
    message::StopNumber,
    network::Network,
    role::moving_target::{
        CAMERAS, EstimateMemory, TargetEvent, TargetRole, TargetTask, WORKSPACE,
    },
};

/// After a failure of the sensor.
const PAUSE: Duration = Duration::from_secs(1);

pub(super) async fn run<H: Hardware, N: Network, F: NorFlash>(
    (id, first_stop): (u16, StopNumber),
    config: &TargetConfig,
    services: Services<'_, H, N, F>,
    mut steps: H::Steps,
) -> Infallible {
    let (clock, network) = (services.clock, services.network);
    let channels = DeviceChannels::new();
    // Each on its own: together they would be made on the stack first.
    let mut cameras = [UnknownStorage::default(); CAMERAS];
    let mut stops = [StopStorage::default(); ESTIMATED_STOPS];
    let mut bearings = [BearingStorage::default(); WALK_BEARINGS];
    let mut workspace = [0.0; WORKSPACE];
    let mut told = [None; CAMERAS];
    let memory = EstimateMemory {
        cameras: &mut cameras,
        stops: &mut stops,
        bearings: &mut bearings,
        workspace: &mut workspace,
        told: &mut told,
    };
    let mut role = TargetRole::new(id, *config, first_stop);
    role.estimate_in(memory);
    let driver = AnyDriver::Target(RoleDriver::new(&mut role, &channels));
    let driven = drive(driver, services);
    let sensed = sense(&mut steps, clock, channels.events.sender());
    let tasks = channels.tasks.receiver();
    let roaming = async {
        loop {
            let TargetTask::Roam = tasks.receive().await;
            network.roam();
        }
    };
    match select3(pin!(driven), Outlined(pin!(sensed)), pin!(roaming)).await {
        Either3::First(never) | Either3::Second(never) | Either3::Third(never) => match never {},
    }
}

async fn sense<C: Clock, S: StepSensor>(
    steps: &mut S,
    clock: &C,
    events: Events<'_, TargetEvent>,
) -> Infallible {
    loop {
        let event = match steps.next().await {
            Ok(Some(step)) => TargetEvent::Step(step),
            Ok(None) => TargetEvent::Sensor(None),
            Err(fault) => TargetEvent::Sensor(Some(fault)),
        };
        events.send(event).await;
        if let TargetEvent::Sensor(Some(_)) = event {
            clock.sleep_until(clock.now() + PAUSE).await;
        }
    }
}
