//! Estimator with fixed room: it takes measurements and gives answers.

use nalgebra::{Point2, Vector2};

use super::{
    BearingResidual, Carrier, Finding, JointError, JointSettings, JointSolution, Leg, LegResidual,
    Lens, Move, Progress, ProtectionLevels, ReferenceHeadings, Round, Solver, StopPlace,
    Undetermined,
    equations::Layout,
    integrity::IN_A_ROW,
    problem::{
        Common, NONE, Optics, Problem, Quantity, REFERENCES, Sight, Standing, Stop, Told, Unknown,
        Visit, root_information,
    },
    round::Work,
};
use crate::{
    Limits, Pose, Real, Refusal,
    level::{Elevation, Levelness},
    numerics::real::lit,
};

/// Memory for the measurements and estimates of an estimator. The caller owns it, so it can be static and as large as
/// needed. Its former contents do not matter.
#[derive(Debug)]
pub struct JointMemory<'m, T: Real> {
    /// One for each camera, of which the first two are the references.
    pub cameras: &'m mut [Unknown<T>],
    /// One for each stop.
    pub stops: &'m mut [Stop<T>],
    /// One for each bearing.
    pub bearings: &'m mut [Sight<T>],
    /// One for each mark.
    pub marks: &'m mut [Unknown<T>],
    /// One for each visit to a mark.
    pub visits: &'m mut [Visit<T>],
    /// As many numbers as [`Capacity::workspace`](super::Capacity::workspace) says, or more.
    pub workspace: &'m mut [T],
}

/// Joint estimator of as many cameras, stops, bearings and marks as its memory holds.
///
/// Measurements come stop by stop. [`solve`](JointEstimator::solve) computes, and begins with the estimates of the last
/// solve.
#[derive(Debug)]
pub struct JointEstimator<'m, T: Real> {
    pub(super) common: Common<T>,
    limits: Limits<T>,
    pub(super) work: Work<T>,
    /// Numbers of stops, of bearings and of visits that count. Later ones count from the next round on.
    pub(super) counted: [usize; 3],
    pub(super) stops: List<'m, Stop<T>>,
    pub(super) sights: List<'m, Sight<T>>,
    pub(super) visits: List<'m, Visit<T>>,
    pub(super) cameras: &'m mut [Unknown<T>],
    marks: &'m mut [Unknown<T>],
    workspace: &'m mut [T],
    solver: Option<&'m mut dyn Solver<T>>,
}

/// List of fixed capacity.
#[derive(Debug)]
pub(super) struct List<'m, V> {
    values: &'m mut [V],
    pub(super) len: usize,
}

impl<'m, V> List<'m, V> {
    const fn new(values: &'m mut [V]) -> Self {
        Self { values, len: 0 }
    }

    fn push(&mut self, value: V) -> Result<usize, JointError> {
        let index = self.len;
        *self.values.get_mut(index).ok_or(JointError::Full)? = value;
        self.len += 1;
        Ok(index)
    }

    pub(super) fn all(&self) -> &[V] {
        self.values.get(..self.len).unwrap_or_default()
    }

    pub(super) fn all_mut(&mut self) -> &mut [V] {
        self.values.get_mut(..self.len).unwrap_or_default()
    }
}

impl<V: Copy> List<'_, V> {
    /// Removes the value at this index. The last value takes its place.
    pub(super) fn swap_remove(&mut self, index: usize) {
        let last = self.all().last().copied();
        if let (Some(last), Some(place)) = (last, self.all_mut().get_mut(index)) {
            *place = last;
            self.len -= 1;
        }
    }

    /// Removes the value at this index. Later values move up.
    pub(super) fn remove(&mut self, index: usize) {
        let behind = self.all_mut().get_mut(index..).unwrap_or_default();
        let mut moved = None;
        for place in behind.iter_mut().rev() {
            moved = Some(moved.map_or(*place, |later| core::mem::replace(place, later)));
        }
        if moved.is_some() {
            self.len -= 1;
        }
    }
}

/// One bearing or leg in so many may be left out, plus one.
const LEFT_OUT: usize = 5;

impl<'m, T: Real> JointEstimator<'m, T> {
    /// Returns an estimator without any stop. `baseline` is the distance between both references.
    ///
    /// # Errors
    /// [`JointError::NotFinite`] for a baseline, a scale or a sigma that is not above zero;
    /// [`JointError::Memory`], also if lenses are to be estimated and the workspace is less than
    /// [`Capacity::workspace_with_lenses`](super::Capacity::workspace_with_lenses).
    pub fn new(
        memory: JointMemory<'m, T>,
        baseline: T,
        settings: JointSettings<T>,
    ) -> Result<Self, JointError> {
        Self::new_with(memory, baseline, settings, false)
    }

    fn new_with(
        memory: JointMemory<'m, T>,
        baseline: T,
        settings: JointSettings<T>,
        has_solver: bool,
    ) -> Result<Self, JointError> {
        check(baseline, &settings)?;
        let JointSettings {
            scale,
            compass,
            standing,
            tilt,
            lens,
            principal,
            are_ranges_seen,
            is_baseline_known,
            limits,
        } = settings;
        let optics = Optics::new(lens, principal, are_ranges_seen);
        let JointMemory {
            cameras,
            stops,
            bearings,
            marks,
            visits,
            workspace,
        } = memory;
        let most = usize::from(u16::MAX);
        let (stop_count, sight_count) = (stops.len(), bearings.len());
        let block = optics.block();
        let layout = Layout::new(cameras.len(), stop_count, sight_count, marks.len(), block);
        let least = if has_solver {
            layout.without_kept().workspace()
        } else {
            layout.workspace()
        };
        let is_enough = workspace.len() >= least;
        if !is_enough || cameras.len() < REFERENCES || stops.len() > most || cameras.len() > most {
            return Err(JointError::Memory);
        }
        for unknown in cameras.iter_mut().chain(marks.iter_mut()) {
            *unknown = Unknown::default();
        }
        Ok(Self {
            common: Common {
                baseline,
                is_baseline_known,
                scale_prior: scale,
                compass_prior: compass,
                standing: stands(standing, baseline),
                tilt,
                optics,
                carrier: Vector2::new(scale.mean, compass.mean),
                carrier_step: Vector2::zeros(),
                leg_factor: T::one(),
                told: Told::Nothing,
                cost: [T::zero(); 2],
                undetermined: None,
                is_carrier_undetermined: false,
                is_started: false,
                window: [0, u16::MAX],
                is_whole: has_solver,
                left_out: None,
                suspect: None,
            },
            limits,
            work: Work::new(),
            counted: [0; 3],
            stops: List::new(stops),
            sights: List::new(bearings),
            visits: List::new(visits),
            cameras,
            marks,
            workspace,
            solver: None,
        })
    }

    /// Returns an estimator as [`new`](Self::new) does, for walks so long that a solver computes all unknowns together.
    /// Its workspace needs the size of [`Capacity::workspace_beside_solver`](super::Capacity).
    ///
    /// # Errors
    /// As [`new`](Self::new).
    #[cfg(feature = "solver")]
    pub fn with_solver(
        memory: JointMemory<'m, T>,
        solver: &'m mut dyn Solver<T>,
        baseline: T,
        settings: JointSettings<T>,
    ) -> Result<Self, JointError> {
        let mut joint = Self::new_with(memory, baseline, settings, true)?;
        joint.solver = Some(solver);
        Ok(joint)
    }

    /// Makes cameras `first` and `second` the references, numbers 0 and 1. The cameras that had these numbers get
    /// theirs. `baseline` is the distance between the new references. Everything is estimated anew.
    ///
    /// So bearings can be added before the references are known.
    ///
    /// # Errors
    /// [`JointError::Unknown`] where these are not two cameras, and as
    /// [`new`](JointEstimator::new): lenses are estimated from now on, or no longer, as the settings say.
    pub fn appoint(
        &mut self,
        [first, second]: [usize; 2],
        baseline: T,
        settings: JointSettings<T>,
    ) -> Result<(), JointError> {
        if first == second || first.max(second) >= self.cameras.len() {
            return Err(JointError::Unknown);
        }
        check(baseline, &settings)?;
        let optics = Optics::new(settings.lens, settings.principal, settings.are_ranges_seen);
        let [stops, sights] = [self.stops.values.len(), self.sights.values.len()];
        let marks = self.marks.len();
        let layout = Layout::new(self.cameras.len(), stops, sights, marks, optics.block());
        if !self.common.is_whole() && self.workspace.len() < layout.workspace() {
            return Err(JointError::Memory);
        }
        // Moves of cameras are searched anew.
        self.counted = [self.stops.len, self.sights.len, self.visits.len];
        self.work().1.undo_moves(None);
        // Index of the second reference after the first exchange.
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
        self.work = Work::new();
        self.counted = [0; 3];
        let common = &mut self.common;
        common.baseline = baseline;
        common.is_baseline_known = settings.is_baseline_known;
        common.scale_prior = settings.scale;
        common.compass_prior = settings.compass;
        common.standing = stands(settings.standing, baseline);
        common.tilt = settings.tilt;
        common.optics = optics;
        common.carrier = Vector2::new(settings.scale.mean, settings.compass.mean);
        common.leg_factor = T::one();
        common.told = Told::Nothing;
        common.suspect = None;
        common.is_started = false;
        for camera in &mut *self.cameras {
            *camera = Unknown::default();
        }
        Ok(())
    }

    /// Forgets all measurements and results. References, priors and limits stay.
    pub fn clear(&mut self) {
        self.work = Work::new();
        self.counted = [0; 3];
        self.stops.len = 0;
        self.sights.len = 0;
        self.visits.len = 0;
        self.common.is_started = false;
        self.common.told = Told::Nothing;
        self.common.suspect = None;
        self.common.leg_factor = T::one();
        for unknown in self.cameras.iter_mut().chain(self.marks.iter_mut()) {
            *unknown = Unknown::default();
        }
    }

    /// Adds the next stop of the walk and returns its number, counted from zero. `leg` is the way from the stop before;
    /// `None` at the first stop, or if the way was not measured.
    ///
    /// # Errors
    /// [`JointError::Full`]; [`JointError::NotFinite`].
    pub fn add_stop(&mut self, leg: Option<Leg<T>>) -> Result<usize, JointError> {
        self.push_stop(leg.filter(|_| self.stops.len > 0))
    }

    pub(super) fn push_stop(&mut self, leg: Option<Leg<T>>) -> Result<usize, JointError> {
        let (mut displacement, mut root) = (Vector2::zeros(), [T::zero(); 3]);
        if let Some(leg) = leg {
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
            ..Stop::default()
        })
    }

    /// Adds a bearing: camera `camera` saw the target at a stop. `bearing` is the angle from its optical axis in
    /// radians, positive to the left; `sigma` is the standard deviation.
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

    /// Adds a range: the distance from camera `camera` to the target at a stop, for example from the size of the target
    /// in the picture, and its standard deviation. A range takes the room of a bearing. Three bearings give a camera a
    /// pose; ranges do not. Once a camera has a pose, a bearing and a range together give a place. The range is
    /// measured from the eye to the target. The row of the bearing at that stop
    /// ([`add_elevation`](Self::add_elevation)) turns it into the distance along the floor.
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

    /// Adds the elevation of the target above the horizontal plane of the camera to the last bearing. It has the
    /// standard deviation of that bearing.
    ///
    /// # Errors
    /// [`JointError::Unknown`] where the last measurement is no bearing.
    pub fn add_elevation(&mut self, elevation: Elevation) -> Result<(), JointError> {
        let last = self.sights.all_mut().last_mut();
        let last = last.filter(|sight| sight.is_bearing());
        last.ok_or(JointError::Unknown)?.elevation = elevation;
        Ok(())
    }

    fn add_sight(
        &mut self,
        stop: usize,
        camera: usize,
        quantity: Quantity,
        value: T,
        sigma: T,
    ) -> Result<(), JointError> {
        if stop >= self.stops.len || camera >= self.cameras.len() {
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
            elevation: Elevation::UNKNOWN,
            next: NONE,
        })?;
        Ok(())
    }

    /// Adds a visit: the target stood on mark `mark` at a stop, with `sigma` in every direction. A mark is a place that
    /// can be found again, though its position is unknown. Two visits to a mark close a loop.
    ///
    /// # Errors
    /// [`JointError::Unknown`], [`JointError::Full`], [`JointError::NotFinite`].
    pub fn add_visit(&mut self, stop: usize, mark: usize, sigma: T) -> Result<(), JointError> {
        if stop >= self.stops.len || mark >= self.marks.len() {
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
        self.visits.push(new)?;
        Ok(())
    }

    /// Splits a moved camera: from the next round on its sightings at stop `from` and later belong to camera `into`,
    /// which has no sightings yet. This holds for later sightings too. Camera `into` is estimated like any other, and
    /// `camera` keeps its former pose. A new pose takes four bearings that agree, of which three are different: a stuck
    /// camera repeats itself.
    ///
    /// # Errors
    /// [`JointError::Unknown`] for a camera there is not; [`JointError::Taken`] if something was seen
    /// by `into`, it is a reference, or has become of another.
    pub fn split(&mut self, camera: usize, from: usize, into: usize) -> Result<(), JointError> {
        if camera.max(into) >= self.cameras.len() {
            return Err(JointError::Unknown);
        }
        let mut sights = self.sights.all().iter();
        let is_seen = sights.any(|sight| usize::from(sight.camera) == into);
        if is_seen || into < REFERENCES || into == camera || self.work().1.is_successor(into) {
            return Err(JointError::Taken);
        }
        let (from, into) = (index(from)?, index(into)?);
        let unknown = self.cameras.get_mut(camera).ok_or(JointError::Unknown)?;
        unknown.moved = Some(from);
        unknown.successor = Some(into);
        Ok(())
    }

    /// Begins a round: estimates everything from all measurements so far, beginning with the estimates of the last
    /// round. Then, if asked, it leaves out contradictions one by one, estimates the noise of the legs and computes
    /// protection levels. [`step`](JointEstimator::step) does the work. A round under way is given up.
    ///
    /// Measurements that come during a round count from the next one on.
    pub fn begin(&mut self, round: Round) {
        self.count();
        let (work, mut problem) = self.work();
        work.begin(&mut problem, round);
    }

    /// Does one slice of the round: a pass over the measurements, a reference solve or a resection of a camera. Call it
    /// until it returns [`Over`](Progress::Over) or an error. Then answers can be read. Further calls return the same
    /// solution.
    ///
    /// # Errors
    /// [`JointError::Start`] until the references' sightings give a frame; [`JointError::Solve`], with
    /// [`Refusal::TooFew`] before the first round.
    pub fn step(&mut self) -> Result<Progress<T>, JointError> {
        let limits = self.limits;
        let (work, mut problem) = self.work();
        work.step(&mut problem, &limits)
    }

    /// Returns true while a round is under way. Until its end all answers are [`Refusal::DidNotConverge`].
    pub fn is_under_way(&self) -> bool {
        self.work.is_under_way()
    }

    /// Does a whole round that solves and nothing else.
    ///
    /// # Errors
    /// As [`step`](JointEstimator::step).
    pub fn solve(&mut self) -> Result<JointSolution<T>, JointError> {
        self.begin(Round::default());
        self.finish().1
    }

    /// Finds the measurement that contradicts the others most: a bearing, a leg, or all sightings of a camera since
    /// some stop. If chance explains it only once in 100,000, the measurement is left out and everything is solved
    /// again. Returns `None` if nothing contradicts. Call it a few times, until it does. A solve may have failed
    /// because of contradictions; another solve then shows if they were all.
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

    /// Estimates the ratio of the legs' errors to their told sigmas, solves again with it and returns it. The told
    /// sigmas are believed until residuals contradict them by two sigmas; then they weigh as much as six residuals. The
    /// factor stays.
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

    /// Ratio of the legs' errors to their told sigmas, as estimated last; one at first.
    pub fn leg_noise(&self) -> T {
        self.common.leg_factor
    }

    /// Computes the protection levels of all cameras for [`protection`](JointEstimator::protection). It takes no pass:
    /// the covariances of the last solve suffice.
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

    /// Begins a round with the present solution, without a solve.
    fn finish_solved(&mut self, round: Round) -> Result<Finished<T>, JointError> {
        self.solved().map_err(JointError::Solve)?;
        let (work, mut problem) = self.work();
        work.begin_solved(&mut problem, round);
        Ok(self.finish())
    }

    /// Does all steps of a round. Returns the last finding and the result.
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

    /// Largest error of a camera's pose from one wrong measurement that no test notices, as computed by
    /// [`protect`](JointEstimator::protect). `None` for a reference, or a camera without a pose.
    pub fn protection(&self, camera: usize) -> Option<ProtectionLevels<T>> {
        let camera = self.cameras.get(camera).filter(|camera| camera.takes_part);
        camera.map(|camera| camera.protection)
    }

    /// Pose of a camera, from all measurements.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera that does not take part (yet); [`Refusal::Undetermined`].
    pub fn pose(&mut self, camera: usize) -> Result<Pose<T>, Refusal> {
        self.solved()?.told_pose(camera)
    }

    /// Mounting of a camera as its rows tell: level, or with pitch and roll. Sigmas are multiplied by the root of
    /// `inflation`. `None` without a pose, without rows, or without a [tolerance](JointSettings::tilt).
    pub fn levelness(&mut self, camera: usize, inflation: T) -> Option<Levelness<T>> {
        self.solved().ok()?.levelness(camera, inflation)
    }

    /// Lens of a camera: the scale of its bearings' tangents.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera without a pose, and where lenses are not estimated
    /// ([`JointSettings::lens`]); [`Refusal::Undetermined`].
    pub fn lens(&mut self, camera: usize) -> Result<Lens<T>, Refusal> {
        self.solved()?.lens(camera)
    }

    /// Place of a stop, from all measurements.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve or for a stop there is not;
    /// [`Refusal::Undetermined`].
    pub fn place(&mut self, stop: usize) -> Result<StopPlace<T>, Refusal> {
        self.solved()?.place(stop)
    }

    /// Position of a stop as last estimated. `None` if there is no such stop, or if it comes after a leg that was not
    /// measured and nothing else tells where it is.
    pub fn position(&self, stop: usize) -> Option<Point2<T>> {
        let stop = self.stops.all().get(stop)?;
        stop.is_placed.then_some(stop.place)
    }

    /// Position of a camera that hangs upside down and has the same bearings, if these fit it as well as the estimated
    /// [pose](Self::pose). So it is if all stops lie nearly on a line. It takes four bearings. `None` if the bearings
    /// show that the camera is upright, or if it is not level: then its rows tell.
    pub fn mirrored(&mut self, camera: usize) -> Option<Point2<T>> {
        self.solved().ok()?.mirrored(camera)
    }

    /// Systematic errors of the carrier. If the baseline is not known, the scale is that of the prior.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve; [`Refusal::Undetermined`].
    pub fn carrier(&mut self) -> Result<Carrier<T>, Refusal> {
        self.solved()?.carrier()
    }

    /// Headings of the references.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve; [`Refusal::Undetermined`].
    pub fn reference_headings(&mut self) -> Result<ReferenceHeadings<T>, Refusal> {
        self.solved()?.reference_headings()
    }

    /// Residual of bearing or range `n`, in the order in which they were added.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve, for a camera without a pose or a bearing there is
    /// not; [`Refusal::Undetermined`].
    pub fn bearing_residual(&mut self, n: usize) -> Result<BearingResidual<T>, Refusal> {
        self.solved()?.bearing_residual(n)
    }

    /// Residual of the leg to a stop.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] before the first solve and where no leg was measured;
    /// [`Refusal::Undetermined`].
    pub fn leg_residual(&mut self, stop: usize) -> Result<LegResidual<T>, Refusal> {
        self.solved()?.leg_residual(stop)
    }

    /// The first unknown that measurements do not determine, if there is one. All that depends on it is
    /// [`Refusal::Undetermined`].
    pub fn undetermined(&self) -> Option<Undetermined> {
        self.common.undetermined
    }

    /// Returns true if there is a bearing of this camera at this stop.
    pub fn has_bearing(&self, stop: usize, camera: usize) -> bool {
        let is_it = |sight: &Sight<T>| {
            usize::from(sight.stop) == stop
                && usize::from(sight.camera) == camera
                && sight.is_bearing()
        };
        self.sights.all().iter().any(is_it)
    }

    /// Number of bearings of a camera, and number of those that count.
    pub fn bearings_of(&self, camera: usize) -> [usize; 2] {
        let of = { self.sights.all().iter() }.filter(|sight| usize::from(sight.camera) == camera);
        let counting = of
            .clone()
            .filter(|sight| sight.standing == Standing::Counts);
        [of.count(), counting.count()]
    }

    /// Number of bearings and ranges that are left out, and number of legs.
    #[inline(never)] // for less flash
    pub fn left_out(&self) -> [usize; 2] {
        let bearings =
            { self.sights.all().iter() }.filter(|sight| sight.standing == Standing::Excluded);
        let legs = { self.stops.all().iter() }.filter(|stop| stop.standing == Standing::Excluded);
        [bearings.count(), legs.count()]
    }

    /// Returns true if so much was left out that the rest proves little: more than a fifth of all bearings or of all
    /// legs, so that what is left agrees by being few; or several of the last bearings of this camera in a row, so that
    /// it may have been moved without being found [moved](JointEstimator::moved).
    #[inline(never)] // for less flash
    pub fn is_selective(&self, camera: usize) -> bool {
        let mut latest = 0;
        for sight in self.sights.all() {
            // A stop with both bearing and range left out counts once.
            if usize::from(sight.camera) == camera && sight.is_bearing() {
                latest = if sight.standing == Standing::Counts {
                    0
                } else {
                    latest + 1
                };
            }
        }
        let [left_out, slipped] = self.left_out();
        let is_much = |left_out, all| LEFT_OUT * left_out >= all + LEFT_OUT;
        latest >= IN_A_ROW
            || is_much(left_out, self.sights.all().len())
            || is_much(slipped, self.stops.all().len())
    }

    /// Move of a camera, if one was found. If a leg is found later that explains it, there is none.
    pub fn moved(&self, camera: usize) -> Option<Move> {
        let unknown = self.cameras.get(camera)?;
        Some(Move {
            since: unknown.moved?.into(),
            successor: unknown.successor.map(usize::from),
        })
    }

    /// Number of stops at which both cameras saw the target. Three give a frame between them.
    pub fn common_stops(&self, one: usize, other: usize) -> usize {
        let of = |camera: usize| {
            let sights = self.sights.all().iter();
            sights.filter(move |sight| usize::from(sight.camera) == camera && sight.is_bearing())
        };
        of(one)
            .filter(|sight| of(other).any(|second| second.stop == sight.stop))
            .count()
    }

    /// Returns true if two faults cannot be told apart: either the camera was moved for a while, or the way to where it
    /// saw the target was wrong. So it is if legs are left out and no other camera saw the target at the stops between
    /// them.
    pub fn is_ambiguous(&self, camera: usize) -> bool {
        let is_cut = |stop: &Stop<T>| stop.standing != Standing::Counts;
        if !self.stops.all().iter().any(is_cut) {
            return false;
        }
        let (mut own, mut others) = (0, 0);
        for (n, stop) in self.stops.all().iter().enumerate() {
            if is_cut(stop) {
                if own >= IN_A_ROW && others == 0 {
                    return true;
                }
                (own, others) = (0, 0);
            }
            for sight in self.sights.all() {
                if usize::from(sight.stop) == n && sight.standing == Standing::Counts {
                    let is_own = usize::from(sight.camera) == camera;
                    let of = self.cameras.get(usize::from(sight.camera));
                    let is_estimated = of.is_some_and(|of| of.takes_part);
                    own += usize::from(is_own);
                    let is_reference = usize::from(sight.camera) < REFERENCES;
                    others += usize::from(!is_own && (is_estimated || is_reference));
                }
            }
        }
        own >= IN_A_ROW && others == 0
    }

    /// Returns true if the sightings of the references gave a frame.
    pub const fn is_started(&self) -> bool {
        self.common.is_started
    }

    /// Number of stops.
    pub fn stops(&self) -> usize {
        self.stops.len
    }

    /// Number of bearings and ranges.
    pub fn bearings(&self) -> usize {
        self.sights.len
    }

    /// Returns the solved problem, to read answers from.
    fn solved(&mut self) -> Result<Problem<'_, T>, Refusal> {
        if self.work.is_under_way() {
            return Err(Refusal::DidNotConverge);
        }
        if !self.common.is_started || self.common.told == Told::Nothing {
            return Err(Refusal::TooFew);
        }
        Ok(self.work().1)
    }

    /// Lets the measurements count that came since the last round began.
    fn count(&mut self) {
        let [stops, _, visits] = self.counted;
        self.counted = [self.stops.len, self.sights.len, self.visits.len];
        let mut problem = self.work().1;
        problem.sort_moved();
        problem.link();
        if problem.common.is_started {
            for stop in stops..problem.stops.len() {
                problem.place_new(stop);
            }
            for visit in problem.visits.iter().skip(visits) {
                problem.find_mark(usize::from(visit.mark));
            }
        }
    }

    fn work(&mut self) -> (&mut Work<T>, Problem<'_, T>) {
        let [stops, sights, visited] = self.counted;
        let problem = Problem {
            common: &mut self.common,
            stops: self.stops.values.get_mut(..stops).unwrap_or_default(),
            sights: self.sights.values.get_mut(..sights).unwrap_or_default(),
            visits: self.visits.values.get(..visited).unwrap_or_default(),
            cameras: self.cameras,
            marks: self.marks,
            workspace: self.workspace,
            solver: self
                .solver
                .as_mut()
                .map(|solver| &mut **solver as &mut dyn Solver<T>),
        };
        (&mut self.work, problem)
    }
}

fn check<T: Real>(baseline: T, settings: &JointSettings<T>) -> Result<(), JointError> {
    let JointSettings { scale, compass, .. } = settings;
    let above_zero = [baseline, scale.mean, scale.sigma, compass.sigma];
    let is_spread = |sigma: T| sigma.is_finite() && sigma >= T::zero();
    let stands = is_spread(settings.standing) && is_spread(settings.tilt);
    let Optics {
        lens, principal, ..
    } = Optics::new(settings.lens, settings.principal, settings.are_ranges_seen);
    if [lens, principal]
        .iter()
        .flatten()
        .any(|sigma| !is_sigma(sigma))
    {
        return Err(JointError::NotFinite);
    }
    if !above_zero.iter().all(is_sigma) || !compass.mean.is_finite() || !stands {
        return Err(JointError::NotFinite);
    }
    Ok(())
}

/// Least standing sigma over the baseline, in units of the machine's epsilon to the power of 3/4.
const LEAST_STANDING: f64 = 4.0;

/// Returns the standing sigma of a target, or its least value if that is larger. Right before a camera, one bearing
/// would tell so much that single precision has no digits left for the others. The least value is a quarter of a
/// millimetre for a baseline of ten metres, and nothing in double precision.
fn stands<T: Real>(standing: T, baseline: T) -> T {
    let root = T::default_epsilon().sqrt();
    standing.max(baseline * root * root.sqrt() * lit(LEAST_STANDING))
}

/// Last finding of a round, and the result of the round.
type Finished<T> = (Option<Finding<T>>, Result<JointSolution<T>, JointError>);

fn is_sigma<T: Real>(number: &T) -> bool {
    number.is_finite() && *number > T::zero()
}

pub(super) fn index(number: usize) -> Result<u16, JointError> {
    u16::try_from(number).map_err(|_| JointError::Unknown)
}
