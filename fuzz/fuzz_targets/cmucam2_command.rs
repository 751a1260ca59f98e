//! Any line: what is accepted means the same when it is written and read again.
#![no_main]

use cmucam2_driver::Command;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|line: &[u8]| {
    if let Ok(command) = Command::parse(line) {
        let again = command.line();
        let Some((b'\r', text)) = again.as_bytes().split_last() else {
            panic!("no carriage return");
        };
        assert_eq!(Command::parse(text), Ok(command));
    }
});
