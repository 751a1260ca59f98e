//! A debugger at a chip, and what a panic leaves.

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    process::{Command, Stdio},
    thread,
};

use object::{Object, ObjectSymbol};

use super::*;

/// GDB's remote serial protocol ("Debugging with GDB", appendix E).
struct Debugger(TcpStream);

impl Debugger {
    fn ask(&mut self, packet: &str) -> String {
        let sum = packet.bytes().fold(0_u8, u8::wrapping_add);
        write!(self.0, "${packet}#{sum:02x}").unwrap();
        let (mut answer, mut byte) = (String::new(), [0]);
        // Acknowledgements come before, the sum behind.
        while !answer.ends_with('#') {
            self.0.read_exact(&mut byte).unwrap();
            answer.push(byte[0].into());
        }
        self.0.read_exact(&mut [0; 2]).unwrap();
        self.0.write_all(b"+").unwrap();
        answer.trim_matches(['+', '$', '#']).to_owned()
    }

    fn set(&mut self, register: u8, value: u32) {
        let value = value.swap_bytes();
        assert_eq!(self.ask(&format!("P{register:x}={value:08x}")), "OK");
    }

    fn store(&mut self, address: u32, bytes: &[u8]) {
        let text: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let packet = format!("M{address:x},{:x}:{text}", bytes.len());
        assert_eq!(self.ask(&packet), "OK");
    }
}

/// The address of a function with this name, mangled or not: there, its length is before it.
fn function(name: &str) -> u32 {
    let bytes = fs::read(image()).unwrap();
    let file = object::File::parse(bytes.as_slice()).unwrap();
    let symbol = file.symbols().find(|symbol| {
        symbol.name().is_ok_and(|mangled| {
            mangled == name || mangled.contains(&format!("{}{name}", name.len()))
        })
    });
    symbol.unwrap().address() as u32 & !1
}

/// Output of GDB after these commands.
fn gdb(commands: &[&str], address: SocketAddr) -> String {
    let mut command = Command::new("gdb-multiarch");
    command.args(["-nx", "-batch", "-ex", "set width 0"]);
    command.args(["-ex", &format!("target remote {address}")]);
    for line in commands {
        command.args(["-ex", line]);
    }
    let output = command.arg(image()).stdin(Stdio::null()).output();
    let output = output.expect("install gdb-multiarch");
    // The answers to `monitor` are on the other one.
    let printed = [output.stdout, output.stderr].concat();
    let printed = String::from_utf8_lossy(&printed).into_owned();
    assert!(output.status.success(), "{printed}");
    printed
}

/// A user's GDB finds the sources, stops where it is told to, and lets the node go on. Its work takes none of the
/// node's time.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn gdb_looks_at_a_node() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let node = |debugger| Node {
        debugger,
        ..lab().coordinator()
    };
    let running = thread::spawn(move || alone(node(Some(listener)), 5 * S));
    let printed = gdb(
        &[
            "tbreak embassy_nrf::init",
            "continue",
            "backtrace",
            "monitor until-time 3s",
            "continue",
            "monitor icount",
            "print/x $lr",
            "stepi",
            "detach",
        ],
        address,
    );
    for words in ["boards/nrf52/src/board.rs:", "at 3000000000 ns"] {
        assert!(printed.contains(words), "{printed}");
    }
    are_equal(&[running.join().unwrap()], &[alone(node(None), 5 * S)]);
}

/// GDB stops a node at a function; a panic there tells its file and line after the restart.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_panic_tells_its_file_and_line() {
    const RAM: u32 = 0x2000_1000;
    const PC: u8 = 15;
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let node = Node {
        debugger: Some(listener),
        ..lab().coordinator()
    };
    let running = thread::spawn(|| alone(node, 5 * S));
    let mut debugger = Debugger(TcpStream::connect(address).unwrap());
    let main = function("main");
    assert_eq!(debugger.ask(&format!("Z0,{main:x},2")), "OK");
    let stop = debugger.ask("c");
    assert!(stop.starts_with('T') || stop.starts_with('S'), "{stop}");
    let at = debugger.ask(&format!("p{PC:x}"));
    assert_eq!(u32::from_str_radix(&at, 16).unwrap().swap_bytes(), main);
    assert_eq!(debugger.ask(&format!("z0,{main:x},2")), "OK");
    // A place in a source: a name, its length, a line and a column.
    let file = b"planted.rs";
    debugger.store(RAM + 16, file);
    let place = [RAM + 16, file.len() as u32, 42, 7];
    let bytes: Vec<u8> = place.iter().flat_map(|word| word.to_le_bytes()).collect();
    debugger.store(RAM, &bytes);
    // `core::panicking::panic_bounds_check(index, length, place)`.
    for (register, value) in [
        (0, 3),
        (1, 2),
        (2, RAM),
        (PC, function("panic_bounds_check")),
    ] {
        debugger.set(register, value);
    }
    assert_eq!(debugger.ask("D"), "OK");
    let outcome = running.join().unwrap();
    assert!(says(&outcome, "planted.rs:42"), "{:?}", log(&outcome));
    assert!(outcome.resets.len() <= 2, "{:?}", outcome.resets);
}
