//! Losses of power at any change of the flash.

use core::time::Duration;

use radio_update::{packet::Phase, sender::Sender};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::chip::{Node, PAGES, image, package};

const LENGTH: usize = 4096 * PAGES - 1000;

/// Losses of power of a daily run, and of a long one (`XTASK_ALL`).
fn cuts() -> usize {
    if std::env::var_os("XTASK_ALL").is_some() {
        20_000
    } else {
        400
    }
}

/// An update goes on after each loss of power, a third of all packets lost besides. Whenever a node runs, its image is
/// whole.
#[test]
fn no_loss_of_power_costs_a_node() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let (mut done, mut updates, mut reverted) = (0, 0, 0);
    while done < cuts() {
        let mut node = Node::new(LENGTH, ChaCha8Rng::seed_from_u64(updates));
        assert!(node.start());
        let mut sender = Sender::new(package(LENGTH, 2), [0], 0);
        let mut now = Duration::ZERO;
        node.power(Some(random.random_range(1..4000)));
        let mut is_over = false;
        while !is_over {
            assert!(
                now < Duration::from_secs(36_000),
                "update {updates}: {sender:?}"
            );
            if !node.has_power() {
                done += 1;
                // Erasures, writes of the header, of blocks, of the state, of a swap: some starts do not come far.
                node.power(Some(random.random_range(1..9000)));
                node.start();
                continue;
            }
            if let Some(next) = sender.poll(now) {
                now += Duration::from_millis(5);
                if !random.random_bool(0.3) || next.to.is_some() {
                    if let Some(answer) = node.take(&next.packet) {
                        sender.on_packet(now, 0, &answer);
                    }
                    node.confirm();
                }
                sender.on_sent(now);
            } else if let Some(deadline) = sender.deadline() {
                now = now.max(deadline);
            }
            if node.receiver.is_some() && node.has_power() {
                let active = node.active(LENGTH);
                assert!(active == image(LENGTH, 1) || active == image(LENGTH, 2));
                is_over = sender.is_done();
            }
        }
        let ended = &sender.nodes()[&0];
        if ended.phase == Some(Phase::Reverted) {
            // It lost its power on trial each time.
            reverted += 1;
            assert_eq!(node.active(LENGTH), image(LENGTH, 1));
            updates += 1;
            continue;
        }
        assert_eq!(ended.version, Some(2), "update {updates}");
        node.power(None);
        assert!(node.start());
        assert_eq!(node.active(LENGTH), image(LENGTH, 2), "update {updates}");
        updates += 1;
    }
    println!("{done} losses of power in {updates} updates; {reverted} ended with the former image");
    assert!(reverted <= updates / 100, "{reverted} of {updates}");
}
