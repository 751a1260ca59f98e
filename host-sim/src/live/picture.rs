//! A run as a small picture that moves: SVG that any browser plays, without a script.

use std::fmt::Write as _;

use calib_core::Status;
use results::record::{
    Role,
    event::{self, Event, What},
};

/// Duration of the animation, seconds; the last picture of a walk is held for a while.
const PLAYS: f64 = 20.0;
/// Ratio of the duration to that of the walk.
const HELD: f64 = 1.15;
/// Number of places of a target's way.
const PLACES: usize = 240;
/// Time for which a sighting is shown, as a share of the whole.
const FLASH: f64 = 0.012;
/// Magnification of the ellipses of 95 %.
const MAGNIFIED: f64 = 20.0;
/// Width, pixels.
const WIDTH: f64 = 640.0;

/// A network as it finds itself: cameras grey until they are calibrated, then with the ellipse that holds
/// them with 95 %, magnified 20 times; the target on its way, and a ray for every sighting. In the frame of the
/// first network. `None` if the events do not tell where the cameras are.
pub fn animation(events: &[Event]) -> Option<String> {
    let record = event::fold(events.iter())?;
    let end = events.last()?.seconds * HELD;
    let cameras: Vec<_> = { record.nodes.iter() }
        .filter(|node| node.role == Role::Camera && node.network == record.nodes[0].network)
        .filter_map(|node| Some((node, node.truth?, node.view?)))
        .collect();
    let way = way(events);
    let corners = cameras.iter().map(|(_, at, _)| [at.x, at.y]);
    let all: Vec<[f64; 2]> = { corners }
        .chain(way.iter().map(|&(_, place)| place))
        .chain(record.obstacles.iter().flatten().copied())
        .collect();
    let limit = |axis: usize, pick: fn(f64, f64) -> f64| all.iter().map(|p| p[axis]).reduce(pick);
    let (low_x, high_x) = (limit(0, f64::min)? - 1.5, limit(0, f64::max)? + 1.5);
    let (low_y, high_y) = (limit(1, f64::min)? - 1.5, limit(1, f64::max)? + 1.5);
    let scale = WIDTH / (high_x - low_x);
    let height = (high_y - low_y) * scale + 24.0;
    let at = |x: f64, y: f64| ((x - low_x) * scale, (high_y - y) * scale);
    let share = |seconds: f64| (seconds / end).clamp(0.0, 0.999);
    let timing = format!("dur=\"{PLAYS}s\" repeatCount=\"indefinite\"");
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height:.0}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<title>A camera network finds itself</title>\n\
         <rect width=\"{WIDTH}\" height=\"{height:.0}\" fill=\"#fff\"/>\n"
    );
    let line = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let places: Vec<_> = points
            .map(|[x, y]| at(x, y))
            .map(|(x, y)| format!("{x:.0},{y:.0}"))
            .collect();
        places.join(" ")
    };
    for outline in &record.obstacles {
        let points = line(&mut outline.iter().copied());
        let _ = writeln!(
            out,
            "<polygon points=\"{points}\" fill=\"#d9cfc4\" stroke=\"#6b5b4b\"/>"
        );
    }
    for (_, place, view) in &cameras {
        let edge = |n: u32| {
            let off = view.fov_deg * (f64::from(n) / 8.0 - 0.5);
            let (sin, cos) = (place.heading_deg + off).to_radians().sin_cos();
            [place.x + view.range * cos, place.y + view.range * sin]
        };
        let points = line(&mut std::iter::once([place.x, place.y]).chain((0..=8).map(edge)));
        let _ = writeln!(
            out,
            "<polygon points=\"{points}\" fill=\"#0072b2\" fill-opacity=\".06\"/>"
        );
    }
    let points = line(&mut way.iter().map(|&(_, place)| place));
    let _ = writeln!(
        out,
        "<polyline points=\"{points}\" fill=\"none\" stroke=\"#d95f02\" stroke-opacity=\".3\"/>"
    );
    for event in events {
        let What::Seen { node, .. } = event.what else {
            continue;
        };
        let camera = cameras.iter().find(|(camera, ..)| camera.id == node);
        let now = way
            .iter()
            .take_while(|(seconds, _)| *seconds <= event.seconds)
            .last();
        let (Some((_, from, _)), Some(&(_, to))) = (camera, now) else {
            continue;
        };
        let ((x1, y1), (x2, y2)) = (at(from.x, from.y), at(to[0], to[1]));
        let from = share(event.seconds);
        let _ = writeln!(
            out,
            "<path d=\"M{x1:.0} {y1:.0}L{x2:.0} {y2:.0}\" stroke=\"#d95f02\" opacity=\"0\"><animate attributeName=\"opacity\" \
             calcMode=\"discrete\" values=\"0;1;0\" keyTimes=\"0;{from:.3};{:.3}\" {timing}/></path>",
            from + FLASH
        );
    }
    let mut calibrated = Vec::new();
    for (node, place, _) in &cameras {
        let (x, y) = at(place.x, place.y);
        let when = match node.status {
            Some(Status::Calibrated) => node.calibrated_seconds,
            _ => None,
        };
        calibrated.extend(when);
        let animate = |name: &str, before: &str, after: &str| {
            let when = share(when.unwrap_or_default());
            format!(
                "<animate attributeName=\"{name}\" calcMode=\"discrete\" values=\"{before};{after}\" \
                 keyTimes=\"0;{when:.3}\" {timing}/>"
            )
        };
        if let (Some(estimate), Some(_)) = (node.estimate, when) {
            let [xx, xy, _, yy, ..] = estimate.covariance;
            let (mean, spread) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
            let half = |variance: f64| (5.991 * variance.max(0.0)).sqrt() * MAGNIFIED * scale;
            let angle = -f64::atan2(2.0 * xy, xx - yy).to_degrees() / 2.0;
            let _ = writeln!(
                out,
                "<ellipse rx=\"{:.1}\" ry=\"{:.1}\" transform=\"translate({x:.0} {y:.0}) rotate({angle:.0})\" \
                 fill=\"#7b3fa0\" fill-opacity=\".25\" opacity=\"0\">{}</ellipse>",
                half(mean + spread),
                half(mean - spread),
                animate("opacity", "0", "1")
            );
        }
        let colour = when.map(|_| animate("fill", "#999", "#0068a8"));
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.0}\" cy=\"{y:.0}\" r=\"6\" fill=\"#999\">{}</circle><text x=\"{:.0}\" y=\"{:.0}\">{}</text>",
            colour.unwrap_or_default(),
            x + 8.0,
            y - 6.0,
            node.id
        );
    }
    if let Some(&(_, first)) = way.first() {
        let (x, y) = at(first[0], first[1]);
        let times: Vec<_> = way
            .iter()
            .map(|&(t, _)| format!("{:.4}", share(t)))
            .collect();
        let times = format!("0;{};1", times.join(";"));
        let moves = |name: &str, values: Vec<f64>| {
            let values: Vec<_> = values.iter().map(|value| format!("{value:.0}")).collect();
            let (first, last) = (&values[0], &values[values.len() - 1]);
            format!(
                "<animate attributeName=\"{name}\" values=\"{first};{};{last}\" keyTimes=\"{times}\" {timing}/>",
                values.join(";")
            )
        };
        let places: Vec<_> = way.iter().map(|&(_, [x, y])| at(x, y)).collect();
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.0}\" cy=\"{y:.0}\" r=\"5\" fill=\"#d95f02\">{}{}</circle>",
            moves("cx", places.iter().map(|place| place.0).collect()),
            moves("cy", places.iter().map(|place| place.1).collect())
        );
    }
    words(&mut out, calibrated, cameras.len(), height, &share);
    out.push_str("</svg>\n");
    Some(out)
}

/// Text with the number of calibrated cameras by now.
fn words(
    out: &mut String,
    mut calibrated: Vec<f64>,
    count: usize,
    height: f64,
    share: &dyn Fn(f64) -> f64,
) {
    calibrated.sort_by(f64::total_cmp);
    for n in 0..=calibrated.len() {
        let from = if n == 0 {
            0.0
        } else {
            share(calibrated[n - 1])
        };
        let until = calibrated.get(n).map_or(1.0, |&next| share(next));
        if until - from < 1e-3 && n < calibrated.len() {
            continue;
        }
        let words = match n.checked_sub(1) {
            Some(last) => format!(
                "{n} of {count} cameras calibrated, {:.0} s",
                calibrated[last]
            ),
            None => format!("none of {count} cameras calibrated"),
        };
        let _ = writeln!(
            out,
            "<text x=\"6\" y=\"{:.0}\" opacity=\"0\">{words}<animate \
             attributeName=\"opacity\" calcMode=\"discrete\" values=\"0;1;0\" keyTimes=\"0;{from:.3};{until:.3}\" \
             dur=\"{PLAYS}s\" repeatCount=\"indefinite\"/></text>",
            height - 8.0
        );
    }
}

/// Times and places of the first target.
fn way(events: &[Event]) -> Vec<(f64, [f64; 2])> {
    let mut first = None;
    let places = events.iter().filter_map(|event| match event.what {
        What::Place { target, x, y } if *first.get_or_insert(target) == target => {
            Some((event.seconds, [x, y]))
        }
        _ => None,
    });
    let places: Vec<_> = places.collect();
    let every = places.len().div_ceil(PLACES).max(1);
    let last = places.len().saturating_sub(1);
    let chosen = places.into_iter().enumerate();
    { chosen.filter(|(n, _)| n % every == 0 || *n == last) }
        .map(|(_, place)| place)
        .collect()
}
