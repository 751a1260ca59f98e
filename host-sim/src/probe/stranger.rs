//! Recognition of a device on the line that is no camera, by its bytes.

use std::fmt;

/// Number of received bytes that are looked at, and that are shown.
pub const HEARD_MAX: usize = 256;
const SHOWN_MAX: usize = 48;

/// A device that is no CMUcam2 ready for commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stranger {
    /// Another camera of the family.
    OtherCamera,
    /// An original Pixy, or what plays one: it tells blobs without being asked.
    OriginalPixy,
    /// It refuses whatever it is told.
    RefusesAll,
    /// A device that answers only with a prompt.
    Unacknowledged,
    /// Sent bytes come back.
    Echo,
    /// A GPS receiver that sends NMEA sentences.
    Nmea,
    /// A GPS receiver that sends u-blox packets.
    Ublox,
    /// A modem, or a module that takes AT commands.
    Modem,
    /// The console of a computer.
    Shell,
    /// An interpreter of Python on a microcontroller.
    Python,
    /// A boot loader.
    BootLoader,
    /// A radio co-processor or another speaker of HDLC.
    Hdlc,
    /// A line that is held low, or upside down.
    Break,
    /// Readable text of something else.
    Text,
}

impl fmt::Display for Stranger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OtherCamera => "that is another camera of the CMUcam family: its commands differ",
            Self::OriginalPixy => {
                "that is an original Pixy (CMUcam5), or an OpenMV Cam that plays one: --camera pixy, openmv or \
                 openmv-tags; or a Pixy2 whose \"Pixy 1.0 compatibility mode\" is ticked in PixyMon \
                 (Configure, Interface)"
            }
            Self::RefusesAll => {
                "it says NCK to everything: no CMUcam2 does that for long, so switch it off and on; \
                 a CMUcam1 has other commands"
            }
            Self::Unacknowledged => {
                "it answers with prompts alone: a CMUcam2 in raw mode 2 or 3 does, but RM 0 has not \
                 ended it; switch it off and on"
            }
            Self::Echo => {
                "what was sent comes back: are TX and RX of the adapter connected to each other?"
            }
            Self::Nmea => "that is a GPS receiver (NMEA 0183)",
            Self::Ublox => "that is a GPS receiver (u-blox binary protocol)",
            Self::Modem => "that is a modem, or a module with AT commands",
            Self::Shell => "that is the console of a computer",
            Self::Python => "that is a Python prompt of a microcontroller",
            Self::BootLoader => "that is a boot loader",
            Self::Hdlc => "that looks like HDLC frames: a radio co-processor?",
            Self::Break => {
                "only zero bytes come: the line is held low or its levels are upside down (RS-232 on \
                 TTL pins), or the other end is not powered; an original Pixy that sees nothing sends them, \
                 too"
            }
            Self::Text => "that is readable, so the baud rate is right, but it is no CMUcam2",
        })
    }
}

impl Stranger {
    /// Returns true if it was recognised by words that do not come by chance.
    pub const fn is_certain(self) -> bool {
        !matches!(
            self,
            Self::Break | Self::Echo | Self::Hdlc | Self::Text | Self::Unacknowledged
        )
    }

    /// Returns true if it talks all the time, and its bytes can be told from the picture of a camera.
    pub(super) const fn talks_unasked(self) -> bool {
        matches!(self, Self::OriginalPixy | Self::Nmea)
    }
}

/// Returns true if an original Pixy's block is in this: words of two bytes, the lower one first. A synchronisation
/// word, the sum of the words that follow, signature, x, y, width, height, and of a colour code its angle.
fn has_pixy_block(heard: &[u8]) -> bool {
    (0..heard.len()).any(|at| {
        let words = heard[at..]
            .as_chunks()
            .0
            .iter()
            .copied()
            .map(u16::from_le_bytes);
        let words: Vec<u16> = words.take(8).collect();
        let (sum, numbers) = match words[..] {
            [0xAA55, sum, ref numbers @ ..] => (sum, numbers.get(..5)),
            [0xAA56, sum, ref numbers @ ..] => (sum, numbers.get(..6)),
            _ => return false,
        };
        numbers.is_some_and(|numbers| {
            numbers[0] > 0 && numbers.iter().copied().fold(0, u16::wrapping_add) == sum
        })
    })
}

/// Returns true if a whole packet of a u-blox receiver is in this: two bytes at its begin, its class and number, the
/// length of what follows in two bytes, and a checksum of two bytes over all behind the begin (u-blox interface
/// descriptions, "UBX frame structure"). Its begin alone comes by chance where bytes have no meaning.
fn has_ublox_packet(heard: &[u8]) -> bool {
    (0..heard.len()).any(|at| {
        let [0xB5, 0x62, ref rest @ ..] = heard[at..] else {
            return false;
        };
        let [_, _, low, high, ..] = *rest else {
            return false;
        };
        let end = 4 + usize::from(u16::from_le_bytes([low, high]));
        let (Some(summed), Some(&[first, second, ..])) = (rest.get(..end), rest.get(end..)) else {
            return false;
        };
        let sums = summed.iter().fold((0_u8, 0_u8), |(first, second), byte| {
            let first = first.wrapping_add(*byte);
            (first, second.wrapping_add(first))
        });
        sums == (first, second)
    })
}

/// The device that sends this. `None`: it is not known; a wrong baud rate is likely.
pub fn name(heard: &[u8]) -> Option<Stranger> {
    let has = |text: &str| {
        heard
            .windows(text.len())
            .any(|part| part == text.as_bytes())
    };
    let any = |texts: &[&str]| texts.iter().any(|text| has(text));
    let only = |allowed: &[u8]| heard.iter().all(|byte| allowed.contains(byte));
    if heard.is_empty() {
        return None;
    }
    if heard.iter().all(|&byte| byte == 0) {
        return Some(Stranger::Break);
    }
    let stranger = if has_pixy_block(heard) {
        Stranger::OriginalPixy
    } else if has("CMUcam") && !any(&["CMUcam2", "CMUcam3"]) {
        Stranger::OtherCamera
    } else if any(&["$GP", "$GN", "$GL", "$GA", "!AIVDM"]) {
        Stranger::Nmea
    } else if has_ublox_packet(heard) {
        Stranger::Ublox
    } else if any(&["U-Boot", "bootloader", "Bootloader", "ets Jun", "rst:0x"]) {
        Stranger::BootLoader
    } else if any(&[">>> ", "MicroPython"]) {
        Stranger::Python
    } else if any(&[
        "login:",
        "assword:",
        "command not found",
        "not found\r",
        "~# ",
        "~$ ",
        "]# ",
    ]) {
        Stranger::Shell
    } else if has("NCK") && !has("ACK") && only(b"NCK\r\n:") {
        Stranger::RefusesAll
    } else if any(&["OK\r", "ERROR\r", "+CME", "NO CARRIER"]) {
        Stranger::Modem
    } else if only(b":") {
        Stranger::Unacknowledged
    } else if only(b"\r\n") || has("RM 0\r") || has("GV\r") {
        Stranger::Echo
    } else if heard.iter().filter(|&&byte| byte == 0x7E).count() >= 2 {
        Stranger::Hdlc
    } else if heard.len() >= 4 && heard.iter().all(|&byte| is_text(byte)) {
        Stranger::Text
    } else {
        return None;
    };
    Some(stranger)
}

fn is_text(byte: u8) -> bool {
    matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t')
}

/// The banner in the received bytes, if it is not that of a CMUcam2 as it was sold: extended firmware, or a
/// CMUcam3 that plays a CMUcam2.
pub fn kindred_banner(heard: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(heard);
    let banner = text.get(text.rfind("CMUcam")?..)?;
    let banner = banner.split(['\r', ':']).next().unwrap_or_default();
    (!banner.starts_with("CMUcam2 v1.0")).then(|| banner.to_owned())
}

/// The first received bytes in a form to be shown.
pub fn shown(heard: &[u8]) -> String {
    let shown = &heard[..heard.len().min(SHOWN_MAX)];
    let more = if heard.len() > SHOWN_MAX { "..." } else { "" };
    format!("received \"{}\"{more}", shown.escape_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kindred_firmware_is_told_from_what_was_sold() {
        for (heard, banner) in [
            (&b"ACK\rCMUcam2 v1.00 c6\r:"[..], None),
            (b"ACK\rCMUcam2 v1.01 c7:", None),
            (b"ACK\rCMUcam2 v2.0+ c6\r:", Some("CMUcam2 v2.0+ c6")),
            (b"\r:ACK\rCMUcam2+ v1.00 c6\r:", Some("CMUcam2+ v1.00 c6")),
            (b"ACK\rCMUcam3 v1.0\r:", Some("CMUcam3 v1.0")),
            (b"ACK\r:", None),
        ] {
            assert_eq!(kindred_banner(heard).as_deref(), banner);
        }
    }

    #[test]
    fn strangers_are_named_by_what_they_say() {
        for (heard, stranger) in [
            (
                &b"$GPGGA,123519,4807.038,N,01131.000,E,1,08\r\n"[..],
                Some(Stranger::Nmea),
            ),
            // A packet of 3 bytes between noise; a begin alone; a packet that is damaged, and one that is cut off.
            (
                b"\0\xB5\x62\x01\x07\x03\0\x1C\0\x02\x29\x96\xB5",
                Some(Stranger::Ublox),
            ),
            (b"\xB5\x62\xF8\x00\x1C\xE6\x80\xB5\x62", None),
            (b"\xB5\x62\x01\x07\x03\0\x1C\0\x03\x29\x96", None),
            (b"\xB5\x62\x01\x07\x03\0\x1C\0\x02\x29", None),
            (b"\r\nOK\r\n\r\nOK\r\n", Some(Stranger::Modem)),
            (b"\r\nERROR\r\n", Some(Stranger::Modem)),
            (b"\r\nraspberrypi login: ", Some(Stranger::Shell)),
            (
                b"\r\n-sh: GV: command not found\r\n~ # ",
                Some(Stranger::Shell),
            ),
            (b"\r\n>>> \r\n>>> ", Some(Stranger::Python)),
            (b"U-Boot 2023.01\r\n=> ", Some(Stranger::BootLoader)),
            (b"\r\r\r\r", Some(Stranger::Echo)),
            (b"\rRM\x01\x00\rRM 0\r\r", Some(Stranger::Echo)),
            (b"NCK\r:NCK\r:NCK\r:", Some(Stranger::RefusesAll)),
            // From the middle of a block on: one of signature 1 at 158, 104; the checksum of a colour code.
            (
                b"\x1E\0\x55\xAA\x55\xAA\x43\x01\x01\0\x9E\0\x68\0\x1E\0\x1E\0\x55\xAA",
                Some(Stranger::OriginalPixy),
            ),
            (
                b"\x55\xAA\x56\xAA\x5D\0\x0A\0\x10\0\x20\0\x08\0\x08\0\x13\0",
                Some(Stranger::OriginalPixy),
            ),
            (
                b"\x55\xAA\x55\xAA\x44\x01\x01\0\x9E\0\x68\0\x1E\0\x1E\0\x55\xAA",
                None,
            ),
            (b"::::", Some(Stranger::Unacknowledged)),
            (b"CMUcam v1.12 c6\r:", Some(Stranger::OtherCamera)),
            (b"\x7E\x80\x06\x00\x71\xFA\xB5\x7E", Some(Stranger::Hdlc)),
            (b"\0\0\0\0", Some(Stranger::Break)),
            (b"temperature 21.5 C\r\n", Some(Stranger::Text)),
            (b"\xF8\x00\x1C:\xE6\x80", None),
            (b"", None),
        ] {
            assert_eq!(name(heard), stranger, "{}", heard.escape_ascii());
        }
    }
}
