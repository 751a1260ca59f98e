//! Sites of any size: cells side by side, each a network of its own.
//!
//! A cell is a square. Two references stand at its lower border, ten twenty-fourths of its side apart, and
//! look at the area before both; the other cameras stand at random places and look somewhat towards the
//! middle. Neighbouring cells are on other channels and their targets have other colours. The last cell has
//! the nodes that are left, at least two. With `one_frame` only the first cell has references and a target,
//! which walks through all of them. Cameras are drawn from the scenario's seed, each cell from its own stream,
//! so that a larger site contains the smaller one.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{
    check::{self, refuse},
    error::ScenarioError,
    file::{GridTable, NetworkTable, PlacedCamera, ReferencesTable, Scenario, TargetTable},
};
use cmucam2_emulator::Rgb;

/// Channels of the 2.4 GHz band, far from each other between neighbours.
const CHANNELS: [u8; 16] = [
    11, 15, 19, 23, 13, 17, 21, 25, 12, 16, 20, 24, 14, 18, 22, 26,
];

/// Colours of the targets, so that no camera takes a neighbour's for its own.
const COLOURS: [Rgb; 4] = [[230, 105, 35], [40, 70, 220], [40, 200, 60], [215, 40, 190]];

/// Makes the networks of a grid and the world that holds them.
pub(super) fn expand(scenario: &mut Scenario) -> Result<(), ScenarioError> {
    let Some(grid) = scenario.grid.take() else {
        return Ok(());
    };
    if !scenario.networks.is_empty() {
        return Err(refuse("grid", "there beside `network`", "one or the other"));
    }
    check::camera("camera", &scenario.camera)?;
    let least = 3.0 * scenario.camera.range;
    if !(grid.cell_size >= least && grid.cell_size <= 1e4) {
        let allowed = format!("three times the cameras' range, {least}, to 10000");
        return Err(refuse("grid.cell_size", grid.cell_size, allowed));
    }
    let cells = grid.nodes.div_ceil(grid.cell_nodes);
    let side = (cells as f64).sqrt().ceil() as usize;
    let margin = 2.0;
    scenario.world.low = [-margin; 2];
    let rows = cells.div_ceil(side);
    scenario.world.high = [side, rows].map(|count| count as f64 * grid.cell_size + margin);
    scenario.networks = (0..cells)
        .map(|cell| network(&grid, cell, side, scenario))
        .collect();
    Ok(())
}

fn network(grid: &GridTable, cell: usize, side: usize, scenario: &Scenario) -> NetworkTable {
    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
    random.set_stream(cell as u64);
    let (column, row) = (cell % side, cell / side);
    let corner = [column, row].map(|index| index as f64 * grid.cell_size);
    let size = grid.cell_size;
    let first = cell * grid.cell_nodes;
    let nodes = grid.cell_nodes.min(grid.nodes - first).max(2);
    let at = |id: usize, x: f64, y: f64, heading_deg: f64| PlacedCamera {
        id: id as u16,
        x: Some(corner[0] + x),
        y: Some(corner[1] + y),
        heading_deg: Some(heading_deg),
        ..PlacedCamera::default()
    };
    let (begin, end) = (
        size / 2.0 - scenario.camera.range * 0.6,
        size / 2.0 + scenario.camera.range * 0.6,
    );
    let low = size / 24.0;
    let mut cameras = vec![
        at(first + 1, begin, low, 45.0),
        at(first + 2, end, low, 135.0),
    ];
    for id in first + 3..=first + nodes {
        let x = random.random_range(low..size - low);
        let y = random.random_range(low..size - low);
        let inwards = f64::atan2(size / 2.0 - y, size / 2.0 - x).to_degrees();
        let heading = (inwards + random.random_range(-75.0..75.0)).rem_euclid(360.0);
        cameras.push(at(id, x, y, heading));
    }
    let is_first = cell == 0;
    let target = (is_first || !grid.one_frame).then(|| TargetTable {
        id: 40_000 + cell as u16,
        colour: COLOURS[column % 2 + 2 * (row % 2)],
        radius: 0.15,
        height: None,
        stops: None,
        window: None,
        firmware: None,
    });
    NetworkTable {
        channel: Some(CHANNELS[(column % 4 + 4 * (row % 4)) % CHANNELS.len()]),
        channels: None,
        allow: Vec::new(),
        frame: None,
        coordinator: Some([corner[0] + size / 2.0, corner[1] + size / 2.0]),
        area: Some([corner, corner.map(|low| low + size)]),
        references: ReferencesTable {
            cameras: [first as u16 + 1, first as u16 + 2],
            // A grid is for many nodes, not for what a tape errs by.
            baseline_sigma: Some(0.0),
            position_sigma: Some(0.0),
            frame_of: (grid.one_frame && !is_first).then_some(1),
            ..ReferencesTable::default()
        },
        cameras,
        targets: target.into_iter().collect(),
    }
}
