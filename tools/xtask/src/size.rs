//! Flash and RAM of the link on a Cortex-M4F, read from images built as firmware is.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};
use object::{Object, ObjectSymbol};
use xshell::Shell;

use crate::{
    elf::{self, Size},
    firmware,
};

const PACKAGE: &str = "bench-size";

/// Image with only the common part: the start of the processor.
const EMPTY: &str = "empty";

struct Image {
    name: &'static str,
    contents: &'static str,
    /// Most bytes of flash and RAM it may take.
    budget: Option<(u64, u64)>,
}

const IMAGES: [Image; 4] = [
    Image {
        name: "link",
        contents: "messages, security, 16 peers",
        budget: Some((17 * 1024 + 768, 4 * 1024)),
    },
    Image {
        name: "store",
        contents: "and key and frame counter in flash",
        budget: None,
    },
    Image {
        name: "device",
        contents: "and joining a network",
        budget: None,
    },
    Image {
        name: "coordinator",
        contents: "and forming one, 16 members",
        budget: None,
    },
];

/// An image, without what the empty one takes.
pub(crate) struct Measurement {
    image: &'static Image,
    path: PathBuf,
    size: Size,
}

/// Builds the images and reads their sizes.
pub(crate) fn run(sh: &Shell) -> Result<Vec<Measurement>> {
    let paths = build(sh)?;
    let path = |name: &str| {
        let found = paths.iter().find(|path| path.ends_with(name));
        found.with_context(|| format!("cargo built no image `{name}` of {PACKAGE}"))
    };
    let empty = size(path(EMPTY)?)?;
    IMAGES
        .iter()
        .map(|image| {
            let path = path(image.name)?;
            let whole = size(path)?;
            Ok(Measurement {
                image,
                path: path.clone(),
                size: Size {
                    flash: whole.flash.saturating_sub(empty.flash),
                    ram: whole.ram.saturating_sub(empty.ram),
                },
            })
        })
        .collect()
}

/// Fails if an image is over its budget.
pub(crate) fn within_budget(measurements: &[Measurement]) -> Result<()> {
    for Measurement { image, size, .. } in measurements {
        if let Some((flash, ram)) = image.budget {
            ensure!(
                size.flash <= flash && size.ram <= ram,
                "`{}` takes {} bytes of flash and {} of RAM, its budget is {flash} and {ram}",
                image.name,
                size.flash,
                size.ram
            );
        }
    }
    Ok(())
}

/// A Markdown table: a row per image.
pub(crate) fn table(measurements: &[Measurement]) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN);
    table.set_header(["zigbee-link on a Cortex-M4F", "flash", "RAM", "at most"]);
    for Measurement { image, size, .. } in measurements {
        let budget = image.budget.map_or_else(String::new, |(flash, ram)| {
            format!("{flash} and {ram} bytes")
        });
        table.add_row([
            image.contents.to_owned(),
            size.flash.to_string(),
            size.ram.to_string(),
            budget,
        ]);
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// The largest functions and statics of each image.
pub(crate) fn largest(measurements: &[Measurement], count: usize) -> Result<String> {
    let mut text = String::new();
    for Measurement { image, path, .. } in measurements {
        let data = fs::read(path)?;
        let file = object::File::parse(&*data)?;
        let mut symbols: Vec<_> = file
            .symbols()
            .filter(|symbol| symbol.size() > 0)
            .map(|symbol| Ok((symbol.size(), symbol.name()?)))
            .collect::<Result<_>>()?;
        symbols.sort_unstable_by(|a, b| b.cmp(a));
        text += &format!("\n{}\n", image.name);
        for (size, name) in symbols.into_iter().take(count) {
            text += &format!("{size:8} {:#}\n", rustc_demangle::demangle(name));
        }
    }
    Ok(text)
}

fn build(sh: &Shell) -> Result<Vec<PathBuf>> {
    let messages = firmware::compiled(sh, PACKAGE, &[])?;
    let mut images = Vec::new();
    for message in messages.lines() {
        let message: serde_json::Value = serde_json::from_str(message)?;
        if let Some(image) = message["executable"].as_str() {
            images.push(image.into());
        }
    }
    Ok(images)
}

fn size(image: &Path) -> Result<Size> {
    let name = || image.display().to_string();
    let bytes = fs::read(image).with_context(name)?;
    let file = object::File::parse(&*bytes).with_context(name)?;
    elf::size(&file).with_context(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(flash: u64, ram: u64) -> [Measurement; 1] {
        [Measurement {
            image: &IMAGES[0],
            path: PathBuf::new(),
            size: Size { flash, ram },
        }]
    }

    #[test]
    fn a_budget_is_kept_or_not() {
        let (flash, ram) = IMAGES[0].budget.unwrap();
        assert!(within_budget(&measured(flash, ram)).is_ok());
        assert!(within_budget(&measured(flash + 1, ram)).is_err());
        assert!(within_budget(&measured(flash, ram + 1)).is_err());
    }
}
