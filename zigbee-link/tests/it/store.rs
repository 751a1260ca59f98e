//! The store: what it keeps through power cuts and rot.

use crate::support;

use embassy_embedded_hal::flash::partition::Partition;
use embassy_futures::block_on;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, mutex::Mutex};
use flash_log::{Entry, Log};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::flash::{self, Flash, PAGE};
use virtual_hardware::flash::FlashError;
use zigbee_link::{
    radio::Channel,
    security::{BLOCK, Counter, Key},
    store::{Member, Membership, Record, Store, StoreError},
    wire::{Eui64, PanId, ShortAddress},
};

const LEN: u32 = flash::length(8);
const CUT: StoreError<FlashError> = StoreError::Flash(FlashError::Failed);

fn chip(seed: u64) -> Flash {
    flash::chip(8, seed)
}

fn key(index: u8) -> Key {
    Key::new(index, core::array::from_fn(|i| i as u8 * 7 + index)).unwrap()
}

const OWN: Eui64 = Eui64([2, 0, 0, 0, 0, 0, 0, 9]);

fn store(flash: Flash) -> Store<Flash> {
    Store::new(flash, 0..LEN).unwrap()
}

fn member(n: u8) -> Member {
    Member {
        extended: Eui64([1, 2, 3, 4, 5, 6, 7, n]),
        short: ShortAddress(u16::from(n)),
    }
}

#[test]
fn remembers_everything() {
    let network = Membership {
        pan: PanId(0xBEEF),
        channel: Channel::new(15).unwrap(),
        short: ShortAddress(0x42),
        coordinator: Eui64([8; 8]),
    };
    let flash = block_on(async {
        let mut store = store(chip(0));
        store.provision(key(1), OWN, 7).await.unwrap();
        store.save(Record::CounterLimit(5000)).await.unwrap();
        store.save(Record::NextKey(Some(key(2)))).await.unwrap();
        store.save(Record::Network(Some(network))).await.unwrap();
        for n in 0..8 {
            let record = Record::Member(n, Some(member(n)));
            store.save(record).await.unwrap();
        }
        store.save(Record::Member(3, None)).await.unwrap();
        store.into_flash()
    });
    block_on(async {
        let mut store = store(flash);
        let saved = store.load().await.unwrap();
        assert_eq!(saved.counter_limit, 5000);
        assert_eq!(saved.active_key, key(1));
        assert_eq!(saved.next_key, Some(key(2)));
        assert_eq!(saved.network, Some(network));
        assert_eq!(store.member(2).await, Ok(Some(member(2))));
        assert_eq!(store.member(3).await, Ok(None));
        assert_eq!(store.member(200).await, Ok(None));
        store.save(Record::Network(None)).await.unwrap();
        assert_eq!(store.load().await.unwrap().network, None);
    });
}

/// The key of provisioning stays known after others come into use. Stores of the time before it was written down
/// had no other.
#[test]
fn the_key_of_provisioning_is_known() {
    block_on(async {
        let mut store = store(chip(0));
        store.provision(key(1), OWN, 7).await.unwrap();
        store.save(Record::ActiveKey(key(2))).await.unwrap();
        for n in 0..200 {
            store.save(Record::CounterLimit(n)).await.unwrap();
        }
        let saved = store.load().await.unwrap();
        assert_eq!(saved.active_key, key(2));
        assert_eq!(store.first_key().await, Ok(key(1)));

        let mut flash = chip(0);
        let mut older = Log::<_, 32>::new(&mut flash, 0..LEN).unwrap();
        let mut active = vec![1, 3];
        active.extend((0..16).map(|i| i * 7 + 3));
        let records = [
            Entry::new(0, &[9, 0, 0, 0]).unwrap(),
            Entry::new(1, &active).unwrap(),
        ];
        older.begin(&records).await.unwrap();
        let mut store = Store::new(flash, 0..LEN).unwrap();
        assert_eq!(store.load().await.unwrap().counter_limit, 9);
        assert_eq!(store.first_key().await, Ok(key(3)));
    });
}

#[test]
fn without_a_key_there_is_nothing() {
    let mut store = store(chip(0));
    assert_eq!(block_on(store.load()), Err(StoreError::NotProvisioned));
    for bytes in [[0; 16], [0xFF; 16], [0x5A; 16]] {
        assert_eq!(Key::new(1, bytes), None);
    }
    assert_eq!(Key::new(0, core::array::from_fn(|i| i as u8)), None);
}

#[test]
fn the_range_is_checked() {
    for range in [
        0..0,
        0..3 * PAGE as u32,
        4..4 + 4 * PAGE as u32,
        0..LEN - 4,
        PAGE as u32..0,
    ] {
        let store = Store::new(chip(0), range);
        assert!(matches!(store, Err(StoreError::Layout)));
    }
}

/// The bytes in the flash are an interface: version 1, frozen. The checksums are zlib's.
#[test]
fn format() {
    let flash = block_on(async {
        let mut store = store(chip(0));
        store.provision(key(1), OWN, 0x0102_0304).await.unwrap();
        store.save(Record::NextKey(None)).await.unwrap();
        let network = Membership {
            pan: PanId(0xBEEF),
            channel: Channel::LAST,
            short: ShortAddress(0x42),
            coordinator: Eui64([1, 2, 3, 4, 5, 6, 7, 8]),
        };
        store.save(Record::Network(Some(network))).await.unwrap();
        let record = Record::Member(2, Some(member(9)));
        store.save(record).await.unwrap();
        store.into_flash()
    });
    let [active, first] = [1, 4].map(|record| {
        let mut slot = vec![1, record, 1, 1];
        slot.extend((0..16).map(|i| i * 7 + 1));
        slot
    });
    let slots: [(&[u8], [u8; 4]); 8] = [
        (&[1, 255, 1, 0, 0, 0], [0xEE, 0xBA, 0x87, 0xA8]),
        (&[1, 0, 4, 3, 2, 1], [0xA2, 0x8C, 0xF4, 0xDC]),
        (&active, [0xFB, 0x8E, 0x42, 0x39]),
        (&first, [0xFF, 0xFE, 0x8F, 0x36]),
        (&[1, 5, 1, 2, 0, 0, 0, 0, 0, 0, 9], [0xD7, 0x62, 0x70, 0x01]),
        (&[1, 2, 0], [0x76, 0xBC, 0xDD, 0x5C]),
        (
            &[1, 3, 1, 0xEF, 0xBE, 26, 0x42, 0, 1, 2, 3, 4, 5, 6, 7, 8],
            [0x7D, 0xDB, 0x79, 0xD8],
        ),
        (
            &[1, 18, 1, 1, 2, 3, 4, 5, 6, 7, 9, 9, 0],
            [0x03, 0x4A, 0xCB, 0x69],
        ),
    ];
    let mut expected = Vec::new();
    for (body, sum) in slots {
        let start = expected.len();
        expected.extend(body);
        expected.resize(start + 28, 0);
        expected.extend(sum);
    }
    expected.resize(LEN as usize, 0xFF);
    assert_eq!(*flash.bytes(), *expected);
}

/// 10,000 power cuts, each in the middle of changing a word or a page: every counter that is ever
/// handed out is above all before it, so no nonce occurs twice. Nothing once written is lost.
#[test]
fn no_nonce_twice_through_power_cuts() {
    const CUTS: u32 = 10_000;
    let mut rng = ChaCha8Rng::seed_from_u64(0x5eed);
    let mut flash = chip(1);
    flash = block_on(async {
        let mut store = store(flash);
        store.provision(key(1), OWN, 0).await.unwrap();
        store.into_flash()
    });
    let mut lowest_unused = 0;
    let mut used = 0_u64;
    let mut cuts = 0;
    let mut written_member = [None; 4];
    while cuts < CUTS {
        // Mostly so short that the cut falls into the very next writes, sometimes into a reload.
        let exponent = rng.random_range(0..9);
        flash.power(Some(1 + rng.random_range(0..1 << exponent)));
        flash = block_on(async {
            let mut store = store(flash);
            match run(
                &mut store,
                &mut rng,
                &mut lowest_unused,
                &mut used,
                &mut written_member,
            )
            .await
            {
                Err(CUT) => cuts += 1,
                other => panic!("{other:?} after {cuts} cuts"),
            }
            store.into_flash()
        });
    }
    assert!(
        used > 1_000_000,
        "{used} frames are too few to prove anything"
    );
    let erasures = flash.wear().erasures;
    assert!(erasures.iter().all(|&count| count > 10), "{erasures:?}");
}

async fn run(
    store: &mut Store<Flash>,
    rng: &mut ChaCha8Rng,
    lowest_unused: &mut u32,
    used: &mut u64,
    members: &mut [Option<Member>; 4],
) -> Result<(), StoreError<FlashError>> {
    let saved = store.load().await?;
    assert_eq!(saved.active_key, key(1), "after {saved:?}");
    let mut counter = Counter::resume(saved.counter_limit);
    loop {
        for place in 0..4 {
            let found = store.member(place).await?;
            assert!(found == members[usize::from(place)] || members[usize::from(place)].is_none());
        }
        if rng.random_ratio(1, 4) {
            let place = rng.random_range(0..4);
            // Until it is known that the record is whole, it may be the old or the new one.
            members[usize::from(place)] = None;
            let new = member(rng.random());
            store.save(Record::Member(place, Some(new))).await?;
            members[usize::from(place)] = Some(new);
        }
        if let Some(limit) = counter.wanted() {
            store.save(Record::CounterLimit(limit)).await?;
            counter.reserved(limit);
        }
        for _ in 0..rng.random_range(0..BLOCK) {
            let Ok(taken) = counter.take() else { break };
            assert!(taken >= *lowest_unused, "{taken} used before");
            *lowest_unused = taken + 1;
            *used += 1;
        }
    }
}

/// Any single bit of the flash may rot, in both directions: the node refuses to start, or starts
/// above every counter it used.
#[test]
fn rot_never_brings_back_a_nonce() {
    for saves in [1, 5, 9, 14, 23] {
        let (flash, used_below) = block_on(async {
            let mut store = store(chip(0));
            store.provision(key(1), OWN, 0).await.unwrap();
            let mut counter = Counter::resume(0);
            for _ in 0..saves {
                let limit = counter.wanted().unwrap();
                store.save(Record::CounterLimit(limit)).await.unwrap();
                counter.reserved(limit);
                while counter.take().is_ok() {}
            }
            (store.into_flash(), saves * BLOCK)
        });
        let mut refused = 0;
        for bit in 0..LEN as usize * 8 {
            let rotten = flash.copy();
            rotten.bytes_mut()[bit / 8] ^= 1 << (bit % 8);
            let loaded = block_on(store(rotten).load());
            match loaded {
                Ok(saved) => assert!(
                    saved.counter_limit >= used_below && saved.active_key == key(1),
                    "bit {bit} after {saves} saves: {saved:?}"
                ),
                Err(_) => refused += 1,
            }
        }
        println!(
            "{saves} reservations: {refused} of {} flips refused",
            LEN * 8
        );
    }
}

/// A fresh flash, and flashes whose store is in either bank, at rest.
fn before_provisioning() -> [Flash; 3] {
    [0, 1, 2].map(|provisions| {
        block_on(async {
            let mut store = store(chip(provisions));
            for _ in 0..provisions {
                let _ = store.load().await;
                store.provision(key(1), OWN, 0).await.unwrap();
                store.save(Record::CounterLimit(BLOCK)).await.unwrap();
                store.save(Record::NextKey(Some(key(2)))).await.unwrap();
            }
            store.into_flash()
        })
    })
}

/// The power fails at each moment of a provisioning, and once more when it is repeated: the node is
/// as before or as told, and is provisioned in the end. Of all counters that any life used under
/// the key, none is used again.
#[test]
fn provisioning_survives_power_cuts() {
    const PAGE_COUNTER: u32 = 5 * BLOCK;
    /// Starts a node. Returns the first counter of this life.
    async fn start(store: &mut Store<Flash>) -> Result<u32, StoreError<FlashError>> {
        let is_newer = match store.load().await {
            Ok(saved) => saved.counter_limit < PAGE_COUNTER,
            Err(StoreError::NotProvisioned) => true,
            Err(error) => return Err(error),
        };
        if is_newer {
            store.provision(key(1), OWN, PAGE_COUNTER).await?;
        }
        let saved = store.load().await?;
        assert_eq!((saved.active_key, saved.next_key), (key(1), None));
        let mut counter = Counter::resume(saved.counter_limit);
        let limit = counter.wanted().unwrap();
        store.save(Record::CounterLimit(limit)).await?;
        counter.reserved(limit);
        Ok(counter.take().unwrap())
    }
    for flash in before_provisioning() {
        let mut cuts = 0;
        let mut is_cut = true;
        while is_cut {
            cuts += 1;
            for again in 1..=cuts {
                let mut flash = flash.copy();
                let mut counters = Vec::new();
                for budget in [Some(cuts), Some(again), None, None] {
                    flash.power(budget);
                    let mut store = store(flash);
                    let started = block_on(start(&mut store));
                    flash = store.into_flash();
                    if started.is_err() {
                        assert_eq!(started, Err(CUT), "cut at {cuts}, {again}");
                        assert!(!flash.has_power());
                    }
                    counters.extend(started);
                }
                assert!(counters.len() >= 2 && counters.is_sorted_by(|a, b| a < b));
                is_cut = counters.len() < 4;
            }
        }
        assert!(cuts > 30, "{cuts} changes are too few to be all");
    }
}

/// A header that rotted is not taken for one that was being written.
#[test]
fn a_bad_header_is_refused() {
    for flash in before_provisioning().into_iter().skip(1) {
        let bank = LEN as usize / 2;
        let header = if flash.bytes()[0] == 0xFF { bank } else { 0 };
        for byte in 0..4 {
            flash.bytes_mut()[header + 28 + byte] ^= 0x10;
            let mut store = store(flash.copy());
            assert_eq!(block_on(store.load()), Err(StoreError::Corrupt));
        }
    }
}

/// A caller that was told that the node is not provisioned cannot write without provisioning it.
#[test]
fn nothing_is_saved_without_a_key() {
    let mut flash = chip(0);
    // Erased, the header that says that provisioning was begun, erased, and records.
    flash = block_on(async {
        flash.power(Some(4 + 8 + 4 + 10));
        let mut store = store(flash);
        assert!(store.provision(key(1), OWN, 0).await.is_err());
        store.into_flash()
    });
    flash.power(None);
    let mut store = store(flash);
    for _ in 0..2 {
        assert_eq!(block_on(store.load()), Err(StoreError::NotProvisioned));
        let saved = block_on(store.save(Record::CounterLimit(1)));
        assert_eq!(saved, Err(StoreError::NotProvisioned));
    }
    block_on(store.provision(key(1), OWN, 0)).unwrap();
    block_on(store.save(Record::CounterLimit(1))).unwrap();
}

#[test]
fn a_link_and_an_application_share_a_flash() {
    let flash = Mutex::<NoopRawMutex, _>::new(chip(0));
    let half = LEN / 2;
    let fact = |key, value| Entry::new(key, &[value; 90]).unwrap();
    let mut store = Store::new(Partition::new(&flash, 0, half), 0..half).unwrap();
    let mut facts = Log::<_, 96>::new(Partition::new(&flash, half, half), 0..half).unwrap();
    block_on(async {
        store.provision(key(1), OWN, 0).await.unwrap();
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
