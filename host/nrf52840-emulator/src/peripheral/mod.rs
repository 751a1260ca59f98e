//! Parts common to the chip's peripherals (Product Specification, "Peripheral interface"), and a model of each.
//!
//! A peripheral is 4 KiB of registers. Tasks are started by a write of 1 to the first of them, events are flags
//! behind those, and an interrupt is pending while an event is set that INTEN enables. A [`Model`] defines its
//! tasks; an [`Instance`] gives it the rest.

pub(crate) mod clock;
mod egu;
mod gpio;
pub(crate) mod gpiote;
mod nvmc;
mod ppi;
pub(crate) mod radio;
mod rng;
pub(crate) mod rtc;
mod stopwatch;
mod temp;
pub(crate) mod timer;
pub(crate) mod twim;
pub(crate) mod uarte;
pub(crate) mod usbd;
pub(crate) mod watchdog;

pub(crate) use self::radio::RAMP_UP;
pub use self::{
    clock::Clock,
    egu::Egu,
    gpio::{Gpio, Held},
    gpiote::Gpiote,
    nvmc::Nvmc,
    ppi::Ppi,
    radio::{AIR_PER_BYTE, Arrival, Frame, HEADER, Radio, crc},
    rng::Rng,
    rtc::Rtc,
    temp::Temp,
    timer::Timer,
    twim::Twim,
    uarte::{Peer, Uarte, Wire},
    usbd::{Names, Pc, Usbd},
    watchdog::Watchdog,
};

use rigless::{
    device::{Device, DeviceContext, Level, RegisterFile, RequestChange},
    soc::{Access, Layout, ReadAction, RegisterSpec, Width, WriteModify},
    time::{EventId, VirtualNanos},
};

/// Wires over which bytes go, and their rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wires {
    /// Numbers of pins, those of the second port from 32 on; [`NOT_CONNECTED`](Self::NOT_CONNECTED) or above: none.
    pub pins: [u32; 2],
    /// Bits per second.
    pub rate: u32,
}

impl Wires {
    /// No pin.
    pub const NOT_CONNECTED: u32 = 1 << 31;
}

/// Nanoseconds of a microsecond.
pub const US: u64 = 1_000;

/// Token of writes to memory; reads have others.
const DONE: u64 = 0;
/// Token of reads, where there is one kind of them.
const READ: u64 = 1;

/// Words of a peripheral.
const WORDS: usize = 1024;

/// Offsets of the events, and of the registers that all have (Product Specification, "Peripheral interface").
const EVENTS: u16 = 0x100;
const SHORTS: u16 = 0x200;
const INTEN: u16 = 0x300;
const INTENSET: u16 = 0x304;
const INTENCLR: u16 = 0x308;

/// The last byte of data RAM, and the first (Product Specification, "Memory map").
const RAM: core::ops::Range<u64> = 0x2000_0000..0x2004_0000;

/// The registers of any peripheral: their purposes are the model's.
pub(crate) static REGISTERS: [RegisterSpec; WORDS] = {
    let plain = RegisterSpec {
        name: "register",
        offset: 0,
        width: Width::W32,
        reset: 0,
        access: Access::ReadWrite,
        read: ReadAction::None,
        write: WriteModify::None,
        fields: &[],
    };
    let mut table = [plain; WORDS];
    let mut word = 0;
    while word < WORDS {
        table[word].offset = (word * 4) as u32;
        word += 1;
    }
    table
};

/// A register by its number, which is a quarter of its offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word(u16);

impl Word {
    /// The register at this offset.
    pub const fn at(offset: u16) -> Self {
        Self(offset / 4)
    }
}

impl Layout for Word {
    const REGISTERS: &'static [RegisterSpec] = &REGISTERS;

    fn from_index(index: usize) -> Option<Self> {
        (index < WORDS).then_some(Self(index as u16))
    }

    fn index(self) -> usize {
        usize::from(self.0)
    }
}

/// Parts that a model reaches while it is called.
pub struct Call<'a, 'b> {
    file: &'a mut RegisterFile,
    context: &'a mut DeviceContext<'b>,
    /// INTEN.
    enabled: u32,
    happened: Vec<u16>,
}

impl Call<'_, '_> {
    /// The register at an offset.
    pub fn get(&self, offset: u16) -> u32 {
        self.file.get(Word::at(offset)) as u32
    }

    /// Sets the register at an offset.
    pub fn set(&mut self, offset: u16, value: u32) {
        self.file.set(Word::at(offset), value.into());
    }

    /// Nanoseconds since power came.
    pub fn now(&self) -> u64 {
        self.context.now().0
    }

    /// Calls the model at an instant.
    pub fn at(&mut self, instant: u64) -> EventId {
        self.context.schedule(VirtualNanos(instant))
    }

    /// Calls the model so many nanoseconds from now.
    pub fn after(&mut self, nanoseconds: u64) -> EventId {
        let instant = self.now().saturating_add(nanoseconds);
        self.at(instant)
    }

    /// An event: its flag is set, other peripherals hear of it, and shortcuts follow.
    pub fn event(&mut self, number: u16) {
        self.set(EVENTS + 4 * number, 1);
        let request = usize::from(number);
        self.context.request(request, Level::High);
        self.context.request(request, Level::Low);
        self.happened.push(number);
    }

    /// An event of which no other peripheral hears.
    fn event_unheard(&mut self, number: u16) {
        self.set(EVENTS + 4 * number, 1);
        self.happened.push(number);
    }

    /// Tells of a use that the specification forbids, by the register it concerns.
    pub fn forbid(&mut self, register: &'static str, what: &'static str) {
        self.context.tell(register, what);
    }

    /// Tells that a task does nothing here.
    fn no_task(&mut self) {
        self.forbid("TASKS", "this task is not modelled");
    }

    /// Tells that a register behind the events, if this is one, does nothing here.
    fn no_register(&mut self, offset: u16) {
        if offset >= SHORTS {
            self.forbid("registers", "this register is not modelled");
        }
    }

    /// Tells of shortcuts that are not among these.
    fn only_shortcuts(&mut self, offset: u16, value: u32, known: u32) {
        if offset == SHORTS && value & !known != 0 {
            self.forbid("SHORTS", "a shortcut that is not modelled");
        }
    }

    /// Returns true if EasyDMA reaches these bytes: data RAM only (Product Specification, "EasyDMA"). Otherwise it
    /// is told.
    fn reaches(&mut self, pointer: u32, length: u32) -> bool {
        let (from, to) = (u64::from(pointer), u64::from(pointer) + u64::from(length));
        let is_ram = length == 0 || RAM.contains(&from) && to <= RAM.end;
        if !is_ram {
            self.forbid("PTR", "EasyDMA reaches data RAM only (\"EasyDMA\")");
        }
        is_ram
    }
}

/// Behaviour of a peripheral.
pub trait Model: core::fmt::Debug {
    /// A task was started.
    fn task(&mut self, _number: u16, _call: &mut Call<'_, '_>) {}
    /// A register behind the events was written, INTEN too.
    fn write(&mut self, _offset: u16, _value: u32, _call: &mut Call<'_, '_>) {}
    /// Value that a register reads as, unless it is what was last put there.
    fn read(&mut self, _offset: u16, _call: &mut Call<'_, '_>) -> Option<u32> {
        None
    }
    /// An event of its own: shortcuts.
    fn shortcut(&mut self, _event: u16, _call: &mut Call<'_, '_>) {}
    /// An instant asked for has come.
    fn due(&mut self, _id: EventId, _call: &mut Call<'_, '_>) {}
    /// A value that was read from memory.
    fn answer(&mut self, _token: u64, _value: u32, _call: &mut Call<'_, '_>) {}
    /// An event of another peripheral.
    fn hear(&mut self, _instance: &str, _event: u16, _call: &mut Call<'_, '_>) {}
    /// The program stored a word to the flash.
    fn store(&mut self, _address: u64, _value: u32, _call: &mut Call<'_, '_>) {}
    /// The chip restarts.
    fn reset(&mut self) {}
}

/// A peripheral of the chip: a model with its interrupt.
#[derive(Debug)]
pub struct Instance<M> {
    /// Its behaviour.
    pub model: M,
    enabled: u32,
    is_pending: bool,
}

impl<M: Model> Instance<M> {
    /// As after power-on.
    pub fn new(model: M) -> Self {
        Self {
            model,
            enabled: 0,
            is_pending: false,
        }
    }

    /// Returns true if its interrupt is pending.
    pub fn is_pending(&self) -> bool {
        self.is_pending
    }

    /// Calls the model; events that happen meanwhile take their shortcuts, and the interrupt follows.
    pub fn call<T>(
        &mut self,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
        work: impl FnOnce(&mut M, &mut Call<'_, '_>) -> T,
    ) -> T {
        let mut call = Call {
            file,
            context,
            enabled: self.enabled,
            happened: Vec::new(),
        };
        let out = work(&mut self.model, &mut call);
        let mut next = 0;
        while let Some(&event) = call.happened.get(next) {
            next += 1;
            self.model.shortcut(event, &mut call);
        }
        self.enabled = call.enabled;
        let is_set = |event: &u16| call.file.get(Word::at(EVENTS + 4 * event)) != 0;
        let mut enabled = (0..32).filter(|event| self.enabled >> event & 1 != 0);
        let is_pending = enabled.any(|event| is_set(&event));
        if is_pending != self.is_pending {
            self.is_pending = is_pending;
            let level = if is_pending { Level::High } else { Level::Low };
            call.context.interrupt(0, level);
        }
        out
    }
}

impl<M: Model> Device for Instance<M> {
    type Register = Word;

    fn read(
        &mut self,
        word: Word,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let offset = word.0 * 4;
        if matches!(offset, INTEN | INTENSET | INTENCLR) {
            return Some(self.enabled.into());
        }
        let value = self.call(file, context, |model, call| model.read(offset, call));
        value.map(u64::from)
    }

    fn write(
        &mut self,
        word: Word,
        value: u64,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let (offset, value) = (word.0 * 4, value as u32);
        self.call(file, context, |model, call| match offset {
            0..EVENTS => {
                call.set(offset, 0);
                if value & 1 != 0 {
                    model.task(offset / 4, call);
                }
            }
            INTEN | INTENSET | INTENCLR => {
                call.enabled = match offset {
                    INTEN => value,
                    INTENSET => call.enabled | value,
                    _ => call.enabled & !value,
                };
                model.write(offset, value, call);
            }
            _ => model.write(offset, value, call),
        });
    }

    fn on_event(&mut self, id: EventId, file: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.call(file, context, |model, call| model.due(id, call));
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if change.level == Level::High {
            let event = change.request as u16;
            self.call(file, context, |model, call| {
                model.hear(change.instance, event, call);
            });
        }
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if token != DONE {
            self.call(file, context, |model, call| {
                model.answer(token, value as u32, call);
            });
        }
    }

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        context.tell("PTR", "nothing answers where EasyDMA went");
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        file: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if width == Width::W32 {
            self.call(file, context, |model, call| {
                model.store(address, value as u32, call);
            });
        } else {
            // Product Specification, "NVMC": only whole words are written.
            context.tell("flash", "only whole words are written (\"NVMC\")");
            context.bus_error();
        }
        true
    }

    fn reset(&mut self) {
        self.enabled = 0;
        self.is_pending = false;
        self.model.reset();
    }
}

#[cfg(test)]
pub(crate) mod bench {
    //! One peripheral alone.

    use rigless::{
        emulator::{Error, Memory},
        mcu::{Operate, Single},
        soc::{Bus, Cpu, Endian, Peripheral, Region},
    };

    use super::*;

    pub(crate) const BASE: u64 = 0x4000_0000;

    static MEMORY: [Region; 2] = [
        Region::flash("flash", 0, 0x2000)
            .erased_to(0xff)
            .programmed_by("it"),
        Region::ram("ram", 0x2000_0000, 0x1000),
    ];

    /// Flash and RAM, by address.
    #[derive(Debug, Default)]
    pub(crate) struct Cells(pub(crate) std::collections::BTreeMap<u64, u8>);

    impl Memory for Cells {
        fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
            let blank = if address < 0x2000 { 0xff } else { 0 };
            let bytes = (address..address + u64::from(width.bytes())).rev();
            Ok(bytes.fold(0, |value, at| {
                value << 8 | u64::from(*self.0.get(&at).unwrap_or(&blank))
            }))
        }

        fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
            for byte in 0..u64::from(width.bytes()) {
                self.0.insert(address + byte, (value >> (8 * byte)) as u8);
            }
            Ok(())
        }

        fn program(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
            self.write(address, width, value)
        }
    }

    #[derive(Debug)]
    pub(crate) struct Bench<M: Model + 'static> {
        pub(crate) chip: Single<Instance<M>>,
        pub(crate) cells: Cells,
        pub(crate) now: u64,
    }

    impl<M: Model + 'static> Bench<M> {
        pub(crate) fn new(model: M) -> Self {
            let it = Peripheral {
                name: "it",
                base: BASE,
                size: 0x1000,
                interrupts: &[0],
                registers: &REGISTERS,
            };
            let cpu = Cpu::new("test", true, 1, Endian::Little);
            let bus = Bus::builder(cpu, &MEMORY, [it]);
            Self {
                chip: Single::new(bus, "it", Instance::new(model)).unwrap(),
                cells: Cells::default(),
                now: 0,
            }
        }

        pub(crate) fn set(&mut self, offset: u16, value: u32) {
            let (at, address) = (VirtualNanos(self.now), BASE + u64::from(offset));
            self.chip
                .write(at, address, Width::W32, value.into())
                .unwrap();
            self.settle();
        }

        pub(crate) fn get(&mut self, offset: u16) -> u32 {
            let (at, address) = (VirtualNanos(self.now), BASE + u64::from(offset));
            let value = self.chip.read(at, address, Width::W32).unwrap();
            self.settle();
            value as u32
        }

        pub(crate) fn task(&mut self, number: u16) {
            self.set(number * 4, 1);
        }

        /// Returns true if the event happened since it was last asked.
        pub(crate) fn took(&mut self, event: u16) -> bool {
            let flag = self.get(EVENTS + 4 * event) != 0;
            self.set(EVENTS + 4 * event, 0);
            flag
        }

        /// Something happens to it.
        pub(crate) fn with(&mut self, work: impl FnOnce(&mut M, &mut Call<'_, '_>)) {
            let at = VirtualNanos(self.now);
            self.chip.drive(at, |instance, file, context| {
                instance.call(file, context, work);
            });
            self.settle();
        }

        pub(crate) fn settle(&mut self) {
            self.chip.settle(&mut self.cells).unwrap();
        }

        /// Lets time pass, from one instant to the next.
        pub(crate) fn pass(&mut self, nanoseconds: u64) {
            let end = self.now + nanoseconds;
            while let Some(VirtualNanos(next)) = self.chip.next_event()
                && next <= end
            {
                self.chip.advance_to(VirtualNanos(next));
                self.settle();
                self.now = next;
            }
            self.now = end;
        }

        /// Forbidden uses that were told.
        pub(crate) fn forbidden(&mut self) -> Vec<&'static str> {
            let told = self.chip.drain_told();
            told.iter().map(|told| told.register).collect()
        }
    }
}
