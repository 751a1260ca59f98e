//! A driver, a camera, and a UART between them.

use std::collections::VecDeque;

use cmucam2_driver::session::{Answer, Fault, Policy, Request, Session};

use cmucam2_emulator::{Emulator, Time};

const MICROSECOND: Time = 1_000;
/// Start bit, eight data bits, stop bit.
const BITS: u64 = 10;
const SECOND: Time = 1_000_000_000;

/// A [`Session`] and an [`Emulator`], and a UART between them whose receive buffer holds
/// everything. Time passes only while something is asked, or in [`Link::pass`].
#[derive(Clone, Debug)]
pub struct Link {
    /// The driver's end.
    pub session: Session,
    /// The camera.
    pub camera: Emulator,
    now: Time,
    /// From the host to the camera, with the time at which each byte is over.
    outgoing: VecDeque<(Time, u8)>,
    byte_time: Time,
    /// Time when the host's last byte came.
    heard_at: Time,
}

impl Link {
    /// Both ends at this baud rate.
    pub fn new(camera: Emulator, policy: Policy, host_baud: u32) -> Self {
        Self {
            session: Session::new(policy),
            camera,
            now: 0,
            outgoing: VecDeque::new(),
            byte_time: BITS * SECOND / u64::from(host_baud.max(1)),
            heard_at: 0,
        }
    }

    /// Nanoseconds since the camera was made.
    pub fn now(&self) -> Time {
        self.now
    }

    /// Time when the last byte that the host looked at came.
    pub fn heard_at(&self) -> Time {
        self.heard_at
    }

    /// Lets time pass without looking at bytes that come.
    pub fn pass(&mut self, time: Time) {
        self.now += time;
        self.camera.advance(self.now);
    }

    /// Asks for something that needs neither a row buffer nor raw bytes.
    ///
    /// # Errors
    /// The driver's.
    pub fn ask(&mut self, request: Request) -> Result<Answer, Fault> {
        self.ask_with(request, &mut [], &[])
    }

    /// Asks for something. `row` receives a row of [`Request::NextPart`]; `payload` are the raw
    /// bytes of an upload.
    ///
    /// # Errors
    /// The driver's.
    pub fn ask_with(
        &mut self,
        request: Request,
        row: &mut [u8],
        payload: &[u8],
    ) -> Result<Answer, Fault> {
        self.session.begin(request, self.now / MICROSECOND);
        loop {
            self.send(payload);
            if let Some(outcome) = self.session.outcome() {
                return outcome;
            }
            // Bytes that wait for the host come first, then the next event.
            if let Some((at, byte)) = self.camera.transmit(self.now) {
                self.heard_at = at;
                self.session.receive(byte, self.now / MICROSECOND, row);
                continue;
            }
            let sent = self.outgoing.front().map(|&(at, _)| at);
            let deadline = self.session.deadline().map(|at| at * MICROSECOND);
            let next = [sent, self.camera.next_deadline(), deadline];
            if let Some(next) = next.into_iter().flatten().min() {
                self.now = self.now.max(next);
            }
            while let Some((at, byte)) = self.outgoing.pop_front_if(|(at, _)| *at <= self.now) {
                self.camera.receive(byte, at);
            }
            // Bytes that the camera has sent by now come before the deadline.
            if self.camera.next_deadline().is_none_or(|at| at > self.now) {
                self.session.tick(self.now / MICROSECOND);
            }
        }
    }

    fn send(&mut self, payload: &[u8]) {
        let pending = self.session.pending().to_vec();
        self.session.sent(pending.len());
        self.put(&pending);
        if self.session.payload_due() {
            self.put(payload);
            self.session.payload_sent(self.now / MICROSECOND);
        }
    }

    fn put(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let free_at = self.outgoing.back().map_or(self.now, |&(at, _)| at);
            self.outgoing.push_back((free_at + self.byte_time, byte));
        }
    }
}

#[cfg(test)]
mod tests {
    use cmucam2_driver::session::StartUp;
    use cmucam2_emulator::{Configuration, Scene};

    use super::*;

    fn link(host_baud: u32) -> Link {
        let camera = Emulator::new(Configuration::default(), Scene::default());
        let mut link = Link::new(camera, Policy::default(), host_baud);
        link.pass(2 * SECOND);
        link
    }

    #[test]
    fn a_driver_starts_the_camera_up() {
        let camera_baud = Configuration::default().host_baud;
        let mut same = link(camera_baud);
        let answer = same.ask(Request::StartUp(StartUp::default()));
        assert!(answer.is_ok(), "{answer:?}");
        assert!(same.heard_at() > 2 * SECOND && same.heard_at() <= same.now());
    }

    #[test]
    fn a_byte_takes_ten_bits() {
        let mut link = link(9600);
        link.put(&[1, 2]);
        let times: Vec<Time> = link.outgoing.iter().map(|(at, _)| at - link.now).collect();
        assert_eq!(times, [1_041_666, 2_083_332]);
    }
}
