//! A coordinator and a device on a simulated radio: `cargo run -p zigbee-link --example two_nodes`.
//!
//! The device joins, and sends a message that one frame in five of the air loses. All of it happens in virtual time.

use core::time::Duration;

use embassy_futures::select::select;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use virtual_hardware::{
    executor::{Clock, Executor},
    flash::{Flash, PAGE},
    medium::{Medium, NRF52840, Propagation},
};
use zigbee_link::{
    link::Delivery,
    network::{Channels, NetworkSettings, NetworkStatus, Node},
    radio::{Channel, Csma},
    runner::{Clock as _, Happened, Shared, run},
    security::Key,
    store::Store,
    wire::{Eui64, ShortAddress},
};

const SECOND: u64 = 1_000_000_000;
const COORDINATOR: ShortAddress = ShortAddress(0);

/// Four peers, two messages each way, four members.
type Shares = Shared<Clock, 4, 2, 4>;

/// Works on a node's messages; the node itself runs beside it.
async fn node(clock: Clock, medium: Medium, number: u8, work: impl AsyncFnOnce(&Shares)) {
    let seed = number.into();
    let own = Eui64([2, 0, 0, 0, 0, 0, 0, number]);
    // Of a site: 16 random bytes, provisioned once.
    let key = Key::new(1, std::array::from_fn(|i| 0xA0 ^ i as u8)).expect("it looks random");
    let flash = Flash::<PAGE>::without_time(2, ChaCha8Rng::seed_from_u64(seed));
    let mut store = Store::new(flash, 0..2 * PAGE as u32).expect("two pages are enough");
    store
        .provision(key, own, 0)
        .await
        .expect("the flash is new");
    let saved = store.load().await.expect("it was written");

    let mut settings = NetworkSettings::new(own, seed);
    settings.channels = Channels::only(Channel::FIRST);
    let node = match number {
        0 => Node::coordinator(settings, &saved, [None; 4]),
        _ => Node::device(clock.now(), settings, &saved),
    };
    let shared = Shared::new(node, clock.clone());
    let place = medium.attach([f64::from(number), 0.0]);
    let mut radio = Csma::new(medium.radio(place, NRF52840), clock, seed);
    select(run(&shared, &mut radio, &mut store), work(&shared)).await;
}

fn main() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let air = Propagation::UnitDisk {
        range: 10.0,
        loss: 0.2,
    };
    let medium = Medium::new(&clock, air, 1);

    executor.spawn(node(
        clock.clone(),
        medium.clone(),
        0,
        async |shared: &Shares| {
            shared.with(|node, now| node.open_join_window(now, Duration::from_secs(60)));
            loop {
                let (from, message): (_, [f32; 2]) = shared.recv().await;
                println!("the coordinator heard {message:?} from {from:?}");
                assert_eq!(message, [6.5, -1.25]);
            }
        },
    ));
    executor.spawn(node(clock, medium, 1, async |shared: &Shares| {
        let mut status = NetworkStatus::Out;
        while !matches!(status, NetworkStatus::Joined(_)) {
            if let Happened::<()>::Status(now) = shared.happened(status).await {
                status = now;
            }
        }
        let sent = shared.send(COORDINATOR, &[6.5_f32, -1.25]).await;
        println!("the device was told: {sent:?}");
        assert_eq!(sent, Ok(Delivery::Delivered));
    }));
    let _ = executor.run_until(60 * SECOND);
    assert_eq!(executor.tasks(), 1, "the device is done within a minute");
}
