//! An emulated camera at the far end of a line.

use cmucam2_emulator::{Emulator, Scene};
use virtual_bench::{executor::Time, line::Device};

/// Puts things where they are at a time.
type Stage = Box<dyn FnMut(Time, &mut Scene)>;

/// A camera that sees a scene which changes with time.
pub struct CameraDevice {
    /// The camera.
    pub emulator: Emulator,
    scene: Stage,
}

impl CameraDevice {
    /// `scene` is called with the time before each frame is taken, to put things where they are
    /// then.
    pub fn new(emulator: Emulator, scene: impl FnMut(Time, &mut Scene) + 'static) -> Self {
        Self {
            emulator,
            scene: Box::new(scene),
        }
    }
}

impl Device for CameraDevice {
    fn power_up(&mut self, now: Time) {
        self.emulator.power_cycle(now);
    }

    fn next_action(&self) -> Option<Time> {
        self.emulator.next_frame()
    }

    fn act(&mut self, now: Time) {
        (self.scene)(now, self.emulator.scene_mut());
        self.emulator.advance(now);
    }

    fn receive(&mut self, byte: u8, at: Time) {
        // Some commands take a frame by themselves.
        if byte == b'\r' {
            (self.scene)(at, self.emulator.scene_mut());
        }
        self.emulator.receive(byte, at);
    }

    fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.emulator.transmit(now)
    }

    fn next_burst(&self, room: usize) -> Option<Time> {
        self.emulator.next_burst(room)
    }
}
