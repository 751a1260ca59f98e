//! Chips that hear each other, each in a thread of its own.
//!
//! A frame is told 130 us before it is on the air, when its radio ramps up. So no chip can be heard
//! sooner than [`AHEAD`] after the earliest instant at which any of them does something: until then all
//! of those that have something to do run beside one another. An idle one waits for its next event.

use std::{
    sync::mpsc::{self, Sender},
    thread,
};

use crate::{
    node::{self, Node, Outcome},
    peripheral::{Frame, RAMP_UP, US},
};

/// A little less than a ramp-up.
const AHEAD: u64 = RAMP_UP - US;
/// Where there is nobody else.
const ALONE: u64 = 1_000_000_000;

/// When a chip does something next, and what it sends.
pub(crate) struct Report {
    pub(crate) next: u64,
    pub(crate) sent: Vec<Frame>,
}

/// Until when a chip runs, and what it hears by then.
pub(crate) struct Order {
    pub(crate) until: u64,
    pub(crate) heard: Vec<(Frame, u8)>,
}

/// Tells that a chip has ended, whatever the reason.
struct Guard(usize, Sender<(usize, Option<Report>)>);

impl Drop for Guard {
    fn drop(&mut self) {
        // Nobody listens any more where all end.
        let _ = self.1.send((self.0, None));
    }
}

/// Runs chips from power-on for so many nanoseconds. `medium` says at which level a node hears a frame,
/// if it does; 0 to 63, in steps of 1 dB from -92 dBm (Product Specification, "RADIO"). Also returned are
/// all frames.
///
/// # Errors
/// A chip's image cannot be run.
pub fn run(
    nodes: Vec<Node>,
    until: u64,
    mut medium: impl FnMut(&Frame, usize) -> Option<u8>,
) -> Result<(Vec<Outcome>, Vec<Frame>), String> {
    let (reports, reported) = mpsc::channel();
    let count = nodes.len();
    let ahead = if count > 1 { AHEAD } else { ALONE };
    thread::scope(|scope| {
        let mut orders: Vec<Sender<Order>> = Vec::new();
        let mut threads = Vec::new();
        for (number, node) in nodes.into_iter().enumerate() {
            let (order, received) = mpsc::channel();
            orders.push(order);
            let reports = reports.clone();
            let guard = Guard(number, reports.clone());
            threads.push(scope.spawn(move || {
                let _guard = guard;
                node::run(number, node, reports, received)
            }));
        }
        drop(reports);
        let mut next = vec![0; count];
        let mut inboxes = vec![Vec::new(); count];
        let mut frames: Vec<Frame> = Vec::new();
        let mut running = count;
        loop {
            let mut sent = Vec::new();
            while running > 0 {
                // One that has ended by itself ends all.
                let Ok((number, Some(report))) = reported.recv() else {
                    break;
                };
                running -= 1;
                next[number] = report.next;
                sent.extend(report.sent);
            }
            let is_broken = running > 0;
            sent.sort_by_key(|frame: &Frame| (frame.start, frame.node));
            for frame in &sent {
                for (to, inbox) in inboxes.iter_mut().enumerate() {
                    if to != frame.node
                        && let Some(level) = medium(frame, to)
                    {
                        inbox.push((frame.clone(), level));
                        next[to] = next[to].min(frame.start);
                    }
                }
            }
            frames.extend(sent);
            let first = next.iter().copied().min().unwrap_or(u64::MAX);
            if first >= until || is_broken {
                break;
            }
            let horizon = first.saturating_add(ahead).min(until);
            for (number, order) in orders.iter().enumerate() {
                if next[number] < horizon {
                    let heard = core::mem::take(&mut inboxes[number]);
                    running += usize::from(
                        order
                            .send(Order {
                                until: horizon,
                                heard,
                            })
                            .is_ok(),
                    );
                }
            }
        }
        drop(orders);
        let outcomes = threads.into_iter().map(|thread| match thread.join() {
            Ok(outcome) => outcome,
            Err(_) => Err("a model panicked".to_owned()),
        });
        outcomes
            .collect::<Result<_, _>>()
            .map(|outcomes| (outcomes, frames))
    })
}
