//! `host-sim flash`: an image, and the page that says which node it is, onto a board.

mod boot_loader;
mod lock;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, Result, bail, ensure};
use board_facts::{BOARDS, Board, Loader, chip::Family};
use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use flash_file::Image;
use node_firmware::config::{
    CheckedConfig, Config,
    page::{self, PAGE_MAX, PageError},
};
use site::{
    durable::write_private,
    node::{self, RoleName},
};
use xshell::{Cmd, Shell, cmd};

use self::boot_loader::Volume;
use super::{OfFile, file_name, files::Files, print, provision::read_page, tell};

/// Folder into which `cargo xtask firmware` puts images.
const IMAGES: &str = "target/firmware";

const INSTALL: &str = "probe-rs is not installed: see https://probe.rs/docs/getting-started/installation/, or \
     type `cargo install probe-rs-tools --locked` (on Debian after `sudo apt-get install \
     pkg-config libudev-dev`)";

/// The names of the boards.
fn boards() -> impl TypedValueParser<Value = &'static Board> {
    PossibleValuesParser::new(BOARDS.map(|board| PossibleValue::new(board.name).help(board.title)))
        .try_map(|name| Board::named(&name).ok_or("no such board"))
}

/// Writes an image and a configuration page onto a board.
///
/// With a debug probe (probe-rs); or, to a board that is sold with a boot loader, over its USB plug: as a file that is
/// copied to the volume which the board shows, or as a package over the serial port that it has then (Nordic's DFU).
///
/// The node's memory is kept. A page with another site key, role or number than the one in the
/// board is refused without --erase-memory.
#[derive(Args)]
pub(super) struct Arguments {
    /// Kind of board.
    #[arg(value_parser = boards())]
    board: &'static Board,
    /// The page, of `host-sim provision`; without it, the node keeps the one it has.
    #[arg(long, value_name = "PAGE")]
    config: Option<PathBuf>,
    /// The image; without it, what `cargo xtask firmware` makes in target/firmware.
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
    /// Debug probe to use, as `probe-rs list` names it: VID:PID or VID:PID:SERIAL.
    /// A board with a boot loader is flashed by that, unless a probe is named.
    #[arg(long)]
    probe: Option<String>,
    /// Writes the file that the boot loader of the board takes, image and page in one, and touches no board.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["probe", "volume", "lock", "unlock"])]
    file: Option<PathBuf>,
    /// Writes over a file that exists.
    #[arg(long, requires = "file")]
    overwrite: bool,
    /// Folder of the volume that the boot loader shows; without it, it is looked for.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["probe", "lock", "unlock"])]
    volume: Option<PathBuf>,
    /// Serial port of a boot loader that takes a package; without it, it is looked for.
    #[arg(long, value_name = "PORT", conflicts_with_all = ["file", "probe", "volume", "lock", "unlock"])]
    port: Option<String>,
    /// Makes the node forget its network, its place and its extended address: when it was moved, or
    /// its memory is damaged.
    #[arg(long, requires = "config")]
    erase_memory: bool,
    /// Closes the debug port, so that a person with the board in hand cannot read the site key. Opening
    /// it again (--unlock) erases the board.
    #[arg(long)]
    lock: bool,
    /// Opens the debug port of a board that was locked, before it is written. That erases all that
    /// the board holds.
    #[arg(long, requires = "config")]
    unlock: bool,
    /// Tells the commands, or the steps with a boot loader, and runs none.
    #[arg(long)]
    dry_run: bool,
}

/// A page that is to be written.
struct Page {
    path: PathBuf,
    config: CheckedConfig,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    arguments.flash(&Shell::new()?)?;
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn flash(&self, sh: &Shell) -> Result<()> {
        let page = self.page()?;
        if self.is_for_boot_loader() {
            return self.by_boot_loader(page.as_ref());
        }
        let has_probe_rs = is_on_path("probe-rs");
        ensure!(has_probe_rs || self.dry_run, INSTALL);
        if let Some((program, install)) = lock::locked_with(self.board)
            && (self.lock || self.unlock)
            && !is_on_path(program)
        {
            ensure!(self.dry_run, install);
            tell(install);
        }
        let image = self.image()?;
        // Beside the image, where a file that is left over is not in the way.
        let beside = Beside {
            erased: image.with_extension("erased.bin"),
            enabled: image.with_extension("approtect.bin"),
        };
        let files = Files::default().reads([&image]).reads(&self.config);
        if !self.dry_run {
            files
                .writes(self.erase_memory.then_some(&beside.erased))
                .writes(self.lock.then_some(&beside.enabled))
                .check()?;
        }
        if let Some(page) = &page {
            tell(node::text(page.config.settings())?.trim_end());
        }
        let path = page.as_ref().map(|page| page.path.as_path());
        let commands = self.commands(sh, &image, path, &beside);
        // With all memory erased, it does not matter what the board was before.
        let page = page.filter(|_| !self.erase_memory && !self.unlock);
        if self.dry_run {
            let look = page.map(|_| self.look(sh));
            for command in look.iter().chain(&commands) {
                print(&format!("{command}\n"))?;
            }
            if !has_probe_rs {
                tell(INSTALL);
            }
            return Ok(());
        }
        if let Some(page) = page {
            self.compare(sh, page.config.settings())?;
        }
        if self.erase_memory {
            let (_, bytes) = self.board.memory();
            write(&beside.erased, &vec![0xFF; bytes as usize])?;
        }
        if self.lock {
            write(&beside.enabled, &lock::ENABLED)?;
        }
        for command in commands {
            command.run().context(
                "the board is not complete: see what probe-rs says above, then type the same \
                 command again",
            )?;
        }
        if self.lock {
            tell(lock::after_locking(self.board));
        }
        Ok(())
    }

    fn is_for_boot_loader(&self) -> bool {
        let asks_for_probe = self.probe.is_some() || self.lock || self.unlock;
        let asks_for_loader = self.file.is_some() || self.volume.is_some() || self.port.is_some();
        asks_for_loader || self.board.loader.is_some() && !asks_for_probe
    }

    /// Makes the file that the boot loader takes, and hands it over.
    fn by_boot_loader(&self, page: Option<&Page>) -> Result<()> {
        let Some(loader) = self.board.loader else {
            bail!(
                "{} has no boot loader: it is flashed with its debug probe",
                self.board.title
            );
        };
        match loader {
            Loader::Uf2 { .. } => ensure!(
                self.port.is_none(),
                "a {} takes a file on the volume that it shows, and no package on a serial port: leave --port out, \
                 or name the folder with --volume",
                self.board.title
            ),
            Loader::Dfu { .. } => ensure!(
                self.volume.is_none(),
                "a {} takes a package on its serial port, and shows no volume: leave --volume out, or name the port \
                 with --port",
                self.board.title
            ),
        }
        if let Loader::Dfu { .. } = loader {
            // The one before would go with the image before.
            ensure!(
                page.is_some(),
                "a {} has its page within the image: name it with --config",
                self.board.title
            );
            ensure!(
                !self.erase_memory,
                "the boot loader of a {} cannot erase the memory: that takes a debug probe, named \
                 with --probe",
                self.board.title
            );
        }
        let path = self.image()?;
        let files = Files::default().reads([&path]).reads(&self.config);
        files.writes(&self.file).check()?;
        if let Some(file) = &self.file {
            ensure!(
                self.overwrite || !file.exists(),
                "{} exists: name another file with --file, or use --overwrite",
                file_name(file)
            );
        }
        if let Some(page) = page {
            tell(node::text(page.config.settings())?.trim_end());
        }
        if self.dry_run {
            for step in self.steps(loader, &path, page) {
                print(&format!("{step}\n"))?;
            }
            return Ok(());
        }
        let elf = fs::read(&path).with_context(|| OfFile::unread(&path))?;
        let image = Image::of(self.board, &elf)?;
        let bytes = page.map(|page| fs::read(&page.path)).transpose()?;
        let file = image.file(bytes.as_deref(), self.erase_memory);
        let (_, file) = file.context("the board's boot loader takes no file")?;
        match (&self.file, loader) {
            (Some(path), _) => {
                // It may hold a key.
                write_private(path, &file, self.overwrite)
                    .with_context(|| format!("{} was not written", path.display()))?;
                if let Loader::Dfu { press, .. } = loader {
                    tell(boot_loader::by_hand(press, path));
                }
                Ok(())
            }
            (None, Loader::Uf2 { .. }) => {
                let volume = Volume::wait_for(self.board, self.volume.as_deref())?;
                if let Some(page) = page.filter(|_| !self.erase_memory) {
                    compare(&volume.page()?, page.config.settings())?;
                }
                volume.write(&file)
            }
            (None, Loader::Dfu { press, usb, .. }) => {
                let package = image.package(bytes.as_deref());
                let package = package.context("the board's boot loader takes no package")?;
                boot_loader::send(self.board, (press, usb), self.port.as_deref(), package)
            }
        }
    }

    /// Steps of [`Self::by_boot_loader`], for a person.
    fn steps(&self, loader: Loader, image: &Path, page: Option<&Page>) -> Vec<String> {
        let title = self.board.title;
        let page = page.map(|page| page.path.display());
        let mut parts = format!("the image {}", image.display());
        if let Some(page) = &page {
            parts += &format!(", the page {page}");
        }
        if self.erase_memory {
            parts += ", an erased memory";
        }
        match (&self.file, loader) {
            (Some(file), loader) => {
                let written = format!("write {}: {parts}", file.display());
                let by_hand = match loader {
                    Loader::Dfu { press, .. } => Some(boot_loader::by_hand(press, file)),
                    Loader::Uf2 { .. } => None,
                };
                [Some(written), by_hand].into_iter().flatten().collect()
            }
            (
                None,
                Loader::Uf2 {
                    press, soft_device, ..
                },
            ) => {
                let place = match &self.volume {
                    Some(folder) => format!(" in {}", folder.display()),
                    None => String::new(),
                };
                let compared = page.filter(|_| !self.erase_memory);
                let compared = compared.map(|page| format!("compare the board's page with {page}"));
                let first = [
                    format!("wait for the volume of a {title}{place}: {press}"),
                    format!("check that it has the SoftDevice {soft_device}"),
                ];
                let last = [
                    format!("copy one file to it: {parts}"),
                    "wait until the board has started".to_owned(),
                ];
                first.into_iter().chain(compared).chain(last).collect()
            }
            (None, Loader::Dfu { press, .. }) => {
                let port = match &self.port {
                    Some(port) => format!("the serial port {port}"),
                    None => format!("the serial port of a {title}"),
                };
                vec![
                    format!("wait for {port}: {press}"),
                    format!("send one package to it: {parts}"),
                    "wait until the board has started".to_owned(),
                ]
            }
        }
    }

    fn page(&self) -> Result<Option<Page>> {
        let Some(path) = &self.config else {
            return Ok(None);
        };
        Ok(Some(Page {
            config: read_page(path)?,
            path: path.clone(),
        }))
    }

    /// Path of the image, checked to be for this board.
    fn image(&self) -> Result<PathBuf> {
        let image = match &self.image {
            Some(image) => image.clone(),
            None => Path::new(IMAGES).join(format!("{}-node.elf", self.board.name)),
        };
        if self.image.is_none() && !image.is_file() {
            let missing = format!(
                "there is no image {}: type `cargo xtask firmware`, which makes it, or name one with \
                 --image",
                image.display()
            );
            ensure!(self.dry_run, missing);
            tell(missing);
            return Ok(image);
        }
        let bytes = fs::read(&image);
        let bytes = bytes.with_context(|| OfFile::unread(&image))?;
        Image::of(self.board, &bytes)
            .with_context(|| format!("{} was not written", image.display()))?;
        Ok(image)
    }

    /// Refuses a page that makes another node of the board, as [`compare`].
    fn compare(&self, sh: &Shell, new: &Config) -> Result<()> {
        let said = self.look(sh).quiet().read().context(
            "nothing was written: see what probe-rs says above. A board that was locked is \
                 written with --unlock, which erases it",
        )?;
        let bytes = parse_read(&said);
        ensure!(
            bytes.len() == PAGE_MAX,
            "probe-rs printed {} bytes of the board's page, which has {PAGE_MAX}, and nothing was \
             written: update probe-rs, or make the board forget with --erase-memory",
            bytes.len()
        );
        compare(&bytes, new)
    }

    /// Reads the page that the board has. Its output holds a key: it is not to be shown.
    fn look<'a>(&self, sh: &'a Shell) -> Cmd<'a> {
        let probe = &self.probe_options();
        let address = format!("{:#010x}", self.board.config());
        let bytes = PAGE_MAX.to_string();
        cmd!(sh, "probe-rs read {probe...} b8 {address} {bytes}")
    }

    fn probe_options(&self) -> Vec<&str> {
        let mut options = vec!["--chip", self.board.chip.probe];
        if let Some(selector) = &self.probe {
            options.extend(["--probe", selector]);
        }
        options
    }

    /// The page comes before the memory is erased: if the node starts between two commands, it does
    /// not begin again with the former page's counters. A debug port is closed last.
    fn commands<'a>(
        &self,
        sh: &'a Shell,
        image: &Path,
        page: Option<&Path>,
        beside: &Beside,
    ) -> Vec<Cmd<'a>> {
        let probe = &self.probe_options();
        // What is erased with the page and not written would be lost: a part of the image, or the page with an image.
        let shares = !{ self.board.regions.config.start }.is_multiple_of(self.board.chip.page);
        let keep = shares.then_some("--restore-unwritten");
        let bytes = |path: &Path, address: u32| {
            let address = format!("{address:#010x}");
            cmd!(
                sh,
                "probe-rs download {probe...} {keep...} --verify --binary-format bin --base-address {address} {path}"
            )
        };
        let selector = self.probe.as_deref();
        let mut commands = Vec::new();
        commands.extend(
            self.unlock
                .then(|| lock::unlock(self.board, sh, selector, probe)),
        );
        commands.push(cmd!(
            sh,
            "probe-rs download {probe...} {keep...} --verify --binary-format elf {image}"
        ));
        commands.extend(page.map(|page| bytes(page, self.board.config())));
        let (memory, _) = self.board.memory();
        commands.extend(self.erase_memory.then(|| bytes(&beside.erased, memory)));
        let reset = cmd!(sh, "probe-rs reset {probe...}");
        let lock = self
            .lock
            .then(|| lock::lock(self.board, sh, selector, probe, &beside.enabled));
        // OpenOCD starts the board itself, and nothing connects to it after that.
        match self.board.chip.family {
            Family::Nrf52 => commands.extend(lock.into_iter().chain([reset])),
            Family::Stm32l4 => commands.push(lock.unwrap_or(reset)),
        }
        commands
    }
}

/// Refuses a page that makes another node of the board that has this page: the node would go on with the former one's
/// memory.
fn compare(bytes: &[u8], new: &Config) -> Result<()> {
    let old = match page::decode(bytes) {
        Ok(old) => old.settings().clone(),
        Err(PageError::Blank) => return Ok(()),
        Err(error) => bail!(
            "the board has a page that cannot be compared with this one ({error}), and nothing \
             was written: make it forget what it learnt with --erase-memory"
        ),
    };
    let [old_role, new_role] = [&old, new].map(|config| RoleName::from(&config.role));
    let differences: Vec<_> = [
        ("site key", old.site_key != new.site_key),
        ("role", old_role != new_role),
        ("number", old.id != new.id),
    ]
    .into_iter()
    .filter_map(|(what, differs)| differs.then_some(what))
    .collect();
    if !differences.is_empty() {
        bail!(
            "the board is node {}, a {old_role}; the page has another {}, and nothing was \
             written: take another board, or make this one forget what it learnt with \
             --erase-memory",
            old.id,
            differences.join(", another ")
        );
    }
    Ok(())
}

/// Files beside the image that are also written.
struct Beside {
    /// A memory in which nothing was learnt.
    erased: PathBuf,
    /// Value that closes the debug port.
    enabled: PathBuf,
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    fs::write(path, bytes).with_context(|| format!("{} was not written", path.display()))
}

/// The bytes that `probe-rs read b8` prints: hexadecimal numbers, in newer versions with their
/// address and a colon before each line.
fn parse_read(said: &str) -> Vec<u8> {
    said.split_whitespace()
        .filter(|word| !word.ends_with(':'))
        .map_while(|word| u8::from_str_radix(word, 16).ok())
        .collect()
}

fn is_on_path(program: &str) -> bool {
    env::var_os("PATH")
        .is_some_and(|path| env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}
