//! Events of a run: they add up to its record.

use host_sim::network::{Onlooker, Options, Simulation};
use results::record::{
    RunRecord,
    event::{self, Event, News, What},
    verdict::Verdict,
};
use site::{Action, Overrides, Scenario};

/// A run with its events, looked at this often, nanoseconds.
fn watched(name: &str, every: u64, act: Option<(f64, Action)>) -> (RunRecord, Vec<Event>) {
    let scenario = Scenario::load(name, &Overrides::default()).unwrap();
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    simulation.watch();
    let mut onlooker = Onlooker::default();
    let mut events = Vec::new();
    let mut act = act;
    let record = simulation.run_watched(
        every,
        |_| (),
        |simulation| {
            events.extend(onlooker.look(simulation));
            if let Some((_, action)) = act.take_if(|(at, _)| simulation.seconds() >= *at) {
                simulation.act(action);
            }
        },
    );
    events.extend(onlooker.end(&simulation, &record, None));
    let record = RunRecord {
        wall_seconds: None,
        ..record
    };
    (record, events)
}

/// The events after writing and reading their text.
fn written(events: &[Event]) -> Vec<Event> {
    let text: String = events
        .iter()
        .map(|event| event.to_line().unwrap())
        .collect();
    event::read(text.as_bytes()).unwrap()
}

#[test]
fn events_come_to_the_record_of_the_same_run_that_nobody_watched() {
    let scenario = Scenario::load("thesis-13", &Overrides::default()).unwrap();
    let mut unwatched = Simulation::new(scenario, Options::default()).unwrap();
    let unwatched = RunRecord {
        wall_seconds: None,
        ..unwatched.run(|_| ())
    };
    let (record, events) = watched("thesis-13", 200_000_000, None);
    assert_eq!(record, unwatched, "looking changes nothing");
    let events = written(&events);
    let folded = event::fold(&events).unwrap();
    assert_eq!(folded, record);
    assert_eq!(Verdict::of(&folded), Verdict::of(&record));

    assert!(
        events.is_sorted_by(|a, b| a.seconds <= b.seconds + 0.2),
        "in their order"
    );
    let count = |is: fn(&What) -> bool| events.iter().filter(|event| is(&event.what)).count();
    let stops: usize = record.targets.iter().map(|target| target.stops.len()).sum();
    assert_eq!(
        count(|what| matches!(what, What::Stop { begins: true, .. })),
        stops
    );
    assert_eq!(
        count(|what| matches!(what, What::StopEnds { .. })),
        stops - 1
    );
    let joined =
        |what: &What| matches!(what, What::Node { news, .. } if news.contains(&News::Joined));
    assert_eq!(count(joined), 14, "13 cameras and the target");
    assert!(count(|what| matches!(what, What::Seen { .. })) >= 3 * 11);
    // The last verdict is that of the run.
    let verdicts = events.iter().rev().find_map(|event| match &event.what {
        What::Verdict { words, good, .. } => Some((words.clone(), *good)),
        _ => None,
    });
    let verdict = Verdict::of(&record);
    let words = verdict.to_string().trim_end().to_owned();
    assert_eq!(verdicts, Some((words, verdict.is_good())));
}

#[test]
fn what_somebody_does_is_told() {
    let bump = Action::BumpCamera {
        node: 3,
        by: [0.5, 0.0],
        turn_deg: 10.0,
    };
    let (record, events) = watched("lab", 500_000_000, Some((20.0, bump)));
    assert_eq!(event::fold(&written(&events)).unwrap(), record);
    let said = events.iter().find_map(|event| match &event.what {
        What::Said {
            node: Some(3),
            words,
        } => Some(words.as_str()),
        _ => None,
    });
    assert_eq!(said, Some("has its camera moved"));
    let moved = events.iter().any(|event| {
        matches!(&event.what, What::Node { news, is } if is.id == 3 && news.contains(&News::Moved))
    });
    assert!(moved);
}

#[test]
fn a_record_becomes_events_that_come_to_it() {
    let (record, _) = watched("lab", 6_000_000_000, None);
    let events = written(&event::of_record(&record, None));
    assert_eq!(event::fold(&events).unwrap(), record);
    let stops = events
        .iter()
        .filter(|e| matches!(e.what, What::Stop { .. }))
        .count();
    assert!(stops > 3, "{stops}");
    let half = event::fold(
        events
            .iter()
            .filter(|e| e.seconds <= record.sim_seconds / 2.0),
    );
    let half = half.unwrap();
    assert!(half.targets[0].stops.len() < record.targets[0].stops.len());
}

#[test]
fn what_is_no_stream_is_refused_and_a_cut_line_left_out() {
    let (_, events) = watched("lab", 6_000_000_000, None);
    let text: String = events
        .iter()
        .map(|event| event.to_line().unwrap())
        .collect();
    let cut = event::read(&text.as_bytes()[..text.len() - 10]).unwrap();
    assert_eq!(cut.len(), events.len() - 1);
    let damaged = text.replacen('\n', "\n}", 1);
    let refused = event::read(damaged.as_bytes()).unwrap_err().to_string();
    assert_eq!(refused, "line 2 is no event: it is no JSON");
    assert!(event::read(&b"{\"seconds\":1,\"event\":\"stop_ends\",\"target\":1}\n"[..]).is_err());
    let newer = text.replacen("\"events\":1", "\"events\":2", 1);
    let refused = event::read(newer.as_bytes()).unwrap_err().to_string();
    assert!(refused.contains("format 2"), "{refused}");
}

/// Names and their meaning are an interface: format 1.
#[test]
fn lines_of_format_1_stay_as_they_are() {
    let lines = r#"
{"seconds":1.5,"event":"gone","node":3}
{"seconds":1.5,"event":"network","is":{"network":1,"frame":{"x":0.0,"y":0.0,"heading_deg":0.0},"building":null,"pan":291,"channel":15}}
{"seconds":1.5,"event":"obstacles","outlines":[[[0.0,1.0],[2.0,1.0]]]}
{"seconds":1.5,"event":"stop","target":20,"begins":true,"is":{"stop":1,"seconds":1.5,"x":2.0,"y":3.0,"believed":{"x":2.1,"y":2.9,"sigma_x":0.1,"sigma_y":0.2}}}
{"seconds":1.5,"event":"stop_ends","target":20}
{"seconds":1.5,"event":"place","target":20,"x":2.0,"y":3.5}
{"seconds":1.5,"event":"seen","node":3,"target":20,"bearing_deg":-12.5,"sigma_deg":0.25}
{"seconds":1.5,"event":"tracked","node":3,"middle":[44,70],"edges":[40,60,48,80],"pixels":99,"confidence":200,"bearing_deg":-1.5,"sigma_deg":0.25,"is_wide":false}
{"seconds":1.5,"event":"object","network":1,"object":2,"is":{"x":1.0,"y":2.0,"covariance":[0.01,0.0,0.02],"velocity":[0.5,-0.5],"unseen_s":0.25}}
{"seconds":1.5,"event":"object","network":1,"object":2,"is":null}
{"seconds":1.5,"event":"truth","network":1,"object":1,"x":1.0,"y":2.0}
{"seconds":1.5,"event":"command","node":null,"command":"track","state":"asked","words":""}
{"seconds":1.5,"event":"said","node":3,"words":"has its camera moved"}
{"seconds":1.5,"event":"verdict","good":false,"calibrated":1,"expected":2,"words":"1 of 2","findings":[{"node":3,"words":"weak"}],"walk_to":[{"network":1,"x":7.3,"y":1.7,"seen_by":[3]}]}
{"seconds":1.5,"event":"traffic","radio":{"frames":3,"bytes":90,"drops":{},"airtime_share":0.125}}
{"seconds":1.5,"event":"end","radio":null,"sim_seconds":9.5,"cut_short":"interrupted"}
"#;
    for line in lines.lines().filter(|line| !line.is_empty()) {
        let event = Event::from_line(line).unwrap_or_else(|e| panic!("{line}: {e}"));
        assert_eq!(event.to_line().unwrap().trim_end(), line);
    }
    // From before cameras told directions.
    let line = r#"{"seconds":1.5,"event":"tracked","node":3,"middle":[44,70],"edges":[40,60,48,80],"pixels":99,"confidence":200}"#;
    let event = Event::from_line(line).unwrap();
    let told = |what: &What| {
        matches!(
            what,
            What::Tracked {
                bearing_deg: None,
                is_wide: false,
                ..
            }
        )
    };
    assert!(told(&event.what), "{event:?}");
}
