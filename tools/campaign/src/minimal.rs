//! Leaves out of a scenario the parts that its failure does not need.

use std::sync::Arc;

use site::{Overrides, RadioTable, Scenario};

use crate::{
    judgement::{Judgement, Kind, judge},
    runs,
    scenario::text,
};

/// One thing less: the rest of the scenario, if there was such a thing.
type Cut = Arc<dyn Fn(&Scenario) -> Option<Scenario>>;

fn cut(of: impl Fn(&mut Scenario) -> Option<()> + 'static) -> Cut {
    Arc::new(move |scenario| {
        let mut less = scenario.clone();
        of(&mut less)?;
        (less != *scenario).then_some(less)
    })
}

/// One that every scenario has.
fn usual(of: impl Fn(&mut Scenario) + 'static) -> Cut {
    cut(move |scenario| {
        of(scenario);
        Some(())
    })
}

/// Leaves out a camera that is no reference and that no event names.
fn without_camera(scenario: &mut Scenario, place: usize) -> Option<()> {
    let network = scenario.networks.first_mut()?;
    let id = network.cameras.get(place)?.id;
    if network.references.cameras.contains(&id) {
        return None;
    }
    network.cameras.remove(place);
    without_node(scenario, id);
    Some(())
}

/// Events without a node that is not there any more.
fn without_node(scenario: &mut Scenario, id: u16) {
    for event in &mut scenario.events {
        if let site::Action::Partition { nodes, .. } = &mut event.action {
            nodes.retain(|node| *node != id);
        }
    }
    scenario.events.retain(|event| match &event.action {
        site::Action::Partition { nodes, .. } => !nodes.is_empty(),
        action => !action.nodes().contains(&id),
    });
}

/// The larger ones first.
fn cuts(scenario: &Scenario) -> Vec<Cut> {
    let mut cuts = vec![
        cut(|s| {
            let network = s.networks.first_mut()?;
            let last = (network.targets.len() > 1).then(|| network.targets.pop())??;
            without_node(s, last.id);
            Some(())
        }),
        usual(|s| s.camera.faults.clear()),
        usual(|s| s.world.obstacles.clear()),
        usual(|s| s.sensor = None),
        usual(|s| s.firmware = site::FirmwareTable::default()),
        cut(|s| {
            s.radio = RadioTable::UnitDisk {
                range: 60.0,
                loss: 0.0,
            };
            Some(())
        }),
        cut(|s| {
            let network = s.networks.first_mut()?;
            network.references = site::ReferencesTable {
                cameras: network.references.cameras,
                ..site::ReferencesTable::default()
            };
            Some(())
        }),
        cut(|s| {
            let sensor = s.sensor.as_mut()?;
            (sensor.scale_bias, sensor.heading_bias_deg) = (0.0, 0.0);
            Some(())
        }),
        cut(|s| {
            let sensor = s.sensor.as_mut()?;
            (sensor.undeclared_distance, sensor.undeclared_heading_deg) = (0.0, 0.0);
            Some(())
        }),
        cut(|s| {
            let sensor = s.sensor.as_mut()?;
            (sensor.leg_distance, sensor.leg_heading_deg) = (0.0, 0.0);
            Some(())
        }),
    ];
    for place in (0..scenario.events.len()).rev() {
        cuts.push(cut(move |s| {
            (place < s.events.len()).then(|| drop(s.events.remove(place)))
        }));
    }
    for fault in scenario.camera.faults.keys() {
        let fault = fault.clone();
        cuts.push(cut(move |s| s.camera.faults.remove(&fault).map(drop)));
    }
    for place in (0..scenario.networks[0].cameras.len()).rev() {
        cuts.push(cut(move |s| without_camera(s, place)));
    }
    cuts
}

/// The scenario with as little as shows a failure of this kind, and that failure: nothing more can be left out
/// alone. A scenario that does not fail so stays as it is.
///
/// Stops stay: a fault that cannot be noticed, as nothing was seen after it, would be another one.
pub fn minimal(scenario: &Scenario, kind: Kind) -> (Scenario, Judgement) {
    let judged = |scenario: &Scenario| Some(judge(scenario, &runs::run(scenario).ok()?));
    let mut least = scenario.clone();
    let mut judgement = judged(&least).unwrap_or_default();
    let mut failures = judgement.failures.iter();
    let Some(failure) = failures.find(|failure| failure.kind() == kind).cloned() else {
        return (least, Judgement::default());
    };
    loop {
        let smaller = cuts(&least).into_iter().find_map(|cut| {
            // As its file will be read, and possible.
            let less = Scenario::from_toml(&text(&cut(&least)?), &Overrides::default()).ok()?;
            let judged = judged(&less)?;
            judged.fails_as(&failure).then_some((less, judged))
        });
        match smaller {
            Some(smaller) => (least, judgement) = smaller,
            None => return (least, judgement),
        }
    }
}
