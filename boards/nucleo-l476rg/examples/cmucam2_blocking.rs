//! A CMUcam2 on a NUCLEO-L476RG with a blocking HAL, and nothing else of a node: the camera adapts to the light
//! and learns the colour in the middle of its view; then the kit's lamp is lit while an object of that colour is
//! in view. The camera's own button has it learn anew.
//!
//! The HAL's blocking UART can read a byte or say that there is none (`embedded-hal-nb`), and no more:
//! [`Peek`] makes of it what the driver needs. Any other HAL of that kind will do.
//!
//! The camera's TX belongs to PA10, its RX to PA9, at 38,400 baud and 3.3 V.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this runs on a NUCLEO-L476RG: `cargo check --target thumbv7em-none-eabihf \
         --package nucleo-l476rg --example cmucam2_blocking`"
    );
}

#[cfg(target_os = "none")]
mod chip {
    use cmucam2_driver::{
        Cmucam2, Command, Error,
        serial::{Peek, SerialError},
        session::{Answer, Learn, Policy, StartUp},
    };
    use defmt_rtt as _;
    use embassy_stm32::{
        gpio::{Level, Output, Speed},
        mode::Blocking,
        usart::{Config, Uart},
    };
    use embassy_time::Delay;

    type Camera = Cmucam2<Peek<Uart<'static, Blocking>>, Delay>;

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let p = embassy_stm32::init(embassy_stm32::Config::default());
        let mut config = Config::default();
        config.baudrate = 38_400;
        let mut lamp = Output::new(p.PA5, Level::Low, Speed::Low);
        let Ok(uart) = Uart::new_blocking(p.USART1, p.PA10, p.PA9, config) else {
            // The clock cannot be divided to that rate.
            cortex_m::asm::udf()
        };
        let policy = Policy {
            // The UART holds one byte, which is 260 us at this rate.
            poll_us: 20,
            ..Policy::default()
        };
        let mut camera = Cmucam2::with_policy(Peek::new(uart), Delay, policy);
        loop {
            // It was not there, it restarted, a wire was loose: begin again.
            let _ = follow(&mut camera, &mut lamp);
            lamp.set_low();
        }
    }

    fn follow(camera: &mut Camera, lamp: &mut Output<'static>) -> Result<(), Error<SerialError>> {
        camera.start_up(StartUp::default()).wait()?;
        // One packet for each that is asked for: nothing comes while the program does not read.
        camera.set(Command::PollMode(true)).wait()?;
        camera.learn_and_track(Learn::default()).wait()?;
        loop {
            let seen = camera.next_tracking().wait()?;
            let is_there = seen.is_some_and(|seen| !seen.is_lost());
            lamp.set_level(Level::from(is_there));
            let button = camera.command(Command::GetButton).wait()?;
            if matches!(button, Answer::Values([pressed, ..]) if pressed > 0) {
                camera.learn_and_track(Learn::default()).wait()?;
            }
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        cortex_m::asm::udf()
    }
}
