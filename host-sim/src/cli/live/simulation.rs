//! A simulation on the page, and commands from people there.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    thread,
};

use anyhow::{Context, ensure};
use host_sim::{
    live::{About, Command},
    network::{Onlooker, Options, Simulation},
};
use results::{record::event::CommandState, view::parse_command};
use site::{Action, Overrides, Scenario};
use virtual_hardware::executor::times_real_time;

use super::super::{of_site, scenario_options::tell_assumptions};
use super::{Audience, Begun, POLL, SourceOptions, told, wait};

/// Slowest speed by command. At a slower one an event, and with it the next command, would wait for minutes.
const SLOWEST: f64 = 0.1;

/// Time between two looks at a simulation, nanoseconds.
const LOOKS: u64 = 100_000_000;
/// Largest distance by which a camera is moved at once: the largest width of a site.
const MOVE_MAX: f64 = 1e5;

pub(super) fn run(
    options: &SourceOptions,
    source: &str,
    begins: impl FnOnce(About) -> Begun,
    interrupted: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let overrides = Overrides {
        seed: options.seed,
        path: options.path,
        nodes: options.nodes,
        ..Overrides::default()
    };
    let named = |error| of_site(source, error);
    let scenario = Scenario::load(source, &overrides).map_err(named)?;
    tell_assumptions(source, &scenario);
    let name = scenario.name.clone();
    let settings = Options {
        speed: options.speed.0,
        further_stops: options.further_stops,
        stop: interrupted.clone(),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, settings).map_err(named)?;
    simulation.watch();
    simulation.take_orders();
    if options.speed.0.is_none() {
        simulation.set_pace(|_| ());
    }
    let (audience, commands) = begins(About {
        name,
        kind: "simulation",
        speed: options.speed.0.unwrap_or(0.0),
    })?;
    let mut controls = Controls {
        audience: &audience,
        commands: &commands,
        interrupted,
        times: options.speed.0,
    };
    let mut onlooker = Onlooker::default();
    let record = simulation.run_watched(
        LOOKS,
        |_| (),
        |simulation| {
            audience.tell(onlooker.look(simulation));
            controls.take(simulation);
        },
    );
    let why = interrupted.load(Ordering::Relaxed).then_some("interrupted");
    audience.tell(onlooker.end(&simulation, &record, why));
    wait(&audience, &commands, interrupted);
    Ok(())
}

/// Commands of people at the page for a simulation.
struct Controls<'a> {
    audience: &'a Audience,
    commands: &'a Receiver<Command>,
    interrupted: &'a AtomicBool,
    times: Option<f64>,
}

impl Controls<'_> {
    fn take(&mut self, simulation: &mut Simulation) {
        let mut is_paused = false;
        loop {
            for command in self.commands.try_iter() {
                match command {
                    Command::Pause => is_paused = true,
                    Command::Resume => is_paused = false,
                    _ => {}
                }
                let seconds = simulation.seconds();
                let event = match self.act(simulation, &command) {
                    Ok(true) => told(seconds, &command, CommandState::Done, ""),
                    Ok(false) => told(seconds, &command, CommandState::Asked, ""),
                    Err(why) => told(seconds, &command, CommandState::Failed, &why.to_string()),
                };
                self.audience.tell([event]);
            }
            if !is_paused || self.interrupted.load(Ordering::Relaxed) {
                return;
            }
            thread::sleep(POLL);
        }
    }

    /// Returns true if it is done already; a node's command is done when the node says so.
    fn act(&mut self, simulation: &mut Simulation, command: &Command) -> anyhow::Result<bool> {
        let duration = |seconds: f64| -> anyhow::Result<f64> {
            ensure!(
                (0.0..=86_400.0).contains(&seconds),
                "a time from 0 to 86400 s is needed"
            );
            Ok(seconds)
        };
        let known = |node: u16| -> anyhow::Result<u16> {
            ensure!(simulation.config(node).is_some(), "there is no node {node}");
            Ok(node)
        };
        let action = match *command {
            Command::Pause => return Ok(true),
            Command::Resume => {
                self.pace(simulation);
                return Ok(true);
            }
            Command::Speed { times } => {
                ensure!(
                    times == 0.0 || (SLOWEST..=1e6).contains(&times),
                    "a speed from {SLOWEST} to 1000000 is needed, or 0 for as fast as it can"
                );
                self.times = (times > 0.0).then_some(times);
                self.pace(simulation);
                return Ok(true);
            }
            Command::Restart { node } => Action::Restart { node: known(node)? },
            Command::Unplug { node, seconds } => Action::UnplugCamera {
                node: known(node)?,
                for_s: duration(seconds)?,
                with_power: true,
            },
            Command::Jam { seconds } => Action::Jam {
                for_s: duration(seconds)?,
                channel: None,
                at: None,
                reach: None,
            },
            Command::Drift {
                node,
                seconds,
                share,
            } => {
                ensure!(share.abs() <= 1.0, "a share from -1 to 1 is needed");
                Action::Slip {
                    node: known(node)?,
                    for_s: duration(seconds)?,
                    distance: share,
                    heading_deg: 0.0,
                }
            }
            Command::Move { node, by, turn_deg } => {
                // Places stay within what a site may be, and a camera turns by one round at most.
                let is_near = by.iter().all(|by| by.abs() <= MOVE_MAX) && turn_deg.abs() <= 360.0;
                ensure!(
                    is_near,
                    "lengths of {MOVE_MAX:.0} at most are needed, and -360 to 360 degrees"
                );
                Action::BumpCamera {
                    node: known(node)?,
                    by,
                    turn_deg,
                }
            }
            Command::JoinWindow { seconds } => {
                simulation.let_join(seconds);
                return Ok(false);
            }
            Command::Remove { node } => {
                ensure!(simulation.remove(node), "node {node} is no member");
                return Ok(false);
            }
            Command::Camera { node, ref command } => {
                let order = parse_command(command).context("cameras know no such command")?;
                let record = simulation.record();
                let all = record.cameras().map(|camera| camera.id);
                let meant: Vec<u16> = all
                    .filter(|id| node.is_none_or(|node| node == *id))
                    .collect();
                ensure!(!meant.is_empty(), "there is no such camera");
                let sent = meant.iter().filter(|id| simulation.order(**id, order));
                ensure!(sent.count() > 0, "no such camera is a member");
                return Ok(false);
            }
        };
        simulation.act(action);
        Ok(true)
    }

    fn pace(&self, simulation: &mut Simulation) {
        match self.times {
            Some(times) => simulation.set_pace(times_real_time(times)),
            None => simulation.set_pace(|_| ()),
        }
    }
}
