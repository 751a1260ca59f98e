//! Updates by radio: a receiver beside the role.
//!
//! The coordinator is a line between the PC and the nodes, and a node itself: it hands packets on, and takes those to
//! all, too.

#[cfg(feature = "update")]
pub(super) use with::{Mail, run};
#[cfg(not(feature = "update"))]
pub(super) use without::{Mail, run};

/// Without the feature nothing of it is there.
#[cfg(not(feature = "update"))]
mod without {
    use core::{
        convert::Infallible,
        future::{Pending, pending},
    };

    use zigbee_link::wire::ShortAddress;

    use super::super::{Failure, drive::Tasks};
    use crate::{
        config::CheckedConfig, console::FromPc, hardware::Updates, message::Message,
        role::coordinator::CoordinatorTask,
    };

    /// No end of a receiver.
    pub(in super::super) struct Ended(Infallible);

    impl Ended {
        #[inline(always)]
        pub(in super::super) const fn failure<R, F>(self) -> Failure<R, F> {
            match self.0 {}
        }
    }

    #[inline(always)]
    pub(in super::super) fn run<T, N>(
        _: Option<Updates>,
        _: &CheckedConfig,
        _: &T,
        _: N,
    ) -> Pending<Ended> {
        pending()
    }

    pub(in super::super) struct Mail;

    impl Mail {
        pub(in super::super) const fn new() -> Self {
            Self
        }

        #[inline(always)]
        pub(in super::super) const fn on_message(&self, _: ShortAddress, _: &Message) {}

        #[inline(always)]
        pub(in super::super) const fn on_pc(&self, _: &FromPc) {}

        #[inline(always)]
        pub(in super::super) async fn or_answer(
            &self,
            tasks: Tasks<'_, CoordinatorTask>,
        ) -> CoordinatorTask {
            tasks.receive().await
        }
    }
}

#[cfg(feature = "update")]
mod with {
    use core::time::Duration;

    use embassy_futures::{
        select::{Either, Either3, select, select3},
        yield_now,
    };
    use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel, signal::Signal};
    use embedded_storage_async::nor_flash::NorFlash;
    use radio_update::{
        packet::{PACKET_MAX, Phase},
        receiver::{Layout, Own, Reaction, Receiver},
        stamp::Stamp,
    };
    use zigbee_link::{Instant, runner::Clock, wire::ShortAddress};

    use super::super::{Failure, drive::Tasks, shared_flash::SharedFlash};
    use crate::{
        config::{CheckedConfig, RoleConfig},
        console::{FromPc, ToPc},
        hardware::Updates,
        log::warning,
        message::{Message, UpdatePacket},
        network::{Network, PostError, Receipt},
        role::{COORDINATOR, coordinator::CoordinatorTask},
    };

    /// Packets that wait while the flash is written; more are lost, and asked for again.
    const WAITING: usize = 6;

    /// Time in which a new image has to hear of its network. After that the node restarts, and its boot loader goes
    /// back to the former image.
    const TRIAL: Duration = Duration::from_secs(600);

    /// Time for the acknowledgement of the last request to get out before the restart, and pause before an answer is
    /// tried again.
    const PAUSE: Duration = Duration::from_millis(200);

    /// Packets on their way within the node.
    pub(in super::super) struct Mail {
        packets: Channel<NoopRawMutex, UpdatePacket, WAITING>,
        /// Another node of the network was heard.
        heard: Signal<NoopRawMutex, ()>,
        /// The coordinator's own answer to the PC.
        answer: Signal<NoopRawMutex, UpdatePacket>,
    }

    impl Mail {
        pub(in super::super) const fn new() -> Self {
            Self {
                packets: Channel::new(),
                heard: Signal::new(),
                answer: Signal::new(),
            }
        }

        /// Takes what the coordinator sends.
        pub(in super::super) fn on_message(&self, from: ShortAddress, message: &Message) {
            self.heard.signal(());
            if let Message::Update(packet) = message
                && from == COORDINATOR
            {
                let _ = self.packets.try_send(*packet);
            }
        }

        /// Takes what the PC sends to the coordinator itself, alone or as one of all.
        pub(in super::super) fn on_pc(&self, wish: &FromPc) {
            if let FromPc::Update { to, packet } = wish
                && [COORDINATOR, ShortAddress::BROADCAST].contains(&ShortAddress(*to))
            {
                // Its PC is what a coordinator must not lose.
                self.heard.signal(());
                let _ = self.packets.try_send(*packet);
            }
        }

        /// The next task of the coordinator's line: one of the role's, or an answer.
        pub(in super::super) async fn or_answer(
            &self,
            tasks: Tasks<'_, CoordinatorTask>,
        ) -> CoordinatorTask {
            match select(tasks.receive(), self.answer.wait()).await {
                Either::First(task) => task,
                Either::Second(packet) => CoordinatorTask::Tell(ToPc::Update {
                    address: COORDINATOR.0,
                    packet,
                }),
            }
        }
    }

    /// The end of a receiver: the boot loader is to change images.
    pub(in super::super) struct Ended;

    impl Ended {
        pub(in super::super) const fn failure<R, F>(self) -> Failure<R, F> {
            Failure::Update
        }
    }

    /// Takes updates, until the boot loader is to change images.
    pub(in super::super) async fn run<F: NorFlash, N: Network, C: Clock>(
        updates: Option<Updates>,
        config: &CheckedConfig,
        flash: &SharedFlash<F>,
        (network, clock, mail): (&N, &C, &Mail),
    ) -> Ended {
        let Some(updates) = updates else {
            return core::future::pending().await;
        };
        let role = &config.settings().role;
        let own = Own {
            stamp: Stamp {
                board: updates.board,
                roles: updates.roles,
                version: updates.version,
            },
            role: role.bit(),
            key: updates.key,
        };
        let layout = Layout {
            state: updates.state,
            header: updates.header,
            spare: updates.spare,
        };
        let mut receiver = Receiver::open(flash.user(), layout, own).await;
        let is_coordinator = matches!(role, RoleConfig::Coordinator(_));
        let trial_ends = clock.now() + TRIAL;
        // When the next answer is due, and the first block that it lists.
        let mut answer: Option<(Instant, u16)> = None;
        // Answers of many nodes are spread by their numbers.
        let number = u32::from(config.settings().id);
        loop {
            let now = clock.now();
            if receiver.phase() == Phase::Trial && now >= trial_ends {
                warning!("the new image does not hear of its network");
                return Ended;
            }
            if let Some((due, from)) = answer
                && now >= due
            {
                let mut bytes = [0; PACKET_MAX];
                let length = receiver.status(from, &mut bytes);
                let packet = bytes.get(..length).and_then(UpdatePacket::new);
                answer = None;
                if let Some(packet) = packet {
                    if is_coordinator {
                        mail.answer.signal(packet);
                    } else if network.post(COORDINATOR, &Message::Update(packet), Receipt::Wanted)
                        == Err(PostError::Full)
                    {
                        answer = Some((now + PAUSE, from));
                    }
                }
            }
            let wake = async {
                let trial = (receiver.phase() == Phase::Trial).then_some(trial_ends);
                let due = answer.map(|(due, _)| due);
                match [trial, due].into_iter().flatten().min() {
                    _ if receiver.has_work() => yield_now().await,
                    Some(time) => clock.sleep_until(time).await,
                    None => core::future::pending().await,
                }
            };
            match select3(mail.packets.receive(), mail.heard.wait(), wake).await {
                Either3::First(packet) => match receiver.on_packet(packet.bytes()).await {
                    Reaction::Nothing => {}
                    Reaction::Answer { from, spread_ms } => {
                        let share = number.wrapping_mul(0x9e37_79b9) >> 16;
                        let wait = (u64::from(share) * u64::from(spread_ms) * 1000) >> 16;
                        answer = Some((Instant(clock.now().0.saturating_add(wait)), from));
                    }
                    Reaction::Restart => {
                        clock.sleep_until(clock.now() + PAUSE).await;
                        return Ended;
                    }
                },
                Either3::Second(()) => receiver.confirm().await,
                Either3::Third(()) => receiver.work().await,
            }
        }
    }
}
