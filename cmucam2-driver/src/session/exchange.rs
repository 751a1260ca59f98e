//! One command and its reply.

use super::request::Answer;
use crate::{
    command::{Effect, Order, Reply},
    features::FULL,
    packet::Packet,
    parser::Token,
};

/// A command on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exchange {
    pub(super) order: Order,
    pub(super) purpose: Purpose,
}

/// Purpose of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Its answer is that of the request.
    Whole,
    /// The same: a packet of the stream that was begun.
    Next,
    /// It begins the stream that later requests read.
    Begin,
    /// A step of a script.
    Step,
    /// A step whose effect a later one takes back.
    Once,
    /// It gives the camera a mode back.
    Restore,
}

/// Part of the reply that is awaited.
#[derive(Clone, Copy, Debug)]
pub(super) enum Awaited {
    /// `ACK` or `NCK`.
    Ack,
    /// The rest after `ACK`: the answer, unless it came, and the prompt.
    Reply(Option<Answer>),
    /// The prompt after `NCK`.
    Refused,
    /// A packet or a part of a frame.
    Packet,
    /// The prompt after the one packet or frame that was wanted.
    Prompt(Answer),
}

/// Meaning of an event before packets come.
pub(super) enum Reaction {
    Nothing,
    /// The rest that is awaited now may take as long as a reply takes.
    Await(Awaited),
    /// The camera sends; this may be the first packet already.
    Sends,
    /// Answer and prompt are there.
    Done(Option<Answer>),
    Refused,
    /// The camera's next bytes cannot be foretold.
    Irregular,
}

impl Exchange {
    /// Returns true if this command asks for a packet like this.
    pub(super) fn asks_for(&self, packet: &Packet) -> bool {
        match self.order.reply() {
            Reply::Packets(kind) => packet.is_of(kind),
            _ => false,
        }
    }

    /// Returns true if the camera may have carried out the request already. `under_way`: the exchange is not
    /// over.
    pub(super) fn answers(&self, under_way: bool) -> bool {
        under_way && self.purpose == Purpose::Whole
    }

    pub(super) fn is_frame(&self) -> bool {
        FULL && self.order.reply() == Reply::Frame
    }

    /// Returns true if a banner is the answer. After a reset it comes even if the `ACK` was lost.
    pub(super) fn asks_for_banner(&self, awaited: &Awaited) -> bool {
        match awaited {
            Awaited::Ack => self.order.effect() == Effect::Reset,
            Awaited::Reply(_) => self.order.reply() == Reply::Banner,
            Awaited::Refused | Awaited::Packet | Awaited::Prompt(_) => false,
        }
    }

    /// Reaction to an event while no packets are awaited.
    pub(super) fn on_event(&self, awaited: &mut Awaited, event: &Token) -> Reaction {
        let reply = self.order.reply();
        match (awaited, event) {
            (Awaited::Ack, Token::Ack) => match reply {
                Reply::Packets(_) | Reply::Frame => Reaction::Sends,
                _ => Reaction::Await(Awaited::Reply(None)),
            },
            (Awaited::Ack | Awaited::Reply(_), Token::Nck) => Reaction::Await(Awaited::Refused),
            // The acknowledgement was damaged, but this is the packet that it promised.
            (Awaited::Ack, Token::Packet(packet)) if self.asks_for(packet) => Reaction::Sends,
            (Awaited::Ack, Token::Prompt) => Reaction::Irregular,
            (Awaited::Reply(answer), Token::Values(values)) => {
                *answer = Some(Answer::Values(*values));
                Reaction::Nothing
            }
            (Awaited::Reply(None), Token::Prompt)
                if matches!(reply, Reply::Values(_) | Reply::Banner) =>
            {
                Reaction::Irregular
            }
            (Awaited::Reply(answer), Token::Prompt) => Reaction::Done(*answer),
            (Awaited::Refused, Token::Prompt) => Reaction::Refused,
            _ => Reaction::Nothing,
        }
    }
}
