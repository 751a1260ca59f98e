//! Nodes whose cameras see video files of a ball that rolls through a room.

use cmucam2_emulator::Scene;
use host_sim::network::{Options, Simulation};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use site::{Overrides, Scenario, world::Walker};

use super::film::{Shot, lit_ball, played, room};

/// Pictures a second.
const RATE: usize = 2;

/// The ball goes by the clock, as it did when it was filmed: the target stays longer at a stop than
/// its carrier, so that the lamp never says when to go.
fn scenario(stops: &str, seed: u64) -> Scenario {
    let text = format!(
        r#"
        name = "filmed"
        [world]
        low = [-3.0, -3.0]
        high = [11.0, 11.0]
        [walk]
        speed = 0.5
        arrive_within = 0.0001
        patience_s = 30.0
        [firmware]
        systematic_heading_deg = 0.0
        systematic_scale = 0.0
        standing_sigma = 0.01
        dwell_least_ms = 40000
        dwell_most_ms = 60000
        [[network]]
        references = {{ cameras = [1, 2] }}
        camera = [
          {{ id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 }},
          {{ id = 2, x = 8.0, y = 0.0, heading_deg = 135.0 }},
          {{ id = 3, x = 4.0, y = 9.0, heading_deg = 270.0 }},
          {{ id = 4, x = -1.0, y = 5.0, heading_deg = 0.0 }},
        ]
        target = [{{ id = 20, stops = [{stops}] }}]
        "#
    );
    let overrides = Overrides {
        seed: Some(seed),
        ..Overrides::default()
    };
    Scenario::from_toml(&text, &overrides).unwrap().exact()
}

/// Runs the nodes of one room and checks their results.
fn calibrated(number: u8, stops: &str) {
    let folder = tempfile::tempdir().unwrap();
    let scenario = scenario(stops, number.into());
    let (_, site) = scenario.rehearsed().unwrap();
    let target = &site.networks[0].targets[0];
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    for camera in &site.networks[0].cameras {
        let mut world = site.world.clone();
        let stops = target.stops.clone();
        let mut walker = Walker::new(target.gait, stops, ChaCha8Rng::seed_from_u64(0));
        let scene = |index: usize| {
            let now = index as u64 * 1_000_000_000 / RATE as u64;
            walker.advance(now, &mut Vec::new());
            world.move_target(target.index, walker.place());
            let seen = world.look(camera.index);
            let balls = seen.patches().iter().map(|patch| patch.extent);
            Scene {
                background: room(number),
                objects: balls.flat_map(lit_ball).collect(),
                ..Scene::default()
            }
        };
        let path = folder.path().join(format!("camera-{}.mp4", camera.id));
        let shot = Shot {
            width: 176,
            height: 144,
            rate: RATE,
            noise: 6,
        };
        shot.compressed(&path, 23, 240 * RATE, scene);
        simulation.show_video(camera.id, played(&path)).unwrap();
    }
    let record = simulation.run(|_| ());
    for camera in record.cameras() {
        let (Some(estimate), Some(error)) = (&camera.estimate, camera.error) else {
            panic!("room {number}: camera {} has no pose", camera.id);
        };
        println!(
            "room {number}, camera {}: errs by {:.3}, {:.3}, {:.2} deg, sigmas {:.3}, {:.3}, {:.2} deg",
            camera.id,
            error.x,
            error.y,
            error.heading_deg,
            estimate.sigma_x,
            estimate.sigma_y,
            estimate.sigma_heading_deg
        );
        assert_eq!((camera.used, &camera.reason), (6, &None));
        // A larger value comes once in a million.
        assert!(
            camera.nees.is_none_or(|nees| nees < 30.7),
            "{:?}",
            camera.nees
        );
        assert!(estimate.sigma_position() < 0.1);
    }
}

#[test]
fn cameras_calibrate_from_video_of_three_rooms() {
    let rooms = [
        "[3.0, 3.2], [5.0, 3.4], [4.2, 5.2], [2.8, 4.8], [5.2, 5.4], [3.4, 4.0]",
        "[4.4, 3.0], [3.2, 5.2], [5.4, 4.6], [3.0, 3.4], [4.8, 5.4], [4.0, 4.2]",
        "[5.2, 5.0], [2.8, 4.4], [4.6, 3.2], [3.6, 5.6], [5.4, 3.8], [3.2, 3.6]",
    ];
    std::thread::scope(|scope| {
        for (number, stops) in (0..).zip(rooms) {
            scope.spawn(move || calibrated(number, stops));
        }
    });
}
