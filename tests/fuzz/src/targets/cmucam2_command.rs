//! Any line: an accepted one means the same when it is written and read again.

use cmucam2_driver::Command;

/// Tries one input.
pub(crate) fn run(line: &[u8]) {
    if let Ok(command) = Command::parse(line) {
        let again = command.line();
        let Some((b'\r', text)) = again.as_bytes().split_last() else {
            panic!("no carriage return");
        };
        assert_eq!(Command::parse(text), Ok(command));
    }
}
