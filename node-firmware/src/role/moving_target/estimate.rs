//! Everything that was measured, estimated together: the stops of this target, the cameras that saw it
//! there, and its own step sensor.
//!
//! The target is where all of it comes together: it measures the ways from stop to stop, and every
//! camera that sees it answers with a bearing. What the [estimator](calib_core::joint) makes of it
//! corrects the target's place and its steps, and is told to the cameras.

use calib_core::{
    Pose, angle,
    dead_reckoning::Step,
    joint::{
        BearingStorage, Finding, JointEstimator, JointMemory, JointSettings, JointSolution, Prior,
        Progress, Quantity, Round, StopStorage, UnknownStorage, workspace,
    },
};
use nalgebra::{Matrix2, Point2, Vector2};

use crate::{
    arithmetic::root,
    config::TargetConfig,
    limits::{WALK_BEARINGS, WALK_STOPS},
    log::debug,
    message::{CameraState, MemberAddress, PoseParts, ProtectionLevel, Report, Seen, StopNumber},
    role::{Unsaved, is_news},
};

/// Cameras that take part. What more there are finds its pose from its own sightings.
pub const CAMERAS: usize = 24;
/// Numbers that they are solved with.
pub const WORKSPACE: usize = workspace(CAMERAS, 0);

/// What is done after each stop: what contradicts is left out, so much at most at a time; what the legs
/// are worth is estimated, and what one wrong measurement could do.
const ROUND: Round = Round {
    findings: 4,
    leg_noise: true,
    protection: true,
};

/// Sigma of a direction, radians, of which nothing is known but what the bearings tell.
const VAGUE: f32 = 0.5;

/// A leg, a scale or a direction is not known better than this: rounding.
pub(super) const LEAST_SIGMA: f32 = 1e-3;

const _: () = assert!(CAMERAS <= u32::BITS as usize, "a bit for each");

/// Where a target keeps what was measured, and what it estimates from it.
#[derive(Debug)]
pub struct EstimateMemory<'m> {
    /// Cameras, references included.
    pub cameras: &'m mut [UnknownStorage<f32>; CAMERAS],
    /// Stops.
    pub stops: &'m mut [StopStorage<f32>; WALK_STOPS],
    /// Bearings.
    pub bearings: &'m mut [BearingStorage<f32>; WALK_BEARINGS],
    /// Numbers.
    pub workspace: &'m mut [f32; WORKSPACE],
    /// What cameras were told of themselves.
    pub told: &'m mut [Option<Report>; CAMERAS],
}

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

/// A camera of the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Camera {
    address: MemberAddress,
    /// What it sees contradicts the rest: it was moved, or is stuck.
    is_doubtful: bool,
    /// The number under which it is estimated since.
    successor: Option<u8>,
    /// The number under which it was known before.
    is_successor: bool,
}

/// Measurements, and what they give together.
#[derive(Debug)]
pub(super) struct Estimate<'m> {
    pub(super) estimator: JointEstimator<'m, f32>,
    /// Cameras by their number in the estimator. One that was moved has two.
    cameras: heapless::Vec<Camera, CAMERAS>,
    /// What each was told, or is to be told.
    told: &'m mut [Option<Report>; CAMERAS],
    /// To be told: a bit for each camera.
    news: u32,
    /// Bearings before this one are written down, or are to be.
    pub(super) saved: usize,
    /// Stops of a former run are not in their order yet.
    pub(super) is_restoring: bool,
    /// The way since the last stop, as the sensor read it.
    pub(super) way: Option<(Vector2<f32>, Matrix2<f32>)>,
    frame: Option<Frame>,
    /// Direction of the sensor's x axis in the frame of the site before anything is estimated, and
    /// its sigma.
    sensor: Option<(f32, f32)>,
    /// There is something that the last solve did not have.
    pub(super) is_new: bool,
}

impl<'m> Estimate<'m> {
    pub(super) fn new(memory: EstimateMemory<'m>) -> Option<Self> {
        let told = memory.told;
        told.fill(None);
        let memory = JointMemory {
            cameras: memory.cameras,
            stops: memory.stops,
            bearings: memory.bearings,
            marks: &mut [],
            visits: &mut [],
            workspace: memory.workspace,
        };
        let estimator = JointEstimator::new(memory, 1.0, JointSettings::default()).ok()?;
        Some(Self {
            estimator,
            cameras: heapless::Vec::new(),
            told,
            news: 0,
            saved: 0,
            is_restoring: false,
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

    /// A camera saw the target at a stop. `radius` is that of the ball, 0 if nobody knows it.
    pub(super) fn on_seen(
        &mut self,
        camera: MemberAddress,
        stop: StopNumber,
        seen: &Seen,
        radius: f32,
        unsaved: &mut Unsaved,
    ) {
        let is_known = |index| self.has(index, camera, Quantity::Bearing);
        if self.index(stop).is_none_or(is_known) {
            return;
        }
        self.make_room_for_bearing(unsaved);
        let (Some(stop), Some(camera)) = (self.index(stop), self.number(camera)) else {
            return;
        };
        let added = self
            .estimator
            .add_bearing(stop, camera, seen.bearing, seen.sigma);
        self.is_new |= added.is_ok();
        // Ranges leave room for bearings, which are worth more.
        if let Some((range, sigma)) = seen.range(radius)
            && added.is_ok()
            && self.estimator.bearings() < WALK_BEARINGS / 2
        {
            let added = self.estimator.add_range(stop, camera, range, sigma);
            debug_assert_eq!(added, Ok(()), "there is room");
        }
        self.save_bearings(false, unsaved);
    }

    /// The address of a camera of the estimator.
    pub(super) fn address(&self, camera: usize) -> Option<MemberAddress> {
        Some(self.cameras.get(camera)?.address)
    }

    /// Whether it is known how the target came to where it is from its last stop.
    pub(super) const fn knows_way(&self) -> bool {
        self.way.is_some()
    }

    /// The number of a camera, a new one if there is room.
    pub(super) fn number(&mut self, address: MemberAddress) -> Option<usize> {
        let is_it = |known: &Camera| known.address == address && !known.is_successor;
        if let Some(number) = self.cameras.iter().position(is_it) {
            return Some(number);
        }
        self.add(address, false)
    }

    fn add(&mut self, address: MemberAddress, is_successor: bool) -> Option<usize> {
        let camera = Camera {
            address,
            is_doubtful: false,
            successor: None,
            is_successor,
        };
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
            standing: config.standing_sigma,
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
        self.told.fill(None);
        exchange(&mut self.cameras, 0, first);
        exchange(
            &mut self.cameras,
            1,
            if second == 0 { first } else { second },
        );
        self.frame = Some(frame);
        self.is_new = true;
    }

    /// Begins to estimate everything anew, if there is something new: whether that is so.
    pub(super) fn begin(&mut self) -> bool {
        let begins = self.frame.is_some() && core::mem::take(&mut self.is_new);
        if begins {
            self.estimator.begin(ROUND);
        }
        begins
    }

    /// Some of the work. `None`: there is more. Else what came of it, if anything did.
    // stack
    #[inline(never)]
    pub(super) fn step(&mut self) -> Option<Option<Estimated>> {
        match self.estimator.step() {
            Ok(Progress::Working) => None,
            Ok(Progress::Found(finding)) => {
                self.on_found(&finding);
                None
            }
            Ok(Progress::Over(solution)) => Some(self.answers(&solution)),
            Err(_) => {
                debug!("nothing that was measured can be estimated together");
                Some(None)
            }
        }
    }

    /// Something contradicts the rest. A camera that does has been moved: it is estimated anew.
    fn on_found(&mut self, finding: &Finding<f32>) {
        let &Finding::Camera { camera, from, .. } = finding else {
            return;
        };
        let Some(found) = self.cameras.get(camera).copied() else {
            return;
        };
        let into = match found.successor {
            None => self.add(found.address, true),
            Some(_) => None,
        };
        let is_split = into.is_some_and(|into| self.estimator.split(camera, from, into).is_ok());
        if let Some(found) = self.cameras.get_mut(camera) {
            found.is_doubtful = true;
            found.successor = into.filter(|_| is_split).map(|into| into as u8);
        }
        self.is_new |= is_split;
    }

    /// Where the target is, and what cameras are to be told.
    // stack
    #[inline(never)]
    fn answers(&mut self, solution: &JointSolution<f32>) -> Option<Estimated> {
        let frame = self.frame?;
        let carrier = self.estimator.carrier().ok()?;
        let last = self.estimator.stops().checked_sub(1)?;
        let place = self.estimator.place(last).ok()?;
        let inflation = solution.fit.inflation();
        let turn = frame.turn();
        for camera in 0..self.cameras.len() {
            let report = self.report(camera, &frame, solution);
            if let (Some(report), Some(told)) = (report, self.told.get_mut(camera))
                && told.is_none_or(|told| is_news(&told, &report))
            {
                *told = Some(report);
                self.news |= 1 << camera;
            }
        }
        let sigmas = carrier.covariance * inflation;
        Some(Estimated {
            stop: self.stop_number(last)?,
            position: frame.origin + turn * place.position.coords,
            covariance: angle::turned(&(place.covariance * inflation), &turn),
            frame_heading: (
                angle::wrap_signed(frame.direction - carrier.compass),
                root(sigmas.m22),
            ),
            scale: (carrier.scale, root(sigmas.m11)),
        })
    }

    /// What a camera is to be told. One that was moved is where it is now; before anybody knows where
    /// that is, its pose of before is doubtful.
    // stack
    #[inline(never)]
    fn report(
        &mut self,
        camera: usize,
        frame: &Frame,
        solution: &JointSolution<f32>,
    ) -> Option<Report> {
        let known = *self
            .cameras
            .get(camera)
            .filter(|known| !known.is_successor)?;
        let successor = known.successor.map(usize::from);
        let moved = successor.and_then(|now| Some((now, self.estimator.pose(now).ok()?)));
        let is_found = moved.is_some();
        let (camera, pose) = match moved {
            Some(moved) => moved,
            None => (camera, self.estimator.pose(camera).ok()?),
        };
        let protection = self.estimator.protection(camera);
        let pose = pose.seen_from(frame.origin, frame.direction);
        let parts = PoseParts::from(Pose {
            covariance: pose.covariance * solution.fit.inflation(),
            ..pose
        });
        let [came, count] = self.estimator.bearings_of(camera);
        // Whom most of what it saw contradicts is not believed; nor is one that was moved.
        let is_outvoted = 2 * count <= came;
        let is_doubtful = is_outvoted || (known.is_doubtful && !is_found);
        // The camera itself knows what is good enough.
        let state = if solution.fit.is_bad() || is_doubtful {
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
            joint: Some(protection.map_or(ProtectionLevel::NONE, ProtectionLevel::from)),
            state,
        })
    }

    /// Cameras that are to be told something new. Says so once.
    pub(super) fn take_news(&mut self) -> impl Iterator<Item = MemberAddress> {
        let news = core::mem::take(&mut self.news);
        let cameras = self.cameras.iter().enumerate();
        cameras.filter_map(move |(n, camera)| (news & (1 << n) != 0).then_some(camera.address))
    }

    /// What these cameras are to be told.
    pub(super) fn reports(&self) -> impl Iterator<Item = (MemberAddress, &Report)> {
        let told = self.cameras.iter().zip(&*self.told);
        told.filter_map(|(camera, report)| Some((camera.address, report.as_ref()?)))
    }

    /// Forgets what was measured among other cameras.
    pub(super) fn clear(&mut self, unsaved: &mut Unsaved) {
        self.forget_records(unsaved);
        self.estimator.clear();
        self.cameras.clear();
        self.told.fill(None);
        self.news = 0;
        self.way = None;
        self.frame = None;
        self.is_new = false;
    }
}

fn exchange(list: &mut [Camera], a: usize, b: usize) {
    if let (Some(&one), Some(&other)) = (list.get(a), list.get(b)) {
        for (place, address) in [(a, other), (b, one)] {
            if let Some(kept) = list.get_mut(place) {
                *kept = address;
            }
        }
    }
}
