//! Packets and images as they come.

use super::{Fault, exchange::Exchange, request::Answer};
use crate::{
    command::{Order, Reply},
    features::FULL,
    packet::{Packet, PacketKind},
    parser::{RowState, Token},
};

/// A camera that sends, until it is stopped or the prompt comes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stream {
    /// Order that it was given.
    pub(super) order: Order,
    /// The last packet was empty, or there was none yet.
    lost: bool,
    /// Bytes dropped when the last packet came.
    dropped_then: u32,
    /// Requests that ended in [`Answer::Quiet`], one after the other.
    quiet: u8,
    /// Bytes of a row of the image that is being sent.
    row_bytes: u16,
    /// Bytes of the row so far.
    row_at: u16,
}

impl Stream {
    pub(super) fn new(order: Order, dropped: u32) -> Self {
        Self {
            order,
            lost: true,
            dropped_then: dropped,
            quiet: 0,
            row_bytes: 0,
            row_at: 0,
        }
    }

    /// Returns `Ok` if rows fit into so many bytes.
    ///
    /// # Errors
    /// [`Fault::RowBuffer`].
    pub(super) fn fits(&self, room: usize) -> Result<(), Fault> {
        if usize::from(self.row_bytes) > room {
            return Err(Fault::RowBuffer {
                needed: self.row_bytes,
            });
        }
        Ok(())
    }

    /// Meaning of an event for the reader of the stream. `dropped`: bytes dropped so far.
    pub(super) fn on_event(
        &mut self,
        exchange: &Exchange,
        event: Token,
        row: &mut [u8],
        dropped: u32,
    ) -> Option<Answer> {
        match event {
            Token::Packet(packet) if exchange.asks_for(&packet) => {
                self.lost = matches!(packet, Packet::Tracking(tracking) if tracking.is_lost());
                self.quiet = 0;
                self.dropped_then = dropped;
                Some(Answer::Packet(packet))
            }
            _ if !FULL => None,
            Token::Header(header) => {
                self.row_bytes = header.row_bytes;
                self.row_at = 0;
                Some(Answer::Header(header))
            }
            Token::Pixel(byte, state) => {
                if let Some(place) = row.get_mut(usize::from(self.row_at)) {
                    *place = byte;
                }
                self.row_at = self.row_at.saturating_add(1);
                if state == RowState::Open {
                    return None;
                }
                let bytes = core::mem::take(&mut self.row_at);
                Some(Answer::Row {
                    bytes,
                    intact: state == RowState::Full,
                })
            }
            Token::RowCut(bytes) => {
                self.row_at = 0;
                Some(Answer::Row {
                    bytes,
                    intact: false,
                })
            }
            Token::RowAgain => {
                self.row_at = 0;
                None
            }
            Token::ImageEnd { rows, intact } => {
                self.row_bytes = 0;
                Some(Answer::End { rows, intact })
            }
            Token::Ack
            | Token::Nck
            | Token::Prompt
            | Token::Banner(_)
            | Token::Packet(_)
            | Token::Values(_) => None,
        }
    }

    /// Returns true if silence is right under packet filter: the last packet was empty or may have been
    /// dropped.
    pub(super) fn may_be_quiet(&self, dropped: u32) -> bool {
        matches!(
            self.order.reply(),
            Reply::Packets(PacketKind::Tracking | PacketKind::Difference)
        ) && (self.lost || dropped != self.dropped_then)
    }

    /// Counts a request that ended in silence. Returns the number of them.
    pub(super) fn count_quiet(&mut self) -> u8 {
        self.quiet = self.quiet.saturating_add(1);
        self.quiet
    }
}
