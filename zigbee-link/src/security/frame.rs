//! Frames in and out of security.

use core::fmt;

use super::{
    Counter, CounterError, Key, Keyring, Peers, Protection,
    ccm::{self, nonce},
    peers::{FRESH_FOR, STALE_AFTER},
};
use crate::{
    Instant,
    radio::FRAME_MAX,
    wire::{
        Address, AuxHeader, EmitError, Eui64, Frame, FrameType, Header, Malformed, PanId, Panned,
        ShortAddress, copy,
    },
};

/// Everything that secures one node's frames: address, keys, counter and up to `PEERS` peers.
#[derive(Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameSecurity<const PEERS: usize> {
    /// The own extended address.
    extended: Eui64,
    protection: Protection,
    /// The key in use and, during a change, one more.
    pub keys: Keyring,
    /// The own frame counter.
    pub counter: Counter,
    /// The senders known to be fresh.
    pub peers: Peers<PEERS>,
    /// Numbers of a coordinator's members that may have missed the last change of key, and are spoken to under the
    /// former one.
    late: heapless::Vec<u16, PEERS>,
    /// One of them spoke.
    late_heard: Option<Eui64>,
}

/// Sender of an authentic frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sender {
    /// A peer: the frame is new, and its counter has been noted.
    Peer(Eui64),
    /// Not in the table: the frame may be old.
    Stranger(Eui64),
}

impl Sender {
    /// The extended address.
    pub const fn extended(self) -> Eui64 {
        match self {
            Self::Peer(extended) | Self::Stranger(extended) => extended,
        }
    }
}

/// Fields of a frame's header, parsed once for all that decide on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Envelope {
    frame_type: FrameType,
    pub destination: Panned,
    pub source: Option<Address>,
    security: Option<AuxHeader>,
    header_len: usize,
}

impl Envelope {
    pub(crate) fn parse(frame: &[u8]) -> Result<Self, Malformed> {
        let parsed = Frame::parse(frame)?;
        let header = parsed.header();
        Ok(Self {
            frame_type: header.frame_type,
            destination: header.destination,
            source: header.source.address,
            security: header.security,
            header_len: parsed.header_bytes().len(),
        })
    }
}

/// An authentic frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Opened<'a> {
    /// Data or command.
    pub frame_type: FrameType,
    /// The sender.
    pub sender: Sender,
    /// The address it was sent from.
    pub source: Address,
    /// The PAN it was sent in.
    pub pan: Option<PanId>,
    /// The address it was sent to.
    pub destination: Option<Address>,
    /// Its frame counter.
    pub counter: u32,
    /// The index of its key.
    pub key: u8,
    /// The payload in clear, of a command with its identifier.
    pub payload: &'a [u8],
}

/// Reason why a frame was not opened. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Refused {
    /// Not a frame that this crate speaks.
    Malformed(Malformed),
    /// Neither data nor a command.
    NotForSecurity,
    /// Not secured at all.
    Unsecured,
    /// Another level than this network's, for example without integrity code.
    Level,
    /// The index of a key that is not, or no longer, accepted.
    Key,
    /// The frame has no source address.
    NoSource,
    /// A short address of no known peer, so that there is no nonce.
    UnknownShort(ShortAddress),
    /// The own address as the source.
    OwnAddress,
    /// The counter is not above the sender's last one, or the forbidden 0xFFFFFFFF.
    Replayed,
    /// The integrity code is wrong: forged, damaged, or under another key.
    Mic,
}

impl From<Malformed> for Refused {
    fn from(malformed: Malformed) -> Self {
        Self::Malformed(malformed)
    }
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Malformed(malformed) => return malformed.fmt(f),
            Self::NotForSecurity => "neither data nor a command",
            Self::Unsecured => "an unsecured frame",
            Self::Level => "another security level than this network's",
            Self::Key => "a key that is not accepted",
            Self::NoSource => "no source address",
            Self::UnknownShort(short) => return write!(f, "no known node has address {short}"),
            Self::OwnAddress => "sent in this node's own name",
            Self::Replayed => "a frame counter that is not new",
            Self::Mic => "a wrong integrity code",
        })
    }
}

impl core::error::Error for Refused {}

/// Reason why a frame could not be secured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SealError {
    /// No frame counter.
    Counter(CounterError),
    /// The frame cannot be written.
    Emit(EmitError),
}

impl fmt::Display for SealError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Counter(error) => error.fmt(f),
            Self::Emit(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for SealError {}

impl From<EmitError> for SealError {
    fn from(error: EmitError) -> Self {
        Self::Emit(error)
    }
}

/// A secured frame in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sealed {
    /// Its length without FCS.
    pub len: usize,
    /// Its frame counter.
    pub counter: u32,
}

/// Bytes of a payload that are authenticated but not encrypted: the identifier of a command
/// (IEEE 802.15.4-2006, 7.2.2.4).
const fn open_payload(frame_type: FrameType) -> usize {
    match frame_type {
        FrameType::Command => 1,
        _ => 0,
    }
}

impl<const PEERS: usize> FrameSecurity<PEERS> {
    /// A session without peers.
    ///
    /// `counter` comes from the store, see [`Counter::resume`].
    // for less stack
    #[inline(always)]
    pub fn new(extended: Eui64, protection: Protection, key: Key, counter: Counter) -> Self {
        Self {
            extended,
            protection,
            keys: Keyring::new(key),
            counter,
            peers: Peers::default(),
            late: heapless::Vec::new(),
            late_heard: None,
        }
    }

    /// The own extended address.
    pub const fn extended(&self) -> Eui64 {
        self.extended
    }

    /// Protection of frames.
    pub const fn protection(&self) -> Protection {
        self.protection
    }

    /// Goes on to understand this member under the former key, for as long as that is known.
    pub(crate) fn await_late(&mut self, member: Eui64) {
        let number = member.number();
        if !self.late.contains(&number) {
            // There are places for all members.
            let _ = self.late.push(number);
        }
    }

    /// Number of members that may still have only the former key.
    pub(crate) fn late(&self) -> u8 {
        u8::try_from(self.late.len()).unwrap_or(u8::MAX)
    }

    /// This member has the key in use.
    pub(crate) fn caught_up(&mut self, member: Eui64) {
        self.late.retain(|number| *number != member.number());
    }

    /// No member is understood under the former key any more.
    pub(crate) fn abandon_late(&mut self) {
        self.late.clear();
        self.late_heard = None;
    }

    /// A member that spoke under the former key since this was last asked.
    pub(crate) const fn take_late_heard(&mut self) -> Option<Eui64> {
        self.late_heard.take()
    }

    fn is_late(&self, member: Eui64) -> bool {
        self.late.contains(&member.number())
    }

    /// Returns true if the frame is for a member that may have only the former key.
    fn is_for_late(&self, destination: Panned) -> bool {
        match destination.address {
            Some(Address::Extended(extended)) => self.is_late(extended),
            Some(Address::Short(short)) => {
                let peer = self.peers.by_short(short);
                peer.is_some_and(|peer| self.is_late(peer.extended))
            }
            None => false,
        }
    }

    /// Writes a data or command frame to the start of `buffer`, secured with the key in use.
    ///
    /// `header.security` is filled in here; the payload of a command starts with its identifier.
    ///
    /// # Errors
    /// No frame counter; or a frame that is too long or impossible. A counter
    /// may be lost then, never used twice.
    pub fn seal(
        &mut self,
        header: &Header,
        payload: &[u8],
        buffer: &mut [u8; FRAME_MAX],
    ) -> Result<Sealed, SealError> {
        self.seal_under(false, header, payload, buffer)
    }

    /// The same, with the next key if `wants_next` and there is one.
    pub(crate) fn seal_under(
        &mut self,
        wants_next: bool,
        header: &Header,
        payload: &[u8],
        buffer: &mut [u8; FRAME_MAX],
    ) -> Result<Sealed, SealError> {
        let kind = matches!(header.frame_type, FrameType::Data | FrameType::Command);
        if !kind {
            return Err(EmitError::Impossible.into());
        }
        let level = self.protection.level();
        let counter = self.counter.take().map_err(SealError::Counter)?;
        let former = self.keys.former_cipher();
        let former = former.filter(|_| self.is_for_late(header.destination));
        let (key, cipher) = former.unwrap_or_else(|| self.keys.speaker(wants_next));
        let secured = Header {
            security: Some(AuxHeader {
                level,
                counter,
                key_index: key,
            }),
            ..*header
        };
        let header_len = secured.emit(buffer)?;
        let clear_len = header_len + open_payload(header.frame_type);
        let mic_at = header_len + payload.len();
        let len = mic_at + level.mic_len();
        let (body, mic) = buffer
            .get_mut(..len)
            .and_then(|frame| frame.split_at_mut_checked(mic_at))
            .ok_or(EmitError::NoRoom)?;
        copy(
            body.get_mut(header_len..).ok_or(EmitError::NoRoom)?,
            payload,
        );
        let (clear, secret) = body
            .split_at_mut_checked(clear_len)
            .ok_or(EmitError::Impossible)?;
        let nonce = nonce(self.extended, counter, level);
        ccm::seal(cipher, self.protection, &nonce, clear, secret, mic)
            .map_err(|_| EmitError::NoRoom)?;
        Ok(Sealed { len, counter })
    }

    /// Checks and decrypts a frame without FCS, in place.
    ///
    /// From a peer, the frame is accepted once: its counter is noted. Of a [`Sender::Stranger`], and
    /// of a peer whose counter is far behind, or that broadcasts after a long silence, nothing is noted,
    /// and the caller must not act on the frame but to challenge.
    ///
    /// # Errors
    /// The frame is not authentic, or not new; nothing has changed. The buffer's content is then
    /// undefined, but no plaintext.
    pub fn open<'f>(&mut self, now: Instant, frame: &'f mut [u8]) -> Result<Opened<'f>, Refused> {
        let envelope = Envelope::parse(frame)?;
        self.open_parsed(now, &envelope, frame)
    }

    /// The same with a header that was parsed already.
    pub(crate) fn open_parsed<'f>(
        &mut self,
        now: Instant,
        envelope: &Envelope,
        frame: &'f mut [u8],
    ) -> Result<Opened<'f>, Refused> {
        let frame_type = envelope.frame_type;
        if !matches!(frame_type, FrameType::Data | FrameType::Command) {
            return Err(Refused::NotForSecurity);
        }
        let security = envelope.security.ok_or(Refused::Unsecured)?;
        let level = self.protection.level();
        if security.level != level {
            return Err(Refused::Level);
        }
        let (key, counter) = (security.key_index, security.counter);
        let source = envelope.source.ok_or(Refused::NoSource)?;
        let extended = match source {
            Address::Extended(extended) => extended,
            Address::Short(short) => {
                let peer = self.peers.by_short(short);
                peer.ok_or(Refused::UnknownShort(short))?.extended
            }
        };
        if extended == self.extended {
            return Err(Refused::OwnAddress);
        }
        let is_late = self.is_late(extended);
        let former = self.keys.former_cipher();
        let former = former.filter(|(index, _)| is_late && *index == key);
        let cipher = match former {
            Some((_, cipher)) => cipher,
            None => self.keys.cipher(key, now).ok_or(Refused::Key)?,
        };
        let is_former = former.is_some();
        let peer = self.peers.by_extended(extended);
        let last = peer.map(|peer| peer.counter);
        let is_broadcast =
            envelope.destination.address == Some(Address::Short(ShortAddress::BROADCAST));
        let was_silent = peer.is_some_and(|peer| peer.heard + FRESH_FOR <= now);
        // Far behind, it may still prove that it is fresh, as a stranger.
        let is_stale = last.is_some_and(|last| last.saturating_sub(counter) > STALE_AFTER);
        let is_old = !is_stale && last.is_some_and(|last| counter <= last);
        if counter == u32::MAX || is_old {
            return Err(Refused::Replayed);
        }
        let header_len = envelope.header_len;
        let clear_len = header_len + open_payload(frame_type);
        let mic_at = frame
            .len()
            .checked_sub(level.mic_len())
            .ok_or(Malformed::Truncated)?;
        let (body, mic) = frame
            .split_at_mut_checked(mic_at)
            .ok_or(Malformed::Truncated)?;
        let (clear, secret) = body
            .split_at_mut_checked(clear_len)
            .ok_or(Malformed::Truncated)?;
        let nonce = nonce(extended, counter, level);
        ccm::open(cipher, self.protection, &nonce, clear, secret, mic).map_err(|_| Refused::Mic)?;
        if is_former {
            self.late_heard = Some(extended);
        } else if is_late && key == self.keys.active().index() {
            self.caught_up(extended);
        }
        let sender = match self.peers.by_extended_mut(extended) {
            Some(_) if is_stale || (is_broadcast && was_silent) => Sender::Stranger(extended),
            Some(peer) => {
                peer.counter = counter;
                peer.heard = now;
                Sender::Peer(extended)
            }
            None => Sender::Stranger(extended),
        };
        Ok(Opened {
            frame_type,
            sender,
            source,
            pan: envelope.destination.pan,
            destination: envelope.destination.address,
            counter,
            key,
            payload: body.get(header_len..).ok_or(Malformed::Truncated)?,
        })
    }
}
