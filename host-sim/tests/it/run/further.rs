//! A carrier that walks on to the stops that the verdict asks for.

use host_sim::network::{Options, Simulation};
use results::{
    network,
    record::{
        RunRecord,
        verdict::{Common, Gain, Gained, Trouble, Verdict, Weakness},
    },
};
use site::{Overrides, Scenario};

use crate::common::{Files, run};

/// Two places 20 units apart: at the first one the references look, at the second one two cameras. Only
/// one leg ties them.
const TWO_PLACES: &str = r#"
    name = "two places"
    stops = 3

    [world]
    low = [-2.0, -2.0]
    high = [34.0, 12.0]

    [camera]
    projection = "pin-hole"
    field_of_view_deg = 60.0
    field_of_view_sigma = 0
    principal_sigma = 0
    tilt_sigma_deg = 0

    [sensor]
    measures = true
    leg_distance = 0.005
    leg_heading_deg = 0.3

    [firmware]
    systematic_scale = 0.005
    systematic_heading_deg = 0.3

    [[network]]
    references = { cameras = [1, 2], baseline_sigma = 0, position_sigma = 0 }
    camera = [
      { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
      { id = 2, x = 10.0, y = 0.0, heading_deg = 135.0 },
      { id = 3, x = 20.0, y = 0.0, heading_deg = 45.0 },
      { id = 4, x = 30.0, y = 0.0, heading_deg = 135.0 },
    ]

    [[network.target]]
    id = 20
    stops = [
      [4.6, 3.4], [6.6, 4.4], [5.0, 6.0], [3.2, 4.0],
      [25.0, 2.6], [23.6, 4.2], [26.4, 4.2], [25.0, 6.2], [25.0, 4.4], [24.0, 3.2],
    ]
"#;

/// Runs a site with so many further stops at most; returns how many were made.
fn walked(site: &str, further_stops: usize) -> (RunRecord, usize) {
    walked_from(
        Scenario::from_toml(site, &Overrides::default()).unwrap(),
        further_stops,
    )
}

fn walked_from(scenario: Scenario, further_stops: usize) -> (RunRecord, usize) {
    let options = Options {
        further_stops,
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    (record, simulation.further_stops())
}

/// The largest protection level of all places when the network is solved again by the estimator.
fn solved_again(record: &RunRecord) -> f64 {
    let settings = network::Settings::default();
    let solved = network::solve(&record.sightings[0], &settings).unwrap();
    let levels = solved[0]
        .cameras
        .iter()
        .filter_map(|camera| camera.protection);
    levels.map(|level| level.position).fold(0.0, f64::max)
}

#[test]
fn a_leg_that_ties_two_places_alone_is_walked_back_across() {
    let (record, made) = walked(TWO_PLACES, 0);
    let verdict = Verdict::of(&record);
    assert_eq!(
        (made, verdict.calibrated, verdict.exit_code()),
        (0, 4, 0),
        "{verdict}"
    );
    assert_eq!((verdict.checked, verdict.checkable), (0, 2));
    for found in &verdict.findings {
        let by_leg = Weakness::Leg {
            target: 20,
            from: 4,
            to: 5,
        };
        assert!(
            matches!(found.trouble, Trouble::Unchecked { weakness: Some(by), .. } if by == by_leg),
            "{verdict}"
        );
    }
    assert!(
        verdict
            .to_string()
            .contains("the weakest measurement is the leg from (3.2, 4.0) to (25.0, 2.6)"),
        "{verdict}"
    );
    // Back to the place at which the references look.
    let [stop, ..] = verdict.next_stops.as_slice() else {
        panic!("{verdict}");
    };
    assert!(
        stop.x < 10.0 && stop.seen_by.iter().all(|id| *id < 3),
        "{verdict}"
    );
    assert!(stop.again.is_some_and(|again| again <= 4));
    assert!(solved_again(&record) > 10.0);

    let (record, made) = walked(TWO_PLACES, 24);
    let verdict = Verdict::of(&record);
    assert!(verdict.is_checked() && verdict.is_complete(), "{verdict}");
    assert!((1..=8).contains(&made), "{made}");
    assert_eq!(record.targets[0].stops.len(), 10 + made);
    assert_eq!(verdict.next_stops, []);
    assert!(solved_again(&record) < 3.0, "{}", solved_again(&record));
}

/// A second network has its frame from the first one's target, which makes no joint estimates from then
/// on.
const GUESTS: &str = r#"
    name = "guests"

    [world]
    low = [-2.0, -2.0]
    high = [34.0, 12.0]

    [camera]
    projection = "pin-hole"
    field_of_view_deg = 60.0
    field_of_view_sigma = 0
    principal_sigma = 0
    tilt_sigma_deg = 0

    [sensor]
    measures = true

    [firmware]
    systematic_scale = 0.03
    systematic_heading_deg = 1.5

    [[network]]
    references = { cameras = [1, 2], baseline_sigma = 0, position_sigma = 0 }
    camera = [
      { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
      { id = 2, x = 8.0, y = 0.0, heading_deg = 135.0 },
      { id = 3, x = 4.0, y = 8.0, heading_deg = -90.0 },
    ]
    target = [{ id = 40 }]

    [[network]]
    channel = 20
    references = { cameras = [21, 22], frame_of = 1 }
    camera = [
      { id = 21, x = 12.0, y = 0.0, heading_deg = 45.0 },
      { id = 22, x = 20.0, y = 0.0, heading_deg = 135.0 },
      { id = 23, x = 16.0, y = 8.0, heading_deg = -90.0 },
    ]
"#;

#[test]
fn a_target_that_left_a_network_is_not_led_on_in_vain() {
    let scenario = Scenario::from_toml(GUESTS, &Overrides::default()).unwrap();
    let options = Options {
        further_stops: 24,
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    let verdict = Verdict::of(&record);
    assert!(verdict.is_complete() && !verdict.is_checked(), "{verdict}");
    assert_eq!(simulation.further_stops(), 0);
    assert_eq!(verdict.common, [Common::UncheckedGuests(2)]);
    let text = verdict.to_string();
    let why = "No pose is checked in network 2: it has no references, and a target that brings";
    assert!(text.contains(why), "{text}");
    // A camera keeps fewer sightings, or more, than a target counts: it tells which ones its pose rests on.
    for camera in record.cameras() {
        assert!(camera.used <= camera.sightings, "camera {}", camera.id);
        assert!(camera.sightings <= 6, "camera {}", camera.id);
    }
}

/// Their network has no target of its own.
#[test]
fn a_target_is_led_to_guests_that_are_weak() {
    let (key, limits) = (
        "[firmware]",
        "weak_sigma = 0.12\n    good_enough_position = 0.05",
    );
    assert!(GUESTS.contains(key));
    let strict = GUESTS.replace(key, &format!("{key}\n    {limits}"));
    let (record, made) = walked(&strict, 2);
    let weak = record.cameras().filter(|camera| !camera.is_calibrated());
    let weak: Vec<_> = weak.map(|camera| camera.id).collect();
    assert!(made > 0, "{weak:?}");
    assert!(weak.iter().all(|id| *id > 20), "{weak:?}");
    // It went there.
    let last = record.targets[0].stops.last().unwrap();
    assert!(last.x > 10.0, "{last:?}");
}

#[test]
fn no_more_stops_are_made_than_are_allowed() {
    let (record, made) = walked(TWO_PLACES, 1);
    assert_eq!((made, record.targets[0].stops.len()), (1, 11));
}

/// The room of the page about deployment: nodes tell what the stop that is asked for was to improve.
#[test]
fn a_stop_improves_what_was_foretold() {
    let page = include_str!("../../../../docs/deploy.md");
    let (_, room) = page.split_once("```toml\nname = \"room\"").unwrap();
    let (room, _) = room.split_once("```").unwrap();
    let room = format!("name = \"room\"{room}");
    let (before, _) = walked(&room, 0);
    let verdict = Verdict::of(&before);
    let [asked, ..] = verdict.next_stops.as_slice() else {
        panic!("{verdict}");
    };
    let gain = asked.helps.expect("a foretold gain");
    assert!(
        gain.of == Gained::Protection && gain.to < 0.7 * gain.from,
        "{verdict}"
    );
    let (after, made) = walked(&room, 1);
    assert_eq!(made, 1);
    assert_foretold(gain, &after, &verdict);
    // The network of the thesis: from 13 units to a tenth of that.
    let thesis = || Scenario::load("thesis-13", &Overrides::default()).unwrap();
    let (before, _) = walked_from(thesis(), 0);
    let verdict = Verdict::of(&before);
    let gain = verdict.next_stops[0].helps.expect("a foretold gain");
    assert!(gain.to < 0.2 * gain.from, "{verdict}");
    let (after, _) = walked_from(thesis(), 1);
    assert_foretold(gain, &after, &verdict);
}

/// The protection level of the camera that a stop is for is about what was foretold.
fn assert_foretold(gain: Gain, after: &RunRecord, verdict: &Verdict) {
    let camera = after.cameras().find(|camera| camera.id == gain.camera);
    let level = camera.unwrap().protection.unwrap().position;
    assert!((level / gain.to - 1.0).abs() < 0.1, "{level}, {verdict}");
}

/// A run that needs no further stops is the same as before.
#[test]
fn nothing_changes_where_nothing_is_asked_for() {
    let files = Files::new();
    let [one, other] = ["plain.json", "until.json"].map(|name| files.path(name));
    let plain = run(&["run", "lab", "--json", &one]);
    let until = run(&["run", "lab", "--json", &other, "--until-calibrated"]);
    assert_eq!((plain.code, until.code), (0, 0));
    assert!(until.stderr.contains("0 further stops"), "{}", until.stderr);
    assert!(
        plain
            .stdout
            .contains("5 of 5 poses are checked; nothing is left to do")
    );
    let [one, other] = [one, other].map(|path| std::fs::read(path).unwrap());
    assert!(one == other);
}

#[test]
fn an_option_alone_is_refused() {
    let alone = run(&["run", "lab", "--further-stops", "3"]);
    assert_eq!(alone.code, 2);
    assert!(
        alone.stderr.contains("--until-calibrated"),
        "{}",
        alone.stderr
    );
}
