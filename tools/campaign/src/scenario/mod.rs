//! Draws the scenario of a run.
//!
//! Settings that a site would not configure have their shipped defaults. Others, such as the errors of its
//! carrier, are sometimes given and sometimes not.

mod carrier;
mod faults;
mod ground;
mod systematic;

use std::collections::BTreeSet;

use clap::ValueEnum;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use site::{Overrides, PlacedCamera, RadioTable, Scenario, ScenarioError};

/// A mount that moves so often gives way.
const SAGS: usize = 4;

/// Draws until a site can be put up: where no stops can be planned, it is another site.
const TRIES: u64 = 1000;

/// Faults that are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
pub enum Draw {
    /// Faults that come and go; every tenth run has a systematic one besides.
    #[default]
    Daily,
    /// A systematic fault in each run, in buildings as people have them; every other run has nothing else wrong.
    Systematic,
}

impl Draw {
    /// Kinds of faults that a run has: those that come and go, and a systematic one.
    fn kinds(self, number: u64) -> [bool; 2] {
        match self {
            Self::Daily => [true, number % TENTH == TENTH - 1],
            Self::Systematic => [!number.is_multiple_of(2), true],
        }
    }
}

/// One of so many runs of [`Draw::Daily`] has a systematic fault.
const TENTH: u64 = 10;

/// The scenario of a run: complete, with its stops, so that its file needs no more.
///
/// # Panics
/// None of a thousand drawn sites can be put up.
pub fn draw(seed: u64, number: u64, draw: Draw) -> Scenario {
    let of = |attempt| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(number * TRIES + attempt);
        attempted(&mut random, number, draw).ok()
    };
    let drawn = (0..TRIES).find_map(of);
    drawn.unwrap_or_else(|| panic!("no site could be drawn for run {number} of seed {seed}"))
}

/// One that comes about with this probability.
fn happens(random: &mut impl Rng, probability: f64) -> bool {
    random.random_bool(probability)
}

/// Rounds to three digits after the point, as people write files.
fn short(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// Between two numbers, [`short`].
fn between(random: &mut impl Rng, low: f64, high: f64) -> f64 {
    short(random.random_range(low..high))
}

fn attempted(random: &mut ChaCha8Rng, number: u64, draw: Draw) -> Result<Scenario, ScenarioError> {
    let [come_and_go, is_systematic] = draw.kinds(number);
    let text = ground::text(random, number, draw);
    let mut scenario = Scenario::from_toml(&text, &Overrides::default())?;
    scenario.radio = RadioTable::UnitDisk {
        range: 60.0,
        loss: match random.random_range(0..10) {
            _ if !come_and_go => 0.0,
            0..5 => 0.0,
            5..8 => between(random, 0.0, 0.3),
            _ => between(random, 0.3, 0.5),
        },
    };
    carrier::draw(random, &mut scenario, come_and_go);
    let site = scenario.put_up()?;
    // Several rounds: things go wrong in all but the last one and a bit.
    let rounds = random.random_range(3..=4);
    for (target, node) in scenario.networks[0]
        .targets
        .iter_mut()
        .zip(&site.networks[0].targets)
    {
        let round = || node.stops.iter().map(|stop| [short(stop.x), short(stop.y)]);
        target.stops = Some((0..rounds).flat_map(|_| round()).collect());
    }
    if come_and_go {
        faults::draw(random, &mut scenario, rounds);
    }
    if is_systematic {
        let walk_s = faults::walk_s(&scenario);
        systematic::draw(random, &mut scenario, walk_s, draw);
    }
    complete(&scenario)
}

/// As it is read from its own file: a drawn scenario is checked like any other, and the same to the bit.
fn complete(scenario: &Scenario) -> Result<Scenario, ScenarioError> {
    let scenario = Scenario::from_toml(&text(scenario), &Overrides::default())?;
    scenario.put_up()?;
    Ok(scenario)
}

/// A scenario as a file.
///
/// # Panics
/// It cannot be written as TOML, which none is known of.
pub fn text(scenario: &Scenario) -> String {
    toml::to_string(scenario).unwrap_or_else(|error| panic!("a scenario is TOML: {error}"))
}

/// Faults of a scenario, and its unusual properties: each once, in alphabetical order.
pub fn ingredients(scenario: &Scenario) -> BTreeSet<&'static str> {
    let events = faults::names(scenario);
    let sensor = scenario.sensor.unwrap_or_default();
    let unlikely = |bias: f64, believed: f64| bias.abs() > 2.5 * believed;
    let [scale, heading] = carrier::believed(scenario);
    let noise = [sensor.undeclared_distance, sensor.undeclared_heading_deg];
    let references = &scenario.networks[0].references;
    let radio = scenario.radio;
    let network = &scenario.networks[0];
    let models = || network.cameras.iter().filter_map(|camera| camera.model);
    let firmware = &scenario.firmware;
    let shines = |camera: &PlacedCamera| {
        let faults = camera.faults.as_ref();
        faults.is_some_and(|faults| faults.contains_key("merge"))
    };
    let others = [
        (
            models().any(|model| model.field_of_view_deg.is_some()),
            "wrong lens",
        ),
        (
            models().any(|model| model.principal_column.is_some()),
            "wrong centre",
        ),
        (
            scenario.camera.model.field_of_view_deg.is_some(),
            "wrong lenses, all alike",
        ),
        (references.baseline.is_some(), "wrong baseline"),
        (firmware.ball_radius.is_some(), "wrong radius of the ball"),
        (network.cameras.iter().any(shines), "glare beside the ball"),
        (
            matches!(&network.targets[..], [a, b, ..] if a.colour == b.colour),
            "two targets of a colour",
        ),
        (!scenario.camera.faults.is_empty(), "corrupt lines"),
        (
            matches!(radio, RadioTable::UnitDisk { loss, .. } if loss > 0.0),
            "loss",
        ),
        (unlikely(sensor.scale_bias, scale), "undeclared scale"),
        (
            unlikely(sensor.heading_bias_deg, heading),
            "undeclared compass",
        ),
        (noise.iter().any(|noise| *noise > 0.0), "undeclared noise"),
        (firmware.systematic_scale.is_some(), "carrier was measured"),
        (references.elected, "elected references"),
        (references.baseline_known == Some(false), "unknown baseline"),
        (
            references.frame_heading_known == Some(false),
            "unknown frame heading",
        ),
        (scenario.networks[0].targets.len() > 1, "two targets"),
        (!scenario.world.obstacles.is_empty(), "pillars"),
    ];
    let others = others.into_iter().filter(|(is_there, _)| *is_there);
    events.chain(others.map(|(_, name)| name)).collect()
}

fn is_target(scenario: &Scenario, node: u16) -> bool {
    let mut targets = scenario
        .networks
        .iter()
        .flat_map(|network| &network.targets);
    targets.any(|target| target.id == node)
}

fn is_reference(scenario: &Scenario, node: u16) -> bool {
    let mut networks = scenario.networks.iter();
    networks.any(|network| network.references.cameras.contains(&node))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_its_seed_and_number() {
        for number in 0..3 {
            let drawn = draw(7, number, Draw::Daily);
            assert_eq!(drawn, draw(7, number, Draw::Daily));
            let read = Scenario::from_toml(&text(&drawn), &Overrides::default()).unwrap();
            assert_eq!(read, drawn);
            assert_ne!(text(&drawn), text(&draw(8, number, Draw::Daily)));
            assert_ne!(text(&drawn), text(&draw(7, number + 3, Draw::Daily)));
        }
    }

    /// A campaign that forgot a fault would pass in spite of that fault.
    #[test]
    fn everything_goes_wrong_in_some_run() {
        let mut seen = BTreeSet::new();
        for number in 0..200 {
            let text = text(&draw(3, number, Draw::Daily));
            let all = [
                "restart]",
                "power-cut]",
                "in_flash_write = true",
                "jam]",
                "partition]",
                "action.loss]",
                "unplug-camera]",
                "with_power = false",
                "stick-camera]",
                "bump-camera]",
                "slip]",
                "replay]",
                "forge]",
                "rest]",
                "ignore-lamp]",
                "rot]",
                "corrupt_line",
                "undeclared_distance",
                "undeclared_heading_deg",
                "scale_bias",
                "heading_bias_deg",
                "elected = true",
                "baseline_known = false",
                "systematic_scale",
                "pillar",
            ];
            seen.extend(all.into_iter().filter(|fault| text.contains(fault)));
            if seen.len() == all.len() {
                return;
            }
        }
        panic!("only {seen:?}");
    }

    /// Each systematic fault alone and with others, and no other fault where it is alone.
    #[test]
    fn every_fact_is_wrong_in_some_run() {
        let all = BTreeSet::from(SYSTEMATIC);
        let mut alone = BTreeSet::new();
        let mut with_others = BTreeSet::new();
        for number in 0..200 {
            let drawn = draw(3, number, Draw::Systematic);
            let seen = ingredients(&drawn);
            let systematic = seen.intersection(&all).copied();
            if number % 2 == 0 {
                assert!(drawn.events.len() <= 12 && drawn.camera.faults.is_empty());
                alone.extend(systematic);
            } else {
                with_others.extend(systematic);
            }
        }
        assert_eq!(alone, all);
        assert_eq!(with_others, all);
    }

    const SYSTEMATIC: [&str; 8] = [
        "wrong lens",
        "wrong lenses, all alike",
        "wrong centre",
        "wrong baseline",
        "sagging mount",
        "wrong radius of the ball",
        "two targets of a colour",
        "glare beside the ball",
    ];
}
