//! Pixels of a frame that count, found exactly by computing only those that noise decides.

use std::ops::RangeInclusive;

use super::{
    blob::Filter,
    colour::Colour,
    view::{Region, View},
};

/// Verdict on the pixels of one paint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Never,
    Always,
    /// Each has to be computed.
    Perhaps,
}

impl Verdict {
    pub(super) fn sure(counts: bool) -> Self {
        if counts { Self::Always } else { Self::Never }
    }

    pub(super) fn inverted(self) -> Self {
        match self {
            Self::Never => Self::Always,
            Self::Always => Self::Never,
            Self::Perhaps => Self::Perhaps,
        }
    }
}

/// A region of a view, seen through a filter.
pub(super) struct Tracked<'a> {
    view: &'a View<'a>,
    region: Region,
    filter: &'a Filter,
    /// Verdicts on the patches, from back to front.
    patches: Vec<Verdict>,
    /// Verdict on the background, if it is the same in all rows.
    backdrop: Option<Verdict>,
    /// Nothing counts outside of these rows.
    rows: (u8, u8),
    row: Vec<Verdict>,
    pixels: Vec<Colour>,
}

impl<'a> Tracked<'a> {
    pub(super) fn new(view: &'a View<'a>, region: Region, filter: &'a Filter) -> Self {
        let patches: Vec<Verdict> = view.verdicts(filter).collect();
        let backdrop = view.backdrop_verdict(filter);
        let rows = if backdrop == Some(Verdict::Never) {
            let counting = patches.iter().map(|&verdict| verdict != Verdict::Never);
            view.rows_of(counting)
        } else {
            (region.y1, region.y2)
        };
        Self {
            view,
            region,
            filter,
            patches,
            backdrop,
            rows,
            row: Vec::new(),
            pixels: Vec::new(),
        }
    }

    /// Rows in which anything may count.
    pub(super) fn rows(&self) -> RangeInclusive<u8> {
        let (first, last) = self.rows;
        first.max(self.region.y1)..=last.min(self.region.y2)
    }

    /// The runs of counting pixels of one row, as first and last columns.
    pub(super) fn runs(&mut self, y: u8, runs: &mut Vec<(u8, u8)>) {
        runs.clear();
        if !(self.rows.0..=self.rows.1).contains(&y) {
            return;
        }
        let Some(from) = self.judge(y) else {
            return;
        };
        let needed = u16::from(self.filter.run.max(1));
        let mut x = u16::from(from);
        for run in self.row.chunk_by(PartialEq::eq) {
            let length = run.len() as u16;
            if run[0] == Verdict::Always && length >= needed {
                let skipped = if self.filter.tail_only { needed - 1 } else { 0 };
                runs.push(((x + skipped) as u8, (x + length - 1) as u8));
            }
            x += length;
        }
    }

    /// Fills `row`, with no `Perhaps`, from the column that is returned on. Columns outside of it do not count.
    fn judge(&mut self, y: u8) -> Option<u8> {
        let Region { x1, x2, .. } = self.region;
        let backdrop = self
            .backdrop
            .unwrap_or_else(|| self.view.row_verdict(y, self.filter));
        let mut span = (backdrop != Verdict::Never).then_some((x1, x2));
        self.row.clear();
        self.row.resize(usize::from(x2 - x1) + 1, backdrop);
        let place = |x: u8| usize::from(x - x1);
        for (patch, &verdict) in self.patches.iter().enumerate() {
            let Some((first, last)) = self.view.columns(patch, y, x1, x2) else {
                continue;
            };
            self.row[place(first)..=place(last)].fill(verdict);
            if verdict != Verdict::Never {
                let (from, to) = span.unwrap_or((first, last));
                span = Some((from.min(first), to.max(last)));
            }
        }
        let (from, to) = span?;
        self.row.truncate(place(to) + 1);
        self.row.drain(..place(from));
        let mut x = from;
        for run in self.row.chunk_by_mut(|a, b| a == b) {
            let next = x.wrapping_add(run.len() as u8);
            if run[0] == Verdict::Perhaps {
                self.view.row(y, x, next.wrapping_sub(1), &mut self.pixels);
                for (verdict, &pixel) in run.iter_mut().zip(&self.pixels) {
                    *verdict = Verdict::sure(self.filter.accepts(pixel));
                }
            }
            x = next;
        }
        Some(from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::mix;
    use crate::{
        colour::Bounds,
        scene::{Background, Extent, Patch, Scene, Shape},
        sensor::Size,
        view::{Layout, Snapshot},
    };

    const COLUMNS: u8 = 88;
    const ROWS: u8 = 143;

    /// Numbers that follow from a case.
    struct Numbers(u64);

    impl Numbers {
        fn below(&mut self, below: u64) -> u64 {
            self.0 = mix(self.0);
            self.0 % below
        }

        /// In steps of a quarter of a pixel, so that edges lie on the middles of pixels at times.
        fn place(&mut self, pixels: u8) -> f64 {
            let quarters = u64::from(pixels) * 4;
            let finely = if self.below(2) == 0 { 0.0 } else { 0.013 };
            let place = self.below(quarters * 5 / 4) as f64 - quarters as f64 / 8.0;
            (place + finely) / quarters as f64
        }

        fn patch(&mut self) -> Patch {
            let [x, y] = [self.place(COLUMNS), self.place(ROWS)];
            Patch {
                extent: Extent {
                    left: x,
                    right: x + self.place(COLUMNS).abs() / 2.0,
                    top: y,
                    bottom: y + self.place(ROWS).abs() / 2.0,
                },
                shape: [Shape::Disc, Shape::Box][self.below(2) as usize],
                colour: [[210, 105, 40], [165, 100, 50], [90; 3]][self.below(3) as usize],
            }
        }
    }

    /// Against every pixel of the frame, computed and counted.
    #[test]
    fn what_counts_is_what_the_pixels_say() {
        let mut runs_found = 0;
        for case in 0..600 {
            let mut numbers = Numbers(case);
            let background = match numbers.below(4) {
                0 => Background::Gradient {
                    top: [220, 110, 40],
                    bottom: [40, 30, 20],
                },
                1 => Background::Blocks {
                    columns: 5,
                    rows: 3,
                    colours: vec![[200, 100, 50], [60, 50, 40], [90; 3], [172, 66, 20]],
                },
                _ => Background::Plain([90; 3]),
            };
            let scene = Scene {
                background,
                noise: numbers.below(3) as f64 * 4.0,
                ..Scene::default()
            };
            let patches = (0..numbers.below(4)).map(|_| numbers.patch()).collect();
            let snapshot = Snapshot {
                background: scene.background.clone(),
                patches,
                factors: [1.0; 3],
                contrast: 1.0,
                seed: case,
                ..Snapshot::default()
            };
            let layout = Layout {
                picture: [u16::from(COLUMNS), u16::from(ROWS)],
                frame: Size::new(COLUMNS, ROWS),
                down_sampling: [1; 2],
                luminance_chrominance: numbers.below(5) == 0,
                difference: numbers.below(5) == 0,
            };
            let filter = Filter {
                bounds: Bounds([170, 240, 60, 150, 16, 90]),
                invert: numbers.below(4) == 0,
                run: numbers.below(4) as u8,
                tail_only: numbers.below(2) == 0,
            };
            let region = Region {
                x1: numbers.below(30) as u8,
                y1: numbers.below(30) as u8,
                x2: 60 + numbers.below(28) as u8,
                y2: 100 + numbers.below(43) as u8,
            };
            let view = View::new(&scene, &snapshot, layout);
            let mut tracked = Tracked::new(&view, region, &filter);
            let (mut runs, mut pixels) = (Vec::new(), Vec::new());
            for y in region.y1..=region.y2 {
                tracked.runs(y, &mut runs);
                runs_found += runs.len();
                view.row(y, region.x1, region.x2, &mut pixels);
                let counts: Vec<bool> = pixels.iter().map(|&p| filter.accepts(p)).collect();
                let needed = usize::from(filter.run.max(1));
                let mut expected = vec![false; counts.len()];
                for end in needed..=counts.len() {
                    if counts[end - needed..end].iter().all(|&counts| counts) {
                        let from = if filter.tail_only {
                            end - 1
                        } else {
                            end - needed
                        };
                        expected[from..end].fill(true);
                    }
                }
                let mut found = vec![false; counts.len()];
                for &(first, last) in &runs {
                    let place = |x: u8| usize::from(x - region.x1);
                    found[place(first)..=place(last)].fill(true);
                }
                assert_eq!(found, expected, "case {case}, row {y}");
            }
        }
        assert!(runs_found > 10_000);
    }
}
