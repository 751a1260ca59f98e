//! UARTE: a serial line whose bytes go to memory and come from it by themselves.

use std::{collections::VecDeque, fmt, ops::Range};

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, SHORTS, Wires};

const ERRORSRC: u16 = 0x480;
const ENABLE: u16 = 0x500;
const PSEL_RTS: u16 = 0x508;
const PSEL_TXD: u16 = 0x50c;
const PSEL_CTS: u16 = 0x510;
const PSEL_RXD: u16 = 0x514;
const BAUDRATE: u16 = 0x524;
const RX_PTR: u16 = 0x534;
const RX_MAX: u16 = 0x538;
const RX_AMOUNT: u16 = 0x53c;
const TX_PTR: u16 = 0x544;
const TX_MAX: u16 = 0x548;
const TX_AMOUNT: u16 = 0x54c;
const CONFIG: u16 = 0x56c;

/// After a reset: no pins, 250 kbit/s.
pub(crate) const RESET: [(u16, u32); 5] = [
    (BAUDRATE, 0x0400_0000),
    (PSEL_RTS, u32::MAX),
    (PSEL_TXD, u32::MAX),
    (PSEL_CTS, u32::MAX),
    (PSEL_RXD, u32::MAX),
];

const RXDRDY: u16 = 2;
const ENDRX: u16 = 4;
const TXDRDY: u16 = 7;
const ENDTX: u16 = 8;
const ERROR: u16 = 9;
const RXTO: u16 = 17;
const RXSTARTED: u16 = 19;
const TXSTARTED: u16 = 20;
const TXSTOPPED: u16 = 22;

/// Bytes that wait where there is no buffer (Product Specification, "UARTE", reception).
const FIFO: usize = 4;
/// In ERRORSRC, the only cause that is modelled.
const OVERRUN: u32 = 1;

/// Device at the other end of the line.
pub trait Peer: fmt::Debug + Send {
    /// A byte has arrived at an instant.
    fn receive(&mut self, byte: u8, at: u64);
    /// A byte that has been sent by now.
    fn transmit(&mut self, now: u64) -> Option<u8>;
    /// Time when it will have sent the next one, as far as it knows.
    fn next(&self) -> Option<u64>;
    /// Gives it, from outside, a byte that it will have sent at an instant.
    fn give(&mut self, _byte: u8, _at: u64) {}
}

/// A line to a device elsewhere.
#[derive(Debug, Default)]
pub struct Wire(VecDeque<(u64, u8)>);

impl Peer for Wire {
    fn receive(&mut self, _: u8, _: u64) {}

    fn transmit(&mut self, now: u64) -> Option<u8> {
        let (_, byte) = self.0.pop_front_if(|(at, _)| *at <= now)?;
        Some(byte)
    }

    fn next(&self) -> Option<u64> {
        self.0.front().map(|(at, _)| *at)
    }

    fn give(&mut self, byte: u8, at: u64) {
        self.0.push_back((at, byte));
    }
}

/// Bytes of a buffer in memory.
#[derive(Clone, Copy, Debug)]
struct Buffer {
    pointer: u32,
    max: u32,
    done: u32,
}

/// Eight bits, no parity, one stop bit, without flow control.
#[derive(Debug, Default)]
pub struct Uarte {
    /// Bytes that were sent, and the times.
    pub sent: Vec<(u64, u8)>,
    /// Buffers whose bytes it begins to send, and the times, to be taken: their carrier to others knows of them
    /// before they are out.
    pub begun: Vec<(u64, Vec<u8>)>,
    /// Times from which on it transfers over which wires, to be taken.
    pub wired: Vec<(u64, Wires)>,
    /// The last of them.
    wires: Option<Wires>,
    /// Bytes that came while there was no room.
    pub overruns: u64,
    /// Times from begin to end during which there is no room, whatever the program does: memory is too slow.
    pub full: Option<Range<u64>>,
    /// Time for which bytes were on the line, nanoseconds: both directions together.
    pub transferred: u64,
    /// Time for which receiver or transmitter were started until both had last stopped, and the time since which one
    /// of them is.
    started: u64,
    since: u64,
    /// Value that ERRORSRC shows.
    errors: u32,
    peer: Option<Box<dyn Peer>>,
    tx: Option<(Buffer, EventId)>,
    /// Bytes of the buffer that is sent.
    out: Vec<u8>,
    rx: Option<Buffer>,
    /// The receiver runs, with a buffer or without; the event at which it has stopped.
    is_on: bool,
    stopping: Option<EventId>,
    /// The transmitter was started, and not stopped since.
    is_ready: bool,
    /// Pin over which it last began to send, and true until it was disabled since.
    output: Option<u32>,
    is_driven: bool,
    fifo: VecDeque<u8>,
    next: Option<EventId>,
}

impl Uarte {
    /// A line to this peer.
    pub fn new(peer: Option<Box<dyn Peer>>) -> Self {
        Self {
            peer,
            ..Self::default()
        }
    }

    /// The peer is [given](Peer::give) a byte. One that has come to a receiver that is off is not heard.
    pub(crate) fn deliver(&mut self, byte: u8, at: u64, call: &mut Call<'_, '_>) {
        if let Some(peer) = &mut self.peer {
            peer.give(byte, at);
            self.plan(call);
        }
    }

    /// Ten bits; the rate is the register's share of 16 MHz (Product Specification, "UARTE", BAUDRATE).
    fn byte_time(call: &Call<'_, '_>) -> u64 {
        let share = u128::from(call.get(BAUDRATE).max(1));
        (10_000_000_000_u128 * (1 << 32) / (share * 16_000_000)) as u64
    }

    /// A transfer begins that needs this pin.
    fn connect(&mut self, pin: u16, call: &mut Call<'_, '_>) {
        if call.get(pin) >= Wires::NOT_CONNECTED {
            call.forbid(
                "PSEL",
                "a transfer over a pin that is not connected (\"UARTE\")",
            );
        }
        if call.get(CONFIG) != 0 {
            call.forbid(
                "CONFIG",
                "parity, flow control and a second stop bit are not modelled",
            );
        }
        let rate = (u64::from(call.get(BAUDRATE)) * 16_000_000) >> 32;
        if pin == PSEL_TXD {
            self.output = Some(call.get(pin));
            self.is_driven = true;
        }
        let wires = Wires {
            pins: [PSEL_TXD, PSEL_RXD].map(|pin| call.get(pin)),
            rate: rate as u32,
        };
        if self.wires.replace(wires) != Some(wires) {
            self.wired.push((call.now(), wires));
        }
    }

    /// Starts the receiver; bytes from before were not heard.
    fn switch_on(&mut self, call: &mut Call<'_, '_>) {
        self.stopping = None;
        if !self.is_on {
            let now = call.now();
            self.count(now);
            self.is_on = true;
            while { self.peer.as_mut() }.is_some_and(|peer| peer.transmit(now).is_some()) {}
        }
        self.plan(call);
    }

    /// Stops receiver and transmitter.
    pub(crate) fn switch_off(&mut self, now: u64) {
        self.count(now);
        self.is_on = false;
        self.is_ready = false;
        self.stopping = None;
        self.next = None;
    }

    /// Time until now for which it needed the high-frequency clock, nanoseconds: receiver or transmitter were started
    /// and had not stopped. Each "consumes the least amount of energy" before it is started, and after `RXTO` or
    /// `TXSTOPPED` (Product Specification, "UARTE", transmission and reception).
    pub fn started_until(&self, now: u64) -> u64 {
        let running = match self.is_started() {
            true => now.saturating_sub(self.since),
            false => 0,
        };
        self.started + running
    }

    /// Pin over which it has sent and that it does not drive any more.
    pub(crate) fn left(&self) -> Option<u32> {
        self.output.filter(|_| !self.is_driven)
    }

    fn is_started(&self) -> bool {
        self.is_on || self.is_ready
    }

    /// Counts the time until now, before one of them starts or stops.
    fn count(&mut self, now: u64) {
        self.started = self.started_until(now);
        self.since = now;
    }

    fn plan(&mut self, call: &mut Call<'_, '_>) {
        let peer = self.peer.as_ref().filter(|_| self.is_on);
        let next = peer.and_then(|peer| peer.next());
        let now = call.now();
        self.next = next.map(|next| call.at(next.max(now + 1)));
    }

    fn drain(&mut self, call: &mut Call<'_, '_>) {
        while let Some(mut buffer) = self.rx
            && let Some(byte) = self.fifo.pop_front()
        {
            let at = u64::from(buffer.pointer) + u64::from(buffer.done);
            call.context.write_to(at, Width::W8, byte.into(), DONE);
            buffer.done += 1;
            self.rx = Some(buffer);
            call.event(RXDRDY);
            if buffer.done == buffer.max {
                self.end_reception(call);
            }
        }
    }

    fn end_reception(&mut self, call: &mut Call<'_, '_>) {
        if let Some(buffer) = self.rx.take() {
            call.set(RX_AMOUNT, buffer.done);
            call.event(ENDRX);
        }
    }

    /// All bytes of a buffer are read when the first one goes out.
    fn begin(&mut self, pointer: u32, max: u32, call: &mut Call<'_, '_>) {
        self.out.clear();
        for byte in 0..u64::from(max) {
            let at = u64::from(pointer) + byte;
            call.context.read_from(at, Width::W8, READ);
        }
        let done = 0;
        self.send(Buffer { pointer, max, done }, call);
    }

    /// The next byte of a buffer goes out.
    fn send(&mut self, buffer: Buffer, call: &mut Call<'_, '_>) {
        let time = Self::byte_time(call);
        let id = call.after(time);
        self.tx = Some((buffer, id));
    }

    fn end_transmission(&mut self, amount: u32, call: &mut Call<'_, '_>) {
        call.set(TX_AMOUNT, amount);
        call.event(ENDTX);
    }
}

impl Model for Uarte {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        if call.get(ENABLE) != 8 {
            call.forbid("ENABLE", "a task while it is not enabled (\"UARTE\")");
            return;
        }
        // A transfer under way goes on.
        if number == 0 && self.rx.is_some() || number == 2 && self.tx.is_some() {
            call.forbid(
                "TASKS_START",
                "it is started before the buffer before is over (\"UARTE\")",
            );
            return;
        }
        match number {
            0 => {
                let (pointer, max) = (call.get(RX_PTR), call.get(RX_MAX));
                self.connect(PSEL_RXD, call);
                call.event(RXSTARTED);
                self.switch_on(call);
                if call.reaches(pointer, max) {
                    self.rx = Some(Buffer {
                        pointer,
                        max,
                        done: 0,
                    });
                    self.drain(call);
                }
            }
            // It goes on for the time of as many bytes as the FIFO has room for ("UARTE", reception).
            1 if self.is_on => {
                let time = Self::byte_time(call) * FIFO as u64;
                self.stopping = Some(call.after(time));
            }
            1 => call.event(RXTO),
            2 => {
                let (pointer, max) = (call.get(TX_PTR), call.get(TX_MAX));
                self.connect(PSEL_TXD, call);
                self.count(call.now());
                self.is_ready = true;
                call.event(TXSTARTED);
                if max == 0 {
                    self.end_transmission(0, call);
                } else if call.reaches(pointer, max) {
                    self.begin(pointer, max, call);
                }
            }
            3 => {
                if let Some((buffer, _)) = self.tx.take() {
                    self.end_transmission(buffer.done, call);
                }
                self.count(call.now());
                self.is_ready = false;
                call.event(TXSTOPPED);
            }
            11 => {
                // Bytes that wait go to the buffer that is set up.
                let (pointer, max) = (call.get(RX_PTR), call.get(RX_MAX));
                if call.reaches(pointer, max) {
                    self.rx = Some(Buffer {
                        pointer,
                        max,
                        done: 0,
                    });
                    self.drain(call);
                    self.end_reception(call);
                }
            }
            _ => call.no_task(),
        }
    }

    fn answer(&mut self, _: u64, value: u32, call: &mut Call<'_, '_>) {
        self.out.push(value as u8);
        let is_whole =
            { self.tx.as_ref() }.is_some_and(|(buffer, _)| self.out.len() == buffer.max as usize);
        if is_whole {
            self.begun.push((call.now(), self.out.clone()));
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        let now = call.now();
        if self.stopping == Some(id) {
            self.count(now);
            self.stopping = None;
            self.is_on = false;
            self.next = None;
            self.end_reception(call);
            call.event(RXTO);
        }
        if let Some((mut buffer, _)) = self.tx.take_if(|(_, mine)| *mine == id) {
            let byte = self.out.get(buffer.done as usize).copied().unwrap_or(0);
            self.sent.push((now, byte));
            self.transferred += Self::byte_time(call);
            if let Some(peer) = &mut self.peer {
                peer.receive(byte, now);
                self.plan(call);
            }
            call.event(TXDRDY);
            buffer.done += 1;
            if buffer.done == buffer.max {
                self.end_transmission(buffer.done, call);
            } else {
                self.send(buffer, call);
            }
        }
        if self.next == Some(id) {
            self.next = None;
            while let Some(byte) = self.peer.as_mut().and_then(|peer| peer.transmit(now)) {
                self.transferred += Self::byte_time(call);
                let has_room = !self.full.as_ref().is_some_and(|full| full.contains(&now));
                if has_room && self.fifo.len() < FIFO {
                    self.fifo.push_back(byte);
                } else {
                    self.overruns += 1;
                    self.errors |= OVERRUN;
                    call.set(ERRORSRC, self.errors);
                    call.event(ERROR);
                }
                self.drain(call);
            }
            self.plan(call);
        }
    }

    fn shortcut(&mut self, event: u16, call: &mut Call<'_, '_>) {
        let shorts = call.get(SHORTS);
        if event == ENDRX && shorts & 1 << 5 != 0 {
            self.task(0, call);
        }
        if event == ENDRX && shorts & 1 << 6 != 0 {
            self.task(1, call);
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        call.only_shortcuts(offset, value, 1 << 5 | 1 << 6);
        if offset == ERRORSRC {
            // Cleared by ones.
            self.errors &= !value;
            call.set(ERRORSRC, self.errors);
        }
        // A UARTE that is switched off keeps nothing, as chips do. One that is switched off before it has stopped may
        // go on to draw current.
        if offset == ENABLE && value != 8 {
            if self.is_started() {
                call.forbid(
                    "ENABLE",
                    "it is disabled before RXTO and TXSTOPPED (\"UARTE\", low power)",
                );
            }
            self.switch_off(call.now());
            Model::reset(self);
        }
    }

    fn reset(&mut self) {
        self.tx = None;
        self.rx = None;
        self.is_on = false;
        self.stopping = None;
        self.is_ready = false;
        self.is_driven = false;
        self.next = None;
        self.fifo.clear();
        self.errors = 0;
        self.wires = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    /// Sends the bytes that it hears, a millisecond later.
    #[derive(Debug, Default)]
    struct Echo(VecDeque<(u64, u8)>);

    impl Peer for Echo {
        fn receive(&mut self, byte: u8, at: u64) {
            self.0.push_back((at + 1_000_000, byte));
        }

        fn transmit(&mut self, now: u64) -> Option<u8> {
            let first = self.0.front().filter(|(at, _)| *at <= now);
            first.is_some().then(|| self.0.pop_front().unwrap().1)
        }

        fn next(&self) -> Option<u64> {
            self.0.front().map(|(at, _)| *at)
        }
    }

    const BUFFER: u32 = 0x2000_0100;

    fn bench() -> Bench<Uarte> {
        let mut bench = Bench::new(Uarte::new(Some(Box::new(Echo::default()))));
        bench.set(ENABLE, 8);
        // 38,400 baud, as the specification tables it.
        bench.set(BAUDRATE, 0x009d_0000);
        for (at, byte) in (u64::from(BUFFER)..).zip(*b"hello, all") {
            bench.cells.0.insert(at, byte);
        }
        bench.set(TX_PTR, BUFFER);
        bench.set(TX_MAX, 10);
        bench
    }

    #[test]
    fn bytes_take_their_time_and_come_back() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 10);
        bench.task(0);
        bench.task(2);
        // 10 bytes of 10 bits at 38,339 baud.
        bench.pass(2_600_000);
        assert!(!bench.took(ENDTX));
        bench.pass(20_000);
        assert!(bench.took(ENDTX));
        assert_eq!(bench.get(TX_AMOUNT), 10);
        assert!(!bench.took(ENDRX));
        bench.pass(1_000_000);
        assert!(bench.took(ENDRX));
        assert_eq!(bench.get(RX_AMOUNT), 10);
        let heard = (0x2000_0200..0x2000_020a).map(|at| bench.cells.0[&at]);
        assert_eq!(heard.collect::<Vec<_>>(), b"hello, all");
    }

    /// Each time that they are other ones.
    #[test]
    fn wires_are_told() {
        let mut bench = bench();
        bench.set(PSEL_TXD, 34);
        bench.set(PSEL_RXD, 33);
        bench.task(0);
        bench.task(2);
        bench.pass(5_000_000);
        bench.set(BAUDRATE, 0x01d6_0000);
        bench.task(2);
        // 38,400 and 115,200 baud, as near as the chip comes.
        let wires = |rate| Wires {
            pins: [34, 33],
            rate,
        };
        let told = std::mem::take(&mut bench.chip.model.model.wired);
        assert_eq!(told, [(0, wires(38_330)), (5_000_000, wires(114_746))]);
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.pass(5_000_000);
        bench.task(1);
        bench.pass(2_000_000);
        bench.set(PSEL_TXD, u32::MAX);
        bench.task(2);
        bench.set(CONFIG, 1);
        bench.task(0);
        assert_eq!(bench.forbidden(), ["PSEL", "CONFIG"]);
    }

    #[test]
    fn without_a_buffer_bytes_are_lost() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 1);
        bench.task(0);
        bench.task(2);
        bench.pass(5_000_000);
        assert!(bench.took(ENDRX) && bench.took(ERROR));
        assert_eq!(bench.chip.model.model.overruns, 9 - FIFO as u64);
        // A cause is forgotten where a one is written, and never made.
        for (written, left) in [(0, OVERRUN), (OVERRUN, 0), (0, 0)] {
            bench.set(ERRORSRC, written);
            assert_eq!(bench.get(ERRORSRC), left);
        }
        // Bytes that waited come first.
        bench.set(RX_MAX, 4);
        bench.task(0);
        assert!(bench.took(ENDRX));
        let heard = (0x2000_0200..0x2000_0204).map(|at| bench.cells.0[&at]);
        assert_eq!(heard.collect::<Vec<_>>(), b"ello");
    }

    /// `TASKS_FLUSHRX` is at 0x02c.
    #[test]
    fn what_waits_is_flushed() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 1);
        bench.task(0);
        bench.task(2);
        bench.pass(5_000_000);
        bench.task(1);
        bench.pass(2_000_000);
        assert!(bench.took(ENDRX) && bench.took(RXTO));
        bench.set(RX_MAX, 10);
        bench.set(0x02c, 1);
        assert!(bench.took(ENDRX));
        assert_eq!(bench.get(RX_AMOUNT), FIFO as u32);
        assert_eq!(bench.cells.0[&0x2000_0200], b'e');
    }

    #[test]
    fn what_is_switched_off_keeps_nothing() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 1);
        bench.task(0);
        bench.task(2);
        bench.pass(5_000_000);
        bench.task(1);
        bench.task(3);
        bench.pass(2_000_000);
        assert_eq!(bench.chip.model.model.left(), None);
        bench.set(ENABLE, 0);
        assert_eq!(bench.forbidden(), [""; 0]);
        assert_eq!(bench.chip.model.model.left(), Some(bench.get(PSEL_TXD)));
        bench.set(ENABLE, 8);
        assert!(bench.took(ENDRX));
        bench.task(0);
        bench.pass(5_000_000);
        assert!(!bench.took(ENDRX));
    }

    #[test]
    fn a_receiver_that_is_off_hears_nothing() {
        let mut bench = bench();
        bench.task(2);
        bench.pass(5_000_000);
        assert!(!bench.took(ERROR));
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 1);
        bench.task(0);
        bench.pass(5_000_000);
        assert!(!bench.took(RXDRDY));
        bench.task(2);
        bench.pass(5_000_000);
        assert!(bench.took(RXDRDY));
        assert_eq!(bench.cells.0[&0x2000_0200], b'h');
    }

    /// Receiver and transmitter draw current until each was stopped: ENDTX and ENDRX do not stop them.
    #[test]
    fn its_time_is_counted() {
        let mut bench = bench();
        let started = |bench: &Bench<Uarte>| bench.chip.model.model.started_until(bench.now);
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 10);
        bench.pass(1_000_000);
        assert_eq!(started(&bench), 0);
        bench.task(0);
        bench.task(2);
        bench.pass(5_000_000);
        // Ten bytes out and as many in, at 38,339 baud.
        assert_eq!(bench.chip.model.model.transferred / 20_000, 260);
        bench.task(1);
        // Four bytes at that rate.
        bench.pass(1_043_000);
        assert!(!bench.took(RXTO));
        bench.pass(1_000);
        assert!(bench.took(RXTO));
        bench.pass(3_956_000);
        assert_eq!(started(&bench), 10_000_000);
        bench.set(ENABLE, 0);
        assert_eq!(bench.forbidden(), ["ENABLE"]);
        bench.set(ENABLE, 8);
        bench.task(2);
        bench.pass(5_000_000);
        bench.task(3);
        assert!(bench.took(TXSTOPPED));
        bench.pass(5_000_000);
        assert_eq!(started(&bench), 15_000_000);
    }

    /// Bytes that were under way when the receiver was stopped are received.
    #[test]
    fn a_receiver_stops_late() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 10);
        bench.task(0);
        bench.task(2);
        // The first byte was sent after 0.26 ms, and comes back a millisecond later.
        bench.pass(1_200_000);
        bench.task(1);
        bench.pass(5_000_000);
        assert!(bench.took(ENDRX) && bench.took(RXTO));
        assert_eq!(bench.get(RX_AMOUNT), 4);
        // It hears nothing before it is started again.
        assert!(!bench.took(ERROR));
    }

    #[test]
    fn a_buffer_is_told_when_it_begins() {
        let mut bench = bench();
        bench.pass(7);
        bench.task(2);
        let begun = std::mem::take(&mut bench.chip.model.model.begun);
        assert_eq!(begun, [(7, b"hello, all".to_vec())]);
        bench.pass(5_000_000);
        let sent = &bench.chip.model.model.sent;
        assert_eq!(
            sent.iter().map(|(_, byte)| *byte).collect::<Vec<_>>(),
            b"hello, all"
        );
    }

    #[test]
    fn what_is_under_way_goes_on() {
        let mut bench = bench();
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 10);
        for task in [0, 2] {
            bench.task(task);
            assert_eq!(bench.forbidden(), [""; 0]);
            bench.task(task);
            assert_eq!(bench.forbidden(), ["TASKS_START"]);
        }
        bench.pass(5_000_000);
        assert_eq!(bench.chip.model.model.sent.len(), 10);
        assert!(bench.took(ENDRX));
        for task in [0, 2] {
            bench.task(task);
        }
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.task(5);
        bench.set(SHORTS, 1 << 7);
        assert_eq!(bench.forbidden(), ["TASKS", "SHORTS"]);
    }

    #[test]
    fn flash_is_out_of_its_reach() {
        let mut bench = bench();
        bench.set(TX_PTR, 0x1000);
        bench.task(2);
        bench.set(TX_PTR, 0x2003_fffc);
        bench.task(2);
        bench.task(3);
        bench.set(ENABLE, 0);
        bench.task(2);
        assert_eq!(bench.forbidden(), ["PTR", "PTR", "ENABLE"]);
        bench.pass(5_000_000);
        assert!(bench.chip.model.model.sent.is_empty());
    }
}
