//! Commands as a camera reads them: from a line of text, or byte by byte in raw input.
//!
//! The camera understands the commands that the manual lists and that public programs send: letters of either
//! case, with or without a space after them, several spaces, a space or a line feed before the carriage return.
//! Arguments are not judged beyond what makes a command impossible: colour levels of 0 to 255 in any order, servo
//! positions, masks and modes with bits that mean nothing are all taken, as CMU's own firmware takes them.

use std::fmt;

use Takes::{Exactly, OneOrTwo, OrNone, Pairs};

/// The most arguments a command has: five registers with their values.
pub(super) const ARGUMENTS_MAX: usize = 10;

/// A command: two capital letters and its arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Command {
    /// Its name.
    pub letters: [u8; 2],
    /// Bytes that follow.
    pub arguments: Vec<u8>,
}

impl fmt::Display for Command {
    /// The line without its carriage return.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.letters.escape_ascii())?;
        self.arguments
            .iter()
            .try_for_each(|argument| write!(f, " {argument}"))
    }
}

/// Reason why something is no command. The camera answers `NCK` to all of them.
pub(super) type Refusal = &'static str;

const UNKNOWN: Refusal = "no command has these letters";
const COUNT: Refusal = "this command takes another number of arguments";
const NUMBER: Refusal = "an argument must be a decimal number from 0 to 255";
const VALUE: Refusal = "an argument has no meaning";

/// Arguments that a command takes.
pub(super) enum Takes {
    /// So many, each at most this.
    Exactly(&'static [u8]),
    /// The same, or none.
    OrNone(&'static [u8]),
    /// This, and perhaps one more.
    OneOrTwo,
    /// Pairs, or none.
    Pairs,
}

/// Any byte.
const ANY: u8 = 255;

/// A command: its letters, the arguments that it takes, and those that hold after a reset, where all that it does is to
/// set them.
pub(super) type Row = (&'static [u8; 2], Takes, &'static [u8]);

/// All commands.
pub(super) const COMMANDS: &[Row] = &[
    (b"BM", Exactly(&[1]), &[0]),
    (b"CP", Exactly(&[1]), &[1]),
    (b"CR", Pairs, &[]),
    (b"CT", Exactly(&[1]), &[0]),
    (b"DC", Exactly(&[2]), &[1]),
    (b"DM", Exactly(&[ANY]), &[0]),
    (b"DS", Exactly(&[ANY; 2]), &[1; 2]),
    (b"FD", Exactly(&[ANY]), &[]),
    (b"FS", Exactly(&[1]), &[0]),
    (b"GB", Exactly(&[]), &[]),
    (b"GH", Exactly(&[2]), &[]),
    (b"GI", Exactly(&[]), &[]),
    (b"GM", Exactly(&[]), &[]),
    (b"GS", Exactly(&[4]), &[]),
    (b"GT", Exactly(&[]), &[]),
    (b"GV", Exactly(&[]), &[]),
    (b"GW", Exactly(&[]), &[]),
    (b"HC", OneOrTwo, &[]),
    (b"HD", Exactly(&[1]), &[0]),
    (b"HR", Exactly(&[1]), &[0]),
    (b"HT", Exactly(&[1]), &[0]),
    (b"L0", Exactly(&[2]), &[2]),
    (b"L1", Exactly(&[2]), &[2]),
    (b"LF", Exactly(&[]), &[]),
    (b"LM", Exactly(&[2, 3]), &[]),
    (b"MD", Exactly(&[ANY]), &[]),
    (b"NF", Exactly(&[ANY]), &[2]),
    (b"OM", Exactly(&[1, ANY]), &[]),
    (b"PD", Exactly(&[1]), &[0]),
    (b"PF", Exactly(&[1]), &[0]),
    (b"PM", Exactly(&[1]), &[0]),
    (b"PS", Exactly(&[ANY]), &[0]),
    (b"RF", Exactly(&[]), &[]),
    (b"RM", Exactly(&[ANY]), &[0]),
    (b"RS", Exactly(&[]), &[]),
    (b"SD", Exactly(&[]), &[]),
    (b"SF", OrNone(&[2]), &[]),
    (b"SL", Exactly(&[]), &[]),
    (b"SM", Exactly(&[ANY]), &[0]),
    (b"SO", Exactly(&[4, 1]), &[]),
    (b"SP", Exactly(&[ANY; 6]), &[16, 8, 5, 16, 8, 5]),
    (b"ST", OrNone(&[ANY; 6]), &[]),
    (b"SV", Exactly(&[4, ANY]), &[]),
    (b"TC", OrNone(&[ANY; 6]), &[]),
    (b"TI", Exactly(&[1]), &[0]),
    (b"TW", OrNone(&[ANY]), &[]),
    (b"UD", Exactly(&[]), &[]),
    (b"VW", OrNone(&[ANY; 4]), &[]),
];

fn takes(letters: [u8; 2]) -> Option<&'static Takes> {
    let row = COMMANDS.iter().find(|(name, ..)| **name == letters);
    row.map(|(_, takes, _)| takes)
}

impl Command {
    /// Reads a line without its carriage return; `None` is an empty one.
    pub(super) fn read(line: &[u8]) -> Result<Option<Self>, Refusal> {
        let line = line.trim_ascii();
        let Some((letters, rest)) = line.split_first_chunk::<2>() else {
            return if line.is_empty() {
                Ok(None)
            } else {
                Err(UNKNOWN)
            };
        };
        let letters = letters.map(|letter| letter.to_ascii_uppercase());
        let takes = takes(letters).ok_or(UNKNOWN)?;
        let words = rest
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let arguments = words.map(number).collect::<Result<Vec<_>, _>>()?;
        Self::checked(letters, arguments, takes).map(Some)
    }

    /// From the bytes of raw input.
    pub(super) fn from_raw(letters: [u8; 2], arguments: &[u8]) -> Result<Self, Refusal> {
        let letters = letters.map(|letter| letter.to_ascii_uppercase());
        let takes = takes(letters).ok_or(UNKNOWN)?;
        Self::checked(letters, arguments.to_vec(), takes)
    }

    fn checked(letters: [u8; 2], arguments: Vec<u8>, takes: &Takes) -> Result<Self, Refusal> {
        let count = arguments.len();
        let limits: &[u8] = match *takes {
            Exactly(limits) | OrNone(limits) if count == limits.len() => limits,
            OrNone(_) if count == 0 => &[],
            OneOrTwo if count == 1 || count == 2 => &[ANY; 2],
            Pairs if count.is_multiple_of(2) && count <= ARGUMENTS_MAX => &[ANY; ARGUMENTS_MAX],
            _ => return Err(COUNT),
        };
        let too_great = arguments
            .iter()
            .zip(limits)
            .any(|(value, most)| value > most);
        let nothing = match (&letters, &arguments[..]) {
            (b"DS", sampling) => sampling.contains(&0),
            (b"VW", &[x, y, x2, y2]) => x > x2 || y > y2,
            (b"LM", &[0 | 1, mode]) => mode > 2,
            _ => false,
        };
        if too_great || nothing {
            return Err(VALUE);
        }
        Ok(Self { letters, arguments })
    }
}

fn number(word: &[u8]) -> Result<u8, Refusal> {
    if !word.iter().all(u8::is_ascii_digit) {
        return Err(NUMBER);
    }
    let text = str::from_utf8(word).map_err(|_| NUMBER)?;
    text.parse().map_err(|_| NUMBER)
}

/// Raw input (`RM` with bit 2): two letters, the number of arguments, and these as bytes. A carriage return where
/// a command could begin means the same as in text.
#[derive(Clone, Debug, Default)]
pub(super) struct RawInput {
    bytes: Vec<u8>,
}

/// Result of raw input so far.
pub(super) enum RawHeard {
    /// Something is missing.
    Partial,
    /// A carriage return of its own.
    Idle,
    /// So many bytes were a command, or none.
    Complete(Vec<u8>, Result<Command, Refusal>),
}

impl RawInput {
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
    }

    pub(super) fn push(&mut self, byte: u8) -> RawHeard {
        if self.bytes.is_empty() && byte == b'\r' {
            return RawHeard::Idle;
        }
        self.bytes.push(byte);
        let result = match self.bytes[..] {
            [first, second, count, ..] if usize::from(count) <= ARGUMENTS_MAX => {
                let arguments = &self.bytes[3..];
                if arguments.len() < usize::from(count) {
                    return RawHeard::Partial;
                }
                Command::from_raw([first, second], arguments)
            }
            [_, _, _, ..] => Err(COUNT),
            [_, second] if !second.is_ascii_alphanumeric() => Err(UNKNOWN),
            [first] if !first.is_ascii_alphabetic() => Err(UNKNOWN),
            _ => return RawHeard::Partial,
        };
        RawHeard::Complete(std::mem::take(&mut self.bytes), result)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Result<Option<String>, Refusal> {
        Command::read(line.as_bytes()).map(|command| command.map(|c| c.to_string()))
    }

    #[test]
    fn lines_that_public_programs_send_are_commands() {
        for (line, command) in [
            ("", None),
            (" ", None),
            ("RS ", Some("RS")),
            ("tc 220 255 59 109 0 25 ", Some("TC 220 255 59 109 0 25")),
            ("TC 24 16 0 255 9 1", Some("TC 24 16 0 255 9 1")),
            ("\nCR  5 255 19 33 ", Some("CR 5 255 19 33")),
            ("SM0", Some("SM 0")),
            ("L1 2", Some("L1 2")),
            ("lm 2 3", Some("LM 2 3")),
            ("SV 1 255", Some("SV 1 255")),
            ("VW 001 01 87 142", Some("VW 1 1 87 142")),
        ] {
            assert_eq!(read(line), Ok(command.map(str::to_owned)), "{line:?}");
        }
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (line, why) in [
            ("X", UNKNOWN),
            ("XY", UNKNOWN),
            ("GV 1", COUNT),
            ("TC 1 2 3", COUNT),
            ("CR 1 2 3", COUNT),
            ("CR 1 2 3 4 5 6 7 8 9 10 11 12", COUNT),
            ("SV 0 256", NUMBER),
            ("NF -1", NUMBER),
            ("PM 2", VALUE),
            ("DS 0 1", VALUE),
            ("VW 9 9 8 9", VALUE),
            ("LM 0 3", VALUE),
        ] {
            assert_eq!(read(line), Err(why), "{line:?}");
        }
    }

    #[test]
    fn raw_input_ends_with_its_last_argument() {
        let mut raw = RawInput::default();
        let mut all = Vec::new();
        for byte in *b"\rCR\x02\x29\x80NF\x01\x00RM\x01\x0D\rGV\x00XY\x00@TW\x0B" {
            match raw.push(byte) {
                RawHeard::Partial => {}
                RawHeard::Idle => all.push("idle".to_owned()),
                RawHeard::Complete(_, Ok(command)) => all.push(command.to_string()),
                RawHeard::Complete(_, Err(why)) => all.push(why.to_owned()),
            }
        }
        let expected = [
            "idle",
            "CR 41 128",
            "NF 0",
            "RM 13",
            "idle",
            "GV",
            UNKNOWN,
            UNKNOWN,
            COUNT,
        ];
        assert_eq!(all, expected);
    }
}
