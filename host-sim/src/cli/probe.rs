//! `host-sim probe`

use std::{
    borrow::Cow,
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
    sync::atomic::Ordering,
    time::Duration,
};

use anyhow::{anyhow, bail, ensure};
use clap::Args;
use cmucam2_driver::{
    Command, Error,
    colour::ColourBounds,
    command::{LineMode, OutputMask, RawMode, StatisticsLines, TrackingLines},
    geometry::{DownSampling, Sensor, Size},
    packet::Tracking,
    servo::ServoMask,
    session::{Fault, Learn, StartUp},
};
use host_sim::probe::{
    Device, View,
    advice::{advice, fell_silent, garbled_since, no_baud_rate},
    colour::{self, Judged},
    display::doubt,
    picture,
    port::{self, Baud, Clock, Heard, Overheard, Port, PortError, Search},
    record::{self, Recording},
    sensor_name, stranger,
};
use indicatif::ProgressBar;
use node_firmware::vision::{BackgroundShare, Rows, VisionError, cmucam2::ROWS_PER_COLUMN};

use super::{
    camera::{KindOption, emulated},
    camera_options::{CameraOptions, USUAL_COLUMNS},
    files::Files,
    interrupt::INTERRUPTED,
    messages, tell, values, whole_file,
};
use person::Person;

/// Options without --record: clap demands none that conflicts with an option which is given.
const OF_LIVE: [&str; 3] = ["frame", "count", "seconds"];

mod live;
mod person;
mod pixy;
mod stops;

/// Talks to a camera on a serial port: what it tracks, and where; a picture; sightings for `solve`.
///
/// Starts the camera up, learns the colour of the object in the middle of the view (on a terminal,
/// once Enter is pressed), and prints what the camera tracks until Ctrl-C. Afterwards the camera is
/// left idle.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
#[command(group(clap::ArgGroup::new("line").required(true).args(["port", "emulate"])))]
pub(super) struct Arguments {
    /// The serial port, such as /dev/ttyUSB0.
    #[arg(long, value_name = "DEV")]
    port: Option<String>,
    /// An emulated camera in virtual time in the place of a port: the same answers each time, as fast as this
    /// computer can. With an option of `host-sim camera`, see below; may be repeated.
    #[arg(long, value_name = "NAME=VALUE", num_args = 0..=1, default_missing_value = "")]
    emulate: Vec<String>,
    /// Model of the camera. Of all but a CMUcam2 the blobs of a signature, or a tag, are shown or recorded; they
    /// take no pictures, learn no colour here and are not started up.
    #[arg(long = "camera", value_enum, default_value_t)]
    kind: KindOption,
    /// The signature that a Pixy or an OpenMV Cam was taught and that is looked for [default: 1].
    #[arg(long, value_name = "N", value_parser = values::whole(1, 7_u8))]
    signature: Option<u8>,
    /// The number of the tag that is looked for, with `--camera openmv-tags` [default: 0].
    #[arg(long, value_name = "N", value_parser = values::whole(0, 999_u16))]
    tag: Option<u16>,
    /// Rate that the camera's jumpers select, or that is set in another one; `auto` tries all usual rates.
    #[arg(long, value_name = "RATE", default_value = "auto")]
    baud: Baud,
    /// Time that the camera has to adapt to the light before gain and white balance are frozen [default: 5].
    #[arg(long, value_name = "SECONDS", value_parser = values::not_negative, conflicts_with = "as_is")]
    settle: Option<f64>,
    /// Neither reset nor adapt nor learn: go on with a camera that an earlier run has started up. Modes that
    /// other programs have set since, such as DS, VW or OM, are put back.
    #[arg(long)]
    as_is: bool,
    /// Track this colour instead of learning one: Rmin,Rmax,Gmin,Gmax,Bmin,Bmax, each 0 to 255.
    #[arg(long, value_name = "BOUNDS", value_parser = parse_colour)]
    colour: Option<ColourBounds>,
    /// 176 x 255 pixels instead of 88 x 143 (OV6620 only).
    #[arg(long)]
    high_res: bool,
    /// Stop after so many packets.
    #[arg(long, value_name = "N", value_parser = values::whole(1, u64::MAX))]
    count: Option<u64>,
    /// Stop after so many seconds.
    #[arg(long, value_name = "S", value_parser = values::positive)]
    seconds: Option<f64>,
    /// Take a picture instead of tracking.
    #[arg(long, value_name = "FILE.png", value_parser = values::result(), conflicts_with_all = ["record", "count", "seconds", "colour"])]
    frame: Option<PathBuf>,
    /// Append sightings of the object at known places, for `host-sim solve`.
    #[arg(long, value_name = "FILE.csv", value_parser = values::result(), conflicts_with_all = ["count", "seconds"])]
    record: Option<PathBuf>,
    /// Place where the object stands now: one sighting. Without it, places are read line by line.
    #[arg(
        long, value_name = "X,Y", value_parser = record::place, requires = "record",
        conflicts_with_all = OF_LIVE, allow_hyphen_values = true
    )]
    at: Option<(f64, f64)>,
    /// The name of this camera in the file.
    #[arg(
        long,
        value_name = "NAME",
        default_value = "camera",
        requires = "record",
        conflicts_with_all = OF_LIVE
    )]
    case: String,
    /// Number of packets for which the object must stand still for a sighting.
    #[arg(
        long, value_name = "N", default_value_t = 20, requires = "record", conflicts_with_all = OF_LIVE,
        value_parser = values::whole(2, stops::PACKETS_MAX as u16)
    )]
    packets: u16,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// The number that packets give the first column and row [default: what the camera shows]; see
    /// below.
    #[arg(
        long, value_name = "0|1", help_heading = "Camera, for bearings",
        value_parser = values::whole(0, 1_u8)
    )]
    first_column: Option<u8>,
    #[command(flatten, next_help_heading = "Camera, for bearings")]
    camera: CameraOptions,
}

const EPILOGUE: &str = "\
Bringing up a camera:
  1. host-sim probe --port /dev/ttyUSB0
     It finds the rate that the jumpers select; when there is no answer it says what to check.
  2. host-sim probe --port /dev/ttyUSB0 --frame view.png
     Is it sharp? Levels are the camera's, so a colour picked from the picture can be given as
     --colour; pixels have 16 to 240, bounds may be anything from 0 to 255. Every pixel is there twice, side by side, because the camera's pixels are
     twice as wide as tall.
  3. host-sim probe --port /dev/ttyUSB0 --fov-deg 45
     Bearings are positive to the left, those of the object's middle between its edges. Their sigma is that
     of whole columns. A level camera sees an object at the height of its lens 0 deg up; where it sees it 5 deg
     up, it looks down by 5 degrees.
  4. host-sim probe --port /dev/ttyUSB0 --fov-deg 45 --record sightings.csv --case north
     Type where the object stands, X,Y, once it stands there; three places or more, not on one
     line with the camera. `q` or Ctrl-D ends. Then:
     host-sim solve sightings.csv --fov-deg 45
     (with --columns 176 after --high-res, --columns 160 for an OV7620)

How much of the background has the colour that was learnt is looked at while the object is still in the
middle; hands and arms are background, too. Where it is more than nothing, narrower bounds are searched
for in the camera's histograms. Bounds that 1 % of the background has, and no narrower ones for which
that is not so, are refused; those of --colour never are. What is learnt is tried on the same view: bounds that
only a part of the object has, such as its lit side, are widened until its outline stays where it is, or refused.

Single sightings without resetting the camera in between (run 3 starts it up):
  host-sim probe --port /dev/ttyUSB0 --fov-deg 45 --record sightings.csv --as-is --at 1.5,-2

FILE.csv gets the columns case, target_x, target_y, column (in the direction of the object's
middle, from 0 on the left) and, with --fov-deg, sigma_rad: rounding of both edges to whole columns,
and noise. A file with other columns is refused. An object that is cut off by the left or right
border, lost, moving or partly hidden is refused. Other cameras than a CMUcam2 are judged as on a node: an object of
a signature has to be as wide as tall, and whole.

--first-column: whether packets count columns from 0 or from 1 is not certain for every firmware,
and turns all bearings by one column, half a degree. A camera that is started up is made to track
everything once, and shows it; with --as-is it is 1 unless given. A packet that contradicts it is
reported, and no sighting is recorded from then on.

JSON (--json), one object per line. Everything else goes to the standard error output.
  of a CMUcam2        seconds (since tracking began), column, row, x1, y1, x2, y2 (from 0), pixels, confidence,
                      bearing_rad, sigma_rad, elevation_rad; null when nothing is tracked, bearings also without
                      --fov-deg and where the object is cut off by the left or right border or partly hidden
  of other cameras    seconds, blocks (those of the signature or tag, the two largest at most), x, y, width, height
                      (of the largest one, in the camera's own numbers), bearing_rad, sigma_rad, elevation_rad (of
                      an object that stands still), reason (words for why there is no bearing); null where there
                      is none
  with --record       one object per sighting: case, target_x, target_y, column, sigma_rad, column_sigma,
                      bearing_rad, packets, pixels, confidence; null where there is none: only a CMUcam2 tells
                      pixels and confidence
  with --frame        file, columns, rows, damaged_rows

Without a camera (--emulate): NAME is baud, fault, scene, seed, sensor, switch or taught, as of `host-sim camera`, or
heard: what another program has sent before, such as heard='RM 2\r'. Time is virtual, so --settle and --seconds take
no time.
  host-sim probe --emulate --fov-deg 45 --count 20
  host-sim probe --emulate scene=room.toml --emulate baud=9600 --record sightings.csv --at 1.5,-2

Exit codes:
  0    done, or tracking was ended with Ctrl-C
  2    wrong options, or the camera, its line or a file failed, or no sighting was recorded
  130  Ctrl-C before the end";

/// The camera and what is known of it.
struct Bench<'a> {
    arguments: &'a Arguments,
    camera: Device,
    clock: Clock,
    /// The last bytes that came.
    heard: Heard,
    baud_rate: u32,
    frame: Size,
    view: View,
    person: Person,
    /// It has told who it is: its rate is right.
    is_known: bool,
    /// Restarts since the last packet.
    restarts: u8,
    /// Packets that have come.
    packets: u64,
    /// The user was told that columns are counted otherwise.
    contradicted: bool,
}

/// The number of the first column and row, unless it is known otherwise: most sources agree.
const USUAL_FIRST: u8 = 1;

/// Seconds that a camera has to adapt to the light, unless told otherwise.
const USUAL_SETTLE: f64 = 5.0;

/// Modes in which other programs may have left the camera and which change what is counted or sent, as after
/// a reset: how things are sent comes first. Gain, white balance and colours stay.
fn as_after_reset() -> [Command; 15] {
    [
        Command::RawMode(RawMode::OFF),
        Command::LineMode(LineMode::Tracking(TrackingLines::Off)),
        Command::LineMode(LineMode::Statistics(StatisticsLines::Off)),
        Command::OutputMask(OutputMask::Tracking(0xFF)),
        Command::ServoMask(ServoMask::default()),
        Command::PollMode(false),
        Command::PacketSkip(0),
        Command::PacketFilter(false),
        Command::FrameStream(false),
        Command::BufferMode(false),
        Command::DownSample(DownSampling::NONE),
        Command::VirtualWindow(None),
        Command::TrackInvert(false),
        Command::PixelDifference(false),
        Command::NoiseFilter(2),
    ]
}

/// Restarts without a packet in between after which the camera is given up.
const RESTARTS: u8 = 5;

/// Result of waiting for a packet.
enum Look {
    Packet(Tracking),
    /// Nothing came, and that is right.
    Quiet,
    /// The camera restarted, and tracks again.
    Restarted,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match probe(arguments) {
        Err(error) if is_interruption(&error) => {
            tell("interrupted");
            Ok(ExitCode::from(INTERRUPTED))
        }
        done => done.map(|()| ExitCode::SUCCESS),
    }
}

fn is_interruption(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(PortError::Interrupted))
}

fn probe(arguments: &Arguments) -> anyhow::Result<()> {
    arguments.check_kind()?;
    if arguments.kind == KindOption::Cmucam2 {
        arguments.baud.of_jumpers().map_err(anyhow::Error::msg)?;
    }
    // What is wrong with a file is told before anyone waits for the camera.
    Files::default()
        .reads(&arguments.port)
        .writes(&arguments.frame)
        .writes(&arguments.record)
        .check()?;
    let recording = match &arguments.record {
        Some(path) => Some((
            path.as_path(),
            Recording::open(
                path,
                arguments.camera.camera::<f64>(USUAL_COLUMNS)?.is_some(),
            )?,
        )),
        None => None,
    };
    let person = Person::new()?;
    if let Some(model) = pixy::model(arguments.kind) {
        return pixy::run(arguments, model, person, recording);
    }
    let mut bench = Bench::begin(arguments, person)?;
    let done = bench.work(recording);
    // Ctrl-C has ended the work; the rest is needed in any case.
    bench.person.interrupted().store(false, Ordering::Relaxed);
    let stopped = bench.ask(|camera| camera.stop().wait());
    done.and(stopped)
}

impl Arguments {
    /// Refuses options that mean nothing for this kind of camera.
    fn check_kind(&self) -> anyhow::Result<()> {
        let is_cmucam2 = self.kind == KindOption::Cmucam2;
        let is_tags = self.kind == KindOption::OpenMvTags;
        let only = "is for a CMUcam2";
        for (is_given, has_use, option, why) in [
            (self.frame.is_some(), is_cmucam2, "--frame", only),
            (self.colour.is_some(), is_cmucam2, "--colour", only),
            (self.high_res, is_cmucam2, "--high-res", only),
            (
                self.first_column.is_some(),
                is_cmucam2,
                "--first-column",
                only,
            ),
            (self.settle.is_some(), is_cmucam2, "--settle", only),
            (self.as_is, is_cmucam2, "--as-is", only),
            (
                self.tag.is_some(),
                is_tags,
                "--tag",
                "is for an OpenMV Cam that finds tags, --camera openmv-tags",
            ),
            (
                self.signature.is_some(),
                !is_cmucam2 && !is_tags,
                "--signature",
                "is for cameras that were taught colours, --camera pixy2, pixy or openmv",
            ),
        ] {
            ensure!(!is_given || has_use, "{option} {why}: leave it out");
        }
        Ok(())
    }

    /// Name of the line.
    fn line(&self) -> &str {
        self.port.as_deref().unwrap_or("the emulated camera")
    }

    fn open(&self, baud_rate: u32, person: &Person) -> anyhow::Result<Port> {
        Ok(match &self.port {
            Some(path) => Port::open(path, baud_rate, person.interrupted())?,
            None => {
                let wire = emulated::wire(self.kind, &self.emulate, baud_rate)?;
                Port::on(wire, person.interrupted())
            }
        })
    }
}

impl<'a> Bench<'a> {
    /// Opens the port and finds out what is there.
    fn begin(arguments: &'a Arguments, person: Person) -> anyhow::Result<Self> {
        let (port, baud_rate) = connect(arguments, &person)?;
        let (heard, clock) = (port.heard(), port.clock());
        let mut bench = Self {
            arguments,
            heard,
            camera: port::device(port),
            clock,
            baud_rate,
            frame: Size::LARGEST,
            view: View::new(
                USUAL_COLUMNS,
                arguments.first_column.unwrap_or(USUAL_FIRST),
                None,
            ),
            person,
            is_known: false,
            restarts: 0,
            packets: 0,
            contradicted: false,
        };
        let mut version = bench.camera.version().wait();
        if let Err(Error::Camera(Fault::Silence)) = version {
            // It may have been switched on this second.
            version = bench.camera.version().wait();
        }
        if let Err(Error::Camera(
            Fault::Garbage | Fault::Restarted | Fault::Refused { .. } | Fault::Unexpected { .. },
        )) = version
        {
            // Other programs leave it in a raw mode. A banner without ACK looks like a restart.
            let left = port::leave_raw_modes(bench.camera).map_err(Error::Uart);
            bench.camera = left.map_err(|error| failed(arguments.line(), baud_rate, error))?;
            version = bench.camera.version().wait();
        }
        let version = version.map_err(|error| bench.not_a_camera(error))?;
        bench.is_known = true;
        let banner = version.banner();
        tell(format_args!(
            "{} ({}) at {baud_rate} baud on {}",
            String::from_utf8_lossy(banner.as_bytes()),
            sensor_name(version.sensor()),
            arguments.line()
        ));
        if let Some(banner) = stranger::kindred_banner(&bench.heard.bytes()) {
            tell(format_args!(
                "warning: it calls itself `{banner}`, not CMUcam2 v1: firmware of others, whose \
                 packets and commands may differ"
            ));
        }
        bench.prepare(version.sensor())?;
        Ok(bench)
    }

    /// Starts the camera up and sets the resolution.
    fn prepare(&mut self, sensor: Option<Sensor>) -> anyhow::Result<()> {
        let high = self.arguments.high_res;
        if high && sensor == Some(Sensor::Ov7620) {
            bail!("the OV7620 has no high resolution: leave --high-res out");
        }
        // Told before the camera starts up, which takes a while.
        let expected = Size::of(sensor.unwrap_or(Sensor::Ov6620), high);
        let optics = match sensor {
            Some(_) => self.arguments.camera.of_live(expected.width.into())?,
            None => self.arguments.camera.camera(expected.width.into())?,
        };
        if self.arguments.as_is {
            for mode in as_after_reset() {
                self.ask(|camera| camera.set(mode).wait())?;
            }
        } else {
            let settle = self.arguments.settle.unwrap_or(USUAL_SETTLE);
            let adapting = spinner(format!(
                "the camera resets and adapts to the light for {settle} s"
            ));
            let mut start_up = StartUp::default();
            start_up.adapt_ms = (settle * 1e3) as u32;
            self.ask(|camera| camera.start_up(start_up).wait())?;
            adapting.finish_and_clear();
        }
        // It may be on from an earlier run.
        if high || self.arguments.as_is && sensor != Some(Sensor::Ov7620) {
            self.ask(|camera| camera.set(Command::HighResolution(high)).wait())?;
        }
        self.frame = match sensor {
            Some(_) => self.camera.session().frame(),
            None => expected,
        };
        let usual = u16::from(self.frame.width);
        let columns = self.arguments.camera.columns().unwrap_or(usual);
        if sensor.is_none() && self.arguments.camera.columns().is_none() {
            tell(format_args!(
                "the banner does not name a known sensor: {columns} columns are assumed, see \
                 --columns"
            ));
        }
        self.view = View::new(columns, self.first_number()?, optics).with_rows(Rows {
            count: self.frame.height.into(),
            per_column: ROWS_PER_COLUMN,
        });
        Ok(())
    }

    /// The number of the first column and row: the first row is the least in the whole view.
    fn first_number(&mut self) -> anyhow::Result<u8> {
        if let Some(first) = self.arguments.first_column {
            return Ok(first);
        }
        if self.arguments.as_is {
            return Ok(USUAL_FIRST);
        }
        let seen = self.ask(|camera| {
            camera.track_colour(ColourBounds::ALL).wait()?;
            let seen = camera.next_tracking().wait()?;
            camera.stop().wait()?;
            Ok(seen)
        })?;
        let found = seen.and_then(|seen| seen.bounding_box());
        let first = found.map(|found| found.y1).filter(|&first| first <= 1);
        Ok(first.unwrap_or(USUAL_FIRST))
    }

    fn work(&mut self, recording: Option<(&Path, Recording)>) -> anyhow::Result<()> {
        if let Some(path) = &self.arguments.frame {
            return self.picture(path);
        }
        let bounds = self.bounds()?;
        match recording {
            Some((path, mut recording)) => {
                let mut camera = stops::Tracking {
                    bench: self,
                    bounds,
                };
                stops::run(&mut camera, &mut recording, path)
            }
            None => {
                self.ask(|camera| camera.track_colour(bounds).wait())?;
                live::run(self)
            }
        }
    }

    /// The colour to track: given, still known to the camera, or learnt.
    fn bounds(&mut self) -> anyhow::Result<ColourBounds> {
        if let Some(bounds) = self.arguments.colour {
            return Ok(bounds);
        }
        let bounds = if self.arguments.as_is {
            self.ask(|camera| camera.tracking_bounds().wait())?
        } else {
            if Person::is_there() {
                let question = "Put the object into the middle of the view and press Enter.";
                self.person.line(question)?;
            }
            let learning = spinner("learning the colour in the middle of the view");
            let learnt = self.ask(|camera| camera.learn(Learn::default()).wait());
            learning.finish_and_clear();
            self.best_of(learnt?)?
        };
        let [red_min, red_max, green_min, green_max, blue_min, blue_max] = bounds.values();
        tell(format_args!(
            "tracks red {red_min} to {red_max}, green {green_min} to {green_max}, blue {blue_min} \
             to {blue_max}: --colour {}",
            option(bounds)
        ));
        Ok(bounds)
    }

    /// The bounds that were learnt, or better ones; refused where the background has their colour.
    fn best_of(&mut self, bounds: ColourBounds) -> anyhow::Result<ColourBounds> {
        let looking = spinner("looking how much of the background has this colour");
        let (frame, first) = (self.frame, self.view.first());
        let judged = self.ask(|camera| colour::judge(camera, bounds, (frame, first)));
        looking.finish_and_clear();
        let Judged { background, best } = judged?;
        let best = match best {
            Ok(best) => best,
            Err(VisionError::CommonColour(share)) => bail!(
                "{share} of the background has this colour, and no narrower one tells the object \
                 from it: try another light or object, take away what else has the colour, or give \
                 --colour {} to track it all the same",
                option(bounds)
            ),
            Err(error) => bail!(
                "{error}; or give --colour {} to track it all the same",
                option(bounds)
            ),
        };
        if background == BackgroundShare::NONE {
            tell("nothing in the background has this colour");
            if best.bounds != bounds {
                tell(
                    "only a part of the object has it, so wider bounds are taken that hold all of it",
                );
            }
        } else if best.background < background {
            tell(format_args!(
                "{background} of the background has this colour ({}), so a narrower one is taken: \
                 {} of the background and {:.0} % of the object have that",
                option(bounds),
                best.background,
                best.kept * 1e2
            ));
        } else {
            tell(format_args!(
                "warning: {background} of the background has this colour, and will be taken for \
                 the object"
            ));
        }
        Ok(best.bounds)
    }

    fn look(&mut self) -> anyhow::Result<Look> {
        match self.camera.next_tracking().wait() {
            Ok(Some(tracking)) => {
                self.restarts = 0;
                self.packets += 1;
                Ok(Look::Packet(tracking))
            }
            Ok(None) => Ok(Look::Quiet),
            Err(Error::Camera(Fault::Restarted)) if self.restarts < RESTARTS => {
                self.restarts += 1;
                Ok(Look::Restarted)
            }
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Remark for a person about this packet beyond its numbers.
    fn remark(&mut self, tracking: &Tracking) -> Option<String> {
        let first_look = self.packets == 1;
        if let Some(first) = self.view.contradiction(tracking)
            && !self.contradicted
        {
            self.contradicted = true;
            return Some(format!(
                "this camera counts columns from {first}: give --first-column {first}"
            ));
        }
        let doubt = first_look.then(|| doubt(tracking, &self.view))?;
        doubt.map(str::to_owned)
    }

    fn picture(&mut self, path: &Path) -> anyhow::Result<()> {
        let rows = messages::bar(0, "row {pos} of {len} {wide_bar} {eta} left");
        let progress = |row: usize, of: usize| {
            rows.set_length(of as u64);
            rows.set_position(row as u64);
        };
        let taken = self.ask(|camera| picture::take(camera, progress));
        rows.finish_and_clear();
        let picture = taken?;
        let (columns, rows) = picture.size();
        let damaged = picture.damaged();
        let told = format!(
            "{damaged} of {rows} rows were damaged on the line; a lower rate or a shorter cable helps"
        );
        if damaged > rows / 2 {
            bail!("{}: {told}; no picture is left", self.arguments.line());
        }
        if damaged > 0 {
            tell(told);
        }
        whole_file::write(path, picture.png()?)?;
        if self.arguments.json {
            let file = path.display().to_string();
            let line = serde_json::json!({
                "file": file, "columns": columns, "rows": rows, "damaged_rows": damaged,
            });
            writeln!(io::stdout(), "{line}")?;
        } else {
            writeln!(
                io::stdout(),
                "{columns} x {rows} pixels -> {}",
                path.display()
            )?;
        }
        Ok(())
    }

    /// Describes what answers, if it is not a camera.
    fn not_a_camera(&self, error: Error<PortError>) -> anyhow::Error {
        let heard = self.heard.bytes();
        match error {
            Error::Camera(Fault::Garbage | Fault::Refused { .. } | Fault::Unexpected { .. }) => {
                match stranger::name(&heard) {
                    Some(who) => {
                        let rate = self.baud_rate;
                        let stranger = Overheard { rate, heard, who };
                        anyhow!("{}: {stranger}", self.arguments.line())
                    }
                    None => self.failed(error),
                }
            }
            _ => self.failed(error),
        }
    }

    /// Has the camera do something. A failure is told with what to check.
    fn ask<T>(
        &mut self,
        call: impl FnOnce(&mut Device) -> Result<T, Error<PortError>>,
    ) -> anyhow::Result<T> {
        call(&mut self.camera).map_err(|error| self.failed(error))
    }

    fn failed(&self, error: Error<PortError>) -> anyhow::Error {
        let why = match error {
            Error::Camera(Fault::Silence) if self.is_known => fell_silent(self.packets),
            Error::Camera(Fault::Garbage) if self.is_known => garbled_since(self.packets),
            error => return failed(self.arguments.line(), self.baud_rate, error),
        };
        anyhow!("{}: {why}", self.arguments.line())
    }
}

/// Opens the port, and finds the camera's rate if it is not given.
fn connect(arguments: &Arguments, person: &Person) -> anyhow::Result<(Port, u32)> {
    let (rate, is_known) = match arguments.baud {
        Baud::Rate(rate) => (rate, true),
        Baud::Auto => (port::BAUD_RATES[0], false),
    };
    let port = arguments.open(rate, person)?;
    if is_known {
        return Ok((port, rate));
    }
    tell_search(arguments, "CMUcam2", &port::BAUD_RATES);
    let trying = spinner("");
    // Bytes that the camera already sends would be taken for garbage at every rate but its own.
    let port = match port::quieten(port, || trying.set_message(BUSY)) {
        Ok(Ok(port)) => port,
        Ok(Err(stranger)) => return Err(anyhow!("{}: {stranger}", arguments.line())),
        Err(error) => return Err(failed(arguments.line(), rate, Error::Uart(error))),
    };
    let found = port::find_baud_rate(port, |rate| trying.set_message(format!("{rate} baud?")));
    trying.finish_and_clear();
    let why = match found {
        Ok(Search::Found(port, rate)) => return Ok((port, rate)),
        Ok(Search::Garbage) => no_baud_rate(true),
        Ok(Search::Stranger(stranger)) => stranger.to_string(),
        Ok(Search::Silence) => no_baud_rate(false),
        Err(error) => return Err(failed(arguments.line(), rate, error)),
    };
    Err(anyhow!("{}: {why}", arguments.line()))
}

/// Tells what a search does, which takes a while where nothing answers.
fn tell_search(arguments: &Arguments, camera: &str, rates: &[u32]) {
    let rates: Vec<_> = rates.iter().map(u32::to_string).collect();
    tell(format_args!(
        "{}: looking for a {camera} at {} baud",
        arguments.line(),
        rates.join(", ")
    ));
}

/// While the line is not silent.
const BUSY: &str =
    "something is being sent; a frame that is under way takes 40 s at 9600 baud, and is waited for";

/// Describes what failed, and what to check.
fn failed(port: &str, baud_rate: u32, error: Error<PortError>) -> anyhow::Error {
    match error {
        Error::Uart(PortError::Interrupted) => PortError::Interrupted.into(),
        error => anyhow!("{port}: {}", advice(&error, baud_rate)),
    }
}

/// Shows on a terminal that something is under way.
fn spinner(message: impl Into<Cow<'static, str>>) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(message);
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

/// Bounds as `--colour` takes them.
fn option(bounds: ColourBounds) -> String {
    bounds.values().map(|level| level.to_string()).join(",")
}

fn parse_colour(text: &str) -> Result<ColourBounds, String> {
    const NEEDED: &str = "six levels are needed: Rmin,Rmax,Gmin,Gmax,Bmin,Bmax";
    let levels: Result<Vec<u8>, _> = text.split(',').map(|level| level.trim().parse()).collect();
    let levels = levels.ok().and_then(|levels| levels.try_into().ok());
    ColourBounds::new(levels.ok_or(NEEDED)?).map_err(|error| error.to_string())
}
