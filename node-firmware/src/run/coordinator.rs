//! A coordinator, the PC on its line, and the members of its network.

use core::{convert::Infallible, pin::pin, time::Duration};

use embassy_futures::select::{Either, Either3, select, select3};
use embedded_io_async::{Error, ErrorKind, Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use zigbee_link::{Instant, runner::Clock, wire::ShortAddress};

use super::{
    drive::{AnyDriver, DeviceChannels, Events, RoleDriver, Services, Tasks, drive},
    outlined::Outlined,
    update::Mail,
};
use crate::{
    config::CoordinatorConfig,
    console::{self, FRAME_MAX, Frames, ToPc},
    hardware::{Buttons, Hardware},
    network::{Administration, Network},
    role::coordinator::{CoordinatorEvent, CoordinatorRole, CoordinatorTask},
};

/// The longest frame takes a tenth of it at 9600 baud.
const PATIENCE_US: u64 = 1_000_000;

pub(super) async fn run<H: Hardware, N: Network + Administration, F: NorFlash>(
    config: &CoordinatorConfig,
    services: Services<'_, H, N, F>,
    (uart, mut buttons): (H::Uart, H::Buttons),
) -> Infallible {
    let Services {
        network,
        clock,
        mail,
        ..
    } = services;
    let channels = DeviceChannels::new();
    let mut role = CoordinatorRole::new();
    role.track(config);
    if config.join_window_s > 0 {
        let window = Duration::from_secs(config.join_window_s.into());
        network.open_join_window(window);
    }
    let events = channels.events.sender();
    let driver = AnyDriver::Coordinator(RoleDriver::new(&mut role, &channels));
    let driven = drive(driver, services);
    let line = line(
        uart,
        (network, mail),
        clock,
        channels.tasks.receiver(),
        events,
    );
    let pressed = async {
        loop {
            let button = buttons.pressed().await;
            events.send(CoordinatorEvent::Button(button)).await;
        }
    };
    match select3(pin!(driven), Outlined(pin!(line)), pressed).await {
        Either3::First(never) => match never {},
        Either3::Second(never) => match never {},
        Either3::Third(never) => never,
    }
}

/// The PC, or no PC: bytes for a line without a reader are lost, and so are bytes that it does not take
/// within [`PATIENCE_US`]. A line that fails is tried again with the next task.
async fn line<U: Read + Write>(
    mut uart: U,
    (network, mail): (&impl Administration, &Mail),
    clock: &impl Clock,
    tasks: Tasks<'_, CoordinatorTask>,
    events: Events<'_, CoordinatorEvent>,
) -> Infallible {
    let mut frames = Frames::default();
    let mut bytes = [0; 32];
    let mut is_open = true;
    loop {
        let read = async {
            if is_open {
                uart.read(&mut bytes).await
            } else {
                core::future::pending().await
            }
        };
        match select(mail.or_answer(tasks), read).await {
            Either::First(task) => {
                let mut frame = [0; FRAME_MAX];
                if let Some(message) = perform(network, task)
                    && let Some(frame) = console::encode(&message, &mut frame)
                {
                    let until = Instant(clock.now().0.saturating_add(PATIENCE_US));
                    let written = select(uart.write_all(frame), clock.sleep_until(until)).await;
                    is_open = !matches!(written, Either::First(Err(_)));
                }
            }
            Either::Second(Ok(count)) => {
                is_open = count > 0;
                debug_assert!(
                    count <= bytes.len(),
                    "a line returns no more than it was given"
                );
                for &byte in bytes.iter().take(count) {
                    if let Some(wish) = frames.push(byte) {
                        mail.on_pc(&wish);
                        events.send(CoordinatorEvent::Pc(wish)).await;
                    }
                }
            }
            // Lost bytes are a message that the checksum refuses, and the PC repeats.
            Either::Second(Err(error)) => is_open = error.kind() == ErrorKind::Interrupted,
        }
    }
}

/// Does a task as far as it is the network's, and returns the message for the PC.
fn perform(network: &impl Administration, task: CoordinatorTask) -> Option<ToPc> {
    Some(match task {
        CoordinatorTask::Tell(message) => message,
        CoordinatorTask::TellNetwork => ToPc::Network(network.info()),
        CoordinatorTask::OpenJoinWindow(window) => {
            network.open_join_window(window);
            return None;
        }
        CoordinatorTask::Remove(address) => ToPc::Removed {
            address,
            success: network.remove(ShortAddress(address)),
        },
        CoordinatorTask::ChangePan => {
            let changes = network.change_identifier();
            let conflict_s = network.conflict_s();
            ToPc::Pan {
                conflict_s,
                changes,
            }
        }
        CoordinatorTask::TellConflict => ToPc::Pan {
            conflict_s: Some(network.conflict_s()?),
            changes: false,
        },
        CoordinatorTask::ChangeKey(key) if !network.change_key(key) => ToPc::KeyChange(None),
        CoordinatorTask::ChangeKey(_) | CoordinatorTask::TellKeyChange => {
            ToPc::KeyChange(network.key_change())
        }
    })
}
