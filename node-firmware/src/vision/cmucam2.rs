//! The CMUcam2 as a [`BlobCamera`].
//!
//! # Settings, and why
//! | command | why |
//! |---|---|
//! | `RS`, `CR 18 44 19 33`, 5 s, `CR 18 40 19 32` | adapts to the light, then freezes gain and white balance (thesis Appendix A) |
//! | `HR 1`, if the lens has 175 columns or more | twice the columns, half the angle of one; OV6620 only |
//! | `NF 0` | each pixel counts. By some sources `NF n` leaves out the *first* pixels of each run in a row: the left edge would be late by up to 2 columns (the default), the direction wrong by up to one, five times the sigma of rounding. A stray pixel instead makes a look unsteady or lopsided, which is noticed |
//! | `PM 1` | one packet for each command, then the prompt: no stream runs over while the node does something else, nothing must be stopped (0.1 s), and a restarted camera gives itself away by streaming |
//! | `HD 1` | 16 blocks instead of 8 over the width for frame differencing |
//!
//! Left as after a reset: `OM` all fields (of 34 bytes 15 could be saved, 4 ms of the 20 of a
//! frame, but the numbers of a packet check each other), `LM` off (rows would take longer than
//! the frame), `PF` off (silence stays an error), `RM` off (text is checked, raw bytes are not), `DS 1
//! 1` and the whole window (each column counts).
//!
//! While nothing is to be looked at, `SD` has the camera sleep. The start-up wakes it.
//!
//! At 38,400 baud a polled packet takes command, `ACK`, the rest of the frame under way and
//! one frame of 20 ms, and up to 9 ms of text: five take about 0.3 s at most.
//!
//! # What a restart costs
//! The driver sets all modes again, but the adaptation of the camera is gone, and frame differencing has lost
//! its background. So every restart that is noticed ends in [`VisionError::Restarted`], and the camera must
//! be [started up](BlobCamera::start_up).

use cmucam2_driver::{
    Cmucam2, Command, Error, Packet,
    colour::{ColourBounds, LEVEL_MAX, LEVEL_MIN, LevelRange},
    device::{SummedDelays, TimeSource},
    geometry::{Sensor, Size},
    packet::Tracking,
    session::{Answer, Fault, Learn, Request, StartUp},
};
use embedded_hal_async::delay::DelayNs;
use embedded_io_async::{Read, Write};

use super::{
    Blob, BlobCamera, ColourWindow, Grid, Learning, LearntColour, Rows, Subject, VisionError,
};
use crate::log::warning;

/// Blocks across a frame for frame differencing.
const BLOCKS: u8 = 16;

/// Fewest columns of a lens that needs the high resolution of the OV6620; frames may be one column
/// narrower than its 176.
const HIGH_RESOLUTION: u16 = 175;

/// Number of rows that are as much as a column, at either resolution of either sensor.
pub const ROWS_PER_COLUMN: f32 = 2.0;

/// Settings of a CMUcam2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Cmucam2Settings {
    /// Columns of the [lens](super::Lens::columns).
    pub columns: u16,
    /// Number of the first column in packets, 0 or 1: sources disagree. `host-sim probe` finds out.
    pub first_column: u8,
    /// Time to adapt to the light, milliseconds.
    pub adapt_ms: u32,
}

impl Cmucam2Settings {
    /// A camera of so many columns that count from 1 and adapts for five seconds.
    pub const fn new(columns: u16) -> Self {
        Self {
            columns,
            first_column: 1,
            adapt_ms: 5_000,
        }
    }
}

/// A CMUcam2 on a UART. See the [module](self).
#[derive(Debug)]
pub struct Cmucam2BlobCamera<U, D, K = SummedDelays> {
    camera: Cmucam2<U, D, K>,
    settings: Cmucam2Settings,
    /// Its frame, once it was started up.
    frame: Size,
    /// All is set.
    ready: bool,
    /// It has a background.
    background: bool,
    subject: Option<Subject>,
    /// Number of restarts of the camera when it had adapted.
    restarts: Option<u16>,
}

impl<U, D, K> Cmucam2BlobCamera<U, D, K> {
    /// A camera of which nothing is known. Nothing is sent before the first call.
    pub fn new(camera: Cmucam2<U, D, K>, settings: Cmucam2Settings) -> Self {
        Self {
            camera,
            settings,
            frame: Size::LARGEST,
            ready: false,
            background: false,
            subject: None,
            restarts: None,
        }
    }

    /// The line to it.
    pub fn line(&mut self) -> &mut U {
        self.camera.uart()
    }

    fn forget(&mut self) {
        self.ready = false;
        self.background = false;
        self.subject = None;
        self.restarts = None;
    }

    /// Meaning of the packets for the subject that was begun.
    fn grid(&self, subject: Subject) -> Grid {
        let first = self.settings.first_column;
        match subject {
            Subject::Colour(_) | Subject::Signature(_) | Subject::Tag(_) => Grid::pixels(first),
            Subject::Motion { .. } => {
                let rows = self.frame.height.into();
                Grid::blocks(first, BLOCKS, self.settings.columns, rows)
            }
        }
    }

    fn is_ready(&self) -> Result<(), VisionError> {
        if self.ready {
            Ok(())
        } else {
            Err(VisionError::NotStarted)
        }
    }
}

impl<U: Read + Write, D: DelayNs, K: TimeSource> Cmucam2BlobCamera<U, D, K> {
    /// Has the camera carry out a request. Takes notice of a failure, and of a restart that the driver has made up for
    /// on its way.
    async fn ask(&mut self, request: Request) -> Result<Answer, VisionError> {
        let outcome = self.camera.request(request).run().await;
        let restarts = self.camera.session().restarts();
        let error = match outcome {
            Ok(_) if self.restarts.is_some_and(|before| before != restarts) => {
                VisionError::Restarted
            }
            Ok(answer) => return Ok(answer),
            Err(Error::Uart(error)) => VisionError::Line(embedded_io::Error::kind(&error)),
            Err(Error::Closed) => VisionError::Closed,
            Err(Error::Camera(fault)) => match fault {
                Fault::Silence => VisionError::Silent,
                Fault::Refused { .. } => VisionError::Refused,
                Fault::Restarted => VisionError::Restarted,
                Fault::NotStreaming => VisionError::NotBegun,
                _ => VisionError::Garbled,
            },
        };
        if error == VisionError::Restarted {
            self.forget();
        }
        warning!("camera: {}", error);
        Err(error)
    }

    /// The next packet of a search, or of the learning of a colour.
    async fn look(&mut self) -> Result<Option<Tracking>, VisionError> {
        match self.ask(Request::Next).await? {
            Answer::Packet(Packet::Tracking(tracking)) => Ok(Some(tracking)),
            Answer::Quiet => Ok(None),
            _ => Err(VisionError::Garbled),
        }
    }

    /// The frame that this camera will give with this lens, or the reason why they do not match. A frame may
    /// be one column narrower than the manual says. An unknown sensor is believed.
    async fn ask_frame(&mut self) -> Result<Size, VisionError> {
        let asked = self.ask(Request::Do(Command::GetVersion.order())).await?;
        let Answer::Version(version) = asked else {
            return Err(VisionError::Garbled);
        };
        let lens = self.settings.columns;
        let Some(sensor) = version.sensor() else {
            return Ok(Size::of(Sensor::Ov6620, lens >= HIGH_RESOLUTION));
        };
        let frame = Size::of(sensor, lens >= HIGH_RESOLUTION);
        let camera = u16::from(frame.width);
        if lens == camera || lens + 1 == camera {
            Ok(frame)
        } else {
            Err(VisionError::Columns { camera, lens })
        }
    }
}

impl<U: Read + Write, D: DelayNs, K: TimeSource> BlobCamera for Cmucam2BlobCamera<U, D, K> {
    async fn start_up(&mut self) -> Result<(), VisionError> {
        self.forget();
        self.frame = self.ask_frame().await?;
        let mut start_up = StartUp::default();
        start_up.adapt_ms = self.settings.adapt_ms;
        self.ask(Request::StartUp(start_up)).await?;
        self.restarts = Some(self.camera.session().restarts());
        // The settings that a start does not make.
        let needs_high = self.settings.columns >= HIGH_RESOLUTION;
        for step in u8::from(!needs_high)..4 {
            let mode = match step {
                0 => Command::HighResolution(true).order(),
                1 => Command::NoiseFilter(0).order(),
                2 => Command::HighResolutionDifference(true).order(),
                _ => Command::PollMode(true).order(),
            };
            self.ask(Request::Do(mode)).await?;
        }
        self.ready = true;
        Ok(())
    }

    async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
        self.is_ready()?;
        self.subject = None;
        let learn = Request::Learn {
            how: Learn::default(),
            track: true,
        };
        let Answer::Bounds(learnt) = self.ask(learn).await? else {
            return Err(VisionError::Garbled);
        };
        let mut learning = Learning::new(learnt, self.frame, self.settings.first_column);
        // If anything fails, it may be left with a part of its view.
        self.ready = false;
        while let Some(step) = learning.step() {
            self.ask(Request::Do(Command::from(step).order())).await?;
            learning.take(self.look().await?);
        }
        self.ready = true;
        let (bounds, background) = learning.verdict()?;
        let [a, b, c, d, e, f] = bounds.values();
        let window = ColourWindow {
            red: [a, b],
            green: [c, d],
            blue: [e, f],
        };
        Ok(LearntColour { window, background })
    }

    async fn learn_background(&mut self) -> Result<(), VisionError> {
        self.is_ready()?;
        self.subject = None;
        self.background = false;
        self.ask(Request::Do(Command::LoadFrame.order())).await?;
        self.background = true;
        Ok(())
    }

    async fn begin(&mut self, subject: Subject) -> Result<(), VisionError> {
        self.is_ready()?;
        self.subject = None;
        let order = match subject {
            Subject::Colour(window) => {
                let bounds = bounds(&window).ok_or(VisionError::Colour)?;
                Command::TrackColour(Some(bounds)).order()
            }
            Subject::Motion { .. } if !self.background => return Err(VisionError::NoBackground),
            Subject::Motion { threshold } => Command::FrameDifference(threshold).order(),
            Subject::Signature(_) | Subject::Tag(_) => return Err(VisionError::Unable),
        };
        self.ask(Request::Start(order)).await?;
        self.subject = Some(subject);
        Ok(())
    }

    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        self.is_ready()?;
        let subject = self.subject.ok_or(VisionError::NotBegun)?;
        let tracking = self.look().await?;
        // What moves need not be whole.
        let is_whole = !matches!(subject, Subject::Motion { .. });
        let rows = Rows {
            count: self.frame.height.into(),
            per_column: ROWS_PER_COLUMN,
        };
        let blob = tracking.and_then(|tracking| Blob::from_tracking(&tracking, self.grid(subject)));
        Ok(blob.map(|blob| Blob {
            rows: is_whole.then_some(rows),
            ..blob
        }))
    }

    async fn end(&mut self) -> Result<(), VisionError> {
        self.subject = None;
        self.ask(Request::Stop).await?;
        Ok(())
    }

    async fn sleep(&mut self) {
        self.forget();
        // One that does not hear it goes on waiting.
        let _ = self.ask(Request::Do(Command::DeepSleep.order())).await;
    }
}

/// The same colours in the levels that a CMUcam2 has.
fn bounds(window: &ColourWindow) -> Option<ColourBounds> {
    let range = |[lowest, highest]: [u8; 2]| {
        let cut = |level: u8| level.clamp(LEVEL_MIN, LEVEL_MAX);
        (lowest <= highest).then(|| LevelRange::new(cut(lowest), cut(highest)).ok())?
    };
    Some(ColourBounds {
        red: range(window.red)?,
        green: range(window.green)?,
        blue: range(window.blue)?,
    })
}
