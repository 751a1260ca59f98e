//! Dropped bytes, and the reasons.

/// Bytes that did not become an event, and the reasons. Counters stop at their greatest value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DroppedBytes {
    /// Bytes in all.
    pub bytes: u32,
    /// Runs of bytes that begin nothing.
    pub noise: u32,
    /// Lines with anything but letters and plain numbers where they belong.
    pub malformed: u32,
    /// Lines that ended early: in a prompt, in another line, in silence.
    pub cut: u32,
    /// Packets and values with a wrong number of fields.
    pub fields: u32,
    /// Packets with coordinates out of order or outside the frame, or whose numbers contradict
    /// each other.
    pub impossible: u32,
    /// Images with a wrong header, a wrong count or an impossible byte.
    pub images: u32,
}

#[derive(Clone, Copy)]
pub(super) enum Reason {
    Noise,
    Malformed,
    Cut,
    Fields,
    Impossible,
    Image,
}

impl DroppedBytes {
    pub(super) fn count(&mut self, reason: Reason) {
        let counter = match reason {
            Reason::Noise => &mut self.noise,
            Reason::Malformed => &mut self.malformed,
            Reason::Cut => &mut self.cut,
            Reason::Fields => &mut self.fields,
            Reason::Impossible => &mut self.impossible,
            Reason::Image => &mut self.images,
        };
        *counter = counter.saturating_add(1);
    }
}
