//! Drives a role: tells it the events of its network, its devices and the clock, asks it for its outputs, and
//! carries them out.

use core::{
    convert::Infallible,
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
use zigbee_link::{Instant, runner::Clock, wire::ShortAddress};

use super::{QUEUE, outlined::Outlined, update::Mail};
use crate::{
    facts::{Fact, FactStore},
    hardware::{Hardware, Indicator, Observer},
    liveness::Liveness,
    log::warning,
    message::{Memory, Message, Sight},
    network::{Network, NetworkEvent, PostError, Receipt},
    role::{
        Output, Role, camera::CameraRole, coordinator::CoordinatorRole, moving_target::TargetRole,
    },
};

/// Tasks or events that wait. Devices that are slower make the role keep its next task to itself;
/// a role that is slower makes its devices wait.
const WAITING: usize = 4;

/// The two channels between a role and its devices: tasks go to the devices, events come back.
pub(super) struct DeviceChannels<T, E> {
    pub(super) tasks: Channel<NoopRawMutex, T, WAITING>,
    pub(super) events: Channel<NoopRawMutex, E, WAITING>,
}

impl<T, E> DeviceChannels<T, E> {
    pub(super) const fn new() -> Self {
        Self {
            tasks: Channel::new(),
            events: Channel::new(),
        }
    }
}

/// Tasks for the devices.
pub(super) type Tasks<'a, T> = Receiver<'a, NoopRawMutex, T, WAITING>;
/// Events of the devices.
pub(super) type Events<'a, E> = Sender<'a, NoopRawMutex, E, WAITING>;

/// Services of the node that every role uses.
pub(super) struct Services<'a, H: Hardware, N, F> {
    pub(super) network: &'a N,
    pub(super) clock: &'a H::Clock,
    pub(super) facts: &'a mut FactStore<F>,
    pub(super) observer: &'a mut H::Observer,
    pub(super) indicator: &'a mut H::Indicator,
    pub(super) liveness: &'a Liveness,
    pub(super) mail: &'a Mail,
}

/// The driver of the node's role, of any kind: so [`drive`] is in an image once, not once for each.
pub(super) enum AnyDriver<'a, Ticket> {
    #[cfg(feature = "coordinator")]
    Coordinator(RoleDriver<'a, CoordinatorRole, Ticket>),
    #[cfg(feature = "camera")]
    Camera(RoleDriver<'a, CameraRole, Ticket>),
    #[cfg(feature = "target")]
    Target(RoleDriver<'a, TargetRole<'a>, Ticket>),
    #[cfg(not(any(feature = "camera", feature = "coordinator", feature = "target")))]
    None(RoleDriver<'a, CameraRole, Ticket>),
}

/// The same with a role of any kind.
macro_rules! whichever {
    ($any:expr, $driver:ident => $action:expr) => {
        match $any {
            #[cfg(feature = "coordinator")]
            AnyDriver::Coordinator($driver) => $action,
            #[cfg(feature = "camera")]
            AnyDriver::Camera($driver) => $action,
            #[cfg(feature = "target")]
            AnyDriver::Target($driver) => $action,
            #[cfg(not(any(feature = "camera", feature = "coordinator", feature = "target")))]
            AnyDriver::None($driver) => $action,
        }
    };
}

/// A role, and its outputs that are not done yet.
pub(super) struct RoleDriver<'a, R: Role, Ticket> {
    role: &'a mut R,
    devices: &'a DeviceChannels<R::Task, R::Event>,
    /// Messages with the network of which the role wants to know the result.
    in_flight: heapless::Vec<(Ticket, R::Notification), QUEUE>,
    /// A message for which the network had no room.
    pending_message: Option<(ShortAddress, Message, Option<R::Notification>)>,
    /// A task for which the devices had no time.
    pending_task: Option<R::Task>,
}

impl<'a, R: Role, Ticket> RoleDriver<'a, R, Ticket> {
    pub(super) const fn new(
        role: &'a mut R,
        devices: &'a DeviceChannels<R::Task, R::Event>,
    ) -> Self {
        Self {
            role,
            devices,
            in_flight: heapless::Vec::new(),
            pending_message: None,
            pending_task: None,
        }
    }
}

impl<R: Role, Ticket: Copy + PartialEq> RoleDriver<'_, R, Ticket> {
    // None is inlined: roles need much of the stack, and would be in `drive` in full, each time.

    #[inline(never)] // for less stack
    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        self.role.on_message(now, from, message);
    }

    /// Result of a message that was posted.
    #[inline(never)] // for less stack
    fn on_settled(&mut self, now: Instant, ticket: Ticket, delivered: bool) {
        if let Some(place) = self.in_flight.iter().position(|(on, _)| *on == ticket) {
            let (_, notification) = self.in_flight.swap_remove(place);
            self.role.on_sent(now, notification, delivered);
        }
    }

    /// Does the role's outputs, until it has none or has to wait for the link or its devices. Returns the
    /// fact to be written down before anything else is done. Call it again when that is written.
    #[inline(never)] // for less stack
    fn act(
        &mut self,
        now: Instant,
        mut post: impl FnMut(ShortAddress, &Message) -> Result<Ticket, PostError>,
    ) -> Option<Fact> {
        // While it waits for the link or its devices it goes on hearing: these may wait for it, too.
        loop {
            if let Some(task) = self.pending_task.take()
                && let Err(TrySendError::Full(task)) = self.devices.tasks.try_send(task)
            {
                self.pending_task = Some(task);
                return None;
            }
            if self.pending_message.is_none() {
                match self.role.poll(now)? {
                    Output::Send {
                        to,
                        message,
                        notification,
                    } => self.pending_message = Some((to, message, notification)),
                    Output::Save(fact) => return Some(fact),
                    Output::Task(task) => {
                        self.pending_task = Some(task);
                        continue;
                    }
                }
            }
            if let Some((to, message, notification)) = &self.pending_message {
                match (post(*to, message), *notification) {
                    (Err(PostError::Full), _) => return None,
                    (Ok(ticket), Some(notification)) => {
                        if let Err((_, unknown)) = self.in_flight.push((ticket, notification)) {
                            debug_assert!(false, "more messages on their way than a network takes");
                            self.role.on_sent(now, unknown, false);
                        }
                    }
                    (Err(PostError::Refused), notification) => {
                        if let Some(notification) = notification {
                            self.role.on_sent(now, notification, false);
                        }
                    }
                    (Ok(_), None) => {}
                }
                self.pending_message = None;
            }
        }
    }

    /// Time to act again, if nothing happens before.
    #[inline(never)] // for less stack
    fn deadline(&self) -> Option<Instant> {
        // Not before the link has room or the devices have time, which is something that happens.
        let may_act = self.pending_message.is_none() && self.pending_task.is_none();
        self.role.next_deadline().filter(|_| may_act)
    }

    /// Ready when there is reason to [`act`](Self::act): the devices told something, or can take
    /// the task that waits for them.
    #[inline(never)] // for less stack
    fn poll_devices(&mut self, now: Instant, context: &mut Context<'_>) -> Poll<()> {
        if let Poll::Ready(event) = self.devices.events.poll_receive(context) {
            self.role.on_event(now, event);
            return Poll::Ready(());
        }
        match self.pending_task {
            Some(_) => self.devices.tasks.poll_ready_to_send(context),
            None => Poll::Pending,
        }
    }
}

/// Writes a fact down, after a failure once more. Returns true if it is written.
async fn save<F: NorFlash>(facts: &mut FactStore<F>, fact: &Fact) -> bool {
    // In a loop: each `await` of a future of its own would be code of its own.
    for is_again in [false, true] {
        let is_open = !is_again || facts.reopen().await.is_ok();
        if is_open && facts.save(fact).await.is_ok() {
            return true;
        }
    }
    false
}

/// Drives a role. Where its flash does not serve, it works from RAM.
pub(super) async fn drive<H: Hardware, N: Network, F: NorFlash>(
    mut any: AnyDriver<'_, N::Ticket>,
    services: Services<'_, H, N, F>,
) -> Infallible {
    let Services {
        network,
        clock,
        facts,
        observer,
        indicator,
        liveness,
        mail,
    } = services;
    let recalled = facts.recall(|fact| whichever!(&mut any, driver => driver.role.restore(fact)));
    if Outlined(pin!(recalled)).await.is_err() {
        facts.abandon();
    }
    if facts.is_abandoned() {
        liveness.on_flash_failed();
    }
    let restart = liveness.restart();
    whichever!(&mut any, driver => driver.role.on_node(clock.now(), liveness.memory(), restart));
    let mut attachment = None;
    let mut shown = None;
    loop {
        let post = |to, message: &Message| {
            // The target asks if it has to know.
            let receipt = match message {
                Message::Look(look) if look.sight == Sight::NotInView => Receipt::NotWanted,
                // What nodes miss of it they ask for.
                Message::Update(_) if to == ShortAddress::BROADCAST => Receipt::NotWanted,
                _ => Receipt::Wanted,
            };
            let ticket = network.post(to, message, receipt)?;
            observer.sends(to, message);
            Ok(ticket)
        };
        whichever!(&mut any, driver => driver.role.compute(clock.now()));
        let fact = whichever!(&mut any, driver => driver.act(clock.now(), post));
        if let Some(fact) = fact {
            observer.learns(&fact);
            if !Outlined(pin!(save(facts, &fact))).await {
                warning!("the flash does not serve: the role works from RAM");
                facts.abandon();
                liveness.on_flash_failed();
                let now = clock.now();
                whichever!(&mut any, driver => driver.role.on_node(now, Memory::Ram, restart));
            }
            continue;
        }
        let indication = whichever!(&any, driver => driver.role.indication());
        if shown != Some(indication) {
            indicator.show(indication);
            shown = Some(indication);
        }

        // The next event.
        let deadline = whichever!(&any, driver => driver.deadline());
        let happened = pin!(network.happened(attachment));
        let devices = poll_fn(
            |context| whichever!(&mut any, driver => driver.poll_devices(clock.now(), context)),
        );
        let wake = async {
            match deadline {
                Some(deadline) => clock.sleep_until(deadline).await,
                None => core::future::pending().await,
            }
        };
        let Either3::First(happened) = select3(Outlined(happened), devices, wake).await else {
            continue;
        };
        let now = clock.now();
        match happened {
            NetworkEvent::Message(from, message) => {
                mail.on_message(from, &message);
                whichever!(&mut any, driver => driver.on_message(now, from, &message));
            }
            NetworkEvent::Settled { ticket, delivered } => {
                whichever!(&mut any, driver => driver.on_settled(now, ticket, delivered));
            }
            NetworkEvent::Attached(new) => {
                attachment = new;
                whichever!(&mut any, driver => driver.role.on_attached(now, new));
            }
        }
    }
}
