//! The emulator of the board, and what is on its lines.

use std::{
    cell::Cell,
    env, fs,
    future::Future,
    io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _},
    os::unix::net::UnixStream,
    path::{Path, PathBuf},
    process::ExitStatus,
    task::Poll,
    thread,
    time::{Duration, Instant},
};

use board_emulator::{Emulator as Board, Running};
use board_support::{
    flash::MPS2_AN386_CONFIG,
    panel::{Deframer, FRAME_MAX, FromNode, ToNode, frame},
};
use cmucam2_emulator::{Configuration, Emulator, Extent, Note, Scene, Shape, Time};
use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};
use node_firmware::{
    config::{
        Config,
        page::{self, PAGE_MAX},
    },
    console::{Frames, ToPc},
};
use object::{Object as _, ObjectSymbol as _};
use tempfile::TempDir;

use crate::peer::Uart;

/// Start bit, eight data bits, stop bit.
const BYTE_BITS: Time = 10;
const SECOND: Time = 1_000_000_000;

/// An emulated board. Ends with its owner.
pub(crate) struct Machine {
    directory: TempDir,
    image: PathBuf,
    /// Bytes between the end of the stack and its start.
    stack: u32,
    running: Option<Running>,
    /// How often it was switched on: its random number.
    starts: u32,
}

/// A board opens its lines within this.
const PATIENCE: Duration = Duration::from_secs(30);
/// Where the board's memory begins, and the stack ends.
const MEMORY: u32 = 0x2000_0000;
/// What the stack is painted with.
const PAINT: u8 = 0xc5;

/// The host's ends of its UARTs.
pub(crate) struct Lines {
    pub(crate) device: UnixStream,
    pub(crate) radio: UnixStream,
    pub(crate) panel: UnixStream,
}

impl Machine {
    pub(crate) fn new(config: &Config) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut buffer = [0; PAGE_MAX];
        let len = page::encode(&config.clone().check().unwrap(), &mut buffer).unwrap();
        fs::write(directory.path().join("page.bin"), &buffer[..len]).unwrap();
        let image =
            env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set: `cargo xtask emulate`");
        let image = PathBuf::from(image);
        let stack = stack_start(&image) - MEMORY;
        let paint = vec![PAINT; stack as usize];
        fs::write(directory.path().join("paint.bin"), paint).unwrap();
        Self {
            directory,
            image,
            stack,
            running: None,
            starts: 0,
        }
    }

    /// Switches it on. Its flash is as it was.
    pub(crate) fn start(&mut self) -> Lines {
        self.starts += 1;
        let mut running = Board::new(
            board_emulator::Machine::Mps2An386,
            &self.image,
            self.directory.path(),
        )
        .print_to("log")
        .unwrap()
        .line("device")
        .line("radio")
        .line("panel")
        .load("page.bin", MPS2_AN386_CONFIG)
        .load("paint.bin", MEMORY)
        .monitor("monitor")
        .argument("node")
        .argument("flash.bin")
        .argument(self.starts)
        .start()
        .expect("the emulator does not start");
        let started = Instant::now();
        let lines = loop {
            if let Some(lines) = running.lines().unwrap() {
                break lines;
            }
            assert!(started.elapsed() < PATIENCE, "it opens no lines");
            thread::sleep(Duration::from_millis(5));
        };
        self.running = Some(running);
        let [device, radio, panel] = lines.try_into().unwrap();
        Lines {
            device,
            radio,
            panel,
        }
    }

    /// Switches it off.
    pub(crate) fn stop(&mut self) {
        self.running = None;
    }

    /// How many bytes of its stack it has used since it was switched on.
    pub(crate) fn stack_used(&self) -> u32 {
        let mut monitor = UnixStream::connect(self.directory.path().join("monitor")).unwrap();
        let mut answers = BufReader::new(monitor.try_clone().unwrap()).lines();
        let size = self.stack;
        let save = format!(
            r#"{{"execute":"pmemsave","arguments":{{"val":{MEMORY},"size":{size},"filename":"stack.bin"}}}}"#
        );
        for command in [r#"{"execute":"qmp_capabilities"}"#, &save] {
            writeln!(monitor, "{command}").unwrap();
            // Greetings and events come in between.
            let answer = answers.find(|line| {
                let line = line.as_ref().unwrap();
                line.contains(r#""return""#) || line.contains(r#""error""#)
            });
            let answer = answer.unwrap().unwrap();
            assert!(answer.contains(r#""return""#), "{answer}");
        }
        let stack = fs::read(self.directory.path().join("stack.bin")).unwrap();
        let untouched = stack.iter().take_while(|&&byte| byte == PAINT).count();
        self.stack - untouched as u32
    }

    /// When the emulator ends by itself.
    pub(crate) fn ended(&mut self) -> impl Future<Output = ExitStatus> {
        let running = self.running.as_mut().expect("it was started");
        std::future::poll_fn(|_| match running.status() {
            Some(status) => Poll::Ready(status),
            None => Poll::Pending,
        })
    }

    /// What it printed: defmt frames, or the emulator's own complaints.
    pub(crate) fn log(&self) -> String {
        let bytes = fs::read(self.directory.path().join("log")).unwrap_or_default();
        bytes.escape_ascii().to_string()
    }
}

/// Where the stack begins: at its highest address.
fn stack_start(image: &Path) -> u32 {
    let bytes = fs::read(image).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let symbol = file.symbol_by_name("_stack_start");
    symbol.expect("the image has a stack").address() as u32
}

/// Bytes that are there; `None` when the line is closed.
fn take(mut line: &UnixStream) -> Option<Vec<u8>> {
    let mut buffer = [0; 256];
    match line.read(&mut buffer) {
        Ok(0) => None,
        Ok(len) => Some(buffer[..len].to_vec()),
        Err(error) if error.kind() == ErrorKind::WouldBlock => Some(Vec::new()),
        Err(_) => None,
    }
}

/// The board holds back what it has no room for.
fn put(mut line: &UnixStream, mut bytes: &[u8]) {
    while !bytes.is_empty() {
        match line.write(bytes) {
            Ok(len) => bytes = &bytes[len..],
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                thread::sleep(Duration::from_micros(100));
            }
            // Whoever reads from it will see that it is closed.
            Err(_) => return,
        }
    }
}

/// Waits for bytes; `None` when the line is closed.
async fn wait(line: &UnixStream) -> Option<Vec<u8>> {
    std::future::poll_fn(|_| match take(line) {
        Some(bytes) if bytes.is_empty() => Poll::Pending,
        bytes => Poll::Ready(bytes),
    })
    .await
}

/// Connects a line of the board with a line of a co-processor, until one is closed.
pub(crate) async fn bridge(board: &UnixStream, co_processor: &mut Uart) {
    let mut buffer = [0; 256];
    loop {
        match select(wait(board), co_processor.read(&mut buffer)).await {
            Either::First(Some(bytes)) => co_processor.write_all(&bytes).await.unwrap(),
            Either::Second(Ok(len)) if len > 0 => put(board, &buffer[..len]),
            _ => return,
        }
    }
}

/// Columns and rows of the CMUcam2 as it starts (manual, p. 34: 88 by 143).
const PICTURE: (f64, f64) = (88.0, 143.0);
/// Columns of the ball; a column is as wide as two rows are high.
const BALL: f64 = 18.0;

/// A CMUcam2 in front of a ball, in real time.
pub(crate) struct Camera {
    line: UnixStream,
    emulator: Emulator,
    start: Instant,
    byte_time: Time,
    free_at: Time,
    pub(crate) notes: Vec<Note>,
}

impl Camera {
    pub(crate) fn new(line: UnixStream, baud: u32) -> Self {
        let configuration = Configuration {
            baud,
            host_baud: baud,
            watched: true,
            ..Configuration::default()
        };
        Self {
            line,
            emulator: Emulator::new(configuration, Scene::default()),
            start: Instant::now(),
            byte_time: BYTE_BITS * SECOND / Time::from(baud),
            free_at: 0,
            notes: Vec::new(),
        }
    }

    /// Until the line is closed. The middle of the ball is in this column, counted from 0 at the
    /// middle of the first one.
    pub(crate) async fn run(&mut self, ball: &Cell<f64>) {
        std::future::poll_fn(|_| {
            let middle = ball.get() + 0.5;
            let columns = [middle - BALL / 2.0, middle + BALL / 2.0];
            let rows = [PICTURE.1 / 2.0 - BALL, PICTURE.1 / 2.0 + BALL];
            let extent = Extent::of_pixels(columns, rows, PICTURE.0, PICTURE.1);
            *self.emulator.scene_mut() = Scene::with_object([220, 110, 40], Shape::Disc, extent);
            let now = self.start.elapsed().as_nanos() as Time;
            let Some(bytes) = take(&self.line) else {
                return Poll::Ready(());
            };
            for byte in bytes {
                // A line would carry them one after the other; early is late enough here.
                self.free_at = now.max(self.free_at + self.byte_time);
                self.emulator.receive(byte, self.free_at);
            }
            let mut sent = Vec::new();
            while let Some((_, byte)) = self.emulator.transmit(now.max(self.free_at)) {
                sent.push(byte);
            }
            put(&self.line, &sent);
            while let Some(note) = self.emulator.take_note() {
                self.notes.push(note);
            }
            Poll::Pending
        })
        .await;
    }
}

/// A PC on the coordinator's line.
pub(crate) struct Console {
    line: UnixStream,
    frames: Frames,
}

impl Console {
    pub(crate) fn new(line: UnixStream) -> Self {
        Self {
            line,
            frames: Frames::default(),
        }
    }

    /// Reads until this is told.
    pub(crate) async fn until(&mut self, wanted: impl Fn(&ToPc) -> bool) {
        loop {
            let bytes = wait(&self.line).await.expect("the board is on");
            for byte in bytes {
                let told = self.frames.push::<ToPc>(byte);
                if told.is_some_and(|told| wanted(&told)) {
                    return;
                }
            }
        }
    }
}

/// Somebody in front of the node.
pub(crate) struct Panel {
    line: UnixStream,
    deframer: Deframer,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Lit {
    pub(crate) joined: bool,
    pub(crate) calibrated: bool,
}

impl Panel {
    pub(crate) fn new(line: UnixStream) -> Self {
        Self {
            line,
            deframer: Deframer::new(),
        }
    }

    /// Looks at the lamps until they are as wanted.
    pub(crate) async fn until(&mut self, wanted: impl Fn(Lit) -> bool) {
        loop {
            let bytes = wait(&self.line).await.expect("the board is on");
            for byte in bytes {
                let Some(FromNode::Lamps {
                    joined, calibrated, ..
                }) = self.deframer.push(byte)
                else {
                    continue;
                };
                if wanted(Lit { joined, calibrated }) {
                    return;
                }
            }
        }
    }

    pub(crate) fn press_join_window(&self) {
        put(&self.line, frame(&ToNode::JoinWindow, &mut [0; FRAME_MAX]));
    }
}
