//! A configuration as a page of flash.
//!
//! | bytes | what |
//! |---|---|
//! | 0 to 3 | magic: `CNod` |
//! | 4, 5 | version of the body, little-endian; 11, or 12 with a distortion |
//! | 6, 7 | length n of the body, little-endian |
//! | 8 to 7 + n | body: the [`Config`] in postcard's format; [`Config::sleeps`], 0 or 1; in version 12 k1 and k2 of a camera's [lens](crate::vision::Lens::distortion), little-endian floats |
//! | 8 + n to 11 + n | CRC-32 (ISO-HDLC, that of Ethernet and zip) of all bytes before, little-endian |
//! | the rest | whatever; 0xFF when written |
//!
//! All but the body stays as it is in every version, so that a page of another version is told from a
//! damaged one. The body is frozen by a test with golden bytes. A body of version 10 is one of 11 without its last byte:
//! a node that is updated by radio keeps its page. A camera whose lens has no distortion gets a page of version 11,
//! which older firmware reads too.

use core::fmt;

use flash_log::Crc32;

use super::{CheckedConfig, Config, ConfigError, RoleConfig};

/// Bytes of the longest page.
pub const PAGE_MAX: usize = 512;

/// The newest version of the body.
pub const VERSION: u16 = 12;

/// The version whose bodies have no distortion.
const UNDISTORTED: u16 = 11;

/// The version whose bodies have no [`Config::sleeps`].
const SLEEPLESS: u16 = 10;

const MAGIC: [u8; 4] = *b"CNod";
const HEADER: usize = 8;
const TRAILER: usize = 4;

/// Reason why there is no configuration in a page, or no page for a configuration. The texts say what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PageError {
    /// The page is erased.
    Blank,
    /// Something else is in its place.
    Magic,
    /// The page is shorter than it says.
    Truncated,
    /// The bytes were changed.
    Checksum,
    /// A version that this firmware does not know.
    Version {
        /// Version of the page.
        found: u16,
    },
    /// The checksum is right, but the body is no configuration.
    Body,
    /// A value out of its range.
    Value(ConfigError),
    /// The buffer is too small.
    Room,
}

impl fmt::Display for PageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Blank => "the configuration page is blank: provision this node",
            Self::Magic => {
                "there is something else in the place of the configuration page: check the \
                 address, or provision this node"
            }
            Self::Truncated => "the configuration page is cut off: write it again, all of it",
            Self::Checksum => "the configuration page is damaged: write it again",
            Self::Version { found } if *found < VERSION => {
                "the configuration page is of an older version: make it anew"
            }
            Self::Version { found } => {
                return write!(
                    f,
                    "the configuration page has version {found}, this firmware knows {VERSION}: \
                     update the firmware, or provision the node with its own tools"
                );
            }
            Self::Body => {
                "the configuration page holds no configuration: provision this node again"
            }
            Self::Value(error) => return error.fmt(f),
            Self::Room => "a configuration page needs a buffer of 512 bytes",
        })
    }
}

impl core::error::Error for PageError {}

/// The version of the page of a configuration: the oldest one that can hold it.
pub fn version(config: &Config) -> u16 {
    match config.distortion() {
        Some(_) => VERSION,
        None => UNDISTORTED,
    }
}

/// Writes a page into `buffer`, and 0xFF behind it. Returns the number of bytes that count.
///
/// # Errors
/// [`PageError::Room`].
pub fn encode(config: &CheckedConfig, buffer: &mut [u8]) -> Result<usize, PageError> {
    buffer.fill(0xFF);
    let (header, rest) = buffer.split_at_mut_checked(HEADER).ok_or(PageError::Room)?;
    let room = rest.len().checked_sub(TRAILER).ok_or(PageError::Room)?;
    let body = rest.get_mut(..room).ok_or(PageError::Room)?;
    let settings = config.settings();
    let length = postcard::to_slice(settings, body)
        .map_err(|_| PageError::Room)?
        .len();
    *body.get_mut(length).ok_or(PageError::Room)? = settings.sleeps.into();
    let mut length = length + 1;
    if let Some(distortion) = settings.distortion() {
        for k in distortion {
            let room = body.get_mut(length..length + 4).ok_or(PageError::Room)?;
            room.copy_from_slice(&k.to_le_bytes());
            length += 4;
        }
    }
    let written = u16::try_from(length).map_err(|_| PageError::Room)?;
    let [v0, v1] = version(settings).to_le_bytes();
    let [l0, l1] = written.to_le_bytes();
    let [m0, m1, m2, m3] = MAGIC;
    header.copy_from_slice(&[m0, m1, m2, m3, v0, v1, l0, l1]);
    let (covered, trailer) = buffer
        .split_at_mut_checked(HEADER + length)
        .ok_or(PageError::Room)?;
    let checksum = Crc32::of(covered).to_le_bytes();
    let (trailer, rest) = trailer
        .split_at_mut_checked(TRAILER)
        .ok_or(PageError::Room)?;
    trailer.copy_from_slice(&checksum);
    // Postcard may have used bytes that it then did not count.
    rest.fill(0xFF);
    Ok(HEADER + length + TRAILER)
}

/// Reads a page. Bytes after it are ignored.
///
/// # Errors
/// [`PageError`].
pub fn decode(page: &[u8]) -> Result<CheckedConfig, PageError> {
    if page.iter().all(|&byte| byte == 0xFF) || page.iter().all(|&byte| byte == 0) {
        return Err(PageError::Blank);
    }
    let [m0, m1, m2, m3, v0, v1, l0, l1] =
        *page.first_chunk::<HEADER>().ok_or(PageError::Truncated)?;
    if [m0, m1, m2, m3] != MAGIC {
        return Err(PageError::Magic);
    }
    let length = usize::from(u16::from_le_bytes([l0, l1]));
    let (covered, rest) = page
        .split_at_checked(HEADER + length)
        .ok_or(PageError::Truncated)?;
    let checksum = rest.first_chunk::<TRAILER>().ok_or(PageError::Truncated)?;
    if Crc32::of(covered) != u32::from_le_bytes(*checksum) {
        return Err(PageError::Checksum);
    }
    let body = covered.get(HEADER..).ok_or(PageError::Truncated)?;
    let version = u16::from_le_bytes([v0, v1]);
    if !(SLEEPLESS..=VERSION).contains(&version) {
        return Err(PageError::Version { found: version });
    }
    let (mut config, mut rest) = part::<Config>(body)?;
    if version > SLEEPLESS {
        (config.sleeps, rest) = part(rest)?;
    }
    if let (VERSION, RoleConfig::Camera(camera)) = (version, &mut config.role) {
        (camera.lens.distortion, rest) = part(rest)?;
    }
    if !rest.is_empty() {
        return Err(PageError::Body);
    }
    config.check().map_err(PageError::Value)
}

/// The first part of a body, and the rest of it.
fn part<'a, T: serde::Deserialize<'a>>(body: &'a [u8]) -> Result<(T, &'a [u8]), PageError> {
    postcard::take_from_bytes(body).map_err(|_| PageError::Body)
}

#[cfg(test)]
mod tests;
