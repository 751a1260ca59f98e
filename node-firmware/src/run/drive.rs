//! A role between its link, its memory and its devices.

use core::future::poll_fn;

use embassy_futures::select::{Either3, select3};
use embassy_sync::{
    blocking_mutex::raw::NoopRawMutex,
    channel::{Channel, Receiver, Sender, TrySendError},
};
use embedded_storage_async::nor_flash::NorFlash;
use zigbee_link::{
    link::{Delivery, SendError, Ticket},
    network::Status,
    runner::{Clock, Happened},
    store::log::LogError,
    wire::ShortAddress,
};

use super::{QUEUE, SharedNode};
use crate::{
    hardware::{Indicator, Observer},
    log::debug,
    memory::Memory,
    message::Message,
    role::{Output, Role},
};

/// Tasks or events that wait. Devices that are slower make the role keep its next task to itself;
/// a role that is slower makes its devices wait.
const WAITING: usize = 4;

/// What a role and its devices tell each other.
pub(super) struct Desk<T, E> {
    pub(super) tasks: Channel<NoopRawMutex, T, WAITING>,
    pub(super) events: Channel<NoopRawMutex, E, WAITING>,
}

impl<T, E> Desk<T, E> {
    pub(super) const fn new() -> Self {
        Self {
            tasks: Channel::new(),
            events: Channel::new(),
        }
    }
}

/// What all roles have around them.
pub(super) struct Surroundings<'a, C, F, O> {
    pub(super) shared: &'a SharedNode<&'a C>,
    pub(super) clock: &'a C,
    pub(super) memory: &'a mut Memory<F>,
    pub(super) observer: &'a mut O,
}

/// The devices' side of a desk.
pub(super) type Tasks<'a, T> = Receiver<'a, NoopRawMutex, T, WAITING>;
/// The devices' side of a desk.
pub(super) type Events<'a, E> = Sender<'a, NoopRawMutex, E, WAITING>;

/// Drives a role. Returns only when its memory failed.
pub(super) async fn drive<R, C, F, I, O>(
    role: &mut R,
    surroundings: Surroundings<'_, C, F, O>,
    desk: &Desk<R::Task, R::Event>,
    indicator: &mut I,
) -> LogError<F::Error>
where
    R: Role,
    C: Clock,
    F: NorFlash,
    I: Indicator,
    O: Observer,
{
    let Surroundings {
        shared,
        clock,
        memory,
        observer,
    } = surroundings;
    if let Err(error) = memory.recall(|fact| role.remember(fact)).await {
        return error;
    }
    let mut status = Status::Out;
    let mut on_the_way = heapless::Vec::<(Ticket, R::Errand), QUEUE>::new();
    let mut held: Option<(ShortAddress, Message, Option<R::Errand>)> = None;
    let mut held_task = None;
    let mut shown = None;
    loop {
        // What the role wants. Where it has to wait, for the link or for its devices, it goes on
        // hearing: these may wait for it, too.
        loop {
            if let Some(task) = held_task.take()
                && let Err(TrySendError::Full(task)) = desk.tasks.try_send(task)
            {
                held_task = Some(task);
                break;
            }
            let now = clock.now();
            let next = match held.take() {
                Some(held) => Some(held),
                None => match role.poll(now) {
                    Some(Output::Send {
                        to,
                        message,
                        errand,
                    }) => Some((to, message, errand)),
                    Some(Output::Save(fact)) => {
                        observer.learns(&fact);
                        if let Err(error) = memory.save(&fact).await {
                            return error;
                        }
                        continue;
                    }
                    Some(Output::Task(task)) => {
                        held_task = Some(task);
                        continue;
                    }
                    None => None,
                },
            };
            let Some((to, message, errand)) = next else {
                break;
            };
            match shared.with(|node, now| node.link.send(now, to, &message)) {
                Ok(ticket) => {
                    observer.sends(to, &message);
                    if let Some(errand) = errand {
                        // As many as the queue of the link has places.
                        let _ = on_the_way.push((ticket, errand));
                    }
                }
                Err(SendError::QueueFull) => {
                    held = Some((to, message, errand));
                    break;
                }
                Err(error) => {
                    debug!("not sent: {}", error);
                    if let Some(errand) = errand {
                        role.sent(now, errand, false);
                    }
                }
            }
        }
        let indication = role.indication();
        if shown != Some(indication) {
            indicator.show(indication);
            shown = Some(indication);
        }

        // What happens.
        let deadline = role.deadline();
        let is_held = (held.is_some(), held_task.is_some());
        let wake = async {
            match (deadline, is_held) {
                (_, (_, true)) => poll_fn(|context| desk.tasks.poll_ready_to_send(context)).await,
                // Not before the link has room, which is something that happens.
                (Some(deadline), (false, _)) => clock.sleep_until(deadline).await,
                _ => core::future::pending().await,
            }
        };
        let happened = shared.happened::<Message>(status);
        match select3(happened, desk.events.receive(), wake).await {
            Either3::First(Happened::Message(from, message)) => {
                role.message(clock.now(), from, &message);
            }
            Either3::First(Happened::Settled(ticket, delivery)) => {
                if let Some(place) = on_the_way.iter().position(|(on, _)| *on == ticket) {
                    let (_, errand) = on_the_way.swap_remove(place);
                    let delivered = delivery != Delivery::NoAnswer;
                    role.sent(clock.now(), errand, delivered);
                }
            }
            Either3::First(Happened::Status(new)) => {
                status = new;
                let network = match new {
                    Status::Joined(membership) => Some(membership),
                    _ => None,
                };
                role.attached(clock.now(), network);
            }
            Either3::Second(event) => role.event(clock.now(), event),
            Either3::Third(()) => {}
        }
    }
}
