//! A device on a UART, as a test says.

use std::collections::VecDeque;

use virtual_hardware::{executor::Time, line::Device};

/// Start bit, eight data bits, stop bit.
const BITS: u64 = 10;
const SECOND: u64 = 1_000_000_000;

/// A device that answers lines of text: to each line that ends with a carriage return, a text after some time.
///
/// # Example
/// ```
/// use node_test::{Script, virtual_hardware::line::Device};
///
/// let mut thermometer = Script::new(9600, |line| match line {
///     "T?" => (1_000_000, "21.5\r".to_owned()),
///     _ => (0, "ERROR\r".to_owned()),
/// });
/// for byte in *b"T?\r" {
///     thermometer.receive(byte, 0);
/// }
/// // A millisecond to think, and the time of a byte.
/// assert_eq!(thermometer.transmit(2_000_000), None);
/// assert_eq!(thermometer.transmit(2_100_000), Some((2_041_666, b'2')));
/// ```
pub struct Script<A> {
    answer: A,
    line: String,
    byte_time: Time,
    /// Bytes on their way, with the times at which they are over.
    sending: VecDeque<(Time, u8)>,
}

impl<A: FnMut(&str) -> (Time, String) + 'static> Script<A> {
    /// A device of this rate. `answer` gets a line without its carriage return, and returns the nanoseconds until it
    /// answers, and the text.
    pub fn new(baud: u32, answer: A) -> Self {
        Self {
            answer,
            line: String::new(),
            byte_time: BITS * SECOND / u64::from(baud.max(1)),
            sending: VecDeque::new(),
        }
    }
}

impl<A: FnMut(&str) -> (Time, String) + 'static> Device for Script<A> {
    fn power_up(&mut self, _: Time) {
        self.line.clear();
        self.sending.clear();
    }

    fn next_action(&self) -> Option<Time> {
        None
    }

    fn act(&mut self, _: Time) {}

    fn receive(&mut self, byte: u8, at: Time) {
        if byte != b'\r' {
            self.line.push(byte.into());
            return;
        }
        let (after, text) = (self.answer)(&self.line);
        self.line.clear();
        let busy = self.sending.back().map_or(0, |&(end, _)| end);
        let mut end = busy.max(at + after);
        for byte in text.bytes() {
            end += self.byte_time;
            self.sending.push_back((end, byte));
        }
    }

    fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.sending.pop_front_if(|(end, _)| *end <= now)
    }

    fn next_burst(&self, room: usize) -> Option<Time> {
        let last = self.sending.len().checked_sub(1)?;
        let place = room.saturating_sub(1).min(last);
        self.sending.get(place).map(|&(end, _)| end)
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_example_of_the_readme_is_the_program() {
        let (readme, program) = (
            include_str!("../README.md"),
            include_str!("../examples/camera_node.rs"),
        );
        let (_, code) = program.split_once('\n').unwrap();
        assert!(readme.contains(code), "copy it");
        assert!(
            program.lines().count() <= 40 + 1,
            "a page of 40 lines, and its title"
        );
    }
}
