//! A Pixy2 that any program can talk to over its UART.
//!
//! [`Emulator`] is the camera at the level of bytes, as [`cmucam2_emulator::Emulator`] is a CMUcam2. It has no
//! clock and no thread: bytes sent to it go in with their times, and its own bytes come out with the times at
//! which their stop bits are over. It sees the same [`Scene`]s, and shares no code with a driver. Facts are those
//! of the maker's firmware (`charmedlabs/pixy2`).
//!
//! | module | job |
//! |---|---|
//! | here | Power, frames and answers |
//! | [`wire`] | Packets, and bytes with their times |
//! | [`sight`] | Units of a frame that have a signature's colour, and the blobs of these |
//!
//! # Decided here
//! - It needs two seconds to start, and says nothing before. Then it says that it is busy until its
//!   first frame.
//! - A frame is seen when its blobs are first asked for. Blobs are not followed from frame to frame: one
//!   that comes into view is told at once, and not only after 48 ms.
//! - A signature is a range of chromaticity around the colour that was taught, [`TOLERANCE`] to both
//!   sides. White balance is set by the light in which it starts, and stays; exposure follows the light.
//! - Changing the program, servos and `getRGB` are not there: "unsupported".

pub mod sight;
pub mod wire;

use cmucam2_emulator::{Rgb, Scene};

use self::{
    sight::{Found, Seen},
    wire::{Request, Wire},
};

pub use sight::TOLERANCE;

/// Nanoseconds, as of the other emulator.
pub type Time = cmucam2_emulator::Time;

const SECOND: Time = 1_000_000_000;
/// Time from power-up to the first answer.
const START: Time = 2 * SECOND;
/// 60 frames a second.
const FRAME: Time = SECOND / 60;
/// Time from a request to its answer.
const THINKS: Time = 100_000;

/// Columns and rows in which blobs are told.
pub const FRAME_SIZE: [u16; 2] = [316, 208];

/// Signatures there are.
pub const SIGNATURES: usize = 7;

/// Set-up of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    /// The rate that is set in `PixyMon`, bits per second. As it is shipped: 19,200.
    pub baud: u32,
    /// The colours that it was taught, signature 1 first, [`SIGNATURES`] at most.
    pub signatures: Vec<Rgb>,
    /// Probability that one byte of an answer is another.
    pub corrupt_line: f64,
    /// Seed of noise and faults.
    pub seed: u64,
}

impl Default for Configuration {
    /// As it is shipped, and taught an orange ball.
    fn default() -> Self {
        Self {
            baud: 19_200,
            signatures: vec![[230, 105, 35]],
            corrupt_line: 0.0,
            seed: 0,
        }
    }
}

const ERROR: u8 = 0x03;
const BUSY: i8 = -2;
const INVALID: i8 = -3;
const UNSUPPORTED: i8 = -4;

/// The camera.
#[derive(Clone, Debug)]
pub struct Emulator {
    configuration: Configuration,
    scene: Scene,
    wire: Wire,
    sight: sight::Sight,
    powered: Time,
    /// The last frame whose blobs were told.
    told: Option<u64>,
    /// Number of frames in a row in which each signature was seen.
    ages: [u8; SIGNATURES],
}

impl Emulator {
    /// Switched on at time 0.
    pub fn new(configuration: Configuration, scene: Scene) -> Self {
        Self {
            wire: Wire::new(
                configuration.baud,
                configuration.corrupt_line,
                configuration.seed,
            ),
            sight: sight::Sight::new(&configuration.signatures, configuration.seed),
            configuration,
            scene,
            powered: 0,
            told: None,
            ages: [0; SIGNATURES],
        }
    }

    /// Scene before it. To be changed at any time.
    pub fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// Its power fails and comes back. Its taught colours stay.
    pub fn power_cycle(&mut self, now: Time) {
        let seed = self.configuration.seed ^ now;
        let Configuration {
            baud, corrupt_line, ..
        } = self.configuration;
        self.wire = Wire::new(baud, corrupt_line, seed);
        self.sight = sight::Sight::new(&self.configuration.signatures, seed);
        (self.powered, self.told) = (now, None);
        self.ages = [0; SIGNATURES];
    }

    /// Sets the probability that one byte of an answer is another, from now on.
    pub fn set_corrupt_line(&mut self, rate: f64) {
        self.configuration.corrupt_line = rate;
        self.wire.set_corrupt_line(rate);
    }

    /// A byte that the host sent, at the time of its stop bit.
    pub fn receive(&mut self, byte: u8, at: Time) {
        let is_started = at >= self.powered + START;
        let Some(request) = self.wire.receive(byte).filter(|_| is_started) else {
            return;
        };
        let (kind, payload) = self.answer(&request, at);
        self.wire.send(at + THINKS, kind, &payload);
    }

    fn answer(&mut self, request: &Request, at: Time) -> (u8, Vec<u8>) {
        let error = |why: i8| (ERROR, why.to_le_bytes().to_vec());
        let number = |number: i32| (0x01, number.to_le_bytes().to_vec());
        match (request.kind, &request.payload[..]) {
            (0x0E, _) => {
                let mut version = vec![0x00, 0x22, 3, 0, 11, 0];
                version.extend(b"general\0\0\0");
                (0x0F, version)
            }
            (0x0C, [_]) => {
                let size = FRAME_SIZE.map(u16::to_le_bytes);
                (0x0D, size.concat())
            }
            (0x20, &[0, _]) => error(INVALID),
            (0x20, &[of, most]) => match self.blocks(of, most, at) {
                Some(blocks) => (0x21, blocks),
                None => error(BUSY),
            },
            (0x10, [_]) | (0x14, [_, _, _]) | (0x16, [_, _]) => number(0),
            (0x18, []) => number(60),
            (0x0C | 0x20 | 0x10 | 0x14 | 0x16 | 0x18, _) => error(INVALID),
            _ => error(UNSUPPORTED),
        }
    }

    /// The blobs of the newest frame; `None` if they were told already.
    fn blocks(&mut self, of: u8, most: u8, at: Time) -> Option<Vec<u8>> {
        let frame = (at - self.powered - START) / FRAME;
        if frame == 0 || self.told == Some(frame) {
            return None;
        }
        self.told = Some(frame);
        let Seen { blobs } = self.sight.look(&self.scene, at, frame);
        for (index, age) in self.ages.iter_mut().enumerate() {
            let is_seen = blobs
                .iter()
                .any(|found| usize::from(found.signature) == index + 1);
            *age = if is_seen { age.saturating_add(1) } else { 0 };
        }
        let wanted = blobs
            .iter()
            .filter(|found| of >> (found.signature - 1) & 1 != 0);
        // As many as one packet holds.
        let told = wanted.take(usize::from(most).min(18));
        Some(told.flat_map(|found| self.block(found)).collect())
    }

    /// A blob as it is told: 14 bytes.
    fn block(&self, found: &Found) -> [u8; 14] {
        let [left, top, right, bottom] = found.edges;
        let (width, height) = (right - left, bottom - top);
        let numbers = [
            u16::from(found.signature),
            left + width / 2,
            top + height / 2,
            width,
            height,
            0,
        ];
        let mut bytes = [0; 14];
        for (place, byte) in bytes.iter_mut().zip(numbers.map(u16::to_le_bytes).concat()) {
            *place = byte;
        }
        let age = self.ages.get(usize::from(found.signature) - 1);
        bytes[13] = age.copied().unwrap_or_default();
        bytes
    }

    /// The next byte that is sent until now, with its time.
    pub fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.wire.transmit(now)
    }

    /// Time when the next byte is sent.
    pub fn next_deadline(&self) -> Option<Time> {
        self.wire.sent_at(1)
    }

    /// Time when all that it sends without a pause is sent, or so many bytes of it.
    pub fn next_burst(&self, room: usize) -> Option<Time> {
        self.wire.sent_at(room)
    }
}
