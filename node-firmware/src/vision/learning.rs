//! Search for bounds of a colour that hold the whole object in the middle of a view.
//!
//! A camera learns the mean of its middle and some levels to either side. Of a ball in a slanting light that holds
//! a crescent, whose edges are those of a shadow. So bounds are tried on the picture from which they were learnt:
//! somewhat narrower ones, those that were learnt, then wider ones, as long as no more of the background has them.
//! The outline of an object stays where it is while bounds grow; the edge of a shadow moves, and so does that of
//! something else that joins. The bounds are the narrowest of the learnt ones and wider ones from which on the
//! outline stays. If it never does, the object was not seen whole, and nothing is learnt.
//!
//! [`Learning`] has no input of its own: it tells which bounds to look with, and takes in the look.

use cmucam2_driver::{colour::ColourBounds, geometry::Size, packet::Tracking};

use super::{BackgroundShare, VisionError, background};

/// Levels by which the first bounds are narrower than those that were learnt.
const NARROWER: i16 = 8;

/// Levels by which bounds grow each time.
const GROWTH: i16 = 16;

/// Looks in all: with narrower bounds, with the learnt ones, with wider ones.
const LOOKS: u8 = 7;

/// Columns or rows by which an edge that stays may be elsewhere.
const EDGE: u8 = 2;

/// By how much an object that stays may fill its box more or less, 256 times the share.
const FILL: u8 = 16;

/// A search. See the [module](self).
#[derive(Clone, Debug)]
pub struct Learning {
    learnt: ColourBounds,
    frame: Size,
    first: u8,
    looks: u8,
    /// Share of the background that has the learnt bounds.
    share: BackgroundShare,
    found: Option<Found>,
}

/// An outline, and the narrowest bounds that show it.
#[derive(Clone, Debug)]
struct Found {
    bounds: ColourBounds,
    /// Edges and fill.
    outline: [u8; 5],
    /// Wider bounds show it, too.
    stays: bool,
}

impl Learning {
    /// A search that begins with the bounds that a camera has learnt in the middle of such a frame, whose first
    /// column and row have the number `first`.
    pub fn new(learnt: ColourBounds, frame: Size, first: u8) -> Self {
        Self {
            learnt,
            frame,
            first,
            looks: 0,
            share: BackgroundShare::NONE,
            found: None,
        }
    }

    /// Bounds for the next look; `None` when the search is over.
    pub fn trial(&self) -> Option<ColourBounds> {
        match self.looks {
            0 => Some(self.learnt.widened(-NARROWER)),
            wider if wider < LOOKS => Some(self.learnt.widened(i16::from(wider - 1) * GROWTH)),
            _ => None,
        }
    }

    /// Takes in the look with the bounds of the [trial](Self::trial): the share of the background that has them, and the
    /// object that they show in the whole view, or in the [middle](background::middle) of it (`in_middle`).
    pub fn take(&mut self, share: BackgroundShare, seen: Option<Tracking>, in_middle: bool) {
        let Some(bounds) = self.trial() else {
            return;
        };
        self.looks += 1;
        match self.looks {
            1 => {}
            2 => self.share = share,
            _ if share > self.share => return self.looks = LOOKS,
            _ => {}
        }
        let outline = seen.and_then(|seen| self.outline(&seen, in_middle));
        match (&mut self.found, outline) {
            (Some(found), Some(outline)) if found.shows(outline) => found.stays = self.looks > 1,
            (found, outline) => {
                *found = outline.map(|outline| Found {
                    bounds: if self.looks == 1 { self.learnt } else { bounds },
                    outline,
                    stays: false,
                });
            }
        }
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
        match &self.found {
            _ if self.share.is_hopeless() => Err(VisionError::CommonColour(self.share)),
            Some(found) if found.stays => Ok((found.bounds, self.share)),
            _ => Err(VisionError::PartOfObject),
        }
    }

    /// Returns true if this look shows one compact thing that is whole in the middle.
    pub fn is_whole(&self, seen: Option<Tracking>, in_middle: bool) -> bool {
        seen.is_some_and(|seen| self.outline(&seen, in_middle).is_some())
    }

    /// The outline of one compact thing that is whole in the middle.
    fn outline(&self, seen: &Tracking, in_middle: bool) -> Option<[u8; 5]> {
        let (found, fill) = seen.bounding_box().zip(seen.confidence())?;
        // Frames may be a column narrower, and numbers those of the frame or of the window.
        let is_whole = |from: u8, to: u8, side: u8| {
            let (middle, eighth) = (side / 2, side / 8);
            let outside = if in_middle { eighth } else { 0 };
            let last = side - outside - 2 + self.first;
            (self.first + outside + 1..=middle).contains(&from)
                && (middle - eighth..last).contains(&to)
                && to - from >= eighth
        };
        let is_object = fill >= background::COMPACT
            && is_whole(found.x1, found.x2, self.frame.width)
            && is_whole(found.y1, found.y2, self.frame.height);
        is_object.then_some([found.x1, found.y1, found.x2, found.y2, fill])
    }
}

impl Found {
    fn shows(&self, outline: [u8; 5]) -> bool {
        let most = [EDGE, EDGE, EDGE, EDGE, FILL];
        let pairs = self.outline.into_iter().zip(outline).zip(most);
        pairs
            .into_iter()
            .all(|((a, b), most)| a.abs_diff(b) <= most)
    }
}

#[cfg(test)]
mod tests {
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

    /// Looks beyond which more of the background has the bounds than that; the red that is learnt.
    fn learn(looks: &[[u8; 8]]) -> Result<[u8; 2], VisionError> {
        let learnt = ColourBounds::new([130, 190, 70, 130, 16, 76]).unwrap();
        let mut learning = Learning::new(learnt, FRAME, 1);
        let mut looks = looks.iter();
        while learning.trial().is_some() {
            let (share, seen) = match looks.next() {
                Some(&seen) => (BackgroundShare::NONE, Some(Tracking::new(seen))),
                None => (BackgroundShare { thousandths: 1 }, None),
            };
            learning.take(share, seen, false);
        }
        let (bounds, _) = learning.verdict()?;
        Ok([bounds.red.min(), bounds.red.max()])
    }

    /// Narrower, learnt and wider bounds show the outline that is given; then the background has them.
    #[test]
    fn the_outline_stays() {
        const LEARNT: Result<[u8; 2], VisionError> = Ok([130, 190]);
        const PART: Result<[u8; 2], VisionError> = Err(VisionError::PartOfObject);
        let beside = [64, 70, 54, 52, 73, 91, 78, 200];
        let cut_off = [30, 70, 1, 40, 53, 101, 255, 201];
        let small = [44, 70, 40, 60, 48, 80, 20, 201];
        for (looks, learnt) in [
            (&[BALL; 7][..], LEARNT),
            (&[BALL; 2], LEARNT),
            // Wider ones find more of it, and stay there.
            (&[CRESCENT, LIT, SHADED, BALL, BALL], Ok([98, 222])),
            (&[LOST, LOST, BALL, BALL, BALL], Ok([114, 206])),
            // A lit part is compact, too: only wider bounds show that it is not all.
            (&[LIT, LIT, LIT, BALL, BALL], Ok([98, 222])),
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
            while learning.trial().is_some() {
                learning.take(BackgroundShare::NONE, Some(seen), in_middle);
            }
            let told = (first, in_middle, x1, x2);
            assert_eq!(learning.verdict().is_ok(), is_whole, "{told:?}");
        }
    }

    #[test]
    fn a_colour_of_the_background_is_named() {
        let mut learning = Learning::new(ColourBounds::ALL, FRAME, 1);
        let share = BackgroundShare { thousandths: 445 };
        while learning.trial().is_some() {
            learning.take(share, Some(Tracking::new(BALL)), true);
        }
        assert_eq!(learning.verdict(), Err(VisionError::CommonColour(share)));
    }
}
