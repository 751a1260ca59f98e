//! One target's walk, made ready for the estimator and told again.
//!
//! Where a displacement is missing, the walk falls into pieces. The first that carries a frame by
//! itself begins; of any other, two cameras that then have a pose must see one stop. It is tied to
//! the rest by a displacement that weighs nothing, so that the estimator begins in the right place.

use calib_core::{
    Limits, Ray, Refusal, angle,
    intersection::{self, StationBearing},
    joint::{JointError, JointSettings, Leg, Lens, Prior, Quantity},
    level::Elevation,
};
use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    NetworkError, NetworkSolution, Settings,
    estimator::{self, Depth, Failure, Input, MOST, Output, Seen, Visit},
    usual_carrier,
};
use crate::record::sightings::{Carrier, Sightings};

mod told;

/// Sigma of an unknown direction, radians.
const VAGUE: f64 = 10.0;
/// No carrier is known better than this, a share or radians.
const EXACT: f64 = 1e-5;
/// No displacement is known better than this, in baselines.
const LEAST_LEG: f64 = 1e-5;
/// Sigma of a displacement that weighs nothing, in baselines.
const WEIGHTLESS: f64 = 1e4;
/// Focal lengths of unknown lenses, one sigma.
const ANY_LENS: f64 = 0.3;
/// Cameras take part up to these sigmas: of position, in baselines, and of heading, radians.
const LIMITS: [f64; 2] = [0.3, 0.5];

/// Measurements along one walk, by the numbers of the estimator.
pub(super) struct Walk<'a> {
    sightings: &'a Sightings,
    target: u16,
    cameras: &'a [u16],
    /// Numbers of the stops, in their order.
    stops: Vec<u32>,
    legs: Vec<Option<Leg<f64>>>,
    /// Ranges among them.
    bearings: Vec<Seen>,
    visits: Vec<Visit>,
    marks: usize,
}

/// The part of a walk that is solved.
struct Part {
    input: Input,
    /// Place in the walk of each of its stops.
    stops: Vec<usize>,
    /// Of each of its bearings.
    bearings: Vec<usize>,
    /// Displacements that weigh nothing lead to these of its stops.
    ties: Vec<usize>,
}

/// A piece of a walk without a gap.
struct Piece {
    stops: std::ops::Range<usize>,
    /// Where its first stop is thought to be.
    place: Option<Point2<f64>>,
}

impl<'a> Walk<'a> {
    pub(super) fn new(sightings: &'a Sightings, target: u16, cameras: &'a [u16]) -> Self {
        let own_legs = || {
            sightings
                .legs
                .iter()
                .filter(move |leg| leg.target == target)
        };
        let own_seen = || {
            sightings
                .bearings
                .iter()
                .filter(move |seen| seen.target == target)
        };
        let own_ranges = || {
            sightings
                .ranges
                .iter()
                .filter(move |far| far.target == target)
        };
        let own_visits = || {
            sightings
                .visits
                .iter()
                .filter(move |on| on.target == target)
        };
        let mut stops: Vec<u32> = own_legs().map(|leg| leg.stop).collect();
        stops.extend(own_seen().map(|seen| seen.stop));
        stops.extend(own_ranges().map(|far| far.stop));
        stops.extend(own_visits().map(|on| on.stop));
        stops.sort_unstable();
        stops.dedup();
        let legs = stops.iter().enumerate().map(|(n, stop)| {
            let leg = own_legs().find(|leg| leg.stop == *stop && n > 0)?;
            let [xx, xy, yy] = leg.covariance;
            Some(Leg {
                displacement: Vector2::new(leg.dx, leg.dy),
                covariance: Matrix2::new(xx, xy, xy, yy),
            })
        });
        let legs = legs.collect();
        let number = |all: &[u32], one: u32| all.iter().position(|stop| *stop == one);
        let camera = |one: u16| cameras.iter().position(|camera| *camera == one);
        let bearings = own_seen().filter_map(|seen| {
            Some(Seen {
                stop: number(&stops, seen.stop)?,
                camera: camera(seen.camera)?,
                quantity: Quantity::Bearing,
                value: seen.bearing_deg.to_radians(),
                sigma: seen.sigma_deg.to_radians(),
                elevation: { seen.elevation_deg }.map_or(Elevation::UNKNOWN, |above| {
                    Elevation::from_radians(above.to_radians() as f32)
                }),
            })
        });
        let ranges = own_ranges().filter_map(|far| {
            Some(Seen {
                stop: number(&stops, far.stop)?,
                camera: camera(far.camera)?,
                quantity: Quantity::Range,
                value: far.range,
                sigma: far.sigma,
                elevation: Elevation::UNKNOWN,
            })
        });
        let mut bearings: Vec<_> = bearings.chain(ranges).collect();
        bearings.sort_by_key(|seen| (seen.stop, seen.camera));
        let mut marks: Vec<u32> = own_visits().map(|on| on.mark).collect();
        marks.sort_unstable();
        marks.dedup();
        let visits = own_visits().filter_map(|on| {
            Some(Visit {
                stop: number(&stops, on.stop)?,
                mark: number(&marks, on.mark)?,
                sigma: on.sigma,
            })
        });
        let visits = visits.collect();
        Self {
            sightings,
            target,
            cameras,
            stops,
            legs,
            bearings,
            visits,
            marks: marks.len(),
        }
    }

    pub(super) fn solve(&self, settings: &Settings) -> Result<NetworkSolution, NetworkError> {
        let known = self.sightings.references.and_then(|known| known.baseline);
        let solved = match known {
            Some(baseline) => self.solve_part(baseline, true, settings.depth()),
            None => self.solve_unknown_baseline(settings.depth()),
        };
        match solved {
            Ok((part, mut output)) => {
                self.find_other_lenses(&part, &mut output);
                Ok(self.told(settings, &part, &output, known))
            }
            Err(Failure::TooMany) => Err(NetworkError::TooMany {
                target: self.target,
                cameras: self.cameras.len(),
                stops: self.stops.len(),
                most: MOST,
            }),
            Err(Failure::Joint(why)) => Ok(self.refused(why)),
        }
    }

    /// A lens that is far from the given one makes bearings contradict each other, and the bearings that are left
    /// may tell nothing of it. So if something contradicts, all is solved once more as if little were known of
    /// lenses.
    fn find_other_lenses(&self, part: &Part, output: &mut Output) {
        let Some(prior) = part.input.settings.lens else {
            return;
        };
        if output.findings.is_empty() && !output.fit.is_bad() {
            return;
        }
        let mut input = part.input.clone();
        input.settings.lens = Some(prior.max(ANY_LENS));
        let depth = Depth::Checked { fit_legs: false };
        let Ok(wide) = estimator::solve(&input, depth) else {
            return;
        };
        for (own, wide) in output.lenses.iter_mut().zip(&wide.lenses) {
            if let Some(lens) = wide {
                let off = (lens.scale - 1.0) / lens.sigma.hypot(prior);
                let found = Lens { off, ..*lens };
                if found.is_wrong() {
                    *own = Some(found);
                }
            }
        }
    }

    fn carrier(&self) -> Carrier {
        let mut carriers = self.sightings.carriers.iter();
        let known = carriers.find(|carrier| carrier.target == self.target);
        known.copied().unwrap_or_else(|| usual_carrier(self.target))
    }

    /// A carrier's sigmas of scale and of its compass, radians.
    fn carrier_sigmas(&self) -> [f64; 2] {
        let carrier = self.carrier();
        [
            carrier.systematic_scale.max(EXACT),
            carrier.systematic_heading_deg.to_radians().max(EXACT),
        ]
    }

    fn settings(&self, baseline: f64, is_baseline_known: bool) -> JointSettings<f64> {
        let [scale_sigma, compass_sigma] = self.carrier_sigmas();
        let heading = self.sightings.frame_heading_deg;
        let [position, heading_limit] = LIMITS;
        let mut settings = JointSettings::default();
        settings.scale = Prior {
            mean: 1.0,
            sigma: scale_sigma,
        };
        settings.compass = Prior {
            // A way along the x axis of displacements reads zero.
            mean: -angle::wrap_signed(heading.unwrap_or_default().to_radians()),
            sigma: heading.map_or(VAGUE, |_| compass_sigma),
        };
        settings.standing = self.carrier().standing_sigma;
        settings.tilt = self.sightings.tilt_sigma_deg.to_radians();
        settings.lens = self.sightings.lens.map(|lens| lens.sigma);
        settings.principal = { self.sightings.lens }.map(|lens| lens.principal_deg.to_radians());
        settings.is_baseline_known = is_baseline_known;
        settings.limits = Limits {
            position: position * baseline,
            heading: heading_limit,
        };
        settings
    }

    /// The walk's pieces: their first stops, and whatever comes after the last one.
    fn pieces(&self) -> Vec<Piece> {
        let mut pieces: Vec<Piece> = Vec::new();
        for (stop, leg) in self.legs.iter().enumerate() {
            match pieces.last_mut() {
                Some(last) if leg.is_some() => last.stops.end = stop + 1,
                _ => pieces.push(Piece {
                    stops: stop..stop + 1,
                    place: None,
                }),
            }
        }
        pieces
    }

    /// The carrier's distances set the scale: first with the longest of them for the baseline.
    fn solve_unknown_baseline(&self, depth: Depth) -> Result<(Part, Output), Failure> {
        let legs = self.legs.iter().flatten();
        let lengths = legs.map(|leg| leg.displacement.norm());
        let longest = lengths.fold(f64::MIN_POSITIVE, f64::max);
        let (_, output) = self.solve_part(longest, false, depth.believing())?;
        let second = output.poses.get(1).and_then(Option::as_ref);
        let undetermined = Failure::Joint(JointError::Solve(Refusal::Undetermined));
        let baseline = second.ok_or(undetermined)?.position.x;
        self.solve_part(baseline, false, depth)
    }

    /// Solves with a baseline that is known, or guessed.
    fn solve_part(
        &self,
        baseline: f64,
        is_baseline_known: bool,
        depth: Depth,
    ) -> Result<(Part, Output), Failure> {
        let settings = self.settings(baseline, is_baseline_known);
        let mut pieces = self.pieces();
        if pieces.len() == 1 {
            let part = self.part(&pieces, baseline, settings, None);
            let output = estimator::solve(&part.input, depth)?;
            return Ok((part, output));
        }
        let mut failure = Failure::Joint(JointError::Start(Refusal::TooFew));
        let mut solved = None;
        for first in 0..pieces.len() {
            pieces[first].place = Some(Point2::origin());
            let part = self.part(&pieces, baseline, settings, None);
            match estimator::solve(&part.input, depth) {
                Ok(output) => {
                    pieces[first].place = output
                        .places
                        .first()
                        .and_then(|place| place.as_ref().map(|place| place.position));
                    solved = Some((part, output));
                    break;
                }
                Err(why) => {
                    pieces[first].place = None;
                    if first == 0 {
                        failure = why;
                    }
                }
            }
        }
        let (mut part, mut output) = solved.ok_or(failure)?;
        while self.locate(&mut pieces, &part, &output) {
            let next = self.part(&pieces, baseline, settings, Some(&output));
            let Ok(better) = estimator::solve(&next.input, depth) else {
                break;
            };
            (part, output) = (next, better);
        }
        output.fit.degrees_of_freedom =
            { output.fit.degrees_of_freedom }.saturating_sub(2 * part.ties.len());
        Ok((part, output))
    }

    /// Locates pieces: two cameras with a pose see a stop of the piece, or it comes to a mark whose place is
    /// known. Returns true if there are new ones.
    fn locate(&self, pieces: &mut [Piece], part: &Part, known: &Output) -> bool {
        // Where a stop stood on the same mark as one that is solved.
        let on_mark = |stop: usize| {
            let mark = self.visits.iter().find(|on| on.stop == stop)?.mark;
            let others = self.visits.iter().filter(|on| on.mark == mark);
            others
                .filter_map(|on| part.stops.binary_search(&on.stop).ok())
                .find_map(|n| known.places[n].as_ref().map(|place| place.position))
        };
        let mut found = false;
        for piece in pieces.iter_mut().filter(|piece| piece.place.is_none()) {
            let mut since = Vector2::zeros();
            for stop in piece.stops.clone() {
                if let Some(leg) = self.legs[stop].filter(|_| stop > piece.stops.start) {
                    since += true_way(leg.displacement, known);
                }
                if let Some(place) = on_mark(stop) {
                    piece.place = Some(place - since);
                    found = true;
                    break;
                }
                let is_bearing = |seen: &&Seen| seen.quantity == Quantity::Bearing;
                let own = self.bearings.iter().filter(|seen| seen.stop == stop);
                let stations = own.filter(is_bearing);
                let stations: Vec<_> = stations
                    .filter_map(|seen| {
                        Some(StationBearing {
                            pose: known.poses[seen.camera]?,
                            ray: Ray::from_bearing(seen.value),
                            bearing_sigma: seen.sigma,
                            range: None,
                        })
                    })
                    .collect();
                if let Ok(place) = intersection::locate(&stations) {
                    piece.place = Some(place.position - since);
                    found = true;
                    break;
                }
            }
        }
        found
    }

    /// The pieces that have a known place, one after the other; all if there is but one.
    fn part(
        &self,
        pieces: &[Piece],
        baseline: f64,
        settings: JointSettings<f64>,
        known: Option<&Output>,
    ) -> Part {
        let least = Matrix2::from_diagonal_element((LEAST_LEG * baseline).powi(2));
        let weightless = Matrix2::from_diagonal_element((WEIGHTLESS * baseline).powi(2));
        let mut part = Part {
            input: Input {
                cameras: self.cameras.len(),
                marks: self.marks,
                baseline,
                settings,
                legs: Vec::new(),
                bearings: Vec::new(),
                visits: Vec::new(),
            },
            stops: Vec::new(),
            bearings: Vec::new(),
            ties: Vec::new(),
        };
        // Where the last piece ended.
        let mut end: Option<Point2<f64>> = None;
        for piece in pieces {
            let Some(mut at) = piece.place.or((pieces.len() == 1).then(Point2::origin)) else {
                continue;
            };
            for stop in piece.stops.clone() {
                let leg = if stop > piece.stops.start {
                    self.legs[stop].map(|leg| {
                        at += known
                            .map_or(leg.displacement, |known| true_way(leg.displacement, known));
                        Leg {
                            covariance: leg.covariance + least,
                            ..leg
                        }
                    })
                } else {
                    end.zip(known).map(|(end, known)| {
                        part.ties.push(part.stops.len());
                        Leg {
                            displacement: read_way(at - end, known),
                            covariance: weightless,
                        }
                    })
                };
                part.input.legs.push(leg);
                part.stops.push(stop);
            }
            end = Some(at);
        }
        for (n, seen) in self.bearings.iter().enumerate() {
            if let Ok(stop) = part.stops.binary_search(&seen.stop) {
                part.input.bearings.push(Seen { stop, ..*seen });
                part.bearings.push(n);
            }
        }
        let visits = self.visits.iter().filter_map(|on| {
            let stop = part.stops.binary_search(&on.stop).ok()?;
            Some(Visit { stop, ..*on })
        });
        part.input.visits = visits.collect();
        part
    }
}

/// True way of a carrier for the way that he reads.
fn true_way(read: Vector2<f64>, known: &Output) -> Vector2<f64> {
    angle::rotation(-known.carrier.compass) * read / known.carrier.scale
}

/// Way that he reads for a true way.
fn read_way(way: Vector2<f64>, known: &Output) -> Vector2<f64> {
    angle::rotation(known.carrier.compass) * way * known.carrier.scale
}
