//! Check that radio, camera and flash still work, for a watchdog and for people.
//!
//! It is not enough that the executor runs: a radio may go deaf or not end a transmission, and a driver may
//! wait for an event that never comes. The users of these devices report to a [`Liveness`], and the code that
//! feeds a watchdog asks it before. When it says no, the board keeps the reason over its restart, and the
//! node tells it: see [`Health`](crate::message::Health). A flash that does not serve is told likewise, but
//! is no reason to restart.
//!
//! A radio that hears nothing may be alone. So a radio counts as deaf only if it has heard others in this run
//! and has sent often since. After a restart for that reason it does not count as deaf before an hour is
//! over: a node that is alone loses nothing.

use core::{cell::Cell, time::Duration};

use zigbee_link::{
    Instant,
    radio::{PSDU_MAX, Radio, RadioConfig, Received, TxOutcome},
    runner::Clock,
    wire::{Address, Frame, FrameType, ShortAddress},
};

use crate::message::{Memory, Restart};

/// A radio that has heard nothing for so long may be deaf.
const DEAF: Duration = Duration::from_secs(600);

/// The same after a restart that did not help, or that was not needed.
const DEAF_AGAIN: Duration = Duration::from_secs(3600);

/// Transmissions that call for an answer, sent since it last heard anything.
const UNANSWERED: u8 = 20;

/// No transmission takes longer, its waits for a free channel included.
const TRANSMISSION: Duration = Duration::from_secs(10);

/// No start, look or command of a camera takes longer.
const CAMERA: Duration = Duration::from_secs(120);

/// Present work of radio and camera.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Time when something was heard last.
    heard: Option<Instant>,
    /// Transmissions since to which an answer was due.
    unanswered: u8,
    /// The transmission under way began then.
    sending: Option<Instant>,
    /// The present work of the camera began then.
    working: Option<Instant>,
}

/// Check that radio, camera and flash still work. See the [module](self).
#[derive(Debug)]
pub struct Liveness {
    restart: Restart,
    memory: Cell<Memory>,
    state: Cell<State>,
}

impl Liveness {
    /// Liveness of a node that started for this reason.
    pub const fn new(restart: Restart) -> Self {
        Self {
            restart,
            memory: Cell::new(Memory::Flash),
            state: Cell::new(State {
                heard: None,
                unanswered: 0,
                sending: None,
                working: None,
            }),
        }
    }

    /// Reason why the node started.
    pub const fn restart(&self) -> Restart {
        self.restart
    }

    /// Memory of the node's facts: link and role, or one of them alone.
    pub fn memory(&self) -> Memory {
        self.memory.get()
    }

    /// The flash does not serve: from now on the node works from RAM.
    pub fn on_flash_failed(&self) {
        self.memory.set(Memory::Ram);
    }

    /// The radio heard something, from any sender.
    pub fn on_heard(&self, now: Instant) {
        self.state.set(State {
            heard: Some(now),
            unanswered: 0,
            ..self.state.get()
        });
    }

    /// The radio begins to send, or to do something else that comes to its end.
    pub fn on_sending(&self, now: Instant) {
        self.state.set(State {
            sending: Some(now),
            ..self.state.get()
        });
    }

    /// That is over, and an answer to it is due or not.
    pub fn on_sent(&self, is_answered: bool) {
        let state = self.state.get();
        self.state.set(State {
            sending: None,
            unanswered: state.unanswered.saturating_add(is_answered.into()),
            ..state
        });
    }

    /// The camera begins to do something, or goes on with something else.
    pub fn on_camera_works(&self, now: Instant) {
        self.state.set(State {
            working: Some(now),
            ..self.state.get()
        });
    }

    /// The camera has nothing to do.
    pub fn on_camera_rests(&self) {
        self.state.set(State {
            working: None,
            ..self.state.get()
        });
    }

    /// Returns `Ok` while a watchdog may be fed.
    ///
    /// # Errors
    /// The node has to be restarted, for this reason.
    pub fn check(&self, now: Instant) -> Result<(), Restart> {
        let state = self.state.get();
        let lasts = |since: Option<Instant>, most: Duration| {
            since.is_some_and(|since| now.since(since) > most)
        };
        let deaf_after = match self.restart {
            Restart::RadioDeaf => DEAF_AGAIN,
            _ => DEAF,
        };
        if lasts(state.sending, TRANSMISSION) {
            Err(Restart::RadioStuck)
        } else if lasts(state.heard, deaf_after) && state.unanswered >= UNANSWERED {
            Err(Restart::RadioDeaf)
        } else if lasts(state.working, CAMERA) {
            Err(Restart::CameraStuck)
        } else {
            Ok(())
        }
    }
}

/// Returns true if an answer to a frame is due: not to a message for all, but to a search for networks.
fn is_answered(frame: &[u8]) -> bool {
    const EVERYBODY: Option<Address> = Some(Address::Short(ShortAddress::BROADCAST));
    Frame::parse(frame).is_ok_and(|frame| {
        let header = frame.header();
        header.frame_type == FrameType::Command || header.destination.address != EVERYBODY
    })
}

/// A radio that reports.
pub(crate) struct WatchedRadio<'a, R, C> {
    pub(crate) radio: R,
    pub(crate) clock: &'a C,
    pub(crate) liveness: &'a Liveness,
}

impl<R: Radio, C: Clock> Radio for WatchedRadio<'_, R, C> {
    type Error = R::Error;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), R::Error> {
        self.liveness.on_sending(self.clock.now());
        let configured = self.radio.configure(config).await;
        self.liveness.on_sent(false);
        configured
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, R::Error> {
        self.liveness.on_sending(self.clock.now());
        let sent = self.radio.transmit(frame).await;
        self.liveness.on_sent(is_answered(frame));
        sent
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, R::Error> {
        let received = self.radio.receive(buffer).await;
        if received.is_ok() {
            self.liveness.on_heard(self.clock.now());
        }
        received
    }
}

#[cfg(test)]
mod tests {
    use zigbee_link::wire::{Header, PanId, Panned};

    use super::*;

    const fn at(seconds: u64) -> Instant {
        Instant(seconds * 1_000_000)
    }

    fn send(liveness: &Liveness, now: u64, times: u8) {
        for _ in 0..times {
            liveness.on_sending(at(now));
            liveness.on_sent(true);
        }
    }

    /// A coordinator whose members have nothing to say.
    #[test]
    fn who_only_tells_everybody_is_not_deaf() {
        let liveness = Liveness::new(Restart::Ordinary);
        liveness.on_heard(at(0));
        for now in 0..1000 {
            liveness.on_sending(at(now));
            liveness.on_sent(false);
        }
        assert_eq!(liveness.check(at(100_000)), Ok(()));
    }

    #[test]
    fn what_is_answered() {
        let header = |frame_type, to| Header {
            destination: Panned {
                pan: Some(PanId(7)),
                address: Some(Address::Short(to)),
            },
            ..Header::new(frame_type, 1)
        };
        let one = ShortAddress(3);
        for (frame_type, to, expected) in [
            (FrameType::Data, one, true),
            (FrameType::Data, ShortAddress::BROADCAST, false),
            (FrameType::Command, ShortAddress::BROADCAST, true),
        ] {
            let mut frame = [0; PSDU_MAX];
            let len = header(frame_type, to).emit(&mut frame).unwrap();
            assert_eq!(is_answered(&frame[..len]), expected);
        }
        assert!(!is_answered(&[]));
    }

    #[test]
    fn a_node_that_is_alone_is_not_deaf() {
        let liveness = Liveness::new(Restart::Ordinary);
        for day in 0..100 {
            send(&liveness, day * 86_400, u8::MAX);
            assert_eq!(liveness.check(at(day * 86_400)), Ok(()));
        }
    }

    #[test]
    fn a_radio_that_heard_others_and_hears_nothing_any_more_is_deaf() {
        for (restart, limit) in [(Restart::Ordinary, 600), (Restart::RadioDeaf, 3600)] {
            let liveness = Liveness::new(restart);
            liveness.on_heard(at(1000));
            // No node has reason to answer one that says nothing.
            send(&liveness, 1000, 19);
            assert_eq!(liveness.check(at(100_000)), Ok(()));
            send(&liveness, 1000, 1);
            assert_eq!(liveness.check(at(1000 + limit)), Ok(()));
            assert_eq!(
                liveness.check(at(1001 + limit)),
                Err(Restart::RadioDeaf),
                "{restart:?}"
            );
            liveness.on_heard(at(1001 + limit));
            assert_eq!(liveness.check(at(1001 + limit)), Ok(()));
        }
    }

    #[test]
    fn a_transmission_that_does_not_end_is_noticed() {
        let liveness = Liveness::new(Restart::Ordinary);
        for now in [5, 500] {
            liveness.on_sending(at(now));
            assert_eq!(liveness.check(at(now + 10)), Ok(()));
            assert_eq!(liveness.check(at(now + 11)), Err(Restart::RadioStuck));
            liveness.on_sent(true);
            assert_eq!(liveness.check(at(now + 400)), Ok(()));
        }
    }

    #[test]
    fn a_camera_that_does_not_come_back_is_noticed() {
        let liveness = Liveness::new(Restart::CameraStuck);
        liveness.on_camera_works(at(5));
        liveness.on_camera_works(at(100));
        assert_eq!(liveness.check(at(220)), Ok(()));
        assert_eq!(liveness.check(at(221)), Err(Restart::CameraStuck));
        liveness.on_camera_rests();
        assert_eq!(liveness.check(at(10_000)), Ok(()));
    }
}
