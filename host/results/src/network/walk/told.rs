//! Results of an estimator, by the numbers that people know.

use calib_core::{
    Ray, Refusal, Sighting, Status, angle,
    joint::{Finding as Found, JointError, Quantity, Standing, is_consensus},
    resection,
};

use super::{Part, Walk};
use crate::network::{
    BearingResidual, Camera, Carrier, Finding, LegResidual, LensEstimate, NetworkSolution,
    Protection, RangeResidual, ScaleFrom, Settings, Stop,
    estimator::{Output, Seen},
    limits, standing,
};
use crate::{
    mirror::Mirror,
    record::{Estimate, NodeMount},
};

impl Walk<'_> {
    pub(super) fn told(
        &self,
        settings: &Settings,
        part: &Part,
        output: &Output,
        baseline: Option<f64>,
    ) -> NetworkSolution {
        let is_bad = output.fit.is_bad();
        let mut solution = self.empty();
        if is_bad {
            solution.status = Status::Doubtful;
            solution.reason = Some(NetworkSolution::CONTRADICTORY);
        } else {
            solution.status = Status::Calibrated;
        }
        if baseline.is_none() {
            solution.scale_from = ScaleFrom::Carrier;
        }
        let second = output.poses.get(1).and_then(Option::as_ref);
        solution.baseline = baseline.or(second.map(|pose| pose.position.x));
        solution.sigma_baseline = match baseline {
            Some(_) => Some(0.0),
            None => second.map(|pose| pose.covariance.m11.max(0.0).sqrt()),
        };
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
                Found::Range { stop, camera, off } => Finding::Range {
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
        let of = |quantity: Quantity| {
            let left = output.bearings.iter().flatten();
            left.filter(move |left| left.quantity == quantity)
        };
        solution.bearings = of(Quantity::Bearing)
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
        solution.ranges = of(Quantity::Range)
            .map(|left| RangeResidual {
                target: self.target,
                stop: number(left.stop),
                camera: self.cameras[left.camera],
                residual: left.residual,
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
        let is_bearing = |seen: &&Seen| seen.quantity == Quantity::Bearing;
        let own = || { self.bearings.iter() }.filter(|seen| seen.camera == camera);
        let own = || own().filter(is_bearing);
        let used = output.bearings.iter().flatten().filter(|left| {
            left.camera == camera
                && left.standing == Standing::Counts
                && left.quantity == Quantity::Bearing
        });
        let least = { used.clone() }
            .map(|left| left.redundancy)
            .reduce(f64::min);
        let mut told = Camera {
            camera: self.cameras[camera],
            reference,
            status: Status::Waiting,
            reason: None,
            estimate: None,
            protection: None,
            redundancy: None,
            checked: false,
            lens: None,
            mirrored: false,
            mount: None,
            bearings: own().count(),
            used: used.count(),
        };
        let given = self.sightings.lens.and_then(|lens| lens.fov_deg);
        told.lens = output.lenses[camera].map(|lens| LensEstimate::new(&lens, given));
        let is_other = told.lens.is_some_and(|lens| lens.wrong);
        let is_off = |finding: &Found<f64>| matches!(finding, Found::Camera { camera: off, .. } if *off == camera);
        // Its sightings, from where the stops are.
        let sightings: Vec<_> = own()
            .filter_map(|seen| {
                let stop = part.stops.binary_search(&seen.stop).ok()?;
                let place = output.places[stop].as_ref()?;
                let ray = Ray::from_bearing(seen.value);
                let mut sighting = Sighting::new(place.position, ray, seen.sigma);
                sighting.target_covariance = place.covariance;
                Some(sighting)
            })
            .collect();
        let mirror = match reference {
            false => Mirror::of(&sightings),
            true => Mirror::Worse,
        };
        told.mirrored = mirror == Mirror::Better;
        let has_moved = output.findings.iter().any(is_off);
        if let Some(pose) = output.poses[camera] {
            told.estimate = Estimate::new(&pose);
            told.protection = output.protections[camera].map(|levels| Protection {
                position: levels.position_bearing.max(levels.position_leg),
                heading_deg: levels.heading_bearing.max(levels.heading_leg).to_degrees(),
            });
            told.redundancy = least;
            let limits = limits(settings, part.input.baseline);
            told.checked = told.protection.is_some_and(|level| limits.tolerate(&level));
            let is_outvoted = !is_consensus(told.used, told.bearings, told.checked);
            // Rows that contradict any mounting; those of a reference spoil all poses.
            let is_refused =
                |camera: usize| output.mounts[camera].is_some_and(|mount| mount.is_refused());
            let hangs_on = [0, 1, camera].into_iter().any(is_refused);
            told.mount = output.mounts[camera].and_then(|mount| NodeMount::of(&mount));
            let contradicts = is_bad || told.mirrored || is_outvoted || has_moved || hangs_on;
            let is_weak = { settings.max_sigma }
                .is_some_and(|most| !reference && pose.sigma_position() > most);
            (told.status, told.reason) = if contradicts || is_other {
                (Status::Doubtful, Some(NetworkSolution::CONTRADICTORY))
            } else if mirror == Mirror::AsGood && !told.checked {
                (Status::Doubtful, Some(NetworkSolution::AMBIGUOUS))
            } else if is_weak {
                (Status::Weak, None)
            } else {
                (Status::Calibrated, None)
            };
            return told;
        }
        // Why its bearings give no pose.
        if sightings.len() >= 3 {
            let why = resection::solve(&sightings).err();
            let is_outvoted = !is_consensus(told.used, told.bearings, false);
            let contradicts = is_bad || told.mirrored || is_outvoted || has_moved;
            let why = why.unwrap_or(if contradicts {
                Refusal::Inconsistent
            } else {
                Refusal::Undetermined
            });
            (told.status, told.reason) = (Status::Refused, Some(why.name()));
        }
        told
    }

    pub(super) fn refused(&self, why: JointError) -> NetworkSolution {
        let refusal = match why {
            JointError::Start(refusal) | JointError::Solve(refusal) => refusal,
            _ => Refusal::NotFinite,
        };
        NetworkSolution {
            status: refusal.into(),
            reason: Some(refusal.name()),
            advice: Some(match self.lacking() {
                Some(lacking) => format!("{why}; {lacking}"),
                None => why.to_string(),
            }),
            ..self.empty()
        }
    }

    /// Measurements that a solution needs and that are not there.
    fn lacking(&self) -> Option<String> {
        let saw =
            |camera: u16| { self.sightings.bearings.iter() }.any(|seen| seen.camera == camera);
        let references = { self.cameras.iter() }.take(2);
        if let Some(blind) = references.copied().find(|camera| !saw(*camera)) {
            return Some(format!("camera {blind}, a reference, has no bearing"));
        }
        let gaps = { self.stops.iter().zip(&self.legs) }.skip(1);
        let gaps = gaps.filter(|(_, leg)| leg.is_none());
        let gaps: Vec<_> = gaps.map(|(stop, _)| stop.to_string()).collect();
        (!gaps.is_empty()).then(|| {
            format!(
                "no displacement tells the way to stop {}, so that both references have to see stops before it and after it",
                gaps.join(", ")
            )
        })
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
            ranges: Vec::new(),
            legs: Vec::new(),
            leg_factor: None,
            chi_squared: None,
            degrees_of_freedom: 0,
        }
    }
}
