//! Judgement how well a learnt colour tells an object from its background, and a window of colours that does
//! it better.
//!
//! As on a node, the bounds are those that hold the whole object ([`node_firmware::vision::learning`]). Where some
//! of the background has them, the window is peeled as in the
//! patient rule induction method (J. H. Friedman and N. I. Fisher, "Bump hunting in high-dimensional
//! data", Statistics and Computing 9, 1999): of its six faces, the one is moved inwards that takes away most
//! of the background for a tenth of the object at most; then all is measured again. The camera's histograms
//! of tracked pixels (`HT 1`, `GH`) tell what is behind a face, once in the middle of the view and once
//! around it. A peeled window counts only if it, too, holds the whole object.

use cmucam2_driver::{
    Cmucam2, Command, Error, Packet,
    colour::{ColourBounds, ColourChannel, LEVEL_MAX, LEVEL_MIN},
    geometry::{Size, Window},
    packet::Tracking,
    session::Answer,
};
use embedded_hal::delay::DelayNs;
use embedded_io::{Read, ReadReady, Write};
use node_firmware::vision::{BackgroundShare, Learning, VisionError, background};

/// Share of the object that a step of peeling may cost at most.
const PEELED: f64 = 0.1;

/// Share of the background that a step must take away at least.
const WORTH: f64 = 0.03;

/// Share of the object that must be left.
const KEPT: f64 = 0.5;

/// Number of steps: each of the six faces twice.
const STEPS: usize = 12;

const CHANNELS: [ColourChannel; 3] = [
    ColourChannel::Red,
    ColourChannel::Green,
    ColourChannel::Blue,
];

/// Judgement of a colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Share of the background that has what was learnt.
    pub background: BackgroundShare,
    /// The best bounds that hold the whole object, or why there are none.
    pub best: Result<Bounds, VisionError>,
}

/// A window of colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Its levels.
    pub bounds: ColourBounds,
    /// Share of the background that has it.
    pub background: BackgroundShare,
    /// The part of the object's pixels that it keeps, 0.5 to 1; 1 of one that was not narrowed.
    pub kept: f64,
}

/// Judges the colour of an object that is in the middle of the view of a camera that has this frame and whose first
/// column and row have the number `first`. Afterwards the camera has all of its view, and is idle.
///
/// # Errors
/// Those of the driver.
pub fn judge<U, D>(
    camera: &mut Cmucam2<U, D>,
    bounds: ColourBounds,
    (frame, first): (Size, u8),
) -> Result<Judged, Error<U::Error>>
where
    U: Read + Write + ReadReady,
    D: DelayNs,
{
    let mut looks = Looks {
        camera,
        frame,
        first,
        middle: Window::central(frame),
        around: (0..background::PARTS - 1)
            .filter_map(|part| background::part(frame, first, part))
            .collect(),
    };
    looks.camera.set(Command::PollMode(true)).wait()?;
    let judged = looks.judge(bounds);
    // Also after a failure: the next command is to see the whole view.
    let camera = looks.camera;
    let back = [
        Command::VirtualWindow(None),
        Command::HistogramTracked(false),
        Command::PollMode(false),
    ];
    let back = back.map(|mode| camera.set(mode).wait());
    let judged = judged?;
    back.into_iter().collect::<Result<(), _>>().map(|()| judged)
}

/// A camera, and the parts of its view.
struct Looks<'a, U, D> {
    camera: &'a mut Cmucam2<U, D>,
    frame: Size,
    first: u8,
    middle: Window,
    around: Vec<Window>,
}

/// Pixels of a colour in the parts of the view.
struct Counted {
    object: u32,
    around: Vec<u32>,
}

impl<U: Read + Write + ReadReady, D: DelayNs> Looks<'_, U, D> {
    fn judge(&mut self, bounds: ColourBounds) -> Result<Judged, Error<U::Error>> {
        let learning = self.learn(bounds)?;
        let mut judged = Judged {
            background: learning.background(),
            best: learning.verdict().map(|(bounds, background)| Bounds {
                bounds,
                background,
                kept: 1.0,
            }),
        };
        if judged.background != BackgroundShare::NONE
            && let Some(peeled) = self.peeled(judged.best.map_or(bounds, |best| best.bounds))?
            && peeled.background < judged.background
            && !peeled.background.is_hopeless()
        {
            let middle = background::part(self.frame, self.first, background::PARTS - 1);
            let seen = self.look(peeled.bounds, middle)?;
            if learning.is_whole(seen) {
                judged.best = Ok(peeled);
            }
        }
        Ok(judged)
    }

    /// The search for bounds that hold the whole object.
    fn learn(&mut self, learnt: ColourBounds) -> Result<Learning, Error<U::Error>> {
        let mut learning = Learning::new(learnt, self.frame, self.first);
        self.camera.track_colour(learnt).wait()?;
        while let Some(step) = learning.step() {
            self.camera.set(step.into()).wait()?;
            learning.take(self.camera.next_tracking().wait()?);
        }
        Ok(learning)
    }

    /// Narrower bounds of which less of the background is, if there are any.
    fn peeled(&mut self, bounds: ColourBounds) -> Result<Option<Bounds>, Error<U::Error>> {
        let (mut now, mut counted) = (bounds, self.count(bounds)?);
        let mut least = self.share(&counted);
        let object = f64::from(counted.object.max(1));
        let mut better = None;
        for _ in 0..STEPS {
            if self.share(&counted) == BackgroundShare::NONE {
                break;
            }
            let Some(peeled) = self.peel(now, &counted)? else {
                break;
            };
            (now, counted) = (peeled, self.count(peeled)?);
            let kept = (f64::from(counted.object) / object).min(1.0);
            if kept < KEPT {
                break;
            }
            let background = self.share(&counted);
            if background < least {
                least = background;
                better = Some(Bounds {
                    bounds: now,
                    background,
                    kept,
                });
            }
        }
        Ok(better)
    }

    fn look(
        &mut self,
        bounds: ColourBounds,
        window: Option<Window>,
    ) -> Result<Option<Tracking>, Error<U::Error>> {
        self.camera.set(Command::VirtualWindow(window)).wait()?;
        self.camera.track_colour(bounds).wait()?;
        self.camera.next_tracking().wait()
    }

    fn count(&mut self, bounds: ColourBounds) -> Result<Counted, Error<U::Error>> {
        let (middle, around) = (self.middle, self.around.clone());
        let mut pixels = |window| {
            let seen = self.look(bounds, Some(window))?;
            Ok::<u32, Error<U::Error>>(seen.map_or(0, |seen| background::pixels(&seen)))
        };
        Ok(Counted {
            object: pixels(middle)?,
            around: around.into_iter().map(pixels).collect::<Result<_, _>>()?,
        })
    }

    fn share(&self, counted: &Counted) -> BackgroundShare {
        let of = background::surrounding_pixels(self.frame);
        BackgroundShare::new(counted.around.iter().sum(), of)
    }

    /// The bounds with the face moved inwards that is worth most, if any is worth it.
    fn peel(
        &mut self,
        bounds: ColourBounds,
        counted: &Counted,
    ) -> Result<Option<ColourBounds>, Error<U::Error>> {
        let mut best: Option<(f64, ColourBounds)> = None;
        for (channel, place) in CHANNELS.into_iter().zip([0, 2, 4]) {
            let object = self.levels(bounds, channel, &[(self.middle, counted.object)])?;
            let around: Vec<_> = (self.around.iter().copied())
                .zip(counted.around.iter().copied())
                .filter(|&(_, pixels)| pixels > 0)
                .collect();
            let around = self.levels(bounds, channel, &around)?;
            let values = bounds.values();
            let (low, high) = (values[place], values[place + 1]);
            for cut in cuts(&object, &around, (low, high)) {
                let mut values = values;
                values[place..place + 2].copy_from_slice(&cut.levels);
                let Ok(bounds) = ColourBounds::new(values) else {
                    continue;
                };
                if cut.worth > best.map_or(WORTH, |(worth, _)| worth) {
                    best = Some((cut.worth, bounds));
                }
            }
        }
        Ok(best.map(|(_, bounds)| bounds))
    }

    /// Distribution of the tracked pixels of some windows over the bins of a channel; the sum is 1.
    fn levels(
        &mut self,
        bounds: ColourBounds,
        channel: ColourChannel,
        windows: &[(Window, u32)],
    ) -> Result<Vec<f64>, Error<U::Error>> {
        let mut spread: Vec<f64> = Vec::new();
        self.camera.set(Command::SetBounds(bounds)).wait()?;
        self.camera.set(Command::HistogramTracked(true)).wait()?;
        for &(window, pixels) in windows {
            self.camera
                .set(Command::VirtualWindow(Some(window)))
                .wait()?;
            let answer = self.camera.command(Command::GetHistogram(channel)).wait()?;
            let Answer::Packet(Packet::Histogram(histogram)) = answer else {
                continue;
            };
            let bins = histogram.bins();
            let sum: f64 = bins.iter().copied().map(f64::from).sum();
            spread.resize(bins.len().max(spread.len()), 0.0);
            for (place, &bin) in spread.iter_mut().zip(bins) {
                *place += f64::from(bin) / sum.max(1.0) * f64::from(pixels);
            }
        }
        let sum: f64 = spread.iter().sum();
        Ok(spread
            .into_iter()
            .map(|part| part / sum.max(1e-9))
            .collect())
    }
}

/// A face that is moved inwards.
struct Cut {
    levels: [u8; 2],
    /// The part of the background that it takes away, less that of the object.
    worth: f64,
}

/// The lower and the upper face of a channel, each moved as far as the object allows, by whole bins.
fn cuts(object: &[f64], around: &[f64], (low, high): (u8, u8)) -> Vec<Cut> {
    let bins = object.len().min(around.len());
    let edge = |bin: usize| {
        let span = f64::from(LEVEL_MAX - LEVEL_MIN);
        f64::from(LEVEL_MIN) + bin as f64 * span / bins.max(1) as f64
    };
    let sum = |parts: &[f64]| parts.iter().sum::<f64>();
    let mut cuts = Vec::new();
    for cut in 1..bins {
        let level = edge(cut).round() as u8;
        if level <= low || level > high {
            continue;
        }
        for (levels, lost, removed) in [
            ([level, high], sum(&object[..cut]), sum(&around[..cut])),
            ([low, level - 1], sum(&object[cut..]), sum(&around[cut..])),
        ] {
            if lost <= PEELED {
                let worth = removed - lost;
                cuts.push(Cut { levels, worth });
            }
        }
    }
    cuts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The object's levels are 96 to 111, those of the background 104 to 135 and 64 to 71.
    #[test]
    fn the_cut_takes_what_only_the_background_has() {
        let spread = |from: usize, to: usize| {
            let mut bins = vec![0.0; 28];
            for bin in &mut bins[from..to] {
                *bin = 1.0 / (to - from) as f64;
            }
            bins
        };
        // Bins of eight levels from 16 on.
        let object = spread(10, 12);
        let around = spread(11, 15);
        let best = cuts(&object, &around, (60, 140))
            .into_iter()
            .max_by(|a, b| a.worth.total_cmp(&b.worth))
            .unwrap();
        assert_eq!(best.levels, [60, 111]);
        assert!((best.worth - 0.75).abs() < 1e-9);
        // A cut that costs the object more than a tenth is not made.
        assert!(
            cuts(&object, &object, (60, 140))
                .iter()
                .all(|cut| cut.worth < 1e-9)
        );
        assert!(cuts(&[], &around, (60, 140)).is_empty());
    }
}
