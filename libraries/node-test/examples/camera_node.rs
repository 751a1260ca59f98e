//! A camera node, tested on a computer: `cargo run -p node-test --example camera_node`.
use std::{cell::Cell, rc::Rc};

use node_test::{
    Bench, SECOND,
    cmucam2_emulator::{Extent, Scene, Shape},
    node_firmware::{
        config::{CameraConfig, CoordinatorConfig, Subjects, TargetConfig},
        message::Sight,
        vision::{ColourWindow, Lens},
    },
};

fn main() {
    let mut bench = Bench::new(1);
    let mut coordinator = CoordinatorConfig::default();
    coordinator.join_window_s = 60;
    let coordinator = bench.coordinator(coordinator);
    // An emulated CMUcam2 sees an orange ball, as long as the ball is there.
    let (red, green, blue) = ([170, 240], [60, 140], [16, 80]);
    let orange = [ColourWindow { red, green, blue }].into_iter().collect();
    let config = CameraConfig::new(Lens::pin_hole(88, 45.0), Subjects::Colours(orange));
    let place = Rc::new(Cell::new(Some(Extent::centred(0.5, 0.5, 0.1, 0.1))));
    let ball = place.clone();
    let camera = bench.camera(config, move |_, scene| match ball.get() {
        Some(at) => *scene = Scene::with_object([210, 105, 40], Shape::Disc, at),
        None => *scene = Scene::default(),
    });
    let target = bench.target(TargetConfig::default());
    bench.switch_on([&coordinator, &camera, &target]);

    bench.run_for(60 * SECOND); // It joins, and sees the target, which has stood since the start.
    assert!(camera.lamps().joined);
    assert_eq!(camera.looks().last(), Some(&Sight::InView));

    place.set(None); // The target walks to where the camera does not see it.
    target.step(1.0, 0.5);
    bench.run_for(30 * SECOND);
    assert_eq!(camera.looks().last(), Some(&Sight::NotInView));
}
