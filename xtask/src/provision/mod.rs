//! `cargo xtask provision`: configuration pages for nodes.
//!
//! | module | |
//! |---|---|
//! | `key_file` | site keys in files |
//! | `node` | what people write of a node |
//! | `options` | the same on the command line |
//! | `site` | all nodes of a site, from one file |
//! | `text` | a configuration as text |

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use node_firmware::config::{
    Config, Role,
    page::{self, PAGE_MAX},
};
use toml::Table;

mod key_file;
mod node;
mod options;
mod site;
mod text;

pub(crate) use self::{key_file::Keygen, node::RoleName, text::text};

/// Configuration pages, which tell boards which nodes they are
///
/// Makes a page, or those of a whole site, or tells what is in one. The site key is never shown.
/// Ends with 2 if an option is wrong, with 1 if anything else is.
#[derive(clap::Args)]
pub(crate) struct Provision {
    /// Tells what is in a page
    #[arg(long, value_name = "PAGE", exclusive = true)]
    show: Option<PathBuf>,
    /// The site's key, of `cargo xtask keygen`
    #[arg(long, value_name = "FILE", required_unless_present = "show")]
    site_key: Option<PathBuf>,
    /// A node's parameters; options stand over them
    #[arg(long, value_name = "FILE.toml", conflicts_with = "site")]
    config: Option<PathBuf>,
    /// All nodes of a site; --out is then a folder
    #[arg(long, value_name = "FILE.toml", requires = "out")]
    site: Option<PathBuf>,
    /// Where to write; without it, node-ID.page.bin
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Writes over pages that exist
    #[arg(long)]
    overwrite: bool,
    /// The first frame counter: above all that nodes used under this key; without it, the seconds
    /// since 2026 began
    #[arg(long, value_name = "N")]
    first_counter: Option<u32>,
    #[command(flatten)]
    options: options::Options,
}

impl Provision {
    pub(crate) fn run(&self) -> Result<()> {
        if let Some(path) = &self.show {
            print!("{}", text(&read_page(path)?)?);
            return Ok(());
        }
        let path = self.site_key.as_deref().context("--site-key is missing")?;
        let key = key_file::read(path)?;
        let counter = self.first_counter.map_or_else(node::counter_now, Ok)?;
        let options = self.options.table()?;
        if let Some(file) = &self.site {
            ensure!(
                options.is_empty(),
                "a site's nodes have their parameters in its file, not in options"
            );
            let configs = site::configs(read_table(file)?, key, counter)
                .with_context(|| file.display().to_string())?;
            let folder = self.out.as_deref().context("--out is missing")?;
            fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
            let pages = configs
                .iter()
                .map(|config| folder.join(default_name(config)));
            let pages: Vec<_> = pages.collect();
            // All or none.
            pages.iter().try_for_each(|page| self.check_free(page))?;
            let mut pairs = configs.iter().zip(&pages);
            return pairs.try_for_each(|(config, page)| self.write(config, page));
        }
        let mut table = match &self.config {
            Some(file) => read_table(file)?,
            None => Table::new(),
        };
        node::merge(&mut table, options);
        let config = node::config(table, key, counter)?;
        let out = self.out.clone();
        let out = out.unwrap_or_else(|| default_name(&config).into());
        self.check_free(&out)?;
        self.write(&config, &out)
    }

    fn check_free(&self, path: &Path) -> Result<()> {
        let name = path.display();
        ensure!(!path.is_dir(), "{name} is a folder: name a file");
        ensure!(
            self.overwrite || !path.exists(),
            "{name} exists: name another file with --out, or use --overwrite"
        );
        Ok(())
    }

    /// A page holds the key: nobody else may read it.
    fn write(&self, config: &Config, path: &Path) -> Result<()> {
        let mut bytes = [0; PAGE_MAX];
        let length = page::encode(config, &mut bytes)?;
        let file = key_file::private_file(path, &bytes)?;
        let written = match self.overwrite {
            true => file.persist(path),
            false => file.persist_noclobber(path),
        };
        written.with_context(|| format!("{} was not written", path.display()))?;
        println!("# {}: {length} bytes", path.display());
        println!("{}", text(config)?);
        if let Role::Coordinator(coordinator) = &config.role
            && coordinator.allow.is_empty()
            && coordinator.join_window_s == 0
        {
            eprintln!("Nobody may join this coordinator until its button opens the join window.");
        }
        if let Role::Target(target) = &config.role
            && target.sensor.hard_iron == [0.0; 3]
        {
            eprintln!(
                "Without --hard-iron the compass of this target shows no direction on a real board."
            );
        }
        Ok(())
    }
}

/// Reads a page that is to be shown or flashed.
pub(crate) fn read_page(path: &Path) -> Result<Config> {
    let name = path.display();
    let bytes = fs::read(path).with_context(|| format!("{name} cannot be read"))?;
    let config = page::decode(&bytes).with_context(|| format!("{name} is no page for a node"))?;
    // More would go over what comes behind the page in the flash.
    ensure!(
        bytes.len() == PAGE_MAX,
        "{name} has {} bytes, a page has {PAGE_MAX}: make it again with `cargo xtask provision`",
        bytes.len()
    );
    Ok(config)
}

fn read_table(path: &Path) -> Result<Table> {
    let text =
        fs::read_to_string(path).with_context(|| format!("{} cannot be read", path.display()))?;
    text.parse()
        .with_context(|| format!("{} is not TOML", path.display()))
}

fn default_name(config: &Config) -> String {
    format!("node-{}.page.bin", config.id)
}
