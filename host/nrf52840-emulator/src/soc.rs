//! The chip: its memory map, the addresses of its peripherals, and its reset.

use std::{
    collections::BTreeMap,
    num::{NonZeroU32, NonZeroU64},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use rigless::{
    cpu,
    device::{ErasedDevice, ResetCause},
    machine::{self, Target, armv7m},
    mcu::{Mcu, Operate},
    snapshot::Store,
    soc::{Bus, Cpu, Endian, Error, Peripheral, Region},
    time::VirtualNanos,
};

use crate::peripheral::{
    Arrival, Clock, Egu, Frame, Gpio, Gpiote, Held, Instance, Model, Nvmc, Pc, Peer, Ppi,
    REGISTERS, Radio, Rng, Rtc, Temp, Timer, Twim, Uarte, Usbd, Watchdog, Word, clock, gpiote,
    radio, rtc, timer, twim, uarte, usbd, watchdog,
};
use crate::{
    device::Chip,
    processor::{self, Lease, Program},
};

/// Addresses of FICR and UICR (Product Specification, "Memory map").
pub(crate) const FICR: u64 = 0x1000_0000;
/// Data RAM, and its size.
pub(crate) const RAM: (u64, u64) = (0x2000_0000, 256 << 10);
const INTERRUPTS: u16 = 48;
const HZ: u64 = 64_000_000;
/// Name of the peripheral that keeps UICR and flash.
const NVMC: &str = "NVMC";

static MEMORY: [Region; 4] = [
    Region::flash("flash", 0, 1 << 20)
        .erased_to(0xff)
        .programmed_by(NVMC),
    Region::system("ficr", FICR, 0x1000),
    Region::flash("uicr", 0x1000_1000, 0x1000)
        .erased_to(0xff)
        .programmed_by(NVMC),
    Region::ram("ram", RAM.0, RAM.1),
];

/// Product Specification, "Instantiation": the number in the address is that of the interrupt.
const fn peripheral(name: &'static str, base: u64, interrupts: &'static [u16]) -> Peripheral {
    Peripheral {
        name,
        base,
        size: 0x1000,
        interrupts,
        registers: &REGISTERS,
    }
}

const CLOCK: usize = 0;
const RADIO: usize = 1;
const UARTE: usize = 2;
const TWIM: usize = 3;
const TIMER: usize = 5;
const WATCHDOG: usize = 8;
const RTC: usize = 9;
const EGU: usize = 10;
const EGUS: usize = 6;
const PPI: usize = 17;
const USBD: usize = 18;
const GPIO: usize = 20;

/// Peripherals by their addresses: the bus counts its slots so.
const MAP: [Peripheral; 21] = [
    peripheral("CLOCK", 0x4000_0000, &[0]),
    peripheral("RADIO", radio::BASE, &[1]),
    peripheral("UARTE0", 0x4000_2000, &[2]),
    peripheral("TWIM0", twim::BASE, &[3]),
    peripheral("GPIOTE", gpiote::BASE, &[6]),
    peripheral("TIMER1", 0x4000_9000, &[9]),
    peripheral("TEMP", 0x4000_c000, &[12]),
    peripheral("RNG", 0x4000_d000, &[13]),
    peripheral("WDT", 0x4001_0000, &[16]),
    peripheral("RTC1", rtc::BASE, &[17]),
    peripheral("EGU0", 0x4001_4000, &[20]),
    peripheral("EGU1", 0x4001_5000, &[21]),
    peripheral("EGU2", 0x4001_6000, &[22]),
    peripheral("EGU3", 0x4001_7000, &[23]),
    peripheral("EGU4", 0x4001_8000, &[24]),
    peripheral("EGU5", 0x4001_9000, &[25]),
    peripheral(NVMC, 0x4001_e000, &[30]),
    peripheral("PPI", 0x4001_f000, &[31]),
    peripheral("USBD", 0x4002_7000, &[39]),
    // Registers without a name, for which "Errata" (171 and 187) has values.
    peripheral("ERRATA", 0x4006_e000, &[]),
    peripheral("GPIO", gpiote::PINS, &[]),
];

const _: () = {
    let mut slot = 1;
    while slot < MAP.len() {
        assert!(MAP[slot - 1].base < MAP[slot].base);
        slot += 1;
    }
};

/// Registers that are not 0 after a reset: peripheral, offsets, and values.
const RESET: [(usize, &[(u16, u32)]); 6] = [
    (RADIO, &radio::RESET),
    (UARTE, &uarte::RESET),
    (TWIM, &twim::RESET),
    (TIMER, &timer::RESET),
    (WATCHDOG, &watchdog::RESET),
    (USBD, &usbd::RESET),
];

/// Registers of which nothing is known but values to write.
#[derive(Clone, Copy, Debug)]
struct Errata;

impl Model for Errata {}

/// An nRF52840.
#[derive(Debug)]
pub struct Soc {
    bus: Bus,
    /// The processor has locked up, and the times when it was reset for that.
    lockup: Arc<AtomicBool>,
    lockups: Vec<VirtualNanos>,
    /// CLOCK and POWER.
    pub clock: Instance<Clock>,
    /// RADIO.
    pub radio: Instance<Radio>,
    /// UARTE0.
    pub uarte: Instance<Uarte>,
    /// TWIM0.
    pub twim: Instance<Twim>,
    gpiote: Instance<Gpiote>,
    temp: Instance<Temp>,
    /// TIMER1.
    pub timer: Instance<Timer>,
    rng: Instance<Rng>,
    /// WDT.
    pub watchdog: Instance<Watchdog>,
    rtc: Instance<Rtc>,
    egus: [Instance<Egu>; EGUS],
    /// NVMC.
    pub nvmc: Instance<Nvmc>,
    ppi: Instance<Ppi>,
    /// USBD.
    pub usbd: Instance<Usbd>,
    errata: Instance<Errata>,
    /// Both ports.
    pub gpio: Instance<Gpio>,
}

impl Soc {
    /// The chip of a node, with the peer of its line, the PC at its plug, and the chips on its bus.
    ///
    /// # Errors
    /// The map is not in order.
    pub fn new(
        node: usize,
        peer: Option<Box<dyn Peer>>,
        pc: Option<Pc>,
        chips: BTreeMap<u32, Box<dyn Chip>>,
    ) -> Result<Self, Error> {
        let cpu = Cpu::new("nrf52840", true, INTERRUPTS, Endian::Little);
        let bus = Bus::builder(cpu, &MEMORY, MAP)
            .reads_requests("PPI")
            .build()?;
        let bases = MAP.iter().map(|entry| (entry.name, entry.base)).collect();
        let mut soc = Self {
            bus,
            lockup: Arc::default(),
            lockups: Vec::new(),
            clock: Instance::new(Clock::new(pc.is_some())),
            radio: Instance::new(Radio::new(node)),
            uarte: Instance::new(Uarte::new(peer)),
            twim: Instance::new(Twim::new(chips)),
            gpiote: Instance::new(Gpiote::default()),
            temp: Instance::new(Temp::default()),
            timer: Instance::new(Timer::default()),
            rng: Instance::new(Rng::new(node as u64 + 1)),
            watchdog: Instance::new(Watchdog::default()),
            rtc: Instance::new(Rtc::default()),
            egus: [const { Egu }; EGUS].map(Instance::new),
            nvmc: Instance::new(Nvmc::default()),
            ppi: Instance::new(Ppi::new(bases)),
            usbd: Instance::new(Usbd::new(pc)),
            errata: Instance::new(Errata),
            gpio: Instance::new(Gpio::default()),
        };
        soc.check()?;
        soc.set_registers(VirtualNanos(0));
        Ok(soc)
    }

    /// All registers are as after a reset, where they were 0 before.
    fn set_registers(&mut self, now: VirtualNanos) {
        for (slot, registers) in RESET {
            let (file, _) = self.bus.drive(now, slot);
            for &(offset, value) in registers {
                file.set(Word::at(offset), value.into());
            }
        }
    }

    /// Returns true if an interrupt is pending, which wakes the processor.
    pub(crate) fn is_interrupted(&self) -> bool {
        self.clock.is_pending()
            || self.radio.is_pending()
            || self.uarte.is_pending()
            || self.twim.is_pending()
            || self.gpiote.is_pending()
            || self.timer.is_pending()
            || self.rng.is_pending()
            || self.watchdog.is_pending()
            || self.rtc.is_pending()
            || self.temp.is_pending()
            || self.usbd.is_pending()
            || self.egus.iter().any(Instance::is_pending)
    }

    /// Random numbers come from this seed, and where power goes from that instant on too.
    pub(crate) fn draw_from(&mut self, seed: u64, since: u64) {
        self.rng = Instance::new(Rng::new(seed));
        self.nvmc.model.draw_from(seed ^ since.rotate_left(32));
    }

    /// A program that reads this register again and again waits for it to change: where that is no event by
    /// itself, there is one when it does.
    pub(crate) fn wake(&mut self, now: VirtualNanos, address: u64) {
        if let Some(offset) = address.checked_sub(rtc::BASE).filter(|at| *at < 0x1000) {
            let (file, mut context) = self.bus.drive(now, RTC);
            self.rtc.call(file, &mut context, |rtc, call| {
                rtc.wake(offset as u16, call);
            });
        }
    }

    /// Source of the reset of the chip at an instant: `Core` for the program, `Lockup`, or the peripheral.
    pub(crate) fn by(&self, at: VirtualNanos, cause: ResetCause) -> String {
        match cause {
            ResetCause::Core if self.lockups.contains(&at) => "Lockup".to_owned(),
            cause => format!("{cause:?}"),
        }
    }

    /// A byte on the line of UARTE0 is over at an instant.
    pub(crate) fn deliver(&mut self, now: VirtualNanos, byte: u8, at: u64) {
        let (file, mut context) = self.bus.drive(now, UARTE);
        self.uarte.call(file, &mut context, |uarte, call| {
            uarte.deliver(byte, at, call);
        });
    }

    /// From an instant on something outside pulls these inputs of a port down, and no others.
    pub(crate) fn pull(&mut self, now: VirtualNanos, at: u64, port: u8, low: u32) {
        let (file, mut context) = self.bus.drive(now, GPIO);
        self.gpio.call(file, &mut context, |gpio, call| {
            gpio.pull(at, port, low, call);
        });
    }

    /// Something holds the bus of TWIM0 low: a fault, from power-on.
    pub fn hold_bus(&mut self, held: Held) {
        let (file, mut context) = self.bus.drive(VirtualNanos(0), GPIO);
        self.gpio.call(file, &mut context, |gpio, call| {
            gpio.hold(held, call);
        });
    }

    /// A frame of another node is about to arrive.
    pub(crate) fn hear(&mut self, now: VirtualNanos, frame: Frame, arrival: Arrival) {
        let (file, mut context) = self.bus.drive(now, RADIO);
        self.radio.call(file, &mut context, |radio, call| {
            radio.hear(frame, arrival, call);
        });
    }
}

impl Mcu for Soc {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// Product Specification, "Reset behavior": the watchdog runs on through a reset by the program or by a
    /// lockup, and GPREGRET and GPREGRET2 stay.
    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.radio.model.count(at.0);
        self.uarte.model.switch_off(at.0);
        self.timer.model.clocked.stop(at.0);
        self.clock.model.asked.stop(at.0);
        let deadline = self.watchdog.model.deadline;
        let keep = |slot: usize, offset| {
            let file = self.bus.slots()[slot].registers();
            (offset, file.get(Word::at(offset)) as u32)
        };
        let kept = Watchdog::KEPT.map(|offset| keep(WATCHDOG, offset));
        let retained = Clock::KEPT.map(|offset| keep(CLOCK, offset));
        self.reset_every_model();
        self.set_registers(at);
        let (file, mut context) = self.bus.drive(at, GPIO);
        self.gpio.call(file, &mut context, Gpio::go_on);
        if cause == ResetCause::Core {
            let (file, _) = self.bus.drive(at, CLOCK);
            for (offset, value) in retained {
                file.set(Word::at(offset), value.into());
            }
            let (file, mut context) = self.bus.drive(at, WATCHDOG);
            self.watchdog.call(file, &mut context, |watchdog, call| {
                for (offset, value) in kept {
                    call.set(offset, value);
                }
                if Watchdog::is_running(call) {
                    watchdog.go_on(deadline, call);
                }
            });
        }
        let is_lockup = cause == ResetCause::Core && self.lockup.swap(false, Ordering::Relaxed);
        self.clock.model.cause |= match cause {
            ResetCause::Core if is_lockup => {
                self.lockups.push(at);
                clock::LOCKUP
            }
            ResetCause::Core => clock::PROGRAM,
            ResetCause::Model("WDT") => clock::WATCHDOG,
            ResetCause::Pin => clock::PIN,
            _ => 0,
        };
    }

    fn poll(&mut self, _: VirtualNanos) {}

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let model: &mut dyn ErasedDevice = match slot {
            CLOCK => &mut self.clock,
            RADIO => &mut self.radio,
            UARTE => &mut self.uarte,
            TWIM => &mut self.twim,
            4 => &mut self.gpiote,
            TIMER => &mut self.timer,
            6 => &mut self.temp,
            7 => &mut self.rng,
            WATCHDOG => &mut self.watchdog,
            RTC => &mut self.rtc,
            EGU..16 => &mut self.egus[slot - EGU],
            16 => &mut self.nvmc,
            PPI => &mut self.ppi,
            USBD => &mut self.usbd,
            19 => &mut self.errata,
            GPIO => &mut self.gpio,
            _ => return (&mut self.bus, None),
        };
        (&mut self.bus, Some(model))
    }
}

/// A board with one such chip.
#[derive(Debug)]
pub struct Board {
    /// Its chip.
    pub soc: Soc,
    pub(crate) program: Program,
    pub(crate) processor: Lease,
}

impl Store for Board {}

impl machine::Board for Board {
    fn name(&self) -> &'static str {
        "nrf52840"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["nrf52840"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.soc)
    }

    /// An instruction a cycle: faster than the chip, which waits for its flash.
    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: const { NonZeroU64::new(HZ).unwrap() },
            interrupt_lines: const { NonZeroU32::new(INTERRUPTS as u32).unwrap() },
            priority_bits: 3,
            refclk_divider: NonZeroU32::MIN,
            instructions_per_second: const { NonZeroU64::new(HZ).unwrap() },
            boot: "flash",
        };
        let mut config = armv7m::Config::new(core, &cpu::armv7m::windows(self.soc.bus()));
        config.vector_table = Some(0);
        config.fpu = armv7m::Fpu::FpV4Sp;
        let mut spec = config.spec();
        spec.processor = processor::constructor(
            spec.processor,
            self.program.clone(),
            self.processor.clone(),
            self.soc.lockup.clone(),
        );
        vec![Target::new("nrf52840", &mut self.soc, spec)]
    }
}

/// FICR of a chip with 1 MiB of flash and 256 KiB of RAM (Product Specification, "FICR").
pub(crate) fn ficr(node: usize) -> Vec<u8> {
    let mut bytes = vec![0xff; 0x1000];
    let variant = u32::from_be_bytes(*b"AAD0");
    for (at, word) in [
        (0x10, 4096),
        (0x14, 256),
        (0x60, 0x1234_5600 + node as u32),
        (0x64, 0x89ab_cdef),
        (0x100, 0x5_2840),
        (0x104, variant),
        (0x108, 0x2004),
        (0x10c, 256),
        (0x110, 1024),
    ] {
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use rigless::soc::Width;

    use super::*;

    const NOW: VirtualNanos = VirtualNanos(0);

    fn soc() -> Soc {
        Soc::new(0, None, None, BTreeMap::new()).unwrap()
    }

    /// No pin is connected: PSEL.RTS, TXD, CTS and RXD of UARTE0, PSEL.SCL and SDA of TWIM0.
    #[test]
    fn a_reset_disconnects_pins() {
        let mut soc = soc();
        for address in [
            0x4000_2508,
            0x4000_250c,
            0x4000_2510,
            0x4000_2514,
            0x4000_3508,
            0x4000_350c,
        ] {
            soc.write(NOW, address, Width::W32, 7).unwrap();
            Mcu::reset(&mut soc, NOW, ResetCause::Core);
            let read = soc.read(NOW, address, Width::W32).unwrap();
            assert_eq!(read, 0xffff_ffff, "{address:x}");
        }
    }

    /// GPREGRET and GPREGRET2 stay through a reset by the program, and through no other.
    #[test]
    fn a_reset_by_the_program_retains_registers() {
        for (cause, kept) in [(ResetCause::Core, 0x57), (ResetCause::Model("WDT"), 0)] {
            let mut soc = soc();
            for address in [0x4000_051c, 0x4000_0520] {
                soc.write(NOW, address, Width::W32, 0x57).unwrap();
            }
            Mcu::reset(&mut soc, NOW, cause);
            for address in [0x4000_051c, 0x4000_0520] {
                assert_eq!(soc.read(NOW, address, Width::W32), Ok(kept));
            }
        }
    }

    /// A contact that pulled a pin lets go of it in its time, whether the chip restarts or not.
    #[test]
    fn a_reset_does_not_hold_buttons() {
        const MS: u64 = 1_000_000;
        const CONFIGURED: u64 = 0x5000_0700;
        let mut soc = soc();
        let read = |soc: &mut Soc, at| {
            let at = VirtualNanos(at);
            // Connected, pulled up.
            soc.write(at, CONFIGURED, Width::W32, 0b1100).unwrap();
            soc.read(at, 0x5000_0510, Width::W32).unwrap() & 1
        };
        soc.pull(NOW, MS, 0, 1);
        soc.pull(NOW, 200 * MS, 0, 0);
        soc.advance_to(VirtualNanos(MS));
        assert_eq!(read(&mut soc, MS), 0);
        let reset = VirtualNanos(100 * MS);
        soc.advance_to(reset);
        Mcu::reset(&mut soc, reset, ResetCause::Core);
        assert_eq!(read(&mut soc, 100 * MS), 0);
        soc.advance_to(VirtualNanos(200 * MS));
        assert_eq!(read(&mut soc, 200 * MS), 1);
    }
}
