//! Figures in the documentation that chores measure: a chore that measures them compares them with what
//! the pages say, or, with `UPDATE=1`, writes them there.

use std::{collections::BTreeSet, env, fs};

use anyhow::{Context, Result, ensure};
use xshell::Shell;

const PAGES: [&str; 2] = ["README.md", "docs/hardware.md"];
const END: &str = "<!-- end -->";

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
    for name in PAGES {
        let path = sh.current_dir().join(name);
        let page = fs::read_to_string(&path).with_context(|| name.to_owned())?;
        let made = made_anew(&page, tables, &mut found);
        if made == page {
        } else if env::var_os("UPDATE").is_some() {
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
        "the figures in {} are not those of this tree: type `UPDATE=1 cargo xtask {chore}`",
        stale.join(" and ")
    );
    Ok(())
}

/// The last cell of a row that the documentation has, as a number.
pub(crate) fn figure(sh: &Shell, table: &str, row: &str) -> Result<Option<u64>> {
    for name in PAGES {
        let page = fs::read_to_string(sh.current_dir().join(name))?;
        if let Some(figure) = figure_in(&page, table, row) {
            return Ok(Some(figure));
        }
    }
    Ok(None)
}

fn figure_in(page: &str, table: &str, row: &str) -> Option<u64> {
    let (_, after) = page.split_once(&begin(table))?;
    let (rows, _) = after.split_once(END)?;
    let start = format!("| {row} |");
    let cells = rows.lines().find_map(|line| line.strip_prefix(&*start))?;
    let last = cells.trim_end_matches('|').rsplit('|').next()?;
    last.trim().replace(',', "").parse().ok()
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

/// The page with these tables.
fn made_anew(page: &str, tables: &[Table], found: &mut BTreeSet<&'static str>) -> String {
    let mut page = page.to_owned();
    for Table { name, rows } in tables {
        let Some((before, after)) = page.split_once(&begin(name)) else {
            continue;
        };
        let Some((_, after)) = after.split_once(END) else {
            continue;
        };
        found.insert(name);
        let mut table = String::new();
        for (i, row) in rows.iter().enumerate() {
            table += &format!("| {} |\n", row.join(" | ")).replace("|  |", "| |");
            if i == 0 {
                table += &format!("|{}\n", "---|".repeat(row.len()));
            }
        }
        page = format!("{before}{}{table}{END}{after}", begin(name));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "a\n<!-- sizes -->\n| of | b |\n|---|---|\n| c | 1,234 |\n<!-- end -->\nd\n";

    fn sizes(bytes: u64) -> Table {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        Table {
            name: "sizes",
            rows: vec![row(["of", "b"]), row(["c", &number(bytes)])],
        }
    }

    #[test]
    fn only_the_table_is_made_anew() {
        let mut found = BTreeSet::new();
        assert_eq!(made_anew(PAGE, &[sizes(1234)], &mut found), PAGE);
        assert_eq!(
            made_anew(PAGE, &[sizes(56)], &mut found),
            PAGE.replace("1,234", "56")
        );
        assert_eq!(found, BTreeSet::from(["sizes"]));
        found.clear();
        let other = PAGE.replace("sizes", "other");
        assert_eq!(made_anew(&other, &[sizes(56)], &mut found), other);
        assert!(found.is_empty());
    }

    #[test]
    fn figures_are_found_by_their_row() {
        assert_eq!(figure_in(PAGE, "sizes", "c"), Some(1234));
        assert_eq!(figure_in(PAGE, "sizes", "d"), None);
        assert_eq!(figure_in(PAGE, "other", "c"), None);
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
