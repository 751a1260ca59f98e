//! The colours that a camera learnt.

use super::CameraTask;
use crate::{
    facts::{Colours, Fact},
    limits::COLOURS_MAX,
    vision::ColourWindow,
};

/// Configured colours, and the learnt ones that replace them.
#[derive(Clone, Debug)]
pub(super) struct LearntColours {
    colours: Colours,
    /// Learnt before the start; the hardware does not know yet.
    is_restored: bool,
}

impl LearntColours {
    /// `configured`: checksum of the colours of the configuration.
    pub(super) fn new(configured: u32) -> Self {
        Self {
            colours: Colours {
                configured,
                learnt: [None; COLOURS_MAX],
            },
            is_restored: false,
        }
    }

    /// Takes the learnt ones of a former run, unless other colours are configured since.
    pub(super) fn restore(&mut self, colours: &Colours) {
        if colours.configured == self.colours.configured {
            self.colours = *colours;
            self.is_restored = true;
        }
    }

    /// A colour was learnt: returns true if that is news.
    pub(super) fn on_learnt(&mut self, colour: u8, window: ColourWindow) -> bool {
        match self.colours.learnt.get_mut(usize::from(colour)) {
            Some(learnt) => learnt.replace(window) != Some(window),
            None => false,
        }
    }

    /// The hardware has to know.
    pub(super) fn next_task(&mut self) -> Option<CameraTask> {
        let is_news = core::mem::take(&mut self.is_restored);
        is_news.then_some(CameraTask::Recall(self.colours.learnt))
    }

    pub(super) const fn fact(&self) -> Fact {
        Fact::Colours(self.colours)
    }
}
