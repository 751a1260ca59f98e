//! RADIO in its IEEE 802.15.4 mode.

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, SHORTS, US};

/// Its address (Product Specification, "Instantiation").
pub(crate) const BASE: u64 = 0x4000_1000;
/// Register where CLOCK tells if the crystal of 32 MHz runs. Programs know nothing of it.
pub(super) const HFXO: u16 = 0xf00;

const CRCSTATUS: u16 = 0x400;
const PACKETPTR: u16 = 0x504;
const FREQUENCY: u16 = 0x508;
const TXPOWER: u16 = 0x50c;
const MODE: u16 = 0x510;
const PCNF0: u16 = 0x514;
const PCNF1: u16 = 0x518;
const CRCCNF: u16 = 0x534;
const CRCPOLY: u16 = 0x538;
const CRCINIT: u16 = 0x53c;
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
const SYMBOL: u64 = 16 * US;
const CCA_TIME: u64 = 8 * SYMBOL;
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

/// Requirements of IEEE 802.15.4 on bits of registers: a length of eight bits that counts the FCS, behind a
/// preamble of 32 zeros; 127 bytes at most, without address and whitening, the least bits first; the FCS of two
/// bytes without the length; the standard's start of a frame (Product Specification, "RADIO", IEEE 802.15.4
/// operation).
const SET_UP: [(&str, u16, u32, u32); 7] = [
    ("MODE", MODE, 0xf, IEEE_802_15_4),
    ("PCNF0", PCNF0, !(1 << 20), 1 << 26 | 2 << 24 | 8),
    ("PCNF1", PCNF1, 0x0307_ffff, 127),
    ("CRCCNF", CRCCNF, 0x303, 0x202),
    ("CRCPOLY", CRCPOLY, 0xff_ffff, 0x1_1021),
    ("CRCINIT", CRCINIT, 0xff_ffff, 0),
    ("SFD", SFD, 0xff, 0xa7),
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
    /// Time when its preamble starts, nanoseconds.
    pub start: u64,
    /// Number of the node that sends it.
    pub node: usize,
    /// FREQUENCY: MHz above 2400.
    pub frequency: u32,
    /// TXPOWER, dBm.
    pub power: i8,
    /// With its FCS.
    pub psdu: Vec<u8>,
}

impl Frame {
    /// Time when its length has been sent.
    pub fn body(&self) -> u64 {
        self.start + HEADER
    }

    /// Time when it is over.
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

/// Way in which a frame arrives at a radio.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Level of its energy and its quality, as the chip measures them: 0 to 63, in steps of 1 dB from -92 dBm
    /// (Product Specification, "RADIO").
    pub level: u8,
    /// It is too weak to be taken for a frame.
    pub is_faint: bool,
    /// It stands out from all that is on the air when it begins.
    pub stands_out: bool,
    /// Nodes whose frames do not stand out any more once it has begun; none if those of all.
    pub spoils: Option<Vec<usize>>,
}

impl From<u8> for Arrival {
    /// Frames that overlap spoil each other, at any levels.
    fn from(level: u8) -> Self {
        Self {
            level,
            is_faint: false,
            stands_out: true,
            spoils: None,
        }
    }
}

/// A frame on the air, as this radio meets it.
#[derive(Debug)]
struct Heard {
    frame: Frame,
    arrival: Arrival,
    /// Number of its edges that the radio has met.
    met: usize,
}

impl Heard {
    /// Times when it begins, when its length is over, and when it ends.
    fn edges(&self) -> [u64; 3] {
        [self.frame.start, self.frame.body(), self.frame.end()]
    }
}

/// The radio of one chip. A frame is told when its transmitter ramps up, so that its carrier to others knows of it
/// before it is on the air.
#[derive(Debug, Default)]
pub struct Radio {
    /// Frames that this radio sends, in order, to be taken.
    pub sent: Vec<Frame>,
    /// From this instant on the next transmission does not end, once.
    pub sticks_at: Option<u64>,
    /// Frames received, and those whose FCS was wrong.
    pub received: [u64; 2],
    /// Times for which it received and sent until its state last changed, nanoseconds.
    on: [u64; 2],
    node: usize,
    state: State,
    since: u64,
    step: Option<EventId>,
    assessment: Option<(EventId, u64)>,
    air: Vec<Heard>,
    /// Times until which something else is on a FREQUENCY, or on all.
    jammed: Vec<(u64, Option<u32>)>,
    /// The start of the frame being received, its sender, and true if it is whole.
    reception: Option<(u64, usize, bool)>,
    /// FREQUENCY as it was when it was enabled, and PACKETPTR when it was started or, to send, enabled.
    frequency: u32,
    pointer: u32,
    packet: Vec<u8>,
    is_body: bool,
    /// Time when the frame that was told starts, until it does.
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
    /// called after it; a caller that watches that is called when its length has been.
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

    /// A node loses its power at an instant: a frame that it sends then is not received whole.
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

    /// Times for which it received and sent until now, nanoseconds.
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

    fn check_clock(call: &mut Call<'_, '_>) {
        if call.get(HFXO) == 0 {
            call.forbid(
                "HFXO",
                "the radio needs the crystal of 32 MHz (\"CLOCK\", HFXO)",
            );
        }
    }

    /// Takes over FREQUENCY, and tells of registers that are not set up as they must be.
    fn set_up(&mut self, call: &mut Call<'_, '_>) {
        for (register, offset, bits, value) in SET_UP {
            if call.get(offset) & bits != value {
                call.forbid(
                    register,
                    "it is not set up for IEEE 802.15.4, and nothing else is modelled (\"RADIO\")",
                );
            }
        }
        let frequency = call.get(FREQUENCY) & 0x1ff;
        if !(5..=80).contains(&frequency) || !frequency.is_multiple_of(5) {
            call.forbid(
                "FREQUENCY",
                "no channel of IEEE 802.15.4 is there (\"RADIO\")",
            );
        }
        self.frequency = frequency;
    }

    fn ramp_up(&mut self, state: State, call: &mut Call<'_, '_>) -> u64 {
        self.reception = None;
        self.assessment = None;
        self.enter(state, call);
        Self::check_clock(call);
        self.set_up(call);
        if call.get(MODECNF0) & 1 != 0 {
            call.forbid("MODECNF0", "the fast ramp-up is not modelled");
        }
        self.step = Some(call.after(RAMP_UP));
        call.now() + RAMP_UP
    }

    fn start(&mut self, call: &mut Call<'_, '_>) {
        match self.state {
            State::RxIdle => {
                self.pointer = call.get(PACKETPTR);
                self.enter(State::Rx, call);
            }
            State::TxIdle => {
                // The frame was told when it began to ramp up.
                let is_told = core::mem::take(&mut self.starts) == call.now();
                if !is_told || self.pointer != call.get(PACKETPTR) {
                    call.forbid(
                        "TASKS_START",
                        "that it sends later than it can, or another packet, is not modelled",
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

    /// Others have heard of a frame that is not over: they go on hearing it.
    fn give_up(&mut self, call: &mut Call<'_, '_>) {
        let is_under_way = match self.state {
            State::TxRampUp => true,
            State::TxIdle => core::mem::take(&mut self.starts) != 0,
            State::Tx => self.step.is_some(),
            _ => false,
        };
        if is_under_way {
            call.forbid(
                "TASKS_DISABLE",
                "that it gives up a frame that it sends is not modelled",
            );
        }
    }

    fn disable(&mut self, call: &mut Call<'_, '_>) {
        self.give_up(call);
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

    /// Returns true if anything on the channel between two instants makes it busy: the carrier of a frame for as
    /// many symbols as CCACORRCNT says, unless that is 0; or the energy of all frames, in the mean (Product
    /// Specification, "RADIO", CCACTRL). A frame correlates better than any CCACORRTHRES.
    fn is_busy(&self, from: u64, to: u64, call: &Call<'_, '_>) -> bool {
        let control = call.get(CCACTRL);
        let (mode, threshold, count) = (control & 7, control >> 8 & 0xff, control >> 24);
        let heard = || {
            { self.air.iter() }
                .filter(|heard| heard.frame.frequency == self.frequency)
                .map(|heard| {
                    let until = heard.frame.end().min(to);
                    let overlap = until.saturating_sub(heard.frame.start.max(from));
                    (&heard.arrival, overlap)
                })
        };
        let least = u64::from(count) * SYMBOL;
        let is_carrier =
            count > 0 && heard().any(|(arrival, overlap)| !arrival.is_faint && overlap >= least);
        let power = |level: f64| 10_f64.powf(level / 10.0);
        let energy = heard().map(|(arrival, overlap)| power(arrival.level.into()) * overlap as f64);
        // A signal that is no frame has energy, however short it is, and no carrier of one.
        let is_jammed = { self.jammed.iter() }.any(|(until, which)| {
            *until > from && which.is_none_or(|which| which == self.frequency)
        });
        let is_strong =
            is_jammed || energy.sum::<f64>() >= power(threshold.into()) * (to - from) as f64;
        match mode {
            CARRIER => is_carrier,
            CARRIER_AND_ENERGY => is_carrier && is_strong,
            CARRIER_OR_ENERGY => is_carrier || is_strong,
            _ => is_strong,
        }
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
        let is_tuned = heard.frame.frequency == self.frequency;
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
        let pointer = self.pointer;
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
        match (number, self.state) {
            (0, State::Disabled | State::RxIdle) => {
                self.starts = self.ramp_up(State::TxRampUp, call);
                self.packet.clear();
                let pointer = call.get(PACKETPTR);
                self.pointer = pointer;
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
                self.give_up(call);
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
            // There is nothing to stop. Nor is there while it ramps up to receive, where the driver of embassy stops
            // it; the specification does not say what comes of it, and here nothing does.
            (3, State::RxRampUp | State::RxIdle | State::TxIdle) | (12, _) => {}
            (3, _) => call.forbid("TASKS_STOP", "there is nothing to stop (\"RADIO\", states)"),
            _ => call.no_task(),
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
                frequency: self.frequency,
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
        call.only_shortcuts(offset, value, known);
        if offset == HFXO && self.state != State::Disabled {
            Self::check_clock(call);
        }
        if offset == POWER && value & 1 == 0 {
            let hfxo = call.get(HFXO);
            for word in 0..POWER / 4 {
                call.set(word * 4, 0);
            }
            for (offset, value) in RESET.into_iter().chain([(HFXO, hfxo)]) {
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
        bench.set(HFXO, 1);
        for (_, offset, _, value) in SET_UP {
            bench.set(offset, value);
        }
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

    /// Its length interrupts when it is there, if it is to; or a program that looks finds it there.
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

    /// In the middle of it, or before it has begun; not where it is over, nor the frames of others.
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

    /// The caller that carries the frames says which of them survives: the first one, if at all.
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

    /// Returns true if an assessment finds the channel busy, in this mode, with a threshold of 17 and this count,
    /// while frames arrive after so long at such levels.
    fn is_busy(mode: u32, count: u32, frames: &[(u64, Arrival)]) -> bool {
        let mut bench = bench();
        bench.set(CCACTRL, mode | 17 << 8 | count << 24);
        bench.set(SHORTS, 1 << 11);
        bench.task(1);
        for (number, (after, arrival)) in frames.iter().enumerate() {
            let frame = frame(RAMP_UP + after, number + 10);
            hear(&mut bench, frame, arrival.clone());
        }
        bench.pass(RAMP_UP + CCA_TIME);
        let told = (bench.took(CCABUSY), bench.took(CCAIDLE));
        assert_ne!(told.0, told.1);
        told.0
    }

    #[test]
    fn the_channel_is_busy_with_a_frame_or_its_energy() {
        for (mode, level, expected) in [
            (0, 16, false),
            (0, 17, true),
            (1, 1, true),
            (2, 16, false),
            (2, 17, true),
            (3, 16, true),
        ] {
            let busy = is_busy(mode, 2, &[(0, level.into())]);
            assert_eq!(busy, expected, "{mode} {level}");
        }
        assert!(!is_busy(3, 2, &[]));
    }

    /// Too short a carrier is none, nor is one where no assessment looks for it, or of a frame that is too weak.
    #[test]
    fn a_carrier_is_seen_for_its_symbols() {
        let faint = Arrival {
            is_faint: true,
            ..Arrival::from(1)
        };
        for (count, after, arrival, expected) in [
            (1, CCA_TIME - SYMBOL, 1.into(), true),
            (2, CCA_TIME - 2 * SYMBOL, 1.into(), true),
            (2, CCA_TIME - 2 * SYMBOL + 1, 1.into(), false),
            (0, 0, 1.into(), false),
            (2, 0, faint, false),
        ] {
            let busy = is_busy(1, count, &[(after, arrival)]);
            assert_eq!(busy, expected, "{count} {after}");
        }
    }

    /// Half of the time it is 3 dB more.
    #[test]
    fn energies_add_and_are_averaged() {
        let half = CCA_TIME / 2;
        for (frames, expected) in [
            ([(half, 20), (CCA_TIME, 0)], false),
            ([(half, 21), (CCA_TIME, 0)], true),
            ([(0, 13), (0, 14)], false),
            ([(0, 14), (0, 14)], true),
            ([(CCA_TIME - 1, 30), (0, 0)], false),
        ] {
            let frames = frames.map(|(after, level): (_, u8)| (after, level.into()));
            assert_eq!(is_busy(0, 0, &frames), expected, "{frames:?}");
        }
    }

    #[test]
    fn what_is_set_while_it_works_comes_later() {
        let mut bench = bench();
        listen(&mut bench);
        bench.set(FREQUENCY, 10);
        bench.set(PACKETPTR, 0x2000_0200);
        let first = frame(1_000 * US, 1);
        hear(&mut bench, first.clone(), 40);
        bench.pass(first.end() - bench.now);
        assert!(bench.took(CRCOK));
        assert_eq!(bench.cells.0.get(&PACKET_AT.into()), Some(&8));
        assert_eq!(bench.cells.0.get(&0x2000_0200), None);
        // Started again it is another packet, enabled again another channel.
        bench.task(2);
        let second = frame(bench.now, 1);
        hear(&mut bench, second.clone(), 40);
        bench.pass(second.end() - bench.now);
        assert_eq!(bench.cells.0.get(&0x2000_0200), Some(&8));
        bench.task(4);
        bench.pass(RX_DISABLE);
        bench.task(1);
        bench.pass(RAMP_UP);
        let third = frame(bench.now, 1);
        hear(&mut bench, third.clone(), 40);
        bench.pass(third.end() - bench.now);
        assert_eq!(bench.chip.model.model.received, [2, 0]);
    }

    #[test]
    fn what_the_standard_does_not_have_is_told() {
        let wrong = SET_UP.map(|(register, offset, _, value)| (register, offset, value ^ 1));
        let frequencies = [0, 2, 7, 85, 0x105].map(|value| ("FREQUENCY", FREQUENCY, value));
        let lengths = [("PCNF1", PCNF1, 128), ("PCNF0", PCNF0, 8)];
        for (register, offset, value) in wrong.into_iter().chain(frequencies).chain(lengths) {
            let mut bench = bench();
            bench.set(offset, value);
            bench.task(1);
            assert_eq!(bench.forbidden(), [register], "{value:x}");
        }
    }

    #[test]
    fn a_frame_that_is_given_up_is_told() {
        const STARTS: u32 = 1 << 18;
        for (shorts, after, task, is_told) in [
            (STARTS, 0, 4, true),
            (0, RAMP_UP + 1, 4, true),
            (STARTS, RAMP_UP + 1, 4, true),
            (STARTS, RAMP_UP + 1, 3, true),
            (STARTS, RAMP_UP + 1_000 * US, 4, false),
        ] {
            let mut bench = bench();
            bench.cells.0.insert(PACKET_AT.into(), 8);
            bench.set(SHORTS, shorts);
            bench.task(0);
            bench.pass(after);
            bench.task(task);
            assert_eq!(bench.forbidden() == ["TASKS_DISABLE"], is_told, "{after}");
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
    fn it_needs_its_crystal() {
        let mut bench = bench();
        bench.set(HFXO, 0);
        for task in [1, 4, 0] {
            bench.task(task);
            bench.pass(RAMP_UP);
        }
        assert_eq!(bench.forbidden(), ["HFXO", "HFXO"]);
        bench.set(HFXO, 1);
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.set(HFXO, 0);
        assert_eq!(bench.forbidden(), ["HFXO"]);
    }

    #[test]
    fn wrong_states_are_told() {
        let mut bench = bench();
        bench.task(2);
        bench.task(11);
        bench.task(3);
        bench.task(1);
        bench.task(0);
        assert_eq!(
            bench.forbidden(),
            ["TASKS_START", "TASKS_CCASTART", "TASKS_STOP", "TASKS_TXEN"]
        );
        bench.pass(RAMP_UP);
        bench.task(3);
        bench.task(2);
        bench.task(0);
        assert_eq!(bench.forbidden(), ["TASKS_TXEN"]);
    }
}
