//! Rooms whose references stand anywhere: what people are told is in the frame of the site's file, and a next stop is
//! a place where a person can stand.

use calib_core::Status;
use host_sim::network::{FurtherEnd, Options, Simulation};
use results::{
    export::Frame,
    record::{
        Place, RunRecord,
        verdict::{Common, Gained, Instead, Verdict},
    },
    report::run::run_report,
};
use site::{Overrides, Scenario};

/// A person who was not measured.
pub(super) const CARRIER: &str = "
    [firmware]
    systematic_heading_deg = 3.0
    systematic_scale = 0.08
    [sensor]
    measures = true
    scale_bias = -0.032
    heading_bias_deg = -0.97
    leg_distance = 0.02
    leg_heading_deg = 1.0
    [walk]
    speed = 0.8
    step_length = 0.6
";

/// A room of this size with these cameras: `(x, y, heading)`. The lenses see 45 degrees.
fn room(size: [f64; 2], cameras: &[(f64, f64, f64)], lens: &str) -> String {
    let [width, height] = size;
    let cameras = cameras.iter().zip(1..).map(|((x, y, heading), id)| {
        format!("{{ id = {id}, x = {x}, y = {y}, heading_deg = {heading} }},")
    });
    format!(
        "name = \"room\"
        unit = \"m\"
        [camera]
        field_of_view_deg = 45
        {lens}
        projection = \"pin-hole\"
        {CARRIER}
        [world]
        low = [0, 0]
        high = [{width:.1}, {height:.1}]
        [[network]]
        references = {{ cameras = [1, 2] }}
        camera = [{}]
        target = [{{ id = 50, radius = 0.1 }}]",
        cameras.collect::<String>()
    )
}

/// Two references in a corner, turned by 219 degrees.
fn turned() -> String {
    let cameras = [
        (6.0, 5.48, 209.0),
        (6.0, 4.48, 173.0),
        (1.63, 0.0, 39.0),
        (6.0, 1.15, 180.0),
    ];
    room([6.0, 6.0], &cameras, "")
}

/// Cameras along a corridor, which see one another's places only.
fn corridor() -> String {
    let cameras: Vec<_> = (0..8)
        .map(|n| (4.0 * f64::from(n), 0.1, 180.0 * f64::from(n % 2)))
        .collect();
    room([28.0, 2.0], &cameras, "")
}

/// The corridor with a carrier whose legs err by scale and compass alone, which no stop there tells.
fn corridor_of_biased_legs() -> String {
    { corridor().replace("scale_bias = -0.032", "scale_bias = 0.05") }
        .replace("heading_bias_deg = -0.97", "heading_bias_deg = -2.0")
        .replace("leg_distance = 0.02", "")
        .replace("leg_heading_deg = 1.0", "")
}

/// A room whose cameras have other lenses than the file says.
fn other_lenses() -> String {
    let cameras = [
        (0.0, 0.0, 45.0),
        (8.0, 0.0, 135.0),
        (8.0, 5.0, 225.0),
        (0.0, 5.0, 315.0),
        (4.0, 0.0, 90.0),
        (4.0, 5.0, 270.0),
    ];
    room([8.0, 5.0], &cameras, "model = { field_of_view_deg = 52.0 }")
}

fn run(site: &str, seed: u64, further_stops: usize) -> (RunRecord, usize, Option<FurtherEnd>) {
    let mut scenario = Scenario::from_toml(site, &Overrides::default()).unwrap();
    scenario.seed = seed;
    let options = Options {
        further_stops,
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    (record, simulation.further_stops(), simulation.further_end())
}

/// Protection levels of the places of all cameras that have one.
fn levels(record: &RunRecord) -> Vec<f64> {
    let told = record.cameras().filter_map(|camera| camera.protection);
    told.map(|level| level.position).collect()
}

/// Every stop that is asked for is inside the world, and in view of the cameras that it names.
#[test]
fn a_next_stop_is_a_place_where_a_person_can_stand() {
    let mut asked = 0;
    for (site, [width, height]) in [(turned(), [6.0, 6.0]), (corridor(), [28.0, 2.0])] {
        for seed in 1..=4 {
            let (record, ..) = run(&site, seed, 0);
            let verdict = Verdict::of(&record);
            for stop in &verdict.next_stops {
                asked += 1;
                let [x, y] = verdict.told_place(stop.network, [stop.x, stop.y]);
                assert!(
                    (0.0..=width).contains(&x) && (0.0..=height).contains(&y),
                    "{verdict}"
                );
                for id in &stop.seen_by {
                    let camera = record.cameras().find(|camera| camera.id == *id).unwrap();
                    // A doubtful pose is not believed: such a camera is where it was put.
                    let is_believed = camera.status != Some(Status::Doubtful);
                    let believed = camera.estimate.filter(|_| is_believed);
                    let pose = believed.map(|pose| Place::new(pose.x, pose.y, pose.heading_deg));
                    let pose = pose.or(camera.truth).unwrap();
                    let view = camera.view.unwrap();
                    let (dx, dy) = (stop.x - pose.x, stop.y - pose.y);
                    let off = (dy.atan2(dx).to_degrees() - pose.heading_deg).rem_euclid(360.0);
                    assert!(
                        off.min(360.0 - off) <= view.fov_deg / 2.0,
                        "camera {id}: {verdict}"
                    );
                    assert!(dx.hypot(dy) <= view.range, "camera {id}: {verdict}");
                }
                if let Some(gain) = stop.helps {
                    assert!(gain.to > 0.0 && gain.from > 0.0, "{verdict}");
                    assert!(
                        gain.of == Gained::Protection || gain.to <= gain.from,
                        "{verdict}"
                    );
                }
            }
        }
    }
    assert!(asked > 0);
}

/// The verdict, the table and exports tell places as the site's file does.
#[test]
fn people_are_told_places_as_the_file_tells_them() {
    let (record, ..) = run(&turned(), 1, 0);
    assert_eq!(Frame::for_people(&record), Frame::Building);
    let verdict = Verdict::of(&record);
    // The first reference is the origin of the network, and at (6, 5.48) in the room.
    let [x, y] = verdict.told_place(1, [0.0, 0.0]);
    assert!((x - 6.0).abs() < 1e-9 && (y - 5.48).abs() < 1e-9);
    let [x, y] = verdict.told_place(1, [1.0, 0.0]);
    assert!((x - 6.0).abs() < 1e-9 && (y - 4.48).abs() < 1e-9);
    let shown = record.for_people();
    for (id, [x, y], heading) in [(3, [1.63, 0.0], 39.0), (4, [6.0, 1.15], 180.0)] {
        let camera = shown.cameras().find(|camera| camera.id == id).unwrap();
        let truth = camera.truth.unwrap();
        assert!(
            (truth.x - x).hypot(truth.y - y) < 1e-6,
            "camera {id}: {truth:?}"
        );
        assert!(
            (truth.heading_deg - heading).abs() < 1e-6,
            "camera {id}: {truth:?}"
        );
    }
    let report = run_report(&record);
    assert!(
        report.contains("in the frame of the site's file"),
        "{report}"
    );
    // The outline of the room is that of the file.
    let corners: Vec<_> = shown
        .area
        .iter()
        .map(|corner| corner.map(f64::round))
        .collect();
    assert_eq!(corners, [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]]);
}

/// Where the next stop helps no camera, the remedies are named at once; a verdict never asks for stops of which the
/// last ones improved nothing.
#[test]
fn remedies_are_named_where_no_stop_helps() {
    let (before, ..) = run(&corridor_of_biased_legs(), 1, 0);
    let (record, made, end) = run(&corridor_of_biased_legs(), 1, 24);
    let verdict = Verdict::of(&record);
    // Each stop that is made is worth it: what one wrong measurement could do falls by far.
    let (begun, ended) = (levels(&before), levels(&record));
    let fell = ended.iter().zip(&begun).map(|(to, from)| to / from);
    let worst = fell.fold(0.0, f64::max);
    assert!(
        made <= 3 || worst < 0.6,
        "{worst}: {made} {end:?} {verdict}"
    );
    assert_eq!(verdict.next_stops, [], "{end:?} {verdict}");
    let carrier = |instead: &Instead| matches!(instead, Instead::Carrier(50, _));
    let references = |instead: &Instead| matches!(instead, Instead::References(..));
    assert!(verdict.instead.iter().any(carrier), "{verdict}");
    assert!(verdict.instead.iter().any(references), "{verdict}");
    let is_tape = |instead: &Instead| matches!(instead, Instead::Tape { target: 50, .. });
    assert!(verdict.instead.iter().any(is_tape), "{verdict}");
    for instead in &verdict.instead {
        assert!(instead.gain().to < 0.95 * instead.gain().from, "{verdict}");
    }
    // The same record, had the last stops been in vain.
    let (mut record, ..) = run(&corridor(), 1, 0);
    assert!(!Verdict::of(&record).next_stops.is_empty());
    record.stops_in_vain = true;
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.next_stops, [], "{verdict}");
    assert!(!verdict.instead.is_empty(), "{verdict}");
    let text = verdict.to_string();
    assert!(
        text.contains("The last stops improved nothing. These changes would help:"),
        "{text}"
    );
}

/// Where no stop helps, one more camera between two others is named with what it is worth.
#[test]
fn one_more_camera_is_named_where_it_helps() {
    let (mut record, ..) = run(&corridor(), 1, 0);
    record.stops_in_vain = true;
    let verdict = Verdict::of(&record);
    let is_it = |instead: &&Instead| matches!(instead, Instead::Camera(..));
    let found = verdict.instead.iter().find(is_it);
    let gain = found
        .map(Instead::gain)
        .unwrap_or_else(|| panic!("{verdict}"));
    assert!(gain.to < 0.95 * gain.from, "{verdict}");
}

/// A hallway with cameras along one wall, whose carrier knows its way badly: what ties them are the stops that the
/// references saw from near by.
const HALLWAY: &str = r#"
    name = "hallway"
    unit = "m"
    [camera]
    projection = "pin-hole"
    field_of_view_deg = 60
    [firmware]
    systematic_heading_deg = 3.0
    systematic_scale = 0.08
    [sensor]
    measures = true
    scale_bias = 0.05
    heading_bias_deg = -2.0
    [world]
    low = [-1.0, 0.0]
    high = [15.0, 2.0]
    [[network]]
    references = { cameras = [1, 2] }
    camera = [
      { id = 1, x = 0.0, y = 0.0, heading_deg = 60.0 },
      { id = 2, x = 2.0, y = 0.0, heading_deg = 120.0 },
      { id = 3, x = 4.0, y = 0.0, heading_deg = 60.0 },
      { id = 4, x = 6.0, y = 0.0, heading_deg = 120.0 },
      { id = 5, x = 8.0, y = 0.0, heading_deg = 60.0 },
      { id = 6, x = 10.0, y = 0.0, heading_deg = 120.0 },
      { id = 7, x = 12.0, y = 0.0, heading_deg = 60.0 },
      { id = 8, x = 14.0, y = 0.0, heading_deg = 120.0 },
    ]
    target = [{ id = 20 }]
"#;

/// Going on as the verdict asks is at least as good as a walk that was planned to check every pose.
#[test]
fn stops_that_are_asked_for_check_as_much_as_planned_ones() {
    let worst = |record: &RunRecord| levels(record).into_iter().fold(0.0, f64::max);
    let planned = HALLWAY.replace("unit =", "placement = \"checked\"\n unit =");
    for seed in 1..=4 {
        let (before, ..) = run(HALLWAY, seed, 0);
        let (planned, ..) = run(&planned, seed, 0);
        let (asked, made, _) = run(HALLWAY, seed, 24);
        let checked = [&planned, &asked].map(|record| Verdict::of(record).checked);
        let told = [&before, &planned, &asked].map(worst);
        assert!(checked[0] <= checked[1], "{seed}: {checked:?} {told:?}");
        assert!(
            made > 0 && told[2] < 0.8 * told[0],
            "{seed}: {made} {told:?}"
        );
        let verdict = Verdict::of(&asked);
        assert!(
            verdict.is_checked() || !verdict.next_stops.is_empty() || !verdict.instead.is_empty(),
            "{verdict}"
        );
    }
}

/// No stop is made where that improves nothing, and the verdict says what would help.
#[test]
fn no_stop_is_made_in_vain() {
    let (record, made, end) = run(&corridor(), 1, 24);
    let verdict = Verdict::of(&record);
    if made == 24 {
        // The second half of them still lowers what one wrong measurement could do.
        let all = |record| -> f64 { levels(record).into_iter().map(f64::ln).sum() };
        let (half, ..) = run(&corridor(), 1, 12);
        assert!(all(&record) < all(&half) - 0.5, "{end:?} {verdict}");
    }
    if !verdict.is_checked() && verdict.next_stops.is_empty() {
        assert!(!verdict.instead.is_empty(), "{verdict}");
    }
    let (record, made, _) = run(&other_lenses(), 1, 24);
    let verdict = Verdict::of(&record);
    assert!(
        verdict
            .common
            .iter()
            .any(|common| matches!(common, Common::Lens(_))),
        "{verdict}"
    );
    assert_eq!((made, verdict.next_stops.len()), (0, 0), "{verdict}");
}
