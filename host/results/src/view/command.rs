//! Commands for cameras, as people type them.

use node_firmware::{limits::COLOURS_MAX, message::CameraCommand};

/// Names of all commands.
pub const COMMAND_NAMES: [&str; 6] = [
    "initialise",
    "learn-colour",
    "learn-background",
    "track",
    "stop-tracking",
    "forget",
];

/// `learn-colour`, or `learn-colour=1` of another colour than the first.
pub fn parse_command(name: &str) -> Option<CameraCommand> {
    Some(match name {
        "initialise" => CameraCommand::Initialise,
        "learn-background" => CameraCommand::LearnBackground,
        "stop-tracking" => CameraCommand::StopTracking,
        "forget" => CameraCommand::Forget,
        coloured => {
            let (name, colour) = match coloured.split_once('=') {
                Some((name, colour)) => (name, colour.parse().ok().filter(is_colour)?),
                None => (coloured, 0),
            };
            match name {
                "learn-colour" => CameraCommand::LearnColour { colour },
                "track" => CameraCommand::Track { colour },
                _ => return None,
            }
        }
    })
}

/// Returns true if a colour can have this number.
fn is_colour(number: &u8) -> bool {
    usize::from(*number) < COLOURS_MAX
}

/// Text that [`parse_command`] reads as this command.
pub fn command_name(command: CameraCommand) -> String {
    let coloured = |name: &str, colour| match colour {
        0 => name.to_owned(),
        _ => format!("{name}={colour}"),
    };
    match command {
        CameraCommand::Initialise => "initialise".to_owned(),
        CameraCommand::LearnBackground => "learn-background".to_owned(),
        CameraCommand::StopTracking => "stop-tracking".to_owned(),
        CameraCommand::Forget => "forget".to_owned(),
        CameraCommand::LearnColour { colour } => coloured("learn-colour", colour),
        CameraCommand::Track { colour } => coloured("track", colour),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_is_what_is_meant() {
        for name in COMMAND_NAMES
            .into_iter()
            .chain(["learn-colour=2", "track=1"])
        {
            assert_eq!(parse_command(name).map(command_name).as_deref(), Some(name));
        }
        for name in ["", "track=", "forget=1", "track=256", "track=4", "sleep"] {
            assert_eq!(parse_command(name), None, "{name}");
        }
    }
}
