//! Test of whether a camera could have seen the target.

use std::collections::VecDeque;

use calib_core::angle;
use nalgebra::{Point2, Vector2};

use super::super::{Node, RunRecord, Stop};

/// Part of the target's way that a camera has in view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InView {
    /// So many of the stops.
    Stops(usize),
    /// It has no stop in view, but places to which the target can be led.
    Elsewhere,
    /// No place to which the target can be led: walls are all around.
    Sealed,
    /// The place of the camera, or the target's way, is not known.
    Unknown,
}

/// Part of its view in which a camera sees a whole ball for certain.
const WHOLE: f64 = 0.9;
/// Time within which cameras tell what they saw at a stop, seconds.
const TOLD_WITHIN: f64 = 15.0;
/// Squares of the floor in one range of the camera.
const SQUARES: f64 = 16.0;
/// Squares of the floor at most, along each side.
const MOST: usize = 256;
/// Parts of the field of view, and of the range, in which it is looked for places.
const PARTS: i32 = 8;

/// Of a camera.
pub(super) fn of(record: &RunRecord, camera: &Node) -> InView {
    let (Some(place), Some(view)) = (camera.truth.or(camera.planned), camera.view) else {
        return InView::Unknown;
    };
    let targets = || { record.targets.iter() }.filter(|t| t.network == camera.network);
    let way: Vec<Point2<f64>> = targets()
        .flat_map(|target| {
            let stops = target.stops.iter().map(Stop::place);
            let path = target.path.iter().map(|&place| Point2::from(place));
            stops.chain(path)
        })
        .collect();
    if way.is_empty() {
        return InView::Unknown;
    }
    let edges = edges(&record.obstacles_of(camera.network));
    let (eye, heading) = (place.position(), place.heading_deg.to_radians());
    let half = (view.fov_deg / 2.0).to_radians();
    let sees = |place: Point2<f64>, part: f64| {
        let d: Vector2<f64> = place - eye;
        d.norm() < part * view.range
            && angle::wrap_signed(d.y.atan2(d.x) - heading).abs() < part * half
            && is_free(&edges, eye, place)
    };
    // A stop stands in both lists where it was made. Of the one where the target stands, cameras may tell yet.
    let stands = |stop: &Stop| {
        stop.seconds
            .is_some_and(|at| record.sim_seconds - at < TOLD_WITHIN)
    };
    let stops = targets().flat_map(|target| &target.stops);
    let now: Vec<_> = stops.filter(|stop| stands(stop)).map(Stop::place).collect();
    let is_one = |a: Point2<f64>, b: Point2<f64>| (a - b).norm() < 0.05 * view.range;
    let mut seen: Vec<Point2<f64>> = Vec::new();
    for &place in way.iter().filter(|&&place| sees(place, WHOLE)) {
        let is_known = seen.iter().chain(&now).any(|&other| is_one(place, other));
        seen.extend((!is_known).then_some(place));
    }
    if !seen.is_empty() {
        return InView::Stops(seen.len());
    }
    if !now.is_empty() {
        return InView::Unknown;
    }
    let floor = Floor::around(&way, eye, view.range, &edges);
    let reached = floor.reached(&way);
    let mut places = (-PARTS..=PARTS).flat_map(|turn| {
        let (sin, cos) = (heading + half * f64::from(turn) / f64::from(PARTS + 1)).sin_cos();
        let ray = Vector2::new(cos, sin) * view.range;
        (1..PARTS).map(move |part| eye + ray * (f64::from(part) / f64::from(PARTS)))
    });
    if places.any(|place| sees(place, 1.0) && floor.square(place).is_some_and(|n| reached[n])) {
        InView::Elsewhere
    } else {
        InView::Sealed
    }
}

pub(in crate::record) type Edge = (Point2<f64>, Point2<f64>);

pub(in crate::record) fn edges(obstacles: &[Vec<Point2<f64>>]) -> Vec<Edge> {
    let outlines = obstacles.iter();
    outlines
        .flat_map(|corners| {
            let next = corners.iter().cycle().skip(1);
            corners.iter().copied().zip(next.copied())
        })
        .collect()
}

pub(in crate::record) fn is_free(edges: &[Edge], from: Point2<f64>, to: Point2<f64>) -> bool {
    !edges.iter().any(|&(a, b)| crosses(from, to, a, b))
}

/// The floor in squares.
pub(in crate::record) struct Floor {
    corner: Point2<f64>,
    side: f64,
    columns: usize,
    rows: usize,
    edges: Vec<Edge>,
}

impl Floor {
    pub(in crate::record) fn around(
        way: &[Point2<f64>],
        eye: Point2<f64>,
        range: f64,
        edges: &[Edge],
    ) -> Self {
        let ends = edges.iter().map(|(a, _)| *a);
        let all = way.iter().copied().chain(ends).chain([eye]);
        let (mut low, mut high) = (eye, eye);
        for place in all {
            low = low.inf(&place);
            high = high.sup(&place);
        }
        // A way around everything is within a range of it.
        let margin = Vector2::repeat(range);
        let (low, high) = (low - margin, high + margin);
        let widest = (high - low).max();
        let side = (range / SQUARES).max(widest / MOST as f64);
        let count = |length: f64| (length / side).ceil().max(1.0) as usize;
        Self {
            corner: low,
            side,
            columns: count(high.x - low.x),
            rows: count(high.y - low.y),
            edges: edges.to_vec(),
        }
    }

    pub(in crate::record) fn square(&self, place: Point2<f64>) -> Option<usize> {
        let d = (place - self.corner) / self.side;
        let is_inside = d.x >= 0.0 && d.y >= 0.0;
        let (column, row) = (d.x as usize, d.y as usize);
        (is_inside && column < self.columns && row < self.rows)
            .then_some(row * self.columns + column)
    }

    pub(in crate::record) fn middle(&self, square: usize) -> Point2<f64> {
        let (row, column) = (square / self.columns, square % self.columns);
        let middle = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
        self.corner + middle * self.side
    }

    /// The squares to which one can walk from somewhere on the way.
    pub(in crate::record) fn reached(&self, way: &[Point2<f64>]) -> Vec<bool> {
        let mut reached = vec![false; self.columns * self.rows];
        let mut begun = VecDeque::new();
        for &place in way {
            if let Some(square) = self.square(place)
                && !reached[square]
                && is_free(&self.edges, place, self.middle(square))
            {
                reached[square] = true;
                begun.push_back(square);
            }
        }
        while let Some(square) = begun.pop_front() {
            let (row, column) = (square / self.columns, square % self.columns);
            let beside = [
                (column > 0).then(|| square - 1),
                (column + 1 < self.columns).then(|| square + 1),
                (row > 0).then(|| square - self.columns),
                (row + 1 < self.rows).then(|| square + self.columns),
            ];
            for next in beside.into_iter().flatten() {
                if !reached[next] && is_free(&self.edges, self.middle(square), self.middle(next)) {
                    reached[next] = true;
                    begun.push_back(next);
                }
            }
        }
        reached
    }
}

/// Returns true if two segments cross.
fn crosses(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>, d: Point2<f64>) -> bool {
    let side = |from: Point2<f64>, to: Point2<f64>, p: Point2<f64>| (to - from).perp(&(p - from));
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_segments_that_meet_between_their_ends_cross() {
        let p = Point2::new;
        assert!(crosses(p(0.0, 0.0), p(2.0, 2.0), p(0.0, 2.0), p(2.0, 0.0)));
        assert!(!crosses(p(0.0, 0.0), p(2.0, 2.0), p(3.0, 0.0), p(5.0, 9.0)));
        assert!(!crosses(p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(1.0, 1.0)));
    }
}
