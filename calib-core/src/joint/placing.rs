//! First guesses of the places of stops.
//!
//! The walk is in parts: a part ends where a leg was not measured, as while a target restarts. Within a part dead
//! reckoning tells where the stops are. Each part but the first needs something else that ties it: bearings or a range of
//! cameras whose poses are known, or a mark. Until then its sightings do not count: a stop that is far from its place
//! would spoil the poses of the cameras.

use core::ops::Range;

use nalgebra::{Matrix2, Point2, Vector2, Vector3};

use super::problem::{Problem, Sight, Stop};
use crate::{
    Real,
    numerics::{plane, real::lit},
};

/// Sine of the least angle between two bearings that tell a place.
const CROSSING: f64 = 0.05;
/// One bearing of so many may point away from the place that all together tell.
const POINTING_AWAY: usize = 4;

impl<T: Real> Problem<'_, T> {
    /// Places all stops: those of one part by dead reckoning from one stop, the others by what ties them to the cameras that
    /// are estimated.
    pub(super) fn place_from(&mut self, from: usize, place: Point2<T>) {
        for stop in self.stops.iter_mut() {
            stop.is_placed = false;
        }
        let part = self.part(from);
        self.reckon(part, from, place);
        self.place_parts();
    }

    /// Places a new stop by dead reckoning from the one before.
    pub(super) fn place_new(&mut self, stop: usize) {
        let before = { stop.checked_sub(1) }.and_then(|before| self.stops.get(before));
        let before = before.filter(|before| before.is_placed && self.is_measured(stop));
        if let Some(place) = before.map(|before| before.place) {
            self.put(stop, place + self.way_to(stop));
        }
    }

    /// Places parts that are not placed yet, where something ties them. Returns true if there was one.
    pub(super) fn place_parts(&mut self) -> bool {
        let mut is_changed = false;
        let is_waiting = |stop: &Stop<T>| !stop.is_placed;
        let mut from = 0;
        while let Some(next) = { self.stops.iter().skip(from) }.position(is_waiting) {
            let part = self.part(from + next);
            from = part.end;
            if let Some((stop, place)) = self.tie(part.clone()) {
                self.reckon(part, stop, place);
                is_changed = true;
            }
        }
        is_changed
    }

    /// Number of parts that are not placed.
    pub(super) fn parts_without_place(&self) -> usize {
        let is_first = |stop: &usize| !self.is_measured(*stop);
        let stops = (0_u16..).zip(0..self.stops.len());
        let waiting =
            stops.filter(|(number, stop)| is_first(stop) && self.placed(*number).is_none());
        waiting.count()
    }

    /// Returns the part to which a stop belongs.
    fn part(&self, stop: usize) -> Range<usize> {
        let begins = |stop: &usize| !self.is_measured(*stop);
        let first = (0..=stop).rev().find(begins).unwrap_or(0);
        let end = (stop + 1..self.stops.len()).find(begins);
        first..end.unwrap_or(self.stops.len())
    }

    /// Places a part by dead reckoning from one of its stops.
    fn reckon(&mut self, part: Range<usize>, from: usize, place: Point2<T>) {
        let mut at = place;
        for stop in from..part.end {
            if stop > from {
                at += self.way_to(stop);
            }
            self.put(stop, at);
        }
        at = place;
        for stop in (part.start..from).rev() {
            at -= self.way_to(stop + 1);
            self.put(stop, at);
        }
    }

    /// Place of one stop of a part, by a mark, by bearings or by a range.
    fn tie(&self, part: Range<usize>) -> Option<(usize, Point2<T>)> {
        let of_mark = self.visits.iter().find_map(|visit| {
            let stop = usize::from(visit.stop);
            let place = part.contains(&stop).then(|| self.mark_place(visit.mark))?;
            Some((stop, place?))
        });
        of_mark
            .or_else(|| self.cross(part.clone()))
            .or_else(|| self.measure_out(part))
    }

    /// The first stop of a part, at the place from which the bearings of estimated cameras see the part as it was walked:
    /// least squares of the distances between bearings and stops. `None` if bearings are too few, or nearly parallel.
    fn cross(&self, part: Range<usize>) -> Option<(usize, Point2<T>)> {
        let mut normal = Matrix2::zeros();
        let mut right = Vector2::zeros();
        self.each_ray(&part, |eye, ray, walked| {
            let across = plane::quarter_turn(ray);
            normal += across * across.transpose();
            right += across * plane::dot(across, eye - walked);
        });
        let determinant = normal.determinant();
        if !(determinant > lit(CROSSING * CROSSING)) {
            return None;
        }
        let place = normal.try_inverse()? * right;
        let (mut all, mut away) = (0, 0);
        self.each_ray(&part, |eye, ray, walked| {
            all += 1;
            away += usize::from(!(plane::dot(place + walked - eye, ray) > T::zero()));
        });
        (away * POINTING_AWAY <= all).then_some((part.start, place.into()))
    }

    /// Calls a function for each bearing of an estimated camera at a stop of a part: with the place of the camera, the
    /// direction, and the way from the first stop of the part.
    fn each_ray(
        &self,
        part: &Range<usize>,
        mut see: impl FnMut(Vector2<T>, Vector2<T>, Vector2<T>),
    ) {
        let mut walked = Vector2::zeros();
        for stop in part.clone() {
            if stop > part.start {
                walked += self.way_to(stop);
            }
            for sight in self.sights.iter() {
                if usize::from(sight.stop) == stop
                    && sight.is_bearing()
                    && let Some((pose, bearing)) = self.seen_from(sight)
                {
                    see(pose.xy(), plane::unit(pose.z + bearing), walked);
                }
            }
        }
    }

    /// A stop of a part from bearing and range of one camera.
    fn measure_out(&self, part: Range<usize>) -> Option<(usize, Point2<T>)> {
        self.sights.iter().find_map(|range| {
            let stop = usize::from(range.stop);
            if range.is_bearing() || !part.contains(&stop) {
                return None;
            }
            let is_its = |sight: &&Sight<T>| {
                sight.is_bearing() && (sight.stop, sight.camera) == (range.stop, range.camera)
            };
            let (pose, bearing) = self.seen_from(self.sights.iter().find(is_its)?)?;
            let range = range.value * self.along_floor(range)?;
            let place = pose.xy() + plane::unit(pose.z + bearing) * range;
            Some((stop, place.into()))
        })
    }

    /// Pose of the camera of a bearing, and the bearing, if both count.
    fn seen_from(&self, sight: &Sight<T>) -> Option<(Vector3<T>, T)> {
        let camera = usize::from(sight.camera);
        let [first, last] = self.common.window;
        let counts = self.is_estimated(camera)
            && self.counts(camera, sight)
            && (first..=last).contains(&sight.stop);
        let pose = self.camera(camera).filter(|_| counts)?;
        Some((pose, self.bearing_at(sight).0))
    }

    /// Puts a mark where it was visited first.
    pub(super) fn find_mark(&mut self, mark: usize) {
        let place = u16::try_from(mark).ok().and_then(|mark| self.visited(mark));
        if let (Some(place), Some(mark)) = (place, self.marks.get_mut(mark)) {
            mark.put(place.coords);
        }
    }

    /// Place of a mark, if the target visited it at a stop that is placed.
    fn mark_place(&self, mark: u16) -> Option<Point2<T>> {
        self.visited(mark)?;
        Some(self.marks.get(usize::from(mark))?.place().into())
    }

    /// Place of the first visit to a mark.
    fn visited(&self, mark: u16) -> Option<Point2<T>> {
        self.visits.iter().find_map(|visit| {
            let stop = self.stops.get(usize::from(visit.stop))?;
            (visit.mark == mark && stop.is_placed).then_some(stop.place)
        })
    }

    /// Returns true if the leg to a stop was measured.
    fn is_measured(&self, stop: usize) -> bool {
        let is_measured = |stop: &Stop<T>| stop.root != [T::zero(); 3];
        self.stops.get(stop).is_some_and(is_measured)
    }

    fn way_to(&self, stop: usize) -> Vector2<T> {
        let stop = self.stops.get(stop);
        stop.map_or_else(Vector2::zeros, |stop| self.true_way(stop.displacement))
    }

    fn put(&mut self, stop: usize, place: Point2<T>) {
        if let Some(stop) = self.stops.get_mut(stop) {
            stop.place = place;
            stop.is_placed = true;
        }
    }
}
