//! A small world: the true places of cameras and targets, in f64, and the sightings of the cameras.

use std::{cell::RefCell, collections::BTreeMap, f64::consts::PI, rc::Rc};

use nalgebra::{Point2, Vector2};
use node_firmware::{
    config::{CameraConfig, LensSigma, Sigmas, Subjects, SurveySigma, TargetConfig},
    message::{Duty, Reference, Seen, Sight},
    vision::{ColourWindow, Lens},
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Standard deviation of the cameras' bearings, radians.
pub const BEARING_SIGMA: f64 = 0.001;
/// Standard deviations of a leg of a walk: distance and direction.
pub const STEP_SIGMAS: [f64; 2] = [0.005, 0.001];
/// Standard deviation of standing.
pub const STANDING_SIGMA: f64 = 0.005;
/// Half of a view, radians.
const HALF_VIEW: f64 = 30.0 * PI / 180.0;

/// A true pose.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub position: Point2<f64>,
    pub heading: f64,
}

pub const fn truth(x: f64, y: f64, heading_deg: f64) -> Truth {
    Truth {
        position: Point2::new(x, y),
        heading: heading_deg * PI / 180.0,
    }
}

/// The references at both ends of a baseline of 10, and three cameras about them.
pub const CAMERAS: [Truth; 5] = [
    truth(0.0, 0.0, 45.0),
    truth(10.0, 0.0, 135.0),
    truth(5.0, 16.0, 270.0),
    truth(-4.0, 6.0, 0.0),
    truth(14.0, 9.0, 190.0),
];

/// In view of all of them.
pub const STOPS: [[f64; 2]; 8] = [
    [5.0, 5.0],
    [3.6, 7.5],
    [6.4, 7.0],
    [4.5, 4.6],
    [5.5, 8.8],
    [6.6, 5.6],
    [3.6, 6.0],
    [5.2, 7.3],
];

/// State of the world.
pub struct Site {
    /// Places where targets stand, by colour.
    pub targets: BTreeMap<u8, Point2<f64>>,
    /// Places that cameras, by their place in [`CAMERAS`], take for a target's.
    pub mistaken: BTreeMap<usize, Point2<f64>>,
    /// Excess of a camera's directions, as a share.
    pub warped: BTreeMap<usize, f64>,
    /// Cameras that were turned, by so much.
    pub turned: BTreeMap<usize, f64>,
    seed: u64,
}

pub type Shared = Rc<RefCell<Site>>;

/// The same for the same words at any time: faults of a radio do not change the sightings.
pub fn noise(words: &[u64]) -> f64 {
    let seed = words.iter().fold(0xA5A5_u64, |hash, word| {
        (hash ^ word)
            .wrapping_mul(0x9E37_79B9_7F4A_7C15)
            .rotate_left(29)
    });
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let sum: f64 = (0..12).map(|_| rng.random::<f64>()).sum();
    sum - 6.0
}

impl Site {
    pub fn new(seed: u64) -> Shared {
        Rc::new(RefCell::new(Self {
            targets: BTreeMap::new(),
            mistaken: BTreeMap::new(),
            warped: BTreeMap::new(),
            turned: BTreeMap::new(),
            seed,
        }))
    }

    /// A camera's look for a colour.
    pub fn look(&self, n: usize, colour: u8) -> (Sight, Option<Seen>) {
        let camera = &CAMERAS[n];
        let Some(target) = self.mistaken.get(&n).or(self.targets.get(&colour)) else {
            return (Sight::NotInView, None);
        };
        let to = target - camera.position;
        let bearing = to.y.atan2(to.x) - camera.heading - self.turned.get(&n).unwrap_or(&0.0);
        let bearing = (bearing + PI).rem_euclid(2.0 * PI) - PI;
        if bearing.abs() > HALF_VIEW {
            return (Sight::NotInView, None);
        }
        let words = [camera.position.x, camera.position.y, target.x, target.y].map(f64::to_bits);
        let error = BEARING_SIGMA * noise(&[&words[..], &[self.seed]].concat());
        let warp = 1.0 + self.warped.get(&n).unwrap_or(&0.0);
        let seen = Seen::direction((bearing * warp + error) as f32, BEARING_SIGMA as f32);
        (Sight::InView, Some(seen))
    }

    /// A target walks to a place. Returns its sensor's reading, in a frame turned by `turn`: distance and
    /// direction.
    pub fn walk(&mut self, colour: u8, to: Point2<f64>, turn: f64) -> [f64; 2] {
        let from = self.targets.insert(colour, to).unwrap_or(to);
        let way: Vector2<f64> = to - from;
        let words = [from.x, from.y, to.x, to.y].map(f64::to_bits);
        let error = |n: u64| noise(&[&words[..], &[self.seed, n]].concat());
        [
            (way.norm() + STEP_SIGMAS[0] * error(1)).max(0.0),
            way.y.atan2(way.x) - turn + STEP_SIGMAS[1] * error(2),
        ]
    }
}

pub fn camera_config(reference: Option<Duty>) -> CameraConfig {
    let window = ColourWindow {
        red: [170, 240],
        green: [60, 140],
        blue: [16, 80],
    };
    let subjects = Subjects::Colours([window].into_iter().collect());
    let mut config = CameraConfig::new(Lens::pin_hole(88, 60.0), subjects);
    config.lens_sigma = LensSigma::EXACT;
    config.reference = reference.map(|duty| Reference {
        duty,
        position: None,
    });
    config.may_be_elected = false;
    config.baseline = Some(10.0);
    config.refine = false;
    config.good_enough = Sigmas {
        position: 0.05,
        heading_deg: 0.3,
    };
    config.sigma_floor_px = 0.0625;
    config
}

pub fn target_config(colour: u8) -> TargetConfig {
    let mut config = TargetConfig::default();
    config.lens_sigma = LensSigma::EXACT;
    config.survey_sigma = SurveySigma::EXACT;
    config.colour = colour;
    config.systematic_heading_deg = 0.0;
    config.systematic_scale = 0.0;
    config.standing_sigma = STANDING_SIGMA as f32;
    config.dwell_most_ms = 60_000;
    config
}
