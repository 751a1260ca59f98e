//! Errors over many runs.

use super::{
    PlotError,
    canvas::{CAMERA, Entry, INK, Plane, TARGET, bar, line},
    panels::Panels,
};
use crate::record::sweep::{Group, Quantity, Row, SweepReport};

/// Quantities of the panels, and their unit where it is not the scenario's.
const PANELS: [(Quantity, Option<&str>); 2] = [
    (Quantity::Position, None),
    (Quantity::HeadingDeg, Some("deg")),
];

/// Quantiles of the errors of every camera over all runs, and of the places targets believed to
/// stand at, with the predicted sigmas.
///
/// # Errors
/// [`PlotError`]
pub fn sweep(report: &SweepReport) -> Result<String, PlotError> {
    let of = |quantity: Quantity, is_chosen: fn(Group) -> bool| {
        let rows = report.rows.iter();
        rows.filter(move |(group, row)| is_chosen(*group) && row.quantity == quantity)
    };
    let is_camera: fn(Group) -> bool = |group| matches!(group, Group::Camera(_));
    let is_stop: fn(Group) -> bool = |group| matches!(group, Group::Stop { .. });
    let names = of(Quantity::Position, is_camera)
        .map(|(group, _)| match group {
            Group::Camera(id) => id.to_string(),
            _ => String::new(),
        })
        .collect();
    let stops: Vec<&Row> = of(Quantity::Position, is_stop)
        .map(|(_, row)| row)
        .collect();
    let has_stops = stops.iter().any(|row| row.calibrated > 0);
    let legend = [
        Entry::dot("25 to 75 %, line: 5 to 95 %", CAMERA),
        Entry::dot("median", INK),
        Entry::dot("predicted sigma (rms)", TARGET),
    ];
    let title = format!("Errors over {} runs: {}", report.runs, report.scenario);
    let mut panels = Panels::new(2 + u8::from(has_stops), names, &title, &legend);
    let half = 0.5 * (16.0 / panels.pitch()).min(0.7);
    for (quantity, unit) in PANELS {
        let rows: Vec<&Row> = of(quantity, is_camera).map(|(_, row)| row).collect();
        let unit = unit.unwrap_or(&report.unit);
        let name = format!("{} [{unit}]", quantity.name());
        let mut plane = panels.panel(&name, 0.0..top(&rows))?;
        for (x, row) in rows.iter().enumerate() {
            draw_box(&mut plane, x as f64, half, row);
        }
        panels.add(plane);
    }
    if has_stops {
        let last = stops.len() as f64;
        let mut plane = panels.free_panel(
            ("stops, in order of their numbers", 0.5..last + 0.5),
            (&format!("stop [{}]", report.unit), 0.0..top(&stops)),
        )?;
        // Counted from 1, as the table counts them.
        for (x, row) in (1..).zip(&stops) {
            draw_box(&mut plane, f64::from(x), 0.3, row);
        }
        panels.add(plane);
    }
    Ok(panels.finish())
}

fn top(rows: &[&Row]) -> f64 {
    let values = rows.iter().flat_map(|row| [row.p95, row.sigma_rms]);
    let largest = values.flatten().fold(0.0, f64::max);
    if largest > 0.0 { 1.1 * largest } else { 1.0 }
}

fn draw_box(plane: &mut Plane, x: f64, half: f64, row: &Row) {
    let level = |plane: &Plane, y| [plane.at(x - half, y), plane.at(x + half, y)];
    if let (Some(p05), Some(p25), Some(p50), Some(p75), Some(p95)) =
        (row.p05, row.p25, row.p50, row.p75, row.p95)
    {
        plane.add(line(&[plane.at(x, p05), plane.at(x, p95)], CAMERA, 1.0));
        let (low, high) = (plane.at(x - half, p25), plane.at(x + half, p75));
        plane.add(bar(low, high, CAMERA, 0.35));
        plane.add(line(&level(plane, p50), INK, 2.0));
    }
    if let Some(sigma) = row.sigma_rms {
        plane.add(line(&level(plane, sigma), TARGET, 2.0));
    }
}
