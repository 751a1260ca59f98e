//! Site keys in files.
//!
//! A key file is one line of ASCII, ended by a line feed:
//!
//! ```text
//! site-key 1 INDEX KEY CHECKSUM
//! ```
//!
//! `1` is the version of the format, INDEX the key's index in decimal (1 to 255), KEY its 16 bytes
//! and CHECKSUM the CRC-32 (ISO-HDLC) of all characters before it, both in lower-case hexadecimal.
//! Only its owner may read it. No message tells what is in it.

use std::{
    fs,
    io::{ErrorKind, Write},
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail, ensure};
use crc::{CRC_32_ISO_HDLC, Crc};
use node_firmware::config::SiteKey;
use tempfile::NamedTempFile;

const START: &str = "site-key 1 ";
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A new site key, in a file
#[derive(clap::Args)]
pub(crate) struct Keygen {
    /// The file; it must not exist
    #[arg(default_value = "site.sitekey")]
    file: PathBuf,
    /// The index by which frames name the key; the next key of a site needs another one
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    index: u8,
}

impl Keygen {
    pub(crate) fn run(&self) -> Result<()> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes).context("the system gave no random numbers")?;
        let key = SiteKey::new(self.index, bytes);
        ensure!(key.key().is_some(), "the system's numbers are not random");
        let path = self.file.display();
        private_file(&self.file, text(self.index, &bytes).as_bytes())?
            .persist_noclobber(&self.file)
            .map_err(|failed| match failed.error.kind() {
                ErrorKind::AlreadyExists => anyhow::anyhow!(
                    "{path} exists, and is not overwritten: its key may be in use; name another \
                     file"
                ),
                _ => anyhow::Error::new(failed.error).context(format!("{path} was not written")),
            })?;
        println!("{path}: a site key with index {}", self.index);
        println!(
            "Keep a copy in a safe place: every node of the site needs it. Publish it nowhere."
        );
        Ok(())
    }
}

/// Reads a key.
pub(crate) fn read(path: &Path) -> Result<SiteKey> {
    let name = path.display();
    let metadata = fs::metadata(path).with_context(|| {
        format!("{name} cannot be read; type `cargo xtask keygen FILE` for a new site's key")
    })?;
    ensure!(
        metadata.permissions().mode() & 0o077 == 0,
        "others may read {name}, so it is not a secret: type `chmod 600 {name}` if nobody did, \
         or make another key"
    );
    let bytes = fs::read(path).with_context(|| format!("{name} cannot be read"))?;
    let key = parse(&bytes).with_context(|| {
        format!("{name} holds no site key: take the copy that was kept, or make another key")
    })?;
    ensure!(
        key.key().is_some(),
        "{name}: nobody drew this key at random"
    );
    Ok(key)
}

/// A file beside `path` with these contents, which only its owner may read, to be renamed.
pub(super) fn private_file(path: &Path, contents: &[u8]) -> Result<NamedTempFile> {
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let written = || {
        let mut file = NamedTempFile::new_in(folder)?;
        file.write_all(contents)?;
        file.as_file().sync_all()?;
        Ok::<_, std::io::Error>(file)
    };
    written().with_context(|| format!("cannot write into {}", folder.display()))
}

fn text(index: u8, bytes: &[u8; 16]) -> String {
    let mut text = format!("{START}{index} ");
    text.extend(bytes.iter().map(|byte| format!("{byte:02x}")));
    text.push(' ');
    let checksum = CRC.checksum(text.as_bytes());
    text + &format!("{checksum:08x}\n")
}

/// Errors tell nothing of the contents.
fn parse(contents: &[u8]) -> Result<SiteKey> {
    let text = str::from_utf8(contents).ok().context("it is not text")?;
    let Some(fields) = text.strip_prefix(START) else {
        bail!("it does not begin with `{START}`");
    };
    let fields: Vec<_> = fields.trim_end().split(' ').collect();
    let &[index, digits, _] = fields.as_slice() else {
        bail!("it is not whole");
    };
    let index = index.parse().ok().context("its index is not 1 to 255")?;
    let mut bytes = [0; 16];
    ensure!(
        digits.len() == 32 && digits.is_ascii(),
        "its key is not 16 bytes"
    );
    for (place, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&digits[2 * place..][..2], 16)
            .ok()
            .context("its key is not hexadecimal")?;
    }
    // One text for each key: what is written otherwise was changed.
    ensure!(self::text(index, &bytes) == text, "its checksum is wrong");
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
        assert_eq!(parse(GOLDEN.as_bytes()).unwrap(), SiteKey::new(7, BYTES));
    }

    /// Every change of one character, and every shortened file.
    #[test]
    fn a_changed_file_is_refused_and_not_quoted() {
        let secret = ["00112233", "ddeeff"];
        let mut changed = Vec::new();
        for place in 0..GOLDEN.len() {
            changed.push(GOLDEN.as_bytes()[..place].to_vec());
            for character in [b'0', b'1', b'9', b'a', b'F', b' ', b'\n', 0xFF] {
                let mut other = GOLDEN.as_bytes().to_vec();
                if other[place] != character {
                    other[place] = character;
                    changed.push(other);
                }
            }
        }
        for other in changed {
            let error = format!("{:?}", parse(&other).unwrap_err());
            assert!(!secret.iter().any(|part| error.contains(part)), "{error}");
        }
    }
}
