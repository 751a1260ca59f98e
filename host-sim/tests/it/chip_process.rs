//! Chips as the simulation sees them. Mostly a stand-in takes their place, which does what a test says:
//! [`StandIn`].

use std::{
    cell::RefCell,
    net::{Ipv4Addr, TcpListener},
    process::{Command, Output},
    rc::Rc,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use crate::small::SMALL;
use host_sim::network::{
    Chips, EmulatorError, Options, Simulation,
    outside::{Deed, Emulator, End, Order, Reports, Wires},
};
use results::record::RunRecord;
use site::{Overrides, Scenario};

/// Notes of what a stand-in was told.
#[derive(Debug, Default)]
struct Notes {
    /// The seed of each start of node 3.
    seeds: Vec<u64>,
    has_ended: bool,
}

/// Stand-in for the chips: that of node 3 does these deeds at each of its starts, the others none. At the second
/// start the run is interrupted, or the stand-in panics.
struct StandIn {
    deeds: Vec<Deed>,
    panics: bool,
    stop: Arc<AtomicBool>,
    notes: Rc<RefCell<Notes>>,
}

impl Emulator for StandIn {
    fn debug(&mut self, _: u32, _: u16, _: Arc<AtomicBool>) {}

    fn run(&mut self, orders: Vec<(u32, Order)>, until: u64) -> Reports {
        let mut deeds = Vec::new();
        for (number, order) in orders {
            if let (3, Order::On { seed, .. }) = (number, order) {
                let mut notes = self.notes.borrow_mut();
                notes.seeds.push(seed);
                if notes.seeds.len() == 2 {
                    assert!(!self.panics, "a planted panic");
                    self.stop.store(true, Ordering::Relaxed);
                }
                deeds = { self.deeds.iter() }
                    .map(|deed| (until, 3, deed.clone()))
                    .collect();
            }
        }
        Reports {
            reached: until,
            next: until,
            deeds,
        }
    }

    fn look(&mut self) -> Reports {
        Reports::default()
    }

    fn end(&mut self) -> Reports {
        self.notes.borrow_mut().has_ended = true;
        let end = Box::new(End {
            instructions: 77,
            ..End::default()
        });
        Reports {
            deeds: vec![(0, 3, Deed::Ends(end))],
            ..Reports::default()
        }
    }
}

/// A run of the small network that has ended.
struct Ended {
    simulation: Simulation,
    record: RunRecord,
    notes: Rc<RefCell<Notes>>,
}

impl Ended {
    /// Reasons why node 3 failed.
    fn failures(&self) -> Vec<&str> {
        let node = self.record.nodes.iter().find(|node| node.id == 3).unwrap();
        let failures = node.failures.iter();
        failures.map(|failure| failure.why.as_str()).collect()
    }
}

/// Runs the small network on chips that do these deeds; its node 3 loses its power for a moment.
fn run(deeds: &[Deed], panics: bool, seed: u64) -> Ended {
    let text = SMALL.replace("at_s = 25.0", "at_s = 0.5");
    let mut scenario = Scenario::from_toml(&text, &Overrides::default()).unwrap();
    scenario.seed = seed;
    let (stop, notes) = (
        Arc::<AtomicBool>::default(),
        Rc::<RefCell<Notes>>::default(),
    );
    let chips = Chips::emulated_by(StandIn {
        deeds: deeds.to_vec(),
        panics,
        stop: stop.clone(),
        notes: notes.clone(),
    });
    let options = Options {
        chips: Some(chips),
        stop,
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    Ended {
        simulation,
        record,
        notes,
    }
}

fn restarts(by: &str, has_settings: bool) -> Deed {
    Deed::Restarts {
        by: by.into(),
        has_settings,
    }
}

fn logs(line: &str) -> Deed {
    Deed::Logs(line.into())
}

fn uart(pins: [u32; 2], rate: u32) -> Deed {
    Deed::Uart(Wires { pins, rate })
}

fn bus(pins: [u32; 2]) -> Deed {
    let rate = 250_000;
    Deed::I2c(Wires { pins, rate })
}

/// Deeds of the image on its board.
fn does_well() -> [Deed; 4] {
    [
        restarts("Core", true),
        logs("error memory: Ram"),
        uart([34, 33], 38_330),
        bus([26, 27]),
    ]
}

/// The first network whose node 3 cannot go on, and the reason.
#[test]
fn what_chips_cannot_do_ends_the_run_with_words() {
    for (does, expected) in [
        (
            Deed::Fails("a model panicked: of two".into()),
            "the chip of node 3 cannot be emulated: a model panicked: of two",
        ),
        (
            logs("error no configuration: Version { found: 9 }"),
            "the configuration page of node 3 (Version { found: 9 })",
        ),
        (
            uart([6, 8], 38_330),
            "its UART has P0.06 and P0.08, where the board has P1.02 and P1.01",
        ),
        (
            uart([34, 33], 250_000),
            "its UART has 250000 baud, where its line has 38400",
        ),
        (
            bus([27, 26]),
            "its I2C bus has P0.27 and P0.26, where the board has P0.26 and P0.27",
        ),
        (
            Deed::Memory(vec![(0, vec![0xff; 4096])]),
            "do not tell what is in the flash of node 3",
        ),
    ] {
        let ended = run(&[does], false, 1);
        let trouble = ended.simulation.trouble().unwrap().to_string();
        assert!(trouble.contains(expected), "{trouble}");
        // It is a failure of this node.
        assert!(ended.failures()[0].contains(expected), "{expected}");
        assert_eq!(ended.notes.borrow().seeds.len(), 1, "{expected}");
    }
}

/// A node that restarts by itself goes on.
#[test]
fn what_a_board_does_well_ends_nothing() {
    let ended = run(&does_well(), false, 1);
    assert!(ended.simulation.trouble().is_none());
    assert_eq!(ended.notes.borrow().seeds.len(), 2);
}

/// A panic, or a watchdog that bites, is in the record with the image's words. The reason of a first start is no
/// failure.
#[test]
fn a_chip_that_restarts_has_failed() {
    let does = [
        restarts("Core", true),
        restarts("Core", false),
        logs("error before that: src/radio.rs:7 no frame"),
        logs("error stopped: the radio failed"),
        restarts("Model(\"WDT\")", false),
    ];
    let told = [
        "its program restarts it: src/radio.rs:7 no frame",
        "its watchdog restarts it: the radio failed",
    ];
    // Before the cut, and after it.
    assert_eq!(run(&does, false, 1).failures(), [told, told].concat());
    assert_eq!(run(&does_well(), false, 1).failures(), [""; 0]);
}

/// A fault of the emulator ends the run, and not the program: the record ends before the fault.
#[test]
fn a_panic_of_what_emulates_chips_ends_the_run_with_words() {
    let Ended {
        simulation,
        record,
        notes,
    } = run(&does_well(), true, 1);
    let trouble = simulation.trouble().unwrap();
    assert!(matches!(&trouble, EmulatorError::Panicked(_)), "{trouble}");
    assert!(trouble.to_string().contains("a planted panic"), "{trouble}");
    assert!((0.5..2.0).contains(&record.sim_seconds));
    assert_eq!((record.scenario.as_str(), record.nodes.len()), ("small", 5));
    let mut nodes = record.nodes.iter();
    assert!(nodes.all(|node| node.calibrated_seconds.is_none()));
    // It is not asked any more.
    assert!(!notes.borrow().has_ended);
}

#[test]
fn who_interrupts_a_run_still_hears_what_chips_knew() {
    let ended = run(&[], false, 1);
    assert!(ended.notes.borrow().has_ended);
    assert_eq!(ended.simulation.chips()[&3].instructions, 77);
}

#[test]
fn chips_get_another_seed_at_each_start_and_the_same_in_each_run() {
    let starts = |seed| run(&[], false, seed).notes.borrow().seeds.clone();
    let first = starts(1);
    assert_eq!(first.len(), 2);
    assert_ne!(first[0], first[1]);
    assert_eq!(starts(1), first);
    assert_ne!(starts(2)[0], first[0]);
}

fn host_sim(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command.args(arguments);
    command
}

fn refused(command: &mut Command, expected: &str) -> Output {
    let output = command.output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(expected), "{stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    output
}

/// Told before any waiting.
#[test]
fn a_node_or_port_that_gdb_cannot_have_is_told() {
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let mut chips = Chips::emulated_by(StandIn {
        deeds: Vec::new(),
        panics: false,
        stop: Arc::default(),
        notes: Rc::default(),
    });
    let error = chips.debug(3, port, Arc::default()).unwrap_err();
    let expected = format!("port {port} of this computer is taken");
    assert!(error.to_string().contains(&expected), "{error}");
    let gdb = |what: &str| host_sim(&["run", "lab", "--backend", "nrf52840", "--gdb", what]);
    refused(
        &mut gdb("99"),
        "there is no node 99; there are 1, 2, 3, 4, 5, 6, 7, 20, ",
    );
    for wrong in ["x", "3:", "3:0", "3:65536"] {
        let output = gdb(wrong).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(stderr.contains("such as 3:3334"), "{stderr}");
    }
}

#[cfg(not(feature = "chip"))]
#[test]
fn what_is_missing_is_told_with_what_to_type() {
    refused(
        &mut host_sim(&["run", "lab", "--backend", "nrf52840"]),
        "`cargo run --release -p host-sim --features chip -- run ...`",
    );
}

/// A program that runs on the chips of the crate `nrf52840-emulator`.
#[cfg(feature = "chip")]
mod images {
    use std::{
        env, fs,
        path::{Path, PathBuf},
        process::{Child, Stdio},
        thread,
        time::Duration,
    };

    use host_sim::network::CHIP_IMAGE;
    use object::{Object, ObjectSegment};
    use tempfile::TempDir;

    use super::*;

    /// ELF's number of the processor.
    const ARM: u16 = 40;

    /// An ELF file of two vectors at an address, and one section.
    fn elf(machine: u16, address: u32, section: &[u8; 6]) -> Vec<u8> {
        let vectors = [0x2004_0000, address + 0x101];
        let names = [b"\0".as_slice(), section, b"\0.shstrtab\0\0\0"].concat();
        let mut file = b"\x7fELF\x01\x01\x01".to_vec();
        file.resize(16, 0);
        let halves = [
            [2, machine, 1, 0, 0x101, 0],
            // Places of the tables of programs and sections, lengths of their entries, and numbers of entries.
            [52, 0, 112, 0, 0, 0],
            [52, 32, 1, 40, 3, 2],
        ];
        file.extend(halves.concat().into_iter().flat_map(u16::to_le_bytes));
        // The program, at the end of this table.
        let program = [1, 84, address, address, 8, 8, 5, 4];
        let sections = [
            [0; 10],
            [1, 1, 0, 0, 84, 0, 0, 0, 1, 0],
            [8, 3, 0, 0, 92, 18, 0, 0, 1, 0],
        ];
        let words = program.into_iter().chain(vectors);
        file.extend(words.flat_map(u32::to_le_bytes));
        file.extend(names);
        let sections = sections.concat();
        file.extend(sections.iter().flat_map(|word: &u32| word.to_le_bytes()));
        file
    }

    /// `host-sim run lab` on an image.
    fn lab(image: &Path) -> Command {
        let mut command = host_sim(&["run", "lab", "--backend", "nrf52840", "--image"]);
        command.arg(image);
        command
    }

    #[test]
    fn what_is_missing_is_told_with_what_to_type() {
        let folder = TempDir::new().unwrap();
        let image = folder.path().join("image.elf");
        let shell = fs::read("/bin/sh").unwrap();
        for other in [
            b"no machine code".to_vec(),
            shell,
            elf(62, 0, b".defmt"),
            elf(ARM, 0x0800_0000, b".defmt"),
            elf(ARM, 0, b".other"),
            // It does not name its log format.
            elf(ARM, 0, b".defmt"),
        ] {
            fs::write(&image, other).unwrap();
            refused(&mut lab(&image), "is no program for an nRF52840");
        }
        fs::remove_file(&image).unwrap();
        refused(&mut lab(&image), "type `cargo xtask firmware`");
    }

    /// The image that is flashed.
    fn flashed() -> PathBuf {
        let usual = || {
            Path::new(env!("CARGO_MANIFEST_DIR"))
                .join("..")
                .join(CHIP_IMAGE)
        };
        env::var_os("NODE_IMAGE").map_or_else(usual, PathBuf::from)
    }

    const UARTE: u32 = 0x4000_2000;

    /// Puts a number into a register: `movw`, `movt`.
    fn set(register: u16, number: u32) -> [u16; 4] {
        let half = |code: u16, half: u16| {
            let code = code | (half >> 11 & 1) << 10 | half >> 12;
            [code, (half >> 8 & 7) << 12 | register << 8 | half & 0xff]
        };
        let low = half(0xf240, number as u16);
        let high = half(0xf2c0, (number >> 16) as u16);
        [low[0], low[1], high[0], high[1]]
    }

    /// The image that is flashed, with another begin: its UART sends over other pins, and it sleeps for ever.
    fn with_other_pins() -> Vec<u8> {
        let mut bytes = fs::read(flashed()).unwrap();
        let file = object::File::parse(bytes.as_slice()).unwrap();
        let start = file.entry() & !1;
        let begins = |segment: &object::Segment<'_, '_>| {
            let range = segment.address()..segment.address() + segment.size();
            let offset = segment.file_range().0;
            range.contains(&start).then(|| offset + start - range.start)
        };
        let at = file
            .segments()
            .find_map(|segment| begins(&segment))
            .unwrap() as usize;
        let store = |register, value| {
            // `str r1, [r2]`
            [&set(2, UARTE + register)[..], &set(1, value), &[0x6011]].concat()
        };
        let code = [
            // PSEL.TXD, PSEL.RXD, ENABLE; TXD.PTR, TXD.MAXCNT, TASKS_STARTTX.
            store(0x50c, 1),
            store(0x514, 2),
            store(0x500, 8),
            store(0x544, 0x2000_0000),
            store(0x548, 1),
            store(0x008, 1),
            // `wfi`, again and again.
            vec![0xbf30, 0xe7fd],
        ]
        .concat();
        let code: Vec<u8> = code.into_iter().flat_map(u16::to_le_bytes).collect();
        bytes[at..at + code.len()].copy_from_slice(&code);
        bytes
    }

    /// Whatever has happened, results end before the failure, and no table seems to be complete.
    #[test]
    #[ignore = "`cargo xtask test --stage chip`"]
    fn a_run_whose_chips_fail_says_that_it_is_not_complete() {
        let folder = TempDir::new().unwrap();
        let [image, json, csv] =
            ["image.elf", "run.json", "poses.csv"].map(|name| folder.path().join(name));
        fs::write(&image, with_other_pins()).unwrap();
        let mut command = lab(&image);
        command.arg("--json").arg(&json).arg("--csv").arg(&csv);
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        // The use of the stacks is told before.
        let stderr = String::from_utf8(output.stderr).unwrap();
        let last = stderr.lines().last().unwrap();
        assert!(last.contains("its UART has P0.01 and P0.02"), "{stderr}");
        let stdout = String::from_utf8(output.stdout).unwrap();
        let begins = "NOT COMPLETE: the image of node ";
        assert!(stdout.starts_with(begins), "{stdout}");
        let csv = fs::read_to_string(&csv).unwrap();
        let last = csv.lines().last().unwrap();
        let begins = "# not complete: the image of node ";
        assert!(last.starts_with(begins), "{csv}");
        let json = fs::read_to_string(&json).unwrap();
        assert!(json.contains("\"cut_short\": \"the image of"), "{json}");
        let record = RunRecord::from_json(&json).unwrap();
        assert_eq!((record.scenario.as_str(), record.nodes.len()), ("lab", 9));
        let mut nodes = record.nodes.iter();
        assert!(nodes.all(|node| node.calibrated_seconds.is_none()));
    }

    /// Ends with its owner.
    struct Running(Child);

    impl Drop for Running {
        fn drop(&mut self) {
            // It may have ended already.
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// A port that no program has now.
    fn free_port() -> u16 {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        listener.local_addr().unwrap().port()
    }

    /// No GDB has connected, and nothing moves.
    #[cfg(target_os = "linux")]
    #[test]
    #[ignore = "`cargo xtask test --stage chip`"]
    fn who_interrupts_a_run_that_waits_for_gdb_need_do_so_once() {
        let port = free_port();
        // Not tried: chips could not have it meanwhile.
        let is_taken = || {
            let all = fs::read_to_string("/proc/net/tcp").unwrap();
            all.contains(&format!(":{port:04X} 00000000:0000 0A"))
        };
        let mut command = lab(&flashed());
        command
            .args(["--gdb", &format!("3:{port}")])
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let mut simulation = Running(command.spawn().unwrap());
        while !is_taken() {
            assert_eq!(simulation.0.try_wait().unwrap(), None);
            thread::sleep(Duration::from_millis(20));
        }
        let pid = simulation.0.id().to_string();
        let kill = Command::new("kill").args(["-INT", &pid]).status();
        assert!(kill.unwrap().success());
        assert_eq!(simulation.0.wait().unwrap().code(), Some(130));
    }
}
