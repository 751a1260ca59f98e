//! Reads a site key from the file that `cargo xtask keygen` makes.
//!
//! One line: `site-key 1 INDEX KEY CHECKSUM`; KEY and the CRC-32 (ISO-HDLC) of all before it are in
//! lower-case hexadecimal. No message tells what is in it.

use std::{fs, io, path::Path};

use crc::{CRC_32_ISO_HDLC, Crc};
use node_firmware::config::SiteKey;

const START: &str = "site-key 1 ";
/// More than the longest line.
const LENGTH_MAX: u64 = 128;

/// Why a file gives no key.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    /// The operating system's answer.
    #[error("it cannot be read")]
    Io(#[from] io::Error),
    /// It is not only its owner's.
    #[error("others may read it, so it is not a secret: make another key")]
    Public,
    /// It is something else, or was changed.
    #[error(
        "it holds no site key: make one with `cargo xtask keygen`, or take the copy that was kept"
    )]
    NoKey,
    /// Such as sixteen zeros.
    #[error("nobody drew this key at random")]
    NotRandom,
}

/// Reads a key.
///
/// # Errors
/// [`KeyFileError`]
pub fn read(path: &Path) -> Result<SiteKey, KeyFileError> {
    let known = fs::metadata(path)?;
    if !known.is_file() || known.len() > LENGTH_MAX {
        return Err(KeyFileError::NoKey);
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        if known.permissions().mode() & 0o077 != 0 {
            return Err(KeyFileError::Public);
        }
    }
    let key = parse(&fs::read(path)?).ok_or(KeyFileError::NoKey)?;
    key.key().map(|_| key).ok_or(KeyFileError::NotRandom)
}

fn parse(contents: &[u8]) -> Option<SiteKey> {
    let line = str::from_utf8(contents).ok()?.strip_suffix('\n')?;
    let (checked, checksum) = line.split_at_checked(line.len().checked_sub(8)?)?;
    let expected = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(checked.as_bytes());
    let fields = checked.strip_prefix(START)?.strip_suffix(' ')?;
    let (index, digits) = fields.split_once(' ')?;
    if checksum != format!("{expected:08x}") || digits.len() != 32 || !digits.is_ascii() {
        return None;
    }
    let mut bytes = [0; 16];
    for (place, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * place..][..2], 16).ok()?;
    }
    Some(SiteKey::new(index.parse().ok()?, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same as in the tests of the writer.
    const GOLDEN: &str = "site-key 1 7 00112233445566778899aabbccddeeff 17238689\n";

    #[test]
    fn golden_file() {
        let bytes = [
            0x00, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99, 0xaa, 0xbb, 0xcc, 0xdd,
            0xee, 0xff,
        ];
        assert_eq!(parse(GOLDEN.as_bytes()), Some(SiteKey::new(7, bytes)));
    }

    /// Every change of one character, and every shortened file.
    #[test]
    fn a_changed_file_is_refused() {
        for place in 0..GOLDEN.len() {
            assert_eq!(parse(&GOLDEN.as_bytes()[..place]), None);
            for character in [b'0', b'1', b'9', b'a', b'F', b' ', b'\n', 0xFF] {
                let mut other = GOLDEN.as_bytes().to_vec();
                if other[place] != character {
                    other[place] = character;
                    assert_eq!(parse(&other), None, "{place}");
                }
            }
        }
    }
}
