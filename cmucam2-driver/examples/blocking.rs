//! The blocking driver on the UART of `embedded-hal-mock`: `cargo run -p cmucam2-driver --all-features
//! --example blocking`.
//!
//! That UART is one of `embedded-hal-nb`, which gives one byte or none: `Peek` makes it one of `embedded-io`. The mock
//! checks that each byte is sent and read when it should be.

use cmucam2_driver::{Cmucam2, Command, colour::ColourBounds, serial::Peek, session::Policy};
use embedded_hal_mock::eh1::{
    delay::NoopDelay,
    serial::{Mock, Transaction},
};
use embedded_hal_nb::nb;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Twice a lone carriage return, which stops whatever the camera did before.
    let stop = || {
        [
            Transaction::write(b'\r'),
            Transaction::flush(),
            Transaction::read_many(b"ACK\r:"),
        ]
    };
    let track = [
        Transaction::write_many(b"PM 1\r"),
        Transaction::flush(),
        Transaction::read_many(b"ACK\r:"),
        Transaction::write_many(b"ST 170 240 60 180 16 100\r"),
        Transaction::flush(),
        Transaction::read_many(b"ACK\r:"),
        Transaction::write_many(b"TC\r"),
        Transaction::flush(),
        Transaction::read_many(b"ACK\rT 44 60 30 50 58 70 25 90\r:"),
    ];
    let silence = [Transaction::read_error(nb::Error::WouldBlock)];
    let mut script: Vec<_> = stop().into_iter().chain(stop()).collect();
    script.extend(silence);
    script.extend(track);
    let mut uart = Mock::new(&script);

    let orange = ColourBounds::new([170, 240, 60, 180, 16, 100])?;
    // One look at the silent line instead of a thousand.
    let mut policy = Policy::default();
    policy.settle_us = 10_000;
    policy.poll_us = 10_000;
    let camera = Peek::new(uart.clone());
    let mut camera = Cmucam2::with_policy(camera, NoopDelay::new(), policy);
    // In poll mode nothing comes unasked: such a UART has no buffer.
    camera.set(Command::PollMode(true)).wait()?;
    camera.track_colour(orange).wait()?;
    let tracking = camera.next_tracking().wait()?;
    let (x, y) = tracking.and_then(|it| it.centroid()).ok_or("not in view")?;
    println!("the ball is at column {x}, row {y}");
    assert_eq!((x, y), (44, 60));
    uart.done();
    Ok(())
}
