//! Hears all publishers of a site.
//!
//! Brokers drop messages for a reader that has too many waiting: mosquitto more than 1,000. So the retained ones are
//! asked for by one publisher after the other.

use std::{
    collections::VecDeque,
    sync::mpsc::{self, Receiver, SyncSender},
    thread,
};

use rumqttc::{
    AsyncClient, Event as Happened, EventLoop, Packet, QoS, SubAck, SubscribeReasonCode,
};
use tracing::{debug, info, warn};

use super::{AGAIN, BEGIN, Broker, BrokerError, COMMAND, EVENTS, STATUS, broker};
use crate::{live::Command, logging::Throttle};

/// Number of messages that wait to be taken; then the broker has to wait.
const WAITING: usize = 1_000;

/// Something that the broker told, or of it.
#[derive(Debug)]
pub enum Heard {
    /// A connection begins: everything that is retained comes, once more too.
    Begins,
    /// All that was retained has come.
    Loaded,
    /// Words on the connection.
    Said(String),
    /// A message of a publisher.
    Message {
        /// Name of the publisher.
        publisher: String,
        /// Levels of the topic below the publisher's.
        levels: String,
        /// Text; an empty one takes the former back.
        text: String,
    },
}

/// A reader that runs.
pub struct Reader {
    client: AsyncClient,
    topic: String,
    heard: Receiver<Heard>,
}

impl Reader {
    /// Hears from now on, on a thread of its own, as long as the program runs.
    ///
    /// # Errors
    /// [`BrokerError`]
    pub fn start(broker: Broker) -> Result<Self, BrokerError> {
        let mut number = [0; 4];
        getrandom::fill(&mut number).map_err(|_| BrokerError::Random)?;
        let number = u32::from_ne_bytes(number);
        let topic = broker.topic().to_owned();
        let options = broker.options(format!("host-sim live {number:08x}"))?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let (client, mut events) = AsyncClient::new(options, 100);
        events.set_network_options(broker::network());
        let (sender, heard) = mpsc::sync_channel(WAITING);
        let (first, begun) = mpsc::channel();
        let talk = Talk {
            client: client.clone(),
            broker,
            sender,
            wanted: VecDeque::new(),
            is_asking: false,
            is_marked: true,
            damaged: Throttle::default(),
        };
        thread::spawn(move || runtime.block_on(talk.go_on(events, &first)));
        match begun.recv() {
            Ok(Err(words)) => Err(BrokerError::Away(words)),
            Ok(Ok(())) | Err(_) => Ok(Self {
                client,
                topic,
                heard,
            }),
        }
    }

    /// Topic of the site.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// All that was heard since the last call.
    pub fn heard(&self) -> impl Iterator<Item = Heard> {
        self.heard.try_iter()
    }

    /// Sends a command to a publisher. Returns false if the connection takes no more.
    pub fn command(&self, publisher: &str, command: &Command) -> bool {
        let topic = format!("{}/{publisher}/{COMMAND}", self.topic);
        let text = serde_json::to_string(command);
        text.is_ok_and(|text| {
            let sent = { &self.client }.try_publish(topic, QoS::AtLeastOnce, false, text);
            sent.is_ok()
        })
    }
}

/// The talk with the broker.
struct Talk {
    client: AsyncClient,
    broker: Broker,
    sender: SyncSender<Heard>,
    /// Subscriptions that are not asked for yet.
    wanted: VecDeque<String>,
    /// One is on its way.
    is_asking: bool,
    /// The last one is on its way, or all has come. It is asked for once more for its answer, which comes after
    /// everything that was retained.
    is_marked: bool,
    damaged: Throttle,
}

/// The receiver has gone, and with it the program.
struct Over;

impl Talk {
    async fn go_on(mut self, mut events: EventLoop, first: &mpsc::Sender<Result<(), String>>) {
        let mut told: Option<String> = None;
        let mut was_there = false;
        loop {
            let done = match events.poll().await {
                Ok(Happened::Incoming(Packet::ConnAck(_))) => {
                    was_there = true;
                    // Nothing is waiting for it but at first.
                    let _ = first.send(Ok(()));
                    let again = told.take().map_or(Ok(()), |_| {
                        let words = "the broker is there again";
                        info!(broker = self.broker.address(), "{words}");
                        self.say(words)
                    });
                    again.and_then(|()| self.begin())
                }
                Ok(Happened::Incoming(Packet::Publish(message))) => {
                    self.take(&message.topic, &message.payload)
                }
                Ok(Happened::Incoming(Packet::SubAck(answer))) => self.answered(&answer),
                Ok(_) => Ok(()),
                Err(error) => {
                    let words = self.broker.trouble(&error);
                    if !was_there {
                        let _ = first.send(Err(words));
                        return;
                    }
                    let said = match told.as_ref() == Some(&words) {
                        true => Ok(()),
                        false => self.warn(&format!("{words}; it is waited for")),
                    };
                    told = Some(words);
                    tokio::time::sleep(AGAIN).await;
                    said
                }
            };
            if done.is_err() {
                return;
            }
        }
    }

    fn tell(&self, heard: Heard) -> Result<(), Over> {
        self.sender.send(heard).map_err(|_| Over)
    }

    fn say(&self, words: &str) -> Result<(), Over> {
        self.tell(Heard::Said(words.to_owned()))
    }

    fn warn(&self, words: &str) -> Result<(), Over> {
        warn!(broker = self.broker.address(), "{words}");
        self.say(words)
    }

    fn begin(&mut self) -> Result<(), Over> {
        let topic = self.broker.topic();
        // By the answer to the second, all publishers are known.
        self.wanted = [BEGIN, STATUS]
            .map(|level| format!("{topic}/+/{level}"))
            .into();
        self.is_asking = false;
        self.is_marked = false;
        self.ask();
        self.tell(Heard::Begins)
    }

    /// Asks for the next subscription, if none is on its way.
    fn ask(&mut self) {
        if self.is_asking {
            return;
        }
        let next = self.wanted.pop_front().or_else(|| {
            let mark = format!("{}/+/{STATUS}", self.broker.topic());
            (!std::mem::replace(&mut self.is_marked, true)).then_some(mark)
        });
        if let Some(filter) = next {
            // There is room: one is asked for at a time, and people give few commands.
            self.is_asking = self.client.try_subscribe(filter, QoS::AtMostOnce).is_ok();
        }
    }

    fn answered(&mut self, answer: &SubAck) -> Result<(), Over> {
        if answer.return_codes.contains(&SubscribeReasonCode::Failure) {
            self.warn("the broker does not let this user read all topics of the site")?;
        }
        self.is_asking = false;
        if self.is_marked && self.wanted.is_empty() {
            return self.tell(Heard::Loaded);
        }
        self.ask();
        Ok(())
    }

    fn take(&mut self, topic: &str, payload: &[u8]) -> Result<(), Over> {
        let below =
            { topic.strip_prefix(self.broker.topic()) }.and_then(|topic| topic.strip_prefix('/'));
        let Some((publisher, levels)) = below.and_then(|below| below.split_once('/')) else {
            return Ok(());
        };
        let Ok(text) = String::from_utf8(payload.to_vec()) else {
            if let Some(count) = self.damaged.count(1) {
                debug!(topic, count, "no text in UTF-8");
            }
            return self.say(&format!("{topic}: it is no text in UTF-8"));
        };
        if levels == BEGIN && !text.is_empty() {
            // All its parts come again: what was before is void.
            let events = format!("{}/{publisher}/{EVENTS}/#", self.broker.topic());
            if !self.wanted.contains(&events) {
                self.wanted.push_back(events);
            }
            self.is_marked = false;
            self.ask();
        }
        self.tell(Heard::Message {
            publisher: publisher.to_owned(),
            levels: levels.to_owned(),
            text,
        })
    }
}
