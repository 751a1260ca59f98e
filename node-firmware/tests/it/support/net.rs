//! A whole network of roles on one bus, and a carrier who walks when the target says so.

use std::{cell::RefCell, rc::Rc};

use calib_core::dead_reckoning::Step;
use nalgebra::{Matrix3, Point2, Vector3};
use node_firmware::{
    config::{CameraConfig, Sigmas, TargetConfig},
    console::ToPc,
    message::{Duty, Message, PoseParts, Report},
    role::{
        Role,
        camera::{self, CameraRole},
        coordinator::{self, CoordinatorRole},
        moving_target::{self, TargetRole},
    },
};

use super::{
    bus::{Air, AnyStation, Faults, Sent, Station, run},
    site::{self, CAMERAS, STEP_SIGMAS, STOPS, Shared, Site, Truth, camera_config, target_config},
    target::target_role,
};

pub const SECOND: u64 = 1_000_000;
/// A look takes so long.
const LOOK: u64 = 600_000;
/// Direction of the sensor of the target.
pub const TURN: f64 = 0.7;
pub const TARGET: u16 = 10;

pub struct Net {
    pub now: u64,
    pub air: Air,
    pub coordinator: Station<CoordinatorRole>,
    pub cameras: Vec<Station<CameraRole>>,
    pub target: Station<TargetRole<'static>>,
    pub told: Rc<RefCell<Vec<ToPc>>>,
    /// Number of looks of each camera.
    pub looks: Rc<RefCell<Vec<u32>>>,
    pub stops: usize,
    missteps: [f64; 2],
    pub site: Shared,
}

/// The two first cameras are configured as references.
pub fn with_references(n: usize) -> CameraConfig {
    camera_config(
        [Some(Duty::First), Some(Duty::Second)]
            .get(n)
            .copied()
            .flatten(),
    )
}

/// The same, which want more than a first pose.
pub fn refining(n: usize) -> CameraConfig {
    let mut camera = with_references(n);
    camera.refine = true;
    camera.good_enough = Sigmas {
        position: 0.02,
        heading_deg: 0.15,
    };
    camera
}

/// A pose against the truth: squared error in units of the predicted covariance.
pub fn nees(pose: &PoseParts, truth: &Truth) -> f64 {
    let [xx, xy, yy, xh, yh, hh] = pose.covariance.map(f64::from);
    let covariance = Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh);
    let error = error(pose, truth);
    covariance.cholesky().unwrap().solve(&error).dot(&error)
}

/// x, y, heading.
pub fn error(pose: &PoseParts, truth: &Truth) -> Vector3<f64> {
    use std::f64::consts::PI;
    let [x, y] = pose.position.map(f64::from);
    let turn = f64::from(pose.heading) - truth.heading;
    Vector3::new(
        x - truth.position.x,
        y - truth.position.y,
        (turn + PI).rem_euclid(2.0 * PI) - PI,
    )
}

impl Net {
    /// With a target that reckons, so that cameras are on their own.
    pub fn new(faults: Faults, seed: u64, config: impl Fn(usize) -> CameraConfig) -> Self {
        // Soon its numbers begin again from zero.
        Self::with(faults, seed, config, || {
            TargetRole::new(TARGET, target_config(0), u16::MAX - 2)
        })
    }

    /// With a target that estimates everything together, as on boards, and whose carrier's errors are not
    /// known.
    pub fn estimating(faults: Faults, seed: u64, config: impl Fn(usize) -> CameraConfig) -> Self {
        Self::with(faults, seed, config, || {
            let unknown = TargetConfig::default();
            let mut config = target_config(0);
            config.systematic_heading_deg = unknown.systematic_heading_deg;
            config.systematic_scale = unknown.systematic_scale;
            target_role(TARGET, config, u16::MAX - 2)
        })
    }

    fn with(
        faults: Faults,
        seed: u64,
        config: impl Fn(usize) -> CameraConfig,
        role: fn() -> TargetRole<'static>,
    ) -> Self {
        let site = Site::new(seed);
        let told = Rc::new(RefCell::new(Vec::new()));
        let looks = Rc::new(RefCell::new(vec![0; CAMERAS.len()]));
        let pc = told.clone();
        let mut coordinator = Station::<CoordinatorRole>::new(
            0,
            CoordinatorRole::new,
            Box::new(move |_, task| {
                if let coordinator::CoordinatorTask::Tell(message) = task {
                    pc.borrow_mut().push(message);
                }
                None
            }),
        );
        coordinator.attach(0);
        let mut cameras: Vec<_> = (0..CAMERAS.len())
            .map(|n| {
                let (site, looks, config) = (site.clone(), looks.clone(), config(n));
                let devices: super::bus::Devices<CameraRole> = Box::new(move |now, task| {
                    Some(match task {
                        camera::CameraTask::Recall(_) => return None,
                        camera::CameraTask::Adapt => (now + LOOK, camera::CameraEvent::Ready),
                        camera::CameraTask::Look { colour } => {
                            looks.borrow_mut()[n] += 1;
                            let (sight, seen) = site.borrow().look(n, colour);
                            (now + LOOK, camera::CameraEvent::Looked(sight, seen))
                        }
                        camera::CameraTask::Command(command) => {
                            let outcome = node_firmware::message::CommandOutcome::Done;
                            let done = node_firmware::message::CommandResult { command, outcome };
                            (now + LOOK, camera::CameraEvent::Done(done))
                        }
                    })
                });
                let address = n as u16 + 1;
                Station::new(
                    address,
                    move || CameraRole::new(100 + address, config.clone()),
                    devices,
                )
            })
            .collect();
        for camera in &mut cameras {
            camera.attach(0);
            camera.event(SECOND, camera::CameraEvent::Ready);
        }
        let mut target = Station::<TargetRole<'_>>::new(TARGET, role, Box::new(|_, _| None));
        target.attach(0);
        let [x, y] = STOPS[0];
        site.borrow_mut().targets.insert(0, Point2::new(x, y));
        Self {
            now: 0,
            air: Air::new(faults, seed),
            coordinator,
            cameras,
            target,
            told,
            looks,
            stops: 1,
            missteps: [0.0; 2],
            site,
        }
    }

    pub fn run(&mut self, until: u64) {
        let mut all: Vec<&mut dyn AnyStation> = vec![&mut self.coordinator, &mut self.target];
        all.extend(self.cameras.iter_mut().map(|c| c as &mut dyn AnyStation));
        run(&mut self.now, until, &mut self.air, &mut all);
    }

    pub fn run_for(&mut self, time: u64) {
        self.run(self.now + time);
    }

    /// Until the target says that it may walk.
    pub fn wait(&mut self) {
        let limit = self.now + 120 * SECOND;
        while !self.target.role.indication().may_walk {
            assert!(self.now < limit, "it may never walk");
            self.run_for(SECOND / 10);
        }
    }

    /// The carrier is moved, and his sensor does not know.
    pub fn push(&mut self, by: [f64; 2]) {
        let mut site = self.site.borrow_mut();
        let target = site.targets.get_mut(&0).unwrap();
        *target += nalgebra::Vector2::from(by);
    }

    /// From now on a camera sees something else, or the target again.
    pub fn show_to(&mut self, camera: usize, what: Option<[f64; 2]>) {
        let mut site = self.site.borrow_mut();
        site.mistaken.remove(&camera);
        site.mistaken
            .extend(what.map(|[x, y]| (camera, Point2::new(x, y))));
    }

    /// Turns a camera to the left, radians.
    pub fn turn_camera(&mut self, camera: usize, by: f64) {
        self.site.borrow_mut().turned.insert(camera, by);
    }

    /// A camera's directions are too large by this share from now on.
    pub fn warp(&mut self, camera: usize, share: f64) {
        self.site.borrow_mut().warped.insert(camera, share);
    }

    /// The step sensor reads so much too far from now on, and so much too far to the left, radians.
    pub fn missteps(&mut self, scale: f64, turn: f64) {
        self.missteps = [scale, turn];
    }

    /// To the next stop, and the events there.
    pub fn walk(&mut self) {
        self.step_to_next();
        self.run_for(SECOND);
        self.wait();
    }

    /// To the next stop.
    pub fn step_to_next(&mut self) {
        let [x, y] = STOPS[self.stops % STOPS.len()];
        let round = 0.15 * (self.stops / STOPS.len()) as f64;
        self.stops += 1;
        let to = Point2::new(x + round, y - round);
        let [distance, heading] = self.site.borrow_mut().walk(0, to, TURN);
        self.target.event(
            self.now,
            moving_target::TargetEvent::Step(Step {
                distance: (distance * (1.0 + self.missteps[0])) as f32,
                heading: (heading + self.missteps[1]) as f32,
                distance_sigma: STEP_SIGMAS[0] as f32,
                heading_sigma: STEP_SIGMAS[1] as f32,
            }),
        );
    }

    /// To the next stop, until the target confirms there a sighting of this camera, which has not heard it.
    pub fn step_until_confirmed(&mut self, camera: usize) {
        self.step_to_next();
        let before = self.air.sent.len();
        let address = camera as u16 + 1;
        let limit = self.now + 20 * SECOND;
        let is_confirmed = |sent: &Sent| match &sent.message {
            Message::Confirmed(confirmation) => confirmation.seen_by.contains(&address),
            _ => false,
        };
        while !self.air.sent[before..].iter().any(is_confirmed) {
            assert!(self.now < limit, "it is never confirmed");
            self.run_for(1_000);
        }
    }

    /// All stops up to this number.
    pub fn walk_to(&mut self, stops: usize) {
        self.wait();
        while self.stops < stops {
            self.walk();
        }
    }

    pub fn reports(&self) -> Vec<Report> {
        self.cameras
            .iter()
            .map(|camera| *camera.role.report())
            .collect()
    }

    pub fn poses(&self) -> Vec<Option<PoseParts>> {
        self.reports()
            .iter()
            .map(|report| report.pose().copied())
            .collect()
    }

    pub fn are_all_done(&self) -> bool {
        self.reports().iter().all(|report| report.done)
    }

    /// The target is where it reckons to be.
    pub fn check_target(&self, within: f64) {
        let (position, _) = self.target.role.position();
        let truth = self.site.borrow().targets[&0];
        let position = Point2::new(position.x.into(), position.y.into());
        let error = (position - truth).norm();
        assert!(error < within, "{error}");
    }

    /// Every camera that has a pose is where the pose says, within so many sigmas.
    pub fn check_poses(&self, frame: impl Fn(&Truth) -> Truth, sigmas: f64) {
        for (n, (report, truth)) in self.reports().iter().zip(&CAMERAS).enumerate() {
            let Some(pose) = report.pose() else {
                panic!("camera {n}: {report:?}");
            };
            let error = error(pose, &frame(truth));
            let sigma = [0, 2, 5].map(|i| f64::from(pose.covariance[i]).sqrt());
            for (error, sigma) in error.iter().zip(sigma) {
                assert!(
                    error.abs() <= sigmas * sigma + 1e-4,
                    "camera {n}: {error} of {sigma}"
                );
            }
            assert!(
                error.xy().norm() < 0.5 && error.z.abs() < 0.05,
                "camera {n}: {error} {report:?}"
            );
        }
    }
}

/// The truth is in the frame of the site.
pub fn same(truth: &Truth) -> Truth {
    *truth
}

/// The frame whose origin is one camera, and whose x axis runs to another.
pub fn from_to(first: usize, second: usize) -> impl Fn(&Truth) -> Truth {
    let (first, second) = (
        site::CAMERAS[first].position,
        site::CAMERAS[second].position,
    );
    let axis = second - first;
    let turn = axis.y.atan2(axis.x);
    move |truth| Truth {
        position: Point2::from(nalgebra::Rotation2::new(-turn) * (truth.position - first)),
        heading: truth.heading - turn,
    }
}
