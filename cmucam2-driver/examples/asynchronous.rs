//! The async driver on mocks: `cargo run -p cmucam2-driver --example asynchronous`.
//!
//! The UART answers line by line as the manual says; the delay is `embedded-hal-mock`'s, which does not wait. On a
//! board both come from its HAL, and nothing else changes.

use std::{collections::VecDeque, convert::Infallible, future::pending};

use cmucam2_driver::{Cmucam2, colour::ColourBounds};
use embassy_futures::block_on;
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_io_async::{ErrorType, Read, Write};

/// A UART with a camera that sees an orange ball.
#[derive(Default)]
struct Uart {
    line: Vec<u8>,
    answers: VecDeque<u8>,
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        for &byte in bytes {
            self.line.push(byte);
            if byte == b'\r' {
                let answer = match self.line.get(..2) {
                    Some(b"TC") => "ACK\rT 44 60 30 50 58 70 25 90\rT 46 60 32 50 60 70 25 90\r",
                    _ => "ACK\r:",
                };
                self.answers.extend(answer.bytes());
                self.line.clear();
            }
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
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
    let orange = ColourBounds::new([170, 240, 60, 180, 16, 100])?;
    let mut camera = Cmucam2::new(Uart::default(), NoopDelay::new());
    block_on(async {
        camera.track_colour(orange).run().await?;
        for expected in [44, 46] {
            let tracking = camera.next_tracking().run().await?;
            let (x, y) = tracking.and_then(|it| it.centroid()).ok_or("not in view")?;
            println!("the ball is at column {x}, row {y}");
            assert_eq!((x, y), (expected, 60));
        }
        camera.stop().run().await?;
        Ok(())
    })
}
