//! Every target over its corpus, and over inputs mutated from it: the same ones in every run. By day these are a
//! quarter of those of the night.

use std::{
    fs,
    panic::{self, AssertUnwindSafe},
    path::Path,
};

use fuzz::{TARGETS, target};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use test_support::amount;

/// Bytes at which parsers branch.
const REMARKABLE: [u8; 12] = [
    0, 1, 0x0A, 0x0D, 0x20, 0x7E, 0x7F, 0x80, 0xAE, 0xC1, 0xFE, 0xFF,
];

/// Edits of one input.
const EDITS: usize = 6;

/// Longest run of bytes that one edit copies or removes.
const RUN: usize = 16;

/// Inputs in the corpus of a target, in the order of their names.
fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("corpus")
        .join(name);
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

/// Changes an input in one place.
fn edit(input: &mut Vec<u8>, seeds: &[Vec<u8>], random: &mut ChaCha8Rng) {
    let place = random.random_range(0..=input.len());
    let run = random.random_range(1..=RUN);
    let end = (place + run).min(input.len());
    match random.random_range(0..7) {
        0 => input.truncate(place),
        1 => drop(input.drain(place..end)),
        2 => input.extend_from_within(place..end),
        3 => input.insert(place, random.random()),
        4 => {
            let seed = &seeds[random.random_range(0..seeds.len())];
            let from = random.random_range(0..=seed.len());
            input.splice(place..end, seed[from..].iter().take(run).copied());
        }
        other => {
            if let Some(byte) = input.get_mut(place) {
                *byte = match other {
                    5 => *byte ^ (1 << random.random_range(0..8)),
                    _ => REMARKABLE[random.random_range(0..REMARKABLE.len())],
                };
            }
        }
    }
}

/// Tries the corpus and, at night, so many mutated inputs.
fn try_inputs(name: &str, mutated: u64) {
    let target = target(name).unwrap();
    let run = |input: &[u8]| {
        if panic::catch_unwind(AssertUnwindSafe(|| (target.run)(input))).is_err() {
            panic!("{name} fails for {input:?}");
        }
    };
    let mut seeds = corpus(name);
    seeds.iter().for_each(|seed| run(seed));
    seeds.push(Vec::new());
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..amount(mutated / 4, mutated) {
        let mut input = seeds[random.random_range(0..seeds.len())].clone();
        for _ in 0..random.random_range(1..=EDITS) {
            edit(&mut input, &seeds, &mut random);
        }
        run(&input);
    }
}

macro_rules! targets {
    ($($name:ident: $mutated:literal,)*) => {
        $(#[test]
        fn $name() {
            try_inputs(stringify!($name), $mutated);
        })*

        #[test]
        fn every_target_is_tried() {
            let tried = [$(stringify!($name)),*];
            for target in TARGETS {
                assert!(tried.contains(&target.name), "{}", target.name);
            }
        }
    };
}

targets! {
    answers_files: 100_000,
    cmucam2_parser: 500_000,
    cmucam2_session: 500_000,
    config_page: 500_000,
    console_line: 100_000,
    flash_log_open: 50_000,
    inertial_session: 200_000,
    link_node: 200_000,
    link_security: 200_000,
    link_spinel: 200_000,
    link_wire: 500_000,
    node_roles: 200_000,
    pixy_session: 500_000,
    pixy_stream: 500_000,
    radio_update: 200_000,
    site_file: 50_000,
}

/// Edits change any byte of an input.
#[test]
fn edits_reach_every_byte() {
    let seeds = [b"0123456789".to_vec()];
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut changed = [false; 10];
    for _ in 0..1_000 {
        let mut input = seeds[0].clone();
        edit(&mut input, &seeds, &mut random);
        for (changed, (now, before)) in changed.iter_mut().zip(input.iter().zip(&seeds[0])) {
            *changed |= now != before;
        }
    }
    assert_eq!(changed, [true; 10]);
}
