//! `host-sim provision`

mod options;

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use node_firmware::config::{CheckedConfig, RoleConfig, SiteKey};
use radio_update::package::Key;
use site::{
    NetworkConfigs, Overrides, Purpose, Scenario, key_file,
    node::{self, RoleName},
    page_file,
};
use toml::Table;

use super::{
    OfFile, file_name, files::Files, of_site, print, public_update_key,
    scenario_options::tell_doubts, tell, values, whole_file,
};

/// Makes configuration pages, which tell boards which nodes they are.
///
/// Makes a page, or those of a whole site, one line for each; `--show PAGE` tells what is in one. The site key is
/// never shown.
#[derive(Args)]
pub(super) struct Arguments {
    /// Tells what is in a page.
    #[arg(long, value_name = "PAGE", exclusive = true)]
    show: Option<PathBuf>,
    /// The site's key, of `host-sim keygen`; without it, the `key_file` of the site.
    #[arg(long, value_name = "FILE")]
    site_key: Option<PathBuf>,
    /// The key of `host-sim keygen --updates`: nodes take images that are signed with it, by radio.
    #[arg(long, value_name = "FILE")]
    update_key: Option<PathBuf>,
    /// A node's parameters; options stand over them.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// All nodes of a site, from the file that `host-sim run` rehearses; --out is then a folder.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "config")]
    site: Option<PathBuf>,
    /// File or folder to write; without it, node-ID.page.bin.
    #[arg(long, value_name = "PATH", value_parser = values::result())]
    out: Option<PathBuf>,
    /// Writes over pages that exist.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    options: options::Options,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    if let Some(path) = &arguments.show {
        let config = read_page(path)?;
        print(&node::text(config.settings())?)?;
        return Ok(ExitCode::SUCCESS);
    }
    match &arguments.site {
        Some(file) => arguments.whole_site(file)?,
        None => arguments.one_node()?,
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn one_node(&self) -> Result<()> {
        let path = self.site_key.as_deref().context(
            "whose pages? Say --site FILE.toml --out FOLDER for all nodes of a site, --site-key FILE \
             with --role and --id for one node, or --show PAGE",
        )?;
        let key = read_key(path)?;
        let mut table = match &self.config {
            Some(file) => read_table(file)?,
            None => Table::new(),
        };
        node::merge(&mut table, self.options.table()?);
        let config = node::config(table, key)?;
        let out = self.out.clone();
        let out = out.unwrap_or_else(|| default_name(&config).into());
        self.write_all(path, &[(config, out)])
    }

    fn whole_site(&self, file: &Path) -> Result<()> {
        let name = file_name(file);
        ensure!(
            self.options.table()?.is_empty(),
            "a site's nodes have their parameters in its file, not in options"
        );
        let folder = self.out.as_deref();
        let folder = folder.context("where to? Say --out FOLDER, into which the pages go")?;
        let scenario =
            Scenario::load(&name, &Overrides::default()).map_err(|error| of_site(&name, error))?;
        tell_doubts(&name, &scenario);
        let open = scenario.assumptions(Purpose::Deployment);
        if !open.is_empty() {
            let open: String = open.iter().map(|one| format!("\n  {one}")).collect();
            bail!("{name} leaves open what real nodes have to be told:{open}");
        }
        let path = match (&self.site_key, &scenario.key_file) {
            (Some(path), _) => path.clone(),
            (None, Some(key)) => file.with_file_name(key),
            (None, None) => bail!(
                "which key has the site? Say --site-key FILE, or write `key_file = \"FILE\"` into \
                 {name}; `host-sim keygen FILE` makes one"
            ),
        };
        let key = read_key(&path)?;
        let networks = site::configs(&scenario, key).map_err(|error| of_site(&name, error))?;
        let nodes = networks.iter().flat_map(NetworkConfigs::iter);
        let pages = nodes.map(|config| (config.clone(), folder.join(default_name(config))));
        let pages: Vec<_> = pages.collect();
        Files::default()
            .writes_into([&folder.to_owned()], &[])
            .check()?;
        fs::create_dir_all(folder).with_context(|| OfFile::unmade(folder))?;
        self.write_all(&path, &pages)?;
        tell_strangers(folder, &pages);
        Ok(())
    }

    /// Writes all pages or, when one cannot be written, none.
    fn write_all(&self, key: &Path, pages: &[(CheckedConfig, PathBuf)]) -> Result<()> {
        let read = [&self.site, &self.config];
        Files::default()
            .reads([key])
            .reads(read.into_iter().flatten())
            .reads(&self.update_key)
            .writes(pages.iter().map(|(_, page)| page))
            .check()?;
        for (_, page) in pages {
            ensure!(
                self.overwrite || !page.exists(),
                "{} exists: name another file with --out, or use --overwrite",
                file_name(page)
            );
        }
        let update_key = self
            .update_key
            .as_deref()
            .map(public_update_key)
            .transpose()?;
        // Warnings come first: they would be lost among the pages.
        for (config, _) in pages {
            self.warn(config);
        }
        pages
            .iter()
            .try_for_each(|(config, page)| self.write(config, update_key.as_ref(), page))
    }

    fn write(&self, config: &CheckedConfig, key: Option<&Key>, path: &Path) -> Result<()> {
        let name = file_name(path);
        let length =
            page_file::write(path, config, key, self.overwrite).with_context(|| name.clone())?;
        let (role, id) = (
            RoleName::from(&config.settings().role),
            config.settings().id,
        );
        print(&format!("{name}: {role} {id}, {length} bytes\n"))?;
        Ok(())
    }

    /// Tells what a node needs besides its page.
    fn warn(&self, config: &CheckedConfig) {
        match &config.settings().role {
            RoleConfig::Coordinator(coordinator)
                if coordinator.allow.is_empty() && coordinator.join_window_s == 0 =>
            {
                tell("No node may join this coordinator until its button opens the join window.");
            }
            RoleConfig::Target(target) if target.sensor.hard_iron == [0.0; 3] => {
                let what = match &self.site {
                    Some(_) => "`hard_iron` in the site's file",
                    None => "--hard-iron",
                };
                tell(format_args!(
                    "Without {what} the compass of target {} shows no direction on a real board.",
                    config.settings().id
                ));
            }
            _ => {}
        }
    }
}

/// Tells of pages in the folder that are of no node of the site: the user could flash one by mistake.
fn tell_strangers(folder: &Path, pages: &[(CheckedConfig, PathBuf)]) {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_page = |name: &str| name.starts_with("node-") && name.ends_with(".page.bin");
    let mut strangers: Vec<_> = found
        .filter(|found| !pages.iter().any(|(_, page)| *page == found.path()))
        .filter_map(|found| found.file_name().into_string().ok())
        .filter(|name| is_page(name))
        .collect();
    strangers.sort();
    if !strangers.is_empty() {
        tell(format_args!(
            "{} also has pages of no node of this site: {}. Remove them, if they are of an earlier one.",
            file_name(folder),
            strangers.join(", ")
        ));
    }
}

/// Reads a page that is to be shown or flashed.
pub(super) fn read_page(path: &Path) -> Result<CheckedConfig> {
    page_file::read(path).with_context(|| OfFile::named(path))
}

fn read_key(path: &Path) -> Result<SiteKey> {
    key_file::read(path).with_context(|| OfFile::named(path))
}

fn read_table(path: &Path) -> Result<Table> {
    let name = file_name(path);
    let text = whole_file::read(path, site::FILE_MAX)?;
    text.parse().with_context(|| format!("{name} is not TOML"))
}

fn default_name(config: &CheckedConfig) -> String {
    format!("node-{}.page.bin", config.settings().id)
}
