//! Geometry from scenarios: cameras and the stops that they see, in the frame of the references.

use std::f64::consts::TAU;

use anyhow::Context;
use calib_core::{Ray, camera::Camera};
use nalgebra::Point2;
use site::{Scenario, Site};
use test_support::{
    Truth, generator, normal,
    walk::{CarrierErrors, SeenAt, Walk},
};

/// Errors of bearings.
#[derive(Clone, Copy, Debug)]
pub(super) enum Bearings {
    /// By a normal error of this standard deviation, radians.
    Gaussian(f64),
    /// They are those of whole columns of the camera's picture.
    WholeColumns,
}

/// A site put up, seen from its references.
pub(super) struct Setting {
    cameras: Vec<Truth>,
    models: Vec<Camera<f64>>,
    places: Vec<Point2<f64>>,
    /// Stop and camera.
    seen: Vec<(usize, usize)>,
}

impl Setting {
    pub(super) fn new(scenario: &Scenario) -> anyhow::Result<Self> {
        let (_, site) = scenario.rehearsed()?;
        Self::of(&site)
    }

    fn of(site: &Site) -> anyhow::Result<Self> {
        let network = site.networks.first().context("a network")?;
        let target = network.targets.first().context("a target")?;
        let frame = &network.frame;
        let [first, second] = network.references;
        let others = (0..network.cameras.len()).filter(|n| !network.references.contains(n));
        let order: Vec<usize> = [first, second].into_iter().chain(others).collect();
        let nodes: Vec<_> = order.iter().map(|&n| &network.cameras[n]).collect();
        let cameras = nodes.iter().map(|node| {
            let camera = &site.world.cameras()[node.index];
            let place = frame.place(camera.place);
            Truth {
                x: place.x,
                y: place.y,
                heading: frame.direction(camera.heading),
            }
        });
        let radius = site.world.targets()[target.index].radius;
        let mut seen = Vec::new();
        for (stop, &place) in target.stops.iter().enumerate() {
            for (n, node) in nodes.iter().enumerate() {
                let sight = site.world.sight(node.index, place, radius);
                if sight.is_some_and(|sight| sight.is_whole()) {
                    seen.push((stop, n));
                }
            }
        }
        Ok(Self {
            cameras: cameras.collect(),
            models: nodes.iter().map(|node| node.model).collect(),
            places: target
                .stops
                .iter()
                .map(|&place| frame.place(place))
                .collect(),
            seen,
        })
    }

    /// Measurements of the walk.
    pub(super) fn measured(&self, seed: u64, carrier: CarrierErrors, bearings: Bearings) -> Walk {
        let mut rng = generator(seed ^ 0x6a6f_696e_7400);
        let seen = self.seen.iter().map(|&(stop, camera)| {
            let truth = self.cameras[camera].bearing_of(self.places[stop]);
            let (bearing, sigma) = match bearings {
                Bearings::Gaussian(sigma) => (truth + sigma * normal(&mut rng), sigma),
                Bearings::WholeColumns => {
                    let model = &self.models[camera];
                    let column = model.column(Ray::from_bearing(truth));
                    let column = column.map_or(0.0, f64::round);
                    (model.bearing(column), model.whole_pixel_sigma(column))
                }
            };
            SeenAt {
                stop,
                camera,
                bearing,
                sigma,
            }
        });
        let bearings = seen.collect();
        let mut walk = Walk {
            cameras: self.cameras.clone(),
            places: self.places.clone(),
            carrier: [1.0, 0.0],
            errors: carrier,
            legs: Vec::new(),
            bearings,
            ranges: Vec::new(),
            visits: Vec::new(),
            lens_sigma: 0.0,
            principal_sigma: 0.0,
        };
        walk.carry(&mut rng);
        walk
    }
}

/// An angle's error in degrees.
pub(super) fn degrees_off(a: f64, b: f64) -> f64 {
    let turns = (a - b) / TAU;
    (turns - turns.round()) * 360.0
}
