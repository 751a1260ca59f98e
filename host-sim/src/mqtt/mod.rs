//! A site over an MQTT broker: publishers on several computers, and readers that see them as one.
//!
//! | module | job |
//! |---|---|
//! | `broker` | Where the broker is, and why it cannot be had |
//! | `topic` | The topics below that of a publisher |
//! | `publisher` | Tells a stream of events |
//! | `reader` | Hears all publishers of a site |
//!
//! `docs/mqtt.md` describes topics and messages. What is retained are the parts of the publisher's record, so there is
//! no other state than that of the stream of events.

use std::time::Duration;

mod broker;
mod publisher;
mod reader;
mod topic;

pub use broker::{Broker, BrokerError};
pub use publisher::{Publisher, check_name};
pub use reader::{Heard, Reader};
pub use topic::{BEGIN, Begun, COMMAND, EVENTS, OFFLINE, ONLINE, STATUS, Topic};

/// Time after which a broker that is away is looked for again.
const AGAIN: Duration = Duration::from_secs(2);

/// Time between two signs of life. A broker takes a client for lost after one and a half of it.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// Bytes of the longest message. Those of MQTT may be sixteen times as long.
const MESSAGE_MAX: usize = 16 << 20;
