//! Keys of a site in files.
//!
//! A key file is one line of ASCII, ended by a line feed:
//!
//! ```text
//! site-key 1 INDEX KEY CHECKSUM
//! update-key 1 KEY CHECKSUM
//! ```
//!
//! The first is the key of the radio network, which every node has. The second signs images for updates by radio; nodes
//! have its public key only. `1` is the version of the format, INDEX the key's index in decimal (1 to 255), KEY its 16
//! or 32 bytes and CHECKSUM the CRC-32 (ISO-HDLC) of all characters before it, both in lower-case hexadecimal.
//! Only its owner may read it. No message tells its content.

use std::{
    fs,
    io::{self, ErrorKind},
    path::Path,
};

use crc::{CRC_32_ISO_HDLC, Crc};
use node_firmware::config::SiteKey;
use thiserror::Error;

use crate::durable;

const START: &str = "site-key 1 ";
const UPDATE_START: &str = "update-key 1 ";
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// More than the longest line.
const LENGTH_MAX: u64 = 128;

/// Kind of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Of the radio network.
    Site,
    /// For images.
    Update,
}

impl Kind {
    /// The command that makes one.
    const fn command(self) -> &'static str {
        match self {
            Self::Site => "host-sim keygen",
            Self::Update => "host-sim keygen --updates",
        }
    }

    const fn words(self) -> &'static str {
        match self {
            Self::Site => "site key",
            Self::Update => "key for updates",
        }
    }
}

/// Why a file gives no key, or why there is no new one. No message has the file's name.
#[derive(Debug, Error)]
pub enum KeyFileError {
    /// The operating system's answer.
    #[error("it cannot be read; `{} FILE` makes the key of a new site", .0.command())]
    Read(Kind, #[source] io::Error),
    /// It is not only its owner's.
    #[error(
        "others may read it, so it is not a secret: type `chmod 600` and its name if no one did, or \
         make another key with `host-sim keygen`"
    )]
    Public,
    /// It is something else, or was changed.
    #[error(
        "it holds no {} ({}): take the copy that was kept, or make another key with `{}`",
        .0.words(),
        .1,
        .0.command()
    )]
    NoKey(Kind, &'static str),
    /// Such as sixteen zeros.
    #[error("this key was not drawn at random: make another one with `host-sim keygen`")]
    NotRandom,
    /// There are no random numbers.
    #[error("the system gave no random numbers")]
    NoRandomness,
    /// A key is never written over.
    #[error("it exists, and is not overwritten: its key may be in use; name another file")]
    Exists,
    /// The operating system's answer.
    #[error("it was not written")]
    Write(#[source] io::Error),
}

/// Reads a key.
///
/// # Errors
/// [`KeyFileError`]
pub fn read(path: &Path) -> Result<SiteKey, KeyFileError> {
    let contents = contents(path, Kind::Site)?;
    let key = parse(&contents).map_err(|why| KeyFileError::NoKey(Kind::Site, why))?;
    key.key().map(|_| key).ok_or(KeyFileError::NotRandom)
}

/// Reads the secret key that signs images: its seed.
///
/// # Errors
/// [`KeyFileError`]
pub fn read_update_key(path: &Path) -> Result<[u8; 32], KeyFileError> {
    let contents = contents(path, Kind::Update)?;
    parse_update_key(&contents).map_err(|why| KeyFileError::NoKey(Kind::Update, why))
}

/// The contents of a file that only its owner may read.
fn contents(path: &Path, kind: Kind) -> Result<Vec<u8>, KeyFileError> {
    let unreadable = |error| KeyFileError::Read(kind, error);
    let known = fs::metadata(path).map_err(unreadable)?;
    if !known.is_file() || known.len() > LENGTH_MAX {
        return Err(KeyFileError::NoKey(kind, "it is no file of one line"));
    }
    if !durable::is_private(&known) {
        return Err(KeyFileError::Public);
    }
    fs::read(path).map_err(unreadable)
}

/// Draws a new key with this index, 1 to 255, and writes it into a file that does not exist yet.
///
/// # Errors
/// [`KeyFileError`]
pub fn create(path: &Path, index: u8) -> Result<(), KeyFileError> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|_| KeyFileError::NoRandomness)?;
    if SiteKey::new(index, bytes).key().is_none() {
        return Err(KeyFileError::NoRandomness);
    }
    write(path, &text(index, &bytes))
}

/// Draws a new key that signs images, and writes it into a file that does not exist yet.
///
/// # Errors
/// [`KeyFileError`]
pub fn create_update_key(path: &Path) -> Result<(), KeyFileError> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|_| KeyFileError::NoRandomness)?;
    write(path, &line(UPDATE_START.to_owned(), &bytes))
}

fn write(path: &Path, text: &str) -> Result<(), KeyFileError> {
    durable::write_private(path, text.as_bytes(), false).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => KeyFileError::Exists,
        _ => KeyFileError::Write(error),
    })
}

fn text(index: u8, bytes: &[u8; 16]) -> String {
    line(format!("{START}{index} "), bytes)
}

/// A line of a key with its checksum.
fn line(mut text: String, bytes: &[u8]) -> String {
    text.extend(bytes.iter().map(|byte| format!("{byte:02x}")));
    text.push(' ');
    let checksum = CRC.checksum(text.as_bytes());
    text + &format!("{checksum:08x}\n")
}

fn parse_update_key(contents: &[u8]) -> Result<[u8; 32], &'static str> {
    let text = str::from_utf8(contents).map_err(|_| "it is not text")?;
    let rest = text.strip_prefix(UPDATE_START);
    let rest = rest.ok_or("it does not begin with `update-key 1`")?;
    let (digits, _) = rest.split_once(' ').ok_or("it is not whole")?;
    let bytes = hexadecimal(digits).ok_or("its key is not 32 bytes in hexadecimal")?;
    // Each key has one text: a file with another text was changed.
    if line(UPDATE_START.to_owned(), &bytes) != text {
        return Err("its checksum is wrong");
    }
    Ok(bytes)
}

fn hexadecimal<const N: usize>(digits: &str) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    if digits.len() != 2 * N || !digits.is_ascii() {
        return None;
    }
    for (place, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * place..][..2], 16).ok()?;
    }
    Some(bytes)
}

/// Errors tell nothing of the contents.
fn parse(contents: &[u8]) -> Result<SiteKey, &'static str> {
    let text = str::from_utf8(contents).map_err(|_| "it is not text")?;
    let fields = text
        .strip_prefix(START)
        .ok_or("it does not begin with `site-key 1`")?;
    let fields: Vec<_> = fields.trim_end().split(' ').collect();
    let &[index, digits, _] = fields.as_slice() else {
        return Err("it is not whole");
    };
    let index = index.parse().map_err(|_| "its index is not 1 to 255")?;
    let bytes = hexadecimal(digits).ok_or("its key is not 16 bytes in hexadecimal")?;
    // Each key has one text: a file with another text was changed.
    if self::text(index, &bytes) != text {
        return Err("its checksum is wrong");
    }
    Ok(SiteKey::new(index, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The checksum by `zlib.crc32` of Python.
    const GOLDEN: &str = "site-key 1 7 00112233445566778899aabbccddeeff 17238689\n";
    const BYTES: [u8; 16] = [
        0x00, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99, 0xaa, 0xbb, 0xcc, 0xdd, 0xee,
        0xff,
    ];

    #[test]
    fn golden_file() {
        assert_eq!(text(7, &BYTES), GOLDEN);
        assert_eq!(parse(GOLDEN.as_bytes()), Ok(SiteKey::new(7, BYTES)));
    }

    /// Every change of one character, and every shortened file.
    #[test]
    fn a_changed_file_is_refused() {
        for place in 0..GOLDEN.len() {
            assert!(parse(&GOLDEN.as_bytes()[..place]).is_err());
            for character in [b'0', b'1', b'9', b'a', b'F', b' ', b'\n', 0xFF] {
                let mut other = GOLDEN.as_bytes().to_vec();
                if other[place] != character {
                    other[place] = character;
                    assert!(parse(&other).is_err(), "{place}");
                }
            }
        }
    }

    #[test]
    fn a_key_for_updates() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        create_update_key(&path).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let key = read_update_key(&path).unwrap();
        assert_ne!(key, [0; 32]);
        assert!(matches!(
            create_update_key(&path),
            Err(KeyFileError::Exists)
        ));
        // One kind is not taken for the other.
        assert!(matches!(read(&path), Err(KeyFileError::NoKey(..))));
        assert!(parse_update_key(GOLDEN.as_bytes()).is_err());
        for place in 0..text.len() {
            let mut other = text.clone().into_bytes();
            other[place] ^= 1;
            assert!(parse_update_key(&other).is_err(), "{place}");
            assert!(parse_update_key(&text.as_bytes()[..place]).is_err());
        }
    }

    #[test]
    fn what_is_drawn_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        create(&path, 3).unwrap();
        let key = read(&path).unwrap();
        assert_eq!(key.index(), 3);
        assert!(matches!(create(&path, 4), Err(KeyFileError::Exists)));
        assert_eq!(read(&path).unwrap(), key);
    }
}
