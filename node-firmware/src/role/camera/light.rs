//! Times when a camera adapts to the light again: gain and white balance are frozen after a start, so a
//! change of daylight, or a target before the lens at that moment, hides the target for good.

/// Without a pose so many looks in a row see nothing before the camera adapts.
const LOOKS: u16 = 12;

/// A look that sees nothing where the pose says that the target is in view counts as so many.
const EXPECTED: u16 = 3;

/// After an adaptation that did not help, the next one waits for twice as many looks, doubled so often at
/// most.
const DOUBLINGS: u8 = 4;

/// A camera is blind when it has adapted, and then so often does not see the target where its pose says that
/// it is in view.
const BLIND: u8 = 3;

/// Looks that saw nothing.
#[derive(Clone, Debug)]
pub(super) struct Light {
    missed: u16,
    /// Adaptations since it saw the target last.
    adapted: u8,
    /// Looks since then that saw nothing where the target is expected.
    in_vain: u8,
    /// The largest distance of a target that this camera, knowing its pose, saw in this run.
    farthest: Option<f32>,
}

impl Light {
    pub(super) const fn new() -> Self {
        Self {
            missed: 0,
            adapted: 0,
            in_vain: 0,
            farthest: None,
        }
    }

    /// The target is seen, so far away if that is known.
    pub(super) fn on_seen(&mut self, range: Option<f32>) {
        self.missed = 0;
        self.adapted = 0;
        self.in_vain = 0;
        if let Some(range) = range {
            self.farthest = Some(self.farthest.map_or(range, |farthest| farthest.max(range)));
        }
    }

    /// Returns true if it sees nothing where it should although it adapted.
    pub(super) const fn is_blind(&self) -> bool {
        self.in_vain >= BLIND
    }

    /// Returns true if a target could be seen from so far, if that is known.
    pub(super) fn reaches(&self, range: f32) -> Option<bool> {
        self.farthest.map(|farthest| range <= farthest)
    }

    /// Nothing is seen, where the target is expected in view or not, or where that is not known (`None`).
    /// Returns true if the camera is to adapt to the light now: rather while the target is not before it, for
    /// that would spoil the white balance again.
    pub(super) fn on_nothing(&mut self, is_expected: Option<bool>) -> bool {
        let weight = match is_expected {
            Some(true) => EXPECTED,
            Some(false) => 0,
            None => 1,
        };
        self.missed = self.missed.saturating_add(weight);
        if self.adapted > 0 && is_expected == Some(true) {
            self.in_vain = self.in_vain.saturating_add(1);
        }
        let limit = LOOKS << self.adapted;
        let limit = if is_expected == Some(true) {
            2 * limit
        } else {
            limit
        };
        let is_due = self.missed >= limit;
        if is_due {
            self.missed = 0;
            self.adapted = (self.adapted + 1).min(DOUBLINGS);
        }
        is_due
    }
}
