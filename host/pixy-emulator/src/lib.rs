#![doc = include_str!("../README.md")]
//!
//! [`Emulator`] is the camera at the level of bytes, as [`cmucam2_emulator::Emulator`] is a CMUcam2. It has no
//! clock and no thread: bytes sent to it go in with their times, and its own bytes come out with the times at
//! which their stop bits are over. It sees the same [`Scene`]s, and shares no code with a driver. Facts are those
//! of the makers' firmware (`charmedlabs/pixy2`, `charmedlabs/pixy`, scripts of `openmv/openmv`).
//!
//! | module | job |
//! |---|---|
//! | here | Power, frames and answers |
//! | [`wire`] | Packets, and bytes with their times |
//! | [`note`] | Requests and their answers, for who watches |
//! | [`sight`] | Which units of a frame have a signature's colour, and the blobs of these; tags |
//!
//! # Decided here
//! - It needs two seconds to start, and says nothing before. Then it says that it is busy until its
//!   first frame.
//! - A frame is seen when its blobs are first asked for. Blobs are not followed from frame to frame: one
//!   that comes into view is told at once, and not only after 48 ms.
//! - A signature is a range of chromaticity around the colour that was taught, [`TOLERANCE`] to both
//!   sides. White balance is set by the light in which it starts, and stays; exposure follows the light.
//! - It has one program, `color_connected_components`, and servos that are not seen. What other programs
//!   answer, such as `getRGB`, is "unsupported".
//! - A camera that streams takes a picture only when all of the one before is sent. The original Pixy tells two zero
//!   words for a picture in which it sees nothing. Commands for servos, lamp and brightness do nothing.
//! - A tag is found if it is whole in view, nothing before it hides any of it, and it is 10 columns wide or more. Its
//!   middle is exact but for rounding. Its angle is told as 0.

pub mod note;
pub mod sight;
pub mod wire;

use cmucam2_emulator::{Rgb, Scene};

use std::collections::VecDeque;

use self::{
    note::Note,
    sight::Found,
    wire::{Request, Wire},
};

pub use sight::TOLERANCE;

/// Nanoseconds, as of the other emulator.
pub type Time = cmucam2_emulator::Time;

const SECOND: Time = 1_000_000_000;
/// Time from power-up to the first answer.
const START: Time = 2 * SECOND;
/// Time from a request to its answer.
const THINKS: Time = 100_000;

/// Columns and rows in which a Pixy2 tells blobs.
pub const FRAME_SIZE: [u16; 2] = Model::Pixy2.size();

/// Model of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// Answers requests.
    #[default]
    Pixy2,
    /// The first Pixy: streams.
    Pixy,
    /// An OpenMV Cam with `pixy_uart_emulation.py`.
    OpenMv,
    /// An OpenMV Cam with `apriltags_pixy_uart_emulation.py`.
    OpenMvTags,
}

impl Model {
    /// Columns and rows in which blobs are told.
    pub const fn size(self) -> [u16; 2] {
        match self {
            Self::Pixy2 => [316, 208],
            Self::Pixy => [320, 200],
            Self::OpenMv => [320, 240],
            Self::OpenMvTags => [160, 120],
        }
    }

    /// Time from picture to picture.
    const fn frame(self) -> Time {
        match self {
            Self::Pixy2 => SECOND / 60,
            Self::Pixy => SECOND / 50,
            Self::OpenMv => SECOND / 30,
            Self::OpenMvTags => SECOND / 15,
        }
    }
}

/// Signatures there are.
pub const SIGNATURES: usize = 7;

/// Set-up of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    /// Its model.
    pub model: Model,
    /// The rate that is set in `PixyMon` or the script, bits per second. As it is shipped: 19,200.
    pub baud: u32,
    /// The colours that it was taught, signature 1 first, [`SIGNATURES`] at most.
    pub signatures: Vec<Rgb>,
    /// Shares of requests, and of answers or pictures, in which one byte is another one.
    pub corrupt_line: f64,
    /// Seed of noise and faults.
    pub seed: u64,
    /// True if requests are [noted](Emulator::take_note).
    pub watched: bool,
}

impl Default for Configuration {
    /// As it is shipped, and taught an orange ball.
    fn default() -> Self {
        Self {
            model: Model::default(),
            baud: 19_200,
            signatures: vec![[230, 105, 35]],
            corrupt_line: 0.0,
            seed: 0,
            watched: false,
        }
    }
}

/// The program that it has.
const PROGRAM: &[u8] = b"color_connected_components";

/// A name as C has it.
fn until_nul(name: &[u8]) -> &[u8] {
    name.split(|&byte| byte == 0).next().unwrap_or_default()
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
    /// Number of the picture that a streaming camera takes next; 0 is that of its start.
    next_picture: u64,
    /// The last frame whose blobs were told.
    told: Option<u64>,
    /// Number of frames in a row in which each signature was seen.
    ages: [u8; SIGNATURES],
    notes: VecDeque<Note>,
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
            sight: sight::Sight::new(
                configuration.model,
                &configuration.signatures,
                configuration.seed,
            ),
            configuration,
            scene,
            powered: 0,
            next_picture: 0,
            told: None,
            ages: [0; SIGNATURES],
            notes: VecDeque::new(),
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
            model,
            baud,
            corrupt_line,
            ..
        } = self.configuration;
        self.wire = Wire::new(baud, corrupt_line, seed);
        self.sight = sight::Sight::new(model, &self.configuration.signatures, seed);
        (self.powered, self.told) = (now, None);
        self.next_picture = 0;
        self.ages = [0; SIGNATURES];
    }

    /// Sets the shares of requests and answers in which one byte is another one.
    pub fn set_corrupt_line(&mut self, rate: f64) {
        self.configuration.corrupt_line = rate;
        self.wire.set_corrupt_line(rate);
    }

    /// A byte that the host sent, at the time of its stop bit.
    pub fn receive(&mut self, byte: u8, at: Time) {
        if self.configuration.model != Model::Pixy2 {
            return;
        }
        let is_started = at >= self.powered + START;
        let Some(request) = self.wire.receive(byte) else {
            return;
        };
        let answer = is_started.then(|| self.answer(&request, at));
        if let Some((kind, payload)) = &answer {
            self.wire.send(at + THINKS, *kind, payload);
        }
        if self.configuration.watched {
            self.notes.push_back(Note { request, answer });
        }
    }

    /// The next request that has come, if it is watched.
    pub fn take_note(&mut self) -> Option<Note> {
        self.notes.pop_front()
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
            // It runs already. Names may be cut short.
            (0x02, name) if PROGRAM.starts_with(until_nul(name)) => number(1),
            (0x10, [_]) | (0x12, [_, _, _, _]) | (0x14, [_, _, _]) | (0x16, [_, _]) => number(0),
            (0x18, _) => number(60),
            (0x02 | 0x0C | 0x20 | 0x10 | 0x12 | 0x14 | 0x16, _) => error(INVALID),
            _ => error(UNSUPPORTED),
        }
    }

    /// The blobs of the newest frame; `None` if they were told already.
    fn blocks(&mut self, of: u8, most: u8, at: Time) -> Option<Vec<u8>> {
        let frame = (at - self.powered - START) / self.configuration.model.frame();
        if frame == 0 || self.told == Some(frame) {
            return None;
        }
        self.told = Some(frame);
        let blobs = self.sight.look(&self.scene, at, frame);
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
        let ([x, y], [width, height]) = (found.middle(), found.size());
        let numbers = [u16::from(found.signature), x, y, width, height, 0];
        let mut bytes = [0; 14];
        for (place, byte) in bytes.iter_mut().zip(numbers.map(u16::to_le_bytes).concat()) {
            *place = byte;
        }
        let age = self.ages.get(usize::from(found.signature) - 1);
        bytes[13] = age.copied().unwrap_or_default();
        bytes
    }

    /// Time at which a camera that streams takes its next picture.
    pub fn next_picture(&self) -> Option<Time> {
        let model = self.configuration.model;
        let at = self.powered + START + self.next_picture * model.frame();
        (model != Model::Pixy2).then_some(at)
    }

    /// Takes the pictures that are due until now.
    pub fn advance(&mut self, now: Time) {
        while let Some(at) = self.next_picture().filter(|&at| at <= now) {
            self.next_picture += 1;
            if self.wire.is_free(at) {
                let words = self.picture(at);
                let bytes = words.into_iter().flat_map(u16::to_le_bytes);
                self.wire.send_bytes(at, bytes.collect());
            }
        }
    }

    /// The words of a picture.
    fn picture(&mut self, at: Time) -> Vec<u16> {
        let model = self.configuration.model;
        let blocks: Vec<(u16, Vec<u16>)> = if model == Model::OpenMvTags {
            let tags = sight::tags(&self.scene, at, model.size()).into_iter();
            let code = |[number, x, y, width, height]: [u16; 5]| {
                (0xAA56, vec![number + 8, x, y, width, height, 0])
            };
            tags.map(code).collect()
        } else {
            let blobs = self.sight.look(&self.scene, at, self.next_picture);
            let block = |found: &Found| {
                let ([x, y], [width, height]) = match model {
                    Model::OpenMv => (found.centroid(), found.box_size()),
                    _ => (found.middle(), found.size()),
                };
                (0xAA55, vec![found.signature.into(), x, y, width, height])
            };
            blobs.iter().map(block).collect()
        };
        let mut words = Vec::new();
        // Both syncs follow one another.
        words.extend((!blocks.is_empty()).then_some(0xAA55));
        for (sync, numbers) in &blocks {
            let sum = numbers.iter().copied().fold(0, u16::wrapping_add);
            words.extend([*sync, sum].iter().chain(numbers));
        }
        match model {
            Model::Pixy if blocks.is_empty() => words.extend([0, 0]),
            Model::Pixy | Model::Pixy2 => {}
            Model::OpenMv | Model::OpenMvTags => words.push(0),
        }
        words
    }

    /// The next byte that is sent until now, with its time.
    pub fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.advance(now);
        self.wire.transmit(now)
    }

    /// Time when the next byte is sent, or the next picture taken.
    pub fn next_deadline(&self) -> Option<Time> {
        let times = self.wire.sent_at(1).into_iter();
        times.chain(self.next_picture()).min()
    }

    /// Time when all that it sends without a pause is sent, or so many bytes of it.
    pub fn next_burst(&self, room: usize) -> Option<Time> {
        self.wire.sent_at(room)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene with a ball around the middle of column 100.5 and row 60 of a picture of that size, and two tags.
    fn scene(size: [u16; 2]) -> Scene {
        use cmucam2_emulator::{Extent, Object, Place, Shape};
        let [columns, rows] = size.map(f64::from);
        let at = |shape, x: f64, y: f64, across: f64| Object {
            colour: [230, 105, 35],
            shape,
            place: Place::At(Extent::centred(
                x / columns,
                y / rows,
                across / columns,
                across / rows,
            )),
        };
        Scene {
            objects: vec![
                at(Shape::Disc, 101.0, 60.5, 20.0),
                at(Shape::Tag(5), 62.5, 41.0, 15.0),
                at(Shape::Tag(7), 20.0, 41.0, 9.0),
                at(Shape::Tag(2), 150.0, 100.0, 18.0),
                at(Shape::Tag(9), 155.0, 20.0, 18.0),
            ],
            ..Scene::default()
        }
    }

    fn words(camera: &mut Emulator, until: Time) -> Vec<u16> {
        let bytes = std::iter::from_fn(|| camera.transmit(until)).map(|(_, byte)| byte);
        let bytes: Vec<u8> = bytes.collect();
        let (pairs, rest) = bytes.as_chunks::<2>();
        assert!(rest.is_empty());
        pairs.iter().copied().map(u16::from_le_bytes).collect()
    }

    /// By the table of the makers' protocol: two syncs, sum, signature, place and size; a zero word of OpenMV's.
    #[test]
    fn pictures_are_streamed_and_silence_is_zeros() {
        for (model, nothing, picture) in [
            (
                Model::Pixy,
                &[0, 0][..],
                &[0xAA55, 0xAA55, 1 + 100 + 60 + 20 + 18, 1, 100, 60, 20, 18][..],
            ),
            (
                Model::OpenMv,
                &[0],
                &[
                    0xAA55,
                    0xAA55,
                    1 + 101 + 60 + 20 + 19,
                    1,
                    101,
                    60,
                    20,
                    19,
                    0,
                ],
            ),
            (
                Model::OpenMvTags,
                &[0],
                &[
                    0xAA55,
                    0xAA56,
                    10 + 150 + 100 + 18 + 18,
                    10,
                    150,
                    100,
                    18,
                    18,
                    0, //
                    0xAA56,
                    13 + 62 + 41 + 15 + 15,
                    13,
                    62,
                    41,
                    15,
                    15,
                    0,
                    0,
                ],
            ),
        ] {
            let configuration = Configuration {
                model,
                ..Configuration::default()
            };
            let mut camera = Emulator::new(configuration, Scene::default());
            let first = camera.next_picture().unwrap();
            assert_eq!(first, START);
            let later = first + model.frame() - 1;
            assert_eq!(words(&mut camera, later), nothing, "{model:?}");
            let mut scene = scene(model.size());
            if model != Model::OpenMvTags {
                scene.objects.truncate(1);
            }
            *camera.scene_mut() = scene;
            let later = first + 2 * model.frame() - 1;
            assert_eq!(words(&mut camera, later), picture, "{model:?}");
            // What hides a part of a tag hides it.
            camera.receive(0xAE, later);
            if model == Model::OpenMvTags {
                let mut wall = camera.scene.objects[1].clone();
                wall.shape = cmucam2_emulator::Shape::Box;
                camera.scene_mut().objects.push(wall);
                let later = later + model.frame();
                assert_eq!(words(&mut camera, later).len(), picture.len() - 8);
            }
        }
    }

    /// Type and payload of a request, and both of the answer that the maker's firmware gives.
    #[test]
    fn requests_of_the_makers_library_are_answered_and_noted() {
        let done = [0; 4].as_slice();
        let mut program = [0; 33];
        program[..PROGRAM.len()].copy_from_slice(PROGRAM);
        let mut camera = Emulator::new(
            Configuration {
                watched: true,
                ..Configuration::default()
            },
            Scene::default(),
        );
        for (kind, payload, answer, told) in [
            (
                0x12,
                &[0xF4, 1, 0x90, 1][..],
                (1, done),
                "setServos (0x12) 244 1 144 1: answered 0 0 0 0",
            ),
            (
                0x12,
                &[0xF4, 1, 0x90],
                (3, &[0xFD][..]),
                "setServos (0x12) 244 1 144: refused, -3 (invalid request)",
            ),
            (
                0x16,
                &[1, 0],
                (1, done),
                "setLamp (0x16) 1 0: answered 0 0 0 0",
            ),
            (0x02, &program, (1, &[1, 0, 0, 0]), ": answered 1 0 0 0"),
            (0x02, b"color\0", (1, &[1, 0, 0, 0]), ": answered 1 0 0 0"),
            (0x02, b"video\0", (3, &[0xFD]), "refused, -3"),
            (
                0x70,
                &[0, 0, 0, 0, 1],
                (3, &[0xFC]),
                "getRGB (0x70) 0 0 0 0 1: refused, -4 (type unsupported)",
            ),
            (0x20, &[1, 9], (0x21, &[]), "getBlocks (0x20) 1 9: 0 blocks"),
            (0x20, &[1, 9], (3, &[0xFE]), "refused, -2 (busy)"),
        ] {
            let at = START + SECOND;
            let request = [&[0xAE, 0xC1, kind, payload.len() as u8], payload].concat();
            request.iter().for_each(|&byte| camera.receive(byte, at));
            let bytes = std::iter::from_fn(|| camera.transmit(Time::MAX)).map(|(_, byte)| byte);
            let bytes: Vec<u8> = bytes.collect();
            assert_eq!((bytes[2], &bytes[6..]), answer, "{kind:#x} {payload:?}");
            let note = camera.take_note().unwrap().to_string();
            assert!(note.contains(told), "{note}");
        }
        // While it starts nothing is answered, but told.
        camera.power_cycle(9 * SECOND);
        for byte in [0xAE, 0xC1, 0x0E, 0] {
            camera.receive(byte, 10 * SECOND);
        }
        assert_eq!(camera.transmit(Time::MAX), None);
        let note = camera.take_note().unwrap().to_string();
        assert!(note.contains("starts"), "{note}");
    }
}
