//! What is known of a network for people and for other programs.

use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};
use serde::Serialize;

use super::known::{Known, Member};
use answers::export::{CsvPose, to_csv};
use answers::record::Estimate;

/// The members as a table. Lengths are in the unit in which the site was configured.
pub fn table(known: &Known) -> String {
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
        let is_camera = member.is_camera();
        table.add_row([
            member.id.to_string(),
            format!("{:04x}", member.address),
            format!("{}{reference}", member.kind_name()),
            if is_camera { member.status() } else { "-" }.to_owned(),
            number(|e| e.x, 3),
            number(|e| e.sigma_x, 3),
            number(|e| e.y, 3),
            number(|e| e.sigma_y, 3),
            number(|e| e.heading_deg, 2),
            number(|e| e.sigma_heading_deg, 2),
            member
                .report
                .map_or_else(|| "-".to_owned(), |report| report.sightings.to_string()),
        ]);
    }
    for column in [0, 1, 4, 5, 6, 7, 8, 9, 10] {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    format!("{}\n", table.trim_fmt())
}

/// Which camera, in CSV. What `host-sim run --csv` writes too has the same name there.
#[derive(Default, Serialize)]
struct CsvCamera {
    camera: u16,
    reference: bool,
    status: &'static str,
}

/// What it reports of its pose.
#[derive(Default, Serialize)]
struct CsvReport {
    sightings: u8,
    used: u8,
    chi_squared: Option<f32>,
    done: bool,
    address: u16,
}

/// One row per camera: `camera`, `reference`, `status` (`calibrated`, or why not), the pose (`x`,
/// `y`, `heading_deg`), its sigmas (`sigma_...`), the upper triangle of its covariance (`cov_xx`,
/// `cov_xy`, `cov_xt`, `cov_yy`, `cov_yt`, `cov_tt`, headings in degrees), `sightings`, how many of
/// them the pose uses (`used`), `chi_squared`, `done` (it needs no more), and `address`.
///
/// # Errors
/// Those of the CSV writer.
pub fn csv(known: &Known) -> Result<String, csv::Error> {
    let cameras = known.present().into_iter().filter(|m| m.is_camera());
    let rows: Vec<_> = cameras.map(row).collect();
    if rows.is_empty() {
        // Without rows, the names of the columns all the same.
        let names = to_csv([<(CsvCamera, CsvPose, CsvReport)>::default()].iter())?;
        return Ok(names.split_inclusive('\n').take(1).collect());
    }
    to_csv(rows.iter())
}

fn row(camera: &Member) -> (CsvCamera, CsvPose, CsvReport) {
    let report = camera.report;
    let which = CsvCamera {
        camera: camera.id,
        reference: camera.is_reference(),
        status: camera.status(),
    };
    let reported = CsvReport {
        sightings: report.map_or(0, |report| report.sightings),
        used: report.map_or(0, |report| report.used),
        chi_squared: report.map(|report| report.chi_squared),
        done: report.is_some_and(|report| report.done),
        address: camera.address,
    };
    (which, CsvPose::from(camera.estimate()), reported)
}

#[derive(Serialize)]
struct Json {
    format: u32,
    network: Option<JsonNetwork>,
    nodes: Vec<JsonNode>,
}

#[derive(Serialize)]
struct JsonNetwork {
    pan: u16,
    channel: u8,
}

#[derive(Serialize)]
struct JsonNode {
    id: u16,
    address: u16,
    role: &'static str,
    reference: bool,
    status: Option<&'static str>,
    estimate: Option<Estimate>,
    sightings: u8,
    used: u8,
    chi_squared: Option<f32>,
    done: bool,
}

impl JsonNode {
    fn new(member: &Member) -> Self {
        let report = member.report;
        Self {
            id: member.id,
            address: member.address,
            role: member.kind_name(),
            reference: member.is_reference(),
            status: member.is_camera().then(|| member.status()),
            estimate: member.estimate(),
            sightings: report.map_or(0, |report| report.sightings),
            used: report.map_or(0, |report| report.used),
            chi_squared: report.map(|report| report.chi_squared),
            done: report.is_some_and(|report| report.done),
        }
    }
}

/// `format` (1), `network` (`pan`, `channel`; `null` while there is none), and `nodes`: each with
/// what [`csv()`] has of a camera, and `estimate` as in the record of a run.
///
/// # Errors
/// Those of the JSON writer.
pub fn json(known: &Known) -> Result<String, serde_json::Error> {
    let network = known.network().map(|network| JsonNetwork {
        pan: network.pan,
        channel: network.channel,
    });
    let nodes = known.present().into_iter().map(JsonNode::new).collect();
    let json = Json {
        format: 1,
        network,
        nodes,
    };
    Ok(serde_json::to_string_pretty(&json)? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_without_cameras_has_its_columns() {
        let text = csv(&Known::default()).unwrap();
        assert!(text.starts_with("camera,reference,status,x,y,"), "{text}");
        assert_eq!(text.lines().count(), 1);
    }
}
