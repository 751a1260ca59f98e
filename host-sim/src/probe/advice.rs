//! Advice on checks when the camera or its line fails.

use cmucam2_driver::{Error, session::Fault};

use super::port::PortError;

/// Names the failure and the things to check, the likeliest cause first.
pub fn advice(error: &Error<PortError>, baud_rate: u32) -> String {
    match error {
        Error::Uart(error) => of_port(error),
        Error::Closed => CLOSED.to_owned(),
        Error::Camera(fault) => camera_advice(*fault, baud_rate),
    }
}

/// Advice when the port itself fails.
pub fn of_port(error: &PortError) -> String {
    match error {
        PortError::Interrupted => "interrupted".to_owned(),
        PortError::Io(error) => format!(
            "the serial port failed ({error}): was the adapter unplugged, or the other end of a \
             pseudo-terminal closed?"
        ),
    }
}

/// Message when the port has come to its end.
pub const CLOSED: &str =
    "the serial port was closed by its other end: start that, then type the same command again";

/// When the camera answers no more after its banner and so many packets: its rate is right.
pub fn fell_silent(packets: u64) -> String {
    let since = since(packets);
    listed(
        format!("the camera has fallen silent after {since}"),
        &STOPPED,
    )
}

/// When it cannot be understood any more.
pub fn garbled_since(packets: u64) -> String {
    let since = since(packets);
    listed(
        format!("what comes makes no sense any more after {since}"),
        &DISTURBED,
    )
}

fn since(packets: u64) -> String {
    match packets {
        0 => "its banner".to_owned(),
        1 => "1 packet".to_owned(),
        _ => format!("{packets} packets"),
    }
}

/// When all rates were tried in vain. `heard`: whether anything came.
pub fn no_baud_rate(heard: bool) -> String {
    if heard {
        listed(
            "what comes makes no sense at any baud rate".to_owned(),
            &GARBLED,
        )
    } else {
        listed("no answer at any baud rate".to_owned(), &SILENT)
    }
}

const JUMPERS: &str = "do the camera's baud rate jumpers agree? `--baud auto` tries all";

/// Causes of silence at every rate.
const SILENT: [&str; 4] = [
    "is this the right port?",
    "is the camera powered (6 to 15 V at its own connector) and its LED lit? It sometimes fails to \
     start: switch it off and on",
    "are TX and RX swapped? The camera's TX belongs to the adapter's RX, and both need a common \
     ground",
    "do the levels fit? The 9-pin connector is RS-232 and the TTL pins are 0 and 5 V; a 3.3 V \
     adapter on the 9-pin connector needs a level shifter",
];

/// Causes of bytes without meaning.
const GARBLED: [&str; 3] = [
    "is this the right port? Something answers, but not like a CMUcam2",
    "RS-232 levels on TTL pins, or the other way round, arrive upside down: use a level shifter",
    "is the ground connected, and is the cable short enough for this rate?",
];

const REFUSED: [&str; 2] = [
    "it says NCK to a command that it should know. Many CMUcam2 do so now and then: try again, \
     then switch it off and on",
    "is it a CMUcam2? A CMUcam1 has other commands",
];

/// Causes of answers to other commands.
const UNEXPECTED: [&str; 2] = [
    "does another program use the same port? It takes answers away, and gets others",
    "is it a CMUcam2? Firmware of others answers some commands otherwise",
];

/// Causes of silence of a camera that has worked.
const STOPPED: [&str; 3] = [
    "was a wire pulled, or is a connector loose? The camera's TX is the one that is missing",
    "does the supply hold (200 mA, more with servos)? It may hang after a short drop: switch it off \
     and on",
    "does something else use the same port, or has the computer put the adapter to sleep?",
];

/// Lines that make nonsense of a camera that was understood before.
const DISTURBED: [&str; 3] = [
    "has another program set a mode that is not known here? Without --as-is the camera is started up, \
     which ends all modes",
    "does another program use the same port? It takes answers away, and gets others",
    "is the ground connected, and is the cable short enough for this rate?",
];

const RESTARTED: [&str; 2] = [
    "is the supply strong enough (200 mA, more with servos)? A voltage that sags restarts it",
    "is a connector loose?",
];

fn camera_advice(fault: Fault, baud_rate: u32) -> String {
    match fault {
        Fault::Silence => {
            let silent = listed(format!("no answer at {baud_rate} baud"), &SILENT);
            listed(silent, &[JUMPERS])
        }
        Fault::Garbage => {
            let garbled = format!("what comes at {baud_rate} baud makes no sense");
            listed(listed(garbled, &[JUMPERS]), &GARBLED)
        }
        Fault::Refused { .. } => listed(fault.to_string(), &REFUSED),
        Fault::Unexpected { .. } => listed(fault.to_string(), &UNEXPECTED),
        Fault::Restarted => listed(fault.to_string(), &RESTARTED),
        fault => fault.to_string(),
    }
}

fn listed(mut text: String, checks: &[&str]) -> String {
    for check in checks {
        text.push_str("\n  - ");
        text.push_str(check);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_failure_of_the_line_says_what_to_check() {
        for (fault, words) in [
            (Fault::Silence, ["38400", "powered", "swapped", "jumpers"]),
            (Fault::Garbage, ["38400", "jumpers", "--baud auto", "port"]),
            (
                Fault::Refused { command: *b"NF" },
                ["refused NF", "try again", "off and on", "CMUcam1"],
            ),
            (
                Fault::Unexpected { command: *b"GV" },
                ["answer GV", "asked for", "another program", "CMUcam2"],
            ),
            (Fault::Restarted, ["restarted", "supply", "mA", "loose"]),
        ] {
            let text = advice(&Error::Camera(fault), 38_400);
            for word in words {
                assert!(text.contains(word), "no {word} in {text}");
            }
        }
        let text = fell_silent(30);
        assert!(
            text.contains("after 30 packets") && text.contains("wire"),
            "{text}"
        );
        assert!(
            !text.contains("jumpers") && !text.contains("levels"),
            "{text}"
        );
        // All rates were tried: the jumpers are not to blame.
        let text = no_baud_rate(false);
        assert!(text.contains("powered") && !text.contains("jumpers"));
        let text = no_baud_rate(true);
        assert!(text.contains("upside down") && !text.contains("jumpers"));
    }
}
