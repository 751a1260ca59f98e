//! `docs/site.md` is complete, and its examples work.

use std::collections::BTreeSet;

use site::{
    Overrides, Scenario,
    keys::{KEYS, Kind, markdown},
};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/site.md");

fn page() -> String {
    std::fs::read_to_string(PAGE).unwrap()
}

/// The page with the tables that the list of keys makes: that of a table's keys, or one of each table in it.
fn made_anew(page: &str, tables: &mut BTreeSet<String>) -> String {
    let mut made = String::new();
    let mut is_table = false;
    for line in page.lines() {
        is_table &= line != "<!-- end -->";
        if is_table {
            continue;
        }
        made += line;
        made.push('\n');
        if let Some(table) = line.strip_prefix("<!-- keys: ") {
            let table = table.trim_end_matches(" -->").trim().to_owned();
            made += &markdown(&table);
            assert!(tables.insert(table), "{line} is there twice");
            is_table = true;
        }
        if let Some(table) = line.strip_prefix("<!-- keys in: ") {
            let prefix = format!("{}.", table.trim_end_matches(" -->").trim());
            for key in KEYS {
                let name = key.path.strip_prefix(&prefix);
                if let Some(name) = name.filter(|name| !name.contains('.')) {
                    made += &format!("`{name}`:\n\n{}\n", markdown(key.path));
                    tables.insert(key.path.to_owned());
                }
            }
            is_table = true;
        }
    }
    made
}

/// `UPDATE=1 cargo test -p site --test docs` writes the tables.
#[test]
fn every_key_is_documented() {
    let page = page();
    let mut tables = BTreeSet::new();
    let made = made_anew(&page, &mut tables);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(PAGE, &made).unwrap();
    } else {
        assert_eq!(made, page, "run this test with UPDATE=1");
    }
    for key in KEYS {
        let table = key.path.rsplit_once('.').map_or("", |(table, _)| table);
        assert!(tables.contains(table), "{} is not on the page", key.path);
    }
}

/// A key that the list does not have is refused, so that it would be no key; and every key that it has is one:
/// none of them is refused as unknown by what reads the file.
#[test]
fn the_list_has_the_keys_that_files_have() {
    // A file that has every key.
    let text = include_str!("every_key.toml");
    let scenario = Scenario::from_toml(text, &Overrides::default()).unwrap();
    scenario.put_up().unwrap();
    let missing: Vec<_> = KEYS
        .iter()
        .filter(|key| !key.path.starts_with("grid"))
        .map(|key| key.path.rsplit_once('.').map_or(key.path, |(_, name)| name))
        .map(|name| name.trim_end_matches("[]"))
        .filter(|name| !text.contains(name))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
    // All that the reader would write is in the list.
    for text in [
        text,
        "name = \"x\"\nseed = 3\n[grid]\nnodes = 4\n",
        "name = \"x\"\n[grid]\nnodes = 6\ncell_nodes = 3\none_frame = true\n",
    ] {
        let scenario = Scenario::from_toml(text, &Overrides::default()).unwrap();
        let written = toml::to_string(&scenario).unwrap();
        Scenario::from_toml(&written, &Overrides::default()).unwrap();
    }
}

/// A key that is the same as another one is as that one.
#[test]
fn every_key_that_is_referred_to_is_there() {
    for key in KEYS {
        if let Kind::Same(other) = key.kind {
            assert!(KEYS.iter().any(|key| key.path == other), "{other}");
        }
    }
    let paths: BTreeSet<_> = KEYS.iter().map(|key| key.path).collect();
    assert_eq!(paths.len(), KEYS.len());
}

#[test]
fn pages_tell_how_many_nodes_a_network_has() {
    let page = include_str!("../../../../docs/hardware.md");
    let most = node_firmware::limits::MEMBERS;
    let told = format!("at most {most} other nodes");
    assert!(page.contains(&told), "{told}");
}

#[test]
fn examples_work() {
    let page = page();
    let blocks: Vec<_> = page
        .split("```toml\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert!(blocks.len() >= 5, "{}", blocks.len());
    for text in blocks {
        let scenario = Scenario::from_toml(text, &Overrides::default())
            .unwrap_or_else(|error| panic!("{error}\n{text}"));
        let key = node_firmware::config::SiteKey::new(1, *b"0123456789abcdef");
        site::configs(&scenario, key).unwrap_or_else(|error| panic!("{error}\n{text}"));
        // Where all cameras have their places, it can be rehearsed.
        let mut cameras = scenario.networks.iter().flat_map(|n| &n.cameras);
        if cameras.all(|camera| camera.heading_deg.is_some()) {
            scenario
                .put_up()
                .unwrap_or_else(|error| panic!("{error}\n{text}"));
        }
    }
}
