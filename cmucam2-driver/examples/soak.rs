//! Feeds the parser with random and damaged streams, as many as asked for.
//!
//! `cargo run --release -p cmucam2-driver --example soak -- [RANDOM] [DAMAGED] [SEED]`

#[path = "../tests/it/random.rs"]
mod random;
#[path = "../tests/it/soak.rs"]
mod soak;
#[path = "../tests/it/stream.rs"]
mod stream;

use std::time::Instant;

fn main() {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|text| text.parse().expect("arguments are whole numbers"));
    let random = arguments.next().unwrap_or(10_000_000);
    let damaged = arguments.next().unwrap_or(1_000_000);
    let seed = arguments.next().unwrap_or(1);

    let begin = Instant::now();
    let bytes = soak::random_streams(random, seed);
    println!(
        "{random} random streams, {bytes} bytes, {:.1} s: resynchronised after each",
        begin.elapsed().as_secs_f64()
    );
    for strict in [false, true] {
        let begin = Instant::now();
        let (delivered, undetectable) = soak::damaged_streams(damaged, seed, strict);
        println!(
            "{damaged} streams with 20 % damaged lines{}, {:.1} s: {delivered} packets delivered, \
             {undetectable} of them ({:.2} %) changed beyond detection",
            if strict { ", strict" } else { "" },
            begin.elapsed().as_secs_f64(),
            100.0 * undetectable as f64 / delivered.max(1) as f64,
        );
    }
}
