//! Figures in the documentation that chores measure: a chore that measures them compares them with the pages, or,
//! with `UPDATE=1`, writes them there.

use std::{collections::BTreeSet, env, fs};

use anyhow::{Context, Result, ensure};
use xshell::Shell;

const PAGES: [&str; 2] = ["README.md", "docs/hardware.md"];
const END: &str = "<!-- end -->";

/// Distance that a figure may have from the one on a page: a hundredth, or this. Compilers place and inline a
/// little differently from one machine to the next, and a page need not follow that.
const NOISE: u64 = 256;

/// A table of Markdown by its name: `<!-- NAME -->` is above it on a page, and `<!-- end -->` below.
pub(crate) struct Table {
    pub(crate) name: &'static str,
    pub(crate) rows: Vec<Vec<String>>,
}

/// Compares tables with the pages, or writes them there.
///
/// # Errors
/// A page says something else, or none has one of the tables.
pub(crate) fn agree(sh: &Shell, chore: &str, tables: &[Table]) -> Result<()> {
    let mut found = BTreeSet::new();
    let mut stale = Vec::new();
    let mut news = Vec::new();
    // Exactly, so that two pages do not say two figures.
    let is_update = env::var_os("UPDATE").is_some();
    let noise = if is_update { 0 } else { NOISE };
    for name in PAGES {
        let path = sh.current_dir().join(name);
        let page = fs::read_to_string(&path).with_context(|| name.to_owned())?;
        let made = made_anew(&page, tables, noise, &mut found, &mut news);
        if made == page {
        } else if is_update {
            fs::write(&path, made).with_context(|| name.to_owned())?;
        } else {
            stale.push(name);
        }
    }
    for table in tables {
        ensure!(found.contains(table.name), "no page has `{}`", table.name);
    }
    ensure!(
        stale.is_empty(),
        "the figures in {} are not those of this tree: type `UPDATE=1 cargo xtask {chore}`. It has\n{}",
        stale.join(" and "),
        news.join("\n")
    );
    Ok(())
}

/// A number as the pages have it: 184,508.
pub(crate) fn number(number: u64) -> String {
    let digits = number.to_string();
    let mut shown = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            shown.push(',');
        }
        shown.push(digit);
    }
    shown
}

fn begin(table: &str) -> String {
    format!("<!-- {table} -->\n")
}

/// The page with these tables, where they differ from the old ones by more than the noise and a hundredth, or at all
/// if there is none; and the rows that are new.
fn made_anew(
    page: &str,
    tables: &[Table],
    noise: u64,
    found: &mut BTreeSet<&'static str>,
    news: &mut Vec<String>,
) -> String {
    let mut page = page.to_owned();
    for Table { name, rows } in tables {
        let Some((before, after)) = page.split_once(&begin(name)) else {
            continue;
        };
        let Some((old, after)) = after.split_once(END) else {
            continue;
        };
        found.insert(name);
        let mut table = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            table.push(format!("| {} |", row.join(" | ")).replace("|  |", "| |"));
            if i == 0 {
                table.push(format!("|{}", "---|".repeat(row.len())));
            }
        }
        let old: Vec<_> = old.lines().collect();
        if old.len() == table.len()
            && old
                .iter()
                .zip(&table)
                .all(|(old, new)| is_alike(old, new, noise))
        {
            continue;
        }
        news.extend(
            table
                .iter()
                .filter(|row| !old.contains(&row.as_str()))
                .cloned(),
        );
        page = format!("{before}{}{}\n{END}{after}", begin(name), table.join("\n"));
    }
    page
}

/// Returns true if two rows are the same but for the noise.
fn is_alike(old: &str, new: &str, noise: u64) -> bool {
    let (old, new): (Vec<_>, Vec<_>) = (old.split('|').collect(), new.split('|').collect());
    let figure = |cell: &str| cell.trim().replace(',', "").parse::<u64>().ok();
    old.len() == new.len()
        && old
            .iter()
            .zip(&new)
            .all(|(old, new)| match (figure(old), figure(new)) {
                (Some(old), Some(new)) if noise > 0 => old.abs_diff(new) <= noise.max(old / 100),
                _ => old == new,
            })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str =
        "a\n<!-- sizes -->\n| of | b |\n|---|---|\n| c | 51,234 |\n<!-- end -->\nd\n";

    fn sizes(bytes: u64) -> Table {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        Table {
            name: "sizes",
            rows: vec![row(["of", "b"]), row(["c", &number(bytes)])],
        }
    }

    fn made(page: &str, bytes: u64) -> (String, Vec<String>, bool) {
        let (mut found, mut news) = (BTreeSet::new(), Vec::new());
        let made = made_anew(page, &[sizes(bytes)], NOISE, &mut found, &mut news);
        (made, news, !found.is_empty())
    }

    #[test]
    fn only_the_table_is_made_anew() {
        let new = PAGE.replace("51,234", "50,000");
        assert_eq!(
            made(PAGE, 50_000),
            (new, vec!["| c | 50,000 |".to_owned()], true)
        );
        let other = PAGE.replace("sizes", "other");
        assert_eq!(made(&other, 50_000), (other.clone(), Vec::new(), false));
    }

    #[test]
    fn a_page_stays_as_it_is_within_the_noise_and_no_further() {
        for (bytes, is_kept) in [
            (51_234, true),
            (51_746, true),
            (51_747, false),
            (50_721, false),
        ] {
            assert_eq!(made(PAGE, bytes).0 == PAGE, is_kept, "{bytes}");
        }
        let small = PAGE.replace("51,234", "300");
        for (bytes, is_kept) in [(556, true), (557, false), (44, true), (43, false)] {
            assert_eq!(made(&small, bytes).0 == small, is_kept, "{bytes}");
        }
    }

    #[test]
    fn an_update_leaves_no_noise() {
        let update = |bytes| made_anew(PAGE, &[sizes(bytes)], 0, &mut BTreeSet::new(), &mut vec![]);
        assert_eq!(update(51_235), PAGE.replace("51,234", "51,235"));
        assert_eq!(update(51_234), PAGE);
    }

    #[test]
    fn numbers_have_their_commas() {
        for (value, shown) in [
            (0, "0"),
            (999, "999"),
            (1000, "1,000"),
            (1_234_567, "1,234,567"),
        ] {
            assert_eq!(number(value), shown);
        }
    }
}
