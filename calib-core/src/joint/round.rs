//! A round of work in slices: solve, survey all measurements, leave out contradictions, solve again.
//!
//! One slice is at most one pass over the measurements, so that a slow processor can do something else in
//! between.

use super::{
    Finding, JointError, JointSolution,
    descent::Settling,
    integrity::Survey,
    problem::{Problem, Told},
    start::Starting,
};
use crate::{
    Limits, Real, Refusal,
    level::{MOUNTING_ROUNDS, PITCHES},
    numerics::real::lit,
};

/// Most estimates of the legs' noise in a round.
const LEG_NOISE_ROUNDS: u8 = 4;
/// Factors of the told noise of the legs with which a start is tried. The first that gives a start is taken; the noise
/// is estimated afterwards.
const LOOSE: [f64; 5] = [1.0, 2.0, 8.0, 32.0, 128.0];
/// Number of these factors that are also tried with a few stops at a time, since a single leg may be wrong.
const TRIED_IN_PARTS: usize = 2;

/// Tasks of a round once it has solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Round {
    /// Most contradictions that are left out. With zero there is no search.
    pub findings: usize,
    /// Estimates the noise of the legs.
    pub leg_noise: bool,
    /// Computes protection levels.
    pub protection: bool,
}

/// Progress of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress<T> {
    /// There is more to do.
    Working,
    /// This contradicted the rest, and is left out. There is more to do.
    Found(Finding<T>),
    /// All is done. Poses and covariances can be read.
    Over(JointSolution<T>),
}

/// The work under way.
#[derive(Clone, Debug)]
pub(super) struct Work<T: Real> {
    stage: Stage<T>,
    /// Tasks still to be done.
    round: Round,
    leg_noise_rounds: u8,
    mounting_rounds: u8,
    /// The one of [`PITCHES`] from which the references began.
    steep: usize,
    /// The one of [`LOOSE`] with which they began.
    loose: usize,
    /// Reason why legs that err as they claim give no start.
    why: Option<Refusal>,
    /// The finding that was left out before the solve that is under way.
    found: Option<Finding<T>>,
    /// Result of the last solve.
    solved: Result<JointSolution<T>, Refusal>,
}

#[derive(Clone, Debug)]
enum Stage<T: Real> {
    Idle,
    Starting(Starting<T>),
    Settling(Settling<T>),
    Settled,
    Surveying(Survey<T>),
    /// Covariances are computed. They belong to this solution.
    Telling(JointSolution<T>),
}

impl<T: Real> Work<T> {
    pub(super) fn new() -> Self {
        Self {
            stage: Stage::Idle,
            round: Round::default(),
            leg_noise_rounds: 0,
            mounting_rounds: 0,
            steep: 0,
            loose: 0,
            why: None,
            found: None,
            solved: Err(Refusal::TooFew),
        }
    }

    pub(super) fn is_under_way(&self) -> bool {
        !matches!(self.stage, Stage::Idle)
    }

    /// Begins a round with a solve, and with a start if there has been none.
    pub(super) fn begin(&mut self, problem: &mut Problem<'_, T>, round: Round) {
        self.ask(round);
        problem.common.suspect = None;
        // A pass that was given up is not resumed.
        problem.common.told = Told::Equations;
        problem.common.left_out = None;
        self.stage = if problem.common.is_started {
            Stage::Settling(problem.begin_settling())
        } else {
            self.start(problem, 0)
        };
    }

    /// Begins a start with this one of [`LOOSE`].
    fn start(&mut self, problem: &mut Problem<'_, T>, loose: usize) -> Stage<T> {
        self.loose = loose;
        if loose == 0 {
            self.why = None;
        }
        problem.common.leg_factor = lit(LOOSE.get(loose).copied().unwrap_or(1.0));
        Stage::Starting(problem.begin_starting(loose < TRIED_IN_PARTS))
    }

    /// Begins a round without a solve.
    pub(super) fn begin_solved(&mut self, problem: &mut Problem<'_, T>, round: Round) {
        self.ask(round);
        self.stage = Stage::Surveying(problem.begin_survey(round.protection));
    }

    fn ask(&mut self, round: Round) {
        self.round = round;
        self.found = None;
        self.leg_noise_rounds = if round.leg_noise { LEG_NOISE_ROUNDS } else { 0 };
        self.mounting_rounds = MOUNTING_ROUNDS;
        self.steep = 0;
    }

    /// Begins anew with references that look down. Returns false if all pitches were tried, or no rows were told.
    fn begin_steeper(&mut self, problem: &mut Problem<'_, T>) -> bool {
        let Some(&pitch) = PITCHES.get(self.steep + 1) else {
            return false;
        };
        self.steep += 1;
        if !problem.pitch_references(lit(pitch)) {
            return false;
        }
        self.mounting_rounds = MOUNTING_ROUNDS;
        // If no start is found, the next round begins with one.
        problem.common.is_started = false;
        self.stage = self.start(problem, 0);
        true
    }

    /// Does one slice.
    pub(super) fn step(
        &mut self,
        problem: &mut Problem<'_, T>,
        limits: &Limits<T>,
    ) -> Result<Progress<T>, JointError> {
        let stepped = match &mut self.stage {
            Stage::Idle => return self.solved.map(Progress::Over).map_err(JointError::Solve),
            Stage::Starting(starting) => match problem.step_start(starting) {
                None => Ok(Progress::Working),
                Some(Ok(())) => {
                    problem.common.is_started = true;
                    self.stage = Stage::Settling(problem.begin_settling());
                    Ok(Progress::Working)
                }
                Some(Err(why)) => {
                    let contradicts = [
                        Refusal::Inconsistent,
                        Refusal::DidNotConverge,
                        Refusal::TargetBehind,
                    ];
                    let why = *self.why.get_or_insert(why);
                    let contradicts = contradicts.contains(&why);
                    // If the told noise is far too small, only wrong answers may be left, which all fit alike.
                    let may_be_loose = contradicts || why == Refusal::Undetermined;
                    let loose = self.loose + 1;
                    if may_be_loose && loose < LOOSE.len() {
                        self.stage = self.start(problem, loose);
                        return Ok(Progress::Working);
                    }
                    if contradicts && self.begin_steeper(problem) {
                        return Ok(Progress::Working);
                    }
                    problem.common.leg_factor = T::one();
                    problem.pitch_references(T::zero());
                    Err(JointError::Start(why))
                }
            },
            Stage::Settling(settling) => match problem.step_settling(settling, limits) {
                None => Ok(Progress::Working),
                Some(solved) => {
                    self.solved = solved;
                    match self.found.take() {
                        // The finding is told once it is known which measurements agree without it.
                        Some(found) => {
                            self.stage = Stage::Settled;
                            Ok(Progress::Found(problem.refined(found)))
                        }
                        None => self.after_solve(problem),
                    }
                }
            },
            Stage::Settled => self.after_solve(problem),
            Stage::Surveying(survey) => {
                let looks = self.round.findings > 0;
                let surveyed = problem.step_survey(survey, looks);
                let survey = *survey;
                match surveyed {
                    None => Ok(Progress::Working),
                    Some(Ok(())) => self.after_survey(problem, &survey),
                    Some(Err(why)) => Err(JointError::Solve(why)),
                }
            }
            Stage::Telling(solution) => {
                let solution = *solution;
                self.over(problem, solution)
            }
        };
        if matches!(stepped, Err(_) | Ok(Progress::Over(_))) {
            self.stage = Stage::Idle;
        }
        stepped
    }

    fn after_solve(&mut self, problem: &mut Problem<'_, T>) -> Result<Progress<T>, JointError> {
        // Bearings of a tilted camera contradict each other until they are turned upright.
        let is_there = matches!(self.solved, Ok(_) | Err(Refusal::DidNotConverge));
        if is_there && self.mounting_rounds > 0 && problem.improve_mountings() {
            self.mounting_rounds -= 1;
            self.stage = Stage::Settling(problem.begin_settling());
            return Ok(Progress::Working);
        }
        match self.solved {
            // It may not converge because of contradictions.
            Err(Refusal::DidNotConverge) if self.round.findings > 0 => {}
            Err(why) => return Err(JointError::Solve(why)),
            Ok(solution) => {
                let Round {
                    findings,
                    protection,
                    ..
                } = self.round;
                if findings == 0 && !protection && self.leg_noise_rounds == 0 {
                    return self.over(problem, solution);
                }
            }
        }
        self.stage = Stage::Surveying(problem.begin_survey(self.round.protection));
        Ok(Progress::Working)
    }

    fn after_survey(
        &mut self,
        problem: &mut Problem<'_, T>,
        survey: &Survey<T>,
    ) -> Result<Progress<T>, JointError> {
        if self.round.findings > 0 && self.leg_noise_rounds > 1 && problem.loosen_legs(survey) {
            self.leg_noise_rounds -= 1;
            self.stage = Stage::Settling(problem.begin_settling());
            return Ok(Progress::Working);
        }
        if self.round.findings > 0 && problem.widen_priors(survey) {
            self.stage = Stage::Settling(problem.begin_settling());
            return Ok(Progress::Working);
        }
        if problem.common.suspect.is_some() {
            self.found = problem.decide(survey);
            if self.found.is_some() {
                self.round.findings = self.round.findings.saturating_sub(1);
            }
            self.stage = Stage::Settling(problem.begin_settling());
            return Ok(Progress::Working);
        }
        if let Some(found) = survey.found()
            && let Some(left) = self.round.findings.checked_sub(1)
        {
            self.found = problem.leave_out(found);
            if self.found.is_some() {
                self.round.findings = left;
            }
            self.stage = Stage::Settling(problem.begin_settling());
            return Ok(Progress::Working);
        }
        self.round.findings = 0;
        if self.leg_noise_rounds > 0 {
            self.leg_noise_rounds -= 1;
            if problem.fit_leg_noise(survey) {
                self.stage = Stage::Settling(problem.begin_settling());
                return Ok(Progress::Working);
            }
            self.leg_noise_rounds = 0;
        }
        let solution = self.solved.map_err(JointError::Solve)?;
        self.over(problem, solution)
    }

    /// Ends the round, once the covariances are computed.
    fn over(
        &mut self,
        problem: &mut Problem<'_, T>,
        solution: JointSolution<T>,
    ) -> Result<Progress<T>, JointError> {
        if !problem.has_told() {
            self.stage = Stage::Telling(solution);
            return Ok(Progress::Working);
        }
        problem.tell().map_err(JointError::Solve)?;
        if problem.is_frame_refused(solution.fit.inflation()) && self.begin_steeper(problem) {
            return Ok(Progress::Working);
        }
        Ok(Progress::Over(solution))
    }
}
