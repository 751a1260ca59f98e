//! Drawings of one run: a map like the thesis's Figures 4.2 to 4.8, errors against predicted
//! sigmas, and residuals.

use calib_core::{Pose, Status};
use nalgebra::{Matrix3, Point2, Vector2};
use plotters::prelude::*;

use super::{
    MOST_NAMES, PlotError,
    fine::fine,
    frame::{
        self, ARROW, BAD, CAMERA, Drawn, Entry, INK, Plane, Root, TARGET, UNCERTAIN, draw_arrow,
        draw_head, draw_name, draw_outline, ellipse, map_plane, to_pair,
    },
    labels::Labels,
    panels::{Panels, bar, level},
    style::{draw_mark, style},
    view::View,
};
use crate::accuracy::quantile;
use crate::record::{Node, RunRecord};

/// How many times larger than they are errors and ellipses may be drawn.
const TIMES: [f64; 7] = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0];
/// What a usual ellipse's longer half axis should be, and the largest error, pixels.
const WELL_VISIBLE: f64 = 16.0;
const TOO_FAR: f64 = 70.0;
/// More fields of view than this are a fog.
const MOST_VIEWS: usize = 120;

/// The map of a run: true cameras with their fields of view, estimates with 95 % ellipses, the
/// targets' ways, their true and believed stops, and obstacles. Where estimates would hide behind
/// the truth, errors and ellipses are drawn larger than they are, and the map says so. Several
/// networks, each of which knows places in a frame of its own only, are drawn where they really are,
/// in the frame of the first one.
///
/// # Errors
/// [`PlotError`]
pub fn map(record: &RunRecord) -> Result<String, PlotError> {
    if record.has_networks() {
        map_in_one_frame(&record.in_one_frame())
    } else {
        map_in_one_frame(record)
    }
}

fn map_in_one_frame(record: &RunRecord) -> Result<String, PlotError> {
    let cameras: Vec<&Node> = record.cameras().collect();
    let truths = cameras.iter().filter_map(|camera| place(camera));
    let positions: Vec<Point2<f64>> = truths.map(|pose| pose.position).collect();
    let stops = record.targets.iter().flat_map(|target| &target.stops);
    let stops = stops.map(|stop| Point2::new(stop.x, stop.y));
    let ways = record.targets.iter().flat_map(|target| &target.path);
    let corners = ways.chain(record.obstacles.iter().flatten());
    let corners = corners.map(|&[x, y]| Point2::new(x, y));
    let mut others: Vec<_> = stops.chain(corners).collect();
    if cameras.len() <= MOST_VIEWS {
        others.extend(cameras.iter().flat_map(|camera| field_of_view(camera)));
    }
    let view = View::of(&positions, &others)?;
    let times = magnification(&cameras, &view);
    let size = frame::map_size(&view);
    let map = RunMap {
        record,
        cameras,
        view,
        times,
    };
    frame::drawing(size, |root| map.draw(root))
}

/// Where a camera is drawn: its true pose, otherwise its estimate.
fn place(camera: &Node) -> Option<Pose<f64>> {
    let truth = camera.truth.map(|truth| Pose {
        position: truth.position(),
        heading: truth.heading_deg.to_radians(),
        covariance: Matrix3::zeros(),
    });
    truth.or_else(|| camera.estimate.map(|estimate| estimate.pose()))
}

fn magnification(cameras: &[&Node], view: &View) -> f64 {
    let estimates = cameras.iter().filter_map(|camera| camera.estimate);
    let mut axes: Vec<f64> = estimates
        .map(|estimate| estimate.pose().ellipse(0.95).semi_major * view.scale)
        .collect();
    axes.sort_unstable_by(f64::total_cmp);
    let errors = cameras.iter().filter_map(|camera| camera.error);
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
    cameras: Vec<&'a Node>,
    view: View,
    times: f64,
}

impl RunMap<'_> {
    fn draw(&self, root: &Root<'_>) -> Drawn {
        let Self { record, view, .. } = self;
        draw_head(root, &record.title(), &self.legend())?;
        let plane = map_plane(root, view, &record.unit.name)?;
        if self.cameras.len() <= MOST_VIEWS {
            for camera in &self.cameras {
                let outline = field_of_view(camera);
                draw_outline(&plane, view, outline, CAMERA, [0.04, 0.14])?;
            }
        }
        for outline in &record.obstacles {
            let outline = outline.iter().map(|&[x, y]| Point2::new(x, y)).collect();
            draw_outline(&plane, view, outline, INK, [0.35, 0.8])?;
        }
        let mut labels = Labels::default();
        self.draw_targets(&plane, &mut labels)?;
        for camera in &self.cameras {
            self.draw_camera(&plane, camera)?;
        }
        if self.cameras.len() <= MOST_NAMES {
            self.draw_names(&plane, &mut labels)?;
        }
        Ok(())
    }

    fn legend(&self) -> Vec<Entry> {
        let of = |status| {
            let cameras = self.cameras.iter();
            cameras
                .filter(|c| c.estimate.is_some() && c.status == Some(status))
                .count()
        };
        let lost = self.lost().count();
        let mut legend = vec![
            Entry::new("true camera, field of view", INK),
            Entry::new(
                format!("{} calibrated, 95 % ellipse", of(Status::Calibrated)),
                style(Status::Calibrated).colour,
            ),
        ];
        for (status, shape) in [(Status::Weak, "ring"), (Status::Doubtful, "triangle")] {
            if let count @ 1.. = of(status) {
                let text = format!("{count} {status} ({shape})");
                legend.push(Entry::new(text, style(status).colour));
            }
        }
        if self.cameras.iter().any(|camera| camera.reference) {
            legend.push(Entry::remark("* reference"));
        }
        if lost > 0 {
            legend.push(Entry::new(format!("{lost} without pose (cross)"), BAD));
        }
        legend.push(Entry::new("way and stops, ring: believed", TARGET));
        if self.record.has_networks() {
            let count = self.record.networks.len();
            legend.push(Entry::remark(format!(
                "{count} networks where they really are, frame of the first"
            )));
        }
        if self.times > 1.0 {
            legend.push(Entry::remark(format!("errors drawn {} x", self.times)));
        }
        legend
    }

    fn lost(&self) -> impl Iterator<Item = &&Node> {
        let all = self.cameras.iter();
        all.filter(|camera| camera.expected && camera.estimate.is_none())
    }

    fn draw_targets(&self, plane: &Plane<'_>, labels: &mut Labels) -> Drawn {
        for target in &self.record.targets {
            let way: Vec<_> = target.path.iter().map(|&[x, y]| (x, y)).collect();
            plane.draw(&PathElement::new(way, TARGET.mix(0.45)))?;
            for stop in &target.stops {
                let place = Point2::new(stop.x, stop.y);
                labels.keep_clear(self.pixel(place), 4.0);
                plane.draw(&Circle::new(to_pair(place), 3, TARGET.filled()))?;
                if let Some(believed) = &stop.believed {
                    let off = Vector2::new(believed.x, believed.y) - place.coords;
                    let drawn = to_pair(place + off * self.times);
                    plane.draw(&PathElement::new([to_pair(place), drawn], TARGET))?;
                    plane.draw(&Circle::new(drawn, 5, TARGET))?;
                }
            }
        }
        Ok(())
    }

    fn draw_camera(&self, plane: &Plane<'_>, camera: &Node) -> Drawn {
        let Some(truth) = place(camera) else {
            return Ok(());
        };
        let at = to_pair(truth.position);
        let colour = match (&camera.estimate, camera.expected) {
            (None, true) => BAD,
            (None, false) => UNCERTAIN,
            (Some(_), _) => INK,
        };
        draw_arrow(plane, &truth, &self.view, colour)?;
        plane.draw(&Circle::new(at, 4, WHITE.filled()))?;
        plane.draw(&Circle::new(at, 4, colour.stroke_width(2)))?;
        if camera.estimate.is_none()
            && let Some(status) = camera.status
        {
            draw_mark(plane, at, style(status))?;
        }
        if let Some(estimate) = &camera.estimate {
            let mut pose = estimate.pose();
            pose.position = truth.position + (pose.position - truth.position) * self.times;
            let outline = ellipse(&pose, self.times);
            let style = style(camera.status.unwrap_or(Status::Waiting));
            draw_outline(plane, &self.view, outline, style.colour, [0.16, 0.8])?;
            draw_arrow(plane, &pose, &self.view, style.colour)?;
            draw_mark(plane, to_pair(pose.position), style)?;
        }
        Ok(())
    }

    fn draw_names(&self, plane: &Plane<'_>, labels: &mut Labels) -> Drawn {
        let poses = || self.cameras.iter().filter_map(|c| Some((c, place(c)?)));
        for (_, pose) in poses() {
            labels.keep_clear(self.pixel(pose.position), 6.0);
            let (sin, cos) = pose.heading.sin_cos();
            for along in [0.4, 0.8] {
                let arrow = Vector2::new(cos, sin) * ARROW * along;
                labels.keep_clear(self.pixel(pose.position) + arrow, 5.0);
            }
        }
        for (camera, pose) in poses() {
            let star = if camera.reference { "*" } else { "" };
            let name = format!("{}{star}", camera.id);
            // Behind the camera, where its arrow is not.
            let behind = pose.heading + std::f64::consts::PI;
            let middle = labels.place(&name, self.pixel(pose.position), 15.0, behind);
            draw_name(plane, &name, Point2::from(middle.coords / self.view.scale))?;
        }
        Ok(())
    }

    /// In pixels, from the world's origin, y upwards.
    fn pixel(&self, place: Point2<f64>) -> Point2<f64> {
        place * self.view.scale
    }
}

fn field_of_view(camera: &Node) -> Vec<Point2<f64>> {
    const PARTS: u8 = 24;
    let (Some(pose), Some(view)) = (place(camera), camera.view) else {
        return Vec::new();
    };
    let fov = view.fov_deg.to_radians();
    let arc = (0..=PARTS).map(|k| {
        let bearing = fov * (f64::from(k) / f64::from(PARTS) - 0.5);
        let (sin, cos) = (pose.heading + bearing).sin_cos();
        pose.position + Vector2::new(cos, sin) * view.range
    });
    std::iter::once(pose.position).chain(arc).collect()
}

fn names<'a>(cameras: impl Iterator<Item = &'a Node>) -> Vec<String> {
    cameras
        .map(|c| format!("{}{}", c.id, if c.reference { "*" } else { "" }))
        .collect()
}

/// What an error and its predicted sigma are of, with its heading and the two values.
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
    let panels = Panels::new(3, names(record.cameras()));
    let half = 0.5 * (16.0 / panels.pitch()).min(0.7);
    frame::drawing(panels.size(), |root| {
        let legend = [
            Entry::new("error", INK),
            Entry::new("more than 3 sigmas", BAD),
            Entry::new("1 and 2 predicted sigmas", CAMERA),
            Entry::remark("x: not calibrated, * reference"),
        ];
        draw_head(root, &format!("Errors: {}", record.title()), &legend)?;
        for (place, (name, of)) in (0..).zip(components) {
            let values: Vec<_> = record.cameras().map(of).collect();
            let reach = |(error, sigma): &(f64, f64)| error.abs().max(2.0 * sigma);
            let largest = values.iter().flatten().map(reach).fold(0.0, f64::max);
            let top = if largest > 0.0 { 1.1 * largest } else { 1.0 };
            let unit = if name == "heading" { "deg" } else { unit };
            let plane = panels.panel(root, place, &format!("{name} [{unit}]"), -top..top)?;
            level(&plane, 0.0, INK)?;
            for (x, value) in values.iter().enumerate() {
                let (x, &Some((error, sigma))) = (x as f64, value) else {
                    let cross = Cross::new((x as f64, 0.0), fine(4), BAD.stroke_width(2));
                    plane.draw(&cross)?;
                    continue;
                };
                for (times, opacity) in [(2.0, 0.18), (1.0, 0.3)] {
                    let reach = (-times * sigma, times * sigma);
                    bar(&plane, x, half, reach, CAMERA.mix(opacity).filled())?;
                }
                let is_far = sigma > 0.0 && error.abs() > 3.0 * sigma;
                let colour = if is_far { BAD } else { INK };
                plane.draw(&Circle::new((x, error), 4, colour.filled()))?;
            }
        }
        Ok(())
    })
}

/// Residuals: normalised, by camera; and in degrees against the bearing, where a wrong camera
/// model shows as a curve.
///
/// # Errors
/// [`PlotError`]
pub fn residuals(record: &RunRecord) -> Result<String, PlotError> {
    let panels = Panels::new(2, names(record.cameras()));
    frame::drawing(panels.size(), |root| {
        let legend = [
            Entry::new("sighting", CAMERA),
            Entry::new("more than 3 sigmas", BAD),
            Entry::remark("three sightings always fit"),
        ];
        draw_head(root, &format!("Residuals: {}", record.title()), &legend)?;
        let all = || record.cameras().flat_map(|camera| &camera.residuals);
        let largest =
            |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
        let sigmas = largest(&mut all().filter_map(|r| r.normalised)).max(3.5) * 1.1;
        let plane = panels.panel(root, 0, "sigmas", -sigmas..sigmas)?;
        for (times, colour) in [(0.0, INK), (1.0, UNCERTAIN), (3.0, BAD)] {
            level(&plane, times, colour)?;
            level(&plane, -times, colour)?;
        }
        for (x, camera) in record.cameras().enumerate() {
            let n = camera.residuals.len().max(1) as f64;
            for (k, residual) in camera.residuals.iter().enumerate() {
                if let Some(normalised) = residual.normalised {
                    // Side by side in the order of the stops.
                    let x = x as f64 + 0.7 * ((k as f64 + 0.5) / n - 0.5);
                    let point = Circle::new((x, normalised), 3, point_colour(normalised).filled());
                    plane.draw(&point)?;
                }
            }
        }
        let degrees = largest(&mut all().filter_map(|r| r.residual_deg)).max(1e-6) * 1.15;
        let bearing = largest(&mut all().map(|r| r.bearing_deg)).max(1.0) * 1.05;
        let plane = panels.free_panel(
            root,
            1,
            ("bearing [deg], left is positive", -bearing..bearing),
            ("residual [deg]", -degrees..degrees),
        )?;
        level(&plane, 0.0, INK)?;
        for residual in all() {
            if let (Some(degrees), Some(normalised)) = (residual.residual_deg, residual.normalised)
            {
                let at = (residual.bearing_deg, degrees);
                plane.draw(&Circle::new(
                    at,
                    3,
                    point_colour(normalised).mix(0.7).filled(),
                ))?;
            }
        }
        Ok(())
    })
}

fn point_colour(normalised: f64) -> RGBColor {
    if normalised.abs() > 3.0 { BAD } else { CAMERA }
}
