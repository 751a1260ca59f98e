//! Where a person can stand: inside the world, or the area that was walked so far where no world is told, and
//! where one can walk to without going through a wall.

use nalgebra::{Point2, Vector2};

use super::{
    RunRecord,
    next_stop::RADIUS,
    verdict::{Edge, Floor, edges, is_free},
};

/// Places of one network at which its target can stop.
pub(super) struct Standing {
    /// Corners of a convex area, counter-clockwise; none: anywhere.
    area: Vec<Point2<f64>>,
    margin: f64,
    /// Places where targets were or should have been. A place that is farther from all of them than a camera sees
    /// is no place at all, but in the view of a pose that is far off.
    been: Vec<Point2<f64>>,
    range: f64,
    edges: Vec<Edge>,
    floor: Option<(Floor, Vec<bool>)>,
}

impl Standing {
    pub(super) fn of(record: &RunRecord, network: u16) -> Self {
        let targets = record.targets.iter().filter(|t| t.network == network);
        let been: Vec<Point2<f64>> = targets
            .flat_map(|target| {
                let stops = target.stops.iter().map(|stop| Point2::new(stop.x, stop.y));
                let path = target.path.iter().map(|&place| Point2::from(place));
                path.chain(stops)
            })
            .collect();
        let own = || record.cameras().filter(|camera| camera.network == network);
        let range = own().filter_map(|camera| Some(camera.view?.range));
        let range = range.reduce(f64::max).unwrap_or(f64::INFINITY);
        let told = record.area_of(network);
        let area = match told.is_empty() {
            false => hull(told),
            // Cameras hang on the walls of what is walked.
            true => {
                let sound = own().filter(|camera| camera.is_calibrated());
                let put = sound.filter_map(|camera| Some(camera.estimate?.pose().position));
                let all = been.iter().copied().chain(put);
                hull(all.collect())
            }
        };
        let obstacles = record.obstacles_of(network);
        let edges = edges(&obstacles);
        let floor = been.first().filter(|_| !obstacles.is_empty()).map(|eye| {
            let mut closed = edges.clone();
            closed.extend(
                area.iter()
                    .copied()
                    .zip(area.iter().copied().cycle().skip(1)),
            );
            let fine = range.min(2.0 * narrowest(&area));
            let floor = Floor::around(&been, *eye, fine, &closed);
            let reached = floor.reached(&been);
            (floor, reached)
        });
        Self {
            area,
            margin: RADIUS * range.min(1e9),
            been,
            range,
            edges,
            floor,
        }
    }

    /// Returns true if a person can stand there.
    pub(super) fn holds(&self, place: Point2<f64>) -> bool {
        let ends = self.area.iter().zip(self.area.iter().cycle().skip(1));
        let is_inside = { ends }.all(|(a, b)| {
            let side: Vector2<f64> = b - a;
            side.perp(&(place - a)) >= self.margin.min(0.25 * narrowest(&self.area)) * side.norm()
        });
        let is_near = |been: &Point2<f64>| (place - been).norm() < self.range;
        let walks = |been: &Point2<f64>| is_near(been) && is_free(&self.edges, *been, place);
        let is_reached = || {
            self.floor.as_ref().is_none_or(|(floor, reached)| {
                let square = floor.square(place).filter(|&square| reached[square]);
                square.is_some_and(|square| is_free(&self.edges, floor.middle(square), place))
                    || self.been.iter().any(walks)
            })
        };
        is_inside && (self.been.is_empty() || self.been.iter().any(is_near)) && is_reached()
    }
}

/// The least extent of a convex outline, infinite of none.
fn narrowest(area: &[Point2<f64>]) -> f64 {
    let ends = area.iter().zip(area.iter().cycle().skip(1));
    let extents = ends.map(|(a, b)| {
        let side = (b - a).normalize();
        { area.iter().map(|corner| side.perp(&(corner - a))) }.fold(0.0, f64::max)
    });
    extents.fold(f64::INFINITY, f64::min)
}

/// The convex hull, counter-clockwise; empty if it has no area. Andrew 1979.
fn hull(mut places: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    places.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    places.dedup();
    let half = |places: &mut dyn Iterator<Item = &Point2<f64>>| {
        let mut chain: Vec<Point2<f64>> = Vec::new();
        for &place in places {
            while let [.., a, b] = chain[..]
                && (b - a).perp(&(place - a)) <= 0.0
            {
                chain.pop();
            }
            chain.push(place);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut places.iter());
    all.extend(half(&mut places.iter().rev()));
    if all.len() < 3 { Vec::new() } else { all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_goes_round_the_outermost_places() {
        let p = Point2::new;
        let places = vec![
            p(1.0, 1.0),
            p(0.0, 0.0),
            p(2.0, 0.0),
            p(2.0, 2.0),
            p(0.0, 2.0),
        ];
        let around = [p(0.0, 0.0), p(2.0, 0.0), p(2.0, 2.0), p(0.0, 2.0)];
        assert_eq!(hull(places), around);
        assert_eq!(hull(vec![p(0.0, 0.0), p(1.0, 1.0), p(2.0, 2.0)]), []);
        assert!((narrowest(&around) - 2.0).abs() < 1e-12);
    }
}
