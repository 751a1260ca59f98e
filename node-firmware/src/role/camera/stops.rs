//! A camera at a stop of a target: it looks, answers and counts.

use calib_core::{Pose, Status, angle, dead_reckoning::Place};
use nalgebra::{RealField, Vector2};
use zigbee_link::{Instant, wire::ShortAddress};

use super::{
    CameraNotification, CameraRole,
    device::LookRequest,
    facts::sighting,
    progress::is_done,
    targets::{LastLook, Unconfirmed, is_past},
};
use crate::{
    arithmetic::root,
    facts::KeptSighting,
    message::{
        CameraState, CommandOutcome, CommandResult, Confirmation, CoordinateFrame, Duty, Eye,
        MemberAddress, Message, Mount, ProtectionLevel, Report, Seen, Sight, StopAnswer,
        StopBearing, StopNumber, Stopped,
    },
    role::COORDINATOR,
    vision::Subject,
};

/// Sigmas beyond which a bearing does not fit the pose.
const WATCH_SIGMAS: f32 = 6.0;

/// Bearings that do not fit from which on a pose is doubtful.
const MISSES: u8 = 2;

/// Repetitions after which a picture counts as stuck: by chance a good one repeats so often once in 10,000 looks.
pub(super) const STUCK: u8 = 2;

/// Share of the half field of view within which the whole target is in view, in spite of the pose's error.
const WELL_INSIDE: f32 = 0.8;

impl CameraRole {
    /// Returns true if this camera can use a sighting at this stop. The target can use every bearing.
    fn needs(&self, stopped: &Stopped) -> bool {
        let report = self.progress.report();
        match stopped.frame {
            CoordinateFrame::Site => !report.done && report.duty.is_none(),
            CoordinateFrame::Own if self.progress.pose().is_some() => true,
            // It may become a reference while the target stands there, or later. Then it needs the sighting.
            CoordinateFrame::Own => {
                self.own_duty().is_some()
                    || self.config.reference.is_some()
                    || self.config.may_be_elected
            }
        }
    }

    /// Takes the message of a target that it stands at a stop.
    pub(super) fn on_stopped(&mut self, now: Instant, target: MemberAddress, stopped: &Stopped) {
        self.on_heard(now, target);
        let stop = stopped.stop;
        let request = LookRequest {
            target,
            stopped: *stopped,
        };
        let known = || self.looks.stops().chain(self.device.requested());
        if known().any(|(of, known)| of == target && is_past(known, stop)) {
            // The target has gone on.
            return;
        }
        if let Some(last) = self.looks.find(target, stop) {
            // The camera has looked. The target repeats its message because the answer was lost, or because it knows
            // its place now.
            if last.stopped.frame == stopped.frame {
                self.answer(now, target, stop, last.sight, last.seen);
            } else {
                self.on_look(now, request, last.sight, last.seen);
            }
        } else if self.device.is_ready() {
            self.device.look(request);
        } else {
            self.answer(now, target, stop, self.device.excuse(), None);
        }
    }

    /// Remembers a target, so that it gets the pose once that is known.
    pub(super) fn on_heard(&mut self, now: Instant, target: MemberAddress) {
        let heard = self.targets.on_heard(target, self.progress.has_report());
        if let Some(replaced) = heard.replaced {
            self.notifications
                .cancel(CameraNotification::Report(replaced));
        }
        if heard.missed_report {
            self.notify(CameraNotification::Report(target), now);
        }
    }

    /// Answers in this node's own slot after a question that went to everybody: otherwise all
    /// answers would begin in the same moment.
    fn answer(
        &mut self,
        now: Instant,
        target: MemberAddress,
        stop: StopNumber,
        sight: Sight,
        seen: Option<Seen>,
    ) {
        let due = now + self.slot();
        let report = self.progress.report();
        // Only a round target has a size that its width tells.
        let seen = seen.filter(|_| sight == Sight::InView).map(|seen| {
            if self.config.has_round_targets() {
                seen
            } else {
                seen.wide(0.0)
            }
        });
        let answer = Message::Look(StopAnswer {
            stop,
            sight,
            seen,
            counted: report.sightings,
            done: report.done,
        });
        self.outbox.push(due, ShortAddress(target), answer, None);
    }

    /// Takes the result of a look.
    pub(super) fn on_looked(&mut self, now: Instant, sight: Sight, seen: Option<Seen>) {
        if let Some(request) = self.device.on_looked() {
            self.on_look(now, request, sight, seen);
            self.judge_light(now, &request.stopped, sight);
        }
    }

    /// Tells targets that wait that the camera cannot look for a while. They ask again.
    pub(super) fn on_starting(&mut self, now: Instant) {
        let (requests, command) = self.device.on_starting();
        for request in requests.into_iter().flatten() {
            let (target, stop) = request.stop();
            self.answer(now, target, stop, Sight::NotReady, None);
        }
        if let Some(command) = command {
            let outcome = CommandOutcome::Failed;
            self.tell_done(now, CommandResult { command, outcome });
        }
    }

    /// Takes the result of a look at a stop, and answers.
    fn on_look(&mut self, now: Instant, request: LookRequest, sight: Sight, seen: Option<Seen>) {
        let LookRequest {
            target, stopped, ..
        } = request;
        let picture = seen.filter(Seen::is_usable);
        let last = self.looks.last(target);
        let before = last.map(|last| last.sight);
        // A stuck camera would be believed until two others contradict it.
        let repeats = picture.map_or(0, |picture| self.looks.repeats(target, &stopped, &picture));
        let stuck = self.is_stuck();
        let sight = if repeats >= STUCK {
            self.on_eye(now, Eye::Failed);
            Sight::Failed
        } else {
            if picture.is_some() && self.health.camera != Eye::Blind {
                self.on_eye(now, Eye::Sees);
            }
            sight
        };
        // One repetition may be chance.
        let refused = match sight {
            Sight::Hidden => Some(Eye::Hidden),
            Sight::Several => Some(Eye::Several),
            _ => None,
        };
        if let Some(eye) = refused
            && before == Some(sight)
        {
            self.on_eye(now, eye);
        }
        let seen = picture.filter(|_| sight == Sight::InView);
        self.target_seen = seen.is_some();
        // The target knows the answer, or asks again.
        let is_known = sight == Sight::NotInView && before == Some(sight);
        self.looks.insert(LastLook {
            target,
            stopped,
            sight,
            seen: picture,
            repeats,
            unconfirmed: seen.map(|_| Unconfirmed::new(now + self.slot())),
        });
        if self.is_stuck() != stuck {
            self.judge_stuck(now);
        }
        if !is_known {
            self.answer(now, target, stopped.stop, sight, seen);
        }
    }

    /// Judges the pose anew if the picture does not change any more, or changes again. While it does not change, a pose
    /// that a wrong sighting could move far is weak.
    // for less stack
    #[inline(never)]
    fn judge_stuck(&mut self, now: Instant) {
        let report = *self.progress.report();
        if report.joint.is_some() && report.duty.is_none() {
            let limits = self.config.weak.limits();
            let state = { report.state }.judged_again(&limits, report.is_tested());
            let state = self.stuck(state, report.joint);
            self.update(now, Report { state, ..report });
        }
    }

    /// Returns true if the picture does not change. Another target that is seen elsewhere changes it.
    fn is_stuck(&self) -> bool {
        self.health.camera == Eye::Failed && self.looks.is_stuck()
    }

    /// Returns the state, weak at best if the picture does not change and the pose is not checked.
    pub(super) fn stuck(&self, state: CameraState, joint: Option<ProtectionLevel>) -> CameraState {
        let limits = self.config.weak.limits();
        let is_checked = joint.is_some_and(|level| level.is_tolerated(&limits));
        if self.is_stuck() && !is_checked {
            state.untested()
        } else {
            state
        }
    }

    /// Direction of a target off the heading, radians, and its distance in the plane, if both places are known.
    // for less flash
    #[inline(never)]
    fn direction(&self, stopped: &Stopped) -> Option<(f32, f32)> {
        let report = self.progress.report();
        let is_trusted = report.status() == Status::Calibrated;
        let is_located = stopped.frame == CoordinateFrame::Site;
        let pose = report.pose().filter(|_| is_trusted && is_located)?.pose()?;
        let to_target = stopped.place.position() - pose.position;
        let off = off_heading(&pose, &to_target);
        Some((off, root(to_target.norm_squared())))
    }

    /// Returns the state, doubtful if the sizes of a round target contradict the pose.
    pub(super) fn sized(&self, state: CameraState, mount: Option<Mount>) -> CameraState {
        match state {
            CameraState::Calibrated(parts) | CameraState::Weak(parts)
                if self.config.has_round_targets()
                    && self.calibration.is_contradicted_by_sizes(&parts, mount) =>
            {
                CameraState::Doubtful(parts)
            }
            state => state,
        }
    }

    /// Has the camera adapt to the light if it does not see a target that should be in view.
    // for less stack
    #[inline(never)]
    fn judge_light(&mut self, now: Instant, stopped: &Stopped, sight: Sight) {
        let subjects = &self.config.subjects;
        // Motion is seen in any light, and the background must not be learnt with a target in view.
        let Some(Subject::Colour(_)) = subjects.of_target(stopped.colour) else {
            return;
        };
        let direction = self.direction(stopped);
        match sight {
            Sight::NotInView => {}
            Sight::InView | Sight::Clipped | Sight::Unsteady | Sight::Hidden | Sight::Several => {
                self.light.on_seen(direction.map(|(_, range)| range));
                if self.health.camera == Eye::Blind {
                    self.on_eye(now, Eye::Sees);
                }
                return;
            }
            Sight::NotLooking | Sight::Failed | Sight::NotReady => return,
        }
        let half_view = self.config.lens.field_of_view_deg.to_radians() / 2.0;
        let is_expected = direction.and_then(|(off, range)| match self.light.reaches(range) {
            reaches if off.abs() < WELL_INSIDE * half_view => reaches,
            _ => Some(false),
        });
        if self.light.on_nothing(is_expected) {
            self.device.adapt();
        }
        if self.light.is_blind() {
            self.on_eye(now, Eye::Blind);
        }
    }

    /// Takes the names of the cameras that looked while the target stood at a stop. Only these looks count: a camera
    /// that heard of the stop late saw the target elsewhere.
    pub(super) fn on_confirmed(
        &mut self,
        now: Instant,
        target: MemberAddress,
        confirmation: &Confirmation,
    ) {
        let Some(own) = self.address else {
            return;
        };
        let stop = confirmation.stop;
        if !confirmation.seen_by.contains(&own.0) {
            self.on_unconfirmed(now, target, stop);
            return;
        }
        let Some(look) = self.looks.confirm(target, stop) else {
            return;
        };
        let stopped = look.stopped;
        let seen = look.seen.filter(|_| look.sight == Sight::InView);
        if let Some(seen) = seen.filter(|_| stopped.frame == CoordinateFrame::Site) {
            self.watch(now, &stopped.place, seen);
        }
        if let Some(seen) = seen.filter(|_| self.needs(&stopped)) {
            self.has_forgotten = false;
            match stopped.frame {
                CoordinateFrame::Site => self.on_sighted(now, target, &stopped, seen),
                CoordinateFrame::Own => self.on_lost_sighted(now, target, &stopped, seen),
            }
        }
    }

    /// The target did not wait for this camera, or did not hear it.
    fn on_unconfirmed(&mut self, now: Instant, target: MemberAddress, stop: StopNumber) {
        if self.looks.find(target, stop).is_some() {
            self.looks.repeat(now, target, stop);
            return;
        }
        let known = || self.looks.stops().chain(self.device.requested());
        if !known().any(|(of, known)| of == target && is_past(known, stop)) {
            // The answer was lost, or the look goes on: the target has to ask, or to wait.
            self.answer(now, target, stop, self.device.excuse(), None);
        }
    }

    /// Repeats answers that the target has not confirmed.
    pub(super) fn repeat_answers(&mut self, now: Instant) {
        while let Some(look) = self.looks.take_due(now) {
            self.answer(now, look.target, look.stopped.stop, look.sight, look.seen);
        }
    }

    /// Compares a bearing of a target that knows its place with the pose from a joint estimate. If two more bearings
    /// are off than fit, the pose is doubtful until as many fit: the camera was moved, or the target is not where it
    /// believes. If the target that estimated the pose doubts it, only that target can end the doubt.
    // for less stack
    #[inline(never)]
    fn watch(&mut self, now: Instant, place: &Place<f32>, seen: Seen) {
        let report = *self.progress.report();
        let Some(seen) = report.upright(seen) else {
            return;
        };
        let is_told = report.joint.is_some() || report.duty.is_some();
        let Some((held, pose)) = report.pose().and_then(|held| Some((*held, held.pose()?))) else {
            return;
        };
        let to_target = place.position() - pose.position;
        let range2 = to_target.norm_squared();
        if !is_told || !(range2 > 0.0) {
            return;
        }
        let across = Vector2::new(-to_target.y, to_target.x) / range2;
        let c = pose.covariance;
        let position = place.covariance() + c.fixed_view::<2, 2>(0, 0);
        let variance = seen.sigma * seen.sigma
            + (across.transpose() * position * across).x
            + 2.0 * (across.x * c.m13 + across.y * c.m23)
            + c.m33;
        let off = angle::wrap_signed(off_heading(&pose, &to_target) - seen.bearing);
        let gate2 = variance * (WATCH_SIGMAS * WATCH_SIGMAS);
        if off * off > gate2 {
            self.misses = (self.misses + 1).min(MISSES + 1);
            self.missed = self.missed.max(off.abs());
        } else if gate2 <= 4.0 * self.missed * self.missed {
            // If the place of the target is less sure than that, every pose fits.
            self.misses = self.misses.saturating_sub(1);
        }
        if self.misses == 0 {
            self.missed = 0.0;
        }
        let state = if self.misses >= MISSES && report.status() == Status::Calibrated {
            self.is_watched_doubtful = true;
            CameraState::Doubtful(held)
        } else if self.misses == 0
            && self.is_watched_doubtful
            && !self.was_moved
            && !self.is_told_doubtful
        {
            self.is_watched_doubtful = false;
            CameraState::Weak(held).judged_again(&self.config.weak.limits(), report.is_tested())
        } else {
            return;
        };
        self.update(now, Report { state, ..report });
    }

    /// Adds a sighting of a target that knows its place. Three of these give a pose.
    // for less stack
    #[inline(never)]
    fn on_sighted(&mut self, now: Instant, target: MemberAddress, stopped: &Stopped, seen: Seen) {
        let report = *self.progress.report();
        if report.done || report.duty.is_some() {
            return;
        }
        let kept = KeptSighting {
            target,
            stop: stopped.stop,
            place: stopped.place,
            seen,
        };
        let Some(index) = self.calibration.add(kept) else {
            return;
        };
        self.unsaved.insert(sighting(index));
        let other_lens = self.calibration.with_other_lens(&self.config.lens);
        if report.joint.is_some() {
            // The result of a joint estimate is not replaced by that of some sightings.
            // A camera that is not level may fit another lens.
            if let Some(state) = other_lens.filter(|_| report.mount.is_none()) {
                self.update(
                    now,
                    Report {
                        done: false,
                        state,
                        ..report
                    },
                );
            }
            return;
        }
        let answer = self
            .calibration
            .solve(&self.config.weak.limits(), &self.config.lens_sigma);
        let state = { other_lens.filter(|_| answer.mount.is_none()) }.unwrap_or(answer.state);
        let state = self.sized(state, answer.mount);
        let count = self.calibration.count();
        self.update(
            now,
            Report {
                sightings: count as u8,
                used: answer.used as u8,
                chi_squared: answer.chi_squared,
                done: is_done(&self.config, count, &state),
                state,
                mount: answer.mount,
                ..report
            },
        );
    }

    /// Adds a sighting of a target that does not know its place.
    // for less stack
    #[inline(never)]
    fn on_lost_sighted(
        &mut self,
        now: Instant,
        target: MemberAddress,
        stopped: &Stopped,
        seen: Seen,
    ) {
        let stop = stopped.stop;
        if let Some(pose) = self.progress.pose() {
            let Some(seen) = self.progress.report().upright(seen) else {
                return;
            };
            let bearing = Message::Bearing(StopBearing {
                target,
                stop,
                seen,
                pose: Some(pose),
            });
            self.outbox.push(now, ShortAddress(target), bearing, None);
            return;
        }
        let at = (target, stop);
        self.duty.on_own(at, stopped.place, seen, &mut self.unsaved);
        match self.own_duty() {
            Some(Duty::First) => self.duty.solve_again(),
            Some(Duty::Second) => self.notify_bearing(now, at),
            None if self.duty.references().is_some() => {}
            None => {
                let trigger = Message::Trigger { target, stop };
                self.outbox.push(now, COORDINATOR, trigger, None);
            }
        }
    }
}

/// Angle of a direction off the heading of a pose, radians.
// for less flash
#[inline(never)]
fn off_heading(pose: &Pose<f32>, to_target: &Vector2<f32>) -> f32 {
    let direction = RealField::atan2(to_target.y, to_target.x);
    angle::wrap_signed(direction - pose.heading)
}
