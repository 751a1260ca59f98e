//! Reason why a node stopped, in memory that a reset leaves alone.
//!
//! After power-on that memory holds anything; a checksum tells.

use node_firmware::message::Restart;

/// Bytes of text that are kept.
const LEN: usize = 112;

const fn words_of(why: Restart) -> &'static str {
    match why {
        Restart::RadioDeaf => "the radio is deaf",
        Restart::RadioStuck => "the radio is stuck",
        Restart::CameraStuck => "the camera's driver is stuck",
        Restart::Ordinary | Restart::Program => "the node stopped",
    }
}

/// A text that survives a reset. Any bits at all are a valid value.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct LastWords {
    len: u32,
    text: [u8; LEN],
    check: u32,
}

impl LastWords {
    /// Nothing was said.
    pub const NONE: Self = Self {
        len: 0,
        text: [0; LEN],
        check: 0,
    };

    /// A panic: its place, and its message if that was told without formatting.
    pub fn panic(file: &str, line: u32, message: Option<&str>) -> Self {
        let mut words = Self::NONE;
        // The end of a path tells more than its beginning.
        let from = file.len().saturating_sub(LEN / 2);
        words.push(file.as_bytes().get(from..).unwrap_or_default());
        words.push(b":");
        words.push_number(line);
        if let Some(message) = message {
            words.push(b" ");
            words.push(message.as_bytes());
        }
        words.sealed()
    }

    /// Reason why the program restarts by itself.
    pub fn decision(reason: &str) -> Self {
        let mut words = Self::NONE;
        words.push(reason.as_bytes());
        words.sealed()
    }

    /// The watchdog's reason, or that the node could not go on.
    pub fn restart(why: Restart) -> Self {
        Self::decision(words_of(why))
    }

    /// Reason why the program restarts, if these are words of one that broke or decided so; `watchdog`: it was the
    /// watchdog that restarted it.
    pub fn reason(&self, watchdog: bool) -> Restart {
        let own = [
            Restart::RadioDeaf,
            Restart::RadioStuck,
            Restart::CameraStuck,
        ];
        match self.text() {
            Some(text) => {
                { own.into_iter().find(|&why| words_of(why) == text) }.unwrap_or(Restart::Program)
            }
            None if watchdog => Restart::Program,
            None => Restart::Ordinary,
        }
    }

    /// A fault of the processor at this address.
    pub fn fault(address: u32) -> Self {
        let mut words = Self::NONE;
        words.push(b"fault at ");
        words.push_hexadecimal(address);
        words.sealed()
    }

    /// The text, if this is one.
    pub fn text(&self) -> Option<&str> {
        let text = self.text.get(..usize::try_from(self.len).ok()?)?;
        let is_one = self.len > 0 && self.check == self.sum();
        is_one.then(|| core::str::from_utf8(text).unwrap_or("not text"))
    }

    fn push(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(place) = self.text.get_mut(self.len as usize) {
                *place = byte;
                self.len += 1;
            }
        }
    }

    // Not `core::fmt`: a node has no room for the code that it brings along.

    fn push_number(&mut self, number: u32) {
        let mut power = 1_000_000_000;
        while power > 1 && number < power {
            power /= 10;
        }
        while power > 0 {
            self.push(&[b'0' + (number / power % 10) as u8]);
            power /= 10;
        }
    }

    fn push_hexadecimal(&mut self, number: u32) {
        for place in (0..8).rev() {
            let digit = (number >> (4 * place) & 0xf) as u8;
            self.push(&[digit + if digit < 10 { b'0' } else { b'a' - 10 }]);
        }
    }

    fn sealed(mut self) -> Self {
        self.check = self.sum();
        self
    }

    /// FNV-1a, and never 0.
    fn sum(&self) -> u32 {
        let step = |sum: u32, &byte: &u8| (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        let text = self.text.iter().fold(0x811c_9dc5, step);
        (text ^ self.len) | 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tells_where_and_why() {
        let words = LastWords::panic("src/radio.rs", 1204, Some("no frame"));
        assert_eq!(words.text(), Some("src/radio.rs:1204 no frame"));
        let words = LastWords::panic("src/main.rs", 7, None);
        assert_eq!(words.text(), Some("src/main.rs:7"));
        assert_eq!(LastWords::decision("too late").text(), Some("too late"));
        assert_eq!(
            LastWords::fault(0x00fe_dc01).text(),
            Some("fault at 00fedc01")
        );
    }

    #[test]
    fn the_reason_outlives_the_restart() {
        for why in [
            Restart::RadioDeaf,
            Restart::RadioStuck,
            Restart::CameraStuck,
            Restart::Program,
        ] {
            for watchdog in [false, true] {
                assert_eq!(LastWords::restart(why).reason(watchdog), why);
            }
        }
        let panic = LastWords::panic("src/main.rs", 7, None);
        assert_eq!(panic.reason(false), Restart::Program);
        assert_eq!(LastWords::NONE.reason(true), Restart::Program);
        assert_eq!(LastWords::NONE.reason(false), Restart::Ordinary);
    }

    #[test]
    fn too_long_is_cut_off() {
        let words = LastWords::panic(&"a/".repeat(500), u32::MAX, Some(&"b".repeat(500)));
        let text = words.text().unwrap();
        assert_eq!(text.len(), LEN);
        assert!(text.contains("a/:4294967295 bbb"), "{text}");
    }

    #[test]
    fn what_power_on_leaves_is_none() {
        assert_eq!(LastWords::NONE.text(), None);
        for byte in [0x00, 0x55, 0xff] {
            let number = u32::from_ne_bytes([byte; 4]);
            let words = LastWords {
                len: number,
                text: [byte; LEN],
                check: number,
            };
            assert_eq!(words.text(), None);
        }
        let mut words = LastWords::fault(1);
        words.text[3] ^= 4;
        assert_eq!(words.text(), None);
    }
}
