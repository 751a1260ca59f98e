//! First guesses of the places of stops.
//!
//! The walk is in parts: a part ends where a leg was not measured, as while a target restarts. Within a part dead
//! reckoning tells where the stops are. Each part but the first needs something else that ties it: bearings or a range of
//! cameras whose poses are known, or a mark. Until then its sightings do not count: a stop that is far from its place
//! would spoil the poses of the cameras.

use core::ops::Range;

use nalgebra::{Matrix2, Point2, Vector2};

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
        self.reckon(&part);
        let walked = self.stops.get(from).map(|stop| stop.place);
        self.shift(&part, place - walked.unwrap_or(place));
        self.place_parts();
    }

    /// Places a new stop by dead reckoning from the one before.
    pub(super) fn place_new(&mut self, stop: usize) {
        let before = { stop.checked_sub(1) }.and_then(|before| self.stops.get(before));
        let before = before.filter(|before| before.is_placed && self.is_measured(stop));
        let place = before.map(|before| before.place + self.way_to(stop));
        if let (Some(place), Some(stop)) = (place, self.stops.get_mut(stop)) {
            (stop.place, stop.is_placed) = (place, true);
        }
    }

    /// Places parts that are not placed yet, where something ties them. Returns true if there was one.
    #[inline(never)] // for less flash
    pub(super) fn place_parts(&mut self) -> bool {
        let mut is_changed = false;
        let is_waiting = |stop: &Stop<T>| !stop.is_placed;
        let mut from = 0;
        while let Some(next) = { self.stops.iter().skip(from) }.position(is_waiting) {
            let part = self.part(from + next);
            from = part.end;
            self.reckon(&part);
            if let Some(way) = self.tie(&part) {
                self.shift(&part, way);
                is_changed = true;
            }
        }
        is_changed
    }

    /// Number of parts that are not placed.
    pub(super) fn parts_without_place(&self) -> usize {
        let stops = self.stops.iter().enumerate();
        let waiting = stops.filter(|(n, stop)| !stop.is_placed && !self.is_measured(*n));
        waiting.count()
    }

    /// Returns the part to which a stop belongs.
    fn part(&self, stop: usize) -> Range<usize> {
        let begins = |stop: &usize| !self.is_measured(*stop);
        let first = (0..=stop).rev().find(begins).unwrap_or(0);
        let end = (stop + 1..self.stops.len()).find(begins);
        first..end.unwrap_or(self.stops.len())
    }

    /// Puts the stops of a part where they are if it begins at the origin.
    fn reckon(&mut self, part: &Range<usize>) {
        let mut at = Point2::origin();
        for stop in part.clone() {
            if stop > part.start {
                at += self.way_to(stop);
            }
            if let Some(stop) = self.stops.get_mut(stop) {
                stop.place = at;
            }
        }
    }

    /// Moves a part to its place.
    fn shift(&mut self, part: &Range<usize>, way: Vector2<T>) {
        for stop in self.stops.get_mut(part.clone()).unwrap_or_default() {
            stop.place += way;
            stop.is_placed = true;
        }
    }

    /// Way by which a part is to be moved, by a mark, by bearings or by a range.
    fn tie(&self, part: &Range<usize>) -> Option<Vector2<T>> {
        let of_mark = self.visits.iter().find_map(|visit| {
            let mark = self.visited(visit.mark)?;
            Some(mark.coords - self.in_part(part, visit.stop)?)
        });
        of_mark
            .or_else(|| self.cross(part))
            .or_else(|| self.measure_out(part))
    }

    /// Place of a stop if it is of a part.
    fn in_part(&self, part: &Range<usize>, stop: u16) -> Option<Vector2<T>> {
        let stop = usize::from(stop);
        let stop = self.stops.get(stop).filter(|_| part.contains(&stop))?;
        Some(stop.place.coords)
    }

    /// Way by which a part is to be moved so that the bearings of estimated cameras see it as it was walked: least squares
    /// of the distances between bearings and stops. `None` if bearings are too few, or nearly parallel.
    fn cross(&self, part: &Range<usize>) -> Option<Vector2<T>> {
        let mut normal = Matrix2::zeros();
        let mut right = Vector2::zeros();
        let mut way = None;
        let (mut all, mut away) = (0, 0);
        // The second time the place is known: do the bearings point there?
        for _ in 0..2 {
            for sight in self.sights.iter() {
                let walked = self.in_part(part, sight.stop);
                let seen = walked.and_then(|walked| Some((walked, self.seen_from(sight)?)));
                let Some((walked, (eye, ray))) = seen else {
                    continue;
                };
                let to_stop = walked - eye;
                if let Some(way) = way {
                    all += 1;
                    away += usize::from(!(plane::dot(way + to_stop, ray) > T::zero()));
                } else {
                    let across = plane::quarter_turn(ray);
                    normal += across * across.transpose();
                    right -= across * plane::dot(across, to_stop);
                }
            }
            if way.is_none() {
                let determinant = normal.determinant();
                let is_determined = determinant > lit(CROSSING * CROSSING);
                way = Some(normal.try_inverse().filter(|_| is_determined)? * right);
            }
        }
        way.filter(|_| away * POINTING_AWAY <= all)
    }

    /// Way by which a part is to be moved, by bearing and range of one camera.
    fn measure_out(&self, part: &Range<usize>) -> Option<Vector2<T>> {
        self.sights.iter().find_map(|range| {
            let walked = self.in_part(part, range.stop)?;
            let is_its = |sight: &&Sight<T>| {
                sight.is_bearing() && (sight.stop, sight.camera) == (range.stop, range.camera)
            };
            let bearing = self.sights.iter().find(is_its)?;
            let (eye, ray) = self.seen_from(bearing).filter(|_| !range.is_bearing())?;
            Some(eye + ray * (range.value * self.along_floor(range)?) - walked)
        })
    }

    /// Place of the camera of a bearing, and the direction in which it saw the target, if it counts.
    fn seen_from(&self, sight: &Sight<T>) -> Option<(Vector2<T>, Vector2<T>)> {
        let camera = usize::from(sight.camera);
        let [first, last] = self.common.window;
        let counts = sight.is_bearing()
            && self.is_estimated(camera)
            && self.counts(camera, sight)
            && (first..=last).contains(&sight.stop);
        let pose = self.camera(camera).filter(|_| counts)?;
        let (bearing, _) = self.bearing_at(sight);
        Some((pose.xy(), plane::unit(pose.z + bearing)))
    }

    /// Puts a mark where it was visited first.
    pub(super) fn find_mark(&mut self, mark: usize) {
        let place = u16::try_from(mark).ok().and_then(|mark| self.visited(mark));
        if let (Some(place), Some(mark)) = (place, self.marks.get_mut(mark)) {
            mark.put(place.coords);
        }
    }

    /// Place of the first visit to a mark at a stop that is placed.
    fn visited(&self, mark: u16) -> Option<Point2<T>> {
        let mut visits = self.visits.iter().filter(|visit| visit.mark == mark);
        visits.find_map(|visit| self.placed(visit.stop))
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
}
