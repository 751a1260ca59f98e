//! Check that the image uses the wires that the board has.

use super::outside::Wires;

/// Pins of the board (docs/hardware.md): to send and to receive, of the camera and of the console; data and clock
/// of the step sensor's bus. Those of the second port are numbered from 32 on.
pub(super) const CAMERA: [u32; 2] = [32 + 2, 32 + 1];
pub(super) const CONSOLE: [u32; 2] = [6, 8];
pub(super) const BUS: [u32; 2] = [26, 27];

/// Two UARTs understand each other if their rates differ by at most one part in so many.
const TOLERANCE: u32 = 40;

/// # Errors
/// A connection to other pins, or another rate than that of the line.
pub(super) fn check(
    what: &str,
    is: &Wires,
    pins: [u32; 2],
    rate: Option<u32>,
) -> Result<(), String> {
    // The chip itself tells of wires that are used and not connected.
    let mut both = is.pins.into_iter().zip(pins);
    if !both.all(|(is, should)| is == should || is >= Wires::NOT_CONNECTED) {
        let [is, should] = [is.pins, pins].map(|pins| pins.map(name).join(" and "));
        return Err(format!("{what} has {is}, where the board has {should}"));
    }
    let rate = rate.filter(|rate| rate.abs_diff(is.rate) > rate / TOLERANCE);
    rate.map_or(Ok(()), |rate| {
        Err(format!(
            "{what} has {} baud, where its line has {rate}",
            is.rate
        ))
    })
}

fn name(pin: u32) -> String {
    match pin {
        0..Wires::NOT_CONNECTED => format!("P{}.{:02}", pin / 32, pin % 32),
        _ => "no pin".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_pins_and_other_rates_are_told() {
        let check = |pins, rate| {
            let is = Wires { pins, rate };
            check("its UART", &is, CAMERA, Some(38_400))
        };
        // The nearest rate that the chip can have; and a UART that only receives yet.
        assert_eq!(check(CAMERA, 38_330), Ok(()));
        assert_eq!(check([u32::MAX, 33], 38_330), Ok(()));
        for rate in [37_400, 39_400, 19_170, 114_746] {
            assert!(check(CAMERA, rate).is_err(), "{rate}");
        }
        let exchanged = check([33, 34], 38_330).unwrap_err();
        assert_eq!(
            exchanged,
            "its UART has P1.01 and P1.02, where the board has P1.02 and P1.01"
        );
        assert!(check(CONSOLE, 38_330).is_err());
        assert!(check([34, 8], 38_330).is_err());
    }
}
