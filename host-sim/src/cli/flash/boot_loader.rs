//! Boards without a debug probe: their boot loader takes a file, or a package over a serial line.

use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use board_facts::{Board, Loader};
use flash_file::{
    dfu::{
        Package,
        serial::{END, Frames, Transfer},
    },
    uf2,
};
use node_firmware::config::page::PAGE_MAX;
use serialport::{ClearBuffer, SerialPortInfo, SerialPortType};

use super::super::tell;

/// File in which a boot loader tells the board that it is for.
const ABOUT: &str = "INFO_UF2.TXT";
/// File in which it shows its flash.
const SHOWN: &str = "CURRENT.UF2";
/// File that is written.
const NODE: &str = "NODE.UF2";

/// Folders in which operating systems show volumes, besides those that `/proc/self/mounts` names.
const VOLUMES: [&str; 1] = ["/Volumes"];

const LOOK: Duration = Duration::from_millis(200);
/// Looks for a volume: two minutes, in which a person finds the button.
const PATIENCE: u32 = 600;
/// Looks until the board has written all and has started: half a minute.
const WRITING: u32 = 150;

/// The volume of a boot loader.
pub(super) struct Volume<'a> {
    board: &'static Board,
    folder: PathBuf,
    family: u32,
    ids: &'a [&'a str],
}

impl Volume<'_> {
    /// The volume in this folder, or wherever it appears after a person has started the boot loader.
    ///
    /// # Errors
    /// It does not appear, it is another board's, or the image would not start on it.
    pub(super) fn wait_for(board: &'static Board, named: Option<&Path>) -> Result<Self> {
        let Some(Loader::Uf2 {
            family,
            ids,
            soft_device,
            press,
        }) = board.loader
        else {
            bail!("{} has no boot loader that shows a volume", board.title);
        };
        let find = || match named {
            Some(folder) => Some(folder.to_owned()).filter(|folder| is_volume(folder)),
            None => volumes().into_iter().find(|folder| {
                let about = fs::read_to_string(folder.join(ABOUT)).unwrap_or_default();
                is_of(&about, ids)
            }),
        };
        if find().is_none() {
            tell(format!(
                "{press}. A volume appears: where it is not mounted by itself, mount it, and name \
                 its folder with --volume"
            ));
        }
        let found = (0..PATIENCE).find_map(|_| find().or_else(|| wait(LOOK)));
        let folder = found.with_context(|| {
            format!(
                "no volume of a {} appeared, and nothing was written: {press}",
                board.title
            )
        })?;
        let about = fs::read_to_string(folder.join(ABOUT))
            .with_context(|| format!("{} cannot be read", folder.join(ABOUT).display()))?;
        ensure!(
            is_of(&about, ids),
            "the volume in {} is not that of a {}, and nothing was written; it says:\n{}",
            folder.display(),
            board.title,
            about.trim_end()
        );
        // Older boot loaders do not tell.
        if let Some(found) = field(&about, "SoftDevice:") {
            ensure!(
                is_soft_device(found, soft_device),
                "this {} has the SoftDevice `{found}`, and an image starts only behind `{soft_device}`: \
                 nothing was written. Bring it up to date with the boot loader's own file",
                board.title
            );
        }
        Ok(Self {
            board,
            folder,
            family,
            ids,
        })
    }

    /// The configuration page that the board has.
    pub(super) fn page(&self) -> Result<Vec<u8>> {
        let path = self.folder.join(SHOWN);
        let shown = fs::read(&path).with_context(|| {
            format!(
                "{} cannot be read, so that it is not known which node this board is, and nothing was \
                 written: make it forget with --erase-memory",
                path.display()
            )
        })?;
        let page = uf2::read(&shown, self.board.config(), PAGE_MAX);
        page.with_context(|| {
            format!(
                "{} does not hold the board's page, and nothing was written: make it forget with \
                 --erase-memory",
                path.display()
            )
        })
    }

    /// Copies a file to the volume, and waits until the board has started with it.
    pub(super) fn write(&self, file: &[u8]) -> Result<()> {
        debug_assert!(uf2::family(file) == Some(self.family));
        let path = self.folder.join(NODE);
        let copied = copy(&path, file);
        let incomplete = || format!("{} was not written", path.display());
        // A board that has all of it may be gone before the file is closed.
        let copied = match copied {
            Err(NotCopied { all: false, error }) => return Err(error).with_context(incomplete),
            other => other.map_err(|failed| failed.error),
        };
        let is_gone = (0..WRITING).any(|_| !self.is_there() || wait::<()>(LOOK).is_some());
        if is_gone {
            return Ok(());
        }
        copied.with_context(incomplete)?;
        bail!(
            "the board has not started: its volume is still in {}. Unmount it, then type the same \
             command again",
            self.folder.display()
        )
    }

    fn is_there(&self) -> bool {
        let about = fs::read_to_string(self.folder.join(ABOUT)).unwrap_or_default();
        is_of(&about, self.ids)
    }
}

/// Bytes at the end of a file after which a board may already be gone: those that an operating system writes together.
const BLOCK: usize = 1 << 12;

/// Failure of a copy.
struct NotCopied {
    /// True if the operating system had taken all but the end, so that the board may have all.
    all: bool,
    error: io::Error,
}

fn copy(path: &Path, bytes: &[u8]) -> Result<(), NotCopied> {
    let mut all = false;
    let mut copy = || {
        let mut file = File::create(path)?;
        let (most, end) = bytes.split_at(bytes.len().saturating_sub(BLOCK));
        file.write_all(most)?;
        all = true;
        file.write_all(end)?;
        file.sync_all()
    };
    copy().map_err(|error| NotCopied { all, error })
}

/// Waits, and has nothing.
fn wait<T>(time: Duration) -> Option<T> {
    thread::sleep(time);
    None
}

fn is_volume(folder: &Path) -> bool {
    folder.join(ABOUT).is_file()
}

/// Text behind the name of a field.
fn field<'a>(about: &'a str, name: &str) -> Option<&'a str> {
    let line = about.lines().find_map(|line| line.strip_prefix(name));
    line.map(str::trim)
}

fn is_of(about: &str, ids: &[&str]) -> bool {
    field(about, "Board-ID:").is_some_and(|id| ids.iter().any(|start| id.starts_with(start)))
}

/// Returns true if a volume tells this `SoftDevice`: boot loaders write `S140 6.1.1` or `S140 version 6.1.1`.
fn is_soft_device(found: &str, wanted: &str) -> bool {
    let words = found.split_whitespace().filter(|word| *word != "version");
    words.eq(wanted.split_whitespace())
}

/// Volumes that are mounted.
fn volumes() -> Vec<PathBuf> {
    let mounts = fs::read_to_string("/proc/self/mounts").unwrap_or_default();
    // Spaces in names are written as \040 (proc(5), fstab(5)).
    let mounted = mounts.lines().filter_map(|line| line.split(' ').nth(1));
    let mut folders: Vec<PathBuf> = mounted
        .map(|folder| folder.replace("\\040", " ").into())
        .collect();
    for parent in VOLUMES {
        let entries = fs::read_dir(parent).into_iter().flatten().flatten();
        folders.extend(entries.map(|entry| entry.path()));
    }
    folders.retain(|folder| is_volume(folder));
    folders
}

/// Instructions to a person who has a package for a boot loader that takes it over a serial line.
pub(super) fn by_hand(press: &str, file: &Path) -> String {
    format!(
        "{press}; then type `nrfutil nrf5sdk-tools dfu usb-serial -pkg {} -p PORT`, with the serial \
         port that appeared",
        file.display()
    )
}

/// Vendor and product of a USB device.
type UsbNumbers = (u16, u16);

/// Rate of the line, of which a USB device makes nothing.
const BAUD: u32 = 115_200;
/// A page is erased and an object is checked in less.
const SILENT: Duration = Duration::from_secs(5);
/// Attempts to open a port that has just appeared: its owner may still be set.
const OPENING: u32 = 25;

/// Brings a package to the boot loader at this serial port, or at the one that appears after a person has started it.
///
/// # Errors
/// It does not appear, does not answer, or refuses the package.
pub(super) fn send(
    board: &Board,
    (press, usb): (&str, UsbNumbers),
    named: Option<&str>,
    package: Package,
) -> Result<()> {
    let find = || match named {
        Some(port) => Path::new(port).exists().then(|| port.to_owned()),
        None => ports_of(usb).into_iter().next(),
    };
    if find().is_none() {
        tell(format!(
            "{press}. A serial port appears: where it is not found, name it with --port"
        ));
    }
    let found = (0..PATIENCE).find_map(|_| find().or_else(|| wait(LOOK)));
    let name = found.with_context(|| {
        format!(
            "no boot loader of a {} appeared, and nothing was written: {press}",
            board.title
        )
    })?;
    let open = || serialport::new(&name, BAUD).timeout(SILENT).open();
    let mut port = match (0..OPENING).find_map(|_| open().ok().or_else(|| wait(LOOK))) {
        Some(port) => port,
        None => {
            open().with_context(|| format!("{name} cannot be opened, and nothing was written"))?
        }
    };
    // A frame that an interrupted transfer left unfinished ends here, and what is said of it is not heard.
    port.write_all(&[END])?;
    thread::sleep(LOOK);
    port.clear(ClearBuffer::Input)?;
    let mut transfer = Transfer::new(package);
    let mut frames = Frames::default();
    while !transfer.is_done() {
        let [confirmed, all] = transfer.progress();
        let incomplete = || {
            format!(
                "the boot loader at {name} has {confirmed} of {all} bytes, and starts no image \
                 before it has all: type the same command again"
            )
        };
        port.write_all(&transfer.request())
            .with_context(incomplete)?;
        let frame = answer(&mut port, &mut frames).with_context(incomplete)?;
        transfer.on_answer(&frame).with_context(incomplete)?;
    }
    drop(port);
    // It goes away to start the image. A port of another name may be anything.
    let is_there = || named.is_none() && find().is_some();
    let is_gone = (0..WRITING).any(|_| !is_there() || wait::<()>(LOOK).is_some());
    ensure!(
        is_gone,
        "the board has all, and has not started: take it from the plug, and plug it in again"
    );
    Ok(())
}

/// The next frame.
fn answer(port: &mut impl Read, frames: &mut Frames) -> Result<Vec<u8>> {
    let mut byte = [0; 1];
    let begun = Instant::now();
    loop {
        // Also where something talks without an end that is no boot loader.
        ensure!(
            begun.elapsed() < SILENT,
            "the boot loader does not answer for {} s",
            SILENT.as_secs()
        );
        match port.read(&mut byte) {
            Ok(0) => bail!("the port is gone"),
            Ok(_) => {
                if let Some(frame) = frames.push(byte[0]) {
                    return Ok(frame);
                }
            }
            Err(error)
                if [io::ErrorKind::TimedOut, io::ErrorKind::Interrupted]
                    .contains(&error.kind()) => {}
            Err(error) => return Err(error.into()),
        }
    }
}

/// Serial ports of a USB device.
fn ports_of((vendor, product): UsbNumbers) -> Vec<String> {
    let is_it = |port: &SerialPortInfo| match &port.port_type {
        SerialPortType::UsbPort(usb) => (usb.vid, usb.pid) == (vendor, product),
        _ => false,
    };
    let ports = serialport::available_ports().unwrap_or_default();
    let ports = ports.into_iter().filter(is_it);
    ports.map(|port| port.port_name).collect()
}

#[cfg(test)]
mod tests {
    use board_facts::XIAO_NRF52840;

    use super::*;

    const FAMILY: u32 = 0xADA5_2840;

    /// A file of one block.
    fn file() -> Vec<u8> {
        let mut block = [0; 512];
        let words = [
            0x0A32_4655,
            0x9E5D_5157,
            0x2000,
            0x2_7000,
            256,
            0,
            1,
            FAMILY,
        ];
        for (place, word) in block.chunks_mut(4).zip(words) {
            place.copy_from_slice(&u32::to_le_bytes(word));
        }
        block[508..].copy_from_slice(&0x0AB1_6F30_u32.to_le_bytes());
        block.to_vec()
    }

    /// A volume that goes away is the usual end, but not where the file could not be begun.
    #[test]
    fn a_copy_that_failed_is_no_success() {
        let folder = tempfile::tempdir().unwrap();
        let gone = Volume {
            board: &XIAO_NRF52840,
            folder: folder.path().to_owned(),
            family: FAMILY,
            ids: &["nRF52840-SeeedXiao"],
        };
        gone.write(&file()).unwrap();
        assert_eq!(fs::read(folder.path().join(NODE)).unwrap(), file());
        fs::remove_file(folder.path().join(NODE)).unwrap();
        fs::create_dir(folder.path().join(NODE)).unwrap();
        let error = gone.write(&file()).unwrap_err().to_string();
        assert!(error.contains("NODE.UF2 was not written"), "{error}");
    }
}
