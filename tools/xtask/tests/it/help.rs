//! Help texts of the chores.

use crate::place::Place;

const CHORES: [&str; 10] = [
    "test", "bench", "campaign", "cortex-m", "size", "firmware", "peers", "fuzz", "scale", "help",
];

#[test]
fn without_a_chore_all_are_told() {
    let place = Place::new();
    let run = place.run(&[]);
    let told = run.stderr.clone();
    run.fails(2, "Usage: cargo xtask <COMMAND>");
    let help = place.run(&["--help"]).ok();
    for chore in CHORES {
        let line = format!("\n  {chore} ");
        assert!(told.contains(&line) && help.contains(&line), "{chore}");
    }
    let listed = help.lines().filter(|line| {
        line.strip_prefix("  ")
            .is_some_and(|line| line.starts_with(|c: char| c.is_ascii_lowercase()))
    });
    assert_eq!(listed.count(), CHORES.len());
}

#[test]
fn an_unknown_chore_is_refused() {
    let place = Place::new();
    place.run(&["firmwares"]).fails(2, "'firmware'");
    place.run(&["firmware", "--fast"]).fails(2, "--fast");
}

#[test]
fn every_chore_tells_what_it_is() {
    let place = Place::new();
    for chore in &CHORES[..9] {
        let help = place.run(&[chore, "--help"]).ok();
        let (first, usage) = help.split_once("\n\n").unwrap();
        assert!(first.len() > 20, "{chore}: {first}");
        assert!(
            usage.contains(&format!("Usage: cargo xtask {chore}")),
            "{help}"
        );
    }
}
