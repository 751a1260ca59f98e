//! Sightings that do not belong: found by consensus, dropped, and reported.

use super::{Solution, least_squares, three_point};
use crate::{Pose, Real, Refusal, Sighting};

/// Rounds of "fit, then look again which sightings agree". Two are usual.
const ROUND_LIMIT: usize = 10;
/// Three sightings always agree with the pose computed from them; a fourth is a witness.
const SMALLEST_CONSENSUS: usize = 4;

/// The pose on which most sightings agree; marks in `dropped` those that do not.
///
/// Each triple proposes a pose; the proposal with the least sum of squared residuals, each
/// limited to the gate's (MSAC: Torr and Zisserman, CVIU 78(1), 2000), is refined on the
/// sightings within the gate until the same ones stay. All triples are tried, so the result is
/// not a matter of chance.
pub(super) fn solve<T: Real>(
    sightings: &[Sighting<T>],
    gate: T,
    dropped: &mut [bool],
) -> Result<Solution<T>, Refusal> {
    let gate = gate * gate;
    let loss = |pose: &Pose<T>| {
        sightings.iter().fold(T::zero(), |sum, s| {
            sum + least_squares::squared_sigmas(s, pose).min(gate)
        })
    };
    let mut best: Option<(T, Pose<T>)> = None;
    let mut refusal = Refusal::TooFew;
    for triple in least_squares::triples(sightings) {
        match three_point::solve(&triple) {
            Ok(pose) => {
                let loss = loss(&pose);
                if best.as_ref().is_none_or(|(least, _)| loss < *least) {
                    best = Some((loss, pose));
                }
            }
            Err(why) => refusal = why,
        }
    }
    let (_, mut pose) = best.ok_or(refusal)?;
    let mut rejected = mark(sightings, &pose, gate, dropped).0;
    for _ in 0..ROUND_LIMIT {
        let kept = sightings.len() - rejected;
        if kept < SMALLEST_CONSENSUS || 2 * kept <= sightings.len() {
            return Err(Refusal::Inconsistent);
        }
        let solution = least_squares::refine(sightings, dropped, &pose)?;
        pose = solution.pose;
        let changed;
        (rejected, changed) = mark(sightings, &pose, gate, dropped);
        if !changed {
            return Ok(solution);
        }
    }
    Err(Refusal::Inconsistent)
}

/// Marks sightings outside the gate; returns their number, and true if any mark changed.
fn mark<T: Real>(
    sightings: &[Sighting<T>],
    pose: &Pose<T>,
    gate: T,
    dropped: &mut [bool],
) -> (usize, bool) {
    let mut rejected = 0;
    let mut changed = false;
    for (sighting, dropped) in sightings.iter().zip(dropped) {
        // Negated, so that a residual that is not a number is outside.
        let outside = !(least_squares::squared_sigmas(sighting, pose) <= gate);
        changed |= *dropped != outside;
        *dropped = outside;
        rejected += usize::from(outside);
    }
    (rejected, changed)
}
