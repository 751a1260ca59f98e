//! A small network, and a check that its cameras' poses, as machine code has them, are those of this program.

use host_sim::network::Simulation;
use node_firmware::{
    config::RoleConfig as Configured,
    facts::{Fact, KeptSighting},
    message::{Confirmation, CoordinateFrame, Message, PoseParts, Report, Sight, Stopped},
    network::{Attachment, NetworkIdentity},
    role::{
        Output as Wish, Role,
        camera::{CameraEvent, CameraRole, CameraTask},
    },
};
use results::record::RunRecord;
use zigbee_link::{Instant, wire::ShortAddress};

const NOW: Instant = Instant(1_000_000);

/// Two references, another camera that loses its power, a target. The distance of the references is not known: the
/// camera's pose is its own until the target has estimated all of them together.
pub(crate) const SMALL: &str = r#"
name = "small"
unit = "inches"
unit_metres = 0.0254

[world]
low = [-12.0, -4.0]
high = [26.0, 30.0]

[camera]
projection = "pin-hole"
field_of_view_deg = 45.0
range = 40.0

[walk]
speed = 6.0
arrive_within = 0.1
step_length = 1.0

[radio]
medium = "unit-disk"
range = 100.0

[sensor]
measures = false

[firmware]
systematic_heading_deg = 0.0
systematic_scale = 0.0
standing_sigma = 0.05
weak_sigma = 1.4

[[network]]
channel = 20
references = { cameras = [1, 2], baseline = 14.0, baseline_known = false }
camera = [
  { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
  { id = 2, x = 14.0, y = 0.0, heading_deg = 135.0 },
  { id = 3, x = 7.0, y = -2.0, heading_deg = 90.0 },
]
target = [{ id = 20, colour = [230, 105, 35], radius = 0.75 }]

[[event]]
at_s = 25.0
action = { power-cut = { node = 3, for_s = 1.0 } }
"#;

/// The poses that Cortex-M4Fs found by themselves are those that this processor finds from the same sightings,
/// to the last bit: same routines, no arithmetic but IEEE 754's. Those that a target estimated agree within sigmas.
pub(crate) fn check_arithmetic(simulation: &Simulation, record: &RunRecord) {
    let mut checked = 0;
    for node in &record.nodes {
        let facts = simulation.memory(node.id);
        let Some(Configured::Camera(config)) = simulation
            .config(node.id)
            .map(|config| &config.settings().role)
        else {
            continue;
        };
        if config.reference.is_some() {
            continue;
        }
        let there = facts.iter().find_map(|fact| match fact {
            Fact::Report(report) => *report,
            _ => None,
        });
        let there = there.unwrap_or_else(|| panic!("node {} has no report", node.id));
        let sightings: Vec<_> = facts
            .iter()
            .filter(|fact| matches!(fact, Fact::Sighting(_, Some(_))))
            .collect();
        let here = again(CameraRole::new(node.id, config.clone()), &sightings);
        assert!(here.pose().is_some());
        if there.joint.is_some() {
            // The target's joint estimate took its place: both tell of the same camera.
            let [own, joint] =
                [&here, &there].map(|report| report.pose().and_then(PoseParts::pose).unwrap());
            let apart = (own.position - joint.position).norm();
            let sigma = own.sigma_position().hypot(joint.sigma_position());
            assert!(apart < 5.0 * sigma, "{here:?} {there:?}");
        } else {
            assert_eq!(here, there);
        }
        checked += 1;
    }
    assert!(checked > 0);
}

/// A camera's report after these sightings.
fn again(mut camera: CameraRole, sightings: &[&Fact]) -> Report {
    let (last, before) = sightings.split_last().unwrap();
    for fact in before {
        camera.restore(fact);
    }
    let &&Fact::Sighting(
        _,
        Some(KeptSighting {
            target,
            stop,
            place,
            seen,
        }),
    ) = last
    else {
        unreachable!();
    };
    let stopped = Stopped {
        stop,
        colour: 0,
        frame: CoordinateFrame::Site,
        place,
    };
    camera.on_event(NOW, CameraEvent::Ready);
    let network = NetworkIdentity {
        number: 1,
        founder: [2; 8],
    };
    camera.on_attached(NOW, Some(Attachment { network, own: 1 }));
    camera.on_message(NOW, ShortAddress(target), &Message::Stopped(stopped));
    while let Some(wish) = camera.poll(NOW) {
        if let Wish::Task(CameraTask::Look { .. }) = wish {
            camera.on_event(NOW, CameraEvent::Looked(Sight::InView, Some(seen)));
        }
    }
    let confirmation = Confirmation {
        stop,
        seen_by: [1].into_iter().collect(),
    };
    let confirmed = Message::Confirmed(confirmation);
    camera.on_message(NOW, ShortAddress(target), &confirmed);
    *camera.report()
}
