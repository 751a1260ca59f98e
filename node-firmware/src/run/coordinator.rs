//! A coordinator, the PC on its line, and the members of its network.

use core::{convert::Infallible, pin::pin, time::Duration};

use embassy_futures::select::{Either, Either3, select, select3};
use embedded_io_async::{Read, Write};
use flash_log::LogError;
use zigbee_link::{Instant, runner::Clock, wire::ShortAddress};

use super::{
    FlashError, SharedNode,
    drive::{AnyDriver, DeviceChannels, Events, RoleDriver, Services, Tasks, drive},
    outlined::Outlined,
};
use crate::{
    config::CoordinatorConfig,
    console::{self, FRAME_MAX, Frames, KeyChangeReport, ToPc},
    hardware::{Buttons, Hardware},
    role::coordinator::{CoordinatorEvent, CoordinatorRole, CoordinatorTask},
};

/// The longest frame takes a tenth of it at 9600 baud.
const PATIENCE_US: u64 = 1_000_000;

pub(super) async fn run<H: Hardware>(
    config: &CoordinatorConfig,
    services: Services<'_, H>,
    (uart, mut buttons): (H::Uart, H::Buttons),
) -> LogError<FlashError<H>> {
    let Services { shared, clock, .. } = services;
    let channels = DeviceChannels::new();
    let mut role = CoordinatorRole::new();
    if config.join_window_s > 0 {
        let window = Duration::from_secs(config.join_window_s.into());
        shared.with(|node, now| node.open_join_window(now, window));
    }
    let events = channels.events.sender();
    let driver = AnyDriver::Coordinator(RoleDriver::new(&mut role, &channels));
    let driven = drive(driver, services);
    let line = line::<H>(uart, shared, clock, channels.tasks.receiver(), events);
    let pressed = async {
        loop {
            let button = buttons.pressed().await;
            events.send(CoordinatorEvent::Button(button)).await;
        }
    };
    match select3(pin!(driven), Outlined(pin!(line)), pressed).await {
        Either3::First(error) => error,
        Either3::Second(never) => match never {},
        Either3::Third(never) => never,
    }
}

/// The PC, or nobody: what is written to a line without a reader is lost, and what it does not take
/// within [`PATIENCE_US`]. A line that fails is tried again with the next task.
async fn line<H: Hardware>(
    mut uart: H::Uart,
    shared: &SharedNode<'_, H>,
    clock: &H::Clock,
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
        match select(tasks.receive(), read).await {
            Either::First(task) => {
                let mut frame = [0; FRAME_MAX];
                if let Some(message) = perform::<H>(shared, task)
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
                        events.send(CoordinatorEvent::Pc(wish)).await;
                    }
                }
            }
            Either::Second(Err(_)) => is_open = false,
        }
    }
}

/// Does a task as far as it is the network's, and returns what the PC is to be told.
fn perform<H: Hardware>(shared: &SharedNode<'_, H>, task: CoordinatorTask) -> Option<ToPc> {
    let told = shared.with(|node, now| {
        match task {
            CoordinatorTask::Tell(message) => return Some(message),
            CoordinatorTask::OpenJoinWindow(window) => {
                node.open_join_window(now, window);
                return None;
            }
            CoordinatorTask::Remove(address) => {
                let short = ShortAddress(address);
                let member = node.members().find(|member| member.short == short);
                let success = member.is_some_and(|member| node.remove(now, member.extended));
                return Some(ToPc::Removed { address, success });
            }
            CoordinatorTask::ChangeKey(key) => {
                let begun = key.key().map(|key| node.change_key(key));
                if !matches!(begun, Some(Ok(()))) {
                    return Some(ToPc::KeyChange(None));
                }
            }
            CoordinatorTask::ChangePan => {
                let changes = node.change_pan(now);
                let conflict_s = seconds_since(now, node.last_conflict());
                return Some(ToPc::Pan {
                    conflict_s,
                    changes,
                });
            }
            CoordinatorTask::TellConflict => {
                let conflict_s = Some(seconds_since(now, node.last_conflict())?);
                return Some(ToPc::Pan {
                    conflict_s,
                    changes: false,
                });
            }
            CoordinatorTask::TellKeyChange => {}
        }
        Some(ToPc::KeyChange(node.key_change().map(|change| {
            KeyChangeReport {
                index: change.index,
                check: change.check,
                done: change.is_done,
                unreached: change.unreached,
            }
        })))
    });
    told.flatten()
}

fn seconds_since(Instant(now): Instant, then: Option<Instant>) -> Option<u32> {
    let seconds = now.saturating_sub(then?.0) / 1_000_000;
    Some(u32::try_from(seconds).unwrap_or(u32::MAX))
}
