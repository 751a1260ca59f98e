//! Both sides of the console's line: any bytes, and any messages in frames. Neither side panics, a message comes
//! out of its frame as it went in, and the PC's state then is a record that can be read again.
//!
//! The first byte: 0 bytes of the line follow; 1 messages to the PC, 2 messages of the PC, each after a
//! pause in seconds and its length.

use std::{fmt::Debug, time::Duration};

use results::{
    record::{RecordError, RunRecord},
    view::NetworkView,
};
use node_firmware::console::{FRAME_MAX, Frames, FromPc, ToPc, encode};
use serde::{Serialize, de::DeserializeOwned};

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let [kind, rest @ ..] = bytes else { return };
    let mut view = NetworkView::default();
    let mut now = Duration::ZERO;
    match kind % 3 {
        0 => {
            let (mut to, mut from) = (Frames::default(), Frames::default());
            for &byte in rest {
                if let Some(message) = to.push::<ToPc>(byte) {
                    view.take(now, &message);
                }
                let _ = from.push::<FromPc>(byte);
            }
        }
        1 => {
            messages::<ToPc>(rest, |pause, message| {
                now += Duration::from_secs(pause.into());
                if let ToPc::Report { address, .. } = message {
                    view.asks(now, *address);
                }
                view.take(now, message);
            });
        }
        _ => messages::<FromPc>(rest, |_, _| ()),
    }
    let record = view.record(now, None);
    let written = record.to_json(false).expect("a record is text");
    let read = RunRecord::from_json(&written);
    // A network of which nothing is known has nothing to solve.
    assert!(
        matches!(read, Ok(_) | Err(RecordError::NoCameras)),
        "{read:?}"
    );
}

/// Takes messages through frames.
fn messages<T: Serialize + DeserializeOwned + Debug>(bytes: &[u8], mut take: impl FnMut(u8, &T)) {
    let mut frames = Frames::default();
    let mut rest = bytes;
    while let [pause, len, tail @ ..] = rest {
        let (body, tail) = tail.split_at(tail.len().min(usize::from(*len)));
        rest = tail;
        let Ok(message) = postcard::from_bytes::<T>(body) else {
            continue;
        };
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(&message, &mut buffer).expect("every message fits");
        let mut came = frame.iter().filter_map(|&byte| frames.push::<T>(byte));
        let read = came.next().expect("a frame holds a message");
        // Numbers that are none are not equal to themselves.
        assert_eq!(format!("{read:?}"), format!("{message:?}"));
        assert!(came.next().is_none());
        take(*pause, &read);
    }
}
