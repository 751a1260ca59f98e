//! Place of a target: steps, fixes, and losses.

use core::time::Duration;

use calib_core::{
    Status, angle,
    dead_reckoning::{Place, Step, Systematic, Track, TrackError},
    fit::Fit,
    intersection,
};
use nalgebra::{Matrix2, Point2, RealField, Vector2};
use zigbee_link::{Instant, link::WAKE_FOR, wire::ShortAddress};

use super::{
    BREATH, CameraEntry, State, TargetNotification, TargetRole,
    estimate::{Estimate, Estimated},
    is_length,
};
use crate::{
    arithmetic::root,
    config::TargetConfig,
    facts::FactKey,
    message::{MemberAddress, Report, Sight, StopAnswer, StopBearing, TargetLocation, matrix},
};

/// Time from the first bearing until bearings are used. Those of other cameras make the place better: the first two may
/// look along one line.
const BEARINGS_WITHIN: Duration = Duration::from_millis(400);

/// Largest sigma of a direction that is used, radians.
const HEADING_LIMIT: f32 = 0.1;

impl TargetRole<'_> {
    /// Returns its place, unless it walked so far that the place is useless.
    pub(super) fn place(&self) -> Option<Place<f32>> {
        self.track.place(self.config.standing_sigma).ok()
    }

    pub(super) fn on_step(&mut self, now: Instant, step: &Step<f32>) {
        let before = core::mem::replace(&mut self.state, State::Walking { last: Some(now) });
        if let State::Standing(standing) = before {
            if !standing.may_walk {
                self.save_history();
                self.unsaved.insert(FactKey::Walk);
            }
            // Sleeping cameras are woken now, and have started by the next stop.
            if now >= standing.since + WAKE_FOR {
                self.confirmations.due(now);
            }
        }
        if let Some(estimate) = &mut self.estimate {
            estimate.on_step(step);
        }
        let turn = match (self.located, self.frame_heading) {
            (true, Some((heading, _))) => heading,
            _ => 0.0,
        };
        let scale = self.scale;
        let step = Step {
            distance: step.distance / scale,
            distance_sigma: step.distance_sigma / scale,
            heading: step.heading + turn,
            ..*step
        };
        // A track may become too long for a message.
        if self.track.advance(&step).is_err() || self.place().is_none() {
            self.lose(now);
        }
    }

    /// Marks the place as unknown: the sensor failed, or the target was carried.
    pub(super) fn lose(&mut self, now: Instant) {
        let stands = matches!(self.state, State::Standing(_));
        let lost = self.jump(Point2::origin(), Matrix2::zeros());
        debug_assert_eq!(lost, Ok(()), "the sigmas of a configuration are usable");
        if stands {
            self.stand(now);
        }
    }

    /// Takes the place where it stands from a person, since the sensor did not measure the way there. The same place is
    /// the same stop.
    pub(super) fn on_placed(&mut self, now: Instant, told: &TargetLocation) {
        let place = Point2::from(told.position);
        let is_there = self.located && self.track.position() == place;
        if self.has_no_steps() && !is_there && self.jump(place, matrix(told.covariance)).is_ok() {
            self.located = true;
            self.stand(now);
        }
    }

    /// Begins anew at a place to which the way is unknown.
    fn jump(&mut self, position: Point2<f32>, covariance: Matrix2<f32>) -> Result<(), TrackError> {
        let own_frame = systematic(&self.config, 0.0);
        self.track.relocate(position, covariance, own_frame)?;
        self.located = false;
        self.has_arrived = false;
        self.found = None;
        self.bearings.clear();
        self.locate_at = None;
        if let Some(estimate) = &mut self.estimate {
            estimate.lose_way();
        }
        self.at_stop = self.track;
        self.stood.clear();
        Ok(())
    }

    /// Takes the place of a point of its track. The target may have walked on since.
    fn fix(
        &mut self,
        now: Instant,
        then: &Track<f32>,
        position: Point2<f32>,
        covariance: Matrix2<f32>,
        (heading, heading_sigma): (f32, f32),
        systematic: Systematic<f32>,
    ) {
        // The track is in the frame of the site, or in that of the sensor.
        let turned = match (self.located, self.frame_heading) {
            (true, Some((before, _))) => heading - before,
            _ => heading,
        };
        let turn = angle::rotation(turned);
        let Some(since) = self.track.since(then) else {
            debug_assert!(false, "stops of former fixes are forgotten");
            return;
        };
        let covariance = covariance + angle::turned(&since.covariance, &turn);
        let walked = self.track.since(&self.at_stop);
        let found = self.track.relocate(
            position + turn * since.vector,
            symmetric(covariance),
            systematic,
        );
        if found.is_err() {
            return;
        }
        self.at_stop = self.track;
        // It may have left its stop: a further estimate of the stop adds the same way.
        if let Some(mut walked) = walked {
            walked.vector = turn * walked.vector;
            walked.covariance = angle::turned(&walked.covariance, &turn);
            self.at_stop.go_back(&walked);
        }
        self.stood.clear();
        self.located = true;
        self.is_heading_provisional = false;
        self.frame_heading = Some((heading, heading_sigma));
        if matches!(self.state, State::Standing(standing) if !standing.may_walk) {
            self.tell_again(now);
        } else {
            self.unsaved.insert(FactKey::Walk);
        }
    }

    /// Takes the place of a stop from the first reference camera.
    pub(super) fn on_located(&mut self, now: Instant, located: &TargetLocation) {
        if !located.is_usable() || self.located || self.has_no_steps() {
            return;
        }
        let heading = (located.frame_heading, located.frame_heading_sigma);
        // An old stop gives no place. It still gives the direction of the sensor.
        let then = self.stood.iter().find(|(stop, _)| *stop == located.stop);
        let then = then.map(|(_, then)| *then);
        if let Some(estimate) = &mut self.estimate
            && (then.is_some() || estimate.index(located.stop).is_some())
        {
            estimate.on_sensor(heading.0, heading.1);
        }
        if let Some(then) = then {
            self.fix(
                now,
                &then,
                Point2::from(located.position),
                matrix(located.covariance),
                heading,
                systematic(&self.config, heading.1),
            );
        }
        self.find_references();
    }

    /// Takes a bearing of a camera at the present stop.
    pub(super) fn on_seen(&mut self, from: ShortAddress, look: &StopAnswer) {
        if let Some(seen) = look.seen.filter(|_| look.sight == Sight::InView)
            && let Some(estimate) = &mut self.estimate
        {
            let radius = self.config.ball_radius;
            estimate.on_seen(from.0, look.stop, &seen, radius, &mut self.unsaved);
        }
    }

    /// Gives the estimate its frame, once both cameras know their poses.
    pub(super) fn find_references(&mut self) {
        if let Some(estimate) = &mut self.estimate {
            estimate.find_frame(&self.table, &self.config);
        }
    }

    /// Does a slice of the joint estimate. At its end, sends the poses.
    // for less stack
    #[inline(never)]
    pub(super) fn estimate(&mut self, now: Instant) {
        let Some(estimate) = &mut self.estimate else {
            self.estimate_at = None;
            return;
        };
        self.estimate_at = Some(now + BREATH);
        if !self.is_estimating {
            estimate.find_frame(&self.table, &self.config);
            self.is_estimating = estimate.begin(&mut self.unsaved);
            if !self.is_estimating {
                self.estimate_at = None;
            }
            return;
        }
        let Some(estimated) = estimate.step(&self.table) else {
            return;
        };
        self.is_estimating = false;
        // There may be new measurements.
        self.estimate_news(now);
        if let Some(estimated) = estimated {
            self.on_estimated(now, &estimated);
        }
    }

    /// Sends reports to the cameras with a new one.
    pub(super) fn estimate_news(&mut self, now: Instant) {
        if let Some(estimate) = &mut self.estimate {
            for camera in estimate.take_news() {
                self.notifications
                    .notify(TargetNotification::Posed(camera), now);
            }
        }
    }

    /// Notes that a camera has its pose. The note is kept over a restart.
    pub(super) fn on_told(&mut self, camera: MemberAddress) {
        let reports = self.estimate.iter().flat_map(Estimate::reports);
        let told = { reports }.find_map(|(of, told)| (of == camera).then_some(*told));
        let is_it = |entry: &CameraEntry| entry.address == camera;
        let before = self.table.iter().find(is_it).and_then(|entry| entry.report);
        let is_exact = |report: &Report| {
            let pose = report.pose();
            pose.is_some_and(|pose| pose.covariance.first() == Some(&0.0))
        };
        if let (Some(told), Some(before)) = (told, before) {
            // Only a doubt replaces a given place.
            if is_exact(&before) && !is_exact(&told) && before.status() != Status::Doubtful {
                return;
            }
            let held = Report {
                joint: told.joint,
                state: told.state,
                ..before
            };
            self.table.report(camera, held, &mut self.unsaved);
        }
    }

    /// Takes the place of this target and the scale of its step sensor from the joint estimate.
    pub(super) fn on_estimated(&mut self, now: Instant, estimated: &Estimated) {
        // It stands elsewhere by now: the next round has that stop.
        let stands = matches!(self.state, State::Standing(standing) if !standing.may_walk);
        // If the sensor failed, or it restarted, the way since then is unknown too.
        let knows_way = { self.estimate.as_ref() }.is_some_and(Estimate::knows_way);
        if estimated.stop != self.stop
            || !knows_way
            || self.has_no_steps()
            || stands
            || !is_length(estimated.scale.0)
        {
            return;
        }
        self.scale = estimated.scale.0;
        let at_stop = self.at_stop;
        let systematic = Systematic {
            heading_sigma: estimated.frame_heading.1,
            scale_sigma: estimated.scale.1 / estimated.scale.0,
        };
        self.fix(
            now,
            &at_stop,
            estimated.position,
            estimated.covariance,
            estimated.frame_heading,
            systematic,
        );
    }

    /// Takes a bearing of a camera with a known pose, while the place is unknown.
    pub(super) fn on_bearing(&mut self, now: Instant, from: ShortAddress, bearing: &StopBearing) {
        let is_mine = self.address.is_some_and(|own| own.0 == bearing.target);
        let is_of_use =
            bearing.seen.is_usable() && bearing.pose.is_some_and(|p| p.pose().is_some());
        if self.located
            || self.has_no_steps()
            || !is_mine
            || bearing.stop != self.stop
            || !is_of_use
        {
            return;
        }
        self.bearings.retain(|(known, _)| *known != from);
        if self.bearings.is_full() {
            return;
        }
        let has_room = self.bearings.push((from, *bearing)).is_ok();
        debug_assert!(has_room);
        let at = now + BEARINGS_WITHIN;
        self.locate_at = Some(at);
        if let State::Standing(standing) = &mut self.state {
            let until = standing.wait_until.map_or(at, |until| until.max(at));
            standing.wait_until = Some(until);
        }
    }

    /// Finds the place from the bearings of all cameras with known poses. One is enough if it tells the range.
    pub(super) fn locate(&mut self, now: Instant) {
        if self.located {
            return;
        }
        let mut stations = heapless::Vec::<intersection::StationBearing<f32>, 4>::new();
        for (_, bearing) in &self.bearings {
            if let Some(pose) = bearing.pose.and_then(|pose| pose.pose()) {
                let has_room = stations.push(intersection::StationBearing {
                    pose,
                    ray: bearing.seen.ray(),
                    bearing_sigma: bearing.seen.sigma,
                    range: bearing.seen.range(self.config.ball_radius),
                });
                debug_assert!(has_room.is_ok(), "as many as there are bearings");
            }
        }
        let Ok(found) = intersection::locate(&stations) else {
            return;
        };
        let is_checked = found.degrees_of_freedom() > 0;
        let at_stop = self.at_stop;
        let before = self
            .found
            .replace((found.position, found.covariance, at_stop));
        let agrees = self.frame_heading.and_then(|(heading, sigma)| {
            let (before, covariance, track) = before.as_ref()?;
            let walked = at_stop.since(track)?;
            let turn = angle::rotation(heading);
            let across = turn * Vector2::new(-walked.vector.y, walked.vector.x) * sigma;
            let covariance = covariance
                + found.covariance
                + angle::turned(&walked.covariance, &turn)
                + across * across.transpose();
            let off = found.position - (before + turn * walked.vector);
            let chi_squared = off.dot(&(covariance.try_inverse()? * off));
            let fit = Fit {
                chi_squared,
                degrees_of_freedom: 2,
            };
            Some(!fit.is_bad())
        });
        if let Some(heading) = self.frame_heading
            && (is_checked || agrees == Some(true))
        {
            // Only the first target hears this from the references.
            if let Some(estimate) = &mut self.estimate {
                estimate.on_sensor(heading.0, heading.1);
            }
            let systematic = systematic(&self.config, heading.1);
            self.fix(
                now,
                &at_stop,
                found.position,
                found.covariance,
                heading,
                systematic,
            );
            return;
        }
        // If the next place contradicts the direction, another pair of places gives a new one.
        let is_told = self.frame_heading.is_some();
        if is_told && !(self.is_heading_provisional && agrees == Some(false)) {
            return;
        }
        // Two places give the direction of the sensor.
        if let Some((before, before_covariance, track)) = &before
            && let Some(walked) = at_stop.since(track)
        {
            let apart = found.position - before;
            let distance = root(walked.vector.norm_squared());
            let covariance = before_covariance + found.covariance + walked.covariance;
            let sigma = root(covariance.trace()) / distance;
            if distance > 0.0 && sigma < HEADING_LIMIT {
                let heading = angle::wrap_signed(direction(apart) - direction(walked.vector));
                self.frame_heading = Some((heading, sigma));
                self.is_heading_provisional = true;
            }
        }
    }
}

/// Direction of a displacement, radians.
fn direction(of: Vector2<f32>) -> f32 {
    RealField::atan2(of.y, of.x)
}

fn systematic(config: &TargetConfig, frame_heading_sigma: f32) -> Systematic<f32> {
    let own = config.systematic_heading_deg.to_radians();
    Systematic {
        heading_sigma: root(own * own + frame_heading_sigma * frame_heading_sigma),
        scale_sigma: config.systematic_scale,
    }
}

/// A track in the target's own frame, with its origin here.
pub(super) fn nowhere(config: &TargetConfig) -> Track<f32> {
    let origin = (Point2::origin(), Matrix2::zeros());
    let track = Track::start(origin.0, origin.1, systematic(config, 0.0));
    debug_assert!(track.is_ok(), "the configuration was checked");
    track.unwrap_or_default()
}

fn symmetric(matrix: Matrix2<f32>) -> Matrix2<f32> {
    (matrix + matrix.transpose()) * 0.5
}
