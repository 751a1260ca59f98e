//! The process that a simulation talks to.

use std::{
    io::BufReader,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
};

use chip_pipe::{Deed, End, Order, Orders, Reception, Reports, read, write};

use super::*;

/// A running one, which ends with its owner.
struct Process {
    child: Child,
    orders: ChildStdin,
    reports: BufReader<ChildStdout>,
}

impl Process {
    fn start() -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chips"));
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut orders = child.stdin.take().unwrap();
        let reports = BufReader::new(child.stdout.take().unwrap());
        write(&mut orders, &Orders::Load(image().display().to_string())).unwrap();
        Self {
            child,
            orders,
            reports,
        }
    }

    fn exchange(&mut self, orders: &Orders) -> Reports {
        write(&mut self.orders, orders).unwrap();
        read(&mut self.reports).unwrap().unwrap()
    }

    /// What is known of a chip in the end.
    fn end(&mut self, chip: u32) -> End {
        let ends = self.exchange(&Orders::End).deeds.into_iter();
        let mut ends = ends.filter_map(|(_, number, deed)| match deed {
            Deed::Ends(end) => (number == chip).then_some(*end),
            _ => None,
        });
        ends.next().unwrap()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Power comes to the node.
fn on(config: &CheckedConfig, has_sensor: bool, drift_ppb: i32) -> Order {
    Order::On {
        at: 0,
        seed: 1,
        drift_ppb,
        has_sensor,
        programmed: node(config).flash,
    }
}

/// Who has no power in the end has done what it did before: it wrote the pins' voltage when it first started.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn what_was_done_is_known_after_a_loss_of_power() {
    let mut process = Process::start();
    let lab = lab();
    for (at, order) in [
        (0, on(&lab.configs.coordinator, false, 0)),
        (5 * S, Order::Off),
        (6 * S, on(&lab.configs.coordinator, false, 0)),
        (11 * S, Order::Off),
    ] {
        let mut run = |orders| process.exchange(&Orders::Run { orders, until: at });
        while run(Vec::new()).reached < at {}
        run(vec![(0, order)]);
    }
    let end = process.end(0);
    println!(
        "{:?} bytes of stack, {:?} of the flash",
        end.stack, end.flash
    );
    assert_eq!(end.forbidden, [""; 0]);
    assert!(end.stack[0] > 1_000 && end.flash[1] > 0 && end.instructions > 100_000);
    // More than either time alone.
    let [received, _] = end.radio_on;
    assert!((5 * S..10 * S).contains(&received), "{received}");
}

/// How long a target stands before it walks, and at what intervals it is told of motion, just before that happens.
const IDLE: u64 = 700 * S;
const EVERY: usize = RATE as usize / 2;

/// How far a target has walked then.
fn walked(drift_ppb: i32) -> f64 {
    let lab = lab();
    let configs = [&lab.configs.coordinator, &lab.configs.targets[0]];
    let mut walker = Walker::new(100);
    walker.act(&[Act::Stand(2.0), Act::Walk(24, 0.0), Act::Stand(12.0)]);
    let Worn(motions) = Worn::by(&walker);
    let moves = |from: usize, at: u64, count: usize| {
        let motions = motions.iter().skip(from).take(count).enumerate();
        let motions = motions.map(|(number, motion)| chip_pipe::Motion {
            at: at + number as u64 * S / RATE as u64,
            acceleration: motion.acceleration,
            angular_rate: motion.angular_rate,
            field: motion.field,
        });
        (1, Order::Moves(motions.collect()))
    };
    let mut process = Process::start();
    let mut orders = vec![
        (0, on(configs[0], false, drift_ppb)),
        (1, on(configs[1], true, drift_ppb)),
        moves(0, 0, 1),
    ];
    let (mut reached, mut known) = (0, 0);
    while known < motions.len() {
        let until = IDLE + known as u64 * S / RATE as u64;
        let told = process.exchange(&Orders::Run {
            orders: core::mem::take(&mut orders),
            until,
        });
        assert!(told.reached >= reached);
        reached = told.reached;
        for (_, from, deed) in told.deeds {
            match deed {
                Deed::Sends(frame, _) => {
                    let reception = Reception {
                        from,
                        level: -50,
                        is_lost: false,
                        is_faint: false,
                        stands_out: true,
                        spoils: Vec::new(),
                    };
                    orders.push((1 - from, Order::Frame(frame, reception)));
                }
                Deed::Fails(why) => panic!("{why}"),
                _ => {}
            }
        }
        if reached >= until {
            orders.push(moves(known, reached + MS, EVERY));
            known += EVERY;
        }
    }
    let end = process.end(1);
    assert_eq!(end.forbidden, [""; 0]);
    let outcome = Outcome {
        flash: end.memory,
        ..Outcome::default()
    };
    let facts = facts(&outcome, configs[1].owner());
    let walk = facts.iter().find_map(|fact| match fact {
        Fact::Walk(walk) => Some(*walk),
        _ => None,
    });
    let place = walk.unwrap().place.position();
    f64::from(place.x).hypot(f64::from(place.y))
}

/// Motion that is told as it happens is felt whole, however long the chip's clock has been wrong: so many steps, and
/// no half of one more or less.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn who_stood_for_long_feels_its_first_steps() {
    let [right, fast, slow] = [0, 500_000, -500_000].map(walked);
    println!("{right} m; {fast} m with a fast clock, {slow} m with a slow one");
    assert!(right > 10.0);
    for wrong in [fast, slow] {
        assert!(
            (wrong / right - 1.0).abs() < 0.02,
            "{wrong} m, not {right} m"
        );
    }
}
