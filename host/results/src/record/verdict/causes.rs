//! Causes of problems of most cameras, and of their true errors.

use calib_core::{
    Ray, Sighting, Status, angle,
    fit::{Fit, one_in_a_thousand},
};
use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    super::{
        Node, Residual, RunRecord, Target,
        sightings::{Bearing, Sightings},
    },
    Cause, Common,
};
use crate::mirror::Mirror;

/// Chi squared that is exceeded as rarely as five sigmas by a normal number: of 1, 2 and 3 degrees
/// of freedom, from the incomplete gamma function.
const FIVE_SIGMAS: [f64; 3] = [25.0, 28.744, 31.812];
/// So many cameras at least tell whether sigmas are too large.
const MANY: usize = 10;
/// Errors this many times smaller than foretold are not chance, among many cameras.
const TOO_SMALL: f64 = 2.0;

/// Number of predicted sigmas that the pose is off, if these are more than five are to one number. A doubtful pose is not to
/// be relied on, and deceives no reader.
pub fn deceives(camera: &Node) -> Option<f64> {
    if camera.status == Some(Status::Doubtful) {
        return None;
    }
    let fit = camera.truth_fit()?;
    let limit = FIVE_SIGMAS.get(fit.degrees_of_freedom.checked_sub(1)?)?;
    (!(fit.chi_squared <= *limit)).then(|| fit.chi_squared.sqrt())
}

/// Problems of the cameras as a whole, and not only because of the worst quarter of them.
pub(super) fn common(record: &RunRecord) -> Vec<Common> {
    let mut common = Vec::new();
    let lens = most(
        record
            .cameras()
            .filter_map(|camera| true_bearings(record, camera)),
    );
    common.extend(lens.map(Common::Lens));
    // A wrong lens makes places wrong, and either one residuals large: one cause is enough.
    if common.is_empty() {
        let carriers = record.targets.iter();
        common.extend(
            carriers.filter_map(|target| {
                believed(target).map(|ratio| Common::Carrier(target.id, ratio))
            }),
        );
    }
    if common.is_empty() {
        let residuals = record.cameras().map(Node::fit);
        common.extend(most(residuals).map(Common::Misfit));
    }
    common.extend(errors(record));
    common
}

/// Factor by which errors are too large, where also without the worst quarter the fit is bad.
fn most(fits: impl Iterator<Item = Fit<f64>>) -> Option<f64> {
    let mut fits: Vec<_> = fits.filter(|fit| fit.degrees_of_freedom > 0).collect();
    let excess = |fit: &Fit<f64>| fit.chi_squared - fit.degrees_of_freedom as f64;
    fits.sort_by(|a, b| f64::total_cmp(&excess(b), &excess(a)));
    let sum = |fits: &[Fit<f64>]| fits.iter().copied().fold(Fit::default(), Fit::and);
    let rest = fits.get(fits.len().div_ceil(4)..).unwrap_or_default();
    let ratio = sum(&fits).ratio();
    ratio.filter(|_| sum(rest).degrees_of_freedom > 0 && sum(rest).is_bad())
}

/// Returns true if the sightings of a camera, which contradict each other, fit once left and right are exchanged. As far as
/// nodes know: a rehearsal's true places are no part of that.
pub(super) fn is_mirrored(record: &RunRecord, camera: &Node) -> bool {
    // Bearings of a camera that is not level are no directions on the floor.
    if camera.mount.is_some() {
        return false;
    }
    let sightings = camera.residuals.iter().filter_map(|seen| {
        let stop = record.stop(seen)?;
        let (place, sigmas) = match stop.believed {
            Some(at) => (
                Point2::new(at.x, at.y),
                Vector2::new(at.sigma_x, at.sigma_y),
            ),
            None if record.seed.is_none() => (Point2::new(stop.x, stop.y), Vector2::zeros()),
            None => return None,
        };
        let measured = record.sightings.iter().find_map(|all| {
            let is_it = |own: &&_| is_of(own, camera, seen);
            (all.network == camera.network)
                .then(|| all.bearings.iter().find(is_it))?
                .map(|own| own.sigma_deg)
        });
        let sigma = measured.or_else(|| Some(seen.residual_deg? / seen.normalised?))?;
        let ray = Ray::from_bearing(seen.bearing_deg.to_radians());
        let mut sighting = Sighting::new(place, ray, sigma.to_radians());
        sighting.target_covariance = Matrix2::from_diagonal(&sigmas.component_mul(&sigmas));
        (sigma > 0.0).then_some(sighting)
    });
    Mirror::of(&sightings.collect::<Vec<_>>()) == Mirror::Better
}

/// Returns true if a bearing is this sighting of a camera.
fn is_of(bearing: &Bearing, camera: &Node, seen: &Residual) -> bool {
    (bearing.camera, bearing.target, bearing.stop) == (camera.id, seen.target, seen.stop)
}

/// Reason why the sightings of a camera contradict each other; `None` where the truth is not known, or tells
/// nothing.
pub(super) fn of_doubt(record: &RunRecord, camera: &Node) -> Option<Cause> {
    if true_bearings(record, camera)?.is_bad() {
        return Some(Cause::Sight);
    }
    let mut targets = record.targets.iter();
    let saw = |target: &Target| camera.residuals.iter().any(|r| r.target == target.id);
    targets
        .any(|target| saw(target) && believed(target).is_some())
        .then_some(Cause::Carrier)
}

/// The bearings of a camera against those under which the target really was. Where the target
/// believed to be is no part of that, and neither are its sigmas.
fn true_bearings(record: &RunRecord, camera: &Node) -> Option<Fit<f64>> {
    // Bearings of a camera that is not level are no directions on the floor.
    let truth = camera.truth.filter(|_| camera.mount.is_none())?;
    let fits = camera.residuals.iter().filter_map(|residual| {
        let stop = record.stop(residual)?;
        let (dx, dy) = (stop.x - truth.x, stop.y - truth.y);
        let sigma = sighting_sigma_deg(record, camera, residual, dx.hypot(dy))?;
        let real = dy.atan2(dx).to_degrees() - truth.heading_deg;
        let error = angle::wrap_signed((residual.bearing_deg - real).to_radians()).to_degrees();
        (sigma > 0.0).then(|| Fit {
            chi_squared: (error / sigma).powi(2),
            degrees_of_freedom: 1,
        })
    });
    fits.reduce(Fit::and)
}

/// Sigma of a camera's direction to where a target really stood, `distance` away: that of its bearing, and of
/// how still the target stands.
fn sighting_sigma_deg(
    record: &RunRecord,
    camera: &Node,
    residual: &Residual,
    distance: f64,
) -> Option<f64> {
    let of_network = |all: &&Sightings| all.network == camera.network;
    let measured = record.sightings.iter().find(of_network).and_then(|all| {
        let bearing = { all.bearings.iter() }.find(|seen| is_of(seen, camera, residual))?;
        let carrier = all.carriers.iter().find(|c| c.target == residual.target);
        let standing = carrier.map_or(0.0, |carrier| carrier.standing_sigma);
        Some(bearing.sigma_deg.hypot((standing / distance).to_degrees()))
    });
    // A record of before bearings were kept: with the share of the target's place.
    measured.or_else(|| Some(residual.residual_deg? / residual.normalised?))
}

/// Factor by which a target's belief is farther off than foretold. Its stops share part of their errors, so
/// that their mean counts like one of them.
fn believed(target: &Target) -> Option<f64> {
    let errors = target.stops.iter().filter_map(|stop| {
        let believed = stop.believed?;
        let off = |error: f64, sigma: f64| (sigma > 0.0).then(|| (error / sigma).powi(2));
        Some(
            off(believed.x - stop.x, believed.sigma_x)?
                + off(believed.y - stop.y, believed.sigma_y)?,
        )
    });
    let errors: Vec<f64> = errors.collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (mean > one_in_a_thousand(2)).then(|| (mean / 2.0).sqrt())
}

/// The true errors of all cameras. They share the errors of the target from which they learnt, so that their
/// mean counts like that of one camera, of three degrees of freedom.
fn errors(record: &RunRecord) -> Option<Common> {
    let relied = record
        .cameras()
        .filter(|camera| camera.status != Some(Status::Doubtful));
    let fits: Vec<_> = relied.filter_map(Node::truth_fit).collect();
    let all = fits.iter().copied().fold(Fit::default(), Fit::and);
    let ratio = all.ratio()?;
    if 3.0 * ratio * ratio > one_in_a_thousand(3) {
        Some(Common::Overconfident(ratio))
    } else {
        (fits.len() >= MANY && ratio * TOO_SMALL < 1.0).then(|| Common::Underconfident(1.0 / ratio))
    }
}
