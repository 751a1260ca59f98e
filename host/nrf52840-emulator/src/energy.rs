//! Current that a chip draws, from the times for which its parts were on.
//!
//! Currents are the typical ones of the Product Specification, "Current consumption": 3 V, 25 degrees, with
//! the DC/DC regulator. The specification tells none for UARTE: that of the nRF5340 is taken, which counts the
//! clock too that the radio needs anyway, so that it is more than the truth. TWIM is not counted, nor what is
//! on the board beside the chip. An instruction takes a cycle here, and more where a chip waits for its flash.

use crate::node::Outcome;

/// "Radio transmitting/receiving", `I_RADIO_RX2`: IEEE 802.15.4, with the crystal it needs; mA.
const RECEIVING: f64 = 6.53;
/// `I_RADIO_TX2`, `I_RADIO_TX5` and `I_RADIO_TX0`: by the power sent, dBm; mA.
const SENDING: [(f64, f64); 3] = [(-40.0, 3.83), (0.0, 6.40), (8.0, 16.40)];
/// Current that the processor adds to a radio that receives: "Compounded", `I_S1`, less `I_RADIO_RX0`; mA.
const RUNNING: f64 = 8.6 - 6.26;
/// "Sleep", `I_ON_RAMON_RTC`: all RAM is kept, and RTC runs; mA.
const ASLEEP: f64 = 0.003_16;
/// nRF5340 Product Specification, "Current consumption", `I_UARTE,IDLE1`: the receiver waits; and the surplus of
/// `I_UARTE1`, while bytes are on the line; mA.
const LINE: [f64; 2] = [0.840, 0.890 - 0.840];
/// "TIMER running", `I_TIMER0` and `I_TIMER2`: one at 1 MHz, with the clock that it needs, from the oscillator of the
/// chip or from the crystal; mA.
const CLOCK: [f64; 2] = [0.418, 0.646];
const HZ: f64 = 64e6;

/// Mean currents, mA, by their purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Current {
    /// The radio listens or receives.
    pub receiving: f64,
    /// It sends.
    pub sending: f64,
    /// The processor runs, or waits for the flash.
    pub running: f64,
    /// The UART is not stopped, or bytes are on the line.
    pub line: f64,
    /// The high-frequency clock runs for a counter, or for a program that asked for its crystal, and neither UART nor
    /// radio need it. Of two such times one is taken to lie within the other; where it does not, the clock takes more
    /// than this.
    pub clock: f64,
    /// Always.
    pub asleep: f64,
}

impl Current {
    /// Mean currents of a chip that sends with so many dBm, over all of the time it had power.
    pub fn of(outcome: &Outcome, power: i8) -> Self {
        let share = |nanoseconds: u64| nanoseconds as f64 / outcome.powered.max(1) as f64;
        let [receiving, sending] = outcome.radio_on.map(share);
        let flash = outcome.operations.iter().map(|work| work.end - work.start);
        let instructions = outcome.instructions as f64 / HZ * 1e9;
        Self {
            receiving: receiving * RECEIVING,
            sending: sending * at(power.into()),
            running: share(flash.sum::<u64>() + instructions as u64) * RUNNING,
            line: share(outcome.uart_on[0]) * LINE[0] + share(outcome.uart_on[1]) * LINE[1],
            clock: share(outcome.clock_on[0].saturating_sub(outcome.uart_on[0])) * CLOCK[0]
                + share(outcome.clock_on[1].saturating_sub(outcome.radio_on.iter().sum()))
                    * CLOCK[1],
            asleep: ASLEEP,
        }
    }

    /// All of it, mA.
    pub fn total(&self) -> f64 {
        self.receiving + self.sending + self.running + self.line + self.clock + self.asleep
    }

    /// If it listened for this share of the time that it does.
    #[must_use]
    pub fn listening(self, share: f64) -> Self {
        Self {
            receiving: self.receiving * share,
            ..self
        }
    }

    /// If its UART were on only while bytes are on the line.
    #[must_use]
    pub fn without_waiting_line(self, outcome: &Outcome) -> Self {
        let busy = outcome.uart_on[1] as f64 / outcome.powered.max(1) as f64;
        Self {
            line: busy * (LINE[0] + LINE[1]),
            ..self
        }
    }

    /// Life of a battery of so many mAh, hours.
    pub fn hours(&self, capacity: f64) -> f64 {
        capacity / self.total()
    }
}

/// In proportion between the known values.
fn at(power: f64) -> f64 {
    let [(low, least), (middle, usual), (high, most)] = SENDING;
    let between = |(from, a): (f64, f64), (to, b): (f64, f64)| {
        a + (b - a) * ((power - from) / (to - from)).clamp(0.0, 1.0)
    };
    if power < middle {
        between((low, least), (middle, usual))
    } else {
        between((middle, usual), (high, most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A crystal that is left on while the radio is off.
    #[test]
    fn a_crystal_is_not_for_nothing() {
        let outcome = Outcome {
            powered: 1_000,
            radio_on: [5, 0],
            clock_on: [0, 105],
            ..Outcome::default()
        };
        let current = Current::of(&outcome, 0);
        assert!((current.clock - 0.1 * 0.646).abs() < 1e-9, "{current:?}");
    }

    /// By hand: it receives all the time but 1 %, and runs for 1 % of it.
    #[test]
    fn currents_are_those_of_the_specification() {
        let outcome = Outcome {
            powered: 100_000_000_000,
            radio_on: [99_000_000_000, 1_000_000_000],
            instructions: 57_600_000,
            uart_on: [50_000_000_000, 1_000_000_000],
            clock_on: [60_000_000_000, 100_000_000_000],
            operations: [5, 50_000_005].map(|at| at..at + 50_000_000).to_vec(),
            ..Outcome::default()
        };
        let current = Current::of(&outcome, 0);
        let line = 0.5 * 0.84 + 0.01 * 0.05;
        // The counter runs for longer than the UART; the radio needs the crystal all the time.
        let clock = 0.1 * 0.418;
        let expected = 0.99 * 6.53 + 0.01 * 6.4 + 0.01 * 2.34 + line + clock + 0.003_16;
        assert!((current.total() - expected).abs() < 1e-9, "{current:?}");
        assert!((current.hours(expected * 3.0) - 3.0).abs() < 1e-9);
        let quiet = current.without_waiting_line(&outcome).total();
        assert!((quiet - (expected - line + 0.01 * 0.89)).abs() < 1e-9);
        let seldom = current.listening(0.1).total();
        assert!((seldom - (expected - 0.9 * 0.99 * 6.53)).abs() < 1e-9);
    }

    #[test]
    fn more_power_draws_more() {
        for (power, current) in [(-40, 3.83), (-50, 3.83), (0, 6.4), (8, 16.4), (4, 11.4)] {
            assert!((at(f64::from(power)) - current).abs() < 1e-9, "{power}");
        }
    }
}
