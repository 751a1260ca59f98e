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

/// Why it is sent.
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

/// What is being waited for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Awaited {
    /// `ACK` or `NCK`.
    Ack,
    /// What follows `ACK`: the answer, unless it came, and the prompt.
    Reply(Option<Answer>),
    /// The prompt after `NCK`.
    Refused,
    /// A packet or a part of a frame.
    Packet,
    /// The prompt after the one packet or frame that was wanted.
    Prompt(Answer),
}

/// What an event means before packets come.
pub(super) enum Reaction {
    Nothing,
    /// What is awaited now may take as long as a reply takes.
    Await(Awaited),
    /// The camera sends; this may be the first packet already.
    Sends,
    /// Answer and prompt are there.
    Done(Option<Answer>),
    Refused,
    /// Nothing can be said of what the camera will send next.
    Irregular,
}

impl Exchange {
    /// Whether a packet is what this command asks for.
    pub(super) fn asks_for(&self, packet: &Packet) -> bool {
        match self.order.reply() {
            Reply::Packets(kind) => packet.is_of(kind),
            _ => false,
        }
    }

    /// Whether the camera may have done already what the request is about. `under_way`: this is not
    /// over.
    pub(super) fn answers(&self, under_way: bool) -> bool {
        under_way && self.purpose == Purpose::Whole
    }

    pub(super) fn is_frame(&self) -> bool {
        FULL && self.order.reply() == Reply::Frame
    }

    /// Whether a banner is the answer. After a reset it comes even if the `ACK` was lost.
    pub(super) fn asks_for_banner(&self, awaited: &Awaited) -> bool {
        match awaited {
            Awaited::Ack => self.order.effect() == Effect::Reset,
            Awaited::Reply(_) => self.order.reply() == Reply::Banner,
            Awaited::Refused | Awaited::Packet | Awaited::Prompt(_) => false,
        }
    }

    /// What to make of an event while no packets are awaited.
    pub(super) fn on_event(&self, awaited: &mut Awaited, event: &Token) -> Reaction {
        let reply = self.order.reply();
        match (awaited, event) {
            (Awaited::Ack, Token::Ack) => match reply {
                Reply::Packets(_) | Reply::Frame => Reaction::Sends,
                _ => Reaction::Await(Awaited::Reply(None)),
            },
            (Awaited::Ack | Awaited::Reply(_), Token::Nck) => Reaction::Await(Awaited::Refused),
            // The acknowledgement was damaged, but this is what it promised.
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
