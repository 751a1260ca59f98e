//! `cargo xtask flash`: an image, and the page that says which node it is, onto a board.

use std::{
    fs,
    path::{Path, PathBuf, absolute},
};

use anyhow::{Context, Result, ensure};
use xshell::{Cmd, Shell, cmd};

use crate::{provision, setup};

const INSTALL: &str = "probe-rs is not installed: see https://probe.rs/docs/getting-started/installation/, or \
     type `cargo install probe-rs-tools --locked` (on Debian after `sudo apt-get install \
     pkg-config libudev-dev`)";

/// Where a board's own pages are, as in its `src/memory.rs`.
struct Layout {
    /// The chip's name for probe-rs.
    chip: &'static str,
    /// What the role and the link must not forget, one behind the other: address and bytes.
    memory: (u32, usize),
    /// The configuration page.
    config: u32,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Board {
    /// nRF52840-DK, or another board with this chip
    Nrf52840,
}

impl Board {
    const fn name(self) -> &'static str {
        match self {
            Self::Nrf52840 => "nrf52840",
        }
    }

    const fn layout(self) -> Layout {
        match self {
            Self::Nrf52840 => Layout {
                chip: "nRF52840_xxAA",
                memory: (0x000f_7000, 32 * 1024),
                config: 0x000f_f000,
            },
        }
    }
}

/// The image and a configuration page onto a board
///
/// What the node learnt is kept.
#[derive(clap::Args)]
pub(crate) struct Flash {
    /// Which board
    board: Board,
    /// The page, of `cargo xtask provision`; without it, the node keeps the one it has
    #[arg(long, value_name = "PAGE")]
    config: Option<PathBuf>,
    /// The image; without it, that of `cargo xtask firmware`
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
    /// Which debug probe, as `probe-rs list` names it: VID:PID or VID:PID:SERIAL
    #[arg(long)]
    probe: Option<String>,
    /// Makes the node forget its network, its place, and which frame counters it used: for another
    /// site key, or another role. Only with a page made now
    #[arg(long, requires = "config")]
    erase_memory: bool,
    /// Tells the commands, and runs none
    #[arg(long)]
    dry_run: bool,
}

impl Flash {
    pub(crate) fn run(&self, sh: &Shell) -> Result<()> {
        let board = self.board.name();
        let firmware = sh.current_dir().canonicalize()?.join("target/firmware");
        let image = match &self.image {
            Some(image) => absolute(image)?,
            None => firmware.join(format!("{board}.elf")),
        };
        ensure!(
            image.is_file(),
            "there is no image {}: type `cargo xtask firmware`, or use --image ELF",
            image.display()
        );
        let page = self.config.as_deref().map(absolute).transpose()?;
        if let Some(page) = &page {
            let config = provision::read_page(page)?;
            eprint!("{}", provision::text(&config)?);
            if self.erase_memory {
                eprintln!(
                    "warning: the node forgets which frame counters it used, and begins again \
                     with {}. If it ran with this page before, or with a later one of the same \
                     key, make a new page first: a counter used twice gives away what was said \
                     under it.",
                    config.first_counter
                );
            }
        }
        let erased = firmware.join(format!("{board}-erased.bin"));
        let commands = self.commands(sh, &image, page.as_deref(), &erased);
        if self.dry_run {
            for command in &commands {
                println!("{command}");
            }
            if !setup::is_on_path("probe-rs") {
                eprintln!("{INSTALL}");
            }
            return Ok(());
        }
        ensure!(setup::is_on_path("probe-rs"), INSTALL);
        if self.erase_memory {
            let (_, bytes) = self.board.layout().memory;
            sh.create_dir(&firmware)?;
            fs::write(&erased, vec![0xFF; bytes])
                .with_context(|| format!("{} was not written", erased.display()))?;
        }
        for command in commands {
            command.run().context(
                "the board is not complete: see what probe-rs says above, then type the same \
                 command again",
            )?;
        }
        Ok(())
    }

    /// The page comes before the memory is erased: should the node start between two commands, it
    /// does not begin again with the former page's counters.
    fn commands<'a>(
        &self,
        sh: &'a Shell,
        image: &Path,
        page: Option<&Path>,
        erased: &Path,
    ) -> Vec<Cmd<'a>> {
        let Layout {
            chip,
            memory: (memory, _),
            config,
        } = self.board.layout();
        let mut probe = vec!["--chip", chip];
        if let Some(selector) = &self.probe {
            probe.extend(["--probe", selector]);
        }
        let probe = &probe;
        let bytes = |path: &Path, address: u32| {
            let address = format!("{address:#010x}");
            cmd!(
                sh,
                "probe-rs download {probe...} --verify --binary-format bin --base-address {address} {path}"
            )
        };
        let mut commands = vec![cmd!(
            sh,
            "probe-rs download {probe...} --verify --binary-format elf {image}"
        )];
        commands.extend(page.map(|page| bytes(page, config)));
        commands.extend(self.erase_memory.then(|| bytes(erased, memory)));
        commands.push(cmd!(sh, "probe-rs reset {probe...}"));
        commands
    }
}
