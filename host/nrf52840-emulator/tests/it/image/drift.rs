//! A target whose clock is wrong, and that is told of motion just before that happens, as a simulation does.

use nrf52840_emulator::{Time, device::Samples};

use super::*;

/// Time for which a target stands before it walks, so that a wrong clock is wrong by a third of a step, and the
/// interval at which it is told of motion.
const IDLE: u64 = 300 * S;
const EVERY: usize = RATE as usize / 2;

/// Distance that a target has walked then.
fn walked(drift_ppb: i32, idle: u64) -> f64 {
    let lab = lab();
    let mut walker = Walker::new(100);
    walker.act(&[Act::Stand(2.0), Act::Walk(24, 0.0), Act::Stand(12.0)]);
    let Worn(motions) = Worn::by(&walker);
    let time = Time {
        since: 0,
        drift_ppb,
    };
    let world = Arc::<Samples>::default();
    let tell = |from: usize, at: u64, count: usize| {
        for (number, motion) in motions.iter().skip(from).take(count).enumerate() {
            let at = at + number as u64 * S / RATE as u64;
            let at = time.local(at);
            world.push(at, *motion);
        }
    };
    tell(0, 0, 1);
    let mut network = Network::default();
    let nodes = [
        lab.coordinator(),
        lab.target_in(&(world.clone() as Arc<dyn World>)),
    ];
    for (number, node) in nodes.into_iter().enumerate() {
        let node = Node { drift_ppb, ..node };
        network.switch_on(number, node, 0);
    }
    let mut known = 0;
    while known < motions.len() {
        let until = idle + known as u64 * S / RATE as u64;
        for (_, from, deed) in network.run(until) {
            match deed {
                Deed::Sends(frame) => {
                    network.input(1 - from, Input::Frame(frame, LEVEL.into()));
                }
                Deed::Fails(why) => panic!("{why}"),
                _ => {}
            }
        }
        if network.reached() >= until {
            tell(known, network.reached() + MS, EVERY);
            known += EVERY;
        }
    }
    let outcome = network.switch_off(1).unwrap().unwrap();
    in_order(&outcome);
    let facts = facts(&outcome, lab.configs.targets[0].settings().owner());
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
    let right = walked(0, 0);
    let [fast, slow] = [500_000, -500_000].map(|drift_ppb| walked(drift_ppb, IDLE));
    println!("{right} m; {fast} m with a fast clock, {slow} m with a slow one");
    assert!(right > 10.0);
    for wrong in [fast, slow] {
        assert!(
            (wrong / right - 1.0).abs() < 0.02,
            "{wrong} m, not {right} m"
        );
    }
}
