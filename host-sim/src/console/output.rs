//! The members of a network for people.

use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};

use calib_core::Refusal;
use results::record::{Estimate, Protection};
use results::report::table::Words;
use results::view::NetworkView;

/// The members as a table. It has no places: those are in a frame that only the record knows.
pub fn table(known: &NetworkView) -> String {
    let unit = known.unit();
    let of_length = |name: &str| format!("{name}\n[{unit}]");
    let of_angle = |name: &str| format!("{name}\n[deg]");
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN).set_header([
        "id".to_owned(),
        "address".to_owned(),
        "kind".to_owned(),
        "status".to_owned(),
        of_length("sigma"),
        of_angle("sigma"),
        of_length("fault"),
        of_angle("fault"),
        "seen".to_owned(),
    ]);
    for member in known.present() {
        let estimate = member.estimate();
        let level = member.protection();
        let number = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let bound = |of: fn(&Protection) -> f64, digits: usize| match &level {
            Some(level) if level.is_boundless() => "any".to_owned(),
            level => number(level.as_ref().map(of), digits),
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
            number(estimate.as_ref().map(Estimate::sigma_position), 3),
            number(estimate.map(|estimate| estimate.sigma_heading_deg), 2),
            bound(|level| level.position, 2),
            bound(|level| level.heading_deg, 1),
            member
                .report
                .map_or_else(|| "-".to_owned(), |report| report.sightings.to_string()),
        ]);
    }
    for column in [0, 1, 4, 5, 6, 7, 8] {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    format!("{}\n", table.trim_fmt())
}
