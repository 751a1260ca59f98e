//! Decimal text in fixed buffers.

/// A line of at most `N` bytes, ready to be sent or under construction.
///
/// Every line of this protocol has a known longest form and `N` is chosen for it, so nothing is
/// ever cut; if it were, `push` drops the byte rather than panicking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line<const N: usize> {
    bytes: [u8; N],
    len: u8,
}

impl<const N: usize> Line<N> {
    pub(crate) const EMPTY: Self = Self {
        bytes: [0; N],
        len: 0,
    };

    pub(crate) fn push(&mut self, byte: u8) {
        if let Some(free) = self.bytes.get_mut(usize::from(self.len)) {
            *free = byte;
            self.len += 1;
        }
    }

    pub(crate) fn text(&mut self, text: &[u8]) {
        for &byte in text {
            self.push(byte);
        }
    }

    pub(crate) fn number(&mut self, value: u8) {
        if value >= 100 {
            self.push(b'0' + value / 100);
        }
        if value >= 10 {
            self.push(b'0' + value / 10 % 10);
        }
        self.push(b'0' + value % 10);
    }

    /// Each number with a space before it.
    pub(crate) fn numbers(&mut self, values: &[u8]) {
        for &value in values {
            self.push(b' ');
            self.number(value);
        }
    }

    /// The bytes to send.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }
}
