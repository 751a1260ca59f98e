//! Text that a person at a terminal reads.

use cmucam2_emulator::{Configuration, FaultRates, Sensor, Switches};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::clients::bytes;
use crate::support::{MILLISECOND, ORANGE_TC, SECOND, Terminal, orange_box, with};

fn terminal() -> Terminal {
    let mut terminal = Terminal::new(Configuration::default(), orange_box([30, 49], [40, 79]));
    terminal.freeze();
    terminal
}

/// The file has dialogues, each with a name and a camera of its own that was started; `...` is whatever follows. Steps
/// that begin with `!` are `switch NAME=VALUE`, before all others, `wait MS`, `button`, `inputs BITS`, and `box` with
/// the columns and rows of what is before the camera.
#[test]
fn a_person_reads_these_answers() {
    for dialogue in include_str!("terminal.txt").split("== ").skip(1) {
        let lines = dialogue.lines().filter(|line| !line.is_empty());
        let lines: Vec<_> = lines.filter(|line| !line.starts_with('#')).collect();
        let switch = lines[1].strip_prefix("!switch ");
        let change = |it: &mut Configuration| switch.map(|switch| it.switches.set_from(switch));
        let camera = with(|it| change(it).unwrap_or(Ok(())).unwrap());
        let mut terminal = Terminal::new(camera, orange_box([30, 49], [40, 79]));
        terminal.freeze();
        for line in &lines[1 + usize::from(switch.is_some())..] {
            let (typed, expected) = line.split_once(" =>").unwrap_or((line, ""));
            let words: Vec<_> = typed.split(' ').collect();
            let number = |place: usize| words[place].parse().unwrap();
            let read = match words[0] {
                "!wait" => terminal.read(words[1].parse::<u64>().unwrap() * MILLISECOND),
                "!button" => {
                    terminal.camera.press_button();
                    continue;
                }
                "!inputs" => {
                    terminal.camera.set_inputs(number(1));
                    continue;
                }
                "!box" => {
                    let scene = orange_box([number(1), number(2)], [number(3), number(4)]);
                    *terminal.camera.scene_mut() = scene;
                    continue;
                }
                _ => terminal.bytes(&String::from_utf8(bytes(typed)).unwrap()),
            };
            let expected = expected.trim_start();
            let is_right = match expected.strip_suffix("...") {
                Some(beginning) => read.starts_with(&bytes(beginning)),
                None => read == bytes(expected),
            };
            assert!(is_right, "{}, {line}: {}", lines[0], read.escape_ascii());
        }
    }
}

/// 50 frames a second, and a T packet of 28 bytes takes 2.4 ms: a stop within one cuts it.
#[test]
fn a_stop_cuts_the_packet_under_way() {
    let packet = "T 40 60 31 41 50 80 100 255\r";
    for (within, answer) in [(1, "T 40 60 3:"), (0, "T 40 60 31 41 50 80 100 255\r:")] {
        let cuts = with(|it| it.switches.stop_within_packet = within);
        let mut terminal = Terminal::new(cuts, orange_box([30, 49], [40, 79]));
        terminal.freeze();
        let mut heard = String::new();
        for byte in ORANGE_TC.bytes() {
            terminal.camera.receive(byte, terminal.now);
        }
        heard += &String::from_utf8(terminal.read(25 * MILLISECOND)).unwrap();
        assert_eq!(heard, format!("ACK\r{packet}"));
        // The next frame, and nine bytes of its packet: the tenth has begun when the stop comes.
        let frame = 20 * MILLISECOND;
        let byte = SECOND / 11_520;
        terminal.now = terminal.now.div_ceil(frame) * frame + 8 * byte + byte / 2;
        terminal.camera.receive(b'\r', terminal.now);
        assert_eq!(String::from_utf8(terminal.read(SECOND)).unwrap(), answer,);
        assert_eq!(terminal.types("\r"), "ACK\r:");
    }
}

/// Under packet filter only the first empty packet is sent.
#[test]
fn packet_filter_and_packet_skip() {
    let here = "T 40 60 31 41 50 80 100 255\r";
    let lost = "T 0 0 0 0 0 0 0 0\r";
    let mut terminal = terminal();
    terminal.types("PF 1\r");
    let stream = terminal.types(ORANGE_TC);
    assert!(stream.matches(here).count() >= 4, "{stream}");
    terminal.camera.scene_mut().objects.clear();
    let stream = String::from_utf8(terminal.read(SECOND)).unwrap();
    assert_eq!(stream.matches(lost).count(), 1, "{stream}");
    assert!(stream.ends_with(lost));
    terminal.types("\r");
    terminal.types("PF 0\r");
    terminal.types("PS 4\r");
    terminal.types("TC\r");
    let stream = String::from_utf8(terminal.read(SECOND)).unwrap();
    assert_eq!(stream, lost.repeat(10), "every fifth of 50 frames");
}

#[test]
fn the_frame_rate_follows_the_clock_divider_and_the_window() {
    let mut terminal = terminal();
    let mut rate = |set: &str, start: &str| {
        terminal.types(set);
        terminal.types(start);
        let stream = terminal.read(10 * SECOND);
        terminal.types("\r");
        stream.iter().filter(|byte| **byte == b'T').count()
    };
    for (divider, frames) in [
        (0, 50),
        (1, 26),
        (2, 17),
        (3, 13),
        (4, 11),
        (5, 9),
        (6, 8),
        (7, 7),
        (8, 6),
        (10, 5),
    ] {
        let counted = rate(&format!("CR 17 {divider}\r"), ORANGE_TC);
        assert!(counted.abs_diff(10 * frames) <= 1, "{divider}: {counted}");
    }
    rate("CR 17 0\r", "LF\r");
    assert!(rate("LF\r", "FD 10\r").abs_diff(260) <= 1);
    // Half the rows, twice the rate; the bytes of 100 packets take 0.2 s.
    assert!(rate("VW 1 1 88 71\r", ORANGE_TC).abs_diff(1007) <= 10);
}

/// Ten bit times for each byte, and the delay of `DM`.
#[test]
fn every_byte_has_its_time() {
    for baud in cmucam2_emulator::BAUD_RATES {
        let configuration = with(|it| {
            it.baud = baud;
            it.host_baud = baud;
        });
        let mut terminal = Terminal::new(configuration, orange_box([30, 49], [40, 79]));
        terminal.read(5 * SECOND);
        let mut duration = |command: &str| {
            for byte in command.bytes() {
                terminal.camera.receive(byte, terminal.now);
            }
            terminal.now += 5 * SECOND;
            let times: Vec<u64> = std::iter::from_fn(|| terminal.camera.transmit(terminal.now))
                .map(|(at, _)| at)
                .collect();
            (times.len() as u64, times[times.len() - 1] - times[0])
        };
        let bit = SECOND / u64::from(baud);
        let (bytes, time) = duration("GV\r");
        assert_eq!((bytes, time), (22, 21 * 10 * bit), "at {baud}");
        duration("DM 7\r");
        assert_eq!(duration("GV\r").1, 21 * 17 * bit, "at {baud}");
    }
}

/// Any byte wakes it; it listens again after about 10 ms.
#[test]
fn sleep() {
    for (prompt, asleep, awake) in [(1, "ACK\r:", ""), (0, "ACK\r", ":")] {
        for command in ["SL\r", "SD\r"] {
            let prompts = with(|it| it.switches.sleep_prompt = prompt);
            let mut terminal = Terminal::new(prompts, orange_box([30, 49], [40, 79]));
            assert_eq!(terminal.types(command), asleep);
            terminal.camera.receive(b'\r', terminal.now);
            terminal.now += 5 * MILLISECOND;
            terminal.camera.receive(b'X', terminal.now);
            assert_eq!(terminal.read(20 * MILLISECOND), awake.as_bytes());
            assert_eq!(terminal.types("GB\r"), "ACK\r0\r:");
        }
    }
}

#[test]
fn learning_in_the_window_says_what_it_saw() {
    let means = with(|it| it.switches.window_mean = 1);
    let mut terminal = Terminal::new(means, orange_box([0, 87], [0, 142]));
    terminal.freeze();
    let stream = terminal.types("TW\r");
    let mean = stream.split('\r').nth(1).unwrap().to_owned();
    assert!(mean.starts_with("S ") && mean.ends_with(" 0 0 0"), "{mean}");
    assert!(
        stream.contains("\rT 44 72 1 1 87 143 255 255\r"),
        "{stream}"
    );
    terminal.types("\r");
    let levels: Vec<u8> = mean
        .split(' ')
        .skip(1)
        .map(|n| n.parse().unwrap())
        .collect();
    let bounds: Vec<String> = levels[..3]
        .iter()
        .flat_map(|level| {
            [
                level.saturating_sub(30).max(16),
                level.saturating_add(30).min(240),
            ]
        })
        .map(|bound| bound.to_string())
        .collect();
    assert_eq!(
        terminal.types("GT\r"),
        format!("ACK\r{}\r:", bounds.join(" "))
    );
}

/// After any input, a reset leads back to a camera that answers.
#[test]
fn no_input_breaks_it() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let letters = "BMCRCTCPDCDMDSFDFSGBGHGIGMGSGTGVGWHCHDHRHTL0L1LFLMMDNFOMPDPFPMPSRFRSSDSFSLSMSOSPSTSVTCTITWUDVW";
    for seed in 0..400 {
        let mut faults = FaultRates::default();
        let mut switches = Switches::default();
        for switch in Switches::TABLE {
            let position = random.random_range(0..=switch.greatest);
            switches.set(switch.name, position).unwrap();
        }
        if seed % 2 == 1 {
            for fault in FaultRates::TABLE {
                faults.set(fault.name, 0.02).unwrap();
            }
        }
        let sensor = [Sensor::Ov6620, Sensor::Ov7620][usize::from(seed % 3 == 2)];
        let configuration = with(|it| {
            it.sensor = sensor;
            it.switches = switches;
            it.faults = faults;
            it.seed = seed;
            it.watched = true;
        });
        let mut terminal = Terminal::new(configuration, orange_box([80, 95], [130, 150]));
        for _ in 0..60 {
            let place = random.random_range(0..letters.len() / 2) * 2;
            let mut line = letters[place..place + 2].to_owned();
            for _ in 0..random.random_range(0..7) {
                let number = match random.random_range(0..4) {
                    0 => random.random_range(0..2),
                    1 => random.random_range(16..=240),
                    _ => random.random_range(0..=255),
                };
                line += &format!(" {number}");
            }
            line.push('\r');
            terminal.bytes(&line);
            if random.random_bool(0.1) {
                for _ in 0..20 {
                    let byte: u8 = random.random_range(0..=255);
                    terminal.camera.receive(byte, terminal.now);
                }
            }
            if random.random_bool(0.5) {
                terminal.bytes("\r");
            }
        }
        terminal.camera.set_faults(&FaultRates::default());
        terminal.camera.power_cycle(terminal.now);
        terminal.read(2 * SECOND);
        assert!(terminal.types("GV\r").contains("CMUcam"), "{seed}");
    }
}

#[test]
fn the_same_seed_and_commands_give_the_same_bytes() {
    let run = |seed: u64| {
        let mut faults = FaultRates::default();
        for fault in FaultRates::TABLE {
            faults.set(fault.name, 0.01).unwrap();
        }
        let configuration = with(|it| {
            it.seed = seed;
            it.faults = faults;
        });
        let mut scene = orange_box([30, 49], [40, 79]);
        scene.noise = 3.0;
        scene.flicker = 0.1;
        let mut terminal = Terminal::new(configuration, scene);
        let mut all = Vec::new();
        for line in [
            "GV\r", "TC\r", "\r", "GM\r", "\r", "SF 1\r", "\r", ORANGE_TC,
        ] {
            all.extend(terminal.bytes(line));
            all.extend(terminal.read(SECOND));
        }
        all
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}
