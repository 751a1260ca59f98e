//! Sigmas that the editor foretells, against those that nodes tell after the same walk.

use std::f64::consts::TAU;

use host_sim::network::{Options, Simulation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use site::{Overrides, Scenario, design::Design};

/// A room of random size with six to nine cameras along its walls, each turned about its middle, and a person.
fn room(seed: u64) -> Scenario {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let size = [6.0, 5.0].map(|least| least + random.random_range(0.0..5.0));
    let count = random.random_range(6..10);
    let mut cameras = String::new();
    for id in 1..=count {
        let along = (f64::from(id - 1) + random.random_range(0.2..0.8)) / f64::from(count);
        let angle = along * TAU - 2.6;
        let [x, y] = [
            size[0] * (0.5 + 0.5 * angle.cos()),
            size[1] * (0.5 + 0.5 * angle.sin()),
        ];
        let middle = (size[1] / 2.0 - y).atan2(size[0] / 2.0 - x).to_degrees();
        let heading = middle + random.random_range(-10.0..10.0);
        cameras +=
            &format!("{{ id = {id}, x = {x:.2}, y = {y:.2}, heading_deg = {heading:.1} }},\n");
    }
    let [width, height] = size;
    let site = format!(
        "name = \"room\"
        unit = \"m\"
        [camera]
        field_of_view_deg = 60
        range = 9
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
        [world]
        low = [0, 0]
        high = [{width:.2}, {height:.2}]
        [[network]]
        references = {{ cameras = [1, 2] }}
        camera = [{cameras}]
        target = [{{ id = 50, radius = 0.1 }}]"
    );
    Scenario::from_toml(&site, &Overrides::default()).unwrap()
}

/// Foretold sigmas of place and heading over told ones, of every camera that is calibrated and no reference.
fn ratios(scenario: Scenario) -> Vec<(u16, [f64; 2])> {
    let design = Design::of(&scenario).unwrap();
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    let record = simulation.run(|_| ());
    let told = record
        .cameras()
        .filter(|camera| camera.is_calibrated() && !camera.reference);
    let pair = told.filter_map(|camera| {
        let foretold = design.cameras.iter().find(|other| other.id == camera.id)?;
        let estimate = camera.estimate?;
        Some((
            camera.id,
            [
                foretold.sigma_position.unwrap_or(f64::NAN) / estimate.sigma_position(),
                foretold.sigma_heading_deg.unwrap_or(f64::NAN) / estimate.sigma_heading_deg,
            ],
        ))
    });
    pair.collect()
}

#[test]
fn the_editor_foretells_what_nodes_tell() {
    let named = ["thesis-13", "lab", "office"].map(|name| {
        let scenario = Scenario::load(name, &Overrides::default()).unwrap();
        (name.to_owned(), scenario)
    });
    let rooms = (1..=10).map(|seed| (format!("room {seed}"), room(seed)));
    let mut count = 0;
    for (name, scenario) in named.into_iter().chain(rooms) {
        for (camera, ratios) in ratios(scenario) {
            for ratio in ratios {
                assert!(
                    (0.8..1.2).contains(&ratio),
                    "{name}, camera {camera}: {ratio}"
                );
            }
            count += 1;
        }
    }
    assert!(count > 75, "{count}");
}
