//! A package for two nodes, one of which does not hear every third packet: `cargo run --example spread --features alloc`.

use core::{convert::Infallible, time::Duration};

use embassy_futures::block_on;
use radio_update::{
    embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash},
    package::{Package, public_key},
    packet::{PACKET_MAX, Phase},
    receiver::{Layout, Own, Reaction, Receiver},
    sender::Sender,
    stamp::{STAMP, Stamp, board_number},
};

/// A flash in memory.
struct Memory(Vec<u8>);

impl ErrorType for Memory {
    type Error = Infallible;
}

impl ReadNorFlash for Memory {
    const READ_SIZE: usize = 4;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        bytes.copy_from_slice(&self.0[at as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Memory {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = 4096;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.0[from as usize..to as usize].fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), Infallible> {
        self.0[at as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

fn main() {
    let secret = [7; 32];
    let stamp = |version| Stamp {
        board: board_number("my-board"),
        roles: 1,
        version,
    };
    let mut image = vec![0xA5; 10_000];
    image[256..][..STAMP].copy_from_slice(&stamp(2).bytes());
    let package = Package::sign(&image, &secret).expect("the image has a stamp");

    let layout = Layout {
        state: 0..4096,
        header: 4096..8192,
        spare: 8192..8192 + 5 * 4096,
    };
    let own = Own {
        stamp: stamp(1),
        role: 1,
        key: Some(public_key(&secret)),
    };
    let open = || {
        block_on(Receiver::open(
            Memory(vec![0xFF; 32_768]),
            layout.clone(),
            own,
        ))
    };
    let mut nodes = [open(), open()];

    let mut sender = Sender::new(package, [0, 1], 0);
    let (mut now, mut sent) = (Duration::ZERO, 0);
    // A node that is told to change images restarts: the boot loader's work is not shown here.
    while nodes[1].phase() != Phase::Installing {
        let Some(next) = sender.poll(now) else {
            now = sender.deadline().map_or(now, |deadline| deadline.max(now));
            continue;
        };
        sent += 1;
        for (address, node) in (0..).zip(&mut nodes) {
            let is_lost = next.to.is_none() && address == 1 && sent % 3 == 0;
            if is_lost || next.to.is_some_and(|to| to != address) {
                continue;
            }
            let reaction = block_on(node.on_packet(&next.packet));
            while node.has_work() {
                block_on(node.work());
            }
            if let Reaction::Answer { from, .. } = reaction {
                let mut answer = [0; PACKET_MAX];
                let length = node.status(from, &mut answer);
                sender.on_packet(now, address, &answer[..length]);
            }
        }
        sender.on_sent(now);
        now += Duration::from_millis(5);
    }
    let blocks = sender.package().blocks();
    println!("{} blocks were sent for {blocks}", sender.sent().blocks);
}
