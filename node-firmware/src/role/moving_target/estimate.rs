//! Joint estimate of all measurements: the stops of this target, the cameras that saw it there, and its own
//! step sensor.
//!
//! The target has all measurements: it measures the legs from stop to stop, and every camera that sees it answers with
//! a bearing. The result of the [estimator](calib_core::joint) corrects the place of the target and its steps. The
//! target sends each camera its pose.

use calib_core::{
    Pose, Refusal, Status, angle,
    dead_reckoning::{Step, Systematic},
    fit::RARE,
    joint::{
        BearingStorage, Capacity, Finding, JointError, JointEstimator, JointMemory, JointSettings,
        JointSolution, Prior, Progress, Quantity, REFERENCES, Round, StopStorage, UnknownStorage,
        is_consensus,
    },
    level::Levelness,
};
use flash_log::DirtySet;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use crate::{
    arithmetic::root,
    config::TargetConfig,
    limits::{ESTIMATED_CAMERAS, ESTIMATED_STOPS, WALK_BEARINGS},
    log::debug,
    message::{
        CameraState, Duty, MemberAddress, Mount, PoseParts, ProtectionLevel, Report, Seen,
        StopNumber,
    },
    role::{CONTRADICTION, Unsaved, contradiction, is_news},
};

use super::{
    frame::{Arrival, Frame},
    sizes::{self, Radius, Sizes},
    table::{CameraEntry, Table},
};

#[cfg(test)]
mod tests;

/// Cameras that take part.
pub const CAMERAS: usize = ESTIMATED_CAMERAS;
/// Numbers in the workspace of the estimator.
pub const WORKSPACE: usize = Capacity {
    cameras: CAMERAS,
    stops: ESTIMATED_STOPS,
    bearings: WALK_BEARINGS,
    marks: 0,
}
.workspace_with_lenses();

/// Work after each stop: leave out contradictions (`findings` at most), estimate the noise of the legs, and compute
/// protection levels.
const ROUND: Round = Round {
    findings: 4,
    leg_noise: true,
    protection: true,
};

/// Sigma of a direction that only the bearings tell, radians.
const VAGUE: f32 = 0.5;

/// Relative sigma of a baseline that is hardly known.
const STRETCH: f32 = 0.2;

/// Least sigma of a leg, a scale or a direction: rounding errors are as large.
pub(super) const LEAST_SIGMA: f32 = 1e-3;

/// Stops that both references have to see before they define a frame.
const FRAME_STOPS: usize = 3;

/// Stops after which a reference that saw the target at none of them counts as lost.
const LOST_STOPS: usize = 12;

/// Pairs of cameras that are tried as references at one stop.
const FAILED: usize = 6;

/// Bearings of a camera at its new place after which no slipped leg can explain them: it was moved.
const SETTLED: usize = 8;

/// Limit of the protection level, in sigmas of the place. Beyond it the pose depends on a single measurement.
const HANGS: f32 = 12.0;

/// Measurements left out from which on a further wrong one is likely, which no test noticed. Of 59,469 calibrated poses
/// of the campaign 115 depended on a single measurement while so many were left out, and 21 of them deceived.
const SEVERAL: usize = 2;

/// Measurements left out and factor of the legs' noise. Where both are exceeded, wrong bearings may look like noise of
/// the legs, and the other way round: no pose is sure. Of 9,953 calibrated poses of the campaign 134 were beyond both,
/// and 4 of them deceived; of all others 2 did.
const MANY: usize = 3;
const RESTLESS: f32 = 3.0;

/// Further bearings after which a pose is doubtful if the camera has no pose with them.
const CONTRADICTING: usize = 2;

/// Stops in a row without a result after which poses are no longer sure: something contradicts the rest that no search
/// finds.
const UNSOLVED: u8 = 5;

/// Some of the cameras.
type CameraSet = DirtySet<{ CAMERAS.div_ceil(u32::BITS as usize) }>;

/// Returns true if a camera is one of these.
fn has(cameras: &CameraSet, camera: usize) -> bool {
    cameras.first_in(&(camera..camera + 1)).is_some()
}

/// Memory for a target's measurements and estimates.
#[derive(Debug)]
pub struct EstimateMemory<'m> {
    /// Cameras, references included.
    pub cameras: &'m mut [UnknownStorage<f32>; CAMERAS],
    /// Stops.
    pub stops: &'m mut [StopStorage<f32>; ESTIMATED_STOPS],
    /// Bearings.
    pub bearings: &'m mut [BearingStorage<f32>; WALK_BEARINGS],
    /// Workspace.
    pub workspace: &'m mut [f32; WORKSPACE],
    /// Reports that the target sent to cameras about themselves.
    pub told: &'m mut [Option<Report>; CAMERAS],
}

/// Place of the target, and the estimate of its steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimated {
    pub(super) stop: StopNumber,
    pub(super) position: Point2<f32>,
    pub(super) covariance: Matrix2<f32>,
    /// Direction of the x axis of the step sensor in the frame of the site, and its sigma.
    pub(super) frame_heading: (f32, f32),
    /// Ratio of the step sensor's reading to the true length, and its sigma.
    pub(super) scale: (f32, f32),
}

/// A camera of the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Camera {
    address: MemberAddress,
    /// True for the second entry of a camera that was moved: its pose since then.
    is_successor: bool,
}

/// Agreement of the poses that the cameras hold with the estimate.
#[derive(Clone, Copy, Debug, Default)]
struct Votes {
    agree: usize,
    /// Cameras that disagree.
    against: usize,
    /// The camera that disagrees most, and its chi squared.
    worst: Option<(usize, f32)>,
}

impl Camera {
    /// Entry that is free.
    const FREE: Self = Self {
        address: MemberAddress::MAX,
        is_successor: true,
    };
}

impl Votes {
    /// Returns true if more cameras agree than disagree: then those were moved. Otherwise the frame may be wrong.
    const fn are_for(&self) -> bool {
        self.against == 0 || self.agree > self.against
    }
}

/// Measurements, and their joint result.
#[derive(Debug)]
pub(super) struct Estimate<'m> {
    pub(super) estimator: JointEstimator<'m, f32>,
    /// Cameras, by their number in the estimator. A moved camera has two entries.
    cameras: heapless::Vec<Camera, CAMERAS>,
    /// Last report for each camera, sent or to be sent.
    told: &'m mut [Option<Report>; CAMERAS],
    /// Cameras to which a report is to be sent.
    news: CameraSet,
    /// Cameras to which a report is to be sent after the next solve, even if it is the same.
    again: CameraSet,
    /// Moved cameras of which the former place is to be forgotten.
    past: CameraSet,
    /// Number of bearings that are saved, or are to be saved.
    pub(super) saved: usize,
    /// True while stops are restored from memory, in any order.
    pub(super) is_restoring: bool,
    /// Displacement since the last stop as the sensor measured it, and its covariance.
    pub(super) way: Option<(Vector2<f32>, Matrix2<f32>)>,
    frame: Option<Frame>,
    /// State that a target brought along from another network.
    arrival: Option<Arrival>,
    /// Reference that does not stand where the frame needs it.
    rejected: Option<MemberAddress>,
    /// Pairs of cameras whose sightings so far give no frame.
    pub(super) failed: heapless::Vec<[MemberAddress; 2], FAILED>,
    /// Direction of the sensor's x axis in the frame of the site before anything is estimated, and
    /// its sigma.
    sensor: Option<(f32, f32)>,
    /// True if something was measured since the last solve.
    pub(super) is_new: bool,
    sizes: Sizes,
    /// Last stop that counts in the round under way, or in the last one.
    round: Option<StopNumber>,
    /// Stops in a row without a result, and the last of them.
    unsolved: (u8, Option<StopNumber>),
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
            news: CameraSet::new(),
            again: CameraSet::new(),
            past: CameraSet::new(),
            saved: 0,
            is_restoring: false,
            way: None,
            frame: None,
            arrival: None,
            rejected: None,
            failed: heapless::Vec::new(),
            sensor: None,
            is_new: false,
            sizes: Sizes::default(),
            round: None,
            unsolved: (0, None),
        })
    }

    /// Adds a step, as the sensor measured it.
    pub(super) fn on_step(&mut self, step: &Step<f32>) {
        if let Some((walked, covariance)) = &mut self.way {
            *walked += step.displacement();
            *covariance += step.covariance();
        }
    }

    /// Marks the displacement to the next stop as unknown.
    pub(super) const fn lose_way(&mut self) {
        self.way = None;
    }

    /// Adds what a camera saw at a stop. `radius` is that of the ball, 0 if unknown.
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
        self.sizes.on_seen(camera, stop, seen);
        // If there is no room for the camera, its measurement is dropped.
        let Some(camera) = self.number(camera) else {
            return;
        };
        self.make_room_for_bearing(unsaved);
        let Some(stop) = self.index(stop) else {
            return;
        };
        let added = self
            .estimator
            .add_bearing(stop, camera, seen.bearing, seen.sigma)
            .and_then(|()| self.estimator.add_elevation(seen.elevation));
        self.is_new |= added.is_ok();
        // Ranges fill half of the memory at most: bearings tell more.
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

    /// Returns true if the way of the target from its last stop is known.
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
            is_successor,
        };
        let free = self.cameras.iter().position(|known| *known == Camera::FREE);
        if let Some(place) = free.and_then(|free| self.cameras.get_mut(free)) {
            *place = camera;
            return free;
        }
        self.cameras.push(camera).ok()?;
        Some(self.cameras.len() - 1)
    }

    /// Sets the direction of the sensor as known before the estimate. A direction that was computed from bearings
    /// counts as unknown: the estimate has these bearings already.
    pub(super) const fn on_sensor(&mut self, heading: f32, sigma: f32) {
        if self.frame.is_none() {
            let sigma = if sigma > 0.0 { VAGUE } else { sigma };
            self.sensor = Some((heading, sigma));
        }
    }

    /// Sets the state of a target that came from another network, at a stop of which it knows the place. Before there
    /// is a frame, the newest stop at which a camera saw the target is used.
    pub(super) fn arrive(&mut self, arrival: Arrival) {
        let is_seen = self.arrival.is_some_and(|before| {
            let index = self.index(before.stop);
            let mut all = (0..self.estimator.bearings()).filter_map(|n| self.estimator.measured(n));
            all.any(|measured| Some(measured.stop) == index)
        });
        if self.frame.is_none() && !is_seen {
            self.arrival = Some(arrival);
        }
    }

    /// Takes a camera's report of itself. A camera that forgot its pose, or doubts it, gets its report again.
    pub(super) fn on_report(&mut self, address: MemberAddress, report: &Report) {
        let is_it = |camera: &Camera| camera.address == address && !camera.is_successor;
        let Some(camera) = self.cameras.iter().position(is_it) else {
            return;
        };
        let holds_it = report.joint.is_some() && report.status() != Status::Doubtful;
        let told = self.told.get(camera).copied().flatten();
        if told.is_some_and(|told| told.status() != Status::Doubtful) && !holds_it {
            // Only after the next stop: that may show a contradiction.
            self.again.mark(camera);
            if report.joint.is_none() {
                self.news.mark(camera);
            }
        }
    }

    /// Returns true if there is no frame, or its references do not serve.
    fn wants_frame(&self) -> bool {
        let Some(frame) = &self.frame else {
            return true;
        };
        let is_rejected = |camera: &MemberAddress| self.rejected == Some(*camera);
        frame.references.iter().any(is_rejected)
            || self.failed.contains(&frame.references)
            || !self.estimator.is_started()
                && self.estimator.stops() >= LOST_STOPS
                && self.common_stops(&frame.references) < FRAME_STOPS
    }

    fn common_stops(&self, cameras: &[MemberAddress; 2]) -> usize {
        let number = |address: MemberAddress| {
            let is_it = |camera: &Camera| camera.address == address && !camera.is_successor;
            self.cameras.iter().position(is_it)
        };
        match cameras.map(number) {
            [Some(one), Some(other)] => self.estimator.common_stops(one, other),
            _ => 0,
        }
    }

    /// Finds a frame where there is none: between the references or, if one of these is dead or was moved, between the
    /// two cameras with the best known poses.
    pub(super) fn find_frame(&mut self, table: &Table, config: &TargetConfig) {
        let pose = |entry: &CameraEntry| {
            let report = entry
                .report
                .filter(|_| self.rejected != Some(entry.address))?;
            let is_good = report.status() != Status::Doubtful;
            Some((entry.address, report.pose().filter(|_| is_good)?.pose()?))
        };
        let has_failed = |pair: &[(MemberAddress, Pose<f32>); 2]| {
            let [a, b] = pair.map(|(address, _)| address);
            self.failed.contains(&[a, b]) || self.failed.contains(&[b, a])
        };
        let serves = |pair: &[(MemberAddress, Pose<f32>); 2]| {
            self.common_stops(&pair.map(|(address, _)| address)) >= FRAME_STOPS
        };
        if self.failed.is_full() {
            return;
        }
        let mut on_duty = [None; 2];
        for (found, duty) in on_duty.iter_mut().zip([Duty::First, Duty::Second]) {
            *found = table.iter().find_map(|entry| {
                entry.report.filter(|report| report.duty == Some(duty))?;
                pose(&entry)
            });
        }
        let mut found = match on_duty {
            [Some(first), Some(second)] => Some([first, second]).filter(|pair| !has_failed(pair)),
            _ => None,
        };
        // A distance of the references that a target from another network found defines no frame.
        let is_measured = |pair| {
            Frame::between(pair, self.arrival.as_ref()).is_none_or(|frame| !frame.is_exact())
        };
        if self.frame.is_none() && found.is_some_and(is_measured) {
            return;
        }
        let wants_frame = self.wants_frame();
        if !wants_frame {
            // The places of references were given: no frame is better than theirs.
            let is_poor = self.frame.is_some_and(|frame| !frame.is_given());
            let is_better = |pair: &[(MemberAddress, Pose<f32>); 2]| {
                let frame = Frame::between(*pair, None);
                frame.is_some_and(|frame| frame.is_given()) && serves(pair)
            };
            found = found.filter(|pair| is_poor && is_better(pair));
        } else if self.rejected.is_some()
            || !self.failed.is_empty()
            || self.estimator.stops() >= LOST_STOPS && !found.as_ref().is_some_and(serves)
        {
            let mut best = f32::INFINITY;
            for first in table.iter().filter_map(|entry| pose(&entry)) {
                for second in table.iter().filter_map(|entry| pose(&entry)) {
                    let pair = [first, second];
                    let frame = Frame::between(pair, self.arrival.as_ref());
                    let Some(frame) = frame.filter(|_| first.0 < second.0) else {
                        continue;
                    };
                    let share = frame.share();
                    if share < best && !has_failed(&pair) && serves(&pair) {
                        best = share;
                        found = Some(pair);
                    }
                }
            }
        }
        if let Some(references) = found {
            self.on_references(references, config);
        }
    }

    /// The references are these, with these poses.
    fn on_references(
        &mut self,
        references: [(MemberAddress, Pose<f32>); 2],
        config: &TargetConfig,
    ) {
        let poses = references.map(|(_, pose)| pose);
        let is_given = poses.iter().all(|pose| pose.sigma_position() == 0.0);
        if is_given {
            self.arrival = None;
        }
        let Some(frame) = Frame::between(references, self.arrival.as_ref()) else {
            return;
        };
        let frame = frame.surveyed(&config.survey_sigma, config.systematic_scale);
        if self.frame == Some(frame) {
            return;
        }
        let Some((scale, compass)) = self.priors(&frame, config) else {
            return;
        };
        let [focal, principal] = config.lens_sigma.of_tangent();
        let mut settings = JointSettings::default();
        settings.scale = scale;
        settings.compass = compass;
        settings.standing = config.standing_sigma;
        settings.tilt = config.lens_sigma.tilt_deg.to_radians();
        settings.lens = Some(focal);
        settings.principal = Some(principal);
        settings.are_ranges_seen = true;
        settings.is_baseline_known = frame.is_baseline_known();
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

    /// Prior of the carrier's scale and compass in a frame before anything is estimated.
    fn priors(&self, frame: &Frame, config: &TargetConfig) -> Option<(Prior<f32>, Prior<f32>)> {
        if let Some(arrival) = &self.arrival {
            // The arrival tells where the frame is, not the other way round.
            let heading = angle::wrap_signed(frame.direction - arrival.heading);
            let [scale, compass] = [(arrival.scale, STRETCH), (heading, VAGUE)];
            return Some((prior(scale), prior(compass)));
        }
        let (heading, sigma) = self.sensor?;
        let own = config.systematic_heading_deg.to_radians();
        let sigma = root(own * own + sigma * sigma).max(LEAST_SIGMA);
        Some((
            prior((1.0, config.systematic_scale.max(LEAST_SIGMA))),
            prior((angle::wrap_signed(frame.direction - heading), sigma)),
        ))
    }

    /// Begins to estimate everything anew, if there is something new: returns true if that is so.
    pub(super) fn begin(&mut self, unsaved: &mut Unsaved) -> bool {
        let begins = !self.wants_frame() && core::mem::take(&mut self.is_new);
        if begins {
            self.forget_past(unsaved);
            let last = self.estimator.stops().checked_sub(1);
            self.round = last.and_then(|last| self.stop_number(last));
            self.estimator.begin(ROUND);
        }
        begins
    }

    /// Forgets former places of moved cameras, so that there is room for further moves. All bearings are then to be
    /// saved anew.
    pub(super) fn forget_past(&mut self, unsaved: &mut Unsaved) {
        for camera in REFERENCES..self.cameras.len() {
            let Some(now) = successor(&self.estimator, camera) else {
                continue;
            };
            let [_, count] = self.estimator.bearings_of(now);
            if count < SETTLED && !has(&self.past, camera) {
                continue;
            }
            // Also those that will be empty.
            self.rewrite_bearings(unsaved);
            if self.estimator.forget_past(camera).is_ok()
                && let Some(number) = self.cameras.get_mut(now)
            {
                debug!("the former place of a moved camera is forgotten");
                *number = Camera::FREE;
                self.saved = self.estimator.bearings();
            }
        }
        self.past = CameraSet::new();
    }

    /// Does a slice of the work. Returns `None` while there is more, then the result, if there is one.
    // for less stack
    #[inline(never)]
    pub(super) fn step(&mut self, table: &Table) -> Option<Option<Estimated>> {
        match self.estimator.step() {
            Ok(Progress::Working) => None,
            Ok(Progress::Found(finding)) => {
                self.on_found(&finding);
                None
            }
            Ok(Progress::Over(solution)) => {
                let answers = self.answers(&solution, table);
                // A stop that came meanwhile is of the next round.
                match self.round.and_then(|stop| self.index(stop)) {
                    Some(last) if self.estimator.place(last).is_ok() => self.unsolved = (0, None),
                    Some(_) => self.on_unsolved(table),
                    None => {}
                }
                Some(answers)
            }
            Err(error) => {
                if let (JointError::Start(why), Some(frame)) = (error, self.frame)
                    && why != Refusal::TooFew
                {
                    // One of the two may have been moved. Another pair may give a frame.
                    let has_room = self.failed.push(frame.references).is_ok();
                    debug_assert!(has_room, "no more are tried at a stop");
                    if why != Refusal::Undetermined {
                        self.doubt(&frame, table);
                    }
                }
                debug!("nothing that was measured can be estimated together");
                // So ends a round that was given up, too.
                let is_too_early = matches!(
                    error,
                    JointError::Start(Refusal::TooFew) | JointError::Solve(Refusal::TooFew)
                );
                if !is_too_early {
                    self.on_unsolved(table);
                }
                Some(None)
            }
        }
    }

    /// The sightings of both references contradict each other, though both knew their poses: it is not known
    /// which of them was moved. After many stops, a pose that a camera found by itself is doubtful too: it rests on
    /// places that these references told.
    fn doubt(&mut self, frame: &Frame, table: &Table) {
        let common = self.common_stops(&frame.references);
        if !frame.is_exact() || common <= FRAME_STOPS {
            return;
        }
        for (n, camera) in self.cameras.iter().enumerate() {
            let is_reference = n < frame.references.len();
            let entry = table.iter().find(|entry| entry.address == camera.address);
            let is_good = |report: &Report| report.status() == Status::Calibrated;
            let held = entry.and_then(|entry| entry.report).filter(|report| {
                report.joint.is_some() == is_reference
                    && (is_reference || common >= LOST_STOPS && is_good(report))
            });
            if let Some((report, pose)) = held.and_then(|report| Some((report, *report.pose()?)))
                && let Some(told) = self.told.get_mut(n)
                && told.is_none_or(|told| told.status() != Status::Doubtful)
            {
                *told = Some(Report {
                    duty: None,
                    joint: report.joint.or(Some(ProtectionLevel::NONE)),
                    state: CameraState::Doubtful(pose),
                    ..report
                });
                self.news.mark(n);
            }
        }
    }

    /// Something contradicts the rest. A camera that does has been moved: it is estimated anew.
    pub(super) fn on_found(&mut self, finding: &Finding<f32>) {
        let &Finding::Camera { camera, from, .. } = finding else {
            return;
        };
        let Some(found) = self.cameras.get(camera).copied() else {
            return;
        };
        if successor(&self.estimator, camera).is_some() {
            return;
        }
        let is_it = |known: &Camera| known.address == found.address && known.is_successor;
        let known = self.cameras.iter().position(is_it);
        if !found.is_successor
            && let Some(into) = known.or_else(|| self.add(found.address, true))
        {
            self.is_new |= self.estimator.split(camera, from, into).is_ok();
            return;
        }
        // It was moved again, or no entry is free: forget a former place. The next round finds this camera again.
        let is_over = |&past: &usize| {
            let now = successor(&self.estimator, past);
            now.is_some_and(|now| !found.is_successor || now == camera)
        };
        if let Some(past) = (REFERENCES..self.cameras.len()).find(is_over) {
            self.past.mark(past);
            self.is_new = true;
        }
    }

    /// Nothing fits the measurements at this stop, or nothing tells where it is. After several such stops in a row the poses
    /// are weak of all cameras that saw the target meanwhile: these sightings did not confirm them.
    // for less stack
    #[inline(never)]
    fn on_unsolved(&mut self, table: &Table) {
        let (count, before) = &mut self.unsolved;
        if *before != self.round {
            *before = self.round;
            *count = count.saturating_add(1);
        }
        if *count < UNSOLVED {
            return;
        }
        for (n, camera) in self.cameras.iter().enumerate() {
            let [came, _] = self.estimator.bearings_of(n);
            let Some(told) = self.told.get_mut(n).filter(|_| !camera.is_successor) else {
                continue;
            };
            let entry = table.iter().find(|entry| entry.address == camera.address);
            if let Some(mut report) = told.or_else(|| entry?.report)
                && let CameraState::Calibrated(pose) | CameraState::Weak(pose) = report.state
                && report.joint.is_some_and(|level| !level.is_none())
                && came >= usize::from(report.sightings) + CONTRADICTING
            {
                report.duty = None;
                report.joint = Some(ProtectionLevel::NONE);
                report.state = CameraState::Weak(pose);
                *told = Some(report);
                self.news.mark(n);
            }
        }
    }

    /// Place of the target, and the reports for cameras.
    // for less stack
    #[inline(never)]
    fn answers(&mut self, solution: &JointSolution<f32>, table: &Table) -> Option<Estimated> {
        let carrier = self.estimator.carrier().ok()?;
        let inflation = solution.fit.inflation();
        let mut frame = self.frame?;
        if let Some(arrival) = self.arrival {
            // If the stop was dropped meanwhile, the frame has its information already.
            if let Some(stop) = self.index(arrival.stop)
                && let Ok(stop) = self.estimator.place(stop)
            {
                frame = frame.arrived(&arrival, &stop, &carrier, inflation);
                self.frame = Some(frame);
            } else if frame.share().is_finite() {
                return None;
            }
        }
        let votes = self.votes(&frame, solution, table);
        let is_believed = votes.are_for();
        if let Some((worst, _)) = votes.worst.filter(|_| !is_believed)
            && let Some(worst) = self.cameras.get(worst)
            && frame.references.contains(&worst.address)
        {
            debug!("a reference is not where it was");
            self.rejected = Some(worst.address);
        }
        // If the rows of a reference contradict every mounting, the frame is wrong for all cameras.
        let inflation = solution.fit.inflation();
        let hung = [0, 1].map(|reference| self.estimator.levelness(reference, inflation));
        let is_frame_refused = { hung.iter().flatten() }.any(Levelness::is_refused);
        let frame = frame.hung(hung.map(|found| found.map_or(0.0, |found| found.shift_variance)));
        let frame = frame.tested_by(carrier.scale);
        // A pose is no better than its frame. If a reference is known to be moved, its sightings before the move define
        // the frame.
        let is_frame_doubtful = (0..).zip(&frame.references).any(|(n, &reference)| {
            let entry = table.iter().find(|entry| entry.address == reference);
            let report = entry.and_then(|entry| entry.report);
            report.is_some_and(|report| report.status() == Status::Doubtful)
                && self.estimator.moved(n).is_none()
        });
        let doubts = [is_frame_doubtful, is_frame_refused];
        let radii = self.radii(inflation);
        let again = core::mem::take(&mut self.again);
        for camera in 0..self.cameras.len() {
            let Some(mut report) = self.report(camera, &frame, solution, doubts) else {
                if is_believed {
                    self.doubt_without_pose(camera);
                }
                continue;
            };
            let is_off = sizes::is_off(&radii, camera, sizes::WRONG);
            if let Some(pose) = report.pose().copied().filter(|_| is_off) {
                report.state = CameraState::Doubtful(pose);
            }
            if let CameraState::Weak(parts) = report.state
                && camera >= REFERENCES
                && let Some(elsewhere) = self.upside_down(camera, &radii, inflation)
                && let Some(pose) = parts.pose()
            {
                report.state = CameraState::Weak(either(pose, frame.place(elsewhere)).into());
            }
            if !is_believed {
                let holds = self
                    .cameras
                    .get(camera)
                    .and_then(|of| held(table, of.address));
                let is_worst = votes.worst.is_some_and(|(worst, _)| worst == camera);
                if let Some(pose) = report
                    .pose()
                    .copied()
                    .filter(|_| is_worst || holds.is_none())
                {
                    report.state = CameraState::Doubtful(pose);
                } else {
                    // A result that most cameras contradict does not replace a pose.
                    continue;
                }
            }
            let asks = has(&again, camera);
            if let Some(told) = self.told.get_mut(camera)
                && (asks || told.is_none_or(|told| is_news(&told, &report)))
            {
                *told = Some(report);
                self.news.mark(camera);
            }
        }
        if !is_believed {
            return None;
        }
        let last = self.estimator.stops().checked_sub(1)?;
        let place = self.estimator.place(last).ok()?;
        let sigmas = carrier.covariance * inflation;
        let (frame_heading, scale) = match &self.arrival {
            // The state that the target brought along is better than anything here.
            Some(arrival) => {
                let Systematic {
                    heading_sigma,
                    scale_sigma,
                } = arrival.sigmas();
                let scale = (arrival.scale, scale_sigma * arrival.scale);
                ((arrival.heading, heading_sigma), scale)
            }
            None => {
                let stretched = frame.turned() * carrier.scale * carrier.scale;
                let heading = angle::wrap_signed(frame.direction - carrier.compass);
                (
                    (heading, root(sigmas.m22 + frame.turned())),
                    (carrier.scale, root(sigmas.m11 + stretched)),
                )
            }
        };
        Some(Estimated {
            stop: self.stop_number(last)?,
            position: frame.place(place.position),
            covariance: frame.place_covariance(place.position, &(place.covariance * inflation)),
            frame_heading,
            scale,
        })
    }

    /// Calls the pose of a camera doubtful if its bearings fit no pose any more with those that came since.
    fn doubt_without_pose(&mut self, camera: usize) {
        let [came, _] = self.estimator.bearings_of(camera);
        let is_known = { self.cameras.get(camera) }.is_some_and(|of| !of.is_successor);
        let Some(told) = self.told.get_mut(camera).and_then(Option::as_mut) else {
            return;
        };
        if let Some(pose) = told.pose().copied()
            && told.status() != Status::Doubtful
            && is_known
            && came >= usize::from(told.sightings) + CONTRADICTING
        {
            told.state = CameraState::Doubtful(pose);
            told.sightings = came.try_into().unwrap_or(u8::MAX);
            self.news.mark(camera);
        }
    }

    /// Radius of the ball by the pose of each camera. A camera that was moved has none.
    // for less stack
    #[inline(never)]
    fn radii(&mut self, inflation: f32) -> heapless::Vec<Option<Radius>, CAMERAS> {
        let mut radii = heapless::Vec::new();
        for camera in 0..self.cameras.len() {
            let radius = self.radius(camera, inflation);
            let has_room = radii.push(radius);
            debug_assert!(has_room.is_ok(), "it has room for all");
        }
        radii
    }

    // for less stack
    #[inline(never)]
    fn radius(&mut self, camera: usize, inflation: f32) -> Option<Radius> {
        let pose = self.estimator.pose(camera).ok()?;
        let hung = self.estimator.levelness(camera, inflation);
        let mount = hung.and_then(|hung| Mount::of(hung.mounting, hung.height));
        let sigma = pose.sigma_position() * root(inflation);
        self.radius_from(camera, (pose.position, sigma), mount)
    }

    /// Radius of the ball by a camera if it stands here, `sigma` in its place.
    fn radius_from(
        &self,
        camera: usize,
        stands: (Point2<f32>, f32),
        mount: Option<Mount>,
    ) -> Option<Radius> {
        let of = self.cameras.get(camera).filter(|of| !of.is_successor)?;
        let is_moved = successor(&self.estimator, camera).is_some();
        let place = |stop| self.estimator.position(self.index(stop)?);
        (!is_moved).then(|| self.sizes.radius(of.address, stands, mount, place))?
    }

    /// Place where a camera would stand if it hung upside down: its bearings fit there as well, and so does the size of the
    /// ball.
    // for less stack
    #[inline(never)]
    fn upside_down(
        &mut self,
        camera: usize,
        radii: &heapless::Vec<Option<Radius>, CAMERAS>,
        inflation: f32,
    ) -> Option<Point2<f32>> {
        let elsewhere = self.estimator.mirrored(camera)?;
        let sigma = self.estimator.pose(camera).ok()?.sigma_position() * root(inflation);
        let mut radii = radii.clone();
        *radii.get_mut(camera)? = self.radius_from(camera, (elsewhere, sigma), None);
        (!sizes::is_off(&radii, camera, sizes::UNLIKELY)).then_some(elsewhere)
    }

    /// Agreement of the poses that cameras hold with the estimate.
    // for less stack
    #[inline(never)]
    fn votes(&mut self, frame: &Frame, solution: &JointSolution<f32>, table: &Table) -> Votes {
        let mut votes = Votes::default();
        for camera in 0..self.cameras.len() {
            let Some(of) = self.cameras.get(camera).copied() else {
                break;
            };
            // A moved camera disagrees by definition.
            if of.is_successor || self.estimator.moved(camera).is_some() {
                continue;
            }
            let Some(held) = held(table, of.address) else {
                continue;
            };
            let Ok(pose) = self.estimator.pose(camera) else {
                continue;
            };
            let pose = frame.in_site(&Pose {
                covariance: pose.covariance * solution.fit.inflation(),
                ..pose
            });
            let off = contradiction(&held, &pose);
            if off <= CONTRADICTION {
                votes.agree += 1;
                continue;
            }
            votes.against += 1;
            if votes.worst.is_none_or(|(_, most)| off > most) {
                votes.worst = Some((camera, off));
            }
        }
        votes
    }

    /// Report for a camera. A moved camera is at its new place; before that place is known, its former pose
    /// is doubtful.
    // for less stack
    #[inline(never)]
    fn report(
        &mut self,
        camera: usize,
        frame: &Frame,
        solution: &JointSolution<f32>,
        [is_frame_doubtful, is_frame_refused]: [bool; 2],
    ) -> Option<Report> {
        let known = *self
            .cameras
            .get(camera)
            .filter(|known| !known.is_successor)?;
        let is_moved = self.estimator.moved(camera).is_some();
        let moved = successor(&self.estimator, camera)
            .and_then(|now| Some((now, self.estimator.pose(now).ok()?)));
        let is_found = moved.is_some();
        debug_assert!(!known.is_successor);
        let (camera, pose) = match moved {
            Some(moved) => moved,
            None => (camera, self.estimator.pose(camera).ok()?),
        };
        let inflation = solution.fit.inflation();
        let hung = self.estimator.levelness(camera, inflation);
        let widened = hung.map_or_else(Matrix3::zeros, |hung| hung.widening);
        let protection = self.estimator.protection(camera).map(|levels| {
            let level = ProtectionLevel::from(levels);
            let place = frame.covariance(pose.position).trace() + widened.m11 + widened.m22;
            ProtectionLevel {
                position: level.position + RARE as f32 * root(place),
                heading: level.heading + RARE as f32 * root(frame.turned() + widened.m33),
            }
        });
        let mut in_site = frame.in_site(&Pose {
            covariance: pose.covariance * solution.fit.inflation(),
            ..pose
        });
        in_site.covariance += widened;
        // A reference has the place that was given, or its place defines the frame. Then only the distance of the
        // second one may be estimated. A target that restarts recognises the frame by these zeros.
        if camera < frame.references.len() && (frame.is_given() || !frame.is_baseline_known()) {
            let c = in_site.covariance;
            let (along, with) = if camera == 1 && !frame.is_given() {
                (c.m11, c.m13)
            } else {
                (0.0, 0.0)
            };
            in_site.covariance = Matrix3::new(along, 0.0, with, 0.0, 0.0, 0.0, with, 0.0, c.m33);
        }
        let [bearings, legs] = self.estimator.left_out();
        // Where several measurements are left out, a further one may be wrong, and this pose may depend on it.
        let hangs = |level: &ProtectionLevel| {
            bearings + legs >= SEVERAL && level.position > HANGS * in_site.sigma_position()
        };
        let is_understood = bearings + legs < MANY || self.estimator.leg_noise() <= RESTLESS;
        let protection = protection.filter(|level| {
            !is_frame_doubtful && is_understood && level.is_usable() && !hangs(level)
        });
        let mut none = ProtectionLevel::NONE;
        // If the told distance is wrong, the second reference does not stand where it was said to.
        if camera == 0 || camera < frame.references.len() && !frame.is_contradicted() {
            none = ProtectionLevel::OF_REFERENCE;
        }
        let parts = PoseParts::from(in_site);
        let [came, count] = self.estimator.bearings_of(camera);
        // A camera that hangs upside down fits the bearings that are left. A moved camera without a new pose is not
        // believed either.
        // The camera itself decides whether its pose is good enough, and checked.
        let is_doubtful = !is_consensus(count, came, true)
            || self.estimator.is_selective(camera)
            || self.estimator.is_ambiguous(camera)
            || is_moved && !is_found;
        let is_refused = is_frame_refused || hung.is_some_and(|hung| hung.is_refused());
        let state = if solution.fit.is_bad() || is_doubtful || is_refused {
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
            joint: Some(protection.unwrap_or(none)),
            state,
            mount: hung.and_then(|hung| Mount::of(hung.mounting, hung.height)),
        })
    }

    /// Returns the cameras with a new report, each once.
    pub(super) fn take_news(&mut self) -> impl Iterator<Item = MemberAddress> {
        let news = core::mem::take(&mut self.news);
        let cameras = self.cameras.iter().enumerate();
        cameras.filter_map(move |(n, camera)| has(&news, n).then_some(camera.address))
    }

    /// Reports for these cameras.
    pub(super) fn reports(&self) -> impl Iterator<Item = (MemberAddress, &Report)> {
        let told = self.cameras.iter().zip(&*self.told);
        told.filter_map(|(camera, report)| Some((camera.address, report.as_ref()?)))
    }

    /// Forgets the measurements among other cameras.
    pub(super) fn clear(&mut self, unsaved: &mut Unsaved) {
        self.arrival = None;
        self.forget_records(unsaved);
        self.estimator.clear();
        self.cameras.clear();
        self.told.fill(None);
        self.news = CameraSet::new();
        self.again = CameraSet::new();
        self.past = CameraSet::new();
        self.way = None;
        self.frame = None;
        self.rejected = None;
        self.failed.clear();
        self.is_new = false;
        self.sizes.clear();
        self.unsolved = (0, None);
    }
}

/// Returns the pose that a camera has by its last report, if a joint estimate gave it.
fn held(table: &Table, address: MemberAddress) -> Option<Pose<f32>> {
    let entry = table.iter().find(|entry| entry.address == address)?;
    let report = entry.report.filter(|report| report.joint.is_some())?;
    let is_good = report.status() != Status::Doubtful;
    report.pose().filter(|_| is_good)?.pose()
}

/// Widens the covariance of a pose so that it covers the place where the camera may stand upside down. Its heading is
/// then unknown.
fn either(mut pose: Pose<f32>, elsewhere: Point2<f32>) -> Pose<f32> {
    let half = (elsewhere - pose.position) * 0.5;
    let off = half.push(1.0);
    pose.covariance += Matrix3::from_diagonal(&off.component_mul(&off));
    pose
}

fn prior((mean, sigma): (f32, f32)) -> Prior<f32> {
    Prior { mean, sigma }
}

/// Returns the entry of a moved camera since its move, if it has one.
#[inline(never)] // for less flash
fn successor(estimator: &JointEstimator<'_, f32>, camera: usize) -> Option<usize> {
    estimator.moved(camera)?.successor
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
