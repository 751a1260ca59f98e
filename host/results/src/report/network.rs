//! A network's joint solution as a table for people.

use std::fmt::Write;

use super::table::Words;
use crate::network::{Camera, Finding, LensEstimate, NetworkSolution, ScaleFrom};

/// The tables of one walk.
pub fn network_report(solution: &NetworkSolution, unit: &str) -> String {
    let mut text = String::new();
    // Writing to a text does not fail.
    let _ = write(&mut text, solution, unit);
    text
}

fn write(out: &mut String, solution: &NetworkSolution, unit: &str) -> std::fmt::Result {
    let words = Words(solution.status, solution.reason);
    match solution.target {
        Some(target) => writeln!(
            out,
            "Network {}, target {target}: {words}",
            solution.network
        )?,
        None => writeln!(out, "Network {}: {words}", solution.network)?,
    }
    if let Some(advice) = &solution.advice {
        writeln!(out, "{advice}")?;
    }
    let Some([first, second]) = solution.references.filter(|_| solution.baseline.is_some()) else {
        return Ok(());
    };
    writeln!(
        out,
        "Camera {first} is the origin, camera {second} on the x axis."
    )?;
    if let (Some(baseline), Some(sigma)) = (solution.baseline, solution.sigma_baseline) {
        match solution.scale_from {
            ScaleFrom::Baseline => writeln!(out, "They are {baseline:.3} {unit} apart, as given.")?,
            ScaleFrom::Nothing => writeln!(
                out,
                "Nothing sets the scale: every length is in units of the distance between them. Give \
                 it with --baseline, or that of two others with --references."
            )?,
            ScaleFrom::Carrier => writeln!(
                out,
                "They are {baseline:.3} +/- {sigma:.3} {unit} apart: the carrier's distances set the \
                 scale, and every length is as wrong as they are."
            )?,
        }
    }
    let unit = match solution.scale_from {
        ScaleFrom::Nothing => "baselines",
        _ => unit,
    };
    writeln!(
        out,
        "\n{:>6}  {:>10} {:>9}  {:>10} {:>9}  {:>8} {:>9}  {:>19}  {:>8}  status",
        "camera",
        format!("x [{unit}]"),
        "+/-",
        format!("y [{unit}]"),
        "+/-",
        "heading",
        "+/- [deg]",
        "protected to",
        "bearings"
    )?;
    for camera in &solution.cameras {
        let bearings = format!("{}/{}", camera.used, camera.bearings);
        let words = Words(camera.status, camera.reason);
        let duty = if camera.reference { ", reference" } else { "" };
        match &camera.estimate {
            Some(own) => {
                let level = camera.protection.map_or("-".to_owned(), |level| {
                    format!("{:.3} {unit}, {:.2} deg", level.position, level.heading_deg)
                });
                writeln!(
                    out,
                    "{:>6}  {:>10.3} {:>9.3}  {:>10.3} {:>9.3}  {:>8.2} {:>9.2}  {level:>19}  \
                     {bearings:>8}  {words}{duty}",
                    camera.camera,
                    own.x,
                    own.sigma_x,
                    own.y,
                    own.sigma_y,
                    own.heading_deg,
                    own.sigma_heading_deg,
                )?;
            }
            None => writeln!(
                out,
                "{:>6}  {:>10} {:>9}  {:>10} {:>9}  {:>8} {:>9}  {:>19}  {bearings:>8}  {words}",
                camera.camera, "-", "-", "-", "-", "-", "-", "-"
            )?,
        }
    }
    writeln!(
        out,
        "\n{:>6}  {:>10} {:>9}  {:>10} {:>9}",
        "stop", "x", "+/-", "y", "+/-"
    )?;
    for stop in &solution.stops {
        writeln!(
            out,
            "{:>6}  {:>10.3} {:>9.3}  {:>10.3} {:>9.3}",
            stop.stop, stop.x, stop.sigma_x, stop.y, stop.sigma_y
        )?;
    }
    if !solution.left_out.is_empty() {
        writeln!(
            out,
            "Left out: stops {}. The way there was not measured, and no two cameras with a pose see one of \
             them: measure it, or let two calibrated cameras see one of them.",
            solution
                .left_out
                .iter()
                .map(u32::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        )?;
    }
    if let Some(carrier) = &solution.carrier {
        writeln!(
            out,
            "\nCarrier: reads {:.4} +/- {:.4} of a distance, compass off by {:.2} +/- {:.2} deg",
            carrier.scale, carrier.sigma_scale, carrier.compass_deg, carrier.sigma_compass_deg
        )?;
    }
    if let Some(factor) = solution.leg_factor {
        writeln!(out, "Displacements err {factor:.2} times what they claim.")?;
    }
    if let Some(chi_squared) = solution.chi_squared {
        writeln!(
            out,
            "Chi squared {chi_squared:.1}, degrees of freedom {}",
            solution.degrees_of_freedom
        )?;
    }
    for finding in &solution.findings {
        writeln!(out, "{}", sentence(finding))?;
    }
    for camera in &solution.cameras {
        if let Some(lens) = camera.lens.filter(|lens| lens.wrong) {
            writeln!(out, "{}", other_lens(camera.camera, &lens))?;
        }
    }
    for camera in solution.cameras.iter().filter(|camera| camera.mirrored) {
        writeln!(
            out,
            "Camera {}: its bearings fit once left and right are exchanged. It hangs upside down, or its picture is \
             mirrored: turn it over, or count its columns from the other side, and do not rely on its pose.",
            camera.camera
        )?;
    }
    let is_ambiguous = |camera: &&Camera| camera.reason == Some(NetworkSolution::AMBIGUOUS);
    for camera in solution.cameras.iter().filter(is_ambiguous) {
        writeln!(
            out,
            "Camera {}: its bearings also fit once left and right are exchanged. Let it see the target at another \
             stop. If it surely hangs upright, and its picture is not mirrored, its pose holds.",
            camera.camera
        )?;
    }
    let unchecked = { solution.cameras.iter() }
        .filter(|camera| camera.estimate.is_some() && !camera.reference && !camera.checked);
    let unchecked: Vec<_> = unchecked.map(|camera| camera.camera.to_string()).collect();
    if !unchecked.is_empty() {
        writeln!(
            out,
            "Not checked: {}. A wrong bearing of theirs would not show: let them see the target at \
             another stop.",
            unchecked.join(", ")
        )?;
    }
    if let Some(largest) = largest(solution) {
        writeln!(out, "{largest}")?;
    }
    if solution.reason == Some(NetworkSolution::BASELINE) {
        writeln!(
            out,
            "The steps contradict the baseline: measure it again, or tell how wrong steps may be (`systematic_scale`), and \
             do not rely on poses before."
        )?;
    }
    if solution.reason == Some(NetworkSolution::CONTRADICTORY) {
        writeln!(
            out,
            "The measurements do not fit this answer: look for a wrong bearing, displacement or \
             sigma, or a wrong baseline, and do not rely on poses or sigmas."
        )?;
    }
    Ok(())
}

/// A finding, and what to do.
fn sentence(finding: &Finding) -> String {
    match finding {
        Finding::Bearing {
            stop, camera, off, ..
        } => format!(
            "Left out: the bearing of camera {camera} at stop {stop}, which is {:.1} sigma off.",
            off.abs()
        ),
        Finding::Range {
            stop, camera, off, ..
        } => format!(
            "Left out: the range of camera {camera} at stop {stop}, which is {:.1} sigma off.",
            off.abs()
        ),
        Finding::Leg {
            stop, chi_squared, ..
        } => format!(
            "Left out: the way to stop {stop} (chi squared {chi_squared:.0}): the carrier slipped, or \
             steps were not counted."
        ),
        Finding::Camera {
            camera,
            from,
            chi_squared,
        } => format!(
            "Left out: camera {camera} from stop {from} on (chi squared {chi_squared:.0}): it was \
             moved, or is stuck. Its pose is the one before."
        ),
    }
}

/// A lens that is not the one that was given, and which one fits.
fn other_lens(camera: u16, lens: &LensEstimate) -> String {
    let fits = match (lens.fov_deg, lens.sigma_fov_deg) {
        (Some(view), Some(sigma)) => format!("a field of view of {view:.1} +/- {sigma:.1} deg"),
        _ => format!(
            "{:.3} +/- {:.3} times the tangents of its bearings",
            lens.factor, lens.sigma
        ),
    };
    format!(
        "Camera {camera}: its lens, or its projection, is not the one given ({:.1} sigma off): {fits} \
         fits. Correct its configuration, and do not rely on its pose.",
        lens.off.abs()
    )
}

/// The residual that is largest of those that count.
fn largest(solution: &NetworkSolution) -> Option<String> {
    let normalised = solution.bearings.iter().filter_map(|left| {
        let counts = left.standing == "counts";
        left.normalised.filter(|_| counts).map(|off| (left, off))
    });
    let (left, off) = normalised.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    Some(format!(
        "Largest residual: camera {} at stop {}, {off:.1} sigma",
        left.camera, left.stop
    ))
}
