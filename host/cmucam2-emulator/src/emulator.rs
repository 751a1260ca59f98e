//! The camera as a state machine: bytes and times in, bytes and times out.

mod commands;
mod picture;
mod streams;
mod talk;

use std::collections::VecDeque;

use super::{
    command::{Command, RawInput},
    differencing::Grid,
    faults::{FaultRates, Faults},
    framing::Framing,
    light::Light,
    modes::Modes,
    packet::Packet,
    scene::Scene,
    sensor::Sensor,
    switches::Switches,
    view::Snapshot,
    wire::Wire,
};

/// Nanoseconds since the camera was made.
pub type Time = u64;

const MILLISECOND: Time = 1_000_000;
/// Unit of the switch for the time that a reset takes.
const BOOT_UNIT: Time = 100 * MILLISECOND;
/// Time for which a camera that falls silent is silent.
const SILENCE: Time = 3_000 * MILLISECOND;

/// Set-up of a camera.
#[derive(Clone, Debug)]
pub struct Configuration {
    /// Its sensor.
    pub sensor: Sensor,
    /// The rate that its jumpers select.
    pub baud: u32,
    /// The rate at which the host listens and sends.
    pub host_baud: u32,
    /// Variants of the camera that the sources leave open.
    pub switches: Switches,
    /// Rates of faults.
    pub faults: FaultRates,
    /// Seed of faults and noise.
    pub seed: u64,
    /// Keep [notes](Emulator::take_note).
    pub watched: bool,
}

impl Default for Configuration {
    /// An OV6620 at 115200 baud without faults.
    fn default() -> Self {
        Self {
            sensor: Sensor::Ov6620,
            baud: 115_200,
            host_baud: 115_200,
            switches: Switches::default(),
            faults: FaultRates::default(),
            seed: 0,
            watched: false,
        }
    }
}

/// Something that a watcher may want to know.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// A command was obeyed.
    Command(Command),
    /// A line was refused.
    Refused {
        /// The line.
        line: Vec<u8>,
        /// Reason for the refusal.
        why: String,
    },
    /// The host stopped a stream.
    Stopped,
    /// The camera has started, or failed to.
    Started {
        /// True if it works.
        alive: bool,
    },
    /// A packet was put on the line, before any damage there.
    Packet {
        /// It.
        packet: Packet,
        /// Time when its last byte will be over.
        end: Time,
    },
    /// A fault was injected.
    Fault(&'static str),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Colour,
    Difference(u8),
    Mean,
    Histogram(u8),
}

#[derive(Clone, Copy, Debug)]
struct Stream {
    source: Source,
    /// Time when the next packet is ready.
    next_at: Time,
    /// One packet, then the prompt.
    single: bool,
    /// The colour in the middle is to be learned first, give or take so much.
    learn: Option<u8>,
    /// The last packet was empty; nothing is known before the first.
    lost: Option<bool>,
}

#[derive(Clone, Debug)]
struct Dump {
    snapshot: Snapshot,
    channel: Option<u8>,
    /// The row to be sent next; `None` before the header.
    row: Option<u8>,
    next_at: Time,
    /// The host wants it to stop.
    stopped: bool,
}

#[derive(Clone, Debug)]
enum Activity {
    /// It waits for a command.
    Command,
    /// It does not start.
    Dead,
    Boot {
        at: Time,
        /// It does not say so.
        quietly: bool,
        /// Bytes that came meanwhile.
        early: Vec<u8>,
    },
    Silent {
        until: Time,
    },
    Stream(Stream),
    Dump(Box<Dump>),
    Upload {
        blocks: [u8; 64],
        len: usize,
    },
    Sleep {
        deep: bool,
    },
    Waking {
        at: Time,
    },
}

/// A CMUcam2. See the [module](super).
#[derive(Clone, Debug)]
pub struct Emulator {
    configuration: Configuration,
    scene: Scene,
    modes: Modes,
    light: Light,
    faults: Faults,
    wire: Wire,
    /// Bytes as the host hears them, if it listens at another rate.
    to_host: Option<Framing>,
    from_host: Option<Framing>,
    line: Vec<u8>,
    raw_input: RawInput,
    activity: Activity,
    /// The earliest time at which an answer can begin.
    answer_at: Time,
    /// In buffer mode.
    held: Option<Snapshot>,
    reference: Grid,
    masked: Vec<bool>,
    /// The last packet of the stream, as text; it is on its way once the stream was stopped.
    last_packet: Vec<u8>,
    is_late: bool,
    button: bool,
    inputs: u8,
    notes: VecDeque<Note>,
}

impl Emulator {
    /// A camera that is switched on at time 0.
    pub fn new(configuration: Configuration, scene: Scene) -> Self {
        let mut emulator = Self {
            modes: Modes::new(configuration.sensor),
            light: Light::new(0),
            faults: Faults::new(&configuration.faults, configuration.seed),
            wire: Wire::new(configuration.baud),
            to_host: None,
            from_host: None,
            line: Vec::new(),
            raw_input: RawInput::default(),
            activity: Activity::Command,
            answer_at: 0,
            held: None,
            reference: Grid::dark(false),
            masked: Vec::new(),
            last_packet: Vec::new(),
            is_late: false,
            button: false,
            inputs: 0,
            notes: VecDeque::new(),
            scene,
            configuration,
        };
        emulator.set_host_baud(emulator.configuration.host_baud);
        emulator.power_cycle(0);
        emulator
    }

    /// Returns the scene before the camera.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene before the camera, to be changed. It takes effect with the next frame.
    pub fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// Returns the light that the sensor has adapted to.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// Presses the button: the next `GB` answers 1.
    pub fn press_button(&mut self) {
        self.button = true;
    }

    /// The four auxiliary inputs, one bit each.
    pub fn set_inputs(&mut self, inputs: u8) {
        self.inputs = inputs & 0x0F;
    }

    /// The host changes its rate.
    pub fn set_host_baud(&mut self, baud: u32) {
        self.configuration.host_baud = baud;
        self.to_host = Framing::new(self.configuration.baud, baud);
        self.from_host = Framing::new(baud, self.configuration.baud);
    }

    /// Other faults from now on, with the same seed as before.
    pub fn set_faults(&mut self, rates: &FaultRates) {
        self.configuration.faults = *rates;
        self.faults = Faults::new(rates, self.configuration.seed);
    }

    /// The supply drops for a moment: the camera starts anew, and says so unless its banner is
    /// lost.
    pub fn brown_out(&mut self, now: Time, quietly: bool) {
        self.advance(now);
        self.restart(now, quietly);
    }

    /// Switches the power off and on.
    pub fn power_cycle(&mut self, now: Time) {
        self.advance(now);
        self.forget(now);
        if self.faults.dead_start.strikes() {
            self.note(|| Note::Fault("dead_start"));
            self.note(|| Note::Started { alive: false });
            self.activity = Activity::Dead;
        } else {
            self.restart(now, false);
        }
    }

    fn restart(&mut self, now: Time, quietly: bool) {
        self.forget(now);
        self.activity = Activity::Boot {
            at: now + BOOT_UNIT * Time::from(self.switches().boot_time),
            quietly,
            early: Vec::new(),
        };
    }

    /// The oldest event since the last call, if the camera is watched.
    pub fn take_note(&mut self) -> Option<Note> {
        self.notes.pop_front()
    }

    fn note(&mut self, note: impl FnOnce() -> Note) {
        if self.configuration.watched {
            self.notes.push_back(note());
        }
    }

    /// The camera loses everything that was set.
    fn forget(&mut self, now: Time) {
        self.wire.cut(now);
        self.wire.pause_bits = 0;
        self.modes = Modes::new(self.configuration.sensor);
        self.light = Light::new(now);
        self.line.clear();
        self.raw_input.clear();
        self.held = None;
        self.reference = Grid::dark(false);
        self.masked.clear();
        self.last_packet.clear();
        self.is_late = false;
        self.answer_at = now;
    }

    /// A byte from the host whose stop bit is over at this time.
    pub fn receive(&mut self, byte: u8, at: Time) {
        self.advance(at);
        match &mut self.from_host {
            Some(framing) => {
                framing.push(at, byte);
                self.advance(at);
            }
            None => self.hear(byte, at),
        }
    }

    /// The next byte for the host that is complete by now, and the time when it was.
    pub fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.advance(now);
        let Some(framing) = &mut self.to_host else {
            return self.wire.receive(now);
        };
        while let Some((at, byte)) = self.wire.receive(now) {
            framing.push(at, byte);
        }
        framing.receive(now)
    }

    /// Time of the next event without the host: a byte is complete, or the camera acts.
    pub fn next_deadline(&self) -> Option<Time> {
        let heard = self.to_host.as_ref().and_then(Framing::next_at);
        [self.act_at(), self.wire.next_at(), heard]
            .into_iter()
            .flatten()
            .min()
    }

    /// Time when a host that reads `count` bytes at once needs to look: so many are complete, or all that the
    /// camera has said so far, or it acts next.
    pub fn next_burst(&self, count: usize) -> Option<Time> {
        if self.to_host.is_some() {
            return self.next_deadline();
        }
        self.wire.complete_at(count).or_else(|| self.act_at())
    }

    /// Time when the camera takes its next frame for a packet, if it streams. Until then the scene may be changed.
    pub fn next_frame(&self) -> Option<Time> {
        match &self.activity {
            Activity::Stream(stream) => Some(stream.next_at),
            Activity::Dump(dump) if dump.row.is_none() => Some(dump.next_at),
            _ => None,
        }
    }

    fn act_at(&self) -> Option<Time> {
        let own = match &self.activity {
            Activity::Boot { at, .. } | Activity::Waking { at } => Some(*at),
            Activity::Silent { until } => Some(*until),
            Activity::Stream(stream) => Some(stream.next_at),
            Activity::Dump(dump) => Some(dump.next_at),
            Activity::Command
            | Activity::Dead
            | Activity::Upload { .. }
            | Activity::Sleep { .. } => None,
        };
        let heard = self.from_host.as_ref().and_then(Framing::next_at);
        own.into_iter().chain(heard).min()
    }

    /// Does what is due until now.
    pub fn advance(&mut self, now: Time) {
        while let Some(at) = self.act_at().filter(|&at| at <= now) {
            if let Some((at, byte)) = self
                .from_host
                .as_mut()
                .and_then(|framing| framing.receive(at))
            {
                self.hear(byte, at);
                continue;
            }
            match self.activity {
                Activity::Boot {
                    quietly,
                    ref mut early,
                    ..
                } => {
                    let early = std::mem::take(early);
                    self.started(at, quietly);
                    for byte in early {
                        // A reset among them drops the rest.
                        if !matches!(self.activity, Activity::Boot { .. }) {
                            self.hear(byte, at);
                        }
                    }
                }
                Activity::Waking { .. } => self.woken(at),
                Activity::Silent { .. } => {
                    self.line.clear();
                    self.raw_input.clear();
                    self.activity = Activity::Command;
                }
                Activity::Stream(stream) => self.next_packet(stream),
                Activity::Dump(_) => self.next_row(at),
                Activity::Command
                | Activity::Dead
                | Activity::Upload { .. }
                | Activity::Sleep { .. } => {}
            }
        }
    }

    fn started(&mut self, now: Time, quietly: bool) {
        self.activity = Activity::Command;
        self.answer_at = now;
        self.note(|| Note::Started { alive: true });
        if quietly {
            return;
        }
        if self.switches().reset_blank_line == 1 {
            self.say(b"\r");
        }
        self.say_banner(true);
        self.prompt();
    }

    fn woken(&mut self, now: Time) {
        self.activity = Activity::Command;
        self.answer_at = now;
        if self.switches().sleep_prompt == 0 {
            self.prompt();
        }
    }

    fn switches(&self) -> &Switches {
        &self.configuration.switches
    }

    /// Faults that a command or a packet may meet, at any time until then. Returns true if one did: then nothing
    /// else happens, and what has not been sent by that time never is.
    fn breaks_down(&mut self, now: Time, until: Time) -> bool {
        let moment = |share: f64| now + ((until - now) as f64 * share) as Time;
        let quietly = self.faults.silent_restart.strikes();
        if quietly || self.faults.restart.strikes() {
            self.note(|| Note::Fault(if quietly { "silent_restart" } else { "restart" }));
            let at = moment(self.faults.restart.share());
            self.restart(at, quietly);
            return true;
        }
        if self.faults.silence.strikes() {
            self.note(|| Note::Fault("silence"));
            let at = moment(self.faults.silence.share());
            self.wire.cut(at);
            self.activity = Activity::Silent {
                until: at + SILENCE,
            };
            return true;
        }
        false
    }
}
