//! A sweep as a table for people.

use super::run::{Maybe, per_cent, print, table};
use crate::accuracy::GAUSSIAN;
use crate::record::sweep::{Group, Quantity, Row, SweepReport};

/// Quantiles over all runs: overall, per camera, and along the targets' ways.
pub fn sweep_report(report: &SweepReport) -> String {
    let SweepReport {
        scenario,
        unit,
        runs,
        complete,
        checked,
        rows,
    } = report;
    let mut text = format!(
        "{scenario}: {runs} runs, {complete} of them with every camera calibrated; lengths in \
         {unit}\n"
    );
    let parts = [
        (checked.poses, "estimated poses"),
        (checked.bearings, "bearings"),
        (checked.legs, "legs"),
    ];
    let parts = parts.iter().filter(|([_, all], _)| *all > 0);
    let parts = parts.map(|([checked, all], what)| {
        let share = 100.0 * *checked as f64 / *all as f64;
        format!("{share:.1} % of {all} {what}")
    });
    let parts = parts.collect::<Vec<_>>().join(", ");
    if !parts.is_empty() {
        text += &format!("Checked: {parts}\n");
    }
    text.push('\n');
    let overall = |group| matches!(group, Group::All | Group::Cameras);
    let parts: [(&str, Choice<'_>); 3] = [
        ("All runs together", &|group, _| overall(group)),
        ("Cameras", &|group, quantity| {
            matches!(group, Group::Camera(_)) && is_main(quantity)
        }),
        ("Where targets believed to stand", &|group, quantity| {
            matches!(group, Group::Stop { .. }) && quantity == Quantity::Position
        }),
    ];
    for (title, chosen) in parts {
        let mut table = table(&HEAD);
        for (group, row) in rows {
            if chosen(*group, row.quantity) {
                table.add_row(cells(row));
            }
        }
        if table.is_empty() {
            continue;
        }
        if title == parts[0].0 {
            let mut foretold = vec!["foretold".to_owned()];
            foretold.extend(vec![String::new(); HEAD.len() - 4]);
            foretold.extend(per_cent(Some(GAUSSIAN)));
            table.add_row(foretold);
        }
        text += &format!("{title}\n{}\n", print(&table));
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}

type Choice<'a> = &'a dyn Fn(Group, Quantity) -> bool;

fn is_main(quantity: Quantity) -> bool {
    matches!(quantity, Quantity::Position | Quantity::HeadingDeg)
}

const HEAD: [&str; 12] = [
    "errors",
    "of",
    "calibrated",
    "rms",
    "median",
    "p90",
    "p95",
    "max",
    "sigma rms",
    "within 1",
    "2",
    "3 sigma",
];

fn cells(row: &Row) -> Vec<String> {
    let digits = if row.quantity == Quantity::HeadingDeg {
        3
    } else {
        4
    };
    let unit = if row.quantity == Quantity::HeadingDeg {
        " [deg]"
    } else {
        ""
    };
    let mut cells = vec![
        row.group.clone(),
        format!("{}{unit}", row.quantity.name()),
        format!("{}/{}", row.calibrated, row.expected),
    ];
    let values = [row.rms, row.p50, row.p90, row.p95, row.max, row.sigma_rms];
    cells.extend(values.map(|v| Maybe(v, digits).to_string()));
    let shares = match (row.within_1, row.within_2, row.within_3) {
        (Some(one), Some(two), Some(three)) => Some([one, two, three]),
        _ => None,
    };
    cells.extend(per_cent(shares));
    cells
}
