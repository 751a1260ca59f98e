//! Only the coordinator is provisioned anew. The others go on, in another network.

use node_firmware::config::{CoordinatorConfig, RoleConfig};

use crate::run::{
    bench::{Bench, Board, SECOND},
    former_networks::{erase_link, link},
    support::site::{CAMERAS, STOPS, camera_config, target_config},
};

struct Site {
    bench: Bench,
    coordinator: Board,
    cameras: [Board; 2],
    target: Board,
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
        let mut bench = Bench::new();
        let mut coordinator = CoordinatorConfig::default();
        coordinator.join_window_s = 600;
        let coordinator = RoleConfig::Coordinator(coordinator);
        let coordinator = Board::new(&mut bench, coordinator);
        let cameras = [(); 2].map(|()| {
            let mut config = camera_config(None);
            config.may_be_elected = true;
            Board::new(&mut bench, RoleConfig::Camera(config))
        });
        let target = Board::new(&mut bench, RoleConfig::Target(target_config(0)));
        let [first, second] = &cameras;
        for (seed, board) in (1..).zip([&coordinator, first, second, &target]) {
            board.power(&mut bench, seed);
        }
        let site = Self {
            bench,
            coordinator,
            cameras,
            target,
            stops: 0,
        };
        site.show();
        site
    }

    fn show(&self) {
        for (n, camera) in self.cameras.iter().enumerate() {
            camera.sees(Some(column(n, STOPS[self.stops])));
        }
    }

    fn walk(&mut self) {
        let from = STOPS[self.stops];
        self.stops += 1;
        let to = STOPS[self.stops];
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let (distance, heading) = (dx.hypot(dy), dy.atan2(dx));
        self.target.step(distance as f32, heading as f32);
        self.show();
        self.bench.run_for(20 * SECOND);
    }

    /// Two are elected; then the coordinator begins anew.
    fn begin(&mut self) {
        self.bench.run_for(60 * SECOND);
        self.walk();
        assert!(!self.are_calibrated());
        self.coordinator.switch_off(&mut self.bench);
        erase_link(&self.coordinator.flash);
        self.coordinator.power(&mut self.bench, 11);
    }

    /// All are in the new network.
    fn end(&mut self) {
        for _ in 0..4 {
            self.walk();
        }
        assert!(self.are_calibrated(), "{:?}", self.addresses());
        assert!(self.target.lamps().calibrated);
    }

    fn are_calibrated(&self) -> bool {
        self.cameras.iter().all(|camera| camera.lamps().calibrated)
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
        let others = [&site.cameras[0], &site.cameras[1], &site.target];
        for board in others {
            board.switch_off(&mut site.bench);
        }
        for node in (1..=3).filter(|node| *node != last).chain([last]) {
            others[node - 1].power(&mut site.bench, 11 + node as u64);
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
