//! Every dialogue of the driver with an independent camera: one that shares no code with the driver or the
//! emulator, prints what the manual says, and is sloppy where real ones are.

mod camera;
mod line;

use std::panic::catch_unwind;

use camera::{Habits, PLAIN};
use cmucam2_driver::{
    Command, Error, Packet,
    colour::{ColourBounds, ColourChannel},
    command::{LineMode, RawMode, TrackingLines},
    device::Part,
    geometry::{Sensor, Window},
    packet::Tracking,
    servo::{Servo, ServoPosition},
    session::{Answer, Fault, Learn, StartUp},
};
use line::{Async, Blocking, Device, Drive, World, connect};

const QUICK: StartUp = StartUp {
    adapt_ms: 500,
    colour_mode: cmucam2_driver::register::ColourMode::Rgb,
};

fn ball() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 70]).unwrap()
}

fn nothing() -> ColourBounds {
    ColourBounds::new([16, 20, 16, 20, 16, 20]).unwrap()
}

/// Habits of real cameras: their name, and the difference that each makes.
type Habit = (&'static str, fn(&mut Habits));

const HABITS: [Habit; 18] = [
    ("echoes", |h| h.echoes = true),
    ("spaces at the end of lines", |h| h.end_of_line = " \r"),
    ("lines end twice", |h| h.end_of_line = "\r\n"),
    ("a space after the prompt", |h| h.prompt = ": "),
    ("a prompt on a line of its own", |h| h.prompt = "\r:\r"),
    ("slow", |h| (h.thinks_ms, h.boots_ms) = (150, 1_500)),
    ("a blank line before the banner", |h| h.before_banner = "\r"),
    ("a banner without an end", |h| h.banner = "CMUcam2 v1.0 c6"),
    ("packets within ACK", |h| h.interrupts_itself = true),
    ("acknowledged stops", |h| h.acknowledges_stop = true),
    ("refusals", |h| h.refuses_every = 3),
    ("lower bounds first", |h| h.lower_bounds_first = true),
    ("a mean before TW", |h| h.tells_mean = true),
    ("columns from 0", |h| h.first_number = 0),
    ("a mark before all rows", |h| h.row_marks = (true, true)),
    ("no mark after them", |h| h.row_marks = (false, false)),
    ("histograms without end", |h| h.histogram_goes_on = true),
    ("a silent sleep", |h| h.sleeps_with_prompt = false),
];

/// Each habit alone, then all that go together.
fn all_habits() -> Vec<(&'static str, Habits)> {
    let mut sloppy = PLAIN;
    for (name, habit) in HABITS {
        if ![
            "lines end twice",
            "a prompt on a line of its own",
            "a mark before all rows",
        ]
        .contains(&name)
        {
            habit(&mut sloppy);
        }
    }
    let sloppy = Habits {
        thinks_ms: 40,
        boots_ms: 900,
        before_banner: "\r\n",
        refuses_every: 5,
        row_marks: (true, false),
        ..sloppy
    };
    let alone = HABITS.map(|(name, habit)| {
        let mut habits = PLAIN;
        habit(&mut habits);
        (name, habits)
    });
    [&[("plain", PLAIN)], &alone[..], &[("all of it", sloppy)]].concat()
}

/// Runs a dialogue with cameras of all habits, over both kinds of UART.
fn with_all(dialogue: [fn(&mut Device, &World, &Habits, &str); 2]) {
    let mut failed = Vec::new();
    for (name, habits) in all_habits() {
        for (kind, dialogue) in ["blocking", "async"].into_iter().zip(dialogue) {
            let what = format!("{name}, {kind}");
            let went = catch_unwind(|| {
                let (mut device, world) = connect(habits);
                dialogue(&mut device, &world, &habits, &what);
            });
            if went.is_err() {
                failed.push(what);
            }
        }
    }
    assert!(failed.is_empty(), "with {failed:?}");
}

macro_rules! dialogues {
    ($($(#[$meta:meta])* fn $name:ident<$drive:ident>($device:ident, $world:ident, $habits:ident, $what:ident) $body:block)*) => { $(
        $(#[$meta])*
        #[test]
        fn $name() {
            #[allow(unused_variables, reason = "not every dialogue needs everything")]
            fn with<$drive: Drive>($device: &mut Device, $world: &World, $habits: &Habits, $what: &str) $body
            with_all([with::<Blocking>, with::<Async>]);
        }
    )* };
}

/// The ball is there, and the packet shows it.
fn assert_ball(seen: Option<Tracking>, habits: &Habits, what: &str) {
    let found = seen.and_then(|seen| seen.bounding_box()).expect(what);
    assert_eq!(
        (found.x2 - found.x1, found.y2 - found.y1),
        (16, 33),
        "{what}"
    );
    let first = habits.first_number as u8;
    assert_eq!(found.y1, 52 + first, "{what}");
    assert!(
        (31 + first..=38 + first).contains(&found.x1),
        "{what}: {found:?}"
    );
}

dialogues! {
    fn from_power_up_to_tracking<D>(device, world, habits, what) {
        let version = D::drive(device.version()).expect(what);
        assert_eq!(version.sensor(), Some(Sensor::Ov6620), "{what}");
        D::drive(device.start_up(QUICK)).expect(what);
        let learnt = D::drive(device.learn_and_track(Learn::default())).expect(what);
        assert_eq!(learnt, ball(), "{what}");
        for _ in 0..20 {
            assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        }
        D::drive(device.stop()).expect(what);
        assert_eq!(D::drive(device.tracking_bounds()).expect(what), ball(), "{what}");
        assert_eq!(device.session().restarts(), 0, "{what}");
    }

    fn a_stream_between_commands<D>(device, world, habits, what) {
        D::drive(device.set(Command::NoiseFilter(0))).expect(what);
        D::drive(device.track_colour(ball())).expect(what);
        for pixels in 0..6 {
            assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
            // Stops the stream; the next packet starts it again.
            D::drive(device.set(Command::NoiseFilter(pixels))).expect(what);
        }
        let tracks = world.camera.borrow().obeyed.iter().filter(|line| line.starts_with("TC")).count();
        assert!(tracks >= 6, "{what}: {tracks}");
    }

    fn polled<D>(device, world, habits, what) {
        D::drive(device.set(Command::PollMode(true))).expect(what);
        D::drive(device.track_colour(ball())).expect(what);
        for _ in 0..10 {
            assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        }
        D::drive(device.track_colour(nothing())).expect(what);
        let seen = D::drive(device.next_tracking()).expect(what).expect(what);
        assert!(seen.is_lost(), "{what}");
        assert_eq!(device.session().restarts(), 0, "{what}");
    }

    fn queries<D>(device, world, habits, what) {
        let value = |value| Answer::Values([value, 0, 0, 0, 0, 0]);
        for (command, answer) in [
            (Command::GetButton, value(0)),
            (Command::GetInputs, value(5)),
            (Command::ServoPosition(Servo::PAN, ServoPosition::new(99).unwrap()), Answer::Done),
            (Command::GetServo(Servo::PAN), value(99)),
            (Command::GetWindow, Answer::Values([1, 1, 88, 143, 0, 0])),
            (Command::VirtualWindow(Some(Window::new(10, 20, 30, 40).unwrap())), Answer::Done),
            (Command::GetWindow, Answer::Values([10, 20, 30, 40, 0, 0])),
            (Command::VirtualWindow(None), Answer::Done),
        ] {
            assert_eq!(D::drive(device.command(command)).expect(what), answer, "{what}: {command:?}");
        }
    }

    fn colours_of_a_window<D>(device, world, habits, what) {
        let mean = |answer| match answer {
            Answer::Packet(Packet::Statistics(statistics)) => statistics.mean().unwrap(),
            other => panic!("{what}: {other:?}"),
        };
        assert_eq!(mean(D::drive(device.command(Command::GetMean)).expect(what)).red, 120, "{what}");
        D::drive(device.stream(Command::GetMean)).expect(what);
        for _ in 0..3 {
            let packet = D::drive(device.next_packet()).expect(what);
            assert!(matches!(packet, Some(Packet::Statistics(_))), "{what}: {packet:?}");
        }
        let answer = D::drive(device.command(Command::GetHistogram(ColourChannel::Green)));
        assert!(matches!(answer, Ok(Answer::Packet(Packet::Histogram(_)))), "{what}: {answer:?}");
        let how = Learn::Mean { window: None, margin: 30 };
        let learnt = D::drive(device.learn(how)).expect(what);
        assert_eq!(learnt, ball(), "{what}");
        // The window is the whole frame again.
        let window = D::drive(device.command(Command::GetWindow)).expect(what);
        assert_eq!(window, Answer::Values([1, 1, 88, 143, 0, 0]), "{what}");
    }

    fn frames<D>(device, world, habits, what) {
        let mut row = [0; 261];
        for channel in [Some(ColourChannel::Red), None] {
            D::drive(device.stream(Command::SendFrame(channel))).expect(what);
            let mut rows = 0;
            loop {
                match D::drive(device.next_part(&mut row)).expect(what) {
                    Part::Header(header) => {
                        assert_eq!((header.width, header.height), (87, 143), "{what}");
                    }
                    Part::Row { bytes, intact } => {
                        assert!(intact && bytes % 87 == 0, "{what}: {bytes}");
                        rows += 1;
                    }
                    Part::End { rows: told, intact } => {
                        assert_eq!((rows, told, intact), (143, 143, true), "{what}");
                        break;
                    }
                    other => panic!("{what}: {other:?}"),
                }
            }
        }
        D::drive(device.set(Command::Idle)).expect(what);
    }

    fn rows_between_packets<D>(device, world, habits, what) {
        D::drive(device.set(Command::LineMode(LineMode::Tracking(TrackingLines::Bitmap)))).expect(what);
        D::drive(device.track_colour(ball())).expect(what);
        let mut row = [0; 11];
        let (mut rows, mut packets) = (0, 0);
        while packets < 2 {
            match D::drive(device.next_part(&mut row)).expect(what) {
                Part::Row { intact, .. } => rows += u16::from(intact),
                Part::Packet(_) => packets += 1,
                _ => {}
            }
        }
        assert_eq!(rows, 286, "{what}");
    }

    fn frame_differencing<D>(device, world, habits, what) {
        D::drive(device.upload_difference(&[100; 64])).expect(what);
        assert_eq!(world.camera.borrow().uploaded, 64, "{what}");
        D::drive(device.set(Command::LoadFrame)).expect(what);
        D::drive(device.stream(Command::FrameDifference(12))).expect(what);
        for _ in 0..3 {
            let seen = D::drive(device.next_tracking()).expect(what).expect(what);
            assert_eq!(seen.centroid(), Some((4, 5)), "{what}");
        }
    }

    fn silence_under_packet_filter<D>(device, world, habits, what) {
        D::drive(device.set(Command::PacketFilter(true))).expect(what);
        D::drive(device.track_colour(nothing())).expect(what);
        for _ in 0..3 {
            let seen = D::drive(device.next_tracking()).expect(what);
            assert!(seen.is_none_or(|seen| seen.is_lost()), "{what}");
        }
        assert_eq!(device.session().restarts(), 0, "{what}");
    }

    fn packets_in_bytes<D>(device, world, habits, what) {
        // Bytes behind a line of text do not come behind raw bytes.
        D::drive(device.set(Command::RawMode(RawMode::OUTPUT))).expect(what);
        D::drive(device.track_colour(ball())).expect(what);
        for _ in 0..5 {
            assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        }
    }

    fn asleep_and_awake<D>(device, world, habits, what) {
        for command in [Command::Sleep, Command::DeepSleep] {
            // A refusal is not repeated blindly: the second copy would wake it.
            if D::drive(device.set(command)).is_err() {
                assert!(habits.refuses_every > 0 || habits.interrupts_itself, "{what}");
            }
            let version = D::drive(device.version()).expect(what);
            assert_eq!(version.major, 1, "{what}");
        }
    }

    /// The modes are back, and the stream goes on.
    fn a_power_cut_within_a_stream<D>(device, world, habits, what) {
        D::drive(device.set(Command::HighResolution(true))).expect(what);
        D::drive(device.set(Command::NoiseFilter(4))).expect(what);
        D::drive(device.track_colour(ball())).expect(what);
        assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        let now = world.now();
        world.camera.borrow_mut().restart(now);
        world.camera.borrow_mut().obeyed.clear();
        let told = (0..20).any(|_| {
            D::drive(device.next_tracking()).map(|_| ()) == Err(Error::Camera(Fault::Restarted))
        });
        assert!(told, "{what}");
        assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        let obeyed = &world.camera.borrow().obeyed;
        for mode in ["HR 1", "NF 4"] {
            assert!(obeyed.iter().any(|line| line == mode), "{what}: no {mode} in {obeyed:?}");
        }
        assert_eq!(device.session().restarts(), 1, "{what}");
    }

    fn recovered<D>(device, world, habits, what) {
        D::drive(device.set(Command::PacketSkip(1))).expect(what);
        D::drive(device.recover()).expect(what);
        let obeyed = world.camera.borrow().obeyed.clone();
        assert_eq!(obeyed.iter().filter(|line| *line == "PS 1").count(), 2, "{what}: {obeyed:?}");
    }

    fn gone<D>(device, world, habits, what) {
        D::drive(device.track_colour(ball())).expect(what);
        assert_ball(D::drive(device.next_tracking()).expect(what), habits, what);
        world.camera.borrow_mut().pull_the_plug();
        let silent = (0..40).any(|_| {
            D::drive(device.next_tracking()).map(|_| ()) == Err(Error::Camera(Fault::Silence))
        });
        assert!(silent, "{what}");
    }
}

/// A UART that can only be tried, one byte at a time.
#[cfg(feature = "embedded-hal-nb")]
#[test]
fn one_byte_is_peeked() {
    use cmucam2_driver::{Cmucam2, serial::Peek};
    for (name, habits) in all_habits() {
        let (device, _world) = connect(habits);
        let (uart, delay) = device.release();
        let mut device = Cmucam2::new(Peek::new(uart), delay);
        device.start_up(QUICK).wait().expect(name);
        device.set(Command::PollMode(true)).wait().expect(name);
        let learnt = device.learn_and_track(Learn::default()).wait();
        assert_eq!(learnt.expect(name), ball(), "{name}");
        for _ in 0..5 {
            assert_ball(device.next_tracking().wait().expect(name), &habits, name);
        }
    }
}
