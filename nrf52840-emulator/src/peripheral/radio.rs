//! RADIO in its IEEE 802.15.4 mode.

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, US};

const SHORTS: u16 = 0x200;
const CRCSTATUS: u16 = 0x400;
const PACKETPTR: u16 = 0x504;
const FREQUENCY: u16 = 0x508;
const TXPOWER: u16 = 0x50c;
const MODE: u16 = 0x510;
const STATE: u16 = 0x550;
const DATAWHITEIV: u16 = 0x554;
const SFD: u16 = 0x660;
const MODECNF0: u16 = 0x650;
const CCACTRL: u16 = 0x66c;
const POWER: u16 = 0xffc;

const READY: u16 = 0;
const ADDRESS: u16 = 1;
const PAYLOAD: u16 = 2;
const END: u16 = 3;
const DISABLED: u16 = 4;
const CRCOK: u16 = 12;
const CRCERROR: u16 = 13;
const FRAMESTART: u16 = 14;
const CCAIDLE: u16 = 17;
const CCABUSY: u16 = 18;
const CCASTOPPED: u16 = 19;
const TXREADY: u16 = 21;
const RXREADY: u16 = 22;
const PHYEND: u16 = 27;
/// MODE of IEEE 802.15.4, 250 kbit/s.
const IEEE_802_15_4: u32 = 15;
/// IEEE 802.15.4-2020, 12.1: a byte of two symbols, and the six bytes from the preamble to the length.
pub const AIR_PER_BYTE: u64 = 32 * US;
/// The six bytes before a frame.
pub const HEADER: u64 = 6 * AIR_PER_BYTE;
/// Eight symbols: an assessment of the channel (IEEE 802.15.4-2020, 10.2.8).
const CCA_TIME: u64 = 128 * US;
/// Product Specification, "RADIO", timing: the default ramp-up, and the ends. The fast one of 40 us is
/// not modelled: others would hear too late of a frame.
pub(crate) const RAMP_UP: u64 = 130 * US;
const TX_DISABLE: u64 = 21 * US;
const RX_DISABLE: u64 = 500;
/// Modes of CCACTRL; the others ask for energy.
const CARRIER: u32 = 1;
const CARRIER_AND_ENERGY: u32 = 2;
const CARRIER_OR_ENERGY: u32 = 3;
/// Bytes of the longest frame with its length.
const PACKET: u64 = 128;
/// FCS.
const FCS: usize = 2;

/// After a reset, where it is not 0.
pub(crate) const RESET: [(u16, u32); 6] = [
    (FREQUENCY, 2),
    (DATAWHITEIV, 0x40),
    (MODECNF0, 0x200),
    (SFD, 0xa7),
    (CCACTRL, 0x052d_0000),
    (POWER, 1),
];

/// Bits of SHORTS that are modelled, causes and tasks (Product Specification, "RADIO").
const SHORTCUTS: [(u16, u16, u16); 13] = [
    (0, READY, 2),
    (1, END, 4),
    (2, DISABLED, 0),
    (3, DISABLED, 1),
    (5, END, 2),
    (11, RXREADY, 11),
    (12, CCAIDLE, 0),
    (13, CCABUSY, 4),
    (17, CCAIDLE, 3),
    (18, TXREADY, 2),
    (19, RXREADY, 2),
    (20, PHYEND, 4),
    (21, PHYEND, 2),
];

/// A frame on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// When its preamble starts, nanoseconds.
    pub start: u64,
    /// Who sends it.
    pub node: usize,
    /// FREQUENCY: MHz above 2400.
    pub frequency: u32,
    /// TXPOWER, dBm.
    pub power: i8,
    /// With its FCS.
    pub psdu: Vec<u8>,
}

impl Frame {
    /// When its length has been sent.
    pub fn body(&self) -> u64 {
        self.start + HEADER
    }

    /// When it is over.
    pub fn end(&self) -> u64 {
        self.body() + self.psdu.len() as u64 * AIR_PER_BYTE
    }
}

/// The FCS of IEEE 802.15.4-2020, 7.2.11.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| {
            crc >> 1 ^ if crc & 1 != 0 { 0x8408 } else { 0 }
        })
    })
}

/// Numbers of STATE.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Disabled = 0,
    RxRampUp = 1,
    RxIdle = 2,
    Rx = 3,
    RxDisable = 4,
    TxRampUp = 9,
    TxIdle = 10,
    Tx = 11,
    TxDisable = 12,
}

/// How a frame arrives at a radio.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Of its energy and its quality, as the chip measures them: 0 to 63, in steps of 1 dB from -92 dBm
    /// (Product Specification, "RADIO").
    pub level: u8,
    /// It is too weak to be taken for a frame.
    pub is_faint: bool,
    /// It stands out from all that is on the air when it begins.
    pub stands_out: bool,
    /// Of which nodes the frames do not stand out any more once it has begun; none if of all.
    pub spoils: Option<Vec<usize>>,
}

impl From<u8> for Arrival {
    /// Where frames that overlap spoil each other, whatever their levels.
    fn from(level: u8) -> Self {
        Self {
            level,
            is_faint: false,
            stands_out: true,
            spoils: None,
        }
    }
}

/// What a frame on the air is to this radio.
#[derive(Debug)]
struct Heard {
    frame: Frame,
    arrival: Arrival,
    /// How many of its edges the radio has met.
    met: usize,
}

impl Heard {
    /// When it begins, its length is over, and it ends.
    fn edges(&self) -> [u64; 3] {
        [self.frame.start, self.frame.body(), self.frame.end()]
    }
}

/// The radio of one chip. A frame is told when its transmitter ramps up, so that whoever carries it to
/// others knows of it before it is on the air.
#[derive(Debug, Default)]
pub struct Radio {
    /// Frames that this radio sends, in order, to be taken.
    pub sent: Vec<Frame>,
    /// From this instant on the next transmission does not end, once.
    pub sticks_at: Option<u64>,
    /// Frames received, and those whose FCS was wrong.
    pub received: [u64; 2],
    /// How long it received and sent until its state last changed, nanoseconds.
    on: [u64; 2],
    node: usize,
    state: State,
    since: u64,
    step: Option<EventId>,
    assessment: Option<(EventId, u64)>,
    air: Vec<Heard>,
    /// Until when something else is on a FREQUENCY, or on all.
    jammed: Vec<(u64, Option<u32>)>,
    /// The start of the frame being received, by whom, and whether it is whole.
    reception: Option<(u64, usize, bool)>,
    packet: Vec<u8>,
    is_body: bool,
    starts: u64,
}

impl Radio {
    /// The radio of this node.
    pub fn new(node: usize) -> Self {
        Self {
            node,
            ..Self::default()
        }
    }

    /// A frame of another node arrives, which starts now or later. Its beginning is met when the radio is next
    /// called after it; whoever watches that is called when its length has been.
    ///
    /// # Panics
    /// The frame has already begun.
    pub fn hear(&mut self, frame: Frame, arrival: Arrival, call: &mut Call<'_, '_>) {
        assert!(frame.start >= call.now(), "a frame is told too late");
        call.at(frame.end());
        call.at(frame.body());
        self.air.push(Heard {
            frame,
            arrival,
            met: 0,
        });
    }

    /// A node loses its power at an instant: what it sends then is not received whole.
    pub fn cut_off(&mut self, node: usize, now: u64) {
        let frames = self.air.iter_mut();
        for heard in frames.filter(|heard| heard.frame.node == node && heard.frame.end() > now) {
            // Not even if its beginning was not met yet.
            heard.arrival.stands_out = false;
            if let Some((start, of, is_whole)) = &mut self.reception
                && (*start, *of) == (heard.frame.start, node)
            {
                *is_whole = false;
            }
        }
    }

    /// Meets the edges of frames until now, in their order.
    fn catch_up(&mut self, call: &mut Call<'_, '_>) {
        let now = call.now();
        loop {
            let next = |(number, heard): (usize, &Heard)| {
                let at = *heard.edges().get(heard.met)?;
                Some((at, number))
            };
            let first = self.air.iter().enumerate().filter_map(next).min();
            let Some((_, number)) = first.filter(|(at, _)| *at <= now) else {
                break;
            };
            let edge = self.air[number].met;
            self.air[number].met += 1;
            self.edge(number, edge, call);
        }
    }

    /// Until an instant something that is no frame is on a FREQUENCY, or on all: assessments find it.
    pub fn jam(&mut self, until: u64, frequency: Option<u32>) {
        self.jammed.push((until, frequency));
    }

    fn enter(&mut self, state: State, call: &Call<'_, '_>) {
        self.count(call.now());
        self.state = state;
    }

    /// Its time so far, before its state changes.
    pub(crate) fn count(&mut self, now: u64) {
        self.on = self.on_until(now);
        self.since = now;
    }

    /// How long it received and sent until now, nanoseconds.
    pub fn on_until(&self, now: u64) -> [u64; 2] {
        let which = match self.state {
            State::Disabled => None,
            State::RxRampUp | State::RxIdle | State::Rx | State::RxDisable => Some(0),
            _ => Some(1),
        };
        let mut on = self.on;
        if let Some(which) = which {
            on[which] += now.saturating_sub(self.since);
        }
        on
    }

    fn ramp_up(&mut self, state: State, call: &mut Call<'_, '_>) -> u64 {
        self.reception = None;
        self.assessment = None;
        self.enter(state, call);
        if call.get(MODECNF0) & 1 != 0 {
            call.forbid("MODECNF0", "the fast ramp-up is not modelled");
        }
        self.step = Some(call.after(RAMP_UP));
        call.now() + RAMP_UP
    }

    fn start(&mut self, call: &mut Call<'_, '_>) {
        match self.state {
            State::RxIdle => self.enter(State::Rx, call),
            State::TxIdle => {
                // The frame was told when it began to ramp up.
                if core::mem::take(&mut self.starts) != call.now() {
                    call.forbid(
                        "TASKS_START",
                        "that it sends later than it can is not modelled",
                    );
                }
                self.enter(State::Tx, call);
                self.is_body = false;
                self.step = Some(call.after(HEADER));
            }
            _ => call.forbid(
                "TASKS_START",
                "it is started from an idle state only (\"RADIO\")",
            ),
        }
    }

    fn disable(&mut self, call: &mut Call<'_, '_>) {
        self.reception = None;
        self.assessment = None;
        match self.state {
            State::Disabled => call.event(DISABLED),
            State::RxRampUp | State::RxIdle | State::Rx => {
                self.enter(State::RxDisable, call);
                self.step = Some(call.after(RX_DISABLE));
            }
            State::TxRampUp | State::TxIdle | State::Tx => {
                self.enter(State::TxDisable, call);
                self.step = Some(call.after(TX_DISABLE));
            }
            State::RxDisable | State::TxDisable => {}
        }
    }

    /// Whether anything on the channel between two instants makes it busy (Product Specification,
    /// "RADIO", CCACTRL).
    fn is_busy(&self, from: u64, to: u64, call: &Call<'_, '_>) -> bool {
        let control = call.get(CCACTRL);
        let (mode, energy) = (control & 7, (control >> 8 & 0xff) as u8);
        let frequency = call.get(FREQUENCY) & 0x7f;
        let needs_carrier = matches!(mode, CARRIER | CARRIER_AND_ENERGY);
        // What is no frame has energy, and no carrier of one.
        let is_jammed = { self.jammed.iter() }
            .any(|(until, which)| *until > from && which.is_none_or(|which| which == frequency));
        is_jammed && !needs_carrier || { self.air.iter() }
            .filter(|heard| heard.frame.frequency == frequency)
            .filter(|heard| heard.frame.start < to && heard.frame.end() > from)
            .any(|heard| {
                let Arrival {
                    level, is_faint, ..
                } = heard.arrival;
                let (is_carrier, is_strong) = (!is_faint, level >= energy);
                match mode {
                    CARRIER => is_carrier,
                    CARRIER_AND_ENERGY => is_carrier && is_strong,
                    CARRIER_OR_ENERGY => is_carrier || is_strong,
                    _ => is_strong,
                }
            })
    }

    fn step(&mut self, call: &mut Call<'_, '_>) {
        match self.state {
            State::RxRampUp => {
                self.enter(State::RxIdle, call);
                call.event(READY);
                call.event(RXREADY);
            }
            State::TxRampUp => {
                self.enter(State::TxIdle, call);
                call.event(READY);
                call.event(TXREADY);
            }
            State::RxDisable | State::TxDisable => {
                self.enter(State::Disabled, call);
                call.event(DISABLED);
            }
            State::Tx if !self.is_body => {
                self.is_body = true;
                call.event(FRAMESTART);
                call.event(ADDRESS);
                let length = u64::from(self.packet.first().map_or(0, |length| length & 0x7f));
                self.step = Some(call.after(length * AIR_PER_BYTE));
            }
            State::Tx if self.sticks_at.take_if(|at| *at <= call.now()).is_some() => {}
            State::Tx => {
                self.enter(State::TxIdle, call);
                for event in [PAYLOAD, END, PHYEND] {
                    call.event(event);
                }
            }
            _ => {}
        }
    }

    /// A frame begins, its body does, or it ends.
    fn edge(&mut self, number: usize, edge: usize, call: &mut Call<'_, '_>) {
        let heard = &self.air[number];
        let (start, node) = (heard.frame.start, heard.frame.node);
        let is_tuned = heard.frame.frequency == call.get(FREQUENCY) & 0x7f;
        let is_this = self
            .reception
            .is_some_and(|(s, n, _)| (s, n) == (start, node));
        let Arrival {
            is_faint,
            stands_out,
            ref spoils,
            ..
        } = heard.arrival;
        match edge {
            0 if is_tuned => match &mut self.reception {
                Some((_, of, is_whole)) => {
                    *is_whole &= { spoils.as_ref() }.is_some_and(|spoils| !spoils.contains(of));
                }
                None if self.state == State::Rx && self.assessment.is_none() && !is_faint => {
                    self.reception = Some((start, node, stands_out));
                }
                None => {}
            },
            1 if is_this => {
                call.event(FRAMESTART);
                call.event(ADDRESS);
            }
            2 if is_this => {
                let is_whole = self.reception.take().is_some_and(|(_, _, whole)| whole);
                let (psdu, level) = (heard.frame.psdu.clone(), heard.arrival.level);
                self.receive(&psdu, level, is_whole, call);
            }
            _ => {}
        }
    }

    /// The quality takes the place of the FCS's first byte (Product Specification, "RADIO").
    fn receive(&mut self, psdu: &[u8], level: u8, is_whole: bool, call: &mut Call<'_, '_>) {
        let (body, fcs) = psdu.split_at(psdu.len().saturating_sub(FCS));
        let is_right = is_whole && fcs == crc(body).to_le_bytes();
        let length = psdu.len() as u8;
        let pointer = call.get(PACKETPTR);
        if call.reaches(pointer, u32::from(length)) {
            let bytes = [&[length], body, &[level]].concat();
            for (at, byte) in (u64::from(pointer)..).zip(bytes) {
                call.context.write_to(at, Width::W8, byte.into(), DONE);
            }
        }
        call.set(CRCSTATUS, is_right.into());
        self.received[usize::from(!is_right)] += 1;
        self.enter(State::RxIdle, call);
        call.event(if is_right { CRCOK } else { CRCERROR });
        for event in [PAYLOAD, END, PHYEND] {
            call.event(event);
        }
    }
}

impl Model for Radio {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        self.catch_up(call);
        if call.get(MODE) & 0xf != IEEE_802_15_4 && number < 3 {
            call.forbid("MODE", "only the mode of IEEE 802.15.4 is modelled");
        }
        match (number, self.state) {
            (0, State::Disabled | State::RxIdle | State::Rx | State::TxIdle) => {
                self.starts = self.ramp_up(State::TxRampUp, call);
                self.packet.clear();
                let pointer = call.get(PACKETPTR);
                if call.reaches(pointer, PACKET as u32) {
                    for byte in 0..PACKET {
                        let at = u64::from(pointer) + byte;
                        call.context.read_from(at, Width::W8, READ + byte);
                    }
                }
            }
            (1, State::Disabled | State::TxIdle) => {
                self.ramp_up(State::RxRampUp, call);
            }
            (0 | 1, _) => call.forbid(
                "TASKS_TXEN",
                "a ramp-up in a wrong state (\"RADIO\", states)",
            ),
            (2, _) => self.start(call),
            (3, State::Rx) => {
                self.reception = None;
                self.assessment = None;
                self.enter(State::RxIdle, call);
            }
            (3, State::Tx) => {
                self.step = None;
                self.enter(State::TxIdle, call);
            }
            (4, _) => self.disable(call),
            (11, State::RxIdle | State::Rx) => {
                self.reception = None;
                self.enter(State::Rx, call);
                let from = call.now();
                self.assessment = Some((call.after(CCA_TIME), from));
            }
            (11, _) => call.forbid("TASKS_CCASTART", "the receiver must run (\"RADIO\", CCA)"),
            (12, _) if self.assessment.take().is_some() => {
                self.enter(State::RxIdle, call);
                call.event(CCASTOPPED);
            }
            (3 | 12, _) => {}
            _ => call.forbid("TASKS", "this task is not modelled"),
        }
    }

    fn answer(&mut self, token: u64, value: u32, call: &mut Call<'_, '_>) {
        self.packet.push(value as u8);
        if token == PACKET {
            let length = usize::from(self.packet[0] & 0x7f);
            let body = &self.packet[1..1 + length.saturating_sub(FCS)];
            let psdu = [body, &crc(body).to_le_bytes()].concat();
            self.sent.push(Frame {
                start: self.starts,
                node: self.node,
                frequency: call.get(FREQUENCY) & 0x7f,
                power: call.get(TXPOWER) as u8 as i8,
                psdu,
            });
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        self.catch_up(call);
        if self.step == Some(id) {
            self.step = None;
            self.step(call);
        }
        if let Some((_, from)) = self.assessment.take_if(|(mine, _)| *mine == id) {
            let is_busy = self.is_busy(from, call.now(), call);
            self.enter(State::RxIdle, call);
            call.event(if is_busy { CCABUSY } else { CCAIDLE });
        }
        let now = call.now();
        // An assessment looks back over what is just over.
        self.air.retain(|heard| heard.frame.end() + CCA_TIME >= now);
        self.jammed.retain(|(until, _)| until + CCA_TIME >= now);
    }

    fn shortcut(&mut self, event: u16, call: &mut Call<'_, '_>) {
        let shorts = call.get(SHORTS);
        for (bit, cause, task) in SHORTCUTS {
            if cause == event && shorts >> bit & 1 != 0 {
                self.task(task, call);
            }
        }
    }

    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        self.catch_up(call);
        (offset == STATE).then_some(self.state as u32)
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        self.catch_up(call);
        let known = SHORTCUTS
            .iter()
            .fold(0, |known, (bit, ..)| known | 1 << bit);
        if offset == SHORTS && value & !known != 0 {
            call.forbid("SHORTS", "a shortcut that is not modelled");
        }
        if offset == POWER && value & 1 == 0 {
            for word in 0..POWER / 4 {
                call.set(word * 4, 0);
            }
            for (offset, value) in RESET {
                call.set(offset, value);
            }
            call.enabled = 0;
            self.enter(State::Disabled, call);
            self.stop();
        }
    }

    fn reset(&mut self) {
        self.state = State::Disabled;
        self.stop();
        // The chip forgot the instants of the edges.
        self.air.clear();
    }
}

impl Radio {
    fn stop(&mut self) {
        self.step = None;
        self.assessment = None;
        self.reception = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::{INTENSET, bench::Bench};
    use rigless::time::VirtualNanos;

    const PACKET_AT: u32 = 0x2000_0100;

    fn bench() -> Bench<Radio> {
        let mut bench = Bench::new(Radio::new(3));
        bench.set(MODE, IEEE_802_15_4);
        bench.set(FREQUENCY, 5);
        bench.set(PACKETPTR, PACKET_AT);
        bench
    }

    fn frame(start: u64, node: usize) -> Frame {
        let body = b"to all";
        let psdu = [body.as_slice(), &crc(body).to_le_bytes()].concat();
        Frame {
            start,
            node,
            frequency: 5,
            power: 0,
            psdu,
        }
    }

    fn hear(bench: &mut Bench<Radio>, frame: Frame, arrival: impl Into<Arrival>) {
        let at = VirtualNanos(bench.now);
        let arrival = arrival.into();
        bench.chip.drive(at, |instance, file, context| {
            instance.call(file, context, |radio, call| {
                radio.hear(frame, arrival, call);
            });
        });
    }

    fn listen(bench: &mut Bench<Radio>) {
        bench.set(SHORTS, 1 << 19);
        bench.task(1);
        bench.pass(RAMP_UP);
        assert_eq!(bench.get(STATE), State::Rx as u32);
    }

    /// Known as CRC-16/KERMIT, whose check value this is.
    #[test]
    fn the_check_sequence_is_the_standards() {
        // A frame with its own FCS leaves nothing.
        assert_eq!(crc(&frame(0, 1).psdu), 0);
        assert_eq!(crc(b"123456789"), 0x2189);
    }

    #[test]
    fn a_frame_is_sent_after_the_ramp_up() {
        let mut bench = bench();
        bench.cells.0.insert(PACKET_AT.into(), 8);
        for (at, byte) in (u64::from(PACKET_AT) + 1..).zip(*b"to all") {
            bench.cells.0.insert(at, byte);
        }
        bench.set(SHORTS, 1 << 18 | 1 << 20);
        bench.task(0);
        // Told at once.
        let expected = frame(RAMP_UP, 3);
        assert_eq!(bench.chip.model.model.sent, std::slice::from_ref(&expected));
        bench.pass(expected.body() - 1);
        assert!(!bench.took(FRAMESTART));
        bench.pass(expected.end() - expected.body());
        assert!(bench.took(FRAMESTART) && !bench.took(PHYEND));
        bench.pass(1);
        assert!(bench.took(PHYEND) && bench.took(END) && !bench.took(DISABLED));
        bench.pass(TX_DISABLE);
        assert!(bench.took(DISABLED));
        let on = expected.end() + TX_DISABLE;
        assert_eq!(bench.chip.model.model.on_until(bench.now), [0, on]);
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn a_frame_is_received() {
        let mut bench = bench();
        listen(&mut bench);
        let frame = frame(1_000 * US, 1);
        hear(&mut bench, frame.clone(), 40);
        bench.pass(frame.end());
        assert!(bench.took(FRAMESTART) && bench.took(CRCOK) && bench.took(END));
        let packet = (0..8).map(|at| bench.cells.0[&(u64::from(PACKET_AT) + at)]);
        assert_eq!(
            packet.collect::<Vec<_>>(),
            [b"\x08to all".as_slice(), &[40]].concat()
        );
        assert_eq!(bench.get(CRCSTATUS), 1);
    }

    /// Its length interrupts when it is there, if it is to; or is found there by whoever looks.
    #[test]
    fn the_middle_of_a_frame_is_told_to_those_who_watch() {
        for is_enabled in [false, true] {
            let mut bench = bench();
            listen(&mut bench);
            let frame = frame(1_000 * US, 1);
            hear(&mut bench, frame.clone(), 40);
            if is_enabled {
                bench.set(INTENSET, 1 << ADDRESS | 1 << FRAMESTART);
            }
            bench.pass(frame.body() - bench.now);
            assert_eq!(bench.chip.model.is_pending(), is_enabled);
            assert!(bench.took(FRAMESTART) && !bench.took(END));
            bench.pass(frame.end() - bench.now);
            assert!(bench.took(END));
        }
    }

    #[test]
    fn frames_that_overlap_spoil_each_other() {
        let mut bench = bench();
        listen(&mut bench);
        hear(&mut bench, frame(1_000 * US, 1), 40);
        hear(&mut bench, frame(1_200 * US, 2), 40);
        bench.pass(5_000 * US);
        assert!(bench.took(CRCERROR) && !bench.took(CRCOK));
        assert_eq!(bench.chip.model.model.received, [0, 1]);
    }

    /// In the middle of it, or before it has begun; not where it is over, nor what others send.
    #[test]
    fn what_is_cut_off_is_not_received_whole() {
        for (at, node, received) in [
            (1_200, 1, [0, 1]),
            (900, 1, [0, 1]),
            (4_000, 1, [1, 0]),
            (1_200, 2, [1, 0]),
        ] {
            let mut bench = bench();
            listen(&mut bench);
            hear(&mut bench, frame(1_000 * US, 1), 40);
            bench.pass(at * US - bench.now);
            let now = bench.now;
            bench.with(|radio, _| radio.cut_off(node, now));
            bench.pass(5_000 * US);
            let radio = &bench.chip.model.model;
            assert_eq!(radio.received, received, "{at} {node}");
        }
    }

    /// Who carries the frames says which of them survives: the first one, if at all.
    #[test]
    fn a_frame_that_stands_out_survives() {
        let weak = |spoils: &[usize]| Arrival {
            spoils: Some(spoils.to_vec()),
            ..Arrival::from(10)
        };
        for (first, second, received) in [
            (Arrival::from(40), weak(&[]), [1, 0]),
            (Arrival::from(40), weak(&[1]), [0, 1]),
            (
                Arrival {
                    stands_out: false,
                    ..weak(&[])
                },
                weak(&[]),
                [0, 1],
            ),
            (
                Arrival {
                    is_faint: true,
                    ..weak(&[])
                },
                weak(&[]),
                [1, 0],
            ),
            (
                Arrival {
                    is_faint: true,
                    ..weak(&[])
                },
                Arrival {
                    is_faint: true,
                    ..weak(&[])
                },
                [0, 0],
            ),
        ] {
            let mut bench = bench();
            listen(&mut bench);
            hear(&mut bench, frame(1_000 * US, 1), first);
            hear(&mut bench, frame(1_200 * US, 2), second);
            bench.pass(5_000 * US);
            assert_eq!(bench.chip.model.model.received, received);
        }
    }

    #[test]
    fn what_jams_the_channel_makes_it_busy() {
        for (frequency, until, is_busy) in [
            (None, RAMP_UP + 1, true),
            (Some(5), RAMP_UP + 1, true),
            (Some(10), RAMP_UP + 1, false),
            (None, RAMP_UP, false),
        ] {
            let mut bench = bench();
            bench.set(SHORTS, 1 << 11);
            bench.chip.model.model.jam(until, frequency);
            bench.task(1);
            bench.pass(RAMP_UP + CCA_TIME);
            let told = (bench.took(CCABUSY), bench.took(CCAIDLE));
            assert_eq!(told, (is_busy, !is_busy), "{frequency:?} {until}");
        }
    }

    /// It is energy, and no frame.
    #[test]
    fn what_jams_the_channel_is_no_carrier_of_frames() {
        for (mode, is_busy) in [(0, true), (1, false), (2, false), (3, true)] {
            let mut bench = bench();
            bench.set(CCACTRL, mode);
            bench.set(SHORTS, 1 << 11);
            bench.chip.model.model.jam(1_000 * US, None);
            bench.task(1);
            bench.pass(RAMP_UP + CCA_TIME);
            assert_eq!(bench.took(CCABUSY), is_busy, "{mode}");
        }
    }

    #[test]
    fn switched_off_it_is_as_after_a_reset() {
        let mut bench = bench();
        bench.set(INTENSET, 1 << END);
        bench.set(POWER, 0);
        bench.set(POWER, 1);
        assert_eq!(bench.get(INTENSET), 0);
        for (offset, value) in RESET {
            assert_eq!(bench.get(offset), value, "{offset:x}");
        }
    }

    #[test]
    fn what_is_not_modelled_of_sending_is_told() {
        let mut bench = bench();
        bench.set(SHORTS, 1 << 18);
        bench.task(0);
        bench.pass(RAMP_UP);
        assert_eq!(bench.forbidden(), [""; 0]);
        let mut bench = self::bench();
        bench.task(0);
        bench.pass(RAMP_UP + 1);
        bench.task(2);
        assert_eq!(bench.forbidden(), ["TASKS_START"]);
        bench.set(SHORTS, 1 << 4);
        assert_eq!(bench.forbidden(), ["SHORTS"]);
    }

    #[test]
    fn what_is_not_listened_for_is_not_heard() {
        let mut bench = bench();
        // It begins before the receiver does, and one is elsewhere.
        hear(&mut bench, frame(RAMP_UP - 1, 1), 40);
        let elsewhere = Frame {
            frequency: 10,
            ..frame(2_000 * US, 1)
        };
        hear(&mut bench, elsewhere, 40);
        listen(&mut bench);
        bench.pass(5_000 * US);
        assert!(!bench.took(FRAMESTART) && !bench.took(END));
    }

    #[test]
    fn the_channel_is_busy_with_a_frame_or_its_energy() {
        for (mode, threshold, level, is_busy) in [
            (0, 17, 16, false),
            (0, 17, 17, true),
            (1, 17, 1, true),
            (2, 17, 16, false),
            (2, 17, 17, true),
            (3, 17, 16, true),
        ] {
            let mut bench = bench();
            bench.set(CCACTRL, mode | threshold << 8);
            bench.set(SHORTS, 1 << 11);
            bench.task(1);
            hear(&mut bench, frame(RAMP_UP + CCA_TIME - 1, 1), level);
            bench.pass(RAMP_UP + CCA_TIME);
            let told = (bench.took(CCABUSY), bench.took(CCAIDLE));
            assert_eq!(told, (is_busy, !is_busy), "{mode} {level}");
        }
    }

    #[test]
    fn a_stuck_one_is_disabled() {
        let mut bench = bench();
        bench.chip.model.model.sticks_at = Some(0);
        bench.cells.0.insert(PACKET_AT.into(), 8);
        bench.set(SHORTS, 1 << 18);
        bench.task(0);
        bench.pass(1_000_000 * US);
        assert!(!bench.took(END));
        assert_eq!(bench.chip.model.model.on_until(bench.now), [0, bench.now]);
        bench.task(4);
        bench.pass(TX_DISABLE);
        assert!(bench.took(DISABLED));
        // Once.
        bench.task(0);
        bench.pass(10_000 * US);
        assert!(bench.took(END));
    }

    #[test]
    fn wrong_states_are_told() {
        let mut bench = bench();
        bench.task(2);
        bench.task(11);
        bench.task(1);
        bench.task(0);
        assert_eq!(
            bench.forbidden(),
            ["TASKS_START", "TASKS_CCASTART", "TASKS_TXEN"]
        );
    }
}
