//! Duties of a reference camera: the second one sends its bearings to the first one, which solves (thesis 2.6.1).

use calib_core::{Status, dead_reckoning::Place};
use zigbee_link::{Instant, wire::ShortAddress};

use super::{
    CameraNotification, CameraRole,
    progress::is_done,
    reference::{Answer, NotYet, ReferenceFrame, ReferenceStops},
};
use crate::{
    config::CameraConfig,
    facts::{Fact, FactKey, ReferenceStop},
    limits::REFERENCE_STOPS,
    log::debug,
    message::{
        CameraState, Duty, MemberAddress, PoseParts, References, Report, Seen, StopBearing,
        StopNumber, TargetLocation,
    },
    role::{CONTRADICTION, Unsaved, contradiction},
};

/// Factor of the variance beyond which a pose does not replace another one.
const LESS: f32 = 1.5;

/// The references, and their sightings of targets that did not know their place.
#[derive(Clone, Debug)]
pub(super) struct ReferenceDuty {
    references: Option<References>,
    stops: ReferenceStops,
    /// Pose of the second reference as the first one solved it. The second one may not have heard it.
    second: Option<Report>,
    /// Place of a target, as the first one solved it.
    location: Option<(MemberAddress, TargetLocation)>,
    /// True if stops of the references have changed since the last solve.
    to_solve: bool,
}

impl ReferenceDuty {
    pub(super) const fn new() -> Self {
        Self {
            references: None,
            stops: ReferenceStops::new(),
            second: None,
            location: None,
            to_solve: false,
        }
    }

    pub(super) const fn references(&self) -> Option<&References> {
        self.references.as_ref()
    }

    /// The duty of a member.
    pub(super) fn of(&self, member: Option<ShortAddress>) -> Option<Duty> {
        self.references?.duty_of(member?)
    }

    /// Returns the pose that the first reference solved for the second one.
    pub(super) const fn second(&self) -> Option<Report> {
        self.second
    }

    /// Returns the place of a target, for that target.
    pub(super) const fn location(&self) -> Option<(MemberAddress, TargetLocation)> {
        self.location
    }

    /// Returns the sighting of this camera at a stop.
    pub(super) fn own_at(&self, target: MemberAddress, stop: StopNumber) -> Option<Seen> {
        let mut stops = self.stops.iter();
        stops
            .find(|kept| (kept.target, kept.stop) == (target, stop))?
            .own
    }

    /// Stops at which this camera saw a target.
    pub(super) fn own_stops(&self) -> impl Iterator<Item = (MemberAddress, StopNumber)> {
        let mine = self.stops.iter().filter(|stop| stop.own.is_some());
        mine.map(|stop| (stop.target, stop.stop))
    }

    /// Takes the references, if there are any. Returns true if these are other ones.
    pub(super) fn appoint(
        &mut self,
        references: &References,
        own: Option<ShortAddress>,
        unsaved: &mut Unsaved,
    ) -> bool {
        let references = Some(*references).filter(References::are_two);
        if self.references == references {
            return false;
        }
        let pair = |of: &References| (of.first, of.second);
        if self.references.as_ref().map(pair) != references.as_ref().map(pair) {
            // Sightings of another pair, or its pose, are of no use.
            self.forget_second(unsaved);
            let kept = self.stops.forget_other();
            rewrite(kept, unsaved);
        }
        self.references = references;
        unsaved.insert(FactKey::References);
        self.to_solve = self.of(own) == Some(Duty::First);
        if !self.to_solve {
            // Another camera tells the place of the target.
            self.location = None;
        }
        true
    }

    /// Adds a sighting of this camera.
    pub(super) fn on_own(
        &mut self,
        (target, stop): (MemberAddress, StopNumber),
        place: Place<f32>,
        seen: Seen,
        unsaved: &mut Unsaved,
    ) {
        if let Some(index) = self.stops.own(target, stop, place, seen) {
            unsaved.insert(reference_stop(index));
        }
    }

    /// Adds a sighting of the second reference.
    pub(super) fn on_other(&mut self, bearing: &StopBearing, unsaved: &mut Unsaved) {
        if let Some(index) = self.stops.other(bearing.target, bearing.stop, bearing.seen) {
            unsaved.insert(reference_stop(index));
        }
        self.to_solve = true;
    }

    /// Marks the stops to be solved again.
    pub(super) const fn solve_again(&mut self) {
        self.to_solve = true;
    }

    /// Returns true, once, if the stops are to be solved now.
    pub(super) const fn take_to_solve(&mut self) -> bool {
        core::mem::replace(&mut self.to_solve, false)
    }

    /// Returns the known parts of the frame before the solve, if there are references.
    fn frame(&self, config: &CameraConfig) -> Option<ReferenceFrame> {
        let references = self.references.as_ref()?;
        Some(ReferenceFrame::new(references, config))
    }

    /// Keeps the results for others: the pose of the second reference, and the place of the target.
    pub(super) fn on_solved(
        &mut self,
        second: Report,
        location: (MemberAddress, TargetLocation),
        unsaved: &mut Unsaved,
    ) {
        self.second = Some(second);
        unsaved.insert(FactKey::Posed);
        self.location = Some(location);
    }

    /// Forgets the stops.
    pub(super) fn drop_stops(&mut self, unsaved: &mut Unsaved) {
        let kept = self.stops.len();
        self.stops.clear();
        rewrite(kept, unsaved);
    }

    /// Forgets sightings and results, but not the references. All stops are saved anew: some may be in the flash alone.
    pub(super) fn forget(&mut self, unsaved: &mut Unsaved) {
        self.stops.clear();
        rewrite(REFERENCE_STOPS, unsaved);
        self.second = None;
        unsaved.insert(FactKey::Posed);
        self.location = None;
    }

    /// Forgets the references.
    pub(super) fn dismiss(&mut self, unsaved: &mut Unsaved) {
        if self.references.take().is_some() {
            unsaved.insert(FactKey::References);
        }
        self.forget_second(unsaved);
        self.location = None;
        self.drop_stops(unsaved);
        self.to_solve = false;
    }

    fn forget_second(&mut self, unsaved: &mut Unsaved) {
        if self.second.take().is_some() {
            unsaved.insert(FactKey::Posed);
        }
    }

    pub(super) const fn restore_references(&mut self, references: Option<References>) {
        self.references = references;
    }

    pub(super) const fn restore_second(&mut self, second: Option<Report>) {
        self.second = second;
    }

    /// Takes a stop of a former run. Returns its index.
    pub(super) fn restore_stop(&mut self, stop: ReferenceStop) -> Option<usize> {
        self.stops.restore(stop)
    }

    /// Returns a fact that is to be saved.
    pub(super) fn stop_fact(&self, index: u8) -> Fact {
        let stop = self.stops.iter().nth(index.into()).copied();
        Fact::ReferenceStop(index, stop)
    }
}

/// Key of a stop in the store.
pub(super) const fn reference_stop(index: usize) -> FactKey {
    FactKey::ReferenceStop(index as u8)
}

/// Marks the first `stops` stops to be saved anew.
fn rewrite(stops: usize, unsaved: &mut Unsaved) {
    for index in 0..stops {
        unsaved.insert(reference_stop(index));
    }
}

impl CameraRole {
    /// Has a sighting sent to the first reference.
    pub(super) fn notify_bearing(
        &mut self,
        now: Instant,
        (target, stop): (MemberAddress, StopNumber),
    ) {
        // A dropped stop needs no message. So there are never more messages than the list holds.
        let duty = &self.duty;
        self.notifications
            .retain(|notification| match notification {
                CameraNotification::Bearing(target, stop) => duty.own_at(target, stop).is_some(),
                _ => true,
            });
        if self.duty.own_at(target, stop).is_some() {
            self.notify(CameraNotification::Bearing(target, stop), now);
        }
    }

    /// Has all sightings sent to the first reference.
    pub(super) fn notify_bearings(&mut self, now: Instant) {
        self.cancel_bearings();
        for (target, stop) in self.duty.own_stops() {
            self.notifications
                .notify(CameraNotification::Bearing(target, stop), now);
        }
    }

    pub(super) fn cancel_bearings(&mut self) {
        self.notifications
            .retain(|notification| !matches!(notification, CameraNotification::Bearing(..)));
    }

    /// Takes the references from the coordinator.
    pub(super) fn on_references(&mut self, now: Instant, references: &References) {
        let is_news = self
            .duty
            .appoint(references, self.address, &mut self.unsaved);
        if !is_news {
            return;
        }
        if self.duty.second().is_none() {
            self.notifications.cancel(CameraNotification::Posed);
        }
        if self.duty.location().is_none() {
            self.notifications.cancel(CameraNotification::Located);
        }
        self.cancel_bearings();
        if self.own_duty() == Some(Duty::Second) {
            self.notify_bearings(now);
        }
    }

    /// Takes a sighting of the second reference.
    pub(super) fn on_bearing(&mut self, now: Instant, bearing: &StopBearing) {
        if self.own_duty() != Some(Duty::First) || !bearing.seen.is_usable() {
            return;
        }
        if self.progress.pose().is_none() {
            self.duty.on_other(bearing, &mut self.unsaved);
        } else if self.duty.second().is_some() {
            // It did not hear its pose, or lost it.
            self.notify(CameraNotification::Posed, now);
        }
    }

    /// Takes the pose of this camera, the second reference, from the first one.
    pub(super) fn on_posed(&mut self, now: Instant, solved: &Report) {
        self.cancel_bearings();
        self.on_own_pose(now, Duty::Second, solved);
    }

    /// Takes the pose of this camera from a target that estimated everything jointly. Of several targets the camera
    /// believes the one that is surer.
    pub(super) fn on_joint(&mut self, now: Instant, from: MemberAddress, solved: &Report) {
        let report = *self.progress.report();
        let variance = |report: &Report| {
            let pose = report.pose();
            pose.map_or(f32::INFINITY, |pose| {
                pose.covariance[0] + pose.covariance[2]
            })
        };
        // Another target, or one that began anew, may know less than the camera. If the same target has as many
        // sightings or more, it has learnt that its steps err by more than it believed.
        let is_same_or_more =
            self.solved_by.is_none_or(|by| by == from) && solved.used >= report.used;
        let knows_less = !is_same_or_more && variance(solved) > LESS * variance(&report);
        let is_calibrated = report.status() == Status::Calibrated;
        let is_given = |parts: &PoseParts| matches!(parts.covariance, [0.0, _, 0.0, ..]);
        let is_trusted =
            is_calibrated && (report.joint.is_some() || report.pose().is_some_and(is_given));
        let poses = [&report, solved].map(|report| report.pose()?.pose());
        if let (true, Some(held), [Some(own), Some(other)]) =
            (is_trusted && report.joint.is_some(), report.pose(), poses)
            && contradiction(&own, &other) > CONTRADICTION
        {
            // The camera was moved, or the solver errs. The pose is doubtful until the next stop decides.
            let state = CameraState::Doubtful(*held);
            self.update(now, Report { state, ..report });
            self.notify(CameraNotification::Report(from), now);
            return;
        }
        if is_trusted && knows_less && solved.status() != Status::Doubtful {
            return;
        }
        // A given place is not replaced by an estimated one: the camera was moved, and its place is unknown now.
        if let (Some(held), [Some(own), Some(other)]) = (report.pose(), poses)
            && is_given(held)
            && !solved.pose().is_some_and(is_given)
            && contradiction(&own, &other) > CONTRADICTION
        {
            self.was_moved = true;
            self.is_watched_doubtful = true;
            let state = CameraState::Doubtful(*held);
            self.update(now, Report { state, ..report });
            self.notify(CameraNotification::Report(from), now);
            return;
        }
        self.solved_by = Some(from);
        // If the sightings of this camera contradict a pose, it stays doubtful when the target repeats it: the target
        // left out the sightings that do not fit.
        let is_same = matches!(poses, [Some(own), Some(other)]
            if contradiction(&own, &other) <= CONTRADICTION);
        // If a reference looks in another direction now, its given place may be wrong too.
        self.was_moved |=
            self.is_watched_doubtful && !is_same && solved.pose().is_some_and(is_given);
        self.is_watched_doubtful &= is_same || self.was_moved;
        if !self.is_watched_doubtful {
            self.misses = 0;
            self.missed = 0.0;
        }
        self.is_told_doubtful = solved.status() == Status::Doubtful;
        // The lens is another one than was told: the camera's own result counts.
        let state = match self.calibration.with_other_lens(&self.config.lens) {
            Some(state) if report.duty.is_none() && solved.mount.is_none() => state,
            _ => {
                let limits = self.config.weak.limits();
                let is_checked = solved
                    .joint
                    .is_some_and(|level| level.is_tolerated(&limits));
                let [counting, all] = [solved.used, solved.sightings].map(usize::from);
                let state = solved.state.judged_again(&limits, solved.is_tested());
                let state = state.supported(counting, all, is_checked);
                self.stuck(state, solved.joint)
            }
        };
        let state = match state {
            CameraState::Calibrated(pose) | CameraState::Weak(pose) if self.is_watched_doubtful => {
                CameraState::Doubtful(pose)
            }
            state => state,
        };
        let state = self.sized(state, solved.mount);
        let sightings = solved.sightings.max(report.sightings);
        self.update(
            now,
            Report {
                sightings,
                used: solved.used,
                chi_squared: solved.chi_squared,
                done: report.duty.is_some() || is_done(&self.config, sightings.into(), &state),
                joint: solved.joint,
                state,
                mount: solved.mount,
                ..report
            },
        );
    }

    // for less stack
    #[inline(never)]
    pub(super) fn solve_reference(&mut self, now: Instant) {
        if self.progress.pose().is_some() {
            return;
        }
        let Some(frame) = self.duty.frame(&self.config) else {
            return;
        };
        let wanted = usize::from(self.config.reference_stops);
        let solved = self.duty.stops.solve(&frame, wanted);
        self.on_solved(now, &solved);
    }

    // for less stack: its stack is not there while solving.
    #[inline(never)]
    fn on_solved(&mut self, now: Instant, solved: &Result<Answer, NotYet>) {
        let report = *self.progress.report();
        match solved {
            Ok(answer) => {
                let limits = self.config.weak.limits();
                let mut reports = [report; 2];
                let told = { answer.poses.iter() }.zip(answer.mounts);
                for (report, (pose, mount)) in reports.iter_mut().zip(told) {
                    report.sightings = answer.stops as u8;
                    report.used = answer.stops as u8;
                    report.chi_squared = answer.fit.chi_squared;
                    report.state = CameraState::judged(*pose, &answer.fit, &limits);
                    report.mount = mount;
                }
                let [first, second] = reports;
                let location = (answer.target, answer.located);
                self.duty.on_solved(second, location, &mut self.unsaved);
                self.notify(CameraNotification::Posed, now);
                self.notify(CameraNotification::Located, now);
                self.on_own_pose(now, Duty::First, &first);
            }
            Err(why) => {
                debug!("no reference solve yet");
                if let NotYet::Refused(refusal) = why {
                    let state = CameraState::Refused(*refusal);
                    self.update(now, Report { state, ..report });
                }
            }
        }
    }

    /// Takes the pose of this reference.
    fn on_own_pose(&mut self, now: Instant, duty: Duty, solved: &Report) {
        // The stops are erased once the pose is saved.
        self.update(now, self.progress.solved(duty, solved));
    }
}
