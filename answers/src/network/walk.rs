//! One target's walk, made ready for the estimator and told again.
//!
//! Where a displacement is missing, the walk falls into pieces. The first that carries a frame by
//! itself begins; of any other, two cameras that then have a pose must see one stop. It is tied to
//! the rest by a displacement that weighs nothing, so that the estimator begins in the right place.

use calib_core::{
    Limits, Pose, Ray, Refusal, Sighting, Status, angle,
    intersection::{self, StationBearing},
    joint::{Finding as Found, JointSettings, Leg, Prior, Standing},
    resection,
};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};

use super::{
    BearingResidual, Camera, Carrier, Finding, LegResidual, NetworkError, NetworkSolution,
    Protection, ScaleFrom, Settings, Stop,
    estimator::{self, Depth, Failure, Input, MOST, Output, Seen},
    standing, usual_carrier,
};
use crate::record::{Estimate, sightings::Sightings};

/// Sigmas of scale and, in radians, of a direction of which nothing is known.
const VAGUE: [f64; 2] = [1e6, 10.0];
/// No carrier is known better than this, a share or radians.
const EXACT: f64 = 1e-5;
/// Nor is any displacement, in baselines.
const LEAST_LEG: f64 = 1e-5;
/// Sigma of a displacement that weighs nothing, in baselines.
const WEIGHTLESS: f64 = 1e4;
/// Cameras take part up to these sigmas: of position, in baselines, and of heading, radians.
const LIMITS: [f64; 2] = [0.3, 0.5];
/// An excluded displacement keeps so many times its sigmas.
const EXCLUDED: f64 = 50.0;

/// What was measured along one walk, by the numbers of the estimator.
pub(super) struct Walk<'a> {
    sightings: &'a Sightings,
    target: u16,
    cameras: &'a [u16],
    /// Numbers of the stops, in their order.
    stops: Vec<u32>,
    legs: Vec<Option<Leg<f64>>>,
    bearings: Vec<Seen>,
}

/// The part of a walk that is solved.
struct Part {
    input: Input,
    /// Of each of its stops the place in the walk.
    stops: Vec<usize>,
    /// Of each of its bearings.
    bearings: Vec<usize>,
    /// Displacements that weigh nothing lead to these of its stops.
    ties: Vec<usize>,
}

/// A piece of a walk without a gap, once it is known where it is: its first and last stop, and the
/// displacement that leads to it from the end of the piece before it.
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
        let mut stops: Vec<u32> = own_legs().map(|leg| leg.stop).collect();
        stops.extend(own_seen().map(|seen| seen.stop));
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
        let bearings = own_seen().filter_map(|seen| {
            Some(Seen {
                stop: number(&stops, seen.stop)?,
                camera: cameras.iter().position(|camera| *camera == seen.camera)?,
                bearing: seen.bearing_deg.to_radians(),
                sigma: seen.sigma_deg.to_radians(),
            })
        });
        let mut bearings: Vec<_> = bearings.collect();
        bearings.sort_by_key(|seen| (seen.stop, seen.camera));
        Self {
            sightings,
            target,
            cameras,
            stops,
            legs,
            bearings,
        }
    }

    pub(super) fn solve(&self, settings: &Settings) -> Result<NetworkSolution, NetworkError> {
        let known = self.sightings.references.and_then(|known| known.baseline);
        let solved = match known {
            Some(baseline) => self.solve_part(baseline, None, settings.fit_legs),
            None => self.solve_unknown_baseline(settings.fit_legs),
        };
        match solved {
            Ok((part, output, baseline)) => {
                Ok(self.told(settings, &part, &output, known.is_some(), baseline))
            }
            Err(Failure::TooMany) => Err(NetworkError::TooMany {
                target: self.target,
                cameras: self.cameras.len(),
                stops: self.stops.len(),
                bearings: self.bearings.len(),
                most: MOST,
            }),
            Err(Failure::Joint(why)) => Ok(self.refused(why)),
        }
    }

    /// A carrier's sigmas of scale and of its compass, radians.
    fn carrier_sigmas(&self) -> [f64; 2] {
        let mut carriers = self.sightings.carriers.iter();
        let known = carriers.find(|carrier| carrier.target == self.target);
        let carrier = known.copied().unwrap_or_else(|| usual_carrier(self.target));
        [
            carrier.systematic_scale.max(EXACT),
            carrier.systematic_heading_deg.to_radians().max(EXACT),
        ]
    }

    fn settings(&self, baseline: f64, scale: Option<Prior<f64>>) -> JointSettings<f64> {
        let [scale_sigma, compass_sigma] = self.carrier_sigmas();
        let heading = self.sightings.frame_heading_deg;
        let known = Prior {
            mean: 1.0,
            sigma: scale_sigma,
        };
        let [position, heading_limit] = LIMITS;
        JointSettings {
            scale: scale.unwrap_or(known),
            compass: Prior {
                // What points along the x axis of displacements reads zero.
                mean: -angle::wrap_signed(heading.unwrap_or_default().to_radians()),
                sigma: heading.map_or(VAGUE[1], |_| compass_sigma),
            },
            limits: Limits {
                position: position * baseline,
                heading: heading_limit,
            },
        }
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

    /// Solves with a baseline that is known, or taken for it. The scale's prior may be another one.
    fn solve_part(
        &self,
        baseline: f64,
        scale: Option<Prior<f64>>,
        fit_legs: bool,
    ) -> Result<(Part, Output, [f64; 2]), Failure> {
        let settings = self.settings(baseline, scale);
        let depth = Depth::Checked { fit_legs };
        let mut pieces = self.pieces();
        if pieces.len() == 1 {
            let part = self.part(&pieces, baseline, settings, None);
            let output = estimator::solve(&part.input, depth)?;
            return Ok((part, output, [baseline, 0.0]));
        }
        let mut failure = Failure::Joint(calib_core::joint::JointError::Start(Refusal::TooFew));
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
        while self.locate(&mut pieces, &output) {
            let next = self.part(&pieces, baseline, settings, Some(&output));
            let Ok(better) = estimator::solve(&next.input, depth) else {
                break;
            };
            (part, output) = (next, better);
        }
        output.fit.degrees_of_freedom =
            { output.fit.degrees_of_freedom }.saturating_sub(2 * part.ties.len());
        Ok((part, output, [baseline, 0.0]))
    }

    /// Finds out where pieces are of which two cameras with a pose see a stop. Whether there are new
    /// ones.
    fn locate(&self, pieces: &mut [Piece], known: &Output) -> bool {
        let mut found = false;
        for piece in pieces.iter_mut().filter(|piece| piece.place.is_none()) {
            let mut since = Vector2::zeros();
            for stop in piece.stops.clone() {
                if let Some(leg) = self.legs[stop].filter(|_| stop > piece.stops.start) {
                    since += true_way(leg.displacement, known);
                }
                let stations = self.bearings.iter().filter(|seen| seen.stop == stop);
                let stations: Vec<_> = stations
                    .filter_map(|seen| {
                        Some(StationBearing {
                            pose: known.poses[seen.camera]?,
                            ray: Ray::from_bearing(seen.bearing),
                            bearing_sigma: seen.sigma,
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

    /// The pieces of which a place is known, one after the other; all if there is but one.
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
                baseline,
                settings,
                legs: Vec::new(),
                bearings: Vec::new(),
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
        part
    }

    /// The carrier's distances set the scale. In a frame of one baseline its scale is free and tells
    /// how long that is; sigmas and correlations with it go into every length.
    fn solve_unknown_baseline(&self, fit_legs: bool) -> Result<(Part, Output, [f64; 2]), Failure> {
        let free = Prior {
            mean: 1.0,
            sigma: VAGUE[0],
        };
        // First in units of a leg, then in those that the carrier has.
        let lengths = self
            .legs
            .iter()
            .flatten()
            .map(|leg| leg.displacement.norm());
        let longest = lengths.fold(f64::MIN_POSITIVE, f64::max);
        let (_, output, _) = self.solve_part(longest, Some(free), false)?;
        let baseline = longest * output.carrier.scale;
        let (part, mut output, _) = self.solve_part(baseline, Some(free), fit_legs)?;
        let scale = output.carrier.scale;
        let sigma = output.carrier.sigma_scale();
        let [own_sigma, _] = self.carrier_sigmas();
        // What the answers do when the scale is another one: with their covariance, that is all that
        // ties them to it.
        let input = without(&part.input, &output);
        let at = |scale: f64| {
            let settings = JointSettings {
                scale: Prior {
                    mean: scale,
                    sigma: sigma * 1e-4,
                },
                ..input.settings
            };
            let input = Input {
                settings,
                ..input.clone()
            };
            estimator::solve(&input, Depth::Answers)
        };
        let (less, more) = (at(scale - sigma)?, at(scale + sigma)?);
        let relative = (sigma / scale).hypot(own_sigma);
        let own = scale.recip();
        for ((pose, less), more) in output.poses.iter_mut().zip(&less.poses).zip(&more.poses) {
            if let (Some(pose), Some(less), Some(more)) = (pose, less, more) {
                let apart = more.position - less.position;
                let turned = angle::wrap_signed(more.heading - less.heading);
                // Covariance with the scale, over it.
                let c = Vector3::new(apart.x, apart.y, turned) * (0.5 * sigma * own);
                let m = Vector3::new(pose.position.x, pose.position.y, 0.0);
                let with = m * c.transpose();
                pose.covariance += with + with.transpose() + m * m.transpose() * relative.powi(2);
                stretch(pose, own);
            }
        }
        for ((place, less), more) in output.places.iter_mut().zip(&less.places).zip(&more.places) {
            if let (Some(place), Some(less), Some(more)) = (place, less, more) {
                let c = (more.position - less.position) * (0.5 * sigma * own);
                let m = place.position.coords;
                let with = m * c.transpose();
                place.covariance += with + with.transpose() + m * m.transpose() * relative.powi(2);
                place.position *= scale;
                place.covariance *= scale * scale;
            }
        }
        output.carrier.scale = 1.0;
        output.carrier.covariance.m11 = own_sigma.powi(2);
        output.carrier.covariance.m12 = 0.0;
        output.carrier.covariance.m21 = 0.0;
        output.fit.degrees_of_freedom = output.fit.degrees_of_freedom.saturating_sub(1);
        let baseline = baseline * scale;
        Ok((part, output, [baseline, baseline * relative]))
    }

    fn told(
        &self,
        settings: &Settings,
        part: &Part,
        output: &Output,
        has_baseline: bool,
        [baseline, sigma_baseline]: [f64; 2],
    ) -> NetworkSolution {
        let is_bad = output.fit.is_bad();
        let mut solution = self.empty();
        if is_bad {
            solution.status = Status::Doubtful;
            solution.reason = Some(NetworkSolution::CONTRADICTORY);
        } else {
            solution.status = Status::Calibrated;
        }
        if !has_baseline {
            solution.scale_from = ScaleFrom::Carrier;
        }
        solution.baseline = Some(baseline);
        solution.sigma_baseline = Some(sigma_baseline);
        solution.chi_squared = Some(output.fit.chi_squared);
        solution.degrees_of_freedom = output.fit.degrees_of_freedom;
        solution.leg_factor = output.leg_factor;
        let number = |stop: usize| part.stops.get(stop).and_then(|stop| self.stops.get(*stop));
        let number = |stop: usize| number(stop).copied().unwrap_or_default();
        solution.findings = { output.findings.iter() }
            .map(|finding| match *finding {
                Found::Bearing { stop, camera, off } => Finding::Bearing {
                    target: self.target,
                    stop: number(stop),
                    camera: self.cameras[camera],
                    off,
                },
                Found::Leg { stop, chi_squared } => Finding::Leg {
                    target: self.target,
                    stop: number(stop),
                    chi_squared,
                },
                Found::Camera {
                    camera,
                    from,
                    chi_squared,
                } => Finding::Camera {
                    camera: self.cameras[camera],
                    from: number(from),
                    chi_squared,
                },
            })
            .collect();
        solution.stops = { output.places.iter().enumerate() }
            .filter_map(|(stop, place)| {
                let place = place.as_ref()?;
                let c = place.covariance;
                Some(Stop {
                    target: self.target,
                    stop: number(stop),
                    x: place.position.x,
                    y: place.position.y,
                    sigma_x: c.m11.max(0.0).sqrt(),
                    sigma_y: c.m22.max(0.0).sqrt(),
                    covariance: [c.m11, c.m12, c.m22],
                })
            })
            .collect();
        let is_told = |stop: &u32| solution.stops.iter().any(|told| told.stop == *stop);
        solution.left_out = { self.stops.iter().copied() }
            .filter(|stop| !is_told(stop))
            .collect();
        solution.carrier = Some(Carrier {
            scale: output.carrier.scale,
            sigma_scale: output.carrier.sigma_scale(),
            compass_deg: angle::wrap_signed(output.carrier.compass).to_degrees(),
            sigma_compass_deg: output.carrier.sigma_compass().to_degrees(),
        });
        solution.bearings = { output.bearings.iter().flatten() }
            .map(|left| BearingResidual {
                target: self.target,
                stop: number(left.stop),
                camera: self.cameras[left.camera],
                residual_deg: left.residual.to_degrees(),
                redundancy: left.redundancy,
                normalised: left.normalised,
                standing: standing(left.standing),
            })
            .collect();
        solution.legs = { output.legs.iter().enumerate() }
            .filter(|(stop, _)| !part.ties.contains(stop))
            .filter_map(|(_, left)| {
                let left = left.as_ref()?;
                Some(LegResidual {
                    target: self.target,
                    stop: number(left.stop),
                    chi_squared: left.chi_squared,
                    degrees_of_freedom: left.degrees_of_freedom,
                    standing: standing(left.standing),
                })
            })
            .collect();
        solution.cameras = (0..self.cameras.len())
            .map(|camera| self.camera(settings, camera, part, output, is_bad))
            .collect();
        solution.cameras.sort_by_key(|camera| camera.camera);
        solution
    }

    fn camera(
        &self,
        settings: &Settings,
        camera: usize,
        part: &Part,
        output: &Output,
        is_bad: bool,
    ) -> Camera {
        let reference = camera < 2;
        let own = || self.bearings.iter().filter(|seen| seen.camera == camera);
        let left = output.bearings.iter().flatten();
        let used = left.filter(|left| left.camera == camera && left.standing == Standing::Counts);
        let mut told = Camera {
            camera: self.cameras[camera],
            reference,
            status: Status::Waiting,
            reason: None,
            estimate: None,
            protection: None,
            bearings: own().count(),
            used: used.count(),
        };
        let is_off = |finding: &Found<f64>| matches!(finding, Found::Camera { camera: off, .. } if *off == camera);
        let contradicts = is_bad || output.findings.iter().any(is_off);
        if let Some(pose) = output.poses[camera] {
            told.estimate = Estimate::new(&pose);
            told.protection = output.protections[camera].map(|levels| Protection {
                position: levels.position_bearing.max(levels.position_leg),
                heading_deg: levels.heading_bearing.max(levels.heading_leg).to_degrees(),
            });
            let is_weak = { settings.max_sigma }
                .is_some_and(|most| !reference && pose.sigma_position() > most);
            (told.status, told.reason) = if contradicts {
                (Status::Doubtful, Some(NetworkSolution::CONTRADICTORY))
            } else if is_weak {
                (Status::Weak, None)
            } else {
                (Status::Calibrated, None)
            };
            return told;
        }
        // Why its bearings give no pose, from where the stops are.
        let sightings: Vec<_> = own()
            .filter_map(|seen| {
                let stop = part.stops.binary_search(&seen.stop).ok()?;
                let place = output.places[stop].as_ref()?;
                let ray = Ray::from_bearing(seen.bearing);
                let mut sighting = Sighting::new(place.position, ray, seen.sigma);
                sighting.target_covariance = place.covariance;
                Some(sighting)
            })
            .collect();
        if sightings.len() >= 3 {
            let why = resection::solve(&sightings).err();
            let why = why.unwrap_or(if contradicts {
                Refusal::Inconsistent
            } else {
                Refusal::Undetermined
            });
            (told.status, told.reason) = (Status::Refused, Some(why.name()));
        }
        told
    }

    fn refused(&self, why: calib_core::joint::JointError) -> NetworkSolution {
        use calib_core::joint::JointError;
        let refusal = match why {
            JointError::Start(refusal) | JointError::Solve(refusal) => refusal,
            _ => Refusal::NotFinite,
        };
        NetworkSolution {
            status: refusal.into(),
            reason: Some(refusal.name()),
            advice: Some(why.to_string()),
            ..self.empty()
        }
    }

    fn empty(&self) -> NetworkSolution {
        NetworkSolution {
            network: self.sightings.network,
            target: Some(self.target),
            status: Status::Waiting,
            reason: None,
            advice: None,
            scale_from: ScaleFrom::Baseline,
            references: Some([self.cameras[0], self.cameras[1]]),
            baseline: None,
            sigma_baseline: None,
            cameras: Vec::new(),
            stops: Vec::new(),
            left_out: Vec::new(),
            carrier: None,
            findings: Vec::new(),
            bearings: Vec::new(),
            legs: Vec::new(),
            leg_factor: None,
            chi_squared: None,
            degrees_of_freedom: 0,
        }
    }
}

/// The same measurements without those that were left out.
fn without(input: &Input, output: &Output) -> Input {
    let mut input = input.clone();
    let counts = |left: &Option<calib_core::joint::BearingResidual<f64>>| {
        left.is_some_and(|left| left.standing == Standing::Counts)
    };
    let mut left = output.bearings.iter();
    input.bearings.retain(|_| left.next().is_some_and(counts));
    for (leg, left) in input.legs.iter_mut().zip(&output.legs) {
        let is_out = left
            .as_ref()
            .is_some_and(|left| left.standing != Standing::Counts);
        let factor = output.leg_factor.unwrap_or(1.0) * if is_out { EXCLUDED } else { 1.0 };
        if let Some(leg) = leg {
            leg.covariance *= factor * factor;
        }
    }
    input
}

/// What a carrier walked of what he read.
fn true_way(read: Vector2<f64>, known: &Output) -> Vector2<f64> {
    angle::rotation(-known.carrier.compass) * read / known.carrier.scale
}

/// What he reads of a way.
fn read_way(way: Vector2<f64>, known: &Output) -> Vector2<f64> {
    angle::rotation(known.carrier.compass) * way * known.carrier.scale
}

/// All lengths times a factor.
fn stretch(pose: &mut Pose<f64>, own: f64) {
    let factor = own.recip();
    let scale = Matrix3::from_diagonal(&Vector3::new(factor, factor, 1.0));
    pose.position *= factor;
    pose.covariance = scale * pose.covariance * scale;
}
