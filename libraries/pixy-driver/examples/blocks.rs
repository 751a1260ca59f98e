//! A Pixy2 on a mock: `cargo run -p pixy-driver --example blocks`.
//!
//! The UART answers as the maker's documentation says; the delay is `embedded-hal-mock`'s, which does not wait. On a
//! board both come from its HAL, and nothing else changes.

use std::{collections::VecDeque, convert::Infallible, future::pending};

use embassy_futures::block_on;
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_io_async::{ErrorType, Read, Write};
use pixy_driver::{Model, Pixy, packet::Signatures};

/// An answer of the camera: its type and payload, with length and checksum.
fn packet(kind: u8, payload: &[u8]) -> Vec<u8> {
    let sum: u16 = payload.iter().map(|&byte| u16::from(byte)).sum();
    let [low, high] = sum.to_le_bytes();
    let head = [0xAF, 0xC1, kind, payload.len() as u8, low, high];
    [&head[..], payload].concat()
}

/// A UART with a camera that sees one block of signature 1.
#[derive(Default)]
struct Uart {
    request: Vec<u8>,
    answers: VecDeque<u8>,
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.request.extend(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        let answer = match self.request[2] {
            0x0E => packet(0x0F, b"\x00\x22\x03\x00\x0C\x00general\0\0\0"),
            // Signature, x, y, width, height, angle, number and age.
            _ => packet(0x21, &[1, 0, 120, 0, 90, 0, 30, 0, 28, 0, 0, 0, 1, 9]),
        };
        self.request.clear();
        self.answers.extend(answer);
        Ok(())
    }
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if self.answers.is_empty() {
            return pending().await;
        }
        let count = self.answers.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.answers.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut camera = Pixy::new(Model::Pixy2, Uart::default(), NoopDelay::new());
    block_on(async {
        println!("{:?}", camera.version().run().await?);
        let block = camera.blocks(Signatures::one(1), 1).run().await?.next();
        let block = block.ok_or("it sees nothing")?;
        println!(
            "{} x {} around {}, {}",
            block.width, block.height, block.x, block.y
        );
        assert_eq!([block.x, block.y], [120, 90]);
        Ok(())
    })
}
