//! The log as an application uses it: a range of its own, larger slots.

mod support;

use embassy_embedded_hal::flash::partition::Partition;
use embassy_futures::block_on;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, mutex::Mutex};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{
    aether::key,
    flash::{MockFlash, PAGE, PowerLoss},
};
use zigbee_link::store::{
    Record, Store,
    log::{Entry, Log, LogError},
};

const SLOT: usize = 96;
type Flash = MockFlash<4>;
type Facts = Log<Flash, SLOT>;

fn log(flash: Flash) -> Facts {
    Log::new(flash, 0..Flash::LEN).unwrap()
}

fn fact(key: u8, first: u8) -> Entry<SLOT> {
    let value: [u8; 90] = core::array::from_fn(|i| first.wrapping_add(i as u8));
    Entry::new(key, &value).unwrap()
}

#[test]
fn an_unused_range_is_an_empty_log() {
    // What no log has written is no log either.
    for byte in [0xFF, 0, 0x5A] {
        let mut flash = Flash::new(0);
        flash.bytes.fill(byte);
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
        let mut log = log(Flash::new(0));
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
    expected.resize(flash.bytes.len(), 0xFF);
    assert_eq!(flash.bytes, expected);
}

const HEADER_SUM: [u8; 4] = [0x35, 0xFB, 0xB2, 0x99];
const FACT_SUM: [u8; 4] = [0x54, 0x10, 0x5F, 0x8E];

/// 512 bytes are five slots of 96, one of them the header.
#[test]
fn full_is_full_and_stays_open() {
    block_on(async {
        let mut log = log(Flash::new(0));
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
    let len = Flash::LEN;
    assert!(matches!(
        Log::<_, 30>::new(Flash::new(0), 0..len),
        Err(LogError::Layout)
    ));
    assert!(matches!(
        Log::<_, { 2 * PAGE }>::new(Flash::new(0), 0..len),
        Err(LogError::Layout)
    ));
    assert!(matches!(
        Log::<_, 32>::new(Flash::new(0), 0..len - PAGE as u32),
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
        let mut flash = Flash::new(round);
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
                Ok::<(), LogError<PowerLoss>>(())
            });
            assert_eq!(failed, Err(LogError::Flash(PowerLoss)));
            flash = log.into_flash();
            flash.power(None);
            if let Some(entry) = trying {
                // Old or new, but from now on always the same.
                let mut log = Log::new(flash, 0..Flash::LEN).unwrap();
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

#[test]
fn a_link_and_an_application_share_a_flash() {
    let flash = Mutex::<NoopRawMutex, _>::new(MockFlash::<8>::new(0));
    let half = MockFlash::<8>::LEN / 2;
    let mut store = Store::new(Partition::new(&flash, 0, half), 0..half).unwrap();
    let mut facts = Log::<_, SLOT>::new(Partition::new(&flash, half, half), 0..half).unwrap();
    block_on(async {
        store.provision(key(1), 0).await.unwrap();
        facts.open().await.unwrap();
        for n in 0..50 {
            store.save(Record::CounterLimit(n)).await.unwrap();
            facts.append(&fact(n as u8 % 2, n as u8)).await.unwrap();
        }
        assert_eq!(store.load().await.unwrap().counter_limit, 49);
        assert_eq!(facts.find(0).await, Ok(Some(fact(0, 48))));
        assert_eq!(facts.find(1).await, Ok(Some(fact(1, 49))));
    });
}
