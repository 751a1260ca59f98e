//! Frame differencing, histograms and the high resolution, of video.

use std::sync::Arc;

use cmucam2_emulator::{Background, Configuration, Emulator, Scene, Sensor};
use host_sim::video::Video;

const SECOND: u64 = 1_000_000_000;

/// Grey pictures of 176 x 144 pixels, four by four places of 44 x 36. A box of 36 x 30 of another level is in
/// this row of places, and in each picture's column.
fn video(pictures: &[Option<usize>], row: usize) -> Video {
    let mut bytes = b"YUV4MPEG2 W176 H144 F50:1 Cmono XCOLORRANGE=FULL\n".to_vec();
    for &column in pictures {
        bytes.extend(b"FRAME\n");
        for y in 0..144 {
            for x in 0..176 {
                let is_box = column == Some(x / 44)
                    && y / 36 == row
                    && (4..40).contains(&(x % 44))
                    && (3..33).contains(&(y % 36));
                bytes.push(if is_box { 200 } else { 60 });
            }
        }
    }
    Video::new(std::io::Cursor::new(bytes)).unwrap()
}

struct Seeing {
    camera: Emulator,
    video: Video,
    now: u64,
}

impl Seeing {
    fn new(video: Video, sensor: Sensor) -> Self {
        let configuration = Configuration {
            sensor,
            ..Configuration::default()
        };
        let camera = Emulator::new(configuration, Scene::default());
        let mut seeing = Self {
            camera,
            video,
            now: 2 * SECOND,
        };
        seeing.said();
        seeing.show();
        // Without the effect of the light on the levels.
        assert!(seeing.ask("CR 18 40 19 32").starts_with("ACK"));
        seeing
    }

    fn show(&mut self) {
        let picture = self.video.next_picture().unwrap().unwrap();
        self.camera.scene_mut().background = Background::Picture(Arc::new(picture));
    }

    fn said(&mut self) -> Vec<u8> {
        std::iter::from_fn(|| Some(self.camera.transmit(self.now)?.1)).collect()
    }

    fn ask(&mut self, line: &str) -> String {
        for byte in line.bytes().chain(*b"\r") {
            self.camera.receive(byte, self.now);
        }
        self.now += SECOND / 4;
        String::from_utf8_lossy(&self.said()).into_owned()
    }

    /// The numbers of the last whole packet.
    fn packet(&mut self, letter: char) -> Vec<u32> {
        self.now += SECOND / 4;
        let said = String::from_utf8_lossy(&self.said()).into_owned();
        let mut packets = said
            .split_inclusive('\r')
            .filter(|line| line.ends_with('\r'));
        let last = packets.rfind(|line| line.starts_with(letter)).expect(&said);
        let numbers = last[1..]
            .split_whitespace()
            .map(|word| word.parse().unwrap());
        numbers.collect()
    }
}

/// A place is two by two of the eight by eight blocks.
#[test]
fn what_moves_in_a_video_is_found_by_frame_differencing() {
    for (sensor, high) in [
        (Sensor::Ov6620, false),
        (Sensor::Ov6620, true),
        (Sensor::Ov7620, false),
    ] {
        let mut seeing = Seeing::new(video(&[None, None, Some(2), Some(0)], 1), sensor);
        if high {
            seeing.ask("HR 1");
        }
        seeing.ask("LF");
        seeing.show();
        seeing.ask("FD 30");
        assert_eq!(seeing.packet('T'), [0; 8]);
        for columns in [[5, 6], [1, 2]] {
            seeing.show();
            let found = seeing.packet('T');
            assert_eq!(found[2..6], [columns[0], 3, columns[1], 4], "{found:?}");
        }
    }
}

/// 36 x 30 of the 176 x 144 pixels are bright: 11 of 256.
#[test]
fn a_video_has_a_histogram() {
    let mut seeing = Seeing::new(video(&[Some(1), Some(3), Some(0)], 2), Sensor::Ov6620);
    for _ in 0..2 {
        let told = seeing.ask("GH 1");
        let bins: Vec<u32> = told
            .split_once('H')
            .and_then(|(_, bins)| bins.split_once('\r'))
            .map(|(bins, _)| {
                bins.split_whitespace()
                    .map(|bin| bin.parse().unwrap())
                    .collect()
            })
            .expect(&told);
        assert_eq!(bins.len(), 28);
        let filled: Vec<u32> = bins.iter().copied().filter(|&bin| bin > 3).collect();
        let [dark, bright] = filled[..] else {
            panic!("{bins:?}");
        };
        assert!(
            dark.abs_diff(245) <= 4 && bright.abs_diff(11) <= 4,
            "{bins:?}"
        );
        seeing.show();
        seeing.now += SECOND;
    }
}

/// The camera looks at every picture that is 20 ms old, whatever its resolution: 50 packets a second.
#[test]
fn fifty_packets_a_second_of_160_x_255() {
    let mut seeing = Seeing::new(video(&[Some(3)], 3), Sensor::Ov6620);
    seeing.ask("HR 1");
    seeing.ask("VW 1 1 160 255");
    seeing.ask("TC 120 240 120 240 120 240");
    seeing.said();
    seeing.now += SECOND;
    let said = seeing.said();
    let packets = said.iter().filter(|&&byte| byte == b'\r').count();
    assert!((49..=51).contains(&packets), "{packets}");
}
