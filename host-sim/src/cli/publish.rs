//! `host-sim publish`

use std::process::ExitCode;

use clap::Args;
use host_sim::mqtt::{Publisher, check_name};

use super::{
    interrupt,
    live::{Audience, Credentials, SourceOptions},
    log_options::LogOptions,
    print,
};

/// Tells an MQTT broker what happens in a network: a real one, a simulation, or one that was recorded.
///
/// Coordinators on several computers make one site: `host-sim live --mqtt` shows all of them, with one verdict, and other
/// programs read poses and health. docs/mqtt.md describes topics and messages. Goes on until Ctrl-C. A broker
/// or a line that goes away is waited for.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: SourceOptions,
    /// The broker, and the topic of the site there, such as `mqtt://user@host:1883/building`. `mqtts://` is with TLS.
    #[arg(long, value_name = "URL")]
    mqtt: String,
    /// The name of this publisher, which no other one at the site has: a level of its topics.
    #[arg(long, value_name = "NAME")]
    name: String,
    /// Obey commands that come from the broker, such as those of the page of `host-sim live --mqtt`: all users obey
    /// that the broker lets write there.
    #[arg(long)]
    obey: bool,
    #[command(flatten)]
    credentials: Credentials,
    #[command(flatten)]
    log: LogOptions,
}

const EPILOGUE: &str = "\
Examples:
  host-sim publish --port /dev/ttyACM0 --site building.toml --mqtt mqtt://me@192.168.1.5/building --name east
  host-sim publish --port /dev/ttyACM0 --site building.toml --mqtt mqtts://me@broker.example/building \\
    --name west --password-file password --obey
  host-sim publish lab --speed real-time --mqtt mqtt://localhost/building --name rehearsal

Exit codes:
  0  Ctrl-C
  2  wrong options, or a file, the port or the broker is not to be had";

/// Records without --log.
const LOG: &str = "host_sim=info";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.log.start(LOG)?;
    check_name(&arguments.name)?;
    let broker = arguments.credentials.broker(&arguments.mqtt)?;
    let interrupted = interrupt::watch()?;
    arguments.source.watch(&interrupted, |_| {
        let topic = format!("{}/{}", broker.topic(), arguments.name);
        let (publisher, commands) =
            Publisher::start(broker.clone(), &arguments.name, arguments.obey)?;
        print(&format!("{topic}\n"))?;
        Ok((Audience::Broker(publisher), commands))
    })?;
    Ok(ExitCode::SUCCESS)
}
