//! A UART: the bytes that it sends and those that it has received.

use std::{collections::VecDeque, task::Waker};

use super::{Counts, Uart};
use crate::executor::Time;

/// Start bit, eight data bits, stop bit.
const BITS: u64 = 10;
const SECOND: Time = 1_000_000_000;

/// A task that waits to write.
pub(super) struct Writer {
    /// Number of bytes still to be sent at which it goes on.
    pub(super) until: usize,
    pub(super) waker: Waker,
}

/// A task that waits to read.
pub(super) struct Reader {
    /// Most bytes that it reads at once.
    pub(super) most: usize,
    pub(super) waker: Waker,
}

pub(super) struct End {
    pub(super) uart: Uart,
    byte_time: Time,
    is_open: bool,
    pub(super) received: VecDeque<u8>,
    /// On their way, with the times at which they are over.
    sending: VecDeque<(Time, u8)>,
    free_at: Time,
    pub(super) reader: Option<Reader>,
    pub(super) writer: Option<Writer>,
    pub(super) counts: Counts,
}

impl End {
    pub(super) fn new(uart: Uart) -> Self {
        Self {
            uart,
            byte_time: BITS * (SECOND / u64::from(uart.baud.max(1))),
            is_open: false,
            received: VecDeque::new(),
            sending: VecDeque::new(),
            free_at: 0,
            reader: None,
            writer: None,
            counts: Counts::default(),
        }
    }

    pub(super) fn open(&mut self, now: Time) {
        self.close(now);
        self.is_open = true;
    }

    /// Closes the end. Bytes that have not begun are never sent.
    pub(super) fn close(&mut self, now: Time) {
        self.is_open = false;
        self.received.clear();
        let byte_time = self.byte_time;
        self.sending.retain(|(end, _)| end - byte_time < now);
        self.free_at = self.sending.back().map_or(now, |(end, _)| *end);
        self.reader = None;
        self.writer = None;
    }

    /// Takes as many bytes as there is room for.
    pub(super) fn send(&mut self, now: Time, bytes: &[u8]) -> usize {
        let room = self.uart.transmit_buffer.saturating_sub(self.sending.len());
        let taken = room.min(bytes.len());
        for &byte in &bytes[..taken] {
            self.free_at = self.free_at.max(now) + self.byte_time;
            self.sending.push_back((self.free_at, byte));
        }
        self.counts.sent += taken as u64;
        taken
    }

    /// Bytes still to be sent.
    pub(super) fn unsent(&self) -> usize {
        self.sending.len()
    }

    /// A byte that was over at a time that has come.
    pub(super) fn next_sent(&mut self, now: Time) -> Option<(Time, u8)> {
        self.sending.pop_front_if(|(at, _)| *at <= now)
    }

    pub(super) fn next_sent_at(&self) -> Option<Time> {
        self.sending.front().map(|(at, _)| *at)
    }

    /// Time when the first carriage return that is under way is over, or else everything.
    pub(super) fn line_at(&self) -> Option<Time> {
        let line = self.sending.iter().find(|(_, byte)| *byte == b'\r');
        line.or(self.sending.back()).map(|(at, _)| *at)
    }

    /// Time when so many bytes are over, or all that are under way.
    pub(super) fn burst(&self, count: usize) -> Option<Time> {
        let last = self.sending.len().checked_sub(1)?;
        let place = count.saturating_sub(1).min(last);
        self.sending.get(place).map(|(at, _)| *at)
    }

    /// Time when the task that waits to write can go on.
    pub(super) fn sent_at(&self) -> Option<Time> {
        let writer = self.writer.as_ref()?;
        let surplus = self.sending.len().checked_sub(writer.until)?;
        self.burst(surplus)
    }

    /// Bytes that this end has sent come to another one.
    pub(super) fn deliver(&mut self, now: Time, to: &mut Self, is_plugged: bool) {
        while let Some((_, byte)) = self.next_sent(now) {
            if is_plugged {
                to.receive(byte);
            }
        }
    }

    pub(super) fn receive(&mut self, byte: u8) {
        self.counts.received += 1;
        if !self.is_open {
            self.counts.unheard += 1;
        } else if self.received.len() < self.uart.receive_buffer {
            self.received.push_back(byte);
        } else {
            self.counts.overrun += 1;
        }
    }

    pub(super) fn is_waiting(&self) -> bool {
        self.reader.is_some()
    }

    /// Most bytes that the reader waits for.
    pub(super) fn room(&self) -> usize {
        let most = self
            .reader
            .as_ref()
            .map_or(usize::MAX, |reader| reader.most);
        most.min(self.uart.receive_buffer).max(1)
    }

    pub(super) fn wake(&mut self) {
        if !self.received.is_empty()
            && let Some(reader) = self.reader.take()
        {
            reader.waker.wake();
        }
        let unsent = self.sending.len();
        if let Some(writer) = self.writer.take_if(|writer| unsent <= writer.until) {
            writer.waker.wake();
        }
    }
}
