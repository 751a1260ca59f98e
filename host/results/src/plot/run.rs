//! Drawings of one run: a map like the thesis's Figures 4.2 to 4.8, errors against predicted
//! sigmas, and residuals.

use calib_core::Pose;
use nalgebra::{Matrix3, Point2, Vector2};

use super::{
    ALL_NAMED, PlotError,
    cameras::{Worth, behind, draw_arrow, draw_estimate},
    canvas::{
        BAD, CAMERA, Colour, Entry, GREY, INK, Mark, Plane, TARGET, area, bar, dot, line, ring,
        text,
    },
    count, keep_clear,
    labels::Labels,
    panels::Panels,
    seen::{self, Wall},
    view::View,
};
use crate::accuracy::quantile;
use crate::record::{Node, RunRecord};

/// Factors by which errors and ellipses may be enlarged in a drawing.
const TIMES: [f64; 7] = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0];
/// Size that a usual ellipse's longer half axis, and the largest error, should have, pixels.
const WELL_VISIBLE: f64 = 16.0;
const TOO_FAR: f64 = 70.0;
/// Up to so many stops all have their numbers; of more, those for whose numbers there is room.
const ALL_NUMBERED: usize = 60;
/// Colours of networks: of their cameras and views. They begin again when there are more networks.
const NETWORKS: [Colour; 8] = [
    "#00798C", "#8C564B", "#6B7A00", "#6A4C93", "#2E8B57", "#5A6E8C", "#B0567A", "#555555",
];

/// The map of a run: true cameras with what they see past walls, estimates with 95 % ellipses, the
/// targets' ways, their true and believed stops, and obstacles. Where estimates would hide behind
/// the truth, errors and ellipses are drawn larger than they are, and the map says so. Several
/// networks, each of which knows places in its own frame only, are drawn where they really are, each in a colour
/// and with its number. All is in the frame of the site's file, or of the first network where that is not known.
///
/// # Errors
/// [`PlotError`]
pub fn map(record: &RunRecord) -> Result<String, PlotError> {
    match record.in_building() {
        Some(record) => map_in_one_frame(&record),
        None if record.has_networks() => map_in_one_frame(&record.in_one_frame()),
        None => map_in_one_frame(record),
    }
}

fn map_in_one_frame(record: &RunRecord) -> Result<String, PlotError> {
    let cameras = record.cameras().filter_map(|camera| {
        let place = place(camera)?;
        Some((camera, place, Worth::of_node(camera)))
    });
    let cameras: Vec<Drawn<'_>> = cameras.collect();
    let first = record.networks.first().map_or(1, |network| network.network);
    let obstacles = record.obstacles_of(first);
    let edges = obstacles.iter().flat_map(|outline| {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(&a, &b)| [a, b])
    });
    let walls: Vec<Wall> = edges.collect();
    let views: Vec<(u16, Vec<Point2<f64>>)> = cameras
        .iter()
        .filter_map(|(camera, pose, _)| {
            let view = camera.view?;
            let half = (view.fov_deg / 2.0).to_radians();
            let seen = seen::outline(pose.position, pose.heading, half, view.range, &walls);
            Some((camera.network, seen))
        })
        .collect();

    let stops = record.targets.iter().flat_map(|target| &target.stops);
    let ways = record.targets.iter().flat_map(|target| &target.path);
    let mut others: Vec<Point2<f64>> = ways.map(|&corner| corner.into()).collect();
    others.extend(stops.map(|stop| Point2::new(stop.x, stop.y)));
    others.extend(
        obstacles
            .iter()
            .chain(views.iter().map(|(_, seen)| seen))
            .flatten(),
    );
    let positions: Vec<_> = cameras.iter().map(|(_, pose, _)| pose.position).collect();
    let view = View::of(&positions, &others)?;
    let map = RunMap {
        record,
        times: magnification(&cameras, &view),
        cameras,
        view,
    };
    let (canvas, mut plane) = view.map(&record.title(), &map.legend(), &record.unit.name)?;
    for (network, seen) in &views {
        let seen: Vec<_> = seen.iter().map(|&corner| plane.place(corner)).collect();
        let colour = map.network_colour(*network).unwrap_or(CAMERA);
        plane.add(area(&seen, colour, [0.05, 0.16]));
    }
    for outline in &obstacles {
        let outline: Vec<_> = outline.iter().map(|&corner| plane.place(corner)).collect();
        plane.add(area(&outline, INK, [0.35, 0.8]).set("stroke-width", 1.5));
    }
    map.draw_network_numbers(&mut plane);
    let mut labels = Labels::default();
    map.draw_targets(&mut plane, &mut labels);
    for camera in &map.cameras {
        map.draw_camera(&mut plane, &mut labels, camera);
    }
    map.draw_names(&mut plane, &mut labels);
    map.draw_stop_numbers(&mut plane, &mut labels);
    Ok(canvas.finish([plane]))
}

/// A camera, where it is drawn, and what its estimate is worth.
type Drawn<'a> = (&'a Node, Pose<f64>, Worth);

/// Where a camera is drawn: its true pose, otherwise its estimate.
fn place(camera: &Node) -> Option<Pose<f64>> {
    let truth = camera.truth.map(|truth| Pose {
        position: truth.position(),
        heading: truth.heading_deg.to_radians(),
        covariance: Matrix3::zeros(),
    });
    truth.or_else(|| camera.estimate.map(|estimate| estimate.pose()))
}

fn magnification(cameras: &[Drawn<'_>], view: &View) -> f64 {
    let estimates = cameras.iter().filter_map(|(camera, ..)| camera.estimate);
    let mut axes: Vec<f64> = estimates
        .map(|estimate| estimate.pose().ellipse(0.95).semi_major * view.scale)
        .collect();
    axes.sort_unstable_by(f64::total_cmp);
    let errors = cameras.iter().filter_map(|(camera, ..)| camera.error);
    let largest = errors
        .map(|e| e.x.hypot(e.y) * view.scale)
        .chain(quantile(&axes, 0.9))
        .fold(0.0, f64::max);
    let usual = quantile(&axes, 0.5).unwrap_or(WELL_VISIBLE);
    let fits = |times: &f64| times * usual <= WELL_VISIBLE && times * largest <= TOO_FAR;
    TIMES.into_iter().find(fits).unwrap_or(1.0)
}

struct RunMap<'a> {
    record: &'a RunRecord,
    cameras: Vec<Drawn<'a>>,
    view: View,
    times: f64,
}

impl RunMap<'_> {
    fn legend(&self) -> Vec<Entry> {
        let mut legend = vec![Entry::new("true camera, what it sees", Mark::Ring, INK)];
        legend.extend(count(&self.cameras.iter().map(|(.., worth)| *worth)));
        legend.push(Entry::remark("ellipse: 95 %"));
        if self.cameras.iter().any(|(camera, ..)| camera.reference) {
            legend.push(Entry::remark("* reference"));
        }
        legend.push(Entry::dot("way and stops, ring: believed", TARGET));
        let is_placed = self.record.is_in_building();
        if self.record.has_networks() {
            let count = self.record.networks.len();
            let frame = if is_placed {
                ""
            } else {
                ", frame of the first"
            };
            legend.push(Entry::remark(format!(
                "{count} networks where they really are{frame}"
            )));
        } else if !is_placed {
            legend.push(Entry::remark(
                "x, y from the first reference, x towards the second",
            ));
        }
        if self.times > 1.0 {
            legend.push(Entry::remark(format!(
                "errors and ellipses drawn {} x",
                self.times
            )));
        }
        legend
    }

    fn is_large(&self) -> bool {
        self.cameras.len() > ALL_NAMED
    }

    /// Of one among several.
    fn network_colour(&self, network: u16) -> Option<Colour> {
        let mut networks = self.record.networks.iter();
        let place = networks.position(|other| other.network == network)?;
        let colour = NETWORKS[place % NETWORKS.len()];
        self.record.has_networks().then_some(colour)
    }

    /// Large and faint, in the middle of the cameras.
    fn draw_network_numbers(&self, plane: &mut Plane) {
        for network in &self.record.networks {
            let number = network.network;
            let own = self.cameras.iter().filter(|(c, ..)| c.network == number);
            let places: Vec<_> = own.map(|(_, pose, _)| pose.position.coords).collect();
            if let Some(colour) = self.network_colour(number) {
                let middle = places.iter().sum::<Vector2<f64>>() / places.len().max(1) as f64;
                let number = text(number, plane.place(middle.into()), 64.0);
                plane.add(number.set("fill", colour).set("fill-opacity", 0.3));
            }
        }
    }

    fn draw_targets(&self, plane: &mut Plane, labels: &mut Labels) {
        for target in &self.record.targets {
            let way: Vec<_> = target.path.iter().map(|&[x, y]| plane.at(x, y)).collect();
            plane.add(line(&way, TARGET, 1.0).set("stroke-opacity", 0.45));
            for stop in &target.stops {
                let place = Point2::new(stop.x, stop.y);
                let at = plane.place(place);
                labels.keep_clear(at, 4.0);
                plane.add(dot(at, 2.5, TARGET));
                if let Some(believed) = &stop.believed {
                    let off = Vector2::new(believed.x, believed.y) - place.coords;
                    let drawn = plane.place(place + off * self.times);
                    labels.keep_clear(drawn, 5.0);
                    plane.add(line(&[at, drawn], TARGET, 1.0));
                    plane.add(ring(drawn, 4.5, TARGET).set("stroke-width", 1.0));
                }
            }
        }
    }

    fn draw_camera(
        &self,
        plane: &mut Plane,
        labels: &mut Labels,
        (camera, truth, worth): &Drawn<'_>,
    ) {
        let at = plane.place(truth.position);
        keep_clear(labels, at, truth.heading);
        let colour = match worth {
            _ if camera.estimate.is_some() => self.network_colour(camera.network).unwrap_or(INK),
            Worth::NotPlanned => GREY,
            _ => INK,
        };
        draw_arrow(plane, at, truth.heading, colour);
        match &camera.estimate {
            Some(estimate) => {
                plane.add(Mark::Ring.draw(at, 4.0, colour));
                let mut pose = estimate.pose();
                pose.position = truth.position + (pose.position - truth.position) * self.times;
                labels.keep_clear(plane.place(pose.position), 4.0);
                draw_estimate(
                    plane,
                    &pose,
                    self.view.scale * self.times,
                    *worth,
                    self.is_large(),
                );
            }
            None => plane.add(worth.mark().draw(at, 5.0, worth.colour())),
        }
    }

    fn draw_names(&self, plane: &mut Plane, labels: &mut Labels) {
        // References, and cameras that need care, are named first.
        let mut cameras: Vec<&Drawn<'_>> = self.cameras.iter().collect();
        cameras.sort_by_key(|(camera, _, worth)| (!camera.reference, std::cmp::Reverse(*worth)));
        for (camera, pose, _) in cameras {
            let name = name(camera);
            let (at, favourite) = (plane.place(pose.position), behind(pose.heading));
            let must = !self.is_large();
            if let Some(place) = labels.place(name.len(), 13.0, at, favourite, must) {
                plane.add(text(name, place, 13.0));
            }
        }
    }

    fn draw_stop_numbers(&self, plane: &mut Plane, labels: &mut Labels) {
        let stops = self.record.targets.iter().flat_map(|target| &target.stops);
        let must = stops.clone().count() <= ALL_NUMBERED;
        for stop in stops {
            let (at, number) = (plane.at(stop.x, stop.y), stop.stop.to_string());
            if let Some(place) = labels.place(number.len(), 9.0, at, -0.8, must) {
                plane.add(text(number, place, 9.0).set("fill", "#A84A06"));
            }
        }
    }
}

/// The number of a camera, with a star of a reference.
fn name(camera: &Node) -> String {
    format!("{}{}", camera.id, if camera.reference { "*" } else { "" })
}

/// Component of the pose: its heading in the drawing, and its error with the predicted sigma.
type Component = (&'static str, fn(&Node) -> Option<(f64, f64)>);

/// Errors in x, y and heading of every camera, against one and two predicted sigmas.
///
/// # Errors
/// [`PlotError`]
pub fn errors(record: &RunRecord) -> Result<String, PlotError> {
    let unit = &record.unit.name;
    let components: [Component; 3] = [
        ("x", |c| Some((c.error?.x, c.estimate?.sigma_x))),
        ("y", |c| Some((c.error?.y, c.estimate?.sigma_y))),
        ("heading", |c| {
            Some((c.error?.heading_deg, c.estimate?.sigma_heading_deg))
        }),
    ];
    let legend = [
        Entry::dot("error", INK),
        Entry::dot("more than 3 sigmas", BAD),
        Entry::dot("1 and 2 predicted sigmas", CAMERA),
        Entry::new("no pose", Mark::Cross, BAD),
        Entry::remark("* reference"),
    ];
    let names = record.cameras().map(name).collect();
    let mut panels = Panels::new(3, names, &format!("Errors: {}", record.title()), &legend);
    let half = 0.5 * (16.0 / panels.pitch()).min(0.7);
    let radius = (panels.pitch() / 4.0).clamp(1.5, 4.0);
    for (name, of) in components {
        let values: Vec<_> = record.cameras().map(of).collect();
        let reach = |(error, sigma): &(f64, f64)| error.abs().max(2.0 * sigma);
        let largest = values.iter().flatten().map(reach).fold(0.0, f64::max);
        let top = if largest > 0.0 { 1.1 * largest } else { 1.0 };
        let unit = if name == "heading" { "deg" } else { unit };
        let mut plane = panels.panel(&format!("{name} [{unit}]"), -top..top)?;
        plane.level(0.0, INK);
        for (x, value) in values.iter().enumerate() {
            let x = x as f64;
            let &Some((error, sigma)) = value else {
                plane.add(Mark::Cross.draw(plane.at(x, 0.0), radius, BAD));
                continue;
            };
            for (times, opaque) in [(2.0, 0.18), (1.0, 0.3)] {
                let low = plane.at(x - half, -times * sigma);
                let high = plane.at(x + half, times * sigma);
                plane.add(bar(low, high, CAMERA, opaque));
            }
            let is_far = sigma > 0.0 && error.abs() > 3.0 * sigma;
            let colour = if is_far { BAD } else { INK };
            plane.add(dot(plane.at(x, error), radius, colour));
        }
        panels.add(plane);
    }
    Ok(panels.finish())
}

/// Residuals: normalised, by camera; and in degrees against the bearing, where a wrong camera
/// model shows as a curve.
///
/// # Errors
/// [`PlotError`]
pub fn residuals(record: &RunRecord) -> Result<String, PlotError> {
    let legend = [
        Entry::dot("sighting", CAMERA),
        Entry::dot("more than 3 sigmas", BAD),
        Entry::remark("three sightings always fit"),
    ];
    let names = record.cameras().map(name).collect();
    let title = format!("Residuals: {}", record.title());
    let mut panels = Panels::new(2, names, &title, &legend);
    let all = || record.cameras().flat_map(|camera| &camera.residuals);
    let largest = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let sigmas = largest(&mut all().filter_map(|r| r.normalised)).max(3.5) * 1.1;
    let mut plane = panels.panel("sigmas", -sigmas..sigmas)?;
    for (times, colour) in [(0.0, INK), (1.0, GREY), (3.0, BAD)] {
        plane.level(times, colour);
        plane.level(-times, colour);
    }
    let point_colour = |normalised: f64| if normalised.abs() > 3.0 { BAD } else { CAMERA };
    for (x, camera) in record.cameras().enumerate() {
        let n = camera.residuals.len().max(1) as f64;
        for (k, residual) in camera.residuals.iter().enumerate() {
            if let Some(normalised) = residual.normalised {
                // Side by side in the order of the stops.
                let x = x as f64 + 0.7 * ((k as f64 + 0.5) / n - 0.5);
                let colour = point_colour(normalised);
                plane.add(dot(plane.at(x, normalised), 2.5, colour));
            }
        }
    }
    panels.add(plane);
    let degrees = largest(&mut all().filter_map(|r| r.residual_deg)).max(1e-6) * 1.15;
    let bearing = largest(&mut all().map(|r| r.bearing_deg)).max(1.0) * 1.05;
    let mut plane = panels.free_panel(
        ("bearing [deg], left is positive", -bearing..bearing),
        ("residual [deg]", -degrees..degrees),
    )?;
    plane.level(0.0, INK);
    for residual in all() {
        if let (Some(degrees), Some(normalised)) = (residual.residual_deg, residual.normalised) {
            let at = plane.at(residual.bearing_deg, degrees);
            plane.add(dot(at, 2.5, point_colour(normalised)).set("fill-opacity", 0.7));
        }
    }
    panels.add(plane);
    Ok(panels.finish())
}
