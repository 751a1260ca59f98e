//! The estimator with its capacities: measurements in, answers out.

use nalgebra::{Point2, Vector2, Vector4};

use super::{
    BearingResidual, Carrier, Finding, JointError, JointSettings, JointSolution, Leg, LegResidual,
    Lens, Progress, ProtectionLevels, ReferenceHeadings, Round, StopPlace,
    problem::{
        Common, Problem, Quantity, REFERENCES, Sight, Standing, Stop, Unknown, Visit,
        root_information, workspace,
    },
    round::Work,
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
    work: Work<T>,
    /// Stops, bearings and visits that are counted; those that came since are not, until the next
    /// round begins.
    counted: [usize; 3],
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
    /// [`JointError::NotFinite`] for a baseline, a scale or a sigma that is not above zero;
    /// [`JointError::Full`] if lenses are to be estimated and `WORKSPACE` is less than
    /// [`workspace_with_lenses`](super::workspace_with_lenses)`(CAMERAS, MARKS)`.
    pub fn new(baseline: T, settings: JointSettings<T>) -> Result<Self, JointError> {
        const {
            assert!(CAMERAS >= REFERENCES, "two references define the frame");
            assert!(STOPS <= u16::MAX as usize, "stops are counted in 16 bits");
            assert!(
                WORKSPACE >= workspace(CAMERAS, MARKS, false),
                "workspace(CAMERAS, MARKS)"
            );
        }
        let JointSettings {
            scale,
            compass,
            lens,
            limits,
        } = settings;
        let lens = lens.filter(|sigma| *sigma != T::zero());
        let above_zero = [baseline, scale.mean, scale.sigma, compass.sigma];
        if !above_zero.iter().all(is_sigma) || !compass.mean.is_finite() {
            return Err(JointError::NotFinite);
        }
        if lens.is_some_and(|sigma| !is_sigma(&sigma)) {
            return Err(JointError::NotFinite);
        }
        if WORKSPACE < workspace(CAMERAS, MARKS, lens.is_some()) {
            return Err(JointError::Full);
        }
        let unknown = Unknown {
            value: Vector4::zeros(),
            step: Vector4::zeros(),
            column: None,
            tried: 0,
            is_new: false,
            moved: None,
            successor: None,
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
                lens_prior: lens,
                carrier: Vector2::new(scale.mean, compass.mean),
                carrier_step: Vector2::zeros(),
                leg_factor: T::one(),
                held: None,
                is_started: false,
                window: [0, u16::MAX],
            },
            limits,
            work: Work::new(),
            counted: [0; 3],
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
                quantity: Quantity::Bearing,
                value: T::zero(),
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
        self.stops.push(Stop {
            place: Point2::origin(),
            displacement,
            root,
            standing: Standing::Counts,
            chain: [T::zero(); 5],
        })
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
        self.add_sight(stop, camera, Quantity::Bearing, bearing, sigma)
    }

    /// Camera `camera` was `range` away from the target at a stop, for example by the size that the
    /// target has in its picture, with its standard deviation. It takes the room of a bearing. A range
    /// does not make a camera take part, which takes three bearings; to one that does, bearing and
    /// range together tell a place.
    ///
    /// # Errors
    /// [`JointError::Unknown`], [`JointError::Full`]; [`JointError::NotFinite`], also for a range that
    /// is not above zero.
    pub fn add_range(
        &mut self,
        stop: usize,
        camera: usize,
        range: T,
        sigma: T,
    ) -> Result<(), JointError> {
        if !is_sigma(&range) {
            return Err(JointError::NotFinite);
        }
        self.add_sight(stop, camera, Quantity::Range, range, sigma)
    }

    fn add_sight(
        &mut self,
        stop: usize,
        camera: usize,
        quantity: Quantity,
        value: T,
        sigma: T,
    ) -> Result<(), JointError> {
        if stop >= self.stops.len || camera >= CAMERAS {
            return Err(JointError::Unknown);
        }
        if !(value.is_finite() && is_sigma(&sigma)) {
            return Err(JointError::NotFinite);
        }
        self.sights.push(Sight {
            stop: index(stop)?,
            camera: index(camera)?,
            quantity,
            value,
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
        Ok(())
    }

    /// A camera that was moved is another one from then on: what `camera` saw, and will be said to
    /// have seen, at stop `from` and later belongs to camera `into`, of which nothing was known. It
    /// is then estimated like any other, and `camera` keeps the pose that it had. From the next round
    /// on. It takes four bearings that agree, and three different ones: one that is stuck repeats
    /// itself.
    ///
    /// # Errors
    /// [`JointError::Unknown`] for a camera there is not; [`JointError::Taken`] if something was seen
    /// by `into`, it is a reference, or has become of another.
    pub fn split(&mut self, camera: usize, from: usize, into: usize) -> Result<(), JointError> {
        if camera >= CAMERAS || into >= CAMERAS {
            return Err(JointError::Unknown);
        }
        let sights = self.sights.values.iter().take(self.sights.len);
        let is_seen = sights
            .into_iter()
            .any(|sight| usize::from(sight.camera) == into);
        if is_seen || into < REFERENCES || into == camera || self.work().1.is_successor(into) {
            return Err(JointError::Taken);
        }
        let (from, into) = (index(from)?, index(into)?);
        let unknown = self.cameras.get_mut(camera).ok_or(JointError::Unknown)?;
        unknown.moved = Some(from);
        unknown.successor = Some(into);
        Ok(())
    }

    /// Begins a round: everything is estimated anew from all that came, from where the last round
    /// ended, and then, as asked, contradictions are left out one after the other, the legs' noise is
    /// estimated and protection levels are computed. [`step`](JointEstimator::step) does it. A round
    /// under way is given up for the new one.
    ///
    /// What comes during a round counts from the next one on.
    pub fn begin(&mut self, round: Round) {
        self.count();
        let (work, mut problem) = self.work();
        work.begin(&mut problem, round);
    }

    /// One slice of the round: a pass over the measurements, a reference solve or a camera's
    /// resection. To be called until the round is [`Over`](Progress::Over) or an error ends it;
    /// answers are told then. After that it tells the same solution again.
    ///
    /// # Errors
    /// [`JointError::Start`] until the references' sightings give a frame; [`JointError::Solve`], with
    /// [`Refusal::TooFew`] before the first round.
    pub fn step(&mut self) -> Result<Progress<T>, JointError> {
        let limits = self.limits;
        let (work, mut problem) = self.work();
        work.step(&mut problem, &limits)
    }

    /// Whether a round is under way. Until it is over answers are [`Refusal::DidNotConverge`].
    pub fn is_under_way(&self) -> bool {
        self.work.is_under_way()
    }

    /// A round at one stretch that solves and does nothing else.
    ///
    /// # Errors
    /// As [`step`](JointEstimator::step).
    pub fn solve(&mut self) -> Result<JointSolution<T>, JointError> {
        self.begin(Round::default());
        self.finish().1
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
        let finished = self.finish_solved(Round {
            findings: 1,
            ..Round::default()
        })?;
        match finished {
            (found, Ok(_) | Err(JointError::Solve(Refusal::DidNotConverge))) => Ok(found),
            (_, Err(why)) => Err(why),
        }
    }

    /// Estimates by how much the legs err more, or less, than they claim, and solves again with that.
    /// A claim is believed until residuals contradict it at two sigmas, and weighs as much as six of
    /// them then. Tells the factor of the sigmas, which stays.
    ///
    /// # Errors
    /// As [`check`](JointEstimator::check).
    pub fn fit_leg_noise(&mut self) -> Result<T, JointError> {
        let (_, solved) = self.finish_solved(Round {
            leg_noise: true,
            ..Round::default()
        })?;
        solved.map(|_| self.leg_noise())
    }

    /// By how much the legs err more than they claim, as it was estimated last: the factor of their
    /// sigmas, one at first.
    pub fn leg_noise(&self) -> T {
        self.common.leg_factor
    }

    /// Computes the protection levels of all cameras, which [`protection`](JointEstimator::protection)
    /// then tells. A pass for each stop.
    ///
    /// # Errors
    /// As [`check`](JointEstimator::check).
    pub fn protect(&mut self) -> Result<(), JointError> {
        let (_, solved) = self.finish_solved(Round {
            protection: true,
            ..Round::default()
        })?;
        solved.map(|_| ())
    }

    /// A round that does not solve first, of what is solved.
    fn finish_solved(&mut self, round: Round) -> Result<Finished<T>, JointError> {
        self.solved().map_err(JointError::Solve)?;
        let (work, mut problem) = self.work();
        work.begin_solved(&mut problem, round);
        Ok(self.finish())
    }

    /// All steps of a round: the last finding, and how it ended.
    fn finish(&mut self) -> Finished<T> {
        let mut last = None;
        loop {
            match self.step() {
                Ok(Progress::Working) => {}
                Ok(Progress::Found(found)) => last = Some(found),
                Ok(Progress::Over(solution)) => return (last, Ok(solution)),
                Err(why) => return (last, Err(why)),
            }
        }
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

    /// What a camera's lens is: the scale of its bearings' tangents.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera without a pose, and where lenses are not estimated
    /// ([`JointSettings::lens`]); [`Refusal::Undetermined`].
    pub fn lens(&mut self, camera: usize) -> Result<Lens<T>, Refusal> {
        self.solved()?.lens(camera)
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

    /// What is left of bearing or range `n`, in the order in which they were added. A pass for each
    /// other stop.
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

    /// Stops so far.
    pub fn stops(&self) -> usize {
        self.stops.len
    }

    /// Bearings and ranges so far.
    pub fn bearings(&self) -> usize {
        self.sights.len
    }

    /// What is solved, for answers.
    fn solved(&mut self) -> Result<Problem<'_, T>, Refusal> {
        if self.work.is_under_way() {
            return Err(Refusal::DidNotConverge);
        }
        if !self.common.is_started || self.common.held.is_none() {
            return Err(Refusal::TooFew);
        }
        Ok(self.work().1)
    }

    /// Counts what came since the last round began.
    fn count(&mut self) {
        let [stops, _, visits] = self.counted;
        self.counted = [self.stops.len, self.sights.len, self.visited];
        let mut problem = self.work().1;
        problem.sort_moved();
        if problem.common.is_started {
            for stop in stops..problem.stops.len() {
                problem.reckon_on(stop);
                problem.find_unmeasured(stop);
            }
            for visit in problem.visits.iter().skip(visits) {
                problem.find_mark(usize::from(visit.mark));
            }
        }
    }

    fn work(&mut self) -> (&mut Work<T>, Problem<'_, T>) {
        let [stops, sights, visited] = self.counted;
        let visits = self.visits.as_flattened();
        let problem = Problem {
            common: &mut self.common,
            stops: self.stops.values.get_mut(..stops).unwrap_or_default(),
            sights: self.sights.values.get_mut(..sights).unwrap_or_default(),
            visits: visits.get(..visited).unwrap_or_default(),
            cameras: &mut self.cameras,
            marks: &mut self.marks,
            workspace: &mut self.workspace,
        };
        (&mut self.work, problem)
    }
}

/// The last finding of a round, and how it ended.
type Finished<T> = (Option<Finding<T>>, Result<JointSolution<T>, JointError>);

fn is_sigma<T: Real>(number: &T) -> bool {
    number.is_finite() && *number > T::zero()
}

fn index(number: usize) -> Result<u16, JointError> {
    u16::try_from(number).map_err(|_| JointError::Unknown)
}
