//! Cameras in space: where is a camera that hangs high, tilted and rolled, and where does it look?
//!
//! A sighting is the pixel (column and row) at which a target at a known place was seen. Unknown are a
//! camera's place, heading, pitch and roll, and of its [`Lens`] what is not told exactly. Axes, for a heading
//! `w`, a pitch `p` (down is positive) and a roll `r` (positive where the left side is high):
//!
//! ```text
//! forward = (cos p cos w, cos p sin w, -sin p)
//! left    = cos r (-sin w, cos w, 0) + sin r (sin p cos w, sin p sin w, cos p)
//! up      = -sin r (-sin w, cos w, 0) + cos r (sin p cos w, sin p sin w, cos p)
//! ```
//!
//! Upright, a target `h` below the camera is at `c + h e^(i w) (forward + i left) / down`: one complex
//! line through all targets gives place, height and heading for each pitch and roll that is tried (planar
//! case of Kukelova, Bujnak, Pajdla, "Closed-form solutions to minimal absolute pose problems with known
//! vertical direction", ACCV 2010). The best few, and the level pose in the plane, are fitted to the
//! pixels (Levenberg and Marquardt). The targets may stand at different heights, but by much less than
//! the camera is above or below them.

mod adjustment;
mod lens;
mod start;

use nalgebra::{Matrix3, Matrix6, Point3, Vector2, Vector3};

use crate::{
    Limits, Real, Refusal, Status,
    angle::wrap_signed,
    fit::Fit,
    numerics::real::{lit, root},
};

use adjustment::{Adjusted, Problem};
pub use lens::Lens;

/// Fewest sightings of a pose in space.
pub const FEWEST: usize = 3;

/// A target at a known place, and the pixel that it was seen at.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sighting<T: Real> {
    /// Place of the target.
    pub target: Point3<T>,
    /// Standard deviations of the target's place along x, y and z.
    pub target_sigma: Vector3<T>,
    /// Column and row, from 0 at the upper left.
    pub pixel: Vector2<T>,
    /// Standard deviation of column and row each.
    pub pixel_sigma: T,
}

impl<T: Real> Sighting<T> {
    fn is_usable(&self) -> bool {
        let numbers = self
            .target
            .iter()
            .chain(&self.target_sigma)
            .chain(&self.pixel);
        numbers.chain([&self.pixel_sigma]).all(T::is_finite) && self.pixel_sigma > T::zero()
    }
}

/// A camera in space: angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose<T: Real> {
    /// Place of the camera.
    pub position: Point3<T>,
    /// Heading of the optical axis, counter-clockwise from x.
    pub heading: T,
    /// Angle of the optical axis below the horizon.
    pub pitch: T,
    /// Turn about the optical axis, positive where the left side is high.
    pub roll: T,
}

impl<T: Real> Pose<T> {
    /// Forward, left and up as rows.
    pub fn axes(&self) -> Matrix3<T> {
        let (sw, cw) = self.heading.sine_cosine();
        let (sp, cp) = self.pitch.sine_cosine();
        let (sr, cr) = self.roll.sine_cosine();
        let left = Vector3::new(-sw, cw, T::zero());
        let up = Vector3::new(sp * cw, sp * sw, cp);
        Matrix3::from_rows(&[
            Vector3::new(cp * cw, cp * sw, -sp).transpose(),
            (left * cr + up * sr).transpose(),
            (up * cr - left * sr).transpose(),
        ])
    }

    /// The same pose with angles in their ranges: pitch within a quarter turn, the others within half.
    /// Returns true too if the pitch was over the edge.
    fn normalised(mut self) -> (Self, bool) {
        self.pitch = wrap_signed(self.pitch);
        let is_over = self.pitch.abs() > T::frac_pi_2();
        if is_over {
            let over = T::pi() - self.pitch.abs();
            self.pitch = if self.pitch < T::zero() { -over } else { over };
            self.heading += T::pi();
            self.roll += T::pi();
        }
        self.heading = wrap_signed(self.heading);
        self.roll = wrap_signed(self.roll);
        (self, is_over)
    }
}

/// A number that is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Told<T> {
    /// The number.
    pub value: T,
    /// Its standard deviation, above zero.
    pub sigma: T,
}

/// Numbers of a pose that are known beforehand, if any.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Priors<T> {
    /// Of the camera's z, as with a tape.
    pub height: Option<Told<T>>,
    /// Of the pitch, radians.
    pub pitch: Option<Told<T>>,
    /// Of the roll, radians.
    pub roll: Option<Told<T>>,
}

impl<T> Default for Priors<T> {
    fn default() -> Self {
        Self {
            height: None,
            pitch: None,
            roll: None,
        }
    }
}

impl<T: Real> Priors<T> {
    fn all(&self) -> [Option<Told<T>>; 3] {
        [self.height, self.pitch, self.roll]
    }

    fn are_usable(&self) -> bool {
        let fine = |told: &Told<T>| {
            told.value.is_finite() && told.sigma.is_finite() && told.sigma > T::zero()
        };
        self.all().iter().flatten().all(fine)
    }
}

/// A pose in space with its covariance and how well the sightings fit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Solution<T: Real> {
    /// The pose that fits best.
    pub pose: Pose<T>,
    /// Covariance of x, y, z, heading, pitch and roll.
    pub covariance: Matrix6<T>,
    /// Factor of the told focal length, k1 and k2.
    pub lens: Vector3<T>,
    /// Standard deviations of `lens`; zero for what was told to be exact.
    pub lens_sigmas: Vector3<T>,
    /// Agreement of sightings and priors with them.
    pub fit: Fit<T>,
    /// Another pose, more than five sigmas off, that fits nearly as well.
    pub rival: Option<Pose<T>>,
    /// Factor of the focal length that fits much better than one that was told to be exact.
    pub fitting_focal: Option<T>,
}

impl<T: Real> Solution<T> {
    /// Standard deviations of x, y, z, heading, pitch and roll.
    pub fn sigmas(&self) -> [T; 6] {
        self.covariance.diagonal().map(root).into()
    }

    /// Standard deviation of the place, in all three directions together.
    pub fn sigma_position(&self) -> T {
        root(self.covariance.diagonal().fixed_rows::<3>(0).sum())
    }

    /// Status of the pose: doubtful where the sightings do not fit, fit another pose as well, or fit
    /// another focal length much better.
    pub fn status(&self, limits: &Limits<T>) -> Status {
        let [_, _, _, heading, ..] = self.sigmas();
        if self.fit.is_bad() || self.rival.is_some() || self.fitting_focal.is_some() {
            Status::Doubtful
        } else if self.sigma_position() <= limits.position && heading <= limits.heading {
            Status::Calibrated
        } else {
            Status::Weak
        }
    }

    /// Returns true if a pose is more than five sigmas off, in any of its six numbers.
    fn is_elsewhere(&self, other: &Pose<T>) -> bool {
        let place = other.position - self.pose.position;
        let turns = [
            wrap_signed(other.heading - self.pose.heading),
            wrap_signed(other.pitch - self.pose.pitch),
            wrap_signed(other.roll - self.pose.roll),
        ];
        let offs = place.iter().copied().chain(turns);
        offs.zip(self.sigmas())
            .any(|(off, sigma)| off.abs() > sigma * lit(5.0))
    }
}

/// Chi squared within which another pose fits nearly as well: one in a hundred of two degrees of freedom.
const NEARLY: f64 = 9.2;

/// Chi squared that another focal length must gain over one told to be exact: four of its sigmas.
const MUCH_BETTER: f64 = 16.0;

/// Standard deviation of a focal length that is freed to look at it.
const FREED: f64 = 0.3;

/// The pose in space from three or more sightings.
///
/// # Errors
/// [`Refusal::TooFew`] below [`FEWEST`]; [`Refusal::NotFinite`] for an unusable number;
/// [`Refusal::DangerLine`] for targets on one line where nothing else is known;
/// [`Refusal::Undetermined`], [`Refusal::TargetBehind`] and [`Refusal::DidNotConverge`] where no start
/// leads to a pose.
pub fn solve<T: Real>(
    sightings: &[Sighting<T>],
    lens: &Lens<T>,
    priors: &Priors<T>,
) -> Result<Solution<T>, Refusal> {
    if sightings.len() < FEWEST {
        return Err(Refusal::TooFew);
    }
    if !(lens.is_usable() && priors.are_usable() && sightings.iter().all(Sighting::is_usable)) {
        return Err(Refusal::NotFinite);
    }
    let told = priors.all().iter().flatten().count();
    if told == 0 && are_in_line(sightings) {
        return Err(Refusal::DangerLine);
    }
    let problem = Problem {
        sightings,
        lens,
        priors,
    };
    let mut best: Option<Adjusted<T>> = None;
    let mut others: heapless::Vec<Adjusted<T>, { start::MOST + 1 }> = heapless::Vec::new();
    let mut refusal = Refusal::TargetBehind;
    for pose in start::starts(&problem) {
        match problem.adjust(&pose, problem.told_lens()) {
            Ok(found) => {
                // As many as there are starts.
                let _ = others.push(found);
                if best
                    .as_ref()
                    .is_none_or(|best| found.chi_squared < best.chi_squared)
                {
                    best = Some(found);
                }
            }
            Err(why) => refusal = why,
        }
    }
    let best = best.ok_or(refusal)?;
    let mut solution = Solution {
        pose: best.pose,
        covariance: best.covariance.fixed_view::<6, 6>(0, 0).into_owned(),
        lens: best.lens,
        lens_sigmas: best.lens_sigmas(),
        fit: Fit {
            chi_squared: best.chi_squared,
            degrees_of_freedom: (2 * sightings.len() + told).saturating_sub(6),
        },
        rival: None,
        fitting_focal: None,
    };
    let limit = best.chi_squared + lit(NEARLY);
    let near = others.iter().filter(|other| other.chi_squared < limit);
    solution.rival = near
        .map(|other| other.pose)
        .find(|other| solution.is_elsewhere(other));
    if lens.sigmas.x <= T::zero() && solution.fit.degrees_of_freedom > 0 {
        solution.fitting_focal = other_focal(&problem, &best);
    }
    Ok(solution)
}

/// Factor of the focal length that fits much better than the one that was told to be exact.
fn other_focal<T: Real>(problem: &Problem<'_, T>, best: &Adjusted<T>) -> Option<T> {
    let mut lens = *problem.lens;
    lens.sigmas.x = lit(FREED);
    let freed = Problem {
        lens: &lens,
        ..*problem
    };
    let found = freed.adjust(&best.pose, best.lens).ok()?;
    // One wrong sighting gets a little better with any unknown that is freed.
    let most = (best.chi_squared * lit(0.5)).min(best.chi_squared - lit(MUCH_BETTER));
    (found.chi_squared < most).then_some(found.lens.x)
}

/// Returns true if the targets stand on one line, as far as the arithmetic can tell.
fn are_in_line<T: Real>(sightings: &[Sighting<T>]) -> bool {
    let count = T::whole(u32::try_from(sightings.len()).unwrap_or(u32::MAX));
    let all = || sightings.iter().map(|sighting| sighting.target.coords);
    let middle = all().fold(Vector3::zeros(), |sum, place| sum + place) / count;
    let scatter = all().fold(Matrix3::zeros(), |sum, place| {
        let off = place - middle;
        sum + off * off.transpose()
    });
    // The product of the two largest principal moments, nearly, and the largest.
    let (trace, square) = (scatter.trace(), (scatter * scatter).trace());
    let product = (trace * trace - square) * lit(0.5);
    !(product > trace * trace * lit(1e-6))
}
