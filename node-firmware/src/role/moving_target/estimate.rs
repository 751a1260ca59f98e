//! Everything that was measured, estimated together: the stops of this target, the cameras that saw it
//! there, and its own step sensor.
//!
//! The target is where all of it comes together: it measures the ways from stop to stop, and every
//! camera that sees it answers with a bearing. What the [estimator](calib_core::joint) makes of it
//! corrects the target's place and its steps, and is told to the cameras.

use calib_core::{
    Pose, angle,
    dead_reckoning::Step,
    joint::{JointEstimator, JointSettings, JointSolution, Leg, Prior, workspace},
};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use crate::{
    arithmetic::root,
    config::TargetConfig,
    log::debug,
    message::{CameraState, MemberAddress, PoseParts, Report, Seen, StopNumber},
    role::is_news,
};

/// Cameras that take part. What more there are finds its pose from its own sightings.
pub(super) const CAMERAS: usize = 24;
/// Stops that take part, from the first on.
const STOPS: usize = 100;
/// Bearings that take part.
const BEARINGS: usize = 384;

/// What is left out at most after one stop.
const FINDINGS: usize = 2;

/// Sigma of a direction, radians, of which nothing is known but what the bearings tell.
const VAGUE: f32 = 0.5;

/// A leg is not known better than this, in its own unit: rounding.
const LEAST_SIGMA: f32 = 1e-4;

const _: () = assert!(CAMERAS <= u32::BITS as usize, "a bit for each");

type Estimator = JointEstimator<f32, CAMERAS, STOPS, BEARINGS, 0, { workspace(CAMERAS, 0) }>;

/// Where the frame of the estimator is in that of the site.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Frame {
    references: [MemberAddress; 2],
    origin: Point2<f32>,
    /// Direction from the first reference to the second, radians.
    direction: f32,
    baseline: f32,
}

impl Frame {
    /// `None` where the distance of both is a measured one: then it would be one of the unknowns.
    fn between(references: [(MemberAddress, Pose<f32>); 2]) -> Option<Self> {
        let [(first, from), (second, to)] = references;
        let between = to.position - from.position;
        let baseline = root(between.norm_squared());
        let uncertain = root(from.covariance.m11 + from.covariance.m22)
            + root(to.covariance.m11 + to.covariance.m22);
        let is_known = baseline > 0.0 && uncertain <= baseline * 1e-3;
        is_known.then_some(Self {
            references: [first, second],
            origin: from.position,
            direction: nalgebra::RealField::atan2(between.y, between.x),
            baseline,
        })
    }

    fn turn(&self) -> Matrix2<f32> {
        angle::rotation(self.direction)
    }
}

/// Where the target is, and what its steps are worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimated {
    pub(super) stop: StopNumber,
    pub(super) position: Point2<f32>,
    pub(super) covariance: Matrix2<f32>,
    /// Direction of the x axis of the step sensor in the frame of the site, and its sigma.
    pub(super) frame_heading: (f32, f32),
    /// What the step sensor reads over the true length, and its sigma.
    pub(super) scale: (f32, f32),
}

/// Measurements, and what they give together.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    estimator: Estimator,
    /// Cameras by their number in the estimator.
    cameras: heapless::Vec<MemberAddress, CAMERAS>,
    /// What each was told, or is to be told.
    told: [Option<Report>; CAMERAS],
    /// To be told: a bit for each camera.
    news: u32,
    /// The number of the first stop.
    first: StopNumber,
    /// The way since the last stop, as the sensor read it.
    way: Option<(Vector2<f32>, Matrix2<f32>)>,
    frame: Option<Frame>,
    /// Direction of the sensor's x axis in the frame of the site before anything is estimated, and
    /// its sigma.
    sensor: Option<(f32, f32)>,
    /// There is something that the last solve did not have.
    is_new: bool,
}

impl Estimate {
    pub(super) fn new() -> Option<Self> {
        let estimator = Estimator::new(1.0, JointSettings::default()).ok()?;
        Some(Self {
            estimator,
            cameras: heapless::Vec::new(),
            told: [None; CAMERAS],
            news: 0,
            first: 0,
            way: None,
            frame: None,
            sensor: None,
            is_new: false,
        })
    }

    /// The target made a step, as its sensor reads it.
    pub(super) fn on_step(&mut self, step: &Step<f32>) {
        if let Some((walked, covariance)) = &mut self.way {
            *walked += step.displacement();
            *covariance += step.covariance();
        }
    }

    /// From now on nobody knows how the target came to its next stop.
    pub(super) const fn lose_way(&mut self) {
        self.way = None;
    }

    /// The target stands. It may have moved a little each time: `standing_sigma`.
    pub(super) fn on_stop(&mut self, stop: StopNumber, standing_sigma: f32) {
        let stops = self.estimator.stops();
        if stops == 0 {
            self.first = stop;
        } else if self.index(stop) != Some(stops) {
            // Numbers began anew.
            return;
        }
        let moved = standing_sigma * standing_sigma + LEAST_SIGMA * LEAST_SIGMA;
        let leg = self.way.map(|(displacement, covariance)| Leg {
            displacement,
            covariance: covariance + Matrix2::from_diagonal_element(2.0 * moved),
        });
        if self.estimator.add_stop(leg).is_ok() {
            self.way = Some((Vector2::zeros(), Matrix2::zeros()));
        } else {
            debug!("no room for another stop");
        }
    }

    /// Where a stop is among those of the estimator, or would be.
    fn index(&self, stop: StopNumber) -> Option<usize> {
        let index = usize::from(stop.wrapping_sub(self.first));
        (index <= self.estimator.stops()).then_some(index)
    }

    /// A camera saw the target at a stop.
    pub(super) fn on_seen(&mut self, camera: MemberAddress, stop: StopNumber, seen: &Seen) {
        let Some(stop) = self.index(stop) else { return };
        let Some(camera) = self.number(camera) else {
            return;
        };
        if self.estimator.has_bearing(stop, camera) {
            return;
        }
        let added = self.estimator.add_bearing(stop, camera, seen.bearing, seen.sigma);
        self.is_new |= added.is_ok();
    }

    /// The number of a camera, a new one if there is room.
    fn number(&mut self, camera: MemberAddress) -> Option<usize> {
        if let Some(number) = self.cameras.iter().position(|known| *known == camera) {
            return Some(number);
        }
        self.cameras.push(camera).ok()?;
        Some(self.cameras.len() - 1)
    }

    /// The direction of the sensor is known to this, before anything is estimated. One that bearings
    /// told is worth nothing beside them.
    pub(super) const fn on_sensor(&mut self, heading: f32, sigma: f32) {
        if self.frame.is_none() {
            let sigma = if sigma > 0.0 { VAGUE } else { sigma };
            self.sensor = Some((heading, sigma));
        }
    }

    /// The references are these, with these poses.
    pub(super) fn on_references(
        &mut self,
        references: [(MemberAddress, Pose<f32>); 2],
        config: &TargetConfig,
    ) {
        let Some(frame) = Frame::between(references) else {
            return;
        };
        let Some((heading, sigma)) = self.sensor else {
            return;
        };
        if self.frame == Some(frame) {
            return;
        }
        let own = config.systematic_heading_deg.to_radians();
        let settings = JointSettings {
            scale: Prior {
                mean: 1.0,
                sigma: config.systematic_scale.max(LEAST_SIGMA),
            },
            compass: Prior {
                mean: angle::wrap_signed(frame.direction - heading),
                sigma: root(own * own + sigma * sigma).max(LEAST_SIGMA),
            },
            ..JointSettings::default()
        };
        let [Some(first), Some(second)] = frame.references.map(|camera| self.number(camera)) else {
            return;
        };
        let appointed = self
            .estimator
            .appoint([first, second], frame.baseline, settings);
        if appointed.is_err() {
            return;
        }
        self.told = [None; CAMERAS];
        self.cameras.swap(0, first);
        self.cameras.swap(1, if second == 0 { first } else { second });
        self.frame = Some(frame);
        self.is_new = true;
    }

    /// Whether there is something that the last solve did not have.
    pub(super) const fn has_news(&self) -> bool {
        self.is_new && self.frame.is_some()
    }

    /// Estimates everything. Where the target is now, if that can be told.
    // stack
    #[inline(never)]
    pub(super) fn solve(&mut self) -> Option<Estimated> {
        self.is_new = false;
        let frame = self.frame?;
        let solution = self.checked()?;
        let carrier = self.estimator.carrier().ok()?;
        let last = self.estimator.stops().checked_sub(1)?;
        let place = self.estimator.place(last).ok()?;
        let inflation = solution.fit.inflation();
        let turn = frame.turn();
        for camera in 0..self.cameras.len() {
            let report = self.report(camera, &frame, &solution);
            if let (Some(report), Some(told)) = (report, self.told.get_mut(camera))
                && told.is_none_or(|told| is_news(&told, &report))
            {
                *told = Some(report);
                self.news |= 1 << camera;
            }
        }
        let sigmas = carrier.covariance * inflation;
        Some(Estimated {
            stop: self.first.wrapping_add(last as StopNumber),
            position: frame.origin + turn * place.position.coords,
            covariance: angle::turned(&(place.covariance * inflation), &turn),
            frame_heading: (
                angle::wrap_signed(frame.direction - carrier.compass),
                root(sigmas.m22),
            ),
            scale: (carrier.scale, root(sigmas.m11)),
        })
    }

    /// The solution without what contradicts it.
    // stack
    #[inline(never)]
    fn checked(&mut self) -> Option<JointSolution<f32>> {
        let mut solution = self.estimator.solve();
        for _ in 0..FINDINGS {
            match self.estimator.check() {
                Ok(Some(_)) => solution = self.estimator.solve(),
                _ => break,
            }
        }
        solution.ok()
    }

    // stack
    #[inline(never)]
    fn report(
        &mut self,
        camera: usize,
        frame: &Frame,
        solution: &JointSolution<f32>,
    ) -> Option<Report> {
        let pose = self.estimator.pose(camera).ok()?;
        let turn = frame.turn();
        let mut turn_pose = Matrix3::identity();
        turn_pose.fixed_view_mut::<2, 2>(0, 0).copy_from(&turn);
        let covariance = turn_pose * pose.covariance * turn_pose.transpose();
        let parts = PoseParts::from(Pose {
            position: frame.origin + turn * pose.position.coords,
            heading: angle::wrap_positive(pose.heading + frame.direction),
            covariance: covariance * solution.fit.inflation(),
        });
        let [came, count] = self.estimator.bearings_of(camera);
        // The camera itself knows what is good enough.
        let state = if solution.fit.is_bad() {
            CameraState::Doubtful(parts)
        } else {
            CameraState::Weak(parts)
        };
        parts.is_usable().then_some(Report {
            id: 0,
            duty: None,
            sightings: came.try_into().unwrap_or(u8::MAX),
            used: count.try_into().unwrap_or(u8::MAX),
            chi_squared: solution.fit.chi_squared,
            done: false,
            joint: true,
            state,
        })
    }

    /// Cameras that are to be told something new. Says so once.
    pub(super) fn take_news(&mut self) -> impl Iterator<Item = MemberAddress> {
        let news = core::mem::take(&mut self.news);
        let cameras = self.cameras.iter().enumerate();
        cameras.filter_map(move |(n, camera)| (news & (1 << n) != 0).then_some(*camera))
    }

    /// What these cameras are to be told.
    pub(super) fn reports(&self) -> impl Iterator<Item = (MemberAddress, &Report)> {
        let told = self.cameras.iter().zip(&self.told);
        told.filter_map(|(camera, report)| Some((*camera, report.as_ref()?)))
    }
}
