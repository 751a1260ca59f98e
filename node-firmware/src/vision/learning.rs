//! Search for bounds of a colour that hold the whole object in the middle of a view.
//!
//! A camera learns the mean of its middle and some levels to either side. Of a ball in a slanting light that holds
//! a crescent, whose edges are those of a shadow. So bounds are tried on the picture from which they were learnt:
//! those that were learnt, then wider ones, as long as the background has little of them. The outline of an object
//! stays where it is while bounds grow; the edge of a shadow moves, and so does that of something else that joins.
//! The bounds are the narrowest ones from which on the outline stays, until more of the background has them. If it
//! never does, the object was not seen whole, and nothing is learnt.
//!
//! [`Learning`] has no input of its own: it tells the [steps](Step) that a camera is to make, and takes in what
//! that sees.

use cmucam2_driver::{
    Command,
    colour::ColourBounds,
    geometry::{Size, Window},
    packet::Tracking,
};

use super::{BackgroundShare, VisionError, background};

/// Levels by which bounds grow each time.
const GROWTH: u8 = 16;

/// Bounds in all: the learnt ones, and wider ones.
const TRIALS: u8 = 6;

/// Columns and rows by which an edge that stays may be elsewhere: rows are half as high.
const COLUMNS: u8 = 1;
const ROWS: u8 = 2;

/// By how much an object that stays may fill its box more or less, 256 times the share.
const FILL: u8 = 16;

/// Views with the same bounds: the whole one, its [parts](background::part), and the whole one again.
const WHOLE: u8 = 0;
const MIDDLE: u8 = background::PARTS;

/// A search. See the [module](self).
#[derive(Clone, Debug)]
pub struct Learning {
    /// Those of the trial.
    bounds: ColourBounds,
    frame: Size,
    first: u8,
    trials: u8,
    view: u8,
    /// Pixels of the surroundings so far.
    count: u32,
    /// Share of the background that has the learnt bounds.
    share: BackgroundShare,
    /// Outline of the last trials, and the narrowest bounds that show it, with the share of the background that has
    /// them.
    outline: Outline,
    held: (ColourBounds, BackgroundShare),
    /// More than one trial showed it.
    stays: bool,
}

/// The next thing that a camera does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// It tracks these bounds.
    Bounds(ColourBounds),
    /// It looks at this part of its view, or at all of it.
    View(Option<Window>),
}

impl From<Step> for Command {
    fn from(step: Step) -> Self {
        match step {
            Step::Bounds(bounds) => Self::SetBounds(bounds),
            Step::View(window) => Self::VirtualWindow(window),
        }
    }
}

/// Edges of an object, and how much of its box it fills; 0 of none.
type Outline = [u8; 5];

impl Learning {
    /// A search that begins with the bounds that a camera has learnt in the middle of such a frame, whose first
    /// column and row have the number `first`.
    pub fn new(learnt: ColourBounds, frame: Size, first: u8) -> Self {
        Self {
            bounds: learnt,
            frame,
            first,
            trials: 0,
            view: WHOLE,
            count: 0,
            share: BackgroundShare::NONE,
            outline: [0; 5],
            held: (learnt, BackgroundShare::NONE),
            stays: false,
        }
    }

    /// The next step; `None` when the search is over.
    pub fn step(&self) -> Option<Step> {
        if self.view != WHOLE {
            let is_part = self.view <= MIDDLE;
            let part = || background::part(self.frame, self.first, self.view - 1);
            return Some(Step::View(is_part.then(part).flatten()));
        }
        (self.trials < TRIALS).then_some(Step::Bounds(self.bounds))
    }

    /// Takes in the packet that was seen after the [step](Self::step) of a camera that tracks.
    pub fn take(&mut self, seen: Option<Tracking>) {
        match self.view {
            WHOLE if seen.is_none_or(|seen| background::is_one_object(&seen, self.frame)) => {
                self.on_trial(BackgroundShare::NONE, seen);
            }
            WHOLE => {
                self.count = 0;
                self.view += 1;
            }
            1..MIDDLE => {
                self.count += seen.map_or(0, |seen| background::pixels(&seen));
                self.view += 1;
            }
            MIDDLE => {
                let of = background::surrounding_pixels(self.frame);
                self.on_trial(BackgroundShare::new(self.count, of), seen);
                self.view = MIDDLE + 1;
            }
            _ => self.view = WHOLE,
        }
    }

    /// Takes in the object that the bounds of a trial show, and the share of the background that has them.
    fn on_trial(&mut self, share: BackgroundShare, seen: Option<Tracking>) {
        if self.trials == 0 {
            self.share = share;
        }
        self.trials += 1;
        let outline = self.outline(seen);
        let most = [COLUMNS, ROWS, COLUMNS, ROWS, FILL];
        let mut pairs = outline.iter().zip(self.outline).zip(most);
        let is_same = outline != [0; 5] && pairs.all(|((a, b), most)| a.abs_diff(b) <= most);
        let (_, held) = self.held;
        // It is background that joins the object, and not the rest of it.
        if share.is_hopeless() || self.stays && !is_same && share > held {
            return self.trials = TRIALS;
        }
        self.stays = is_same;
        if !is_same {
            self.outline = outline;
            self.held = (self.bounds, share);
        }
        self.bounds = self.bounds.widened(GROWTH);
    }

    /// Share of the background that has the learnt bounds, once they were tried.
    pub fn background(&self) -> BackgroundShare {
        self.share
    }

    /// Bounds that hold the whole object, and the share of the background that has them.
    ///
    /// # Errors
    /// [`VisionError::CommonColour`], [`VisionError::PartOfObject`].
    pub fn verdict(&self) -> Result<(ColourBounds, BackgroundShare), VisionError> {
        if self.share.is_hopeless() {
            Err(VisionError::CommonColour(self.share))
        } else if self.stays {
            Ok(self.held)
        } else {
            Err(VisionError::PartOfObject)
        }
    }

    /// Returns true if a look at the middle of the view shows one compact thing that is whole there.
    pub fn is_whole(mut self, seen: Option<Tracking>) -> bool {
        self.view = MIDDLE;
        self.outline(seen) != [0; 5]
    }

    /// The outline of one compact thing that is whole in the middle.
    fn outline(&self, seen: Option<Tracking>) -> Outline {
        let told = seen.and_then(|seen| seen.bounding_box().zip(seen.confidence()));
        let Some((found, fill)) = told else {
            return [0; 5];
        };
        // Frames may be a column narrower, and numbers those of the frame or of the window.
        let is_whole = |from: u8, to: u8, side: u8| {
            let (middle, eighth) = (side / 2, side / 8);
            let outside = if self.view == MIDDLE { eighth } else { 0 };
            let last = side - outside - 2 + self.first;
            (self.first + outside + 1..=middle).contains(&from)
                && (middle - eighth..last).contains(&to)
                && to - from >= eighth
        };
        let is_object = fill >= background::COMPACT
            && is_whole(found.x1, found.x2, self.frame.width)
            && is_whole(found.y1, found.y2, self.frame.height);
        match is_object {
            true => [found.x1, found.y1, found.x2, found.y2, fill],
            false => [0; 5],
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    const FRAME: Size = Size {
        width: 88,
        height: 143,
    };
    const BALL: [u8; 8] = [44, 70, 34, 52, 53, 91, 78, 200];
    const LIT: [u8; 8] = [49, 57, 38, 52, 53, 82, 60, 165];
    const SHADED: [u8; 8] = [45, 65, 34, 52, 53, 91, 68, 176];
    const CRESCENT: [u8; 8] = [49, 56, 41, 34, 56, 108, 13, 22];
    const LOST: [u8; 8] = [0; 8];

    /// Looks beyond which the background has the bounds, and so many thousandths of it that have them; the red that is
    /// learnt.
    fn learn_before(looks: &[([u8; 8], u16)]) -> Result<[u8; 2], VisionError> {
        let learnt = ColourBounds::new([130, 190, 70, 130, 16, 76]).unwrap();
        let mut learning = Learning::new(learnt, FRAME, 1);
        let mut looks = looks.iter();
        while learning.step().is_some() {
            let (thousandths, seen) = match looks.next() {
                Some(&(seen, thousandths)) => (thousandths, Some(Tracking::new(seen))),
                None => (10, None),
            };
            learning.on_trial(BackgroundShare { thousandths }, seen);
        }
        let (bounds, _) = learning.verdict()?;
        Ok([bounds.red.min(), bounds.red.max()])
    }

    /// The same of a background that has none of them.
    fn learn(looks: &[[u8; 8]]) -> Result<[u8; 2], VisionError> {
        let looks: std::vec::Vec<_> = looks.iter().map(|&look| (look, 0)).collect();
        learn_before(&looks)
    }

    /// Bounds of which the background has more than of the object's are too wide, and no reason to doubt those.
    #[test]
    fn background_that_joins_ends_the_search() {
        const JOINED: [u8; 8] = [45, 72, 12, 20, 72, 122, 255, 140];
        for (looks, learnt) in [
            (&[(BALL, 0), (BALL, 0), (JOINED, 1)][..], Ok([130, 190])),
            (
                &[(LIT, 0), (BALL, 0), (BALL, 1), (JOINED, 2)],
                Ok([114, 206]),
            ),
            // There was some of it all the time.
            (
                &[(BALL, 3), (BALL, 3), (BALL, 4), (JOINED, 6)],
                Ok([130, 190]),
            ),
            (
                &[(BALL, 3), (BALL, 3), (JOINED, 3)],
                Err(VisionError::PartOfObject),
            ),
            // Before it stayed once.
            (
                &[(LIT, 0), (BALL, 0), (JOINED, 1)],
                Err(VisionError::PartOfObject),
            ),
        ] {
            assert_eq!(learn_before(looks), learnt, "{looks:?}");
        }
    }

    /// Learnt and wider bounds show the outline that is given; then the background has them.
    #[test]
    fn the_outline_stays() {
        const LEARNT: Result<[u8; 2], VisionError> = Ok([130, 190]);
        const PART: Result<[u8; 2], VisionError> = Err(VisionError::PartOfObject);
        let beside = [64, 70, 54, 52, 73, 91, 78, 200];
        let cut_off = [30, 70, 1, 40, 53, 101, 255, 201];
        let small = [44, 70, 40, 60, 48, 80, 20, 201];
        for (looks, learnt) in [
            (&[BALL; 6][..], LEARNT),
            (&[BALL; 2], LEARNT),
            (&[BALL], PART),
            // Wider ones find more of it, and stay there.
            (&[CRESCENT, LIT, SHADED, BALL, BALL], Ok([82, 238])),
            (&[LOST, LOST, BALL, BALL, BALL], Ok([98, 222])),
            // A lit part is compact, too: only wider bounds show that it is not all.
            (&[LIT, LIT, LIT, BALL, BALL], Ok([82, 238])),
            (&[LIT, LIT, LIT, BALL], PART),
            (&[SHADED, SHADED, BALL], PART),
            (&[LIT, BALL], PART),
            // Something joins it.
            (&[BALL, BALL, CRESCENT], PART),
            (&[LOST; 7], PART),
            (&[CRESCENT; 7], PART),
            (&[beside; 7], PART),
            (&[cut_off; 7], PART),
            (&[small; 7], PART),
        ] {
            assert_eq!(learn(looks), learnt, "{looks:?}");
        }
    }

    /// The middle of a view ends where the object may, by each way of counting.
    #[test]
    fn an_object_ends_within_the_view() {
        for (first, in_middle, x1, x2, is_whole) in [
            (1, false, 2, 86, true),
            (1, false, 1, 86, false),
            (1, false, 2, 87, false),
            (0, false, 1, 85, true),
            (0, false, 0, 85, false),
            (0, false, 1, 86, false),
            (1, true, 13, 75, true),
            (1, true, 12, 75, false),
            (1, true, 13, 76, false),
        ] {
            let learnt = ColourBounds::ALL;
            let mut learning = Learning::new(learnt, FRAME, first);
            let seen = Tracking::new([44, 70, x1, 40, x2, 101, 255, 201]);
            while learning.trials < TRIALS {
                learning.view = if in_middle { MIDDLE } else { WHOLE };
                learning.on_trial(BackgroundShare::NONE, Some(seen));
            }
            let told = (first, in_middle, x1, x2);
            assert_eq!(learning.verdict().is_ok(), is_whole, "{told:?}");
        }
    }

    /// A wall on the right has it: the view is looked at in its parts.
    #[test]
    fn a_colour_of_the_background_is_named() {
        let mut learning = Learning::new(ColourBounds::ALL, FRAME, 1);
        let mut steps = 0;
        while let Some(step) = learning.step() {
            let right = Window::new(78, 1, 88, 143).ok();
            learning.take(match step {
                Step::Bounds(_) => Some(Tracking::new([70, 72, 34, 1, 88, 143, 255, 100])),
                Step::View(part) if part == right => {
                    Some(Tracking::new([83, 72, 78, 1, 88, 143, 197, 255]))
                }
                Step::View(_) => Some(Tracking::LOST),
            });
            steps += 1;
        }
        let thousandths = (197 * 8 * 1_000_u32).div_ceil(12_584 - 66 * 109) as u16;
        let share = BackgroundShare { thousandths };
        assert_eq!(learning.verdict(), Err(VisionError::CommonColour(share)));
        assert_eq!(steps, 7);
    }
}
