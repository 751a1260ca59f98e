//! Real networks on the page: a coordinator each, on a line of its own.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use host_sim::{
    console::session::Wish,
    live::{About, Command},
};
use results::{
    record::event::{CommandState, Event, Looker},
    view::{command_name, parse_command},
};
use site::Scenario;
use tracing::warn;

use super::super::{
    console::{check_ports, read_site},
    lines::{Lines, Trouble},
};
use super::{Audience, Begun, POLL, SourceOptions, said, told};

/// Time between two looks at the networks.
const LOOKS: Duration = Duration::from_millis(200);

/// Runs until Ctrl-C. A line that goes away is waited for; one that never was there is a wrong name.
pub(super) fn run(
    source: &SourceOptions,
    begins: impl FnOnce(About) -> Begun,
    interrupted: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    check_ports(&source.port)?;
    let site = source.site.as_deref().map(read_site).transpose()?;
    let ports = (&source.port[..], source.baud);
    let lines = Lines::open(ports, Vec::new(), interrupted)?;
    let lines = lines.of_site(site.as_ref()).with_sightings();
    let name = match &site {
        Some(site) => site.name.clone(),
        None => source.port.join(", "),
    };
    let (audience, commands) = begins(About {
        name,
        kind: "network",
        speed: 0.0,
    })?;
    let mut networks = Networks {
        asked: lines.all.iter().map(|_| Asked::default()).collect(),
        site: site.as_ref(),
        lines,
        looker: Looker::default(),
        unclear: None,
        audience,
        commands,
    };
    let begin = Instant::now();
    let mut looked = None;
    // At a broker, what was told before a restart stays until the members are known again.
    let mut is_known = matches!(networks.audience, Audience::Page(_));
    while !interrupted.load(Ordering::Relaxed) {
        let now = begin.elapsed();
        networks.exchange(now);
        networks.take(now);
        is_known |= networks.lines.are_listed(now);
        if is_known && looked.is_none_or(|at| now.saturating_sub(at) >= LOOKS) {
            looked = Some(now);
            networks.look(now);
        }
        thread::sleep(POLL);
    }
    Ok(())
}

/// Commands for a coordinator.
#[derive(Default)]
struct Asked {
    /// Handled one after the other; the first is on its way, if its line has a wish.
    pending: VecDeque<(Command, Wish)>,
    /// Problem of its line, which is told once.
    trouble: Option<String>,
}

/// All networks of a site.
struct Networks<'a> {
    site: Option<&'a Scenario>,
    lines: Lines,
    /// By line.
    asked: Vec<Asked>,
    looker: Looker,
    /// Reason why the lines are not one site, which is told once.
    unclear: Option<String>,
    audience: Audience,
    commands: Receiver<Command>,
}

impl Networks<'_> {
    /// Reads what has come on every line, and tells it.
    fn exchange(&mut self, now: Duration) {
        for n in 0..self.lines.all.len() {
            let is_wished = !self.lines.all[n].session.is_done();
            match self.lines.all[n].exchange(now) {
                Ok(()) => {
                    let line = &self.lines.all[n];
                    if line.is_open() && line.session.has_answered() {
                        self.asked[n].trouble = None;
                    }
                    if is_wished && line.session.is_done() {
                        self.end(now, n, CommandState::Done, "");
                    }
                }
                Err(Trouble::Wish(failure)) => {
                    self.lines.all[n].session.go_on(now);
                    let words = failure.to_string();
                    if !is_wished || !self.end(now, n, CommandState::Failed, &words) {
                        self.complain(now, n, words);
                    }
                }
                Err(Trouble::Interrupted) => return,
            }
            self.tell(now, n);
        }
    }

    /// Tells the page what a line said besides the record.
    fn tell(&mut self, now: Duration, n: usize) {
        let line = &mut self.lines.all[n];
        while let Some(words) = line.news() {
            let words = format!("{}{words}", line.prefix);
            self.audience.tell([said(now.as_secs_f64(), words)]);
        }
        let network = line.network.get();
        while let Some(what) = line.session.happening(network) {
            self.audience.tell([Event::new(now.as_secs_f64(), what)]);
        }
    }

    /// Tells what became of a coordinator's first command. Returns false if there was no command.
    fn end(&mut self, now: Duration, n: usize, state: CommandState, why: &str) -> bool {
        let Some((command, _)) = self.asked[n].pending.pop_front() else {
            return false;
        };
        let words = match why {
            "" => self.lines.all[n].prefix.trim_end_matches(": ").to_owned(),
            why => format!("{}{why}", self.lines.all[n].prefix),
        };
        let seconds = now.as_secs_f64();
        self.audience.tell([told(seconds, &command, state, &words)]);
        true
    }

    fn complain(&mut self, now: Duration, n: usize, words: String) {
        let port = &self.lines.all[n].path;
        let said = said(now.as_secs_f64(), format!("{port}: {words}"));
        if self.asked[n].trouble.as_ref() != Some(&words) {
            warn!(port, "{words}");
            self.asked[n].trouble = Some(words);
            self.audience.tell([said]);
        }
    }

    fn look(&mut self, now: Duration) {
        match self.lines.record(now, self.site) {
            Ok(record) => {
                self.unclear = None;
                self.audience.tell(self.looker.look(&record));
            }
            Err(error) => {
                let words = error.to_string();
                if self.unclear.as_ref() != Some(&words) {
                    warn!("{words}");
                    self.unclear = Some(words.clone());
                    self.audience.tell([said(now.as_secs_f64(), words)]);
                }
            }
        }
    }

    /// Hands commands from the page to the coordinators that they concern, one after the other.
    fn take(&mut self, now: Duration) {
        let seconds = now.as_secs_f64();
        let commands: Vec<_> = self.commands.try_iter().collect();
        for command in commands {
            let (state, words) = match self.wish(&command) {
                Ok(()) => (CommandState::Asked, String::new()),
                Err(why) => (CommandState::Failed, why.to_string()),
            };
            self.audience.tell([told(seconds, &command, state, &words)]);
        }
        for (line, asked) in self.lines.all.iter_mut().zip(&self.asked) {
            if line.session.is_done()
                && let Some((_, wish)) = asked.pending.front()
            {
                line.session.wish(*wish);
            }
        }
    }

    /// Hands a command to the coordinators that it concerns.
    fn wish(&mut self, command: &Command) -> anyhow::Result<()> {
        match *command {
            Command::JoinWindow { seconds } => {
                for asked in &mut self.asked {
                    let wish = Wish::JoinWindow(seconds);
                    asked.pending.push_back((command.clone(), wish));
                }
            }
            Command::Remove { node } => {
                let of = self.lines.of(node);
                let of = of.with_context(|| format!("node {node} is no member"))?;
                let wish = (command.clone(), Wish::Remove(node));
                self.asked[of].pending.push_back(wish);
            }
            Command::Camera { node, ref command } => {
                let order = parse_command(command).context("cameras know no such command")?;
                let mut meant = self.lines.cameras();
                meant.retain(|(_, id)| node.is_none_or(|node| node == *id));
                ensure!(!meant.is_empty(), "no such camera is a member");
                for (of, id) in meant {
                    let command = Command::Camera {
                        node: Some(id),
                        command: command_name(order),
                    };
                    let wish = (command, Wish::Command(id, order));
                    self.asked[of].pending.push_back(wish);
                }
            }
            _ => bail!("only a simulation can do that"),
        }
        Ok(())
    }
}
