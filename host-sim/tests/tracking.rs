//! Objects without a radio, tracked by a network that calibrated itself.

use answers::record::{
    RunRecord, Tracking,
    event::{self, Event, What},
};
use host_sim::network::{Onlooker, Options, Simulation, TrackRow};
use site::{ObjectTable, Overrides, Scenario};

struct Run {
    record: RunRecord,
    rows: Vec<TrackRow>,
    events: Vec<Event>,
}

impl Run {
    /// Two objects walk about in the office for so many seconds, or those of the scenario.
    fn office(seed: u64, seconds: f64, objects: Vec<ObjectTable>) -> Self {
        let mut scenario = Scenario::load("office", &Overrides::default()).unwrap();
        scenario.seed = seed;
        scenario.objects = objects;
        let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
        simulation.take_orders();
        simulation.watch();
        let mut onlooker = Onlooker::default();
        let mut events = Vec::new();
        let every = 200_000_000;
        simulation.run_watched(every, |_| (), |s| events.extend(onlooker.look(s)));
        let tracked = simulation.track(seconds, every, |s| events.extend(onlooker.look(s)));
        let (record, rows) = tracked.unwrap();
        events.extend(onlooker.end(&simulation, &record, None));
        let record = RunRecord {
            wall_seconds: None,
            ..record
        };
        Self {
            record,
            rows,
            events,
        }
    }

    fn tracking(&self) -> Tracking {
        assert_eq!(self.record.tracking.len(), 1, "one network");
        self.record.tracking[0]
    }
}

/// Sigmas are tested from both sides: over these walks and calibrations the mean squared error over its
/// covariance is neither far above nor far below the 2 that it is if all is right.
#[test]
fn two_objects_through_an_office_that_calibrated_itself() {
    let runs = [1, 2, 3].map(|seed| Run::office(seed, 60.0, Vec::new()).tracking());
    for run in &runs {
        println!("{run:?}");
        assert_eq!(run.objects, 2);
        assert!(run.rms.unwrap() < 0.4, "{run:?}");
    }
    let mean = |of: fn(&Tracking) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
    assert!(mean(|run| run.covered) > COVERED);
    let nees = mean(|run| run.nees.unwrap());
    assert!((NEES[0]..NEES[1]).contains(&nees), "{nees}");
    assert!(runs.iter().map(|run| run.ghosts).sum::<usize>() <= 1);
}

const COVERED: f64 = 0.8;
const NEES: [f64; 2] = [0.4, 4.0];

/// An object of the scenario goes its way to and fro, and whoever reads the events has the record of it.
#[test]
fn an_object_goes_its_way_and_is_told() {
    let path = vec![[3.0, 3.0], [10.0, 4.0]];
    let object = ObjectTable {
        path: Some(path),
        speed: Some(1.0),
        ..ObjectTable::default()
    };
    let run = Run::office(1, 20.0, vec![object]);
    let tracking = run.tracking();
    assert_eq!((tracking.objects, tracking.ghosts), (1, 0), "{tracking:?}");
    assert!(tracking.covered > 0.95, "{tracking:?}");
    let text: String = run.events.iter().map(|e| e.to_line().unwrap()).collect();
    let events = event::read(text.as_bytes()).unwrap();
    assert_eq!(event::fold(&events).unwrap(), run.record);
    let true_places = events.iter().filter_map(|event| match event.what {
        What::Truth { object, x, y, .. } => Some((object, x, y)),
        _ => None,
    });
    let true_places: Vec<_> = true_places.collect();
    assert!(true_places.iter().all(|(object, ..)| *object == 1));
    // A metre a second, told ten times a second; it turns round once or twice.
    let steps = true_places.windows(2).map(|two| {
        let [(_, ax, ay), (_, bx, by)] = [two[0], two[1]];
        (ax - bx).hypot(ay - by)
    });
    let walked: f64 = steps.sum();
    assert!((18.0..20.5).contains(&walked), "{walked}");
    // What is told of it is where it is.
    let off = run.rows.iter().filter_map(|row| {
        let (_, truth) = row.truth?;
        let ([x, y], _) = row.told?.place;
        Some((f64::from(x) - truth.x).hypot(f64::from(y) - truth.y))
    });
    let off: Vec<f64> = off.collect();
    assert!(off.len() > 150, "{}", off.len());
    let rms = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
    assert!(
        (rms - tracking.rms.unwrap()).abs() < 0.02,
        "{rms} {tracking:?}"
    );
}
