//! The log as an application uses it: a range of its own, larger slots.

use crate::support;

use embassy_futures::block_on;
use flash_log::{Entry, Log, LogError};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use support::{Flash, PAGE, chip, length};
use virtual_hardware::flash::FlashError;

const SLOT: usize = 96;
const SMALL: u32 = length(4);
const LARGE: u32 = length(8);
type Facts = Log<Flash, SLOT>;

fn log(flash: Flash) -> Facts {
    Log::new(flash, 0..SMALL).unwrap()
}

fn fact(key: u8, first: u8) -> Entry<SLOT> {
    let value: [u8; 90] = core::array::from_fn(|i| first.wrapping_add(i as u8));
    Entry::new(key, &value).unwrap()
}

#[test]
fn an_unused_range_is_an_empty_log() {
    // Bytes that no log has written are no log either.
    for byte in [0xFF, 0, 0x5A] {
        let flash = chip(4, 0);
        flash.bytes_mut().fill(byte);
        block_on(async {
            let mut log = log(flash);
            assert_eq!(log.find(1).await, Err(LogError::NotOpen));
            assert_eq!(log.append(&fact(1, 1)).await, Err(LogError::NotOpen));
            log.open().await.unwrap();
            assert_eq!(log.find(1).await, Ok(None));
            log.append(&fact(1, 1)).await.unwrap();
            assert_eq!(log.find(1).await, Ok(Some(fact(1, 1))));
        });
    }
}

/// Frozen: version 1. The checksums are zlib's.
#[test]
fn format() {
    let flash = block_on(async {
        let mut log = log(chip(4, 0));
        log.open().await.unwrap();
        log.append(&fact(9, 1)).await.unwrap();
        log.into_flash()
    });
    let mut expected = vec![1, 255, 1, 0, 0, 0];
    expected.resize(92, 0);
    expected.extend(HEADER_SUM);
    expected.extend([1, 9]);
    expected.extend(1..=90);
    expected.extend(FACT_SUM);
    expected.resize(SMALL as usize, 0xFF);
    assert_eq!(*flash.bytes(), *expected);
}

const HEADER_SUM: [u8; 4] = [0x35, 0xFB, 0xB2, 0x99];
const FACT_SUM: [u8; 4] = [0x54, 0x10, 0x5F, 0x8E];

/// 512 bytes are five slots of 96, one of them the header.
#[test]
fn full_is_full_and_stays_open() {
    block_on(async {
        let mut log = log(chip(4, 0));
        log.open().await.unwrap();
        for key in 0..4 {
            log.append(&fact(key, key)).await.unwrap();
        }
        for _ in 0..3 {
            assert_eq!(log.append(&fact(4, 4)).await, Err(LogError::Full));
        }
        for key in 0..4 {
            assert_eq!(log.find(key).await, Ok(Some(fact(key, key))));
        }
        assert_eq!(log.find(4).await, Ok(None));
    });
}

#[test]
fn a_layout_that_does_not_fit_is_refused() {
    let len = SMALL;
    assert!(matches!(
        Log::<_, 30>::new(chip(4, 0), 0..len),
        Err(LogError::Layout)
    ));
    assert!(matches!(
        Log::<_, { 2 * PAGE }>::new(chip(4, 0), 0..len),
        Err(LogError::Layout)
    ));
    assert!(matches!(
        Log::<_, 32>::new(chip(4, 0), 0..len - PAGE as u32),
        Err(LogError::Layout)
    ));
}

/// The power fails in the middle of changes, the first opening included. Each record is the one
/// last written, or the one that was being written.
#[test]
fn records_survive_power_cuts() {
    const KEYS: u8 = 3;
    let mut rng = ChaCha8Rng::seed_from_u64(0xFAC7);
    for round in 0..40 {
        let mut flash = chip(4, round);
        let mut kept = [None; KEYS as usize];
        for _ in 0..100 {
            let exponent = rng.random_range(0..9);
            flash.power(Some(1 + rng.random_range(0..1 << exponent)));
            let mut log = log(flash);
            let mut trying = None;
            let failed = block_on(async {
                log.open().await?;
                loop {
                    for key in 0..KEYS {
                        let found = log.find(key).await?;
                        assert_eq!(found, kept[usize::from(key)], "{key} in round {round}");
                    }
                    let entry = fact(rng.random_range(0..KEYS), rng.random());
                    trying = Some(entry);
                    log.append(&entry).await?;
                    kept[usize::from(entry.key())] = trying.take();
                }
                #[expect(unreachable_code, reason = "tells the type")]
                Ok::<(), LogError<FlashError>>(())
            });
            assert_eq!(failed, Err(LogError::Flash(FlashError::Failed)));
            flash = log.into_flash();
            flash.power(None);
            if let Some(entry) = trying {
                // Old or new, but from now on always the same.
                let mut log = Log::new(flash, 0..SMALL).unwrap();
                let found = block_on(async {
                    log.open().await.unwrap();
                    log.find(entry.key()).await.unwrap()
                });
                let place = &mut kept[usize::from(entry.key())];
                assert!(found == *place || found == Some(entry));
                *place = found;
                flash = log.into_flash();
            }
        }
    }
}

/// Five keys, some of which were written several times.
fn written() -> (Flash, [u8; 5]) {
    let newest = [40, 31, 22, 33, 44];
    let flash = block_on(async {
        let mut log = Log::<_, SLOT>::new(chip(8, 3), 0..LARGE).unwrap();
        log.open().await.unwrap();
        for (key, first) in [
            (0, 10),
            (1, 31),
            (2, 22),
            (0, 40),
            (3, 13),
            (4, 44),
            (3, 33),
        ] {
            log.append(&fact(key, first)).await.unwrap();
        }
        log.into_flash()
    });
    (flash, newest)
}

fn opened(flash: Flash) -> Log<Flash, SLOT> {
    let mut log = Log::new(flash, 0..LARGE).unwrap();
    block_on(log.open()).unwrap();
    log
}

/// Every bit of the flash, in both directions: nothing is lost, and a header is none of it.
#[test]
fn any_single_bit_may_rot() {
    let (flash, newest) = written();
    for bit in 0..LARGE as usize * 8 {
        let rotten = flash.copy();
        rotten.bytes_mut()[bit / 8] ^= 1 << (bit % 8);
        let mut log = opened(rotten);
        for (key, &first) in (0..).zip(&newest) {
            let found = block_on(log.find(key)).unwrap();
            assert_eq!(found, Some(fact(key, first)), "key {key}, bit {bit}");
        }
        assert_eq!(block_on(log.find(5)), Ok(None));
        // It was put right for good, and goes on.
        let mut log = opened(log.into_flash());
        block_on(log.append(&fact(1, 77))).unwrap();
        assert_eq!(block_on(log.find(1)), Ok(Some(fact(1, 77))));
        assert_eq!(block_on(log.find(4)), Ok(Some(fact(4, 44))));
    }
}

proptest! {
    /// More of a record rots than can be put right: it alone is lost, and the record that it replaced does not
    /// come back. The last record looks torn: there the one before it counts.
    #[test]
    fn a_rotten_record_is_lost_alone(
        slot in 0..8_usize,
        flips in prop::collection::btree_set(16..SLOT * 8, 2..40),
    ) {
        let (flash, newest) = written();
        for flip in flips {
            flash.bytes_mut()[slot * SLOT + flip / 8] ^= 1 << (flip % 8);
        }
        let mut log = opened(flash);
        // Key of each slot, if it is its newest; slot 0 is the header.
        let lost = [None, None, Some(1), Some(2), Some(0), None, Some(4), Some(3)][slot];
        for _ in 0..2 {
            for (key, &first) in (0..).zip(&newest) {
                let found = block_on(log.find(key)).unwrap();
                let expected = match lost {
                    Some(3) if key == 3 => Some(fact(3, 13)),
                    Some(gone) if key == gone => None,
                    _ => Some(fact(key, first)),
                };
                prop_assert_eq!(found, expected, "key {} of slot {}", key, slot);
            }
            log = opened(log.into_flash());
        }
    }
}

/// Up to two bits of a key, of every slot: it is known which it was, and nothing is lost.
#[test]
fn a_key_may_rot() {
    let (flash, newest) = written();
    for slot in 0..8 {
        for flips in (1_u8..=255).filter(|flips| flips.count_ones() <= 2) {
            let rotten = flash.copy();
            rotten.bytes_mut()[slot * SLOT + 1] ^= flips;
            let mut log = opened(rotten);
            for _ in 0..2 {
                for (key, &first) in (0..).zip(&newest) {
                    let found = block_on(log.find(key)).unwrap();
                    let expected = Some(fact(key, first));
                    assert_eq!(found, expected, "slot {slot}, {flips:#x}, key {key}");
                }
                log = opened(log.into_flash());
            }
        }
    }
}

/// A log that must not lose anything is refused instead.
#[test]
fn who_recovers_is_told_of_rot() {
    let (flash, _) = written();
    for slot in 0..7 {
        let rotten = flash.copy();
        rotten.bytes_mut()[slot * SLOT + 20] ^= 1;
        let mut log = Log::<_, SLOT>::new(rotten, 0..LARGE).unwrap();
        let recovered = block_on(log.recover(|_, _| {}));
        assert_eq!(recovered, Err(LogError::Corrupt), "slot {slot}");
    }
    // And of rot during use, the last record included.
    for slot in 1..8 {
        let rotten = flash.copy();
        let mut log = Log::<_, SLOT>::new(rotten.clone(), 0..LARGE).unwrap();
        assert_eq!(block_on(log.recover(|_, _| {})), Ok(true));
        rotten.bytes_mut()[slot * SLOT + 20] ^= 1;
        assert_eq!(block_on(log.find(9)), Err(LogError::Corrupt));
        let full = block_on(async {
            for n in 0..8 {
                log.append(&fact(2, n)).await?;
            }
            Ok(())
        });
        assert_eq!(full, Err(LogError::Corrupt), "slot {slot}");
    }
}
