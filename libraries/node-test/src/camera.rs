//! Emulated cameras at the far end of a line.

use std::{cell::Cell, rc::Rc};

use cmucam2_emulator::{Emulator, FaultRates, Scene};
use virtual_hardware::{executor::Time, line::Device};

/// Puts things where they are at a time.
type Stage = Box<dyn FnMut(Time, &mut Scene)>;

/// A camera that sees a scene which changes with time.
pub struct CameraDevice {
    /// The camera.
    pub emulator: Emulator,
    scene: Stage,
    /// The camera's present faults, and the faults that it is to have.
    faults: Option<(FaultRates, Rc<Cell<FaultRates>>)>,
}

impl CameraDevice {
    /// `scene` is called with the time before each frame is taken, to put things where they are
    /// then.
    pub fn new(emulator: Emulator, scene: impl FnMut(Time, &mut Scene) + 'static) -> Self {
        Self {
            emulator,
            scene: Box::new(scene),
            faults: None,
        }
    }

    /// Adds faults that may change: from the next frame or byte on the camera has those of the cell.
    #[must_use]
    pub fn with_faults(self, faults: Rc<Cell<FaultRates>>) -> Self {
        Self {
            faults: Some((faults.get(), faults)),
            ..self
        }
    }

    /// Sets the faults only if they differ, because they then begin anew with their seed.
    fn follow_faults(&mut self) {
        if let Some((present, faults)) = &mut self.faults
            && *present != faults.get()
        {
            *present = faults.get();
            self.emulator.set_faults(present);
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
        self.follow_faults();
        (self.scene)(now, self.emulator.scene_mut());
        self.emulator.advance(now);
    }

    fn receive(&mut self, byte: u8, at: Time) {
        self.follow_faults();
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

/// An emulated camera of the Pixy family at the far end of a line.
pub struct PixyDevice {
    /// The camera.
    pub emulator: pixy_emulator::Emulator,
    scene: Stage,
    faults: Option<Rc<Cell<FaultRates>>>,
}

impl PixyDevice {
    /// `scene` is called with the time before each byte that may ask for a frame, or before each picture of a camera
    /// that streams.
    pub fn new(
        emulator: pixy_emulator::Emulator,
        scene: impl FnMut(Time, &mut Scene) + 'static,
    ) -> Self {
        Self {
            emulator,
            scene: Box::new(scene),
            faults: None,
        }
    }

    /// Adds faults that may change: of them it has `corrupt_line`, of each request, answer and picture.
    #[must_use]
    pub fn with_faults(self, faults: Rc<Cell<FaultRates>>) -> Self {
        Self {
            faults: Some(faults),
            ..self
        }
    }

    /// Puts before it what is there at a time, and sets its faults.
    fn look(&mut self, now: Time) {
        (self.scene)(now, self.emulator.scene_mut());
        if let Some(faults) = &self.faults {
            self.emulator.set_corrupt_line(faults.get().corrupt_line);
        }
    }
}

impl Device for PixyDevice {
    fn power_up(&mut self, now: Time) {
        self.emulator.power_cycle(now);
    }

    fn next_action(&self) -> Option<Time> {
        self.emulator.next_picture()
    }

    fn act(&mut self, now: Time) {
        self.look(now);
        self.emulator.advance(now);
    }

    fn receive(&mut self, byte: u8, at: Time) {
        self.look(at);
        self.emulator.receive(byte, at);
    }

    fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.emulator.transmit(now)
    }

    fn next_burst(&self, room: usize) -> Option<Time> {
        self.emulator.next_burst(room)
    }
}
