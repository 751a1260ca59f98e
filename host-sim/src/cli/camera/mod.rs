//! `host-sim camera`

use std::{
    fmt::Display,
    fs,
    path::PathBuf,
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};
use cmucam2_emulator::{
    BAUD_RATES, Background, Configuration, Emulator, FaultRates, Note, Scene, SceneError, Sensor,
    Setting, Switches, Time,
};
use pixy_emulator::Model;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};

use self::{carried::Carried, film::Film, line::Line};
use super::{OfFile, pseudo_terminal::PseudoTerminal, tell, values};

mod carried;
pub(super) mod emulated;
mod film;
mod line;
mod pixy;

/// A CMUcam2, a Pixy or an OpenMV Cam on a pseudo-terminal or a serial port, for any program or board that talks to one.
///
/// It answers to the commands of the camera and sees a moving scene, or video of any camera. A
/// program opens PATH like a serial port; the rate that it sets there must be the camera's, or both
/// get garbage, as on a real line. A program that sets no rate is understood.
#[derive(Args)]
#[command(after_long_help = epilogue())]
#[command(group(clap::ArgGroup::new("line").required(true).args(["pty", "port"])))]
pub(super) struct Arguments {
    /// Where programs find the camera: a link to the pseudo-terminal, removed at the end.
    #[arg(long, value_name = "PATH")]
    pty: Option<PathBuf>,
    /// A real serial port on whose line the camera is, such as /dev/serial0.
    #[arg(long, value_name = "DEVICE")]
    port: Option<String>,
    /// Scene that the camera sees [default: an orange ball or tag 0, held in front of a grey room].
    #[arg(long, value_name = "FILE.toml", conflicts_with = "video")]
    scene: Option<PathBuf>,
    /// Video that the camera sees, as YUV4MPEG2; `-` is the standard input. See below.
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Model of the camera.
    #[arg(long, value_enum, default_value_t)]
    kind: KindOption,
    /// A colour that a Pixy or an OpenMV Cam was taught, signature 1 first; may be repeated [default: 225,110,35].
    #[arg(long, value_name = "R,G,B")]
    taught: Vec<pixy::Taught>,
    /// The rate that the camera's jumpers select [default: 115200], or that was set in another
    /// camera [default: 19200].
    #[arg(long, value_name = "N", value_parser = values::whole(1, u32::MAX))]
    baud: Option<u32>,
    /// Understand the other program whatever rate it sets.
    #[arg(long)]
    any_baud: bool,
    /// The sensor on the board of a CMUcam2 [default: ov6620].
    #[arg(long, value_enum)]
    sensor: Option<SensorOption>,
    /// Of noise and faults.
    #[arg(
        long, value_name = "N", default_value_t = 0, value_parser = values::seed
    )]
    seed: u64,
    /// Something that the protocol leaves open; see below. May be repeated.
    #[arg(long, value_name = "NAME=N")]
    switch: Vec<String>,
    /// Something that goes wrong, with its probability; see below. May be repeated.
    #[arg(long, value_name = "NAME=RATE")]
    fault: Vec<String>,
    /// Tell which commands come, and what else happens.
    #[arg(long, short)]
    verbose: bool,
}

/// Model of a camera.
#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
pub(super) enum KindOption {
    /// 88 or 160 columns, colours are learnt by command.
    #[default]
    Cmucam2,
    /// 316 columns, colours were taught beforehand.
    Pixy2,
    /// The original: 320 columns; streams.
    Pixy,
    /// An OpenMV Cam with `pixy_uart_emulation.py`: 320 columns; streams.
    #[value(name = "openmv")]
    OpenMv,
    /// An OpenMV Cam with `apriltags_pixy_uart_emulation.py`: 160 columns; streams tags.
    #[value(name = "openmv-tags")]
    OpenMvTags,
}

impl KindOption {
    /// The emulator's model, of all but a CMUcam2.
    const fn model(self) -> Option<Model> {
        match self {
            Self::Cmucam2 => None,
            Self::Pixy2 => Some(Model::Pixy2),
            Self::Pixy => Some(Model::Pixy),
            Self::OpenMv => Some(Model::OpenMv),
            Self::OpenMvTags => Some(Model::OpenMvTags),
        }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum SensorOption {
    /// 88 x 143 pixels, 176 x 255 in high resolution.
    #[default]
    Ov6620,
    /// 160 x 239 pixels.
    Ov7620,
}

/// One line for each; a default of 0 goes without saying.
fn table<T: Display + Default + PartialEq>(settings: &[Setting<T>]) -> String {
    settings
        .iter()
        .map(|setting| {
            let default = if setting.default == T::default() {
                String::new()
            } else {
                format!(" [default: {}]", setting.default)
            };
            let meaning = setting.meaning.trim();
            format!("  {:<19} {meaning}{default}\n", setting.name)
        })
        .collect()
}

/// The built-in scene, which is also the example of the format.
const USUAL_SCENE: &str = include_str!("../../../../host/cmucam2-emulator/scenes/orange-ball.toml");

fn epilogue() -> String {
    format!(
        "Switches (--switch NAME=N), 0 unless said:\n{}\n\
         Faults (--fault NAME=RATE), from 0 to 1:\n{}\n{EPILOGUE}",
        table(Switches::TABLE),
        table(FaultRates::TABLE),
    )
}

const EPILOGUE: &str = "\
Scenes (--scene FILE.toml):
  light               colour of the light, three factors [default: white]
  noise               standard deviation of each pixel, levels [default: 0]
  flicker             change of the light from frame to frame, a fraction [default: 0]
  [camera]            fov_deg; distortion = [k1, k2]; x, y, height, heading_deg; servo_step_deg: how far one
                      step of the pan servo turns it
  [background]        plain = COLOUR, or gradient = { top, bottom }, or
                      blocks = { columns, rows, colours }
  [[object]]          from back to front: colour, shape (\"disc\", \"box\" or { tag = N }), repeat, and stops,
                      each with at (seconds) and one of
                        picture = [x, y], size                 fractions of the picture
                        bearing_deg, elevation_deg, size_deg   positive to the left and upwards
                        x, y, height, radius                   in the world
  A size is one number above 0, or [width, height]; a COLOUR is [red, green, blue], 0 to 255.
  Examples are in host/cmucam2-emulator/scenes: orange-ball.toml, which is the default, with a smaller ball or a
  tag before other cameras than a CMUcam2, and rolling-ball.toml.

Video (--video FILE):
  Anything that ffmpeg reads: a recording, a webcam, a Raspberry Pi's camera, an IP camera. All of
  each picture is scaled to the camera's frame, so the field of view is that of the video's width.
  Automatic gain and white balance work on it as on a scene. A file is shown at its rate from the
  start on, and its last picture stays; of what comes through a pipe, the newest picture counts.
    ffmpeg -i room.mp4 -pix_fmt yuv420p room.y4m        a recording, to be shown with --video room.y4m
    ffmpeg -f v4l2 -i /dev/video0 -pix_fmt yuv420p -f yuv4mpegpipe - | \\
      host-sim camera --video - --pty cmucam            a webcam, as a CMUcam2

Signals: SIGUSR1 switches the camera off and on.

Examples:
  host-sim camera --pty cmucam --verbose
  host-sim camera --pty cmucam --baud 38400 --fault nck=0.02 --fault corrupt_line=0.2
  host-sim camera --pty cmucam --switch origin=0 --switch bounds_order=1
  host-sim camera --kind pixy2 --pty pixy
  host-sim camera --kind openmv-tags --pty openmv
  host-sim camera --port /dev/serial0 --baud 38400 --video room.y4m";

const SECOND: Time = 1_000_000_000;
/// Start bit, eight data bits, stop bit.
const BYTE_BITS: Time = 10;
/// The longest time without a look at the signals.
const PATIENCE: Duration = Duration::from_millis(50);

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let configuration = arguments.configuration()?;
    let scene = arguments.scene(configuration.sensor)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let power = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGUSR1, Arc::clone(&power))?;
    let film = arguments.video.as_deref().map(Film::open).transpose()?;
    if let Some(model) = arguments.kind.model() {
        pixy::run(arguments, model, scene, film.as_ref(), (&stop, &power))?;
        return Ok(ExitCode::SUCCESS);
    }
    let line = arguments.line()?;
    arguments.tell_where("CMUcam2", &line);
    let mut camera = RealTime {
        carried: Carried::new(Emulator::new(configuration, scene), arguments.baud()),
        film,
        line,
        start: Instant::now(),
        arguments,
        losing: false,
    };
    while !stop.load(Ordering::Relaxed) {
        if power.swap(false, Ordering::Relaxed) {
            let now = camera.now();
            camera.carried.camera.power_cycle(now);
        }
        camera.step()?;
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    /// Refuses options that mean nothing for this kind of camera.
    fn check_kind(&self) -> anyhow::Result<()> {
        let is_cmucam2 = self.kind == KindOption::Cmucam2;
        let has_colours = !is_cmucam2 && self.kind != KindOption::OpenMvTags;
        let only = "is for a CMUcam2";
        for (is_given, has_use, option, why) in [
            (self.sensor.is_some(), is_cmucam2, "--sensor", only),
            (!self.switch.is_empty(), is_cmucam2, "--switch", only),
            (!self.fault.is_empty(), is_cmucam2, "--fault", only),
            (
                !self.taught.is_empty(),
                has_colours,
                "--taught",
                "is for cameras that are taught colours beforehand, --kind pixy2, pixy or openmv",
            ),
        ] {
            ensure!(!is_given || has_use, "{option} {why}: leave it out");
        }
        Ok(())
    }

    fn configuration(&self) -> anyhow::Result<Configuration> {
        self.check_kind()?;
        ensure!(
            self.kind != KindOption::Cmucam2 || BAUD_RATES.contains(&self.baud()),
            "--baud {}: a CMUcam2 knows {}",
            self.baud(),
            BAUD_RATES.map(|rate| rate.to_string()).join(", ")
        );
        let mut switches = Switches::default();
        for switch in &self.switch {
            switches
                .set_from(switch)
                .with_context(|| format!("--switch {switch}"))?;
        }
        let mut faults = FaultRates::default();
        for fault in &self.fault {
            faults
                .set_from(fault)
                .with_context(|| format!("--fault {fault}"))?;
        }
        Ok(Configuration {
            sensor: match self.sensor.unwrap_or_default() {
                SensorOption::Ov6620 => Sensor::Ov6620,
                SensorOption::Ov7620 => Sensor::Ov7620,
            },
            baud: self.baud(),
            host_baud: self.baud(),
            switches,
            faults,
            seed: self.seed,
            watched: self.verbose,
        })
    }

    fn baud(&self) -> u32 {
        self.baud.unwrap_or(match self.kind {
            KindOption::Cmucam2 => 115_200,
            _ => pixy::BAUD,
        })
    }

    fn tell_where(&self, camera: &str, line: &Line) {
        tell(format_args!(
            "a {camera} at {} baud is on {}",
            self.baud(),
            match &self.pty {
                Some(link) => format!("{} ({line})", link.display()),
                None => line.to_string(),
            }
        ));
    }

    /// The other program may set another rate than the known one at any time, which matters unless
    /// --any-baud is given.
    fn other_rate(&self, line: &Line, known: u32) -> anyhow::Result<Option<u32>> {
        let baud = line.baud()?.filter(|baud| *baud != known && *baud != 0);
        let Some(baud) = baud.filter(|_| !self.any_baud) else {
            return Ok(None);
        };
        if baud != self.baud() {
            tell(format_args!(
                "the other program has set {baud} baud, the camera has {}: both will get garbage",
                self.baud()
            ));
        }
        Ok(Some(baud))
    }

    fn line(&self) -> anyhow::Result<Line> {
        match (&self.pty, &self.port) {
            (Some(link), _) => Ok(Line::Terminal(PseudoTerminal::open(link, self.baud())?)),
            (None, Some(port)) => Line::port(port, self.baud()),
            (None, None) => bail!("--pty or --port is needed"),
        }
    }

    fn scene(&self, sensor: Sensor) -> anyhow::Result<Scene> {
        if self.video.is_some() {
            return Ok(Scene::default());
        }
        let Some(path) = &self.scene else {
            // Pictures of a Pixy are flat; a CMUcam2 learns the colour of half the view.
            let small = || USUAL_SCENE.replace("radius = 0.2", "radius = 0.15");
            let usual = match self.kind {
                KindOption::Cmucam2 => USUAL_SCENE.to_owned(),
                // Its script finds no balls.
                KindOption::OpenMvTags => small().replace("\"disc\"", "{ tag = 0 }"),
                KindOption::Pixy2 | KindOption::Pixy | KindOption::OpenMv => small(),
            };
            return Ok(self.scene_of(&usual, sensor)?);
        };
        let name = path.display();
        let text = fs::read_to_string(path).with_context(|| OfFile::unread(path))?;
        match self.scene_of(&text, sensor) {
            Ok(scene) => Ok(scene),
            Err(error) => bail!("{name} is no scene: {error}"),
        }
    }
}

impl Arguments {
    fn scene_of(&self, text: &str, sensor: Sensor) -> Result<Scene, SceneError> {
        match self.kind.model() {
            None => Scene::from_toml(text, sensor),
            Some(model) => Scene::of_frame(text, model.size(), 1.0),
        }
    }
}

/// The emulator on the clock.
struct RealTime<'a> {
    carried: Carried<Emulator>,
    /// Video that takes the place of the scene.
    film: Option<Film>,
    line: Line,
    start: Instant,
    arguments: &'a Arguments,
    /// The other program does not read fast enough.
    losing: bool,
}

impl RealTime<'_> {
    fn now(&self) -> Time {
        // 584 years.
        self.start.elapsed().as_nanos() as Time
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let now = self.now();
        let wait = match self.carried.next() {
            Some(at) => Duration::from_nanos(at.saturating_sub(now)).min(PATIENCE),
            None => PATIENCE,
        };
        let received = self.line.receive(wait)?;
        let known = self.carried.host_baud();
        if let Some(baud) = self.arguments.other_rate(&self.line, known)? {
            self.carried.set_host_baud(baud);
        }
        if let Some(picture) = self.film.as_ref().map(Film::take).transpose()?.flatten() {
            self.carried.camera.scene_mut().background = Background::Picture(picture);
        }
        let now = self.now();
        // Bytes come in one piece, but a line carries them one after the other.
        self.carried.hear(&received, now);
        let sent = self.carried.advance(now);
        let lost = self.line.send(&sent)?;
        if lost > 0 && !self.losing && self.arguments.verbose {
            tell("the other program does not read fast enough: bytes are lost");
        }
        self.losing = lost > 0;
        while let Some(note) = self.carried.camera.take_note() {
            self.tell(&note);
        }
        Ok(())
    }

    fn tell(&self, note: &Note) {
        let seconds = self.start.elapsed().as_secs_f64();
        match note {
            Note::Command(command) => {
                tell(format_args!("{seconds:9.3} {command}"));
            }
            Note::Refused { line, why } => {
                let line = line.escape_ascii();
                tell(format_args!("{seconds:9.3} refused `{line}`: {why}"));
            }
            Note::Stopped => tell(format_args!("{seconds:9.3} stopped")),
            Note::Started { alive: true } => tell(format_args!("{seconds:9.3} started")),
            Note::Started { alive: false } => tell(format_args!(
                "{seconds:9.3} does not start; SIGUSR1 switches it off and on"
            )),
            Note::Fault(name) => tell(format_args!("{seconds:9.3} fault: {name}")),
            Note::Packet { .. } => {}
        }
    }
}
