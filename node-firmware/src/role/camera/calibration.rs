//! Pose of a camera from its own sightings (thesis 2.6.2).

use calib_core::{
    Limits, Pose, Refusal, Sighting, angle,
    dead_reckoning::{Place, correlate},
    fit::Fit,
    level::{self, Mounting, Row, Tolerance},
    resection::{self, Solution},
};

use nalgebra::{Matrix3, Point2, Vector3};

use super::kept::{Kept, OfStop};
use crate::{
    arithmetic::root,
    config::LensSigma,
    facts::KeptSighting,
    limits::SIGHTINGS,
    message::{CameraState, FittingLens, MemberAddress, Mount, PoseParts, StopNumber},
    vision::Lens,
};

/// Sigmas beyond which a sighting is left out, if there are five or more. This tests single sightings; the
/// [fit](calib_core::fit) tests all that remain. By chance one of 16 sightings is so far off in one camera of a
/// thousand.
const GATE: f32 = 4.0;

/// A level camera.
const LEVEL: Mounting<f32> = Mounting {
    pitch: 0.0,
    roll: 0.0,
};

/// Relative error of the size of a blob besides its columns: light, and edges that are cut off.
const SIZE_SHARE: f32 = 0.25;
/// Least number of sizes that can contradict a pose.
const FEWEST_SIZES: usize = 3;

/// Standard deviation of a direction that tells nothing, radians.
const WORTHLESS: f32 = 3.0;

/// The sightings of one camera and the pose they give.
#[derive(Clone, Debug)]
pub(super) struct Calibration {
    kept: Kept<KeptSighting, SIGHTINGS>,
    /// Pitch and roll by which directions are turned upright.
    mounting: Mounting<f32>,
    /// Place of the camera for which that was found.
    stands: Point2<f32>,
}

impl OfStop for KeptSighting {
    fn key(&self) -> (MemberAddress, StopNumber) {
        (self.target, self.stop)
    }
}

/// Result of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    pub(super) state: CameraState,
    pub(super) used: usize,
    pub(super) chi_squared: f32,
    pub(super) mount: Option<Mount>,
}

impl Calibration {
    pub(super) const fn new() -> Self {
        Self {
            kept: Kept::new(),
            mounting: LEVEL,
            stands: Point2::new(0.0, 0.0),
        }
    }

    pub(super) fn count(&self) -> usize {
        self.kept.len()
    }

    pub(super) fn get(&self, index: usize) -> Option<&KeptSighting> {
        self.kept.get(index)
    }

    pub(super) fn clear(&mut self) {
        self.kept.clear();
    }

    /// Adds a sighting, and returns its index. A stop counts once: if it is told again with a better place, it replaces
    /// the former sighting. A full list that gives no pose drops its oldest entry.
    pub(super) fn add(&mut self, sighting: KeptSighting) -> Option<usize> {
        let Some(place) = self.kept.find(sighting.key()) else {
            return self.kept.add(sighting);
        };
        *self.kept.get_mut(place)? = sighting;
        Some(place)
    }

    /// Restores a sighting, and returns its index.
    pub(super) fn restore(&mut self, sighting: KeptSighting) -> Option<usize> {
        let place = self.add(sighting);
        self.kept.find_first();
        place
    }

    /// Returns one of the sightings that share target and last fix with the most others.
    fn common(&self) -> Option<&KeptSighting> {
        let shared = |one: &&KeptSighting| {
            let same = |other: &&KeptSighting| {
                other.target == one.target && other.place.parts().fix == one.place.parts().fix
            };
            self.kept.iter().filter(same).count()
        };
        self.kept.iter().max_by_key(shared)
    }

    /// Solves the pose from all sightings, and judges it by these limits. The lens is known so well.
    pub(super) fn solve(&mut self, limits: &Limits<f32>, lens_sigma: &LensSigma) -> Answer {
        self.mounting = LEVEL;
        match self.solution(limits, lens_sigma) {
            Ok(answer) => answer,
            Err(Refusal::TooFew) => Answer {
                state: CameraState::Waiting,
                used: 0,
                chi_squared: 0.0,
                mount: None,
            },
            Err(refusal) => Answer {
                state: CameraState::Refused(refusal),
                used: 0,
                chi_squared: 0.0,
                mount: None,
            },
        }
    }

    fn solution(
        &mut self,
        limits: &Limits<f32>,
        lens_sigma: &LensSigma,
    ) -> Result<Answer, Refusal> {
        let common = &self.common().copied().ok_or(Refusal::TooFew)?;
        let mut dropped = [false; SIGHTINGS];
        let dropped = dropped.get_mut(..self.kept.len()).unwrap_or_default();
        debug_assert_eq!(dropped.len(), self.kept.len());
        let tolerance = lens_sigma.tolerance(common.place.parts().standing_sigma);
        let (solution, pose) = self.hung(common, dropped, &tolerance)?;
        let fit = solution.fit();
        let mut covariance = pose.covariance * fit.inflation();
        for (axis, sigma) in lens_sigma.of_tangent().into_iter().enumerate() {
            if sigma > 0.0 {
                let mut errors = [0.0; 2];
                if let Some(error) = errors.get_mut(axis) {
                    *error = sigma;
                }
                let moved = self.through(errors, common, dropped, &solution.pose)?;
                covariance += moved * moved.transpose();
            }
        }
        let rows = self.rows(common, dropped);
        let hung = level::judge(&pose, &rows, self.mounting, &tolerance);
        covariance += hung.map_or_else(Matrix3::zeros, |hung| hung.widening);
        let is_refused = hung.is_some_and(|hung| hung.is_refused());
        let parts = PoseParts::from(Pose { covariance, ..pose });
        // Unusable numbers are not reported.
        if !(parts.is_usable() && solution.chi_squared.is_finite()) {
            return Err(Refusal::Undetermined);
        }
        let state = match CameraState::judged(parts, &fit, limits) {
            CameraState::Calibrated(_) | CameraState::Weak(_)
                if is_refused
                    || self.allow_another_place(common, dropped, &solution.pose, parts) =>
            {
                CameraState::Doubtful(parts)
            }
            state => state.supported(solution.used, self.kept.len(), false),
        };
        Ok(Answer {
            state,
            used: solution.used,
            chi_squared: solution.chi_squared,
            mount: hung.and_then(|hung| Mount::of(hung.mounting, hung.height)),
        })
    }

    /// Returns true if the sizes in which it saw a round target contradict this pose: by width and distance it would
    /// have another radius at each stop. A camera that is upside down fits a pose as well as one that is not, with
    /// other distances.
    #[inline(never)] // for less flash
    pub(super) fn is_contradicted_by_sizes(&self, pose: &PoseParts, mount: Option<Mount>) -> bool {
        let Some(common) = self.common() else {
            return false;
        };
        let stands = Point2::from(pose.position);
        let (mut all, mut first, mut second, mut count) = (0.0, 0.0, 0.0, 0);
        for kept in { self.kept.iter() }.filter(|kept| kept.target == common.target) {
            let along = root((kept.place.position() - stands).norm_squared());
            if let Some((radius, sigma)) = kept.seen.radius(along, mount) {
                let share = sigma / radius;
                let weight = 1.0 / (share * share + SIZE_SHARE * SIZE_SHARE);
                all += weight;
                first += weight * radius;
                second += weight * radius * radius;
                count += 1;
            }
        }
        // Squared differences of the radii from their mean, over its square.
        let fit = Fit {
            chi_squared: all * (all * second / (first * first) - 1.0),
            degrees_of_freedom: usize::saturating_sub(count, 1),
        };
        count >= FEWEST_SIZES && fit.is_bad()
    }

    /// Returns the rows of the sightings that count.
    // for less stack
    #[inline(never)]
    fn rows(&self, common: &KeptSighting, dropped: &[bool]) -> heapless::Vec<Row<f32>, SIGHTINGS> {
        let mut rows = heapless::Vec::new();
        for (kept, _) in { self.kept.iter().zip(dropped) }.filter(|(_, dropped)| !**dropped) {
            let sighting = self.sighting(kept, common);
            if let Some(elevation) = kept.seen.elevation.radians() {
                let has_room = rows.push(Row {
                    target: sighting.target,
                    target_variance: sighting.target_covariance.trace() * 0.5,
                    bearing: kept.seen.bearing,
                    elevation,
                    sigma: kept.seen.sigma,
                });
                debug_assert!(has_room.is_ok(), "it has room for all that are kept");
            }
        }
        rows
    }

    /// Returns the change of the pose if the tangents of the lens are larger by this share, and by this amount.
    // for less stack
    #[inline(never)]
    fn through(
        &self,
        [focal, principal]: [f32; 2],
        common: &KeptSighting,
        dropped: &[bool],
        pose: &Pose<f32>,
    ) -> Result<Vector3<f32>, Refusal> {
        let mut seen = self.seen(common);
        let mut dropped = dropped.iter();
        seen.retain(|_| dropped.next() == Some(&false));
        for Sighting { ray, .. } in &mut seen {
            ray.left += ray.left * focal + ray.forward * principal;
        }
        let other = resection::solve(&seen)?.pose;
        let moved = other.position - pose.position;
        Ok(moved.push(angle::wrap_signed(other.heading - pose.heading)))
    }

    /// Returns the pose that fits best, and the sightings that it leaves out.
    // for less stack
    #[inline(never)]
    fn fitted(
        &self,
        common: &KeptSighting,
        dropped: &mut [bool],
    ) -> Result<Solution<f32>, Refusal> {
        let seen = self.seen(common);
        match resection::solve_rejecting(&seen, GATE, dropped) {
            // No majority agrees. Then the lens or a sigma is wrong, rather than half of the sightings. The residuals
            // show it, and the covariance grows with them.
            Err(Refusal::Inconsistent) => {
                dropped.fill(false);
                resection::solve(&seen)
            }
            other => other,
        }
    }

    /// Returns the pose with another lens, if the sightings contradict the configured lens and fit that one.
    // for less stack
    #[inline(never)]
    pub(super) fn with_other_lens(&self, lens: &Lens) -> Option<CameraState> {
        // A camera that is not level may fit another lens.
        let common = self.common().filter(|_| self.mounting.is_level())?;
        let mut scratch = self.seen(common);
        let seen = self.kept.iter().map(|kept| self.sighting(kept, common));
        let view = lens.field_of_view_deg.to_radians();
        let other = resection::other_lens(&seen, &mut scratch, lens.projection, view)?;
        let parts = PoseParts::from(other.solution.pose);
        let lens = FittingLens::new(other.projection, other.field_of_view);
        parts
            .is_usable()
            .then_some(CameraState::OtherLens(parts, lens))
    }

    /// Returns true if another place than this pose's, far beyond the sigmas that are told, fits too.
    // for less stack
    #[inline(never)]
    fn allow_another_place(
        &self,
        common: &KeptSighting,
        dropped: &[bool],
        pose: &Pose<f32>,
        told: PoseParts,
    ) -> bool {
        let sigma = told.pose().map_or(0.0, |told| told.sigma_position());
        resection::alternative(&self.seen(common), dropped, pose, sigma).is_some()
    }

    // for less flash
    #[inline(never)]
    fn seen(&self, common: &KeptSighting) -> heapless::Vec<Sighting<f32>, SIGHTINGS> {
        let mut seen = heapless::Vec::new();
        for kept in self.kept.iter() {
            // The list has no more.
            let _ = seen.push(self.sighting(kept, common));
        }
        seen
    }

    /// A sighting weighted by its stop's own error: the common error of most stops and the `common` one moves the
    /// camera with them. Of a camera that is not level it is turned upright, or worth nothing without its row.
    fn sighting(&self, kept: &KeptSighting, common: &KeptSighting) -> Sighting<f32> {
        let (place, seen) = (kept.place, kept.seen);
        let own = if kept.target == common.target {
            place.own_covariance(&common.place)
        } else {
            place.covariance()
        };
        let target = place.position();
        let (mut ray, mut bearing_sigma) = (seen.ray(), seen.sigma);
        if !self.mounting.is_level() {
            bearing_sigma = WORTHLESS;
            if let Some(elevation) = seen.elevation.radians::<f32>() {
                let upright = self.mounting.seen(seen.bearing, elevation);
                (ray.forward, ray.left) = (upright.ahead, upright.left);
                // The ball bobs by as much as it stands beside its stop.
                let bob = place.parts().standing_sigma;
                let away = (target - self.stands).norm_squared().max(f32::MIN_POSITIVE);
                let of_row = seen.sigma * seen.sigma + bob * bob / away;
                let by_row = self.mounting.by_elevation(seen.bearing, elevation);
                bearing_sigma = root(seen.sigma * seen.sigma + by_row * by_row * of_row);
            }
        }
        Sighting {
            target,
            ray,
            bearing_sigma,
            target_covariance: own,
        }
    }

    /// Solves the pose from all sightings, with the mounting that their rows tell.
    // for less stack
    #[inline(never)]
    fn hung(
        &mut self,
        common: &KeptSighting,
        dropped: &mut [bool],
        tolerance: &Tolerance<f32>,
    ) -> Result<(Solution<f32>, Pose<f32>), Refusal> {
        let mut rounds = level::MOUNTING_ROUNDS;
        loop {
            let solution = self.fitted(common, dropped)?;
            let pose = self.correlated(common, dropped, &solution.pose)?;
            let better = {
                let rows = self.rows(common, dropped);
                level::improved(&pose, &rows, self.mounting, tolerance)
            };
            match better {
                Some(better) if rounds > 0 => {
                    (self.mounting, self.stands) = (better, pose.position);
                    dropped.fill(false);
                    rounds -= 1;
                }
                _ => return Ok((solution, pose)),
            }
        }
    }

    /// Returns the pose with the common errors of the stops added to its covariance.
    // for less stack
    #[inline(never)]
    fn correlated(
        &self,
        common: &KeptSighting,
        dropped: &[bool],
        pose: &Pose<f32>,
    ) -> Result<Pose<f32>, Refusal> {
        let mut used = heapless::Vec::<(Sighting<f32>, Place<f32>), SIGHTINGS>::new();
        let mut targets = heapless::Vec::<MemberAddress, SIGHTINGS>::new();
        for (kept, _) in self
            .kept
            .iter()
            .zip(dropped)
            .filter(|(_, dropped)| !**dropped)
        {
            let has_room = used.push((self.sighting(kept, common), kept.place)).is_ok()
                && targets.push(kept.target).is_ok();
            debug_assert!(has_room, "it has room for all that are kept");
        }
        correlate(pose, &used, |a, b| targets.get(a) == targets.get(b))
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{
        Status,
        camera::Projection,
        dead_reckoning::{Systematic, Track},
    };
    use nalgebra::{Matrix2, Point2};

    use super::*;
    use crate::message::Seen;

    fn kept(stop: StopNumber, target: MemberAddress, fix: u32) -> KeptSighting {
        let systematic = Systematic {
            heading_sigma: 0.0,
            scale_sigma: 0.0,
        };
        let track = Track::start(Point2::origin(), Matrix2::identity(), systematic);
        let seen = Seen::direction(0.1, 0.01);
        KeptSighting {
            target,
            stop,
            place: track.unwrap().numbered(fix).place(0.0).unwrap(),
            seen,
        }
    }

    /// A camera at the origin, from `(x, y, bearing)`.
    fn answer(seen: &[(f32, f32, f32)]) -> Answer {
        let limits = Limits {
            position: 0.3,
            heading: 1.0,
        };
        calibration(seen, 0.0069).solve(&limits, &LensSigma::EXACT)
    }

    fn calibration(seen: &[(f32, f32, f32)], sigma: f32) -> Calibration {
        let mut calibration = Calibration::new();
        for (stop, &(x, y, bearing)) in (0..).zip(seen) {
            let systematic = Systematic {
                heading_sigma: 0.0,
                scale_sigma: 0.0,
            };
            let known = Matrix2::from_diagonal_element(1e-6);
            let track = Track::start(Point2::new(x, y), known, systematic).unwrap();
            calibration.add(KeptSighting {
                target: 1,
                stop,
                place: track.numbered(u32::from(stop)).place(0.0).unwrap(),
                seen: Seen::direction(bearing, sigma),
            });
        }
        calibration
    }

    const STOPS: [(f32, f32); 6] = [
        (3.0, 1.65),
        (5.0, -2.75),
        (4.0, 0.2),
        (2.5, -0.9),
        (6.0, 1.9),
        (3.5, -1.2),
    ];

    /// A ball of one radius, seen from the origin, has another radius at each stop for a camera that stands elsewhere.
    /// Without widths nothing is told.
    #[test]
    fn sizes_contradict_a_pose_with_other_distances() {
        let seen = STOPS.map(|(x, y)| (x, y, y.atan2(x)));
        let mut calibration = calibration(&seen, 0.003);
        let parts = |x, y| PoseParts {
            position: [x, y],
            heading: 0.0,
            covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
        };
        let [right, wrong] = [parts(0.0, 0.0), parts(6.0, 1.7)];
        assert!(!calibration.is_contradicted_by_sizes(&wrong, None));
        for kept in calibration.kept.iter_mut() {
            let range = kept.place.position().coords.norm();
            kept.seen = kept.seen.wide(0.1 / range);
        }
        assert!(!calibration.is_contradicted_by_sizes(&right, None));
        assert!(calibration.is_contradicted_by_sizes(&wrong, None));
    }

    /// Sightings of a lens of 60 degrees of equal angles, and of one of 63 degrees, decoded as a pin-hole of
    /// 60.
    #[test]
    fn a_camera_names_the_lens_that_it_has() {
        let half_view = 30_f32.to_radians();
        let configured = Lens::pin_hole(88, 60.0);
        let of = |decode: &dyn Fn(f32) -> f32| {
            let seen = STOPS.map(|(x, y)| (x, y, decode(y.atan2(x))));
            calibration(&seen, 0.002).with_other_lens(&configured)
        };
        let wide = 31.5_f32.to_radians().tan();
        let other = of(&|bearing| (bearing.tan() / wide * half_view.tan()).atan());
        let lens = other.unwrap().lens().unwrap();
        assert_eq!(lens.projection(), Projection::PinHole);
        assert!((lens.field_of_view_deg() - 63.0).abs() < 1.0, "{lens:?}");

        let other = of(&|bearing| (bearing / half_view * half_view.tan()).atan());
        let (state, lens) = (other.unwrap(), other.unwrap().lens().unwrap());
        assert_eq!(lens.projection(), Projection::EqualAngle);
        assert!((lens.field_of_view_deg() - 60.0).abs() < 1.0, "{lens:?}");
        assert_eq!(state.status(), Status::Doubtful);
        // With that lens the pose is right.
        let pose = state.pose().unwrap().pose().unwrap();
        assert!(pose.position.coords.norm() < 0.02, "{pose}");

        assert_eq!(of(&|bearing| bearing), None);
    }

    /// Near the danger circle noise puts the pose 4.4 units off, right beside a stop, with a sigma of
    /// 0.2.
    #[test]
    fn a_pose_that_another_place_would_do_for_is_doubtful() {
        let wrong = answer(&[
            (3.277, -0.846, -0.2451),
            (3.961, 1.817, 0.4217),
            (4.017, 1.684, 0.4001),
        ]);
        let pose = wrong.state.pose().unwrap().pose().unwrap();
        assert!(
            pose.position.x > 3.0 && pose.sigma_position() < 0.25,
            "{pose}"
        );
        assert_eq!(wrong.state.status(), Status::Doubtful);

        let right =
            [(2.0, 1.0), (4.0, -1.5), (5.0, 1.0)].map(|(x, y): (f32, f32)| (x, y, y.atan2(x)));
        assert_eq!(answer(&right).state.status(), Status::Calibrated);
    }

    /// An error of a fix is common to all stops of that target since that fix, and to no others.
    #[test]
    fn most_stops_have_the_error_of_one_fix_of_one_target_in_common() {
        let others = [
            // Fixes of two targets, with one number by chance.
            [(2, 7), (3, 7), (4, 7)],
            // A target that was found anew at each stop.
            [(2, 7), (2, 8), (2, 9)],
        ];
        for others in others {
            for most in [(1, 5), (1, 7), (5, 8)] {
                let mut calibration = Calibration::new();
                let all = [most, others[0], most, others[1], others[2]];
                for (stop, (target, fix)) in (0..).zip(all) {
                    calibration.add(kept(stop, target, fix));
                }
                let common = calibration.common().unwrap();
                assert_eq!((common.target, common.place.parts().fix), most);
            }
        }
    }
}
