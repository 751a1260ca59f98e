//! A CMUcam2 on an nRF52840 with Embassy, and nothing else of a node: the camera adapts to the light and learns
//! the colour in the middle of its view; then lamp 1 of the kit is lit while an object of that colour is left of
//! the middle, lamp 2 while it is right of it.
//!
//! The camera's TX belongs to P1.01, its RX to P1.02, at 38,400 baud and 3.3 V.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this runs on an nRF52840: \
         `cargo build --release --target thumbv7em-none-eabihf --package nrf52 --features nrf52840 --example cmucam2`"
    );
}

#[cfg(target_os = "none")]
mod chip {
    use cmucam2_driver::{
        Cmucam2, Command, Error,
        session::{Fault, Learn, Policy, StartUp},
    };
    use defmt_rtt as _;
    use embassy_executor::Spawner;
    use embassy_nrf::{
        bind_interrupts,
        buffered_uarte::{Baudrate, BufferedUarte, Error as UartError, InterruptHandler},
        gpio::{Level, Output, OutputDrive},
        peripherals, uarte,
    };
    use embassy_time::{Delay, Instant};
    use static_cell::StaticCell;

    bind_interrupts!(struct Irqs {
        UARTE0 => InterruptHandler<peripherals::UARTE0>;
    });

    /// The middle of 88 columns.
    const MIDDLE: u8 = 44;

    type Camera = Cmucam2<BufferedUarte<'static>, Delay, fn() -> u64>;

    /// With a clock, packets are stamped and the time between two calls counts.
    fn uptime() -> u64 {
        Instant::now().as_micros()
    }

    struct Lamps {
        left: Output<'static>,
        right: Output<'static>,
    }

    #[embassy_executor::main]
    async fn main(_spawner: Spawner) {
        // A stream at 38,400 baud sends 4 bytes a millisecond, whether they are read or not.
        static RECEIVE: StaticCell<[u8; 256]> = StaticCell::new();
        static SEND: StaticCell<[u8; 64]> = StaticCell::new();
        let p = embassy_nrf::init(embassy_nrf::config::Config::default());
        let mut config = uarte::Config::default();
        config.baudrate = Baudrate::Baud38400;
        let uart = BufferedUarte::new(
            p.UARTE0,
            p.TIMER1,
            p.PPI_CH0,
            p.PPI_CH1,
            p.PPI_GROUP0,
            p.P1_01,
            p.P1_02,
            Irqs,
            config,
            RECEIVE.init([0; 256]),
            SEND.init([0; 64]),
        );
        let mut camera = Camera::with_clock(uart, Delay, uptime, Policy::default());
        // The kit's lamps are between their pin and the supply.
        let mut lamps = Lamps {
            left: Output::new(p.P0_13, Level::High, OutputDrive::Standard),
            right: Output::new(p.P0_14, Level::High, OutputDrive::Standard),
        };
        loop {
            // It was not there, it restarted, a wire was loose: begin again.
            let _ = follow(&mut camera, &mut lamps).await;
        }
    }

    async fn follow(camera: &mut Camera, lamps: &mut Lamps) -> Result<(), Error<UartError>> {
        camera.start_up(StartUp::default()).run().await?;
        // One packet at a time, and each pixel counts.
        camera.set(Command::PollMode(true)).run().await?;
        camera.set(Command::NoiseFilter(0)).run().await?;
        camera.learn_and_track(Learn::default()).run().await?;
        loop {
            let tracking = match camera.next_tracking().run().await {
                // A damaged line, perhaps. One frame is lost.
                Err(Error::Camera(Fault::Garbage)) => continue,
                tracking => tracking?,
            };
            let column = tracking
                .and_then(|seen| seen.centroid())
                .map(|(column, _)| column);
            let lit = |is: fn(u8) -> bool| Level::from(!column.is_some_and(is));
            lamps.left.set_level(lit(|column| column < MIDDLE));
            lamps.right.set_level(lit(|column| column > MIDDLE));
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        cortex_m::asm::udf()
    }
}
