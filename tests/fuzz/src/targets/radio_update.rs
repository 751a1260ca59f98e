//! A node takes any packets of an update: nothing panics, and no image comes to be installed that is not signed.

use core::convert::Infallible;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use radio_update::{
    package::Header,
    packet::{PACKET_MAX, Packet},
    receiver::{Layout, Own, Reaction, Receiver},
    stamp::{STAMP, Stamp},
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

/// The first byte of each packet is its length; what is in the flash before is the start of the input.
pub(crate) fn run(data: &[u8]) {
    let _ = Header::parse(data);
    if let Some(stamp) = data.first_chunk::<STAMP>() {
        let _ = Stamp::read(stamp);
    }
    let mut flash = vec![0xFF; 5 * 4096];
    for (to, from) in flash.iter_mut().zip(data) {
        *to = *from;
    }
    let layout = Layout {
        header: 0..4096,
        state: 4096..8192,
        spare: 8192..20_480,
    };
    let own = Own {
        stamp: Stamp {
            board: 1,
            roles: 7,
            version: 1,
        },
        role: 2,
        key: Some([9; 32]),
    };
    let mut receiver = block_on(Receiver::open(Memory(flash), layout, own));
    let mut rest = data;
    while let Some((&length, next)) = rest.split_first() {
        let (packet, next) = next.split_at(next.len().min(usize::from(length) % (PACKET_MAX + 8)));
        rest = next;
        if let Some(packet) = Packet::parse(packet) {
            let mut buffer = [0; PACKET_MAX];
            let length = packet.write(&mut buffer);
            // What does not fit is left out.
            if length < PACKET_MAX {
                assert!(Packet::parse(&buffer[..length]).is_some());
            }
        }
        let reaction = block_on(receiver.on_packet(packet));
        assert_ne!(reaction, Reaction::Restart, "no header here is signed");
        while receiver.has_work() {
            block_on(receiver.work());
        }
        let mut buffer = [0; PACKET_MAX];
        let length = receiver.status(u16::from(length), &mut buffer);
        assert!(Packet::parse(&buffer[..length]).is_some());
    }
}
