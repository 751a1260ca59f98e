//! An emulated camera at the end of a line that carries one byte after the other.

use std::{collections::VecDeque, iter};

use cmucam2_emulator::Time;

use super::{BYTE_BITS, SECOND};

/// An emulated camera, as a line sees it.
pub(super) trait OnLine: Send {
    /// A byte from the host whose stop bit is over at this time.
    fn receive(&mut self, byte: u8, at: Time);
    /// The next byte for the host that is complete by now.
    fn transmit(&mut self, now: Time) -> Option<u8>;
    /// Time at which something happens next without the host.
    fn next_deadline(&self) -> Option<Time>;
    /// The host changes its rate. False: nothing is understood at this one.
    fn set_host_baud(&mut self, baud: u32) -> bool;
}

impl OnLine for cmucam2_emulator::Emulator {
    fn receive(&mut self, byte: u8, at: Time) {
        self.receive(byte, at);
    }

    fn transmit(&mut self, now: Time) -> Option<u8> {
        self.transmit(now).map(|(_, byte)| byte)
    }

    fn next_deadline(&self) -> Option<Time> {
        self.next_deadline()
    }

    fn set_host_baud(&mut self, baud: u32) -> bool {
        self.set_host_baud(baud);
        true
    }
}

/// A camera of the Pixy family, and its rate.
pub(super) struct Pixy {
    emulator: pixy_emulator::Emulator,
    baud: u32,
    is_understood: bool,
}

impl Pixy {
    pub(super) const fn new(emulator: pixy_emulator::Emulator, baud: u32) -> Self {
        Self {
            emulator,
            baud,
            is_understood: true,
        }
    }

    pub(super) const fn emulator(&mut self) -> &mut pixy_emulator::Emulator {
        &mut self.emulator
    }
}

impl OnLine for Pixy {
    fn receive(&mut self, byte: u8, at: Time) {
        self.emulator.receive(byte, at);
    }

    fn transmit(&mut self, now: Time) -> Option<u8> {
        let (_, byte) = self.emulator.transmit(now)?;
        // Levels that are looked at in the middle of other bits.
        Some(if self.is_understood {
            byte
        } else {
            byte.rotate_left(3) ^ 0xE0
        })
    }

    fn next_deadline(&self) -> Option<Time> {
        self.emulator.next_deadline()
    }

    fn set_host_baud(&mut self, baud: u32) -> bool {
        // At another rate no request is one, and what is told is garbage.
        self.is_understood = baud == self.baud;
        self.is_understood
    }
}

/// A camera, and bytes that are on their way to it.
pub(super) struct Carried<C> {
    pub(super) camera: C,
    host_baud: u32,
    is_understood: bool,
    /// With the time at which the line has carried them.
    incoming: VecDeque<(Time, u8)>,
}

impl<C: OnLine> Carried<C> {
    /// Makes a line on which the host has the camera's rate.
    pub(super) fn new(camera: C, baud: u32) -> Self {
        Self {
            camera,
            host_baud: baud,
            is_understood: true,
            incoming: VecDeque::new(),
        }
    }

    pub(super) fn host_baud(&self) -> u32 {
        self.host_baud
    }

    pub(super) fn set_host_baud(&mut self, baud: u32) {
        self.host_baud = baud;
        self.is_understood = self.camera.set_host_baud(baud);
    }

    /// The host hands bytes to the line, all at once.
    pub(super) fn hear(&mut self, bytes: &[u8], now: Time) {
        let byte_time = BYTE_BITS * SECOND / Time::from(self.host_baud);
        for &byte in bytes.iter().filter(|_| self.is_understood) {
            self.incoming
                .push_back((self.busy_until(now) + byte_time, byte));
        }
    }

    /// Time at which the line has carried all that the host said.
    pub(super) fn busy_until(&self, now: Time) -> Time {
        self.incoming.back().map_or(now, |&(at, _)| at.max(now))
    }

    /// Time at which something happens next.
    pub(super) fn next(&self) -> Option<Time> {
        let arrival = self.incoming.front().map(|&(at, _)| at);
        arrival.into_iter().chain(self.camera.next_deadline()).min()
    }

    /// Goes on until now; returns the bytes that have come to the host.
    pub(super) fn advance(&mut self, now: Time) -> Vec<u8> {
        while let Some((at, byte)) = self.incoming.pop_front_if(|(at, _)| *at <= now) {
            self.camera.receive(byte, at);
        }
        iter::from_fn(|| self.camera.transmit(now)).collect()
    }
}
