//! The networks of a site on the page, each told by a publisher at a broker.

use std::{
    collections::BTreeMap,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use host_sim::{
    live::{About, Command},
    logging::Throttle,
    mqtt::{BEGIN, Begun as Message, EVENTS, Heard, OFFLINE, ONLINE, Reader, STATUS, Topic},
};
use results::record::{
    RunRecord,
    event::{CommandState, EVENT_FORMAT, Event, Looker, What},
};
use tracing::{debug, info, warn};

use super::{Audience, Begun, POLL, said, told};

/// Time between two looks at the site.
const LOOKS: Duration = Duration::from_millis(200);
/// Silence after which a verdict is told at once.
const QUIET: Duration = Duration::from_secs(1);

/// Runs until Ctrl-C. A broker that goes away is waited for.
pub(super) fn run(
    reader: &Reader,
    begins: impl FnOnce(About) -> Begun,
    interrupted: &AtomicBool,
) -> anyhow::Result<()> {
    let (audience, commands) = begins(About {
        name: reader.topic().to_owned(),
        kind: "network",
        speed: 0.0,
    })?;
    let mut site = Site {
        reader,
        audience,
        commands,
        publishers: BTreeMap::new(),
        zero: None,
        is_loaded: false,
        is_new: false,
        looker: Looker::default(),
        shown: None,
        said: Vec::new(),
        unclear: None,
        damaged: Throttle::default(),
    };
    let (mut looked, mut news) = (Instant::now(), Instant::now());
    while !interrupted.load(Ordering::Relaxed) {
        if site.hear() {
            news = Instant::now();
        }
        site.take();
        if site.is_loaded && site.is_new && looked.elapsed() >= LOOKS {
            looked = Instant::now();
            site.look();
        }
        if site.is_loaded && !site.is_new && news.elapsed() >= QUIET {
            site.tell_verdict();
        }
        thread::sleep(POLL);
    }
    Ok(())
}

/// A publisher, as far as it has told.
#[derive(Default)]
struct Publisher {
    /// Sum of its events.
    record: Option<RunRecord>,
    /// Time of its second 0, since 1970.
    zero: f64,
    obeys: bool,
    is_away: bool,
}

/// All publishers of a site.
struct Site<'a> {
    reader: &'a Reader,
    audience: Audience,
    commands: Receiver<Command>,
    publishers: BTreeMap<String, Publisher>,
    /// Time of the page's second 0, since 1970: that of the first publisher to begin, when the page begins.
    zero: Option<f64>,
    /// All that is retained has come.
    is_loaded: bool,
    /// Something came since the last look.
    is_new: bool,
    looker: Looker,
    /// The record at the last look.
    shown: Option<RunRecord>,
    /// Words that wait until there is a record.
    said: Vec<Event>,
    /// Reason why the publishers are not one site, which is told once.
    unclear: Option<String>,
    damaged: Throttle,
}

impl Site<'_> {
    /// Takes in what the broker has told. Returns false if it was nothing.
    fn hear(&mut self) -> bool {
        let mut is_any = false;
        for heard in self.reader.heard() {
            is_any = true;
            match heard {
                // Each publisher that the broker knows begins anew. What others told may still be true.
                Heard::Begins => self.is_loaded = false,
                Heard::Loaded => {
                    self.is_loaded = true;
                    self.is_new = true;
                }
                // It is in the log.
                Heard::Said(words) => self.say(words),
                Heard::Message {
                    publisher,
                    levels,
                    text,
                } => {
                    if let Err(error) = self.message(&publisher, &levels, &text) {
                        if let Some(count) = self.damaged.count(1) {
                            debug!(publisher, levels, count, "damaged or unknown: {error:#}");
                        }
                        self.say(format!("{publisher}/{levels}: {error:#}"));
                    }
                }
            }
        }
        is_any
    }

    fn message(&mut self, name: &str, levels: &str, text: &str) -> anyhow::Result<()> {
        let publisher = self.publishers.entry(name.to_owned()).or_default();
        match levels {
            STATUS => {
                let was_away = publisher.is_away;
                publisher.is_away = text == OFFLINE;
                let words = match (was_away, text) {
                    (false, OFFLINE) => "has ended or is lost: it is shown as it was",
                    (true, ONLINE) => "is there again",
                    _ => return Ok(()),
                };
                info!(publisher = name, "{words}");
                self.say(format!("publisher {name}: {words}"));
            }
            BEGIN if text.is_empty() => {
                self.publishers.remove(name);
                self.is_new = true;
            }
            BEGIN => {
                let begun = Message::from_json(text)?;
                let What::Begin { events, record } = begun.event.what else {
                    bail!("a stream does not begin so");
                };
                ensure!(
                    events == EVENT_FORMAT,
                    "it has event format {events}, and only format {EVENT_FORMAT} can be read: take the same \
                     version of host-sim"
                );
                publisher.record = Some(*record);
                publisher.zero = begun.besides.zero_unix;
                publisher.obeys = begun.besides.obeys;
                // Its parts are on their way.
                self.is_loaded = false;
            }
            _ if !levels.starts_with(EVENTS) => {}
            _ => return self.event(name, levels, text),
        }
        Ok(())
    }

    /// Takes in an event of a publisher that has begun.
    fn event(&mut self, name: &str, levels: &str, text: &str) -> anyhow::Result<()> {
        let topic = Topic::parse(levels);
        let Some(publisher) = self.publishers.get_mut(name) else {
            return Ok(());
        };
        let Some(record) = &mut publisher.record else {
            return Ok(());
        };
        if text.is_empty() {
            if let Some(Topic::Part(part)) = topic {
                record.forget(part);
                self.is_new = true;
            }
            return Ok(());
        }
        if topic == Some(Topic::Verdict) {
            // That on all networks is found here.
            return Ok(());
        }
        let mut event = Event::from_line(text)?;
        match topic {
            Some(_) => {
                record.apply(&event);
                self.is_new = true;
            }
            None => {
                if let (true, Some(zero)) = (self.is_loaded, self.zero) {
                    event.seconds += publisher.zero - zero;
                    self.audience.tell([event]);
                }
            }
        }
        Ok(())
    }

    /// The present time of the page.
    fn seconds(&self) -> f64 {
        let shown = self.shown.as_ref();
        shown.map_or(0.0, |record| record.sim_seconds)
    }

    fn say(&mut self, words: String) {
        self.said.push(said(self.seconds(), words));
        // The page begins with the record.
        if self.shown.is_some() || self.unclear.is_some() {
            self.audience.tell(self.said.drain(..));
        }
    }

    /// The record of all publishers; `None` if there is none yet.
    fn record(&self) -> anyhow::Result<Option<RunRecord>> {
        let mut parts: Vec<(&String, RunRecord)> = Vec::new();
        for (name, publisher) in &self.publishers {
            let Some(record) = &publisher.record else {
                continue;
            };
            let own = |network: u16| { record.networks.iter() }.any(|own| own.network == network);
            let is_twice = |other: &RunRecord| other.networks.iter().any(|net| own(net.network));
            if let Some((other, _)) = parts.iter().find(|(_, part)| is_twice(part)) {
                // A coordinator without members yet may be that of any network.
                if record.nodes.iter().all(|node| node.address.is_none()) {
                    continue;
                }
                bail!(
                    "publishers {other} and {name} tell of the same network: give both the --site of the building, \
                     and end one if they are on the same line"
                );
            }
            let later = publisher.zero - self.zero.unwrap_or_default();
            parts.push((name, record.clone().later(later)));
        }
        Ok(RunRecord::together(parts.into_iter().map(|(_, part)| part)))
    }

    fn look(&mut self) {
        self.is_new = false;
        let begun = { self.publishers.values() }.filter(|own| own.record.is_some());
        let first = begun.map(|own| own.zero).min_by(f64::total_cmp);
        self.zero = self.zero.or(first);
        match self.record() {
            Ok(Some(record)) => {
                self.unclear = None;
                self.audience.tell(self.looker.look(&record));
                self.shown = Some(record);
                self.audience.tell(self.said.drain(..));
            }
            Ok(None) => {}
            Err(error) => {
                let words = error.to_string();
                if self.unclear.as_ref() != Some(&words) {
                    warn!("{words}");
                    self.unclear = Some(words.clone());
                    self.say(words);
                }
            }
        }
    }

    /// Tells the verdict that is owed: publishers that have ended say nothing more, and no time goes on.
    fn tell_verdict(&mut self) {
        if let Some(record) = &self.shown {
            self.audience.tell(self.looker.owed_verdict(record));
        }
    }

    /// Hands commands from the page to the publishers that they concern.
    fn take(&mut self) {
        let commands: Vec<_> = self.commands.try_iter().collect();
        for command in commands {
            if let Err(why) = self.hand_on(&command) {
                let event = told(
                    self.seconds(),
                    &command,
                    CommandState::Failed,
                    &why.to_string(),
                );
                self.audience.tell([event]);
            }
        }
    }

    /// Hands a command on. The publisher tells what becomes of it.
    fn hand_on(&self, command: &Command) -> anyhow::Result<()> {
        let node = match command {
            Command::JoinWindow { .. } => None,
            Command::Camera { node, .. } => *node,
            Command::Remove { node } => Some(*node),
            _ => bail!("only a simulation can do that"),
        };
        let mut meant: Vec<&String> = self.publishers.keys().collect();
        if let Some(node) = node {
            let of = self.of(node);
            meant = vec![of.with_context(|| format!("node {node} is no member"))?];
        }
        ensure!(!meant.is_empty(), "there is no publisher yet");
        for name in meant {
            let publisher = &self.publishers[name];
            ensure!(!publisher.is_away, "publisher {name} is away");
            ensure!(
                publisher.obeys,
                "publisher {name} takes no commands: start it with --obey"
            );
            ensure!(
                self.reader.command(name, command),
                "the broker is away: try again"
            );
        }
        Ok(())
    }

    /// The publisher that heard last of this member.
    fn of(&self, id: u16) -> Option<&String> {
        let heard = self.publishers.iter().filter_map(|(name, publisher)| {
            let mut nodes = publisher.record.iter().flat_map(|record| &record.nodes);
            let node = nodes.find(|node| node.id == id && node.address.is_some())?;
            Some((
                publisher.zero + node.heard_seconds.unwrap_or_default(),
                name,
            ))
        });
        let latest = heard.max_by(|(a, _), (b, _)| a.total_cmp(b));
        latest.map(|(_, name)| name)
    }
}
