//! Faults of the sensors on the I2C bus. Each walk is beside the same one with chips that are right.

use nrf52840_emulator::device::{Chip, Lis3mdl, Lsm6dsox, NOT_ACKNOWLEDGED};

use super::*;

/// Does not acknowledge its reset while its FIFO streams. Some obey all the same.
#[derive(Debug)]
struct RefusesReset {
    chip: Lsm6dsox,
    streams: bool,
    obeys: bool,
}

impl Chip for RefusesReset {
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str> {
        match *bytes {
            [0x0a, mode] => self.streams = mode & 7 != 0,
            [0x12, value] if value & 1 != 0 && self.streams => {
                if self.obeys {
                    self.streams = false;
                    self.chip.write(bytes, now)?;
                }
                return Err(NOT_ACKNOWLEDGED);
            }
            _ => {}
        }
        self.chip.write(bytes, now)
    }

    fn read(&mut self, into: &mut [u8], now: u64) {
        self.chip.read(into, now);
    }
}

/// At these instants the next byte is not acknowledged, or a register gets another value.
#[derive(Debug)]
struct Disturbed<C> {
    chip: C,
    refuses_at: Vec<u64>,
    changes_at: Option<(u64, [u8; 2])>,
}

impl<C: Chip> Chip for Disturbed<C> {
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str> {
        if let Some((_, change)) = self.changes_at.take_if(|(at, _)| now >= *at) {
            self.chip.write(&change, now)?;
        }
        if self.refuses_at.first().is_some_and(|at| now >= *at) {
            self.refuses_at.remove(0);
            return Err(NOT_ACKNOWLEDGED);
        }
        self.chip.write(bytes, now)
    }

    fn read(&mut self, into: &mut [u8], now: u64) {
        self.chip.read(into, now);
    }
}

fn motion(world: &Arc<dyn World>) -> Lsm6dsox {
    Lsm6dsox::new(Arc::clone(world), 1)
}

fn compass(world: &Arc<dyn World>) -> Lis3mdl {
    Lis3mdl::new(Arc::clone(world), 2)
}

type Chips = (Box<dyn Chip>, Box<dyn Chip>);

/// Where a carrier's walk is told to have led, metres.
fn led(walker: &Walker, make: impl FnOnce(&Arc<dyn World>) -> Chips) -> [f64; 2] {
    let lab = lab();
    let worn = Worn::by(walker);
    let ends = worn.ends();
    let world: Arc<dyn World> = Arc::new(worn);
    let (motion, compass) = make(&world);
    let target = Node {
        chips: [(Lsm6dsox::ADDRESS, motion), (Lis3mdl::ADDRESS, compass)].into(),
        ..lab.target()
    };
    let (outcomes, _) = run(vec![lab.coordinator(), target], ends, everybody).unwrap();
    outcomes.iter().for_each(in_order);
    let facts = facts(&outcomes[1], lab.configs.targets[0].settings().owner());
    let walk = facts.iter().find_map(|fact| match fact {
        Fact::Walk(walk) => Some(*walk),
        _ => None,
    });
    let place = walk.map(|walk| walk.place.position()).unwrap_or_default();
    [place.x.into(), place.y.into()]
}

fn beside(what: &str, walker: &Walker, make: impl FnOnce(&Arc<dyn World>) -> Chips) -> f64 {
    let place = led(walker, make);
    let right = led(walker, |world| {
        (Box::new(motion(world)), Box::new(compass(world)))
    });
    assert!(right[0].hypot(right[1]) > 10.0, "{right:?}");
    let off = (place[0] - right[0]).hypot(place[1] - right[1]);
    println!("{what}: {place:.1?} m, {off:.2} m beside");
    off
}

fn straight() -> Walker {
    let mut walker = Walker::new(100);
    walker.act(&[Act::Stand(12.0), Act::Walk(24, 0.0), Act::Stand(12.0)]);
    walker
}

/// The board was restarted, and its sensor was not.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_reset_is_not_acknowledged() {
    for obeys in [true, false] {
        let off = beside("reset", &straight(), |world| {
            let mut chip = motion(world);
            let settings = [
                [0x18, 0xe2],
                [0x12, 0x44],
                [0x09, 0x33],
                [0x0a, 0x06],
                [0x10, 0x3c],
                [0x11, 0x34],
            ];
            for setting in settings {
                chip.write(&setting, 1).unwrap();
            }
            let chip = RefusesReset {
                chip,
                streams: true,
                obeys,
            };
            (Box::new(chip), Box::new(compass(world)))
        });
        assert!(off < 0.5, "{off} m beside");
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn transfers_fail_while_it_walks() {
    let all = (0..300).map(|number| (5 + number / 10) * S + number % 10 * 97 * MS);
    for refuses_at in [vec![5 * S], vec![16 * S], vec![22 * S], all.collect()] {
        let off = beside("refused", &straight(), |world| {
            let chip = Disturbed {
                chip: motion(world),
                refuses_at,
                changes_at: None,
            };
            (Box::new(chip), Box::new(compass(world)))
        });
        assert!(off < 0.5, "{off} m beside");
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn an_lsm6dso32_is_in_its_place() {
    let off = beside("LSM6DSO32", &straight(), |world| {
        let mut chip = motion(world);
        chip.is_32 = true;
        (Box::new(chip), Box::new(compass(world)))
    });
    assert!(off < 0.5, "{off} m beside");
}

/// To 16 gauss, before a walk and within it.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_compass_changes_its_range() {
    let mut walker = Walker::new(100);
    walker.act(&[
        Act::Stand(12.0),
        Act::Walk(24, 0.0),
        Act::Stand(3.0),
        Act::Turn(1.5, 3.0),
        Act::Stand(3.0),
        Act::Walk(24, 0.0),
        Act::Stand(12.0),
    ]);
    for at in [5, 20] {
        let off = beside("compass", &walker, |world| {
            let chip = Disturbed {
                chip: compass(world),
                refuses_at: vec![],
                changes_at: Some((at * S, [0x21, 0x60])),
            };
            (Box::new(motion(world)), Box::new(chip))
        });
        assert!(off < 1.0, "{off} m beside");
    }
}
