//! A node's end of the medium.

use std::{
    fmt,
    future::{Future, poll_fn},
    pin::Pin,
    rc::Rc,
    task::{Context, Poll},
};

use zigbee_link::radio::{
    FRAME_MAX, FRAME_MIN, PSDU_MAX, Radio as Contract, RadioConfig, Received, TxOutcome,
};

use super::{Abilities, NodeId, Shared};

/// A radio on a [`Medium`](super::Medium).
pub struct Radio {
    shared: Rc<Shared>,
    node: NodeId,
    abilities: Abilities,
}

/// The radio was used against its contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioError {
    /// It is not configured.
    NotConfigured,
    /// It cannot send a frame of this length.
    Length(usize),
}

impl fmt::Display for RadioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("the radio is not configured"),
            Self::Length(length) => write!(f, "a frame of {length} bytes cannot be sent"),
        }
    }
}

impl std::error::Error for RadioError {}

impl Radio {
    pub(super) fn new(shared: Rc<Shared>, node: NodeId, abilities: Abilities) -> Self {
        Self {
            shared,
            node,
            abilities,
        }
    }

    fn check(&self) -> Result<(), RadioError> {
        let air = self.shared.air.borrow();
        let is_configured = air.node(self.node).config.is_some();
        is_configured.then_some(()).ok_or(RadioError::NotConfigured)
    }
}

impl Drop for Radio {
    fn drop(&mut self) {
        if let Some(event) = self.shared.air.borrow_mut().switch_off(self.node) {
            self.shared.clock.cancel(event);
        }
    }
}

impl Contract for Radio {
    type Error = RadioError;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), RadioError> {
        let now = self.shared.clock.time();
        self.shared
            .air
            .borrow_mut()
            .configure(now, self.node, *config);
        Ok(())
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, RadioError> {
        self.check()?;
        let longest = if self.abilities.fcs {
            FRAME_MAX
        } else {
            PSDU_MAX
        };
        if !(FRAME_MIN..=longest).contains(&frame.len()) {
            return Err(RadioError::Length(frame.len()));
        }
        let mut has_begun = false;
        let outcome = poll_fn(|context| {
            let now = self.shared.clock.time();
            let mut air = self.shared.air.borrow_mut();
            // A transmission whose future was dropped comes to its end first.
            if !has_begun && air.node(self.node).is_idle() {
                has_begun = true;
                let (at, due) = air.begin(now, self.node, frame);
                let event = self.shared.plan(at, due);
                air.planned(due, event);
            }
            let node = air.node_mut(self.node);
            match node.outcome.take() {
                Some(outcome) if has_begun => Poll::Ready(outcome),
                _ => {
                    node.sender = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        });
        Ok(outcome.await)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, RadioError> {
        self.check()?;
        Reception {
            radio: self,
            buffer,
        }
        .await
    }
}

/// Waits for a frame; a radio without queue listens only while there is one of these.
struct Reception<'a> {
    radio: &'a Radio,
    buffer: &'a mut [u8; PSDU_MAX],
}

impl Future for Reception<'_> {
    type Output = Result<Received, RadioError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let this = &mut *self;
        let mut air = this.radio.shared.air.borrow_mut();
        let node = air.node_mut(this.radio.node);
        if let Some((received, bytes)) = node.queue.pop_front() {
            *this.buffer = bytes;
            return Poll::Ready(Ok(received));
        }
        match &mut node.receiver {
            Some(waker) => waker.clone_from(context.waker()),
            None => node.receiver = Some(context.waker().clone()),
        }
        Poll::Pending
    }
}

impl Drop for Reception<'_> {
    fn drop(&mut self) {
        let mut air = self.radio.shared.air.borrow_mut();
        air.node_mut(self.radio.node).receiver = None;
    }
}
