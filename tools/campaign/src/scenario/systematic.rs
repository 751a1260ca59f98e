//! Systematic faults: facts that are not as they are told, all the time.

use rand::{Rng, RngExt, seq::IndexedRandom};
use site::{Action, ModelTable, PlacedCamera, Scenario, ScriptedEvent};

use super::{Draw, SAGS, between, happens, short};

/// Steps in which a mount gives way, at most.
const MOST_SAGS: usize = 12;

/// Kinds of systematic faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// One lens is wider or narrower than told.
    Lens,
    /// All lenses are, by the same share: the sheet is of another one.
    Sheet,
    /// The optical axis of one camera is not where it is said to be.
    Centre,
    /// The distance of the references is mistaken.
    Baseline,
    /// A mount gives way, a little at a time.
    Sagging,
    /// The ball is larger or smaller than told: all ranges are off.
    Ball,
    /// Two targets look the same.
    SameColour,
    /// Something as bright as the ball is always beside it in the picture of one camera.
    Glare,
}

use Kind::{Ball, Baseline, Centre, Glare, Lens, Sagging, SameColour, Sheet};

const KINDS: [Kind; 8] = [
    Lens, Sheet, Centre, Baseline, Sagging, SameColour, Glare, Ball,
];

/// The first of them come with daily faults too. A wrong radius deceives cameras: nothing in a network is told how well
/// it is known.
const DAILY: usize = 7;

/// Between two sizes, to either side.
fn either(random: &mut impl Rng, least: f64, most: f64) -> f64 {
    let size = between(random, least, most);
    if happens(random, 0.5) { size } else { -size }
}

/// The angle of view whose tangents are larger by this share, degrees.
fn wider(view_deg: f64, share: f64) -> f64 {
    let half = (view_deg / 2.0).to_radians().tan() * (1.0 + share);
    short(2.0 * half.atan().to_degrees())
}

/// Draws one of them for a scenario that has its stops, in a walk of so many seconds.
pub(super) fn draw(random: &mut impl Rng, scenario: &mut Scenario, walk_s: f64, drawn: Draw) {
    let kinds = match drawn {
        Draw::Daily => KINDS.get(..DAILY),
        Draw::Systematic => KINDS.get(..),
    };
    let kind = kinds.and_then(|kinds| kinds.choose(random));
    let kind = kind.copied().unwrap_or(Lens);
    let view = scenario.camera.field_of_view_deg();
    let middle = f64::from(scenario.camera.size()[0] - 1) / 2.0;
    let network = &mut scenario.networks[0];
    let [first, second] = network.references.cameras;
    let ids: Vec<u16> = network.cameras.iter().map(|camera| camera.id).collect();
    let one = ids.choose(random).copied().unwrap_or(first);
    let camera = |cameras: &mut [PlacedCamera], of: &dyn Fn(&mut PlacedCamera)| {
        cameras
            .iter_mut()
            .filter(|camera| camera.id == one)
            .for_each(of);
    };
    match kind {
        Lens => {
            let believed = wider(view, either(random, 0.05, 0.2));
            camera(&mut network.cameras, &|camera| {
                camera.model = Some(ModelTable {
                    field_of_view_deg: Some(believed),
                    ..ModelTable::default()
                });
            });
        }
        Sheet => {
            scenario.camera.model.field_of_view_deg = Some(wider(view, either(random, 0.05, 0.2)));
        }
        Centre => {
            let believed = middle + either(random, 3.0, 8.0);
            camera(&mut network.cameras, &|camera| {
                camera.model = Some(ModelTable {
                    principal_column: Some(believed),
                    ..ModelTable::default()
                });
            });
        }
        Baseline => {
            let place = |id| network.camera(id).and_then(PlacedCamera::place);
            if let Some((a, b)) = place(first).zip(place(second)) {
                let share = either(random, 0.03, 0.12);
                network.references.baseline = Some(short((b - a).norm() * (1.0 + share)));
            }
        }
        Sagging => {
            let steps = random.random_range(SAGS..=MOST_SAGS);
            let turn_deg = either(random, 0.3, 1.5);
            for step in 0..steps {
                scenario.events.push(ScriptedEvent {
                    at_s: short(walk_s * (step as f64 + 1.0) / (steps as f64 + 2.0)),
                    action: Action::BumpCamera {
                        node: one,
                        by: [0.0; 2],
                        turn_deg,
                    },
                });
            }
        }
        Ball => {
            let radius = network.targets.first().map_or(0.0, |target| target.radius);
            let told = radius * (1.0 + either(random, 0.1, 0.4));
            scenario.firmware.ball_radius = Some(short(told));
        }
        SameColour => {
            let mut other = network.targets[0].clone();
            other.id += 1;
            if let Some(stops) = &mut other.stops {
                let half = stops.len() / 2;
                stops.rotate_left(half);
            }
            network.targets.truncate(1);
            network.targets.push(other);
        }
        Glare => {
            let mut faults = scenario.camera.faults.clone();
            faults.insert("merge".to_owned(), 1.0);
            camera(&mut network.cameras, &|camera| {
                camera.faults = Some(faults.clone());
            });
        }
    }
}
