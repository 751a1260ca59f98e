//! Only the coordinator is provisioned anew. The others go on, in another network.

use std::future::pending;

use calib_core::dead_reckoning::Step;
use node_firmware::config::{CameraConfig, CoordinatorConfig, Role};

use crate::{
    bench::{Bench, Board, CameraUart, Ether, NoUart, PcUart, SECOND},
    former_networks::link,
    support::site::{CAMERAS, STOPS, camera_config, target_config},
};

struct Site {
    bench: Bench,
    coordinator: Board<PcUart>,
    cameras: [Board<CameraUart>; 2],
    target: Board<NoUart>,
    stops: usize,
}

/// The number of the column in which a camera has this place.
fn column(camera: usize, [x, y]: [f64; 2]) -> u8 {
    let camera = &CAMERAS[camera];
    let (dx, dy) = (x - camera.position.x, y - camera.position.y);
    let left = (dy.atan2(dx) - camera.heading).tan();
    let half_view = 30_f64.to_radians().tan();
    (44.5 - 43.5 * left / half_view).round() as u8
}

impl Site {
    /// Two cameras that may be elected, and a target.
    fn new() -> Self {
        let mut bench = Bench::default();
        let ether = Ether::default();
        let coordinator = Role::Coordinator(CoordinatorConfig {
            join_window_s: 600,
            ..CoordinatorConfig::default()
        });
        let coordinator = Board::new(&ether, PcUart::default(), coordinator);
        let camera = || {
            Role::Camera(CameraConfig {
                may_be_elected: true,
                ..camera_config(None)
            })
        };
        let cameras = [(); 2].map(|()| Board::new(&ether, CameraUart::new(&bench.clock), camera()));
        let target = Board::new(&ether, NoUart, Role::Target(target_config(0)));
        bench.nodes = vec![
            coordinator.power(&bench, 1),
            cameras[0].power(&bench, 2),
            cameras[1].power(&bench, 3),
            target.power(&bench, 4),
        ];
        let mut site = Self {
            bench,
            coordinator,
            cameras,
            target,
            stops: 0,
        };
        site.show();
        site
    }

    fn show(&mut self) {
        for (n, camera) in self.cameras.iter().enumerate() {
            camera.uart.sees.set(Some(column(n, STOPS[self.stops])));
        }
    }

    fn walk(&mut self) {
        let from = STOPS[self.stops];
        self.stops += 1;
        let to = STOPS[self.stops];
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        self.target.steps.0.borrow_mut().push_back(Step {
            distance: dx.hypot(dy) as f32,
            heading: dy.atan2(dx) as f32,
            distance_sigma: 0.01,
            heading_sigma: 0.01,
        });
        self.show();
        self.bench.run_for(20 * SECOND);
    }

    /// Two are elected; then the coordinator begins anew.
    fn begin(&mut self) {
        self.bench.run_for(60 * SECOND);
        self.walk();
        assert!(!self.are_calibrated());
        self.coordinator.config.first_counter = 1_000_000;
        self.bench.nodes[0] = self.coordinator.power(&self.bench, 11);
    }

    /// All are in the new network.
    fn end(&mut self) {
        for _ in 0..4 {
            self.walk();
        }
        assert!(self.are_calibrated(), "{:?}", self.addresses());
        assert!(self.target.lamps.0.get().calibrated);
    }

    fn are_calibrated(&self) -> bool {
        self.cameras
            .iter()
            .all(|camera| camera.lamps.0.get().calibrated)
    }

    fn addresses(&self) -> [u16; 3] {
        let [a, b] = &self.cameras;
        [&a.flash, &b.flash, &self.target.flash].map(|flash| link(flash).0.network.unwrap().short.0)
    }
}

/// Two were elected, and have other addresses in the new network. They are elected again there.
#[test]
fn a_site_is_calibrated_with_a_coordinator_that_begins_anew() {
    for last in [1, 2, 3] {
        let mut site = Site::new();
        site.begin();
        // All others are switched off, and on again: this one at last.
        for node in &mut site.bench.nodes[1..] {
            *node = Box::pin(pending());
        }
        for node in (1..=3).filter(|node| *node != last).chain([last]) {
            site.bench.nodes[node] = match node {
                1 | 2 => site.cameras[node - 1].power(&site.bench, 11 + node as u64),
                _ => site.target.power(&site.bench, 14),
            };
            site.bench.run_for(100 * SECOND);
        }
        site.end();
    }
}

/// The same with others that go on, and join in whatever order they find the new network.
#[test]
fn a_site_that_goes_on_follows_a_coordinator_that_begins_anew() {
    let mut moved = 0;
    for seed in 0..8 {
        let mut site = Site::new();
        site.bench.run_for(seed * 3 * SECOND);
        site.begin();
        let before = site.addresses();
        site.bench.run_for(400 * SECOND);
        moved += usize::from(site.addresses() != before);
        site.end();
    }
    assert!(moved > 2, "addresses changed hands {moved} times");
}
