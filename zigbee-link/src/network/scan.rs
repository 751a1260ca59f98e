//! Looking for PANs.

use core::time::Duration;

use crate::{
    Instant,
    jitter::Jitter,
    radio::Channel,
    wire::{Address, Beacon, Eui64, Frame, FrameType, PanId, ShortAddress},
};

/// Time to listen on each channel after a beacon request.
pub const SCAN_TIME: Duration = Duration::from_millis(140);
/// PANs remembered per scan.
const FOUND: usize = 16;

/// Payload of the beacons of these networks: a mark, and a flag that says if there is room for devices.
///
/// Beacons are not secured, so this only says where to try first.
const MARK: [u8; 3] = *b"zl\x01";
const FULL: u8 = 1;

/// A set of channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channels(u32);

impl Channels {
    /// All 16 channels.
    pub const ALL: Self = Self(0x07FF_F800);

    /// Only this one.
    pub const fn only(channel: Channel) -> Self {
        Self(1 << channel.number())
    }

    /// This one too.
    #[must_use]
    pub const fn and(self, channel: Channel) -> Self {
        Self(self.0 | 1 << channel.number())
    }

    /// The lowest, which is then no longer in the set.
    fn take_first(&mut self) -> Option<Channel> {
        let channel = Channel::new(u8::try_from(self.0.trailing_zeros()).ok()?)?;
        self.0 &= !(1 << channel.number());
        Some(channel)
    }

    fn iter(mut self) -> impl Iterator<Item = Channel> {
        core::iter::from_fn(move || self.take_first())
    }
}

/// A PAN that was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Found {
    pub pan: PanId,
    pub channel: Channel,
    /// The sender of the beacon, if it told its extended address.
    pub coordinator: Option<Eui64>,
    /// A network of this crate with room for devices.
    pub is_open: bool,
    /// Strength of the beacon, by the measure of the own radio; 0 if that has none.
    pub strength: u8,
}

impl Found {
    const fn identity(&self) -> (PanId, Channel, Option<Eui64>) {
        (self.pan, self.channel, self.coordinator)
    }
}

pub(super) fn beacon_payload(is_full: bool) -> [u8; 4] {
    let [a, b, c] = MARK;
    [a, b, c, if is_full { FULL } else { 0 }]
}

/// A beacon of whatever network.
pub(super) fn parse_beacon(frame: &Frame<'_>, channel: Channel, strength: u8) -> Option<Found> {
    let header = frame.header();
    if header.frame_type != FrameType::Beacon || header.security.is_some() {
        return None;
    }
    let beacon = Beacon::parse(frame.payload()).ok()?;
    let room = match beacon.payload.split_first_chunk() {
        Some((&MARK, [flags])) => flags & FULL == 0,
        _ => false,
    };
    Some(Found {
        pan: header.source.pan?,
        channel,
        coordinator: match header.source.address? {
            Address::Extended(extended) => Some(extended),
            Address::Short(_) => None,
        },
        is_open: room && beacon.superframe.pan_coordinator(),
        strength,
    })
}

/// A scan of several channels.
#[derive(Debug)]
pub(super) struct Scan {
    all: Channels,
    left: Channels,
    current: Option<(Channel, Instant)>,
    found: heapless::Vec<Found, FOUND>,
    /// PANs heard, also of those for which there was no room; some of them twice.
    heard: u32,
}

/// Next step of a scan.
pub(super) enum Step {
    /// Send a beacon request on the [`channel`](Scan::channel).
    Request,
    /// Wait until [`until`](Scan::until).
    Listen,
    /// Every channel was listened to.
    Done,
}

impl Scan {
    pub(super) const fn new(channels: Channels) -> Self {
        Self {
            all: channels,
            left: channels,
            current: None,
            found: heapless::Vec::new(),
            heard: 0,
        }
    }

    pub(super) fn channel(&self) -> Option<Channel> {
        self.current.map(|(channel, _)| channel)
    }

    /// Time to take the next step.
    pub(super) fn until(&self) -> Instant {
        self.current.map_or(Instant(0), |(_, until)| until)
    }

    pub(super) fn step(&mut self, now: Instant) -> Step {
        if let Some((_, until)) = self.current
            && now < until
        {
            return Step::Listen;
        }
        match self.left.take_first() {
            Some(channel) => {
                self.current = Some((channel, now + SCAN_TIME));
                Step::Request
            }
            None => Step::Done,
        }
    }

    /// Beyond the room there is, each PAN heard has the same chance to be remembered, by
    /// reservoir sampling: beacons can be forged, and those that come first must not keep out the
    /// others.
    pub(super) fn on_beacon(&mut self, found: Found, jitter: &mut Jitter) {
        let is_it = |known: &&mut Found| known.identity() == found.identity();
        if let Some(known) = self.found.iter_mut().find(is_it) {
            *known = found;
            return;
        }
        self.heard = self.heard.saturating_add(1);
        if self.found.push(found).is_err() {
            let place = jitter.below(self.heard);
            if let Some(other) = self.found.get_mut(place as usize) {
                *other = found;
            }
        }
    }

    /// From now on the strongest come first.
    pub(super) fn sort(&mut self) {
        for _ in 0..self.found.len() {
            let mut before: Option<&mut Found> = None;
            for found in &mut self.found {
                if let Some(before) = before
                    && before.strength < found.strength
                {
                    core::mem::swap(before, found);
                }
                before = Some(found);
            }
        }
    }

    pub(super) fn found(&self) -> &[Found] {
        &self.found
    }

    /// The channel on which the fewest PANs were heard.
    pub(super) fn quietest(&self) -> Option<Channel> {
        let pans = |channel| {
            let here = self.found.iter().filter(|found| found.channel == channel);
            here.count()
        };
        self.all.iter().min_by_key(|&channel| pans(channel))
    }

    /// An identifier that no PAN heard uses, from the numbers drawn.
    pub(super) fn free_pan(&self, mut draw: impl FnMut() -> u16) -> PanId {
        loop {
            let pan = PanId(draw());
            let is_taken = self.found.iter().any(|found| found.pan == pan);
            // 0xFFFE and 0xFFFF mean something else.
            if !is_taken && pan.0 < ShortAddress::UNASSIGNED.0 {
                return pan;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOUND: Found = Found {
        pan: PanId(0x1234),
        channel: Channel::FIRST,
        coordinator: None,
        is_open: false,
        strength: 0,
    };

    #[test]
    fn an_identifier_that_means_nothing_else_and_nobody_has() {
        let mut scan = Scan::new(Channels::ALL);
        scan.on_beacon(FOUND, &mut Jitter::new(1));
        let mut drawn = [0x1234, 0xFFFE, 0xFFFF, 0xFFFD].into_iter();
        let pan = scan.free_pan(|| drawn.next().unwrap());
        assert_eq!(pan, PanId(0xFFFD));
    }

    /// However many forged beacons come, before or after it, a network is found in some scan.
    #[test]
    fn forged_beacons_keep_no_network_out() {
        let own = Found {
            is_open: true,
            ..FOUND
        };
        for (before, after) in [(16, 0), (0, 16), (100, 0), (0, 100), (50, 50)] {
            let mut jitter = Jitter::new(7);
            let mut scans = 0;
            for _ in 0..400 {
                let mut scan = Scan::new(Channels::ALL);
                let forged = |n| Found {
                    pan: PanId(n),
                    ..FOUND
                };
                let beacons = (0..before).map(forged).chain([own]);
                for found in beacons.chain((1000..1000 + after).map(forged)) {
                    scan.on_beacon(found, &mut jitter);
                }
                scans += usize::from(scan.found().contains(&own));
            }
            let share = f64::from(scans as u32) / 400.0;
            let expected = 16.0 / f64::from(before + after + 1);
            assert!((share - expected).abs() < 0.1, "{before} {after}: {share}");
        }
    }

    #[test]
    fn a_network_counts_once() {
        let mut scan = Scan::new(Channels::only(Channel::FIRST).and(Channel::LAST));
        let elsewhere = |pan| Found {
            pan: PanId(pan),
            channel: Channel::LAST,
            ..FOUND
        };
        for found in [FOUND, FOUND, FOUND, elsewhere(1), elsewhere(2)] {
            scan.on_beacon(found, &mut Jitter::new(1));
        }
        assert_eq!(scan.found().len(), 3);
        assert_eq!(scan.quietest(), Some(Channel::FIRST));
    }
}
