//! Bytes that parse are written again as the same bytes.

use zigbee_link::wire::{Beacon, Frame, MacCommand};

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let mut buffer = vec![0; bytes.len()];
    if let Ok(frame) = Frame::parse(bytes) {
        let len = frame
            .header()
            .emit(&mut buffer)
            .expect("what parses can be written");
        assert_eq!(&buffer[..len], frame.header_bytes());
    }
    if let Ok(command) = MacCommand::parse(bytes) {
        assert_eq!(command.emit(&mut buffer), Ok(bytes.len()));
        assert_eq!(buffer, bytes);
    }
    if let Ok(beacon) = Beacon::parse(bytes) {
        assert_eq!(beacon.emit(&mut buffer), Ok(bytes.len()));
        assert_eq!(buffer, bytes);
    }
}
