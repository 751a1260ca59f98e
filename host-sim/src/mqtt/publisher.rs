//! Tells a stream of events to a broker.
//!
//! Parts of the record to which the stream adds up are retained. What is owed to the broker are names of parts, and each
//! is told as it is when its turn comes. So a slow broker gets less, and one that was away gets everything that is still
//! true; memory does not grow meanwhile.

use std::{
    collections::{BTreeMap, VecDeque},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        mpsc::{self, Receiver, Sender},
    },
    thread::{self, JoinHandle},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use calib_core::{Refusal, Status};
use node_firmware::message::Health;
use results::record::{
    NodeMove, RunRecord,
    event::{Event, News, What},
    part::Part,
    space::HungEstimate,
};
use rumqttc::{
    AsyncClient, ClientError, Event as Happened, EventLoop, LastWill, MqttOptions, Outgoing,
    Packet, Publish, QoS, SubscribeFilter,
};
use serde::Serialize;
use tokio::sync::Notify;
use tracing::{debug, info, warn};

use super::{
    AGAIN, Broker, BrokerError, COMMAND, EVENTS, MESSAGE_MAX, OFFLINE, ONLINE, STATUS, Topic,
    broker,
    topic::{Begun, Besides},
};
use crate::{live::Command, logging::Throttle};

/// Number of events without lasting state that wait for a slow broker; of more, the oldest are left out.
const PASSING_MAX: usize = 1_000;
/// Number of messages on their way to the connection.
const REQUESTS: usize = 100;
/// Time for the last messages before the program ends.
const FAREWELL: Duration = Duration::from_secs(5);

/// A publisher that runs; takes events.
pub struct Publisher {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    news: Notify,
    ending: Notify,
}

/// Checks that a publisher can have this name.
///
/// # Errors
/// [`BrokerError::Name`]
pub fn check_name(name: &str) -> Result<(), BrokerError> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    match !name.is_empty() && name.chars().all(is_plain) {
        true => Ok(()),
        false => Err(BrokerError::Name(name.to_owned())),
    }
}

impl Publisher {
    /// Tells the broker from now on, on a thread of its own, under this name below the site's topic. Returns the commands
    /// of others too, of which there are none unless it obeys.
    ///
    /// # Errors
    /// [`BrokerError`]
    pub fn start(
        broker: Broker,
        name: &str,
        obeys: bool,
    ) -> Result<(Self, Receiver<Command>), BrokerError> {
        check_name(name)?;
        let own = format!("{}/{name}", broker.topic());
        // Always the same name: a broker closes the former connection of a client that was cut off, whose last will
        // would otherwise come after the new one's first message.
        let mut options = broker.options(format!("host-sim {own}"))?;
        let status = format!("{own}/{STATUS}");
        options.set_last_will(LastWill::new(status, OFFLINE, QoS::AtLeastOnce, true));
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let shared = Arc::new(Shared {
            state: Mutex::new(State::new(obeys)),
            news: Notify::new(),
            ending: Notify::new(),
        });
        let (commands, commanded) = mpsc::channel();
        let (first, begun) = mpsc::channel();
        let address = broker.address();
        let talk = Talk {
            shared: shared.clone(),
            broker,
            own,
            obeys,
            commands,
            address,
            left_out: Throttle::default(),
            too_long: Throttle::default(),
            strange: Throttle::default(),
        };
        let thread = thread::spawn(move || runtime.block_on(talk.go_on(options, &first)));
        if let Ok(Err(words)) = begun.recv() {
            return Err(BrokerError::Away(words));
        }
        let thread = Some(thread);
        Ok((Self { shared, thread }, commanded))
    }

    /// Tells these events.
    pub fn tell(&self, events: impl IntoIterator<Item = Event>) {
        let mut state = self.shared.state();
        for event in events {
            state.take(event);
        }
        drop(state);
        self.shared.news.notify_one();
    }
}

impl Drop for Publisher {
    /// Says good-bye, if the broker is there.
    fn drop(&mut self) {
        self.shared.state().is_ending = true;
        self.shared.news.notify_one();
        self.shared.ending.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic there was told already.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All that is known, and what the broker has not got of it yet.
struct State {
    /// Sum of all events.
    record: Option<RunRecord>,
    verdict: Option<Event>,
    end: Option<Event>,
    besides: Besides,
    /// Each with the news about a node.
    owed: BTreeMap<Topic, Vec<News>>,
    /// Events without lasting state.
    passing: VecDeque<Event>,
    /// Number of those that were left out since it was last asked for.
    left_out: u64,
    is_connected: bool,
    is_ending: bool,
}

/// A message for the broker, below the publisher's topic.
#[derive(Debug, PartialEq)]
struct Message {
    levels: String,
    text: String,
    is_retained: bool,
}

impl State {
    fn new(obeys: bool) -> Self {
        Self {
            record: None,
            verdict: None,
            end: None,
            besides: Besides {
                zero_unix: 0.0,
                obeys,
            },
            owed: BTreeMap::new(),
            passing: VecDeque::new(),
            left_out: 0,
            is_connected: false,
            is_ending: false,
        }
    }

    fn take(&mut self, event: Event) {
        let topic = Topic::of(&event.what);
        match &event.what {
            What::Begin { record, .. } => {
                // What was before is void.
                self.owe_all();
                self.verdict = None;
                self.end = None;
                let since = SystemTime::now().duration_since(UNIX_EPOCH);
                self.besides.zero_unix = since.unwrap_or_default().as_secs_f64() - event.seconds;
                self.record = Some(RunRecord::clone(record));
                self.owe_all();
                return;
            }
            What::Gone { node } => {
                self.owe(Topic::Part(Part::Node(*node)), &[]);
                self.owe(Topic::Part(Part::Target(*node)), &[]);
            }
            What::Verdict { .. } => self.verdict = Some(event.clone()),
            What::End { .. } => self.end = Some(event.clone()),
            _ => {}
        }
        if let Some(record) = &mut self.record {
            record.apply(&event);
        }
        match (topic, &event.what) {
            (Some(topic), What::Node { news, .. }) => self.owe(topic, news),
            (Some(topic), _) => self.owe(topic, &[]),
            (None, What::Gone { .. }) => {}
            // Of these, only the present is of interest.
            (None, _) if !self.is_connected => {}
            (None, _) => {
                if self.passing.len() == PASSING_MAX {
                    self.passing.pop_front();
                    self.left_out += 1;
                }
                self.passing.push_back(event);
            }
        }
    }

    fn owe(&mut self, topic: Topic, news: &[News]) {
        let known = self.owed.entry(topic).or_default();
        let new = news.iter().filter(|news| !known.contains(news));
        let new: Vec<_> = new.copied().collect();
        known.extend(new);
        let cameras = self.record.iter().flat_map(RunRecord::cameras);
        let concerned = cameras.filter(|camera| match topic {
            Topic::Part(Part::Node(id)) => camera.id == id,
            // Their places may be told in another frame.
            Topic::Part(Part::Network(number)) => camera.network == number,
            _ => false,
        });
        let topics = concerned.map(|camera| (Topic::Camera(camera.id), Vec::new()));
        self.owed.extend(topics);
    }

    /// Everything that is known is told anew.
    fn owe_all(&mut self) {
        let parts = self.record.iter().flat_map(RunRecord::parts);
        let parts: Vec<_> = parts.map(Topic::Part).collect();
        let verdict = self.verdict.as_ref().map(|_| Topic::Verdict);
        let end = self.end.as_ref().map(|_| Topic::End);
        for topic in parts.into_iter().chain(verdict).chain(end) {
            self.owe(topic, &[]);
        }
    }

    /// A message was retained by an earlier run, or before the connection failed.
    fn found(&mut self, topic: Topic) {
        if self.text(topic, Vec::new()).is_none() {
            self.owed.entry(topic).or_default();
        }
    }

    /// The message of a topic as things are now; `None` if there is none any more.
    fn text(&self, topic: Topic, told: Vec<News>) -> Option<String> {
        let record = self.record.as_ref()?;
        let event = match topic {
            Topic::Camera(id) => return camera(record, id),
            Topic::Verdict => self.verdict.clone()?,
            Topic::End => self.end.clone()?,
            Topic::Part(part) => {
                let mut what = record.told(part)?;
                if let What::Node { news, .. } = &mut what {
                    *news = told;
                }
                Event::new(record.sim_seconds, what)
            }
        };
        match topic {
            Topic::Part(Part::Begin) => {
                let besides = self.besides;
                Begun { event, besides }.to_json().ok()
            }
            _ => serde_json::to_string(&event).ok(),
        }
    }

    fn next(&mut self) -> Option<Message> {
        // Before the stream begins, what an earlier run told may still be true.
        if !self.is_connected || self.record.is_none() {
            return None;
        }
        if let Some((topic, news)) = self.owed.pop_first() {
            let text = self.text(topic, news);
            return Some(Message {
                levels: topic.to_string(),
                // An empty one takes the former back.
                text: text.unwrap_or_default(),
                is_retained: true,
            });
        }
        let event = serde_json::to_value(self.passing.pop_front()?).ok()?;
        Some(Message {
            levels: format!("{EVENTS}/{}", event["event"].as_str()?),
            text: event.to_string(),
            is_retained: false,
        })
    }
}

/// One camera for other programs. `docs/mqtt.md` describes it.
#[derive(Serialize)]
struct CameraDocument<'a> {
    camera: u16,
    network: u16,
    unit: &'a str,
    /// `building`, or `network`.
    frame: &'static str,
    status: Option<Status>,
    reason: Option<Refusal>,
    reference: bool,
    x: Option<f64>,
    y: Option<f64>,
    heading_deg: Option<f64>,
    sigma_x: Option<f64>,
    sigma_y: Option<f64>,
    sigma_heading_deg: Option<f64>,
    /// Height, pitch and roll, with their sigmas, where they are known.
    #[serde(flatten)]
    hung: Option<HungEstimate>,
    checked: bool,
    moved: Option<NodeMove>,
    sightings: usize,
    member: bool,
    silent: bool,
    health: Health,
}

fn camera(record: &RunRecord, id: u16) -> Option<String> {
    let node = record.cameras().find(|node| node.id == id)?;
    let placed = record.node_in_building(node);
    let frame = match placed {
        Some(_) => "building",
        None => "network",
    };
    let estimate = placed.map_or(node.estimate, |placed| placed.estimate);
    let document = CameraDocument {
        camera: id,
        network: node.network,
        unit: &record.unit.name,
        frame,
        status: node.status,
        reason: node.reason,
        reference: node.reference,
        x: estimate.map(|own| own.x),
        y: estimate.map(|own| own.y),
        heading_deg: estimate.map(|own| own.heading_deg),
        sigma_x: estimate.map(|own| own.sigma_x),
        sigma_y: estimate.map(|own| own.sigma_y),
        sigma_heading_deg: estimate.map(|own| own.sigma_heading_deg),
        hung: estimate.and_then(|own| own.hung),
        checked: node.is_checked(&record.limits),
        moved: node.moved,
        sightings: node.sightings,
        member: node.address.is_some(),
        silent: node.silent,
        health: node.health,
    };
    serde_json::to_string(&document).ok()
}

/// The talk with the broker.
struct Talk {
    shared: Arc<Shared>,
    broker: Broker,
    /// Topic of the publisher.
    own: String,
    obeys: bool,
    commands: Sender<Command>,
    /// The broker's, for the log.
    address: String,
    /// Events that waited too long.
    left_out: Throttle,
    too_long: Throttle,
    /// Messages to obey that are no commands.
    strange: Throttle,
}

impl Talk {
    /// Talks until the publisher ends, or the broker cannot be had at first.
    async fn go_on(self, options: MqttOptions, first: &Sender<Result<(), String>>) {
        let (client, mut events) = AsyncClient::new(options, REQUESTS);
        events.set_network_options(broker::network());
        tokio::select! {
            () = self.listen(&client, &mut events, first) => {}
            () = self.send(&client) => {}
            () = async {
                self.shared.ending.notified().await;
                tokio::time::sleep(FAREWELL).await;
            } => {}
        }
    }

    async fn listen(
        &self,
        client: &AsyncClient,
        events: &mut EventLoop,
        first: &Sender<Result<(), String>>,
    ) {
        // Words on a broker that is away, once they are told.
        let mut told: Option<String> = None;
        let mut was_there = false;
        loop {
            match events.poll().await {
                Ok(Happened::Incoming(Packet::ConnAck(_))) => {
                    if self.greet(client).is_err() {
                        // The connection takes nothing: it is closed and opened again.
                        events.clean();
                        continue;
                    }
                    match told.take() {
                        Some(_) => info!(broker = self.address, "the broker is there again"),
                        None => debug!(broker = self.address, "the broker is there"),
                    }
                    was_there = true;
                    // Nothing is waiting for it but at first.
                    let _ = first.send(Ok(()));
                }
                Ok(Happened::Incoming(Packet::Publish(message))) => self.heard(&message),
                Ok(Happened::Incoming(Packet::PubAck(_))) => self.begin(client),
                Ok(Happened::Outgoing(Outgoing::Disconnect)) => return,
                Ok(_) => {}
                Err(error) => {
                    let words = self.broker.trouble(&error);
                    if !was_there {
                        let _ = first.send(Err(words));
                        return;
                    }
                    self.shared.state().is_connected = false;
                    // Its ending does not wait for the broker.
                    self.shared.news.notify_one();
                    if told.as_ref() != Some(&words) {
                        warn!(broker = self.address, "{words}; it is waited for");
                        told = Some(words);
                    }
                    tokio::time::sleep(AGAIN).await;
                }
            }
        }
    }

    /// Begins a connection.
    fn greet(&self, client: &AsyncClient) -> Result<(), ClientError> {
        let own = &self.own;
        client.try_subscribe_many(self.filters().map(|filter| SubscribeFilter {
            path: filter,
            qos: QoS::AtMostOnce,
        }))?;
        if self.obeys {
            client.try_subscribe(format!("{own}/{COMMAND}"), QoS::AtLeastOnce)?;
        }
        let status = format!("{own}/{STATUS}");
        client.try_publish(status, QoS::AtLeastOnce, true, ONLINE)?;
        Ok(())
    }

    /// Tells everything, once the first message of a connection has arrived: by then, all own messages that were
    /// retained have come.
    fn begin(&self, client: &AsyncClient) {
        let mut state = self.shared.state();
        if state.is_connected {
            return;
        }
        for filter in self.filters() {
            // Where there is no room, messages come back for nothing.
            let _ = client.try_unsubscribe(filter);
        }
        state.is_connected = true;
        state.owe_all();
        drop(state);
        self.shared.news.notify_one();
    }

    /// The own messages that are retained, which are looked at when a connection begins.
    fn filters(&self) -> [String; 3] {
        let own = &self.own;
        ["begin", "events/#", "camera/+"].map(|levels| format!("{own}/{levels}"))
    }

    fn heard(&self, message: &Publish) {
        let levels =
            { message.topic.strip_prefix(&self.own) }.and_then(|levels| levels.strip_prefix('/'));
        match (levels, message.retain) {
            (Some(COMMAND), true) => warn!(
                broker = self.address,
                "a command is retained at the broker: it is left alone, for it may be old"
            ),
            (Some(COMMAND), false) => match serde_json::from_slice(&message.payload) {
                Ok(command) => {
                    // Its receiver goes when the program ends.
                    let _ = self.commands.send(command);
                }
                Err(error) => {
                    if let Some(count) = self.strange.count(1) {
                        let broker = &self.address;
                        warn!(broker, count, "what came is no command: {error}");
                    }
                }
            },
            (Some(levels), true) => {
                if let Some(topic) = Topic::parse(levels) {
                    self.shared.state().found(topic);
                }
            }
            _ => {}
        }
    }

    /// Sends what is owed, until the publisher ends.
    async fn send(&self, client: &AsyncClient) {
        loop {
            let (message, is_ending, is_connected, left_out) = {
                let mut state = self.shared.state();
                let left_out = std::mem::take(&mut state.left_out);
                (state.next(), state.is_ending, state.is_connected, left_out)
            };
            if let Some(count) = self.left_out.count(left_out) {
                let broker = &self.address;
                warn!(broker, count, "the broker is slow: events are left out");
            }
            match message {
                Some(message) => self.publish(client, message).await,
                None if is_ending && is_connected => {
                    self.say_good_bye(client).await;
                    return;
                }
                None if is_ending => return,
                None => self.shared.news.notified().await,
            }
        }
    }

    async fn publish(&self, client: &AsyncClient, message: Message) {
        let topic = format!("{}/{}", self.own, message.levels);
        // Some bytes are for the head and the topic.
        if message.text.len() > MESSAGE_MAX - 1024 {
            if let Some(count) = self.too_long.count(1) {
                let bytes = message.text.len();
                warn!(
                    broker = self.address,
                    topic, bytes, count, "too long: it is left out"
                );
            }
            return;
        }
        let quality = match message.is_retained {
            true => QoS::AtLeastOnce,
            false => QoS::AtMostOnce,
        };
        let sent = client.publish(topic, quality, message.is_retained, message.text);
        // It fails only where the connection's loop has ended.
        let _ = sent.await;
    }

    async fn say_good_bye(&self, client: &AsyncClient) {
        let status = format!("{}/{STATUS}", self.own);
        let said = client.publish(status, QoS::AtLeastOnce, true, OFFLINE);
        if said.await.is_ok() && client.disconnect().await.is_ok() {
            // The other half ends when it is sent.
            std::future::pending::<()>().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use site::{Overrides, Scenario};

    use super::*;
    use crate::network::{Onlooker, Options, Simulation};

    fn events() -> Vec<Event> {
        let lab = Scenario::load("lab", &Overrides::default()).unwrap();
        let mut simulation = Simulation::new(lab, Options::default()).unwrap();
        simulation.watch();
        let mut onlooker = Onlooker::default();
        let mut events = Vec::new();
        let record = simulation.run_watched(
            1_000_000_000,
            |_| (),
            |now| events.extend(onlooker.look(now)),
        );
        events.extend(onlooker.end(&simulation, &record, None));
        events
    }

    fn all(state: &mut State) -> Vec<Message> {
        std::iter::from_fn(|| state.next()).collect()
    }

    /// The record that retained messages come to, in any order after the first.
    fn fold(mut messages: Vec<Message>) -> RunRecord {
        messages.retain(|message| message.is_retained && !message.levels.starts_with("camera/"));
        let begun = Begun::from_json(&messages.remove(0).text).unwrap();
        let What::Begin { mut record, .. } = begun.event.what else {
            panic!("{begun:?}")
        };
        messages.reverse();
        for message in messages {
            record.apply(&Event::from_line(&message.text).unwrap());
        }
        *record
    }

    #[test]
    fn what_is_owed_adds_up_to_the_record_whenever_it_is_asked_for() {
        let events = events();
        let mut state = State::new(false);
        state.is_connected = true;
        let (mut said, mut half) = (0, false);
        for (n, event) in events.iter().enumerate() {
            state.take(event.clone());
            if n % 7 == 0 {
                said += all(&mut state).len();
            }
            if n == events.len() / 2 {
                state.owe_all();
                let so_far = results::record::event::fold(&events[..=n]).unwrap();
                let mut told = fold(all(&mut state));
                // Events without lasting state have later times.
                told.sim_seconds = so_far.sim_seconds;
                assert_eq!(told, so_far);
                half = true;
            }
        }
        assert!(half && said > 100);
        all(&mut state);
        assert_eq!(state.next(), None);
        state.owe_all();
        let told = fold(all(&mut state));
        assert_eq!(told, results::record::event::fold(&events).unwrap());
    }

    #[test]
    fn what_is_gone_is_taken_back() {
        let mut state = State::new(false);
        for event in events() {
            state.take(event);
        }
        assert_eq!(state.next(), None, "the broker is away");
        // Of every camera the last state alone.
        let nodes = state.record.as_ref().unwrap().nodes.len();
        assert!(state.owed.len() < 3 * nodes + 10, "{}", state.owed.len());
        state.is_connected = true;
        all(&mut state);
        state.take(Event::new(1e4, What::Gone { node: 3 }));
        // One that another run left behind, and one that is true.
        state.found(Topic::Camera(99));
        state.found(Topic::Camera(2));
        let messages = all(&mut state);
        let empty = |levels: &str| Message {
            levels: levels.to_owned(),
            text: String::new(),
            is_retained: true,
        };
        let expected = ["events/node/3", "events/target/3", "camera/3", "camera/99"];
        assert_eq!(messages, expected.map(empty));
    }

    #[test]
    fn events_without_lasting_state_are_bounded() {
        let mut state = State::new(false);
        let end = Event::new(1.0, What::StopEnds { target: 20 });
        state.take(end.clone());
        assert!(state.passing.is_empty(), "the broker is away");
        state.is_connected = true;
        state.take(events().swap_remove(0));
        all(&mut state);
        for _ in 0..2 * PASSING_MAX {
            state.take(end.clone());
        }
        assert_eq!(state.passing.len(), PASSING_MAX);
        let message = state.next().unwrap();
        assert_eq!(message.levels, "events/stop_ends");
        assert!(!message.is_retained);
    }
}
