//! A role between its link, its memory and its devices.

use core::{
    future::poll_fn,
    pin::pin,
    task::{Context, Poll},
};

use embassy_futures::select::{Either3, select3};
use embassy_sync::{
    blocking_mutex::raw::NoopRawMutex,
    channel::{Channel, Receiver, Sender, TrySendError},
};
use embedded_storage_async::nor_flash::NorFlash;
use flash_log::LogError;
use zigbee_link::{
    Instant,
    link::{Delivery, SendError, Ticket},
    network::NetworkStatus,
    runner::{Clock, Happened},
    wire::ShortAddress,
};

use super::{QUEUE, SharedNode, apart::Apart};
use crate::{
    hardware::{Indicator, Observer},
    log::debug,
    memory::{Fact, Memory},
    message::Message,
    role::{Output, Role, camera::Camera, coordinator::Coordinator, target::Target},
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

/// The devices' side of a desk.
pub(super) type Tasks<'a, T> = Receiver<'a, NoopRawMutex, T, WAITING>;
/// The devices' side of a desk.
pub(super) type Events<'a, E> = Sender<'a, NoopRawMutex, E, WAITING>;

/// What all roles have around them.
pub(super) struct Surroundings<'a, C, F, O, I> {
    pub(super) shared: &'a SharedNode<&'a C>,
    pub(super) clock: &'a C,
    pub(super) memory: &'a mut Memory<F>,
    pub(super) observer: &'a mut O,
    pub(super) indicator: &'a mut I,
}

/// Any role at its desk: so [`drive`] is in an image once, not once for each role.
pub(super) enum Actor<'a> {
    Coordinator(AtDesk<'a, Coordinator>),
    Camera(AtDesk<'a, Camera>),
    Target(AtDesk<'a, Target>),
}

/// The same with whichever role it is.
macro_rules! whichever {
    ($actor:expr, $role:ident => $action:expr) => {
        match $actor {
            Actor::Coordinator($role) => $action,
            Actor::Camera($role) => $action,
            Actor::Target($role) => $action,
        }
    };
}

/// A role, its desk, and what it waits for.
pub(super) struct AtDesk<'a, R: Role> {
    role: &'a mut R,
    desk: &'a Desk<R::Task, R::Event>,
    on_the_way: heapless::Vec<(Ticket, R::Errand), QUEUE>,
    /// For which the link had no room.
    held: Option<(ShortAddress, Message, Option<R::Errand>)>,
    /// For which the devices had no time.
    held_task: Option<R::Task>,
}

impl<'a, R: Role> AtDesk<'a, R> {
    pub(super) const fn new(role: &'a mut R, desk: &'a Desk<R::Task, R::Event>) -> Self {
        Self {
            role,
            desk,
            on_the_way: heapless::Vec::new(),
            held: None,
            held_task: None,
        }
    }
}

impl<R: Role> AtDesk<'_, R> {
    // These are not inlined: the roles need the stack, and each would be there in full, each time.

    #[inline(never)]
    fn message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        self.role.message(now, from, message);
    }

    /// What became of a message that was posted.
    #[inline(never)]
    fn settled(&mut self, now: Instant, ticket: Ticket, delivered: bool) {
        if let Some(place) = self.on_the_way.iter().position(|(on, _)| *on == ticket) {
            let (_, errand) = self.on_the_way.swap_remove(place);
            self.role.sent(now, errand, delivered);
        }
    }

    /// Does what the role wants, until it wants nothing more or has to wait for the link or its
    /// devices. Returns what is to be written down before anything else is done; call it again
    /// then.
    #[inline(never)]
    fn act(
        &mut self,
        now: Instant,
        mut post: impl FnMut(ShortAddress, &Message) -> Result<Ticket, SendError>,
    ) -> Option<Fact> {
        // Where it has to wait, for the link or for its devices, it goes on hearing: these may
        // wait for it, too.
        loop {
            if let Some(task) = self.held_task.take()
                && let Err(TrySendError::Full(task)) = self.desk.tasks.try_send(task)
            {
                self.held_task = Some(task);
                return None;
            }
            if self.held.is_none() {
                match self.role.poll(now)? {
                    Output::Send {
                        to,
                        message,
                        errand,
                    } => self.held = Some((to, message, errand)),
                    Output::Save(fact) => return Some(fact),
                    Output::Task(task) => {
                        self.held_task = Some(task);
                        continue;
                    }
                }
            }
            if let Some((to, message, errand)) = &self.held {
                match (post(*to, message), *errand) {
                    (Err(SendError::QueueFull), _) => return None,
                    (Ok(ticket), Some(errand)) => {
                        // As many as the queue of the link has places.
                        let _ = self.on_the_way.push((ticket, errand));
                    }
                    (Err(error), errand) => {
                        debug!("not sent: {}", error);
                        if let Some(errand) = errand {
                            self.role.sent(now, errand, false);
                        }
                    }
                    (Ok(_), None) => {}
                }
                self.held = None;
            }
        }
    }

    /// When to act again, if nothing happens before.
    #[inline(never)]
    fn deadline(&self) -> Option<Instant> {
        // Not before the link has room or the devices have time, which is something that happens.
        let may_act = self.held.is_none() && self.held_task.is_none();
        self.role.deadline().filter(|_| may_act)
    }

    /// Ready when there is reason to [`act`](Self::act): the devices told something, or can take
    /// the task that waits for them.
    #[inline(never)]
    fn poll_devices(&mut self, now: Instant, context: &mut Context<'_>) -> Poll<()> {
        if let Poll::Ready(event) = self.desk.events.poll_receive(context) {
            self.role.event(now, event);
            return Poll::Ready(());
        }
        match self.held_task {
            Some(_) => self.desk.tasks.poll_ready_to_send(context),
            None => Poll::Pending,
        }
    }
}

/// Drives a role. Returns only when its memory failed.
pub(super) async fn drive<C, F, O, I>(
    mut actor: Actor<'_>,
    surroundings: Surroundings<'_, C, F, O, I>,
) -> LogError<F::Error>
where
    C: Clock,
    F: NorFlash,
    O: Observer,
    I: Indicator,
{
    let Surroundings {
        shared,
        clock,
        memory,
        observer,
        indicator,
    } = surroundings;
    let recalled = memory.recall(|fact| whichever!(&mut actor, at => at.role.remember(fact)));
    if let Err(error) = Apart(pin!(recalled)).await {
        return error;
    }
    let mut status = NetworkStatus::Out;
    let mut shown = None;
    loop {
        let post = |to, message: &Message| {
            let ticket = shared.with(|node, now| node.link.send(now, to, message))?;
            observer.sends(to, message);
            Ok(ticket)
        };
        whichever!(&mut actor, at => at.role.compute(clock.now()));
        let fact = whichever!(&mut actor, at => at.act(clock.now(), post));
        if let Some(fact) = fact {
            observer.learns(&fact);
            if let Err(error) = Apart(pin!(memory.save(&fact))).await {
                return error;
            }
            continue;
        }
        let indication = whichever!(&actor, at => at.role.indication());
        if shown != Some(indication) {
            indicator.show(indication);
            shown = Some(indication);
        }

        // What happens.
        let deadline = whichever!(&actor, at => at.deadline());
        let happened = pin!(shared.happened::<Message>(status));
        let devices =
            poll_fn(|context| whichever!(&mut actor, at => at.poll_devices(clock.now(), context)));
        let wake = async {
            match deadline {
                Some(deadline) => clock.sleep_until(deadline).await,
                None => core::future::pending().await,
            }
        };
        let Either3::First(happened) = select3(Apart(happened), devices, wake).await else {
            continue;
        };
        let now = clock.now();
        match happened {
            Happened::Message(from, message) => {
                whichever!(&mut actor, at => at.message(now, from, &message));
            }
            Happened::Settled(ticket, delivery) => {
                let delivered = delivery != Delivery::NoAnswer;
                whichever!(&mut actor, at => at.settled(now, ticket, delivered));
            }
            Happened::Status(new) => {
                status = new;
                let network = match new {
                    NetworkStatus::Joined(membership) => Some(membership),
                    _ => None,
                };
                whichever!(&mut actor, at => at.role.attached(now, network));
            }
        }
    }
}
