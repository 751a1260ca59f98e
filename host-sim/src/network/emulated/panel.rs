//! A board's line for steps and lamps.

use board_support::panel::{Deframer, FRAME_MAX, FromNode, ToNode, frame};
use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};
use node_firmware::hardware::Indication;

use super::super::node::Panel;

/// Carries steps to the node and its lamps to the panel, until the line is closed or fails.
pub(super) async fn connect<U: Read + Write>(mut line: U, panel: &Panel) {
    let mut deframer = Deframer::new();
    let mut shown = None;
    let mut bytes = [0; 64];
    loop {
        match select(line.read(&mut bytes), panel.steps.receive()).await {
            Either::First(Ok(count @ 1..)) => {
                for &byte in &bytes[..count] {
                    let told = deframer.push(byte);
                    // They are told again and again.
                    if let Some(lamps) = told.filter(|told| shown != Some(*told)) {
                        shown = Some(lamps);
                        panel.show(indication(lamps));
                    }
                }
            }
            Either::First(_) => return,
            Either::Second(step) => {
                let mut buffer = [0; FRAME_MAX];
                if line
                    .write_all(frame(&ToNode::Step(step), &mut buffer))
                    .await
                    .is_err()
                {
                    return;
                }
            }
        }
    }
}

fn indication(lamps: FromNode) -> Indication {
    let FromNode::Lamps {
        joined,
        target_seen,
        calibrated,
        may_walk,
    } = lamps;
    Indication {
        joined,
        target_seen,
        calibrated,
        may_walk,
    }
}
