//! The memory of a role in a flash that loses its power and rots.

use crate::support;

use std::collections::BTreeMap;

use calib_core::{
    camera::Projection,
    dead_reckoning::{Place, PlaceParts, Systematic},
    joint::Quantity,
    level::{Elevation, Mounting},
};
use embassy_futures::block_on;
use flash_log::{Entry, Log, LogError};
use nalgebra::{Point2, Vector2};
use node_firmware::{
    facts::{
        self, BEARINGS_PER_RECORD, Colours, Fact, FactStore, KeptSighting, ReferenceStop,
        STOPS_PER_RECORD, Walk, WalkBearing, WalkLeg, WalkStop,
    },
    limits::{MEMBERS, REFERENCE_STOPS, SIGHTINGS, WALK_BEARINGS, WALK_STOPS},
    message::{CameraState, Duty, FittingLens, Mount, PoseParts, References, Report, Seen},
    network::{Attachment, NetworkIdentity},
    vision::ColourWindow,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::flash::{self, Flash};
use virtual_hardware::flash::FlashError;

/// Small, so that it is often full; only a long walk takes as much as there is on the boards.
const LEN: u32 = flash::length(32);
const WHOLE: u32 = facts::BYTES;
const SLOT: usize = 96;
/// Owner of the facts.
const OWNER: u32 = 0x0123_4567;

fn place() -> Place<f32> {
    Place::new(PlaceParts {
        position: Point2::new(1.0, 2.0),
        fix: u32::MAX,
        fix_covariance: [1.0, 0.5, 2.0],
        step_covariance: [2.0, 0.0, 1.0],
        walked: Vector2::new(0.5, 1.0),
        systematic: Systematic {
            heading_sigma: 0.5,
            scale_sigma: 1.0,
        },
        standing_sigma: 2.0,
    })
    .unwrap()
}

fn seen(bearing: f32) -> Seen {
    Seen::direction(bearing, 0.5)
}

fn pose() -> PoseParts {
    PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [1.0, 0.0, 2.0, 0.0, 0.5, 1.0],
    }
}

fn report(id: u16) -> Report {
    Report {
        id,
        duty: Some(Duty::Second),
        sightings: 255,
        used: 255,
        chi_squared: 2.0,
        done: true,
        joint: None,
        state: CameraState::OtherLens(pose(), FittingLens::new(Projection::EqualAngle, 6.0)),
        mount: Mount::of(
            Mounting {
                pitch: -1.5,
                roll: 3.0,
            },
            2.0,
        ),
    }
}

fn sighting(index: u8, bearing: f32) -> Fact {
    Fact::Sighting(
        index,
        Some(KeptSighting {
            target: u16::MAX,
            stop: u16::MAX,
            place: place(),
            seen: seen(bearing),
        }),
    )
}

fn colours() -> Fact {
    let window = ColourWindow {
        red: [170, 240],
        green: [60, 140],
        blue: [16, 80],
    };
    Fact::Colours(Colours {
        configured: u32::MAX,
        learnt: [Some(window); 4],
    })
}

fn network() -> Fact {
    Fact::Network(Attachment {
        network: NetworkIdentity {
            number: 0x1234,
            founder: [2, 0, 0, 0, 0, 0, 0, 9],
        },
        own: u16::MAX,
    })
}

/// The longest of each kind, in the order of their keys.
fn longest() -> [Fact; 11] {
    [
        Fact::Report(Some(report(u16::MAX))),
        Fact::References(Some(References {
            first: u16::MAX,
            second: u16::MAX,
            positions: Some([[1.0, 2.0], [3.0, 4.0]]),
        })),
        Fact::Walk(Walk {
            stop: u16::MAX,
            standing: true,
            place: place(),
            located: true,
            frame_heading: Some(1.0),
            frame_heading_sigma: 0.5,
            scale: 1.05,
        }),
        Fact::Posed(Some(report(u16::MAX))),
        colours(),
        network(),
        sighting(SIGHTINGS as u8 - 1, 1.0),
        Fact::ReferenceStop(
            REFERENCE_STOPS as u8 - 1,
            Some(ReferenceStop {
                target: u16::MAX,
                stop: u16::MAX,
                place: Some(place()),
                own: Some(seen(1.0)),
                other: Some(seen(2.0)),
            }),
        ),
        Fact::Camera(MEMBERS as u8 - 1, Some((u16::MAX, report(u16::MAX)))),
        walk_stops(RECORDS[0] - 1, [1.5; 2]),
        walk_bearings(RECORDS[1] - 1, 1.0),
    ]
}

/// Records of the stops and of the bearings of the longest walk.
const RECORDS: [u8; 2] = [
    WALK_STOPS.div_ceil(STOPS_PER_RECORD) as u8,
    WALK_BEARINGS.div_ceil(BEARINGS_PER_RECORD) as u8,
];

fn walk_stops(record: u8, displacement: [f32; 2]) -> Fact {
    let stop = WalkStop {
        stop: u16::MAX,
        leg: Some(WalkLeg {
            from: u16::MAX - 1,
            displacement,
            covariance: [1.0, 0.5, 2.0],
        }),
    };
    Fact::WalkStops(record, [Some(stop); STOPS_PER_RECORD])
}

fn walk_bearings(record: u8, value: f32) -> Fact {
    let bearing = WalkBearing {
        stop: 0x1234,
        camera: u16::MAX,
        quantity: Quantity::Range,
        value,
        sigma: 0.5,
        elevation: Elevation::UNKNOWN,
    };
    Fact::WalkBearings(record, [Some(bearing); BEARINGS_PER_RECORD])
}

fn recall(flash: &mut Flash) -> Vec<Fact> {
    block_on(async {
        let mut memory = FactStore::open(flash, 0..LEN, OWNER).await.unwrap();
        let mut facts = Vec::new();
        memory.recall(|fact| facts.push(*fact)).await.unwrap();
        facts
    })
}

/// Start of the bank in force, of a flash at rest.
fn bank(flash: &Flash) -> usize {
    match flash.bytes()[..2] {
        [1, 255] => 0,
        _ => LEN as usize / 2,
    }
}

fn save(flash: &mut Flash, facts: &[Fact]) {
    block_on(async {
        let mut memory = FactStore::open(flash, 0..LEN, OWNER).await.unwrap();
        for fact in facts {
            memory.save(fact).await.unwrap();
        }
    });
}

#[test]
fn the_longest_fact_of_each_kind_survives_a_restart() {
    let mut buffer = [0; 256];
    for fact in longest() {
        let length = postcard::to_slice(&fact, &mut buffer).unwrap().len();
        println!("{length:3} of {}: {fact:?}", Entry::<SLOT>::VALUE_MAX);
        assert!(length <= Entry::<SLOT>::VALUE_MAX);
    }
    let mut flash = flash::chip(32, 0);
    save(&mut flash, &longest());
    assert_eq!(recall(&mut flash), longest());
}

/// Frozen: the value of each kind of fact begins with the number of its variant.
#[test]
fn format() {
    let mut buffer = [0; 256];
    let mut bytes = |fact: &Fact| postcard::to_slice(fact, &mut buffer).unwrap().to_vec();
    assert_eq!(bytes(&Fact::Report(None)), [0, 0]);
    assert_eq!(bytes(&Fact::References(None)), [1, 0]);
    assert_eq!(bytes(&longest()[2])[..5], [2, 0xFF, 0xFF, 3, 1]);
    assert_eq!(bytes(&Fact::Sighting(7, None)), [3, 7, 0]);
    assert_eq!(bytes(&Fact::ReferenceStop(7, None)), [4, 7, 0]);
    assert_eq!(bytes(&Fact::Camera(7, None)), [5, 7, 0]);
    assert_eq!(bytes(&Fact::Posed(None)), [6, 0]);
    let learnt = [7, 255, 255, 255, 255, 15, 1, 170, 240, 60, 140, 16, 80, 1];
    assert_eq!(bytes(&colours())[..14], learnt);
    let network_bytes = [8, 0xB4, 0x24, 2, 0, 0, 0, 0, 0, 0, 9, 0xFF, 0xFF, 3];
    assert_eq!(bytes(&network()), network_bytes);
    // A stop without a way to it, and none; numbers of stops and addresses take two bytes.
    let mut stops = [None; STOPS_PER_RECORD];
    stops[1] = Some(WalkStop {
        stop: 0x1234,
        leg: None,
    });
    assert_eq!(
        bytes(&Fact::WalkStops(33, stops)),
        [9, 33, 0, 1, 0x34, 0x12, 0, 0]
    );
    let half = [0x00, 0x00, 0x00, 0x3F];
    let [one, two] = [[0x00, 0x00, 0x80, 0x3F], [0x00, 0x00, 0x00, 0x40]];
    let stops = bytes(&walk_stops(0, [0.5, 1.0]));
    let leg = [
        &[1, 0xFF, 0xFF, 1, 0xFE, 0xFF][..],
        &half,
        &one,
        &one,
        &half,
        &two,
    ]
    .concat();
    assert_eq!(stops[2..][..leg.len()], leg);
    assert_eq!(stops.len(), 2 + STOPS_PER_RECORD * leg.len());
    let bearings = bytes(&walk_bearings(63, 1.0));
    let range = [
        &[1, 0x34, 0x12, 0xFF, 0xFF, 1][..],
        &one,
        &half,
        &[0xFF, 0xFF, 3],
    ]
    .concat();
    assert_eq!(bearings, [&[10, 63][..], &range.repeat(5)].concat());
    let none = bytes(&Fact::WalkBearings(63, [None; BEARINGS_PER_RECORD]));
    assert_eq!(none, [10, 63, 0, 0, 0, 0, 0]);
    // Their owner.
    let mut flash = flash::chip(32, 0);
    assert_eq!(recall(&mut flash), []);
    let owner = bank(&flash) + SLOT;
    assert_eq!(
        flash.bytes()[owner..][..8],
        [1, 254, 8, 0x67, 0x45, 0x23, 0x01, 0]
    );
    // No width, no row.
    let seen = [0, 0, 0x80, 0x3F, 0, 0, 0, 0x3F, 0, 0xFF, 0xFF, 3];
    assert!(bytes(&sighting(1, 1.0)).ends_with(&seen));
}

/// No fact is written over another one.
#[test]
fn all_facts_of_a_camera_fit_together() {
    let mut facts = longest()[..6].to_vec();
    facts.extend((0..SIGHTINGS as u8).map(|index| sighting(index, f32::from(index))));
    facts.extend((0..REFERENCE_STOPS as u8).map(|index| match longest()[7] {
        Fact::ReferenceStop(_, stop) => Fact::ReferenceStop(index, stop),
        _ => unreachable!(),
    }));
    let mut flash = flash::chip(32, 1);
    for _ in 0..5 {
        save(&mut flash, &facts);
    }
    assert_eq!(recall(&mut flash), facts);
}

#[test]
fn all_facts_of_a_target_fit_together() {
    let mut facts = vec![longest()[2], network()];
    facts.extend((0..MEMBERS as u8).map(|n| Fact::Camera(n, Some((n.into(), report(n.into()))))));
    facts.extend((0..RECORDS[0]).map(|n| walk_stops(n, [1.0, n.into()])));
    facts.extend((0..RECORDS[1]).map(|n| walk_bearings(n, n.into())));
    assert_eq!(facts.len(), 213);
    let mut flash = flash::chip(WHOLE as usize / flash::PAGE, 2);
    let mut recalled = Vec::new();
    block_on(async {
        let mut memory = FactStore::open(&mut flash, 0..WHOLE, OWNER).await.unwrap();
        for fact in (0..5).flat_map(|_| &facts) {
            memory.save(fact).await.unwrap();
        }
        memory.recall(|fact| recalled.push(*fact)).await.unwrap();
    });
    assert_eq!(recalled, facts);
    // As the documentation counts: a bank is full after 96 more.
    let slots = WHOLE as usize / 2 / SLOT;
    assert_eq!((slots, slots - 1 - (facts.len() + 1)), (298, 83));
}

/// An erasure is written down as well, in the room of the fact that it replaces. So there is as much room
/// before as after, and nothing is lost in whichever order a role writes.
#[test]
fn erasing_needs_no_room_and_makes_none() {
    let known = |n: u8, id| Fact::Camera(n, Some((n.into(), report(id))));
    // As many as the small flash takes.
    const CAMERAS: u8 = 32;
    let half = CAMERAS / 2;
    for erased_first in [true, false] {
        let mut flash = flash::chip(32, 5);
        let mut expected = vec![longest()[2], network()];
        save(&mut flash, &expected);
        let all: Vec<_> = (0..CAMERAS).map(|n| known(n, 1)).collect();
        save(&mut flash, &all);
        // Other members, and fewer.
        let written = (0..half).map(|n| known(n, 2));
        let erased = (half..CAMERAS).map(|n| Fact::Camera(n, None));
        expected.extend(written.clone().chain(erased.clone()));
        for _ in 0..5 {
            let facts: Vec<_> = if erased_first {
                erased.clone().chain(written.clone()).collect()
            } else {
                written.clone().chain(erased.clone()).collect()
            };
            save(&mut flash, &facts);
            assert_eq!(recall(&mut flash), expected);
        }
    }
}

/// More facts than fit, which no role has. It goes on.
#[test]
fn a_full_memory_is_begun_anew() {
    let mut flash = flash::chip(32, 3);
    for n in 0..MEMBERS as u8 {
        save(&mut flash, &[sighting(n, 1.0)]);
    }
    for n in 0..MEMBERS as u8 {
        let fact = Fact::Camera(n, Some((n.into(), report(n.into()))));
        save(&mut flash, &[fact]);
        assert!(recall(&mut flash).contains(&fact));
    }
}

/// Facts that another node, or this one in another role, has written are not recalled; nor are those of
/// firmware of the former version.
#[test]
fn facts_of_others_are_dropped() {
    let mut flash = flash::chip(32, 7);
    save(&mut flash, &longest());
    for owner in [OWNER + 1, OWNER] {
        let mut facts = 0;
        block_on(async {
            let mut memory = FactStore::open(&mut flash, 0..LEN, owner).await.unwrap();
            memory.recall(|_| facts += 1).await.unwrap();
            memory.save(&sighting(1, 1.0)).await.unwrap();
        });
        assert_eq!(facts, 0, "{owner}");
    }
    assert_eq!(recall(&mut flash), [sighting(1, 1.0)]);

    let mut value = [0; 90];
    let value = postcard::to_slice(&sighting(1, 1.0), &mut value).unwrap();
    let mut flash = flash::chip(32, 8);
    block_on(async {
        let mut log = Log::<_, SLOT>::new(&mut flash, 0..LEN).unwrap();
        log.open().await.unwrap();
        log.append(&Entry::new(8 + 1, value).unwrap())
            .await
            .unwrap();
    });
    assert_eq!(recall(&mut flash), []);
    save(&mut flash, &longest());
    assert_eq!(recall(&mut flash), longest());
}

/// One bit may flip: nothing is lost. With any damage to one record only this one is lost at most, and its
/// predecessor does not come back; with damage to that of the owner, all are lost.
#[test]
fn rot_is_survived() {
    let mut whole = flash::chip(32, 4);
    save(&mut whole, &[sighting(SIGHTINGS as u8 - 1, 7.0)]);
    save(&mut whole, &longest());
    let mut rng = ChaCha8Rng::seed_from_u64(0x5071);
    // The header, the owner, and the replaced fact come first.
    let slots = longest().len() + 3;
    for bit in (0..slots * SLOT * 8).step_by(13) {
        let mut flash = whole.copy();
        flash.bytes_mut()[bank(&whole) + bit / 8] ^= 1 << (bit % 8);
        assert_eq!(recall(&mut flash), longest(), "bit {bit}");
    }
    for round in 0..300 {
        let mut flash = whole.copy();
        let slot = round % slots;
        for _ in 0..rng.random_range(2..20) {
            // All but the key, which tells the fact that is lost.
            let at = bank(&whole) + slot * SLOT + rng.random_range(2..SLOT);
            flash.bytes_mut()[at] ^= 1 << rng.random_range(0..8);
        }
        let recalled = recall(&mut flash);
        let mut expected = longest().to_vec();
        if slot == 1 {
            expected.clear();
        } else if slot >= 3 {
            expected.retain(|fact| *fact != longest()[slot - 3]);
        }
        // Few flips may cancel each other, or leave one.
        assert!(
            recalled == expected || recalled == longest(),
            "{slot}: {recalled:?}"
        );
        // And goes on.
        save(&mut flash, &[sighting(3, 2.0)]);
        assert!(recall(&mut flash).contains(&sighting(3, 2.0)));
    }
}

/// It rots while the node runs, and is put right when the bank is full.
#[test]
fn rot_at_work_is_survived() {
    let mut rotten = flash::chip(32, 5);
    save(&mut rotten, &longest());
    block_on(async {
        let chip = rotten.clone();
        let mut memory = FactStore::open(&mut rotten, 0..LEN, OWNER).await.unwrap();
        for n in 0..200_u8 {
            if n == 60 {
                // The records of both banks are there.
                for bank in [0, LEN as usize / 2] {
                    chip.bytes_mut()[bank + 2 * SLOT + 9] ^= 4;
                }
            }
            memory.save(&sighting(1, f32::from(n))).await.unwrap();
        }
    });
    let mut expected = longest().to_vec();
    expected.insert(6, sighting(1, 199.0));
    assert_eq!(recall(&mut rotten), expected);
}

/// However full the memory is, each of its records is read once for each 60 keys to find the newest
/// ones, and once more if it is one.
#[test]
fn recalling_reads_each_record_five_times_at_most() {
    for count in [0, 30, 2000] {
        let mut flash = flash::chip(32, 9);
        for n in 0..count {
            save(&mut flash, &[sighting(n as u8 % SIGHTINGS as u8, n as f32)]);
        }
        let chip = flash.clone();
        let mut facts = 0;
        let reads = block_on(async {
            let mut memory = FactStore::open(&mut flash, 0..LEN, OWNER).await.unwrap();
            let before = chip.wear().reads;
            memory.recall(|_| facts += 1).await.unwrap();
            chip.wear().reads - before
        });
        assert_eq!(facts, count.min(SIGHTINGS as u64));
        let slots = u64::from(LEN) / 2 / SLOT as u64;
        assert!(reads <= 5 * slots, "{reads}");
    }
}

/// The power fails in the middle of writes, of compaction and of opening. Each fact is then the
/// one last written, or the one that was being written.
#[test]
fn power_cuts_are_survived() {
    let mut rng = ChaCha8Rng::seed_from_u64(0xC075);
    let mut flash = flash::chip(32, 6);
    let mut kept: BTreeMap<u8, Fact> = BTreeMap::new();
    for _ in 0..400 {
        // Up to a bank's worth of words and pages.
        let budget = 1 << rng.random_range(0..12);
        flash.power(Some(rng.random_range(1..=budget)));
        let mut trying = None;
        let failed = block_on(async {
            let mut memory = FactStore::open(&mut flash, 0..LEN, OWNER).await?;
            loop {
                let index = rng.random_range(0..SIGHTINGS as u8);
                let fact = sighting(index, rng.random());
                trying = Some((index, fact));
                memory.save(&fact).await?;
                kept.extend(trying.take());
            }
            #[expect(unreachable_code, reason = "tells the type")]
            Ok::<(), LogError<_>>(())
        });
        assert_eq!(failed, Err(LogError::Flash(FlashError::Failed)));
        flash.power(None);
        let recalled = recall(&mut flash);
        if let Some((index, fact)) = trying
            && recalled.contains(&fact)
        {
            kept.insert(index, fact);
        }
        assert!(recalled.iter().eq(kept.values()));
    }
    assert!(flash.wear().erasures.iter().all(|&n| n > 2));
}
