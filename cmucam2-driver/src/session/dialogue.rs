//! Order of events: the parts of a session put together.

use core::ops::ControlFlow;

use super::{
    Answer, Fault, Modes, Policy, Request,
    exchange::{Awaited, Exchange, Purpose, Reaction},
    modes::Cursor,
    port::{Heard, Port},
    script::{Step, Task},
    stream::Stream,
    synchronisation::{self, Outcome, Resume, Synchronisation},
};
use crate::{
    command::{Effect, Order, Reply},
    geometry::Sensor,
    log::{debug, warning},
    packet::{FirmwareVersion, Packet, PacketKind},
    parser::{Expectation, Token},
};

/// A request goes on, or has its outcome.
pub(super) type Flow = ControlFlow<Result<Answer, Fault>>;

/// State of the camera's end of the line.
#[derive(Clone, Copy, Debug)]
enum Link {
    Unknown,
    /// It waits for a command.
    Prompt,
    /// It sends.
    Streaming(Stream),
}

/// Present work of the session for a request.
#[derive(Clone, Copy, Debug)]
pub(super) enum Doing {
    /// The camera is made to listen.
    Synchronise(Synchronisation, Resume),
    /// The command that was sent last is answered, or the stream that it began goes on.
    Exchange(Awaited),
    /// Time passes before that command is repeated.
    Pause,
    /// Time passes because the script says so.
    Wait,
}

/// All but the request under way.
#[derive(Clone, Debug)]
pub(super) struct Dialogue {
    pub(super) port: Port,
    pub(super) policy: Policy,
    pub(super) modes: Modes,
    /// As named by the banner.
    pub(super) sensor: Option<Sensor>,
    link: Link,
    /// The command that was sent last, and its purpose.
    exchange: Exchange,
    /// The stream that [`Request::Next`] reads; it may have to be told to the camera again.
    stream: Option<Order>,
    /// The camera has lost its modes: progress of telling them again.
    restore: Option<Cursor>,
    /// Time of the last packet that was asked for.
    pub(super) packet_at: Option<u64>,
    pub(super) restarts: u16,
    pub(super) retries: u16,
}

impl Dialogue {
    pub(super) fn new(policy: Policy) -> Self {
        Self {
            port: Port::new(),
            policy,
            modes: Modes::default(),
            sensor: None,
            link: Link::Unknown,
            exchange: Exchange {
                order: Order::IDLE,
                purpose: Purpose::Whole,
            },
            stream: None,
            restore: None,
            packet_at: None,
            restarts: 0,
            retries: 0,
        }
    }

    /// Begins a request.
    pub(super) fn begin(&mut self, task: &mut Task, doing: &mut Doing, now: u64) -> Flow {
        // A request that cannot be begun must not leave the packets of another in its place.
        if task.begins() {
            self.stream = None;
        }
        self.port.turn();
        if self.restore.is_some() {
            self.restore = Some(Cursor::default());
            task.on_lost_modes();
        }
        if let Request::Do(order) = &task.request
            && !self.modes.has_room(order)
        {
            return Flow::Break(Err(Fault::TooManyRegisters));
        }
        self.plan(task, doing, None, now)
    }

    /// A request is given up.
    pub(super) fn abandon(&mut self, doing: &Doing) {
        if !matches!(doing, Doing::Exchange(Awaited::Packet)) {
            self.link = Link::Unknown;
        }
    }

    /// A token came while no request was under way.
    pub(super) fn on_event_between(&mut self, event: Token) {
        if let Token::Banner(version) = event {
            self.recognise(version);
            self.forgotten();
        }
    }

    pub(super) fn on_event(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        event: Token,
        now: u64,
        row: &mut [u8],
    ) -> Flow {
        if let Token::Banner(version) = event {
            return self.on_banner(task, doing, version, now);
        }
        match doing {
            Doing::Synchronise(synchronisation, resume) => {
                if synchronisation.on_event(&event, &mut self.port, &self.policy, now) {
                    let asked = self.exchange.answers(!matches!(resume, Resume::Plan));
                    *resume = Resume::Plan;
                    self.forgotten();
                    task.on_restart(asked, self.policy.retries)?;
                }
            }
            Doing::Exchange(Awaited::Packet) => {
                return self.on_stream(task, doing, event, now, row);
            }
            &mut Doing::Exchange(Awaited::Prompt(answer)) => match event {
                Token::Prompt => {
                    self.link = Link::Prompt;
                    return self.conclude(task, doing, Some(answer), now);
                }
                Token::Packet(_) | Token::Header(_) => {
                    return self.on_further_packet(task, doing, answer, now);
                }
                _ => {}
            },
            Doing::Exchange(awaited) => {
                match self.exchange.on_event(awaited, &event) {
                    Reaction::Nothing => {}
                    Reaction::Await(next) => {
                        *awaited = next;
                        self.await_reply(awaited, now);
                    }
                    Reaction::Sends => {
                        self.sends(task, doing, now)?;
                        if let Token::Packet(_) = event {
                            return self.on_stream(task, doing, event, now, row);
                        }
                    }
                    Reaction::Done(answer) => {
                        // One that sleeps must be woken first.
                        self.link = match self.exchange.order.reply() {
                            Reply::Sleep => Link::Unknown,
                            _ => Link::Prompt,
                        };
                        return self.conclude(task, doing, answer, now);
                    }
                    Reaction::Refused => {
                        self.link = Link::Prompt;
                        return self.failed(task, doing, self.refused(), now);
                    }
                    Reaction::Irregular => {
                        self.link = Link::Unknown;
                        return self.failed(task, doing, self.nothing_useful(), now);
                    }
                }
            }
            Doing::Pause | Doing::Wait => {}
        }
        Flow::Continue(())
    }

    pub(super) fn on_timeout(&mut self, task: &mut Task, doing: &mut Doing, now: u64) -> Flow {
        if self.port.is_silent(now) {
            self.port.parser.gap();
        }
        match doing {
            Doing::Synchronise(synchronisation, resume) => {
                match synchronisation.on_timeout(&mut self.port, &self.policy, now) {
                    Outcome::Again => return Flow::Continue(()),
                    Outcome::Listens => {}
                    // It does not listen; perhaps it still obeys.
                    Outcome::Failed if task.is_resetting() && task.failures == 0 => {
                        task.failures = 1;
                    }
                    Outcome::Failed => {
                        self.link = Link::Unknown;
                        return Flow::Break(Err(match self.nothing_useful() {
                            Fault::Silence if task.restarts > 0 => Fault::Restarted,
                            fault => fault,
                        }));
                    }
                }
                self.link = Link::Prompt;
                match *resume {
                    Resume::Plan => return self.plan(task, doing, None, now),
                    Resume::Repeat => self.send(doing, now),
                    Resume::Conclude(answer) => {
                        return self.conclude(task, doing, Some(answer), now);
                    }
                }
            }
            &mut Doing::Exchange(Awaited::Packet) => {
                return self.stream_timeout(task, doing, now);
            }
            &mut Doing::Exchange(Awaited::Prompt(answer)) => {
                self.stop(doing, Resume::Conclude(answer), now);
            }
            Doing::Exchange(awaited) => match (&awaited, self.exchange.order.reply()) {
                (Awaited::Reply(_), Reply::Sleep) => {
                    self.link = Link::Unknown;
                    return self.conclude(task, doing, None, now);
                }
                (Awaited::Ack, Reply::Upload) if self.port.ask_payload() => {
                    self.port.wait(now, self.policy.reply_us);
                }
                (awaited, _) => {
                    let fault = match awaited {
                        Awaited::Refused => self.refused(),
                        _ => self.nothing_useful(),
                    };
                    self.link = Link::Unknown;
                    return self.failed(task, doing, fault, now);
                }
            },
            Doing::Pause => match self.link {
                Link::Prompt => self.send(doing, now),
                Link::Unknown | Link::Streaming(_) => {
                    self.stop(doing, Resume::Repeat, now);
                }
            },
            Doing::Wait => {
                task.advance();
                return self.plan(task, doing, None, now);
            }
        }
        Flow::Continue(())
    }

    /// Does the next step: first makes the camera listen, then restores its lost modes, then follows the
    /// request. `answer`: of the step before.
    fn plan(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        answer: Option<Answer>,
        now: u64,
    ) -> Flow {
        if task.reads() && self.restore.is_none() {
            if self.stream.is_none() {
                return Flow::Break(Err(Fault::NotStreaming));
            }
            if let Link::Streaming(stream) = &self.link {
                if let Some(room) = task.room()
                    && let Err(fault) = stream.fits(room)
                {
                    return Flow::Break(Err(fault));
                }
                self.exchange = Exchange {
                    order: stream.order,
                    purpose: Purpose::Next,
                };
                self.await_packet(doing, now);
                return Flow::Continue(());
            }
        }
        if !matches!(self.link, Link::Prompt) {
            self.stop(doing, Resume::Plan, now);
            return Flow::Continue(());
        }
        if let Some(cursor) = &mut self.restore
            && !task.is_resetting()
        {
            if let Some(order) = self.modes.next(cursor) {
                let purpose = Purpose::Restore;
                self.exchange = Exchange { order, purpose };
                self.send(doing, now);
                return Flow::Continue(());
            }
            self.restore = None;
            debug!("modes restored");
            if task.was_interrupted() {
                self.go_on(task)?;
            }
        }
        let (order, purpose) = match task.next(answer, &mut self.modes, self.sensor) {
            Step::Send(order, purpose) => (order, purpose),
            Step::Begin(order) => match self.first_of(order) {
                Some(first) => (first, Purpose::Begin),
                None => return self.begun(task, order),
            },
            Step::Read => match self.stream {
                Some(order) => (order, Purpose::Next),
                None => return Flow::Break(Err(Fault::NotStreaming)),
            },
            Step::Stop => {
                self.stream = None;
                return Flow::Break(Ok(Answer::Done));
            }
            Step::Wait(time) => {
                self.port.pause(now, time);
                *doing = Doing::Wait;
                return Flow::Continue(());
            }
            #[cfg(feature = "full")]
            Step::Restore => {
                task.advance();
                self.restore = Some(Cursor::default());
                return self.plan(task, doing, None, now);
            }
            Step::Finish(answer) => return Flow::Break(Ok(answer)),
            Step::Fail(fault) => return Flow::Break(Err(fault)),
        };
        self.exchange = Exchange { order, purpose };
        self.send(doing, now);
        Flow::Continue(())
    }

    /// The stream that the request begins runs, or will run when it is read.
    fn begun(&mut self, task: &Task, order: Order) -> Flow {
        self.stream = Some(order.continued());
        Flow::Break(Ok(task.begun(&self.modes)))
    }

    /// After a restart, with all modes set again: decides whether the request can go on.
    fn go_on(&mut self, task: &Task) -> Flow {
        let lost = task.reads() && !self.stream_can_resume();
        if lost {
            self.stream = None;
        }
        if lost || !task.may_go_on() {
            return Flow::Break(Err(Fault::Restarted));
        }
        Flow::Continue(())
    }

    /// Returns true if the stream means the same after a restart of the camera.
    fn stream_can_resume(&self) -> bool {
        match self.stream.map(|order| order.reply()) {
            Some(Reply::Packets(PacketKind::Tracking)) => self.modes.bounds().is_some(),
            Some(Reply::Packets(PacketKind::Statistics | PacketKind::Histogram)) => true,
            _ => false,
        }
    }

    /// The order that begins a stream. In poll mode nothing streams: the order that [`Request::Next`] sends
    /// is only noted, after the bounds.
    fn first_of(&self, order: Order) -> Option<Order> {
        if !self.modes.poll() || order.reply() == Reply::Frame {
            return Some(order);
        }
        match order.effect() {
            Effect::Bounds if order.arguments().is_empty() => None,
            Effect::Bounds => Some(Order::set_bounds(order.arguments())),
            Effect::OwnBounds => Some(order),
            _ => None,
        }
    }

    /// Sends the command that is to be exchanged.
    fn send(&mut self, doing: &mut Doing, now: u64) {
        let order = &self.exchange.order;
        self.port.send(order);
        self.port.turn();
        let strict = self.policy.strict;
        let expectation = self.modes.expectation(order, self.sensor, strict);
        self.port.parser.expect(expectation);
        self.await_reply(&Awaited::Ack, now);
        *doing = Doing::Exchange(Awaited::Ack);
    }

    fn await_reply(&mut self, awaited: &Awaited, now: u64) {
        let order = &self.exchange.order;
        if let (Awaited::Reply(_), Reply::Upload) = (awaited, order.reply()) {
            self.port.ask_payload();
        }
        let patience = match (awaited, order.effect()) {
            (Awaited::Ack | Awaited::Reply(None), Effect::Reset) => self.policy.reset_us,
            _ => self.policy.reply_us,
        };
        self.port.wait(now, patience);
    }

    fn await_packet(&mut self, doing: &mut Doing, now: u64) {
        self.port.listen();
        let packets = u32::from(self.modes.packet_skip()) + 1;
        let patience = self.policy.packet_us.saturating_mul(packets);
        self.port.wait(now, patience);
        *doing = Doing::Exchange(Awaited::Packet);
    }

    /// Makes the camera listen.
    fn stop(&mut self, doing: &mut Doing, resume: Resume, now: u64) {
        let purpose = match &self.link {
            Link::Streaming(stream) if stream.order.reply() == Reply::Frame => {
                synchronisation::Purpose::Frame
            }
            _ => synchronisation::Purpose::Stop,
        };
        self.synchronise(doing, purpose, resume, now);
    }

    fn synchronise(
        &mut self,
        doing: &mut Doing,
        purpose: synchronisation::Purpose,
        resume: Resume,
        now: u64,
    ) {
        // A frame that is stopped does not go on.
        self.stream = self.stream.filter(|order| order.reply() != Reply::Frame);
        self.port.listen();
        self.port.parser.expect(Expectation::default());
        let begun = Synchronisation::begin(purpose, &mut self.port, &self.policy, now);
        *doing = Doing::Synchronise(begun, resume);
    }

    /// The command was accepted, the camera sends.
    fn sends(&mut self, task: &mut Task, doing: &mut Doing, now: u64) -> Flow {
        let order = self.exchange.order;
        let dropped = self.port.parser.dropped().bytes;
        self.link = Link::Streaming(Stream::new(order, dropped));
        task.window_mean = None;
        let polled = self.modes.poll() && !self.exchange.is_frame();
        match self.exchange.purpose {
            Purpose::Begin if !polled => {
                self.modes.remember(&order);
                self.begun(task, order)
            }
            Purpose::Next if task.was_interrupted() => Flow::Break(Err(Fault::Restarted)),
            _ => {
                self.await_packet(doing, now);
                Flow::Continue(())
            }
        }
    }

    /// Returns true if one packet ends the exchange.
    fn takes_one(&self) -> bool {
        self.modes.poll() || self.exchange.purpose != Purpose::Next
    }

    fn on_stream(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        event: Token,
        now: u64,
        row: &mut [u8],
    ) -> Flow {
        if event == Token::Prompt {
            return self.on_unexpected_prompt(task, doing, now);
        }
        if let (Token::Packet(Packet::Statistics(statistics)), Effect::OwnBounds) =
            (event, self.exchange.order.effect())
        {
            task.window_mean = statistics.mean();
        }
        let dropped = self.port.parser.dropped().bytes;
        let Link::Streaming(stream) = &mut self.link else {
            debug_assert!(false, "packets are awaited of a camera that does not send");
            return Flow::Continue(());
        };
        let Some(answer) = stream.on_event(&self.exchange, event, row, dropped) else {
            return Flow::Continue(());
        };
        let is_last = match answer {
            Answer::Packet(_) => {
                self.packet_at = Some(now);
                self.takes_one()
            }
            Answer::End { .. } if self.exchange.is_frame() && !self.modes.frame_stream() => {
                self.stream = None;
                true
            }
            _ if task.room().is_none() => return Flow::Continue(()),
            _ => false,
        };
        if !is_last {
            return Flow::Break(Ok(answer));
        }
        self.port.wait(now, self.policy.settle_us);
        *doing = Doing::Exchange(Awaited::Prompt(answer));
        Flow::Continue(())
    }

    /// One packet was wanted and another one comes.
    fn on_further_packet(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        answer: Answer,
        now: u64,
    ) -> Flow {
        if !self.modes.poll() || self.exchange.is_frame() {
            self.stop(doing, Resume::Conclude(answer), now);
            return Flow::Continue(());
        }
        // In poll mode it would not: the camera has forgotten that, so it has restarted, if it does so again.
        if self.exchange.order.is_idempotent() && !task.is_suspected_again() {
            self.stop(doing, Resume::Plan, now);
            return Flow::Continue(());
        }
        self.forgotten();
        task.on_restart(self.exchange.answers(true), self.policy.retries)?;
        self.stop(doing, Resume::Plan, now);
        Flow::Continue(())
    }

    /// In a stream a damaged character may look like a prompt, so only a command that must be followed by one
    /// believes it. If it was real, silence follows.
    fn on_unexpected_prompt(&mut self, task: &mut Task, doing: &mut Doing, now: u64) -> Flow {
        if self.exchange.is_frame() {
            self.link = Link::Prompt;
            self.stream = None;
            return Flow::Break(Err(Fault::Garbage));
        }
        if !self.takes_one() {
            return Flow::Continue(());
        }
        if self.may_be_quiet() {
            self.link = Link::Prompt;
            return self.conclude(task, doing, Some(Answer::Quiet), now);
        }
        self.link = Link::Unknown;
        self.failed(task, doing, Fault::Garbage, now)
    }

    fn may_be_quiet(&self) -> bool {
        let dropped = self.port.parser.dropped().bytes;
        self.modes.packet_filter()
            && matches!(&self.link, Link::Streaming(stream) if stream.may_be_quiet(dropped))
    }

    fn stream_timeout(&mut self, task: &mut Task, doing: &mut Doing, now: u64) -> Flow {
        let fault = self.nothing_useful();
        if self.exchange.is_frame() {
            self.link = Link::Unknown;
            self.stream = None;
            return Flow::Break(Err(fault));
        }
        if self.may_be_quiet() {
            if self.exchange.purpose != Purpose::Next {
                self.stop(doing, Resume::Conclude(Answer::Quiet), now);
                return Flow::Continue(());
            }
            if let Link::Streaming(stream) = &mut self.link
                && stream.count_quiet() <= self.policy.quiet_calls
            {
                return Flow::Break(Ok(Answer::Quiet));
            }
        } else if self.exchange.purpose != Purpose::Next {
            self.link = Link::Unknown;
            return self.failed(task, doing, fault, now);
        } else if task.failures > 0 {
            self.link = Link::Unknown;
            return Flow::Break(Err(fault));
        }
        // Stop the stream and start it again: that tells a camera that left it from one that is gone.
        task.failures = task.failures.saturating_add(1);
        self.link = Link::Unknown;
        let purpose = synchronisation::Purpose::Probe;
        self.synchronise(doing, purpose, Resume::Plan, now);
        Flow::Continue(())
    }

    /// Command, answer and prompt: all is well.
    fn conclude(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        answer: Option<Answer>,
        now: u64,
    ) -> Flow {
        task.failures = 0;
        let order = self.exchange.order;
        if order.effect() == Effect::Reset {
            self.restore = None;
            if !task.keeps_modes() {
                self.stream = None;
                self.modes.remember(&order);
            }
        } else if self.exchange.purpose != Purpose::Once {
            self.modes.remember(&order);
        }
        match self.exchange.purpose {
            Purpose::Whole | Purpose::Next => Flow::Break(Ok(answer.unwrap_or(Answer::Done))),
            Purpose::Begin => self.begun(task, order),
            Purpose::Step | Purpose::Once => {
                task.advance();
                self.plan(task, doing, answer, now)
            }
            Purpose::Restore => self.plan(task, doing, None, now),
        }
    }

    /// Fault when no useful byte came.
    #[inline(never)] // for less flash
    fn nothing_useful(&self) -> Fault {
        match self.port.heard() {
            Heard::Nothing => Fault::Silence,
            Heard::Bytes => Fault::Garbage,
            Heard::Words => self.unexpected(),
        }
    }

    /// The command under way got another answer.
    #[inline(never)] // for less flash
    pub(super) fn unexpected(&self) -> Fault {
        Fault::Unexpected {
            command: self.exchange.order.letters(),
        }
    }

    /// The command under way was refused.
    fn refused(&self) -> Fault {
        Fault::Refused {
            command: self.exchange.order.letters(),
        }
    }

    /// An attempt failed: it is repeated, or the request fails.
    fn failed(&mut self, task: &mut Task, doing: &mut Doing, fault: Fault, now: u64) -> Flow {
        task.failures = task.failures.saturating_add(1);
        let repeatable =
            self.exchange.order.is_idempotent() || matches!(fault, Fault::Refused { .. });
        if task.failures > self.policy.retries || !repeatable {
            return Flow::Break(Err(fault));
        }
        self.retries = self.retries.saturating_add(1);
        debug!("repeated after {}", fault);
        self.port.wait(now, self.policy.pause_us);
        *doing = Doing::Pause;
        Flow::Continue(())
    }

    /// A banner: it was asked for, or the camera restarted.
    fn on_banner(
        &mut self,
        task: &mut Task,
        doing: &mut Doing,
        version: FirmwareVersion,
        now: u64,
    ) -> Flow {
        self.recognise(version);
        let asked = match doing {
            Doing::Exchange(awaited) if self.exchange.asks_for_banner(awaited) => {
                *awaited = Awaited::Reply(Some(Answer::Version(version)));
                self.port.wait(now, self.policy.reply_us);
                return Flow::Continue(());
            }
            Doing::Wait | Doing::Synchronise(_, Resume::Plan) => false,
            Doing::Exchange(_) | Doing::Pause | Doing::Synchronise(..) => true,
        };
        self.forgotten();
        task.on_restart(self.exchange.answers(asked), self.policy.retries)?;
        let before = match doing {
            Doing::Synchronise(before, _) => Some(*before),
            _ => None,
        };
        let booting = Synchronisation::booting(before, &mut self.port, &self.policy, now);
        *doing = Doing::Synchronise(booting, Resume::Plan);
        Flow::Continue(())
    }

    fn recognise(&mut self, version: FirmwareVersion) {
        self.sensor = version.sensor().or(self.sensor);
    }

    /// The camera has restarted and forgotten its modes.
    fn forgotten(&mut self) {
        warning!("the camera restarted");
        self.restarts = self.restarts.saturating_add(1);
        self.link = Link::Unknown;
        self.restore = Some(Cursor::default());
    }
}
