//! The members of a network for people.

use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};

use calib_core::Refusal;
use results::record::{Estimate, verdict::half_turn};
use results::report::table::Words;
use results::view::NetworkView;

/// The members as a table. Lengths are in the unit in which the site was configured.
pub fn table(known: &NetworkView) -> String {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN).set_header([
        "id",
        "address",
        "kind",
        "status",
        "x",
        "+/-",
        "y",
        "+/-",
        "heading",
        "+/- [deg]",
        "checked to",
        "sightings",
    ]);
    for member in known.present() {
        let estimate = member.estimate();
        let number = |value: fn(&Estimate) -> f64, digits: usize| match &estimate {
            Some(estimate) => format!("{:.digits$}", value(estimate)),
            None => "-".to_owned(),
        };
        let reference = if member.is_reference() {
            ", reference"
        } else {
            ""
        };
        let status = match member.is_camera() {
            true => Words(member.status(), member.reason().map(Refusal::name)).to_string(),
            false => "-".to_owned(),
        };
        table.add_row([
            member.id.to_string(),
            format!("{:04x}", member.address),
            format!("{}{reference}", member.kind_name()),
            status,
            number(|e| e.x, 3),
            number(|e| e.sigma_x, 3),
            number(|e| e.y, 3),
            number(|e| e.sigma_y, 3),
            number(|e| e.heading_deg, 2),
            number(|e| e.sigma_heading_deg, 2),
            member.protection().map_or_else(
                || "-".to_owned(),
                |level| format!("{:.2}, {:.1}", level.position, half_turn(level.heading_deg)),
            ),
            member
                .report
                .map_or_else(|| "-".to_owned(), |report| report.sightings.to_string()),
        ]);
    }
    for column in [0, 1, 4, 5, 6, 7, 8, 9, 10, 11] {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    format!("{}\n", table.trim_fmt())
}
