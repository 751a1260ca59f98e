//! Runs any images for an nRF52840, which hear each other. Prints what each logs by defmt over RTT, and its
//! faults: `run SECONDS ELF... [--echo]`. `--echo` connects each one's lines of UARTE0.

use std::{collections::VecDeque, env, error::Error, fs};

use defmt_decoder::{DecodeError, Table};
use nrf52840_emulator::{Node, Outcome, peripheral::Peer, run};

const S: f64 = 1e9;
/// 40 dB above the least that is heard.
const LEVEL: u8 = 40;

/// A peer that sends back the bytes it receives.
#[derive(Debug, Default)]
struct Echo(VecDeque<(u64, u8)>);

impl Peer for Echo {
    fn receive(&mut self, byte: u8, at: u64) {
        self.0.push_back((at, byte));
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        let (at, _) = self.0.front()?;
        (*at <= now)
            .then(|| self.0.pop_front())
            .flatten()
            .map(|(_, byte)| byte)
    }

    fn next(&self) -> Option<u64> {
        self.0.front().map(|(at, _)| *at)
    }
}

/// Prints what was logged.
fn log(image: &str, outcome: &Outcome) -> Result<(), Box<dyn Error>> {
    let Some(table) = Table::parse(&fs::read(image)?)? else {
        return Ok(());
    };
    let mut decoder = table.new_stream_decoder();
    decoder.received(&outcome.log);
    loop {
        match decoder.decode() {
            Ok(frame) => println!("{}", frame.display(false)),
            Err(DecodeError::Malformed) => println!("(malformed)"),
            Err(DecodeError::UnexpectedEof) => return Ok(()),
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = env::args().skip(1).collect();
    let all = arguments.len();
    arguments.retain(|argument| argument != "--echo");
    let is_echo = arguments.len() < all;
    let [seconds, images @ ..] = arguments.as_slice() else {
        return Err("type `run SECONDS ELF... [--echo]`".into());
    };
    let seconds: f64 = seconds.parse()?;
    let node = |image: &String| Node {
        image: image.into(),
        peer: is_echo.then(|| Box::<Echo>::default() as Box<dyn Peer>),
        ..Node::default()
    };
    let nodes = images.iter().map(node).collect();
    let (outcomes, frames) = run(nodes, (seconds * S) as u64, |_, _| Some(LEVEL))?;
    for (image, outcome) in images.iter().zip(&outcomes) {
        println!("{image}");
        log(image, outcome)?;
        let line: Vec<u8> = outcome.line.iter().map(|&(_, byte)| byte).collect();
        println!("UARTE0: {:?}", String::from_utf8_lossy(&line));
        println!("forbidden or not modelled: {:?}", outcome.forbidden);
        println!("nothing is at: {:?}", outcome.unmapped);
        println!("restarts: {:?}", outcome.resets);
        let Outcome {
            overruns,
            instructions,
            received: [well, spoilt],
            ..
        } = outcome;
        println!(
            "frames received: {well}, spoilt: {spoilt}; overruns: {overruns}; instructions: {instructions}"
        );
    }
    for frame in &frames {
        println!("sent: {frame:?}");
    }
    Ok(())
}
