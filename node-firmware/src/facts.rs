//! Facts that a role must not forget over a restart, in a log in flash.
//!
//! The radio's own records (frame counters, keys, membership) are in another range of the flash,
//! see [`zigbee_link::store`]. A fact that is lost costs work, never safety: it is learnt again.
//!
//! # Format, version 8
//! One record of the log for each fact. Its key says which, its value is the fact, postcard. The number of
//! the [`Fact`]'s variant leads the value. One more record names the node and role of the facts. Where it is
//! missing or another's, as in versions 1 to 7, they are not recalled, and the memory is begun anew.
//!
//! | key | fact |
//! |---|---|
//! | 0 | [`Fact::Report`] |
//! | 1 | [`Fact::References`] |
//! | 2 | [`Fact::Walk`] |
//! | 3 | [`Fact::Posed`] |
//! | 4 | [`Fact::Colours`] |
//! | 5 | [`Fact::Network`] |
//! | 8 + n | [`Fact::Sighting`] n |
//! | 24 + n | [`Fact::ReferenceStop`] n |
//! | 36 + n | [`Fact::Camera`] n |
//! | 136 + n | [`Fact::WalkStops`] n |
//! | 170 + n | [`Fact::WalkBearings`] n |
//! | 254 | 8, [`Config::owner`] as little-endian u32 |
//!
//! # Wear
//! A page of the nRF52840 can be erased 10,000 times (Product Specification, "NVMC"), and [`BYTES`] are
//! two banks of 298 records, which are erased in turn. A target with the longest walk it can keep, and
//! the most cameras, has 214 live records; so a bank takes 83 more before it is full, and both together
//! 1.6 million. A stop costs some 3 for the walk (the stop, that it stands, that it leaves), one for each
//! five bearings, up to as many again where another stop makes room, and one for each camera whose pose
//! became better: 20 of them are 83,000 stops, or seven years of 30 stops a day. With 13 cameras and
//! walks of 30 stops there are 40 live records and twice as many stops.
//!
//! [`Config::owner`]: crate::config::Config::owner

use core::ops::Range;

use calib_core::{dead_reckoning::Place, joint::Quantity, level::Elevation};
use embedded_storage_async::nor_flash::NorFlash;
use flash_log::{Entry, Log, LogError};
use serde::{Deserialize, Serialize};

use crate::{
    limits::{self, COLOURS_MAX},
    log::warning,
    message::{MemberAddress, References, Report, Seen, StopNumber},
    network::Attachment,
    vision::ColourWindow,
};

/// One above the highest key.
const KEYS: u8 = WALK_BEARINGS_FROM + BEARING_RECORDS;
/// Keys that are looked for in one pass over the log: more take more memory, fewer more time.
const KEYS_AT_A_TIME: u8 = 62;
const _: () =
    assert!(KEYS.div_ceil(KEYS_AT_A_TIME) as u16 * (KEYS_AT_A_TIME as u16) < OWNER as u16);
/// Key of the record that names the owner of the facts.
const OWNER: u8 = 254;
/// First byte of its value.
const VERSION: u8 = 8;
/// Bytes of a record of the log.
const SLOT: usize = 96;

/// Bytes of flash that the facts of any role take, and leave room to write for long.
pub const BYTES: u32 = 14 * 4096;

/// Stops of a walk in a record.
pub const STOPS_PER_RECORD: usize = 3;
/// Bearings of a walk in a record.
pub const BEARINGS_PER_RECORD: usize = 5;
/// Records of all stops that a target keeps, and of all bearings.
pub(crate) const STOP_RECORDS: u8 = limits::WALK_STOPS.div_ceil(STOPS_PER_RECORD) as u8;
pub(crate) const BEARING_RECORDS: u8 = limits::WALK_BEARINGS.div_ceil(BEARINGS_PER_RECORD) as u8;

/// One thing to remember. Written again, it replaces the former one under the same key.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Fact {
    /// A camera: its report. `None`: nothing.
    Report(Option<Report>),
    /// Camera and coordinator: the references.
    References(Option<References>),
    /// A target: its walk.
    Walk(Walk),
    /// A camera's sighting in this place of its list.
    Sighting(u8, Option<KeptSighting>),
    /// A reference camera's stop in this place of its list.
    ReferenceStop(u8, Option<ReferenceStop>),
    /// Target and coordinator: a camera in this place of the table.
    Camera(u8, Option<(MemberAddress, Report)>),
    /// The first reference camera: the report of the second one, which may not have heard it.
    Posed(Option<Report>),
    /// A camera: the colours it learnt.
    Colours(Colours),
    /// Camera and target: the network that the addresses in all other facts are of.
    Network(Attachment),
    /// A target: stops of its walk, in these places of its list: those from
    /// [`STOPS_PER_RECORD`] times the number on.
    WalkStops(u8, [Option<WalkStop>; STOPS_PER_RECORD]),
    /// A target: bearings of its walk, in these places of its list: those from
    /// [`BEARINGS_PER_RECORD`] times the number on.
    WalkBearings(u8, [Option<WalkBearing>; BEARINGS_PER_RECORD]),
}

/// Name of a fact: there is one fact for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FactKey {
    /// [`Fact::Report`].
    Report,
    /// [`Fact::References`].
    References,
    /// [`Fact::Walk`].
    Walk,
    /// [`Fact::Posed`].
    Posed,
    /// [`Fact::Colours`].
    Colours,
    /// [`Fact::Network`].
    Network,
    /// [`Fact::Sighting`] in this place of its list.
    Sighting(u8),
    /// [`Fact::ReferenceStop`] in this place of its list.
    ReferenceStop(u8),
    /// [`Fact::Camera`] in this place of the table.
    Camera(u8),
    /// [`Fact::WalkStops`] of this number.
    WalkStops(u8),
    /// [`Fact::WalkBearings`] of this number.
    WalkBearings(u8),
}

/// Keys of the first record of each list: behind those without one, as many as the list has places.
const SIGHTINGS_FROM: u8 = 8;
const REFERENCE_STOPS_FROM: u8 = SIGHTINGS_FROM + limits::SIGHTINGS as u8;
const CAMERAS_FROM: u8 = REFERENCE_STOPS_FROM + limits::REFERENCE_STOPS as u8;
const WALK_STOPS_FROM: u8 = CAMERAS_FROM + limits::MEMBERS_MOST as u8;
const WALK_BEARINGS_FROM: u8 = WALK_STOPS_FROM + STOP_RECORDS;

const _: () = assert!(KEYS < OWNER);

impl FactKey {
    /// The key of its record. A place beyond the end of a list has the key of the last place.
    pub const fn record(self) -> u8 {
        const fn within(first: u8, place: u8, end: u8) -> u8 {
            let last = end - 1 - first;
            first + if place < last { place } else { last }
        }
        match self {
            Self::Report => 0,
            Self::References => 1,
            Self::Walk => 2,
            Self::Posed => 3,
            Self::Colours => 4,
            Self::Network => 5,
            Self::Sighting(place) => within(SIGHTINGS_FROM, place, REFERENCE_STOPS_FROM),
            Self::ReferenceStop(place) => within(REFERENCE_STOPS_FROM, place, CAMERAS_FROM),
            Self::Camera(place) => within(CAMERAS_FROM, place, WALK_STOPS_FROM),
            Self::WalkStops(place) => within(WALK_STOPS_FROM, place, WALK_BEARINGS_FROM),
            Self::WalkBearings(place) => within(WALK_BEARINGS_FROM, place, KEYS),
        }
    }

    /// The fact with this key of a record.
    pub const fn of_record(key: u8) -> Option<Self> {
        Some(match key {
            0 => Self::Report,
            1 => Self::References,
            2 => Self::Walk,
            3 => Self::Posed,
            4 => Self::Colours,
            5 => Self::Network,
            SIGHTINGS_FROM..REFERENCE_STOPS_FROM => Self::Sighting(key - SIGHTINGS_FROM),
            REFERENCE_STOPS_FROM..CAMERAS_FROM => Self::ReferenceStop(key - REFERENCE_STOPS_FROM),
            CAMERAS_FROM..WALK_STOPS_FROM => Self::Camera(key - CAMERAS_FROM),
            WALK_STOPS_FROM..WALK_BEARINGS_FROM => Self::WalkStops(key - WALK_STOPS_FROM),
            WALK_BEARINGS_FROM..KEYS => Self::WalkBearings(key - WALK_BEARINGS_FROM),
            _ => return None,
        })
    }
}

impl Fact {
    /// Its name.
    pub const fn key(&self) -> FactKey {
        match self {
            Self::Report(_) => FactKey::Report,
            Self::References(_) => FactKey::References,
            Self::Walk(_) => FactKey::Walk,
            Self::Posed(_) => FactKey::Posed,
            Self::Colours(_) => FactKey::Colours,
            Self::Network(_) => FactKey::Network,
            Self::Sighting(place, _) => FactKey::Sighting(*place),
            Self::ReferenceStop(place, _) => FactKey::ReferenceStop(*place),
            Self::Camera(place, _) => FactKey::Camera(*place),
            Self::WalkStops(place, _) => FactKey::WalkStops(*place),
            Self::WalkBearings(place, _) => FactKey::WalkBearings(*place),
        }
    }
}

/// A camera's sighting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct KeptSighting {
    /// Target that the camera saw.
    pub target: MemberAddress,
    /// By the target's own count.
    pub stop: StopNumber,
    /// Place where the target said that it stood, in the frame of the site.
    pub place: Place<f32>,
    /// Direction in which the camera saw it.
    pub seen: Seen,
}

/// A stop that the reference cameras saw before its place was known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReferenceStop {
    /// Target that the camera saw.
    pub target: MemberAddress,
    /// By the target's own count.
    pub stop: StopNumber,
    /// Its place in the target's own frame, once told.
    pub place: Option<Place<f32>>,
    /// Direction in which this camera saw it. Width and row are not written down.
    #[serde(with = "direction")]
    pub own: Option<Seen>,
    /// Direction in which the other reference camera saw it.
    #[serde(with = "direction")]
    pub other: Option<Seen>,
}

/// A direction alone, as far as the reference solve needs it.
mod direction {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    use crate::message::Seen;

    pub(super) fn serialize<S: Serializer>(
        seen: &Option<Seen>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let direction = seen.map(|seen| (seen.bearing, seen.sigma));
        direction.serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Seen>, D::Error> {
        let direction = Option::<(f32, f32)>::deserialize(deserializer)?;
        let seen = direction.map(|(bearing, sigma)| Seen::direction(bearing, sigma));
        let is_sound = seen.is_none_or(|seen| seen.is_usable());
        let seen = is_sound.then_some(seen);
        seen.ok_or_else(|| D::Error::custom("a number out of range"))
    }
}

/// Colours that a camera learnt, by their number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Colours {
    /// Checksum of the colours of its configuration at that time: with others, the learnt ones are out of
    /// date.
    pub configured: u32,
    /// The learnt ones, which count instead.
    pub learnt: [Option<ColourWindow>; COLOURS_MAX],
}

/// Facts of a target about its walk. Written at each stop and when it leaves one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Walk {
    /// The number of the last stop.
    pub stop: StopNumber,
    /// It stands there. If not, its place is lost by a restart.
    pub standing: bool,
    /// Place where it stood.
    pub place: Place<f32>,
    /// The place is one of the site.
    pub located: bool,
    /// Direction of the step sensor's x axis in the frame of the site, radians, if known.
    pub frame_heading: Option<f32>,
    /// Its standard deviation.
    pub frame_heading_sigma: f32,
    /// Ratio of the step sensor's reading to the true length, as far as it was estimated; one at first.
    pub scale: f32,
}

/// A stop of a walk, and the way by which the target came there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WalkStop {
    /// By the target's own count.
    #[serde(with = "postcard::fixint::le")]
    pub stop: StopNumber,
    /// The way from the stop before. `None` if it was not measured.
    pub leg: Option<WalkLeg>,
}

/// A way from stop to stop, as the step sensor read it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WalkLeg {
    /// The stop at which it began. If that is not the known stop before, it is no way from there.
    #[serde(with = "postcard::fixint::le")]
    pub from: StopNumber,
    /// Displacement, units of length.
    pub displacement: [f32; 2],
    /// Its covariance: xx, xy, yy.
    pub covariance: [f32; 3],
}

/// A camera's measurement of a target at a stop of its walk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WalkBearing {
    /// By the target's own count.
    #[serde(with = "postcard::fixint::le")]
    pub stop: StopNumber,
    /// The camera.
    #[serde(with = "postcard::fixint::le")]
    pub camera: MemberAddress,
    /// Quantity that it measured.
    pub quantity: Quantity,
    /// Radians to the left of its axis, or units of length.
    pub value: f32,
    /// Its standard deviation, above zero.
    pub sigma: f32,
    /// Of a bearing: how far above the camera's horizontal plane the target was.
    pub elevation: Elevation,
}

/// The facts of one node in a range of a flash.
#[derive(Debug)]
pub struct FactStore<F> {
    log: Log<F, SLOT>,
    owner: Entry<SLOT>,
    is_abandoned: bool,
}

impl<F: NorFlash> FactStore<F> {
    /// Opens the memory in `range` of the flash, bytes from its start, an even number of erase
    /// units. That of another `owner` is begun anew. A record that rotted is lost alone, but for the
    /// [limits](flash_log#rot) of the log: of damage to its key and to more, the fact
    /// that it replaced comes back, and that of another key may be lost. With the record of the
    /// owner all are lost.
    ///
    /// # Errors
    /// The range does not fit, or the flash failed.
    pub async fn open(flash: F, range: Range<u32>, owner: u32) -> Result<Self, LogError<F::Error>> {
        let mut memory = Self::closed(flash, range, owner)?;
        memory.reopen().await?;
        Ok(memory)
    }

    /// One in a flash that may not serve: to be [opened](Self::reopen) or [abandoned](Self::abandon).
    ///
    /// # Errors
    /// The range does not fit.
    pub fn closed(flash: F, range: Range<u32>, owner: u32) -> Result<Self, LogError<F::Error>> {
        let [a, b, c, d] = owner.to_le_bytes();
        let owner = Entry::new(OWNER, &[VERSION, a, b, c, d]).ok_or(LogError::Full)?;
        Ok(Self {
            log: Log::new(flash, range)?,
            owner,
            is_abandoned: false,
        })
    }

    /// Opens it, again after the flash failed: as [`open`](Self::open).
    ///
    /// # Errors
    /// The flash failed.
    pub async fn reopen(&mut self) -> Result<(), LogError<F::Error>> {
        self.log.open().await?;
        if self.log.find(OWNER).await? != Some(self.owner) {
            self.forget().await?;
        }
        Ok(())
    }

    /// Remembers nothing from now on, and writes nothing: the flash does not serve, and the role goes on
    /// with its facts in RAM.
    pub const fn abandon(&mut self) {
        self.is_abandoned = true;
    }

    /// Returns true if it was [abandoned](Self::abandon).
    pub const fn is_abandoned(&self) -> bool {
        self.is_abandoned
    }

    /// Begins the memory anew. To be done before a membership becomes void: addresses in it are
    /// those of that network.
    ///
    /// # Errors
    /// The flash failed, or it was abandoned: its contents may be read at the next start.
    pub async fn forget(&mut self) -> Result<(), LogError<F::Error>> {
        if self.is_abandoned {
            return Err(LogError::NotOpen);
        }
        self.log.begin(&[self.owner]).await
    }

    /// Passes every fact that is remembered and understood to `take`, in the order of their keys.
    ///
    /// # Errors
    /// The flash failed.
    pub async fn recall(&mut self, mut take: impl FnMut(&Fact)) -> Result<(), LogError<F::Error>> {
        let mut first = if self.is_abandoned { KEYS } else { 0 };
        while first < KEYS {
            let mut slots = [0; KEYS_AT_A_TIME as usize];
            // A read may fail once.
            let mut failures = 0;
            while let Err(error) = self.log.newest(first, &mut slots).await {
                failures += 1;
                if failures > 1 {
                    return Err(error);
                }
            }
            for (key, slot) in (first..).zip(slots) {
                let mut failures = 0;
                let entry = loop {
                    match self.log.read(slot).await {
                        Ok(entry) => break entry,
                        Err(error) if failures > 0 => return Err(error),
                        Err(_) => failures += 1,
                    }
                };
                if let Some(entry) = entry
                    && let Ok((fact, _)) = postcard::take_from_bytes::<Fact>(entry.value())
                    && fact.key().record() == key
                {
                    take(&fact);
                }
            }
            first += KEYS_AT_A_TIME;
        }
        Ok(())
    }

    /// Writes a fact down. When this returns `Ok`, a loss of power does not undo it.
    ///
    /// A memory that is full is begun anew with this fact: a node that stopped would find it the
    /// same again. [`BYTES`] hold all facts of any role.
    ///
    /// # Errors
    /// The flash failed.
    pub async fn save(&mut self, fact: &Fact) -> Result<(), LogError<F::Error>> {
        if self.is_abandoned {
            return Ok(());
        }
        let mut value = [0; Entry::<SLOT>::VALUE_MAX];
        // Every fact fits: a test writes the longest of each kind.
        let value = postcard::to_slice(fact, &mut value).map_err(|_| LogError::Full);
        debug_assert!(value.is_ok(), "a fact is longer than a record");
        let entry = Entry::new(fact.key().record(), value?).ok_or(LogError::Full)?;
        match self.log.append(&entry).await {
            Err(LogError::Full) => {
                warning!("the memory of the role is full: it is begun anew");
                self.log.begin(&[self.owner, entry]).await
            }
            other => other,
        }
    }
}
