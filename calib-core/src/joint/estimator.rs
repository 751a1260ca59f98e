//! The estimator with its capacities: measurements in, answers out.

use nalgebra::{Point2, Vector2, Vector3};

use super::{
    BearingResidual, Carrier, Finding, JointError, JointSettings, JointSolution, Leg, LegResidual,
    ProtectionLevels, ReferenceHeadings, StopPlace,
    problem::{
        Common, Problem, REFERENCES, Sight, Standing, Stop, Unknown, Visit, root_information,
        workspace,
    },
};
use crate::{Limits, Pose, Real, Refusal};

/// Joint estimation of up to `CAMERAS` cameras, of which the first two are the references, from up to
/// `STOPS` stops and `BEARINGS` bearings, and of up to `MARKS` marks, visited twice each on average.
/// `WORKSPACE` is [`workspace`](super::workspace)`(CAMERAS, MARKS)`.
///
/// Measurements come stop after stop. Nothing is computed until [`solve`](JointEstimator::solve),
/// which begins where the last one ended.
#[derive(Clone, Debug)]
pub struct JointEstimator<
    T: Real,
    const CAMERAS: usize,
    const STOPS: usize,
    const BEARINGS: usize,
    const MARKS: usize,
    const WORKSPACE: usize,
> {
    common: Common<T>,
    limits: Limits<T>,
    is_started: bool,
    stops: List<Stop<T>, STOPS>,
    sights: List<Sight<T>, BEARINGS>,
    visits: [[Visit<T>; 2]; MARKS],
    visited: usize,
    cameras: [Unknown<T>; CAMERAS],
    marks: [Unknown<T>; MARKS],
    workspace: [T; WORKSPACE],
}

/// Values in an array, as many as came.
#[derive(Clone, Debug)]
struct List<V, const N: usize> {
    values: [V; N],
    len: usize,
}

impl<V: Copy, const N: usize> List<V, N> {
    fn new(empty: V) -> Self {
        Self {
            values: [empty; N],
            len: 0,
        }
    }

    fn push(&mut self, value: V) -> Result<usize, JointError> {
        let index = self.len;
        *self.values.get_mut(index).ok_or(JointError::Full)? = value;
        self.len += 1;
        Ok(index)
    }

    fn all_mut(&mut self) -> &mut [V] {
        self.values.get_mut(..self.len).unwrap_or_default()
    }
}

impl<
    T: Real,
    const CAMERAS: usize,
    const STOPS: usize,
    const BEARINGS: usize,
    const MARKS: usize,
    const WORKSPACE: usize,
> JointEstimator<T, CAMERAS, STOPS, BEARINGS, MARKS, WORKSPACE>
{
    /// An estimator that knows of no stop yet. `baseline` is the distance between both references.
    ///
    /// # Errors
    /// [`JointError::NotFinite`] for a baseline, a scale or a sigma that is not above zero.
    pub fn new(baseline: T, settings: JointSettings<T>) -> Result<Self, JointError> {
        const {
            assert!(CAMERAS >= REFERENCES, "two references define the frame");
            assert!(STOPS <= u16::MAX as usize, "stops are counted in 16 bits");
            assert!(
                WORKSPACE >= workspace(CAMERAS, MARKS),
                "workspace(CAMERAS, MARKS)"
            );
        }
        check(baseline, &settings)?;
        let JointSettings {
            scale,
            compass,
            limits,
        } = settings;
        let unknown = Unknown {
            value: Vector3::zeros(),
            step: Vector3::zeros(),
            column: None,
            tried: 0,
            is_new: false,
            protection: ProtectionLevels::default(),
        };
        let visit = Visit {
            stop: 0,
            mark: 0,
            sigma: T::one(),
        };
        Ok(Self {
            common: Common {
                baseline,
                scale_prior: scale,
                compass_prior: compass,
                carrier: Vector2::new(scale.mean, compass.mean),
                carrier_step: Vector2::zeros(),
                leg_factor: T::one(),
                held: None,
                window: [0, u16::MAX],
            },
            limits,
            is_started: false,
            stops: List::new(Stop {
                place: Point2::origin(),
                displacement: Vector2::zeros(),
                root: [T::zero(); 3],
                standing: Standing::Counts,
                chain: [T::zero(); 5],
            }),
            sights: List::new(Sight {
                stop: 0,
                camera: 0,
                bearing: T::zero(),
                sigma: T::one(),
                standing: Standing::Counts,
            }),
            visits: [[visit; 2]; MARKS],
            visited: 0,
            cameras: [unknown; CAMERAS],
            marks: [unknown; MARKS],
            workspace: [T::zero(); WORKSPACE],
        })
    }

    /// Appoints other references: camera `first` becomes camera 0 and `second` camera 1, which give
    /// their numbers to those, with this distance between them. Everything is estimated anew then.
    ///
    /// Bearings may so be taken before anybody knows who the references will be.
    ///
    /// # Errors
    /// [`JointError::Unknown`] where these are not two cameras, and as
    /// [`new`](JointEstimator::new).
    pub fn appoint(
        &mut self,
        [first, second]: [usize; 2],
        baseline: T,
        settings: JointSettings<T>,
    ) -> Result<(), JointError> {
        if first == second || first >= CAMERAS || second >= CAMERAS {
            return Err(JointError::Unknown);
        }
        check(baseline, &settings)?;
        // Where the first exchange puts the second reference.
        let second = if second == 0 { first } else { second };
        for [a, b] in [[0, index(first)?], [1, index(second)?]] {
            for sight in self.sights.all_mut() {
                if sight.camera == a {
                    sight.camera = b;
                } else if sight.camera == b {
                    sight.camera = a;
                }
            }
        }
        for sight in self.sights.all_mut() {
            sight.standing = Standing::Counts;
        }
        for stop in self.stops.all_mut() {
            stop.standing = Standing::Counts;
        }
        self.limits = settings.limits;
        self.is_started = false;
        let common = &mut self.common;
        common.baseline = baseline;
        common.scale_prior = settings.scale;
        common.compass_prior = settings.compass;
        common.carrier = Vector2::new(settings.scale.mean, settings.compass.mean);
        common.leg_factor = T::one();
        common.held = None;
        for camera in &mut self.cameras {
            camera.column = None;
            camera.tried = 0;
        }
        Ok(())
    }

    /// The next stop of the walk, and its number: they count from zero. `leg` is how the target came
    /// there; `None` at the first stop, and where the way was not measured.
    ///
    /// # Errors
    /// [`JointError::Full`]; [`JointError::NotFinite`].
    pub fn add_stop(&mut self, leg: Option<Leg<T>>) -> Result<usize, JointError> {
        let (mut displacement, mut root) = (Vector2::zeros(), [T::zero(); 3]);
        if let Some(leg) = leg.filter(|_| self.stops.len > 0) {
            if !leg.displacement.iter().all(T::is_finite) {
                return Err(JointError::NotFinite);
            }
            displacement = leg.displacement;
            root = root_information(&leg.covariance).ok_or(JointError::NotFinite)?;
        }
        let number = self.stops.push(Stop {
            place: Point2::origin(),
            displacement,
            root,
            standing: Standing::Counts,
            chain: [T::zero(); 5],
        })?;
        if self.is_started {
            self.problem().reckon_on(number);
        }
        Ok(number)
    }

    /// Camera `camera` saw the target at a stop: `bearing` is the offset from its optical axis,
    /// radians, positive to the left, with its standard deviation.
    ///
    /// # Errors
    /// [`JointError::Unknown`], [`JointError::Full`], [`JointError::NotFinite`].
    pub fn add_bearing(
        &mut self,
        stop: usize,
        camera: usize,
        bearing: T,
        sigma: T,
    ) -> Result<(), JointError> {
        if stop >= self.stops.len || camera >= CAMERAS {
            return Err(JointError::Unknown);
        }
        if !(bearing.is_finite() && is_sigma(&sigma)) {
            return Err(JointError::NotFinite);
        }
        self.sights.push(Sight {
            stop: index(stop)?,
            camera: index(camera)?,
            bearing,
            sigma,
            standing: Standing::Counts,
        })?;
        Ok(())
    }

    /// At a stop the target stood on mark `mark`, up to `sigma` in every direction. Marks are places
    /// that can be found again; where they are is not known. A mark visited twice closes a loop.
    ///
    /// # Errors
    /// [`JointError::Unknown`], [`JointError::Full`], [`JointError::NotFinite`].
    pub fn add_visit(&mut self, stop: usize, mark: usize, sigma: T) -> Result<(), JointError> {
        if stop >= self.stops.len || mark >= MARKS {
            return Err(JointError::Unknown);
        }
        if !is_sigma(&sigma) {
            return Err(JointError::NotFinite);
        }
        let new = Visit {
            stop: index(stop)?,
            mark: index(mark)?,
            sigma,
        };
        let visits = self.visits.as_flattened_mut();
        *visits.get_mut(self.visited).ok_or(JointError::Full)? = new;
        self.visited += 1;
        self.problem().find_mark(mark);
        Ok(())
    }

    /// Estimates everything anew from all that came, from where the last solve ended.
    ///
    /// # Errors
    /// [`JointError::Start`] until the references' sightings give a frame; [`JointError::Solve`].
    pub fn solve(&mut self) -> Result<JointSolution<T>, JointError> {
        let limits = self.limits;
        if !self.is_started {
            self.problem().start()?;
            self.is_started = true;
        }
        let settled = self.problem().settle(&limits);
        settled.map_err(JointError::Solve)
    }

    /// Looks for the measurement that contradicts the others most: a bearing, a leg, or all that a
    /// camera has seen since some stop. If chance does so only once in 100,000 it is left out, and
    /// everything solved again. `None` if nothing contradicts. To be called until then, some times
    /// at most; takes a pass for each stop, and more where a camera is under suspicion. May follow a
    /// solve that came to no end because of contradictions; another solve tells whether it now does.
    ///
    /// # Errors
    /// [`JointError::Solve`]; with [`Refusal::TooFew`] before the first solve.
    pub fn check(&mut self) -> Result<Option<Finding<T>>, JointError> {
        let limits = self.limits;
        let checked = { self.solved() }.and_then(|mut problem| problem.check(&limits));
        checked.map_err(JointError::Solve)
    }

    /// Estimates by how much the legs err more, or less, than they claim, and solves again with that.
    /// A claim weighs as much as six residuals. Tells the factor of the sigmas, which stays.
    ///
    /// # Errors
    /// As [`check`](JointEstimator::check).
    pub fn fit_leg_noise(&mut self) -> Result<T, JointError> {
        let limits = self.limits;
        let fitted = { self.solved() }.and_then(|mut problem| problem.fit_leg_noise(&limits));
        fitted.map_err(JointError::Solve)
    }

    /// Computes the protection levels of all cameras, which [`protection`](JointEstimator::protection)
    /// then tells. A pass for each stop.
    ///
    /// # Errors
    /// As [`check`](JointEstimator::check).
    pub fn protect(&mut self) -> Result<(), JointError> {
        let protected = self.solved().and_then(|mut problem| problem.protect());
        protected.map_err(JointError::Solve)
    }

    /// How far a camera's pose may be off because of one wrong measurement that no test notices. As
    /// [`protect`](JointEstimator::protect) found it; `None` for one without a pose, and references.
    pub fn protection(&self, camera: usize) -> Option<ProtectionLevels<T>> {
        let camera = self
            .cameras
            .get(camera)
            .filter(|camera| camera.column.is_some());
        camera.map(|camera| camera.protection)
    }

    /// Where a camera stands and looks, from all measurements.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera that does not take part (yet); [`Refusal::Undetermined`].
    pub fn pose(&mut self, camera: usize) -> Result<Pose<T>, Refusal> {
        self.solved()?.pose(camera)
    }

    /// Where a stop is, from all measurements. The last one costs next to nothing, any other a pass.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve or for a stop there is not;
    /// [`Refusal::Undetermined`].
    pub fn place(&mut self, stop: usize) -> Result<StopPlace<T>, Refusal> {
        self.solved()?.place(stop)
    }

    /// What the carrier gets wrong.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve; [`Refusal::Undetermined`].
    pub fn carrier(&mut self) -> Result<Carrier<T>, Refusal> {
        self.solved()?.carrier()
    }

    /// Where the references look.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve; [`Refusal::Undetermined`].
    pub fn reference_headings(&mut self) -> Result<ReferenceHeadings<T>, Refusal> {
        self.solved()?.reference_headings()
    }

    /// What is left of bearing `n`, in the order in which bearings were added. A pass for each other
    /// stop.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve, for a camera without a pose or a bearing there is
    /// not; [`Refusal::Undetermined`].
    pub fn bearing_residual(&mut self, n: usize) -> Result<BearingResidual<T>, Refusal> {
        self.solved()?.bearing_residual(n)
    }

    /// What is left of the leg to a stop. A pass for each.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve and where no leg was measured;
    /// [`Refusal::Undetermined`].
    pub fn leg_residual(&mut self, stop: usize) -> Result<LegResidual<T>, Refusal> {
        self.solved()?.leg_residual(stop)
    }

    /// Whether this camera's bearing at this stop came already.
    pub fn has_bearing(&self, stop: usize, camera: usize) -> bool {
        let is_it = |sight: &Sight<T>| {
            usize::from(sight.stop) == stop && usize::from(sight.camera) == camera
        };
        let all = self.sights.values.get(..self.sights.len);
        all.unwrap_or_default().iter().any(is_it)
    }

    /// Bearings of a camera: how many came, and how many of these count.
    pub fn bearings_of(&self, camera: usize) -> [usize; 2] {
        let all = self.sights.values.get(..self.sights.len);
        let of = { all.unwrap_or_default().iter() }
            .filter(|sight| usize::from(sight.camera) == camera);
        let counting = of.clone().filter(|sight| sight.standing == Standing::Counts);
        [of.count(), counting.count()]
    }

    /// Stops so far.
    pub fn stops(&self) -> usize {
        self.stops.len
    }

    /// Bearings so far.
    pub fn bearings(&self) -> usize {
        self.sights.len
    }

    fn solved(&mut self) -> Result<Problem<'_, T>, Refusal> {
        if !self.is_started || self.common.held.is_none() {
            return Err(Refusal::TooFew);
        }
        Ok(self.problem())
    }

    fn problem(&mut self) -> Problem<'_, T> {
        let visits = self.visits.as_flattened();
        Problem {
            common: &mut self.common,
            stops: self.stops.all_mut(),
            sights: self.sights.all_mut(),
            visits: visits.get(..self.visited).unwrap_or_default(),
            cameras: &mut self.cameras,
            marks: &mut self.marks,
            workspace: &mut self.workspace,
        }
    }
}

fn check<T: Real>(baseline: T, settings: &JointSettings<T>) -> Result<(), JointError> {
    let JointSettings { scale, compass, .. } = settings;
    let above_zero = [baseline, scale.mean, scale.sigma, compass.sigma];
    if !above_zero.iter().all(is_sigma) || !compass.mean.is_finite() {
        return Err(JointError::NotFinite);
    }
    Ok(())
}

fn is_sigma<T: Real>(number: &T) -> bool {
    number.is_finite() && *number > T::zero()
}

fn index(number: usize) -> Result<u16, JointError> {
    u16::try_from(number).map_err(|_| JointError::Unknown)
}
