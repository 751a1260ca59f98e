//! Binary rows: whole frames, and those of the line modes.

use super::{
    blob::{self, Filter},
    colour::Colour,
    differencing::Grid,
    statistics::{Levels, Statistics},
    tracked::Tracked,
    view::{Region, View},
};

const FRAME: u8 = 0x01;
const ROW: u8 = 0x02;
const BITMAP: u8 = 0xAA;
const LINES: u8 = 0xFE;
const DELTAS: u8 = 0xFC;
const LINES_END: u8 = 0xFD;

/// Start of a frame.
pub(super) fn header(region: Region) -> [u8; 3] {
    [FRAME, region.width(), region.height()]
}

/// End of a frame.
pub(super) const END: u8 = 0x03;

/// One row of a frame.
pub(super) fn row(
    view: &View<'_>,
    region: Region,
    y: u8,
    channel: Option<u8>,
    [mark_before, mark_after]: [bool; 2],
) -> Vec<u8> {
    let mut pixels = Vec::new();
    view.row(y, region.x1, region.x2, &mut pixels);
    let mut bytes = Vec::with_capacity(1 + 3 * pixels.len());
    if mark_before {
        bytes.push(ROW);
    }
    for levels in pixels.into_iter().map(Colour::levels) {
        match channel {
            None => bytes.extend(levels),
            Some(channel) => bytes.push(levels[usize::from(channel)]),
        }
    }
    if mark_after {
        bytes.push(ROW);
    }
    bytes
}

/// Tracked pixels: `AA w h`, a bit for each, `AA AA`.
pub(super) fn bitmap(view: &View<'_>, region: Region, filter: &Filter) -> Vec<Vec<u8>> {
    let mut all = vec![vec![BITMAP, region.width(), region.height()]];
    let mut tracked = Tracked::new(view, region, filter);
    let mut runs = Vec::new();
    for y in region.y1..=region.y2 {
        tracked.runs(y, &mut runs);
        let mut bits = vec![0_u8; usize::from(region.width().div_ceil(8))];
        for x in runs.iter().flat_map(|&(first, last)| first..=last) {
            let place = x - region.x1;
            bits[usize::from(place / 8)] |= 0x80 >> (place % 8);
        }
        all.push(bits);
    }
    all.push(vec![BITMAP, BITMAP]);
    all
}

/// Mean, least and greatest column, count and confidence of each row: `FE h`, five bytes each,
/// `FD`. Columns count from `left`, whose number is `origin`.
pub(super) fn rows(
    view: &View<'_>,
    region: Region,
    filter: &Filter,
    left: u8,
    origin: u8,
) -> Vec<Vec<u8>> {
    let mut all = vec![vec![LINES, region.height()]];
    let mut tracked = Tracked::new(view, region, filter);
    let mut runs = Vec::new();
    for y in region.y1..=region.y2 {
        tracked.runs(y, &mut runs);
        let columns = || runs.iter().flat_map(|&(first, last)| first..=last);
        let count = columns().count() as u32;
        let row = match (runs.first(), runs.last()) {
            (Some(&(first, _)), Some(&(_, last))) => {
                let mean = columns().map(u32::from).sum::<u32>() / count;
                let number = |column: u8| column - left + origin;
                [
                    number(mean as u8),
                    number(first),
                    number(last),
                    count.min(255) as u8,
                    blob::confidence(count, u32::from(last - first) + 1),
                ]
            }
            _ => [0; 5],
        };
        all.push(row.to_vec());
    }
    all.push(vec![LINES_END]);
    all
}

/// Mean colour of each row, and perhaps its deviation: `FE`, perhaps the number of rows, three or
/// six bytes each, `FD`.
pub(super) fn means(
    view: &View<'_>,
    region: Region,
    deviations: bool,
    height: bool,
) -> Vec<Vec<u8>> {
    let mut all = vec![vec![LINES]];
    if height {
        all.push(vec![region.height()]);
    }
    let mut pixels = Vec::new();
    for y in region.y1..=region.y2 {
        view.row(y, region.x1, region.x2, &mut pixels);
        let mut levels = Levels::new();
        pixels.iter().for_each(|&colour| levels.add(colour));
        all.push(numbers(&levels.statistics(), deviations));
    }
    all.push(vec![LINES_END]);
    all
}

fn numbers(statistics: &Statistics, deviations: bool) -> Vec<u8> {
    let mut numbers = statistics.mean.levels().to_vec();
    if deviations {
        numbers.extend(statistics.deviation.levels());
    }
    numbers
}

/// Blocks that differ: `AA w h`, a bit for each, `AA AA`.
pub(super) fn difference_bitmap(side: u8, differing: &[bool]) -> Vec<Vec<u8>> {
    let mut all = vec![vec![BITMAP, side, side]];
    for row in differing.chunks(usize::from(side)) {
        let bits = row.chunks(8).map(|blocks| {
            blocks
                .iter()
                .enumerate()
                .fold(0, |byte, (place, &differs)| {
                    byte | u8::from(differs) << (7 - place)
                })
        });
        all.push(bits.collect());
    }
    all.push(vec![BITMAP, BITMAP]);
    all
}

/// Difference of each block: `FC w h`, a byte for each, `FD`.
pub(super) fn deltas(now: &Grid, reference: &Grid) -> Vec<Vec<u8>> {
    let side = now.side();
    let mut all = vec![vec![DELTAS, side, side]];
    let deltas = now.deltas(reference);
    all.extend(deltas.chunks(usize::from(side)).map(<[u8]>::to_vec));
    all.push(vec![LINES_END]);
    all
}
