//! Runs any image for an nRF52840 and prints what it logs by defmt over RTT, and what was wrong with it:
//! `run ELF [SECONDS] [echo]`. `echo` connects the lines of UARTE0 to each other.

use std::{collections::VecDeque, env, error::Error, fs};

use defmt_decoder::{DecodeError, Table};
use nrf52840_emulator::{Node, peripheral::Peer, run};

const S: f64 = 1e9;

/// What is sent comes back.
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

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let image = arguments.next().ok_or("type `run ELF [SECONDS] [echo]`")?;
    let seconds = arguments
        .next()
        .map_or(Ok(10.0), |seconds| seconds.parse::<f64>())?;
    let peer = arguments
        .next()
        .map(|_| Box::<Echo>::default() as Box<dyn Peer>);
    let node = Node {
        image: image.clone().into(),
        peer,
        ..Node::default()
    };
    let (outcomes, frames) = run(vec![node], (seconds * S) as u64, |_, _| None)?;
    let bytes = fs::read(&image)?;
    for outcome in outcomes {
        if let Some(table) = Table::parse(&bytes)? {
            let mut decoder = table.new_stream_decoder();
            decoder.received(&outcome.log);
            loop {
                match decoder.decode() {
                    Ok(frame) => println!("{}", frame.display(false)),
                    Err(DecodeError::Malformed) => println!("(malformed)"),
                    Err(DecodeError::UnexpectedEof) => break,
                }
            }
        }
        let line: Vec<u8> = outcome.line.iter().map(|&(_, byte)| byte).collect();
        println!("UARTE0: {:?}", String::from_utf8_lossy(&line));
        for frame in &frames {
            println!("sent: {frame:?}");
        }
        println!("forbidden or not modelled: {:?}", outcome.forbidden);
        println!("nothing is at: {:?}", outcome.unmapped);
        println!("restarts: {:?}", outcome.resets);
        println!(
            "overruns: {}, instructions: {}",
            outcome.overruns, outcome.instructions
        );
    }
    Ok(())
}
