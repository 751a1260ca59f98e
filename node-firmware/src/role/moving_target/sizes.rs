//! Sizes in which cameras saw the ball, and the radius that their poses make of them.
//!
//! All cameras see the same ball. A camera that hangs upside down, or whose picture is mirrored, has bearings of the
//! other sign. At a few stops these fit a pose elsewhere, at other distances: by that pose the ball has another radius
//! than by those of all other cameras.

use calib_core::level::Elevation;
use nalgebra::Point2;

use super::estimate::CAMERAS;
use crate::{
    arithmetic::{root, sort},
    message::{MemberAddress, Mount, SIZE_SHARE, Seen, StopNumber},
};

/// Sightings of each camera: those in which the ball was widest. Their widths are known best.
const WIDEST: usize = 3;

/// Other cameras of which the radius is compared with that of one, at least.
const OTHERS: usize = 3;

/// Standard deviation of a lens's focal length, as a share.
const LENS_SHARE: f32 = 0.05;

/// Standard deviations beyond which a radius contradicts those of the others, of a pose that is told. Light, and what
/// hides a part of the ball, make sizes err by far more than their sigmas.
pub(super) const WRONG: f32 = 6.0;
/// The same of a pose that is looked at beside another one that fits as well.
pub(super) const UNLIKELY: f32 = 4.0;

/// Widest sightings of each camera.
#[derive(Debug, Default)]
pub(super) struct Sizes(heapless::Vec<(MemberAddress, heapless::Vec<Wide, WIDEST>), CAMERAS>);

/// A sighting without its bearing.
#[derive(Clone, Copy, Debug)]
struct Wide {
    stop: StopNumber,
    half_width: u16,
    elevation: Elevation,
    sigma: f32,
}

impl Wide {
    const fn seen(&self) -> Seen {
        Seen {
            half_width: self.half_width,
            ..Seen::direction(0.0, self.sigma).above(self.elevation)
        }
    }
}

/// Radius of the ball by one camera, in the unit of the site.
#[derive(Clone, Copy, Debug)]
pub(super) struct Radius {
    radius: f32,
    /// Variance of its relative error.
    variance: f32,
}

impl Sizes {
    /// A camera saw the ball at a stop.
    pub(super) fn on_seen(&mut self, camera: MemberAddress, stop: StopNumber, seen: &Seen) {
        let known = self.0.iter().position(|(of, _)| *of == camera);
        let place = known.unwrap_or(self.0.len());
        if known.is_none() && self.0.push((camera, heapless::Vec::new())).is_err() {
            return;
        }
        let Some((_, widest)) = self.0.get_mut(place) else {
            return;
        };
        if seen.half_width == 0 || widest.iter().any(|known| known.stop == stop) {
            return;
        }
        let wide = Wide {
            stop,
            half_width: seen.half_width,
            elevation: seen.elevation,
            sigma: seen.sigma,
        };
        if widest.is_full() {
            let least = widest.iter_mut().min_by_key(|known| known.half_width);
            if let Some(least) = least.filter(|least| least.half_width < wide.half_width) {
                *least = wide;
            }
        } else {
            let has_room = widest.push(wide);
            debug_assert!(has_room.is_ok(), "it is not full");
        }
    }

    /// Radius of the ball by a camera that stands here, `sigma` in its place. `None` if no size is known of it.
    pub(super) fn radius(
        &self,
        camera: MemberAddress,
        (stands, sigma): (Point2<f32>, f32),
        mount: Option<Mount>,
        mut place: impl FnMut(StopNumber) -> Option<Point2<f32>>,
    ) -> Option<Radius> {
        let (_, widest) = self.0.iter().find(|(of, _)| *of == camera)?;
        let (mut weights, mut sum, mut nearest) = (0.0, 0.0, f32::INFINITY);
        for wide in widest {
            let Some(place) = place(wide.stop) else {
                continue;
            };
            let along = root((place - stands).norm_squared());
            if let Some((radius, error)) = wide.seen().radius(along, mount) {
                let share = error / radius;
                let weight = 1.0 / (share * share + SIZE_SHARE * SIZE_SHARE);
                weights += weight;
                sum += weight * radius;
                nearest = nearest.min(along);
            }
        }
        let of_place = sigma / nearest;
        let variance = 1.0 / weights + LENS_SHARE * LENS_SHARE + of_place * of_place;
        let radius = sum / weights;
        (radius + variance)
            .is_finite()
            .then_some(Radius { radius, variance })
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

/// Returns true if the radius by one camera is more than so many standard deviations off that by most others.
pub(super) fn is_off(radii: &[Option<Radius>], camera: usize, gate: f32) -> bool {
    let Some(own) = radii.get(camera).copied().flatten() else {
        return false;
    };
    let mut others: heapless::Vec<f32, CAMERAS> = heapless::Vec::new();
    for (of, radius) in radii.iter().enumerate() {
        if let Some(radius) = radius
            && of != camera
        {
            let has_room = others.push(radius.radius);
            debug_assert!(has_room.is_ok(), "it has room for all");
        }
    }
    sort(&mut others, |a, b| a < b);
    // The median of a few is known about as well as one of them.
    let Some(median) = others.get(others.len() / 2) else {
        return false;
    };
    // The larger one is seen in the same way by a pose that is too far away and by one that is too near.
    let off = (own.radius - median) / own.radius.min(*median);
    others.len() >= OTHERS && off * off > gate * gate * 2.0 * own.variance
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras on a circle of 4 around the stops, and one that is believed to stand twice as far away.
    fn radii(wrong: Option<(usize, f32)>, widths: &[f32]) -> std::vec::Vec<Option<Radius>> {
        let mut sizes = Sizes::default();
        let stops = [[0.0, 0.3], [0.5, -0.4], [-0.6, 0.0], [0.2, 0.8]];
        let place = |stop: StopNumber| stops.get(usize::from(stop)).map(|at| Point2::from(*at));
        let mut radii = std::vec::Vec::new();
        for (camera, width) in (0_u16..).zip(widths) {
            let turn = f32::from(camera);
            let stands = Point2::new(4.0 * turn.cos(), 4.0 * turn.sin());
            for stop in 0..4 {
                let range = (place(stop).unwrap() - stands).norm();
                let seen = Seen::direction(0.0, 0.002).wide(width * 0.15 / range);
                sizes.on_seen(camera, stop, &seen);
                // Told again.
                sizes.on_seen(camera, stop, &seen);
            }
            let far = wrong.filter(|(of, _)| *of == usize::from(camera));
            let believed = stands * far.map_or(1.0, |(_, factor)| factor);
            radii.push(sizes.radius(camera, (believed, 0.1), None, place));
        }
        radii
    }

    #[test]
    fn a_camera_that_stands_elsewhere_sees_another_ball() {
        for factor in [2.5, 0.4] {
            let all = radii(Some((2, factor)), &[1.0; 5]);
            let off: std::vec::Vec<_> = (0..5).map(|camera| is_off(&all, camera, WRONG)).collect();
            assert_eq!(off, [false, false, true, false, false], "{factor}");
        }
        // Sizes that differ by a quarter are usual.
        let all = radii(None, &[1.0, 1.25, 0.8, 1.1, 1.0]);
        assert!((0..5).all(|camera| !is_off(&all, camera, UNLIKELY)));
        let radius = all[0].unwrap().radius;
        assert!((radius - 0.15).abs() < 0.005, "{radius}");
    }

    #[test]
    fn too_few_cameras_tell_nothing() {
        let all = radii(Some((2, 2.5)), &[1.0; 3]);
        assert!((0..3).all(|camera| !is_off(&all, camera, WRONG)));
        // A width of zero is not known.
        let all = radii(Some((2, 2.5)), &[1.0, 1.0, 0.0, 1.0, 1.0]);
        assert!(all[2].is_none() && !is_off(&all, 2, WRONG));
    }
}
