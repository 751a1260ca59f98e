//! Bytes that public programs send and wait for, replayed at the default switches.
//!
//! Each file in `clients` has the steps of one program, a step a line; `\r`, `\n` and `\xNN` stand for bytes:
//!
//! | step | |
//! |---|---|
//! | `baud N` | the rate of both ends |
//! | `send BYTES` | one byte after the other, as fast as the line goes |
//! | `pause MS` | time passes, and the bytes that come are kept |
//! | `wait BYTES` | all bytes are dropped up to and with these |
//! | `skip` | all bytes that have come are dropped |
//! | `expect BYTES` | exactly these bytes have come |
//! | `expect-next BYTES` | these come next |
//! | `bytes HEX...`, `bytes-any N` | these, or so many, come next |
//! | `packet L N`, `line N` | a text packet of letter and numbers comes next, or its numbers only |
//! | `raw-packet L N` | a raw packet comes next, after anything that is not 255 |
//! | `frame W H C` | a frame of one or three channels, a mark after each row |
//! | `rows N LEN HEX` | so many rows, each with its mark |
//! | `retry MS BYTES LINE` | the line is sent until the bytes come within this time |

use std::collections::VecDeque;

use cmucam2_emulator::Emulator;

use crate::support::{MILLISECOND, SECOND, orange_box, with};

/// The longest time that a program waits for a byte.
const PATIENCE: u64 = 10 * SECOND;

struct Client {
    camera: Emulator,
    now: u64,
    byte_time: u64,
    heard: VecDeque<u8>,
}

pub(crate) fn bytes(text: &str) -> Vec<u8> {
    let mut out = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'\\' {
            out.push(byte);
            continue;
        }
        match rest.next() {
            Some(b'r') => out.push(b'\r'),
            Some(b'n') => out.push(b'\n'),
            Some(b'x') => {
                let digits: String = rest.by_ref().take(2).map(char::from).collect();
                out.push(u8::from_str_radix(&digits, 16).unwrap());
            }
            other => panic!("\\{other:?} in {text}"),
        }
    }
    out
}

impl Client {
    /// At a camera that was switched on a while ago, and has received nothing since.
    fn new(baud: u32) -> Self {
        let configuration = with(|it| {
            it.baud = baud;
            it.host_baud = baud;
        });
        let mut client = Self {
            camera: Emulator::new(configuration, orange_box([30, 49], [40, 79])),
            now: 0,
            byte_time: 10 * SECOND / u64::from(baud),
            heard: VecDeque::new(),
        };
        client.pass(2 * SECOND);
        client.heard.clear();
        client
    }

    fn pass(&mut self, time: u64) {
        self.now += time;
        while let Some((_, byte)) = self.camera.transmit(self.now) {
            self.heard.push_back(byte);
        }
    }

    fn send(&mut self, line: &[u8]) {
        for &byte in line {
            self.pass(self.byte_time);
            self.camera.receive(byte, self.now);
        }
    }

    fn next(&mut self) -> Result<u8, String> {
        let limit = self.now + PATIENCE;
        while self.heard.is_empty() {
            match self.camera.next_deadline() {
                Some(at) if at <= limit => self.pass(at.saturating_sub(self.now)),
                _ => return Err("the camera is silent".to_owned()),
            }
        }
        Ok(self.heard.pop_front().unwrap())
    }

    fn expect_next(&mut self, expected: &[u8]) -> Result<(), String> {
        for &byte in expected {
            let found = self.next()?;
            if found != byte {
                return Err(format!("{found:#04x} instead of {byte:#04x}"));
            }
        }
        Ok(())
    }

    fn wait(&mut self, expected: &[u8]) -> Result<(), String> {
        let mut window = VecDeque::new();
        let limit = self.now + PATIENCE;
        while window != expected {
            if self.now > limit {
                return Err("that never comes".to_owned());
            }
            if window.len() == expected.len() {
                window.pop_front();
            }
            window.push_back(self.next()?);
        }
        Ok(())
    }

    fn numbers(&mut self, count: usize) -> Result<(), String> {
        let mut line = Vec::new();
        loop {
            match self.next()? {
                b'\r' => break,
                byte => line.push(byte),
            }
        }
        let text = String::from_utf8_lossy(&line).into_owned();
        let numbers = text.split(' ').filter(|word| !word.is_empty());
        let numbers: Vec<_> = numbers.map(str::parse::<u8>).collect();
        if numbers.len() == count && numbers.iter().all(Result::is_ok) {
            Ok(())
        } else {
            Err(format!("{text:?} is no {count} numbers"))
        }
    }

    fn rows(&mut self, rows: usize, length: usize, mark: u8) -> Result<(), String> {
        for row in 0..rows {
            for _ in 0..length {
                let level = self.next()?;
                if !(16..=240).contains(&level) {
                    return Err(format!("{level} is no level in row {row}"));
                }
            }
            self.expect_next(&[mark])?;
        }
        Ok(())
    }

    fn step(&mut self, line: &str) -> Result<(), String> {
        let (verb, rest) = line.split_once(' ').unwrap_or((line, ""));
        let words: Vec<&str> = rest.split(' ').collect();
        let number = |place: usize| words[place].parse::<usize>().unwrap();
        match verb {
            "send" => self.send(&bytes(rest)),
            "pause" => self.pass(number(0) as u64 * MILLISECOND),
            "skip" => self.heard.clear(),
            "wait" => self.wait(&bytes(rest))?,
            "expect" => {
                let expected = bytes(rest);
                let heard: Vec<u8> = self.heard.drain(..).collect();
                // A prompt may still be on its way.
                if heard.is_empty() {
                    return self.expect_next(&expected);
                }
                if heard != expected {
                    return Err(format!("\"{}\" came", heard.escape_ascii()));
                }
            }
            "expect-next" => self.expect_next(&bytes(rest))?,
            "bytes" => {
                let hex = |word: &&str| u8::from_str_radix(word, 16).unwrap();
                self.expect_next(&words.iter().map(hex).collect::<Vec<_>>())?;
            }
            "bytes-any" => {
                for _ in 0..number(0) {
                    self.next()?;
                }
            }
            "packet" => {
                self.expect_next(words[0].as_bytes())?;
                self.numbers(number(1))?;
            }
            "line" => self.numbers(number(0))?,
            "raw-packet" => {
                self.wait(&[0xFF])?;
                self.expect_next(words[0].as_bytes())?;
                for _ in 0..number(1) {
                    if self.next()? == 0xFF {
                        return Err("255 within a packet".to_owned());
                    }
                }
            }
            "frame" => {
                let (width, height) = (number(0), number(1));
                self.expect_next(&[1, width as u8, height as u8])?;
                self.rows(height, width * number(2), 2)?;
                self.expect_next(&[3])?;
            }
            "rows" => {
                let mark = u8::from_str_radix(words[2], 16).unwrap();
                self.rows(number(0), number(1), mark)?;
            }
            "retry" => {
                let [time, wanted, line] = rest.splitn(3, ' ').collect::<Vec<_>>()[..] else {
                    panic!("{rest}");
                };
                let time = time.parse::<u64>().unwrap() * MILLISECOND;
                let tries = 60;
                for _ in 0..tries {
                    self.heard.clear();
                    self.send(&bytes(line));
                    self.pass(time);
                    if bytes(wanted).iter().all(|byte| self.heard.contains(byte)) {
                        return Ok(());
                    }
                }
                return Err(format!("not once in {tries}"));
            }
            _ => panic!("{line}: no such step"),
        }
        Ok(())
    }
}

fn replay(file: &str) {
    let mut steps = (1..)
        .zip(file.lines())
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (_, baud) = steps.next().unwrap();
    let mut client = Client::new(baud.strip_prefix("baud ").unwrap().parse().unwrap());
    for (number, step) in steps {
        if let Err(why) = client.step(step) {
            panic!("line {number}, {step}: {why}");
        }
    }
}

macro_rules! clients {
    ($($name:ident),*) => {
        $(#[test]
        fn $name() {
            replay(include_str!(concat!("clients/", stringify!($name), ".txt")));
        })*
    };
}

clients!(frc, player, arduino, python, robot, window, desktop);
