//! [`SpinelRadio`] on lines that fail.

use std::future::pending;

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use spinel_radio::{RcpError, RcpFault, RcpPolicy, SpinelRadio};
use virtual_hardware::executor::{Ended, Executor};
use zigbee_link::{
    radio::{Channel, Radio, RadioConfig},
    wire::{Eui64, PanId, ShortAddress},
};

const CONFIG: RadioConfig = RadioConfig {
    channel: Channel::FIRST,
    tx_power: 0,
    pan: PanId(1),
    short: ShortAddress(2),
    extended: Eui64([3; 8]),
    coordinator: false,
    promiscuous: false,
    sampled: false,
};

#[derive(Clone, Copy)]
enum Line {
    /// Takes nothing: the other end holds the flow control.
    Stuck,
    /// Takes everything and says nothing.
    Mute,
    Closed,
    Broken,
}

impl ErrorType for Line {
    type Error = ErrorKind;
}

impl Read for Line {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Closed => Ok(0),
            Self::Broken => Err(ErrorKind::BrokenPipe),
            Self::Stuck | Self::Mute => pending().await,
        }
    }
}

impl Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Stuck => pending().await,
            Self::Mute | Self::Closed | Self::Broken => Ok(bytes.len()),
        }
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

#[test]
fn a_failing_line_is_an_error_in_bounded_time() {
    for (line, error) in [
        (Line::Stuck, RcpError::Radio(RcpFault::Silent)),
        (Line::Mute, RcpError::Radio(RcpFault::Silent)),
        (Line::Closed, RcpError::Closed),
        (Line::Broken, RcpError::Uart(ErrorKind::BrokenPipe)),
    ] {
        let mut executor = Executor::new();
        let clock = executor.clock();
        executor.spawn(async move {
            let mut radio: SpinelRadio<_, _> = SpinelRadio::new(line, &clock);
            assert_eq!(radio.configure(&CONFIG).await, Err(error));
            let unconfigured = RcpError::Radio(RcpFault::NotConfigured);
            assert_eq!(radio.transmit(&[1, 2, 3]).await, Err(unconfigured));
        });
        let bound = 3 * RcpPolicy::DEFAULT.reset.as_nanos() as u64;
        assert_eq!(executor.run_until(bound), Ended::TimeUp);
        assert_eq!(executor.tasks(), 0);
    }
}
