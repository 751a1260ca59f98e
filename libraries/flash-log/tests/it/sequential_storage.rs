//! Tests in which the map of the crate `sequential-storage` loses records where this crate's log loses none: the
//! reason for a log of our own. Where one of these fails with a newer version, look again if there must be one.

use crate::support;

use embassy_futures::block_on;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sequential_storage::{
    Error,
    cache::Cache,
    map::{MapConfig, MapStorage},
};
use support::{Flash, chip, length};
use virtual_hardware::flash::FlashError;

const KEYS: u8 = 3;
const LEN: u32 = length(4);

type Value = [u8; 48];

fn value(first: u8) -> Value {
    core::array::from_fn(|i| first.wrapping_add(i as u8))
}

async fn find(flash: &Flash, key: u8) -> Result<Option<Value>, Error<FlashError>> {
    let config = MapConfig::new(0..LEN);
    let mut map = MapStorage::<u8, _, _>::new(flash.clone(), config, Cache::new_uncached());
    let mut buffer = [0; 128];
    let found = map.fetch_item::<&[u8]>(&mut buffer, &key).await?;
    Ok(found.map(|bytes| bytes.try_into().expect("values of one length")))
}

async fn store(flash: &Flash, key: u8, value: &Value) -> Result<(), Error<FlashError>> {
    let config = MapConfig::new(0..LEN);
    let mut map = MapStorage::<u8, _, _>::new(flash.clone(), config, Cache::new_uncached());
    let mut buffer = [0; 128];
    map.store_item(&mut buffer, &key, &value.as_slice()).await
}

/// Outcome of a map in whose life the power failed again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// Each record was the one last written, or the one that was being written.
    Whole,
    /// A record was gone, or the one before it had come back.
    Lost,
    /// It could not be read or written any more, although the power was on.
    Failed,
}

/// A map for the time of a hundred power cuts: as this crate's own log is tested.
fn life(round: u64, rng: &mut ChaCha8Rng) -> End {
    let flash = chip(4, round);
    let mut kept = [None; KEYS as usize];
    for _ in 0..100 {
        let exponent = rng.random_range(0..9);
        flash.power(Some(1 + rng.random_range(0..1 << exponent)));
        let mut trying = None;
        let mut lost = false;
        let failed = block_on(async {
            loop {
                for key in 0..KEYS {
                    lost |= find(&flash, key).await? != kept[usize::from(key)];
                }
                let (key, new) = (rng.random_range(0..KEYS), value(rng.random()));
                trying = Some((key, new));
                store(&flash, key, &new).await?;
                kept[usize::from(key)] = Some(new);
                trying = None;
            }
            #[expect(unreachable_code, reason = "tells the type")]
            Ok::<(), Error<FlashError>>(())
        });
        if lost {
            return End::Lost;
        }
        if flash.has_power() || !matches!(failed, Err(Error::Storage { .. })) {
            return End::Failed;
        }
        flash.power(None);
        if let Some((key, new)) = trying {
            let Ok(found) = block_on(find(&flash, key)) else {
                return End::Failed;
            };
            if found != Some(new) && found != kept[usize::from(key)] {
                return End::Lost;
            }
            kept[usize::from(key)] = found;
        }
    }
    End::Whole
}

/// A write or an erasure that is cut off leaves any bits in its word or page.
#[test]
fn power_cuts_lose_records() {
    let mut rng = ChaCha8Rng::seed_from_u64(0xFAC7);
    let mut count = [0; 3];
    for round in 0..40 {
        count[life(round, &mut rng) as usize] += 1;
    }
    let [whole, lost, failed] = count;
    println!("of 40 maps {whole} stay whole, {lost} lose a record, {failed} fail");
    assert!(lost + failed > 0, "{whole} of 40 stay whole");
}

/// For a frame counter that is a nonce used twice.
#[test]
fn a_record_with_a_wrong_checksum_gives_way_to_the_one_before() {
    let flash = chip(4, 0);
    let (old, new) = (value(1), value(100));
    block_on(async {
        store(&flash, 1, &old).await.unwrap();
        store(&flash, 1, &new).await.unwrap();
        assert_eq!(find(&flash, 1).await.unwrap(), Some(new));
        let at = flash
            .bytes()
            .windows(new.len())
            .position(|bytes| bytes == new)
            .unwrap();
        flash.bytes_mut()[at + 5] ^= 0x10;
        assert_eq!(find(&flash, 1).await.unwrap(), Some(old));
    });
}
