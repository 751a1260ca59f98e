//! The thesis's own results, to stand beside a run of the same site.

use serde::Deserialize;

use super::{Place, PoseError, RunRecord};
use calib_core::angle;

const TABLE_4_1: &str = include_str!("../../data/thesis_table_4_1.csv");
const STATISTICS: &str = include_str!("../../data/thesis_statistics.csv");

/// Results that the thesis prints about a site.
#[derive(Clone, Debug, PartialEq)]
pub struct Published {
    /// Number of the table of its statistics.
    pub table: String,
    /// Mean of the signed errors, as printed.
    pub mean: PoseError,
    /// Their standard deviation (n - 1), as printed.
    pub standard_deviation: PoseError,
    /// Single results, where it prints them.
    pub nodes: Vec<PublishedNode>,
}

/// One camera's result in the thesis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedNode {
    /// Its number.
    pub id: u16,
    /// Its true pose.
    pub truth: Place,
    /// The calculated pose.
    pub calculated: Place,
}

impl PublishedNode {
    /// Calculated minus true.
    pub fn error(&self) -> PoseError {
        let Self {
            truth, calculated, ..
        } = self;
        let turned = (calculated.heading_deg - truth.heading_deg).to_radians();
        PoseError::new(
            calculated.x - truth.x,
            calculated.y - truth.y,
            angle::wrap_signed(turned).to_degrees(),
        )
    }
}

#[derive(Deserialize)]
struct StatisticsRow {
    results: String,
    path: Option<u32>,
    table: String,
    mean_x: f64,
    mean_y: f64,
    mean_deg: f64,
    sd_x: f64,
    sd_y: f64,
    sd_deg: f64,
}

impl Published {
    /// The results to stand beside those of a run; `None` if there are none.
    pub fn beside(record: &RunRecord) -> Option<Self> {
        Self::named(record.published.as_deref()?, record.path)
    }

    /// The results of this name, as a scenario's `published` has it, for a path; `None` for one that
    /// the thesis does not have.
    ///
    /// `thesis-4.1`: the simulation's 13 cameras, paths 1 to 3. `thesis-3.1`: the laboratory's, one
    /// result for all placements together.
    pub fn named(name: &str, path: Option<u32>) -> Option<Self> {
        let row = csv::Reader::from_reader(STATISTICS.as_bytes())
            .into_deserialize::<StatisticsRow>()
            .filter_map(Result::ok)
            .find(|row| row.results == name && (row.path.is_none() || row.path == path))?;
        let nodes = match row.path {
            Some(path) => table_4_1(path),
            None => Vec::new(),
        };
        Some(Self {
            table: row.table,
            mean: PoseError::new(row.mean_x, row.mean_y, row.mean_deg),
            standard_deviation: PoseError::new(row.sd_x, row.sd_y, row.sd_deg),
            nodes,
        })
    }

    /// The result for one camera.
    pub fn node(&self, id: u16) -> Option<&PublishedNode> {
        self.nodes.iter().find(|node| node.id == id)
    }
}

fn table_4_1(path: u32) -> Vec<PublishedNode> {
    let mut reader = csv::Reader::from_reader(TABLE_4_1.as_bytes());
    let Ok(header) = reader.headers().cloned() else {
        return Vec::new();
    };
    let rows = reader.into_records().filter_map(Result::ok);
    rows.filter_map(|row| {
        let value = |name: String| {
            let column = header.iter().position(|title| title == name)?;
            row.get(column)?.parse::<f64>().ok()
        };
        let place = |prefix: &str| {
            Some(Place::new(
                value(format!("{prefix}_x"))?,
                value(format!("{prefix}_y"))?,
                value(format!("{prefix}_deg"))?,
            ))
        };
        Some(PublishedNode {
            id: row.get(0)?.parse().ok()?,
            truth: place("true")?,
            calculated: place(&format!("path{path}"))?,
        })
    })
    .collect()
}

/// The exchange of the thesis's Appendix B, in bytes, for one camera calibrated from three
/// sightings.
///
/// Every packet has 12 bytes: at each stop the camera's "you are in my field of view" (`20 40 0
/// ...`) and the target's place (`20 'S' ...`), and the camera's pose in the end.
pub mod exchange {
    const PACKET: u64 = 12;
    const PACKETS: u64 = 3 * 2 + 1;
    /// Preamble, start of frame and length; frame control, sequence number, network, two short
    /// addresses; check sequence.
    const FRAME: u64 = 6 + 9 + 2;
    /// The same without addresses: an acknowledgement.
    const ACKNOWLEDGEMENT: u64 = 6 + 3 + 2;

    /// Application bytes.
    pub const PAYLOAD: u64 = PACKETS * PACKET;

    /// Bytes on the air, as far as the thesis tells: had each packet been one acknowledged,
    /// unsecured data frame with short addresses of IEEE 802.15.4-2003, all of them heard at once.
    pub const ON_AIR: u64 = PACKETS * (FRAME + PACKET + ACKNOWLEDGEMENT);
}
