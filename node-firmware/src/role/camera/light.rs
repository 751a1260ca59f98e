//! Decision when a camera adapts to the light. Gain and white balance are frozen after a start. Without a further
//! adaptation a change of daylight, or a target before the lens at the start, would hide targets for ever.

/// Looks in a row that see nothing after which a camera without a pose adapts.
const LOOKS: u16 = 12;

/// Weight of a look that sees nothing although the pose says that the target is in view.
const EXPECTED: u16 = 3;

/// Most doublings of the looks before the next adaptation, after adaptations that did not help.
const DOUBLINGS: u8 = 4;

/// Looks after an adaptation that miss a target that should be in view, from which on a camera counts as blind.
const BLIND: u8 = 3;

/// Looks that saw nothing.
#[derive(Clone, Debug)]
pub(super) struct Light {
    missed: u16,
    /// Adaptations since it saw the target last.
    adapted: u8,
    /// Looks since then that missed a target that should be in view.
    in_vain: u8,
    /// Largest distance at which this camera saw a target since its start, if it knows its pose.
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

    /// Notes that a target was seen, at this distance if that is known.
    pub(super) fn on_seen(&mut self, range: Option<f32>) {
        self.missed = 0;
        self.adapted = 0;
        self.in_vain = 0;
        if let Some(range) = range {
            self.farthest = Some(self.farthest.map_or(range, |farthest| farthest.max(range)));
        }
    }

    /// Returns true if it has adapted and still misses targets that should be in view.
    pub(super) const fn is_blind(&self) -> bool {
        self.in_vain >= BLIND
    }

    /// Returns true if a target could be seen from so far, if that is known.
    pub(super) fn reaches(&self, range: f32) -> Option<bool> {
        self.farthest.map(|farthest| range <= farthest)
    }

    /// Notes that nothing was seen. `is_expected`: the target should be in view, or not, or this is unknown. Returns
    /// true if the camera is to adapt now. It does so rather without a target in view, which would spoil the white
    /// balance.
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
