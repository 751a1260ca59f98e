//! USBD: the device at the USB plug, and the bus to a PC.
//!
//! Of the bus only control and bulk transfers are modelled, a packet at a time, and no suspension.

mod pc;

use rigless::{soc::Width, time::EventId};

pub use self::pc::{Names, Pc};
use self::pc::{RECOVERS, RESETS, Request, SET_ADDRESS, SETTLES};
use super::{Call, DONE, Model, READ, SHORTS, US};

const EVENTCAUSE: u16 = 0x400;
const EPDATASTATUS: u16 = 0x46c;
const USBADDR: u16 = 0x470;
/// BMREQUESTTYPE, and the seven registers behind it.
const SETUP: u16 = 0x480;
/// SIZE.EPOUT.
const SIZE: u16 = 0x4a0;
const ENABLE: u16 = 0x500;
const USBPULLUP: u16 = 0x504;
const EPINEN: u16 = 0x510;
const EPOUTEN: u16 = 0x514;
/// PTR, MAXCNT and AMOUNT of the first endpoint, and the distance to those of the next one.
const IN: u16 = 0x600;
const OUT: u16 = 0x700;
const MAX: u16 = 4;
const AMOUNT: u16 = 8;
const NEXT: u16 = 0x14;

/// Endpoint 0 is enabled after a reset.
pub(crate) const RESET: [(u16, u32); 2] = [(EPINEN, 1), (EPOUTEN, 1)];

const USBRESET: u16 = 0;
const STARTED: u16 = 1;
const ENDEPIN: u16 = 2;
const EP0DATADONE: u16 = 10;
const ENDEPOUT: u16 = 12;
const USBEVENT: u16 = 22;
const EP0SETUP: u16 = 23;
const EPDATA: u16 = 24;
/// EVENTCAUSE: it is ready.
const READY: u32 = 1 << 11;

const STARTEPIN: u16 = 1;
const STARTEPOUT: u16 = 10;
const EP0RCVOUT: u16 = 19;
const EP0STATUS: u16 = 20;
const EP0STALL: u16 = 21;
/// Bits of SHORTS, causes and tasks (Product Specification, "USBD").
const SHORTCUTS: [(u16, u16, u16); 3] = [
    (2, EP0DATADONE, EP0STATUS),
    (3, ENDEPOUT, EP0STATUS),
    (4, ENDEPOUT, EP0RCVOUT),
];

const ENDPOINTS: usize = 8;
/// Bytes of a packet of endpoint 0, and of the longest one.
const PACKET: usize = 64;
/// It is ready so long after it was enabled.
const STARTS: u64 = 20 * US;
/// A full packet and its acknowledgement take so long on the bus, and about as long until the PC sends the next.
const FRAME: u64 = 100 * US;
/// EasyDMA, 64 bytes.
const COPIES: u64 = 5 * US;

/// State of a control transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The device sends.
    In,
    /// The PC sends.
    Out,
    /// The device is to end it.
    Status,
}

#[derive(Debug)]
struct Transfer {
    request: Request,
    stage: Stage,
    /// Bytes that the device sent, or took.
    data: Vec<u8>,
}

/// A packet between memory and an endpoint.
#[derive(Clone, Copy, Debug)]
struct Copy {
    id: EventId,
    endpoint: u16,
    to_pc: bool,
}

/// The device, with a PC or with none.
#[derive(Debug, Default)]
pub struct Usbd {
    pc: Option<Pc>,
    /// Bytes to the PC, and the times.
    pub sent: Vec<(u64, u8)>,
    starts: Option<EventId>,
    /// The next step of the bus, and its time.
    bus: Option<(EventId, u64)>,
    /// A reset is next.
    is_to_reset: bool,
    is_attached: bool,
    transfer: Option<Transfer>,
    copy: Option<Copy>,
    /// Bytes that are copied.
    bytes: Vec<u8>,
    /// Packets for the PC, by endpoints.
    to_pc: [Option<Vec<u8>>; ENDPOINTS],
    /// Packets from it.
    from_pc: [Option<Vec<u8>>; ENDPOINTS],
    /// The endpoint takes a packet.
    takes: [bool; ENDPOINTS],
    cause: u32,
    data: u32,
}

impl Usbd {
    /// A plug with this PC.
    pub fn new(pc: Option<Pc>) -> Self {
        Self {
            pc,
            ..Self::default()
        }
    }

    /// The PC.
    pub fn pc(&self) -> Option<&Pc> {
        self.pc.as_ref()
    }

    /// The bus does its next step so many nanoseconds from now, unless it is going to do one before.
    fn wake(&mut self, after: u64, call: &mut Call<'_, '_>) {
        let at = call.now() + after;
        if self.is_attached && self.bus.is_none_or(|(_, next)| at < next) {
            self.bus = Some((call.at(at), at));
        }
    }

    /// Something has come over an endpoint.
    fn happened(&mut self, bit: usize, call: &mut Call<'_, '_>) {
        self.data |= 1 << bit;
        call.event(EPDATA);
    }

    /// The transfer under way ends.
    fn end(&mut self, is_refused: bool, call: &mut Call<'_, '_>) {
        let Some(Transfer { data, request, .. }) = self.transfer.take() else {
            return;
        };
        let answer = (!is_refused).then_some(&data[..]);
        let told = { self.pc.as_mut() }.map(|pc| pc.on_answer(answer));
        if let Some(Err(what)) = told {
            call.forbid("EP0", what);
        }
        let [_, name, ..] = request.setup;
        self.wake(if name == SET_ADDRESS { RECOVERS } else { FRAME }, call);
    }

    /// A step of the bus.
    fn step(&mut self, call: &mut Call<'_, '_>) {
        let now = call.now();
        let Some(pc) = &mut self.pc else { return };
        if core::mem::take(&mut self.is_to_reset) {
            pc.begin();
            self.transfer = None;
            self.to_pc = Default::default();
            self.from_pc = Default::default();
            self.takes = Default::default();
            call.set(USBADDR, 0);
            call.event(USBRESET);
            self.wake(RESETS, call);
            return;
        }
        if self.transfer.is_some() {
            self.go_on(call);
            return;
        }
        match pc.request(now) {
            Err(later) => self.wake(later - now, call),
            Ok(Some(request)) => self.ask(request, call),
            Ok(None) => self.data(call),
        }
    }

    /// The PC begins a control transfer.
    fn ask(&mut self, request: Request, call: &mut Call<'_, '_>) {
        for (register, byte) in (SETUP..).step_by(4).zip(request.setup) {
            call.set(register, byte.into());
        }
        self.to_pc[0] = None;
        self.takes[0] = false;
        let stage = match (request.asked(), request.out.is_empty()) {
            (1.., _) => Stage::In,
            (0, false) => Stage::Out,
            _ => Stage::Status,
        };
        let [_, name, address, ..] = request.setup;
        let transfer = Transfer {
            request,
            stage,
            data: Vec::new(),
        };
        self.transfer = Some(transfer);
        call.event(EP0SETUP);
        // It does that by itself, and the program hears of it only.
        if name == SET_ADDRESS {
            call.set(USBADDR, address.into());
            self.end(false, call);
        }
    }

    /// The next packet of a control transfer, if the device is ready for it.
    fn go_on(&mut self, call: &mut Call<'_, '_>) {
        let Some(transfer) = &mut self.transfer else {
            return;
        };
        match transfer.stage {
            Stage::In => {
                if let Some(packet) = self.to_pc[0].take() {
                    transfer.data.extend(&packet);
                    let asked = transfer.request.asked();
                    if transfer.data.len() > asked {
                        call.forbid("EPIN[0].MAXCNT", "more is sent than was asked for");
                    }
                    if packet.len() < PACKET || transfer.data.len() >= asked {
                        transfer.stage = Stage::Status;
                    }
                    call.event(EP0DATADONE);
                }
            }
            Stage::Out => {
                if core::mem::take(&mut self.takes[0]) {
                    let from = transfer.data.len();
                    let packet: Vec<u8> = { transfer.request.out.iter().skip(from) }
                        .take(PACKET)
                        .copied()
                        .collect();
                    transfer.data.extend(&packet);
                    if transfer.data.len() == transfer.request.out.len() {
                        transfer.stage = Stage::Status;
                    }
                    call.set(SIZE, packet.len() as u32);
                    self.from_pc[0] = Some(packet);
                    call.event(EP0DATADONE);
                }
            }
            Stage::Status => {}
        }
    }

    /// Packets of the serial port.
    fn data(&mut self, call: &mut Call<'_, '_>) {
        let now = call.now();
        let Some(pc) = &mut self.pc else { return };
        let Some(port) = pc.port() else { return };
        let [(to, _), (from, _)] = [port.to_pc, port.from_pc];
        let mut bits = Vec::new();
        let mut again = None;
        if self.to_pc[usize::from(to)].is_some() {
            match pc.reads(now) {
                Ok(()) => {
                    let packet = self.to_pc[usize::from(to)].take().unwrap_or_default();
                    pc.on_packet(&packet, now);
                    self.sent.extend(packet.iter().map(|&byte| (now, byte)));
                    bits.push(usize::from(to));
                }
                Err(until) => again = Some(until - now),
            }
        }
        let is_enabled = call.get(EPOUTEN) >> from & 1 != 0;
        if is_enabled && self.takes[usize::from(from)] {
            let packet = pc.packet(now);
            if !packet.is_empty() {
                self.takes[usize::from(from)] = false;
                call.set(SIZE + 4 * u16::from(from), packet.len() as u32);
                self.from_pc[usize::from(from)] = Some(packet);
                bits.push(16 + usize::from(from));
            }
        }
        let byte = pc.next_byte().filter(|_| self.takes[usize::from(from)]);
        let byte = byte.map(|at| at.saturating_sub(now).max(FRAME));
        for &bit in &bits {
            self.happened(bit, call);
        }
        if let Some(after) = again.into_iter().chain(byte).min() {
            self.wake(after, call);
        }
    }

    /// Returns true if nothing else is copied.
    fn may_copy(&self, endpoint: u16, enabled: u16, call: &mut Call<'_, '_>) -> bool {
        if self.copy.is_some() {
            call.forbid("TASKS_STARTEP", "two packets are copied at once (\"USBD\")");
            return false;
        }
        if call.get(enabled) >> endpoint & 1 == 0 {
            call.forbid("TASKS_STARTEP", "the endpoint is not enabled (\"USBD\")");
            return false;
        }
        true
    }

    fn start_in(&mut self, endpoint: u16, call: &mut Call<'_, '_>) {
        let at = IN + NEXT * endpoint;
        let (pointer, max) = (call.get(at), call.get(at + MAX));
        if !self.may_copy(endpoint, EPINEN, call) || !call.reaches(pointer, max) {
            return;
        }
        if self.to_pc[usize::from(endpoint)].is_some() {
            call.forbid("TASKS_STARTEPIN", "the packet before is not out (\"USBD\")");
        }
        if max > PACKET as u32 {
            call.forbid("EPIN.MAXCNT", "a packet has 64 bytes at most (\"USBD\")");
        }
        self.bytes.clear();
        for byte in 0..u64::from(max) {
            let at = u64::from(pointer) + byte;
            call.context.read_from(at, Width::W8, READ);
        }
        call.set(at + AMOUNT, max);
        self.copy = Some(Copy {
            id: call.after(COPIES),
            endpoint,
            to_pc: true,
        });
        call.event(STARTED);
    }

    fn start_out(&mut self, endpoint: u16, call: &mut Call<'_, '_>) {
        let at = OUT + NEXT * endpoint;
        let (pointer, max) = (call.get(at), call.get(at + MAX));
        if !self.may_copy(endpoint, EPOUTEN, call) || !call.reaches(pointer, max) {
            return;
        }
        let Some(packet) = self.from_pc[usize::from(endpoint)].take() else {
            call.forbid("TASKS_STARTEPOUT", "no packet has come (\"USBD\")");
            return;
        };
        if max as usize != packet.len() {
            call.forbid("EPOUT.MAXCNT", "it is not SIZE.EPOUT (\"USBD\")");
        }
        for (at, &byte) in (u64::from(pointer)..).zip(packet.iter().take(max as usize)) {
            call.context.write_to(at, Width::W8, byte.into(), DONE);
        }
        call.set(at + AMOUNT, max);
        self.copy = Some(Copy {
            id: call.after(COPIES),
            endpoint,
            to_pc: false,
        });
        call.event(STARTED);
    }
}

impl Model for Usbd {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        if call.get(ENABLE) != 1 {
            call.forbid("ENABLE", "a task while it is not enabled (\"USBD\")");
            return;
        }
        match number {
            1..=8 => self.start_in(number - STARTEPIN, call),
            10..=17 => self.start_out(number - STARTEPOUT, call),
            EP0RCVOUT => {
                self.takes[0] = true;
                self.wake(FRAME, call);
            }
            EP0STATUS => {
                let stage = self.transfer.as_ref().map(|transfer| transfer.stage);
                // After an address there is none.
                if stage.is_some_and(|stage| stage != Stage::Status) {
                    call.forbid("TASKS_EP0STATUS", "the data are not complete (\"USBD\")");
                }
                self.end(false, call);
            }
            EP0STALL => self.end(true, call),
            _ => call.no_task(),
        }
    }

    fn answer(&mut self, _: u64, value: u32, _: &mut Call<'_, '_>) {
        self.bytes.push(value as u8);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.starts.take_if(|mine| *mine == id).is_some() {
            self.cause |= READY;
            call.event(USBEVENT);
        } else if self.bus.take_if(|(mine, _)| *mine == id).is_some() {
            self.step(call);
        } else if let Some(copy) = self.copy.take_if(|copy| copy.id == id) {
            let place = usize::from(copy.endpoint);
            if copy.to_pc {
                self.to_pc[place] = Some(core::mem::take(&mut self.bytes));
                call.event(ENDEPIN + copy.endpoint);
            } else {
                // The next packet may come.
                self.takes[place] = place > 0;
                call.event(ENDEPOUT + copy.endpoint);
            }
            self.wake(FRAME, call);
        }
    }

    fn shortcut(&mut self, event: u16, call: &mut Call<'_, '_>) {
        let shorts = call.get(SHORTS);
        for (bit, cause, task) in SHORTCUTS {
            if cause == event && shorts >> bit & 1 != 0 {
                self.task(task, call);
            }
        }
    }

    fn read(&mut self, offset: u16, _: &mut Call<'_, '_>) -> Option<u32> {
        match offset {
            EVENTCAUSE => Some(self.cause),
            EPDATASTATUS => Some(self.data),
            _ => None,
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        let known = { SHORTCUTS.iter() }.fold(0, |known, (bit, ..)| known | 1 << bit);
        call.only_shortcuts(offset, value, known);
        match offset {
            EVENTCAUSE => self.cause &= !value,
            EPDATASTATUS => self.data &= !value,
            ENABLE if value == 1 => self.starts = Some(call.after(STARTS)),
            ENABLE => {
                self.is_attached = false;
                self.bus = None;
            }
            USBPULLUP => {
                let was = core::mem::replace(&mut self.is_attached, value == 1);
                if self.is_attached && !was && self.pc.is_some() {
                    self.bus = None;
                    self.is_to_reset = true;
                    self.wake(SETTLES, call);
                }
            }
            // A write of any value lets the endpoint take its first packet.
            _ if (SIZE + 4..SIZE + 4 * ENDPOINTS as u16).contains(&offset) => {
                let endpoint = usize::from((offset - SIZE) / 4);
                self.takes[endpoint] = self.from_pc[endpoint].is_none();
                self.wake(FRAME, call);
            }
            _ => {}
        }
    }

    fn reset(&mut self) {
        let pc = self.pc.take();
        let sent = core::mem::take(&mut self.sent);
        *self = Self {
            pc,
            sent,
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use std::{
        collections::VecDeque,
        sync::{Arc, Mutex},
    };

    use super::{super::Peer, super::bench::Bench, *};

    const MS: u64 = 1000 * US;
    const BUFFER: u32 = 0x2000_0100;
    /// Endpoints of the port below.
    const TO_PC: u16 = 2;
    const FROM_PC: u16 = 1;
    /// USB 2.0, tables 9-8 to 9-13; USB CDC 1.2, 5.2.3.
    const DEVICE: [u8; 18] = [
        18, 1, 0, 2, 2, 0, 0, 64, 0xc0, 0x16, 0xe1, 0x05, 0, 1, 1, 2, 3, 1,
    ];
    const CONFIGURATION: [u8; 62] = [
        9, 2, 62, 0, 2, 1, 0, 0x80, 50, // configuration
        9, 4, 0, 0, 1, 2, 2, 0, 0, 5, 0x24, 0, 0x10, 1, 4, 0x24, 2, 2, 5, 0x24, 6, 0, 1, 7, 5,
        0x81, 3, 8, 0, 255, // communication
        9, 4, 1, 0, 2, 10, 0, 0, 0, 7, 5, 0x01, 2, 64, 0, 0, 7, 5, 0x82, 2, 64, 0, 0,
    ];

    /// Bytes that a program heard, and those that it is to send.
    #[derive(Clone, Debug, Default)]
    struct Program(Arc<Mutex<(Vec<u8>, VecDeque<u8>)>>);

    impl Peer for Program {
        fn receive(&mut self, byte: u8, _: u64) {
            self.0.lock().unwrap().0.push(byte);
        }

        fn transmit(&mut self, _: u64) -> Option<u8> {
            self.0.lock().unwrap().1.pop_front()
        }

        fn next(&self) -> Option<u64> {
            (!self.0.lock().unwrap().1.is_empty()).then_some(0)
        }
    }

    /// A device that was reset and has its address.
    fn addressed(program: &Program) -> Bench<Usbd> {
        let mut bench = Bench::new(Usbd::new(Some(Pc::new(Box::new(program.clone())))));
        bench.set(EPINEN, 1);
        bench.set(EPOUTEN, 1);
        bench.set(ENABLE, 1);
        bench.pass(STARTS);
        assert!(bench.took(USBEVENT));
        assert_eq!(bench.get(EVENTCAUSE), READY);
        bench.set(EVENTCAUSE, READY);
        bench.set(USBPULLUP, 1);
        bench.pass(SETTLES - 1);
        assert!(!bench.took(USBRESET));
        bench.pass(1);
        assert!(bench.took(USBRESET));
        bench.pass(RESETS);
        assert!(bench.took(EP0SETUP));
        assert_eq!(bench.get(USBADDR), 7);
        bench.pass(RECOVERS);
        bench
    }

    /// Sends a packet from an endpoint.
    fn send(bench: &mut Bench<Usbd>, endpoint: u16, bytes: &[u8]) {
        for (at, &byte) in (u64::from(BUFFER)..).zip(bytes) {
            bench.cells.0.insert(at, byte);
        }
        bench.set(IN + NEXT * endpoint, BUFFER);
        bench.set(IN + NEXT * endpoint + MAX, bytes.len() as u32);
        bench.task(STARTEPIN + endpoint);
        bench.pass(COPIES);
        assert!(bench.took(ENDEPIN + endpoint));
        bench.pass(FRAME);
    }

    /// Reads the packet of an endpoint.
    fn take(bench: &mut Bench<Usbd>, endpoint: u16) -> Vec<u8> {
        let size = bench.get(SIZE + 4 * endpoint);
        bench.set(OUT + NEXT * endpoint, BUFFER);
        bench.set(OUT + NEXT * endpoint + MAX, size);
        bench.task(STARTEPOUT + endpoint);
        bench.pass(COPIES);
        assert!(bench.took(ENDEPOUT + endpoint));
        let at = |byte| bench.cells.0[&(u64::from(BUFFER) + u64::from(byte))];
        (0..size).map(at).collect()
    }

    fn setup(bench: &mut Bench<Usbd>) -> [u8; 8] {
        assert!(bench.took(EP0SETUP));
        [0, 4, 8, 12, 16, 20, 24, 28].map(|at| bench.get(SETUP + at) as u8)
    }

    /// Answers a request with so many of these bytes as were asked for.
    fn answer(bench: &mut Bench<Usbd>, bytes: &[u8]) {
        let [.., low, high] = setup(bench);
        let asked = usize::from(u16::from_le_bytes([low, high]));
        bench.set(SHORTS, 1 << 2);
        send(bench, 0, &bytes[..bytes.len().min(asked)]);
        assert!(bench.took(EP0DATADONE));
        bench.set(SHORTS, 0);
        bench.pass(FRAME);
    }

    fn name(text: &str) -> Vec<u8> {
        let length = 2 + 2 * text.len() as u8;
        let units = text.encode_utf16().flat_map(u16::to_le_bytes);
        [length, 3].into_iter().chain(units).collect()
    }

    /// A device whose port is open.
    fn opened(program: &Program) -> Bench<Usbd> {
        let mut bench = addressed(program);
        answer(&mut bench, &DEVICE);
        answer(&mut bench, &CONFIGURATION);
        answer(&mut bench, &CONFIGURATION);
        for text in ["maker", "thing", "1"] {
            answer(&mut bench, &name(text));
        }
        // SET_CONFIGURATION 1.
        assert_eq!(setup(&mut bench), [0, 9, 1, 0, 0, 0, 0, 0]);
        bench.set(EPINEN, 0b111);
        bench.set(EPOUTEN, 0b11);
        bench.set(SIZE + 4 * FROM_PC, 0);
        bench.task(EP0STATUS);
        bench.pass(FRAME);
        // SET_LINE_CODING.
        assert_eq!(setup(&mut bench), [0x21, 0x20, 0, 0, 0, 0, 7, 0]);
        bench.task(EP0RCVOUT);
        bench.pass(FRAME);
        assert!(bench.took(EP0DATADONE));
        assert_eq!(take(&mut bench, 0), [0, 0xc2, 1, 0, 0, 0, 8]);
        bench.task(EP0STATUS);
        bench.pass(FRAME);
        // GET_STATUS of an endpoint that it has not.
        assert_eq!(setup(&mut bench), [0x82, 0, 0, 0, 0x8a, 0, 2, 0]);
        bench.task(EP0STALL);
        bench.pass(FRAME);
        // SET_CONTROL_LINE_STATE.
        assert_eq!(setup(&mut bench), [0x21, 0x22, 3, 0, 0, 0, 0, 0]);
        bench.task(EP0STATUS);
        bench.pass(FRAME);
        bench
    }

    #[test]
    fn a_pc_asks_and_opens_the_port() {
        let program = Program::default();
        let mut bench = opened(&program);
        let names = bench.chip.model.model.pc().unwrap().names().unwrap();
        assert_eq!(names.numbers, [0x16c0, 0x05e1]);
        assert_eq!(names.texts, ["maker", "thing", "1"]);
        send(&mut bench, TO_PC, b"to you");
        assert_eq!(program.0.lock().unwrap().0, b"to you");
        assert!(bench.took(EPDATA));
        assert_eq!(bench.get(EPDATASTATUS), 1 << TO_PC);
        bench.set(EPDATASTATUS, u32::MAX);
        assert_eq!(bench.get(EPDATASTATUS), 0);
        // The PC has nothing to say before; a longer text takes two packets.
        program.0.lock().unwrap().1.extend([7; 70]);
        bench.set(SIZE + 4 * FROM_PC, 0);
        for length in [64, 6] {
            bench.pass(2 * FRAME);
            assert!(bench.took(EPDATA));
            assert_eq!(bench.get(EPDATASTATUS), 1 << (16 + FROM_PC));
            bench.set(EPDATASTATUS, u32::MAX);
            assert_eq!(take(&mut bench, FROM_PC), vec![7; length]);
        }
        bench.pass(MS);
        assert!(!bench.took(EPDATA));
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    /// The driver of a PC hands bytes on when a packet is not full, or when it has as many as it asked for.
    #[test]
    fn a_full_packet_waits_for_the_next() {
        let program = Program::default();
        let mut bench = opened(&program);
        let heard = || program.0.lock().unwrap().0.len();
        send(&mut bench, TO_PC, &[1; 64]);
        assert_eq!(heard(), 0);
        send(&mut bench, TO_PC, &[1; 64]);
        assert_eq!(heard(), 128);
        send(&mut bench, TO_PC, &[1; 64]);
        send(&mut bench, TO_PC, &[]);
        assert_eq!(heard(), 192);
        send(&mut bench, TO_PC, &[1; 63]);
        assert_eq!(heard(), 255);
    }

    /// A packet for the PC does not wait until the PC has something to say.
    #[test]
    fn a_packet_does_not_wait_for_the_other_way() {
        #[derive(Debug)]
        struct Late(Program);

        impl Peer for Late {
            fn receive(&mut self, byte: u8, at: u64) {
                self.0.receive(byte, at);
            }

            fn transmit(&mut self, _: u64) -> Option<u8> {
                None
            }

            fn next(&self) -> Option<u64> {
                Some(u64::MAX / 2)
            }
        }

        let program = Program::default();
        let mut bench = opened(&program);
        bench.chip.model.model.pc = {
            let pc = bench.chip.model.model.pc.take();
            pc.map(|pc| pc.with_program(Box::new(Late(program.clone()))))
        };
        bench.set(SIZE + 4 * FROM_PC, 0);
        bench.pass(MS);
        send(&mut bench, TO_PC, b"to you");
        assert_eq!(program.0.lock().unwrap().0, b"to you");
    }

    /// A PC whose program does not read takes no packet.
    #[test]
    fn a_program_may_not_read() {
        let program = Program::default();
        let mut bench = opened(&program);
        let until = bench.now + 30 * MS;
        bench
            .chip
            .model
            .model
            .pc
            .as_mut()
            .unwrap()
            .busy_until(until);
        send(&mut bench, TO_PC, b"to you");
        bench.pass(20 * MS);
        assert!(!bench.took(EPDATA));
        bench.pass(20 * MS);
        assert!(bench.took(EPDATA));
        assert_eq!(program.0.lock().unwrap().0, b"to you");
    }

    #[test]
    fn a_device_that_answers_wrongly_is_given_up() {
        let wrong: [(&[u8], &[u8]); 3] = [
            (&[18, 2], &[]),
            (&DEVICE, &[9, 4, 62, 0]),
            // Only the interface for control.
            (&DEVICE, &CONFIGURATION[..39]),
        ];
        for (device, configuration) in wrong {
            let mut bench = addressed(&Program::default());
            answer(&mut bench, device);
            if !configuration.is_empty() {
                let mut configuration = configuration.to_vec();
                configuration[2] = configuration.len() as u8;
                answer(&mut bench, &configuration);
                if configuration[1] == 2 {
                    answer(&mut bench, &configuration);
                }
            }
            assert_eq!(bench.forbidden(), ["EP0"]);
            bench.pass(100 * MS);
            assert!(!bench.took(EP0SETUP));
        }
        let mut bench = addressed(&Program::default());
        bench.task(EP0STALL);
        assert_eq!(bench.forbidden(), ["EP0"]);
    }

    #[test]
    fn forbidden_uses_are_told() {
        let mut bench = Bench::new(Usbd::new(None));
        bench.task(EP0STATUS);
        assert_eq!(bench.forbidden(), ["ENABLE"]);
        let mut bench = opened(&Program::default());
        bench.task(STARTEPIN + 5);
        bench.task(STARTEPOUT + FROM_PC);
        assert_eq!(bench.forbidden(), ["TASKS_STARTEP", "TASKS_STARTEPOUT"]);
        bench.set(IN + NEXT * TO_PC, BUFFER);
        bench.set(IN + NEXT * TO_PC + MAX, 65);
        bench.task(STARTEPIN + TO_PC);
        bench.task(STARTEPIN + TO_PC);
        assert_eq!(bench.forbidden(), ["EPIN.MAXCNT", "TASKS_STARTEP"]);
    }

    /// Without a PC nothing comes.
    #[test]
    fn a_plug_may_be_empty() {
        let mut bench = Bench::new(Usbd::new(None));
        bench.set(ENABLE, 1);
        bench.set(USBPULLUP, 1);
        bench.pass(1000 * MS);
        assert!(bench.took(USBEVENT) && !bench.took(USBRESET));
    }
}
