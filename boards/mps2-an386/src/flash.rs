//! The node's flash: in memory, with the geometry and the rules of the nRF52840's, and on the host
//! in a file if one was named.

use core::ffi::CStr;

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};
use node_firmware::{facts, hardware::FlashLayout};
use semihosting::{
    fs::{File, OpenOptions},
    io::{Read as _, Seek as _, SeekFrom, Write as _},
};
use static_cell::ConstStaticCell;

const PAGE: usize = 4096;
const LINK: u32 = 4 * PAGE as u32;
const LEN: usize = (facts::BYTES + LINK) as usize;
const ERASED: u8 = 0xff;

/// Where a node keeps what it must not forget.
pub(crate) const LAYOUT: FlashLayout = FlashLayout {
    link: facts::BYTES..facts::BYTES + LINK,
    facts: 0..facts::BYTES,
};

/// Why the flash fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Error {
    /// What was asked for is impossible.
    Request(NorFlashErrorKind),
    /// The file on the host cannot be read or written.
    File,
}

impl NorFlashError for Error {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Request(kind) => *kind,
            Self::File => NorFlashErrorKind::Other,
        }
    }
}

impl From<NorFlashErrorKind> for Error {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self::Request(kind)
    }
}

/// The flash.
pub(crate) struct Flash {
    bytes: &'static mut [u8; LEN],
    file: Option<File>,
}

impl Flash {
    /// The flash, as the file has it, which is made if it is missing. Once.
    pub(crate) fn open(path: Option<&CStr>) -> Result<Self, Error> {
        static BYTES: ConstStaticCell<[u8; LEN]> = ConstStaticCell::new([0; LEN]);
        let mut flash = Self {
            bytes: BYTES.take(),
            file: None,
        };
        flash.bytes.fill(ERASED);
        if let Some(path) = path {
            flash.open_file(path).map_err(|_| Error::File)?;
        }
        Ok(flash)
    }

    fn open_file(&mut self, path: &CStr) -> semihosting::io::Result<()> {
        let mut options = OpenOptions::new();
        if let Ok(mut file) = options.read(true).write(true).open(path) {
            // A short file is of an emulator that ended while it wrote the rest.
            let mut from = 0;
            while let Some(rest) = self.bytes.get_mut(from..).filter(|rest| !rest.is_empty()) {
                match file.read(rest)? {
                    0 => break,
                    len => from += len,
                }
            }
            self.file = Some(file);
        } else {
            options.create(true).truncate(true);
            self.file = Some(options.open(path)?);
        }
        self.keep(0, LEN)
            .map_err(|_| semihosting::io::ErrorKind::Other.into())
    }

    /// Writes a part to the file.
    fn keep(&mut self, from: usize, len: usize) -> Result<(), Error> {
        let (Some(file), Some(part)) = (&mut self.file, self.bytes.get(from..from + len)) else {
            return Ok(());
        };
        file.seek(SeekFrom::Start(from as u64))
            .and_then(|_| file.write_all(part))
            .map_err(|_| Error::File)
    }
}

impl ErrorType for Flash {
    type Error = Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        check_read(self, offset, bytes.len())?;
        let from = offset as usize;
        if let Some(part) = self.bytes.get(from..from + bytes.len()) {
            bytes.copy_from_slice(part);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        LEN
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        check_erase(self, from, to)?;
        if let Some(part) = self.bytes.get_mut(from as usize..to as usize) {
            part.fill(ERASED);
        }
        self.keep(from as usize, (to - from) as usize)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        check_write(self, offset, bytes.len())?;
        let from = offset as usize;
        if let Some(part) = self.bytes.get_mut(from..from + bytes.len()) {
            // A write makes ones to zeros, never zeros to ones.
            for (old, new) in part.iter_mut().zip(bytes) {
                *old &= new;
            }
        }
        self.keep(from, bytes.len())
    }
}
