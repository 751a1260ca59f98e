//! The radio on the chip, as [`zigbee_link::radio::Radio`].
//!
//! A task, [`drive`], owns it and receives whenever it does not send; [`OnChip`] asks the task. So a dropped
//! future of [`OnChip`] loses no frame, and frames that arrive while no task receives are queued. The hardware
//! computes the FCS and makes one clear-channel assessment; backing off is left to `zigbee_link`'s wrapper, and
//! the addresses of a frame to the link. There are no immediate acknowledgements.
//! The radio takes one frame without the processor: a frame that comes after it, before the task runs again, is
//! lost as on the air.
//!
//! While it samples, radio and crystal are off in between.

use board_support::{last_words::LastWords, retained::say_and_restart};
use embassy_futures::select::{Either, Either3, select, select3};
use embassy_nrf::{
    pac::{
        self,
        radio::vals::{Ccamode, Crcstatus, State as RadioState},
    },
    radio::ieee802154::{self, Packet},
};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel as Queue, signal::Signal};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use node_firmware::message::Restart;
use zigbee_link::radio::{
    Channel, FRAME_MAX, FRAME_MIN, PSDU_MAX, Radio, RadioConfig, Received, SAMPLE, SAMPLE_PERIOD,
    TxOutcome,
};

/// Received frames that wait.
const QUEUE: usize = 4;

/// Transmit powers of the chip, dBm, ascending (Product Specification, "RADIO", TXPOWER).
const POWERS: [i8; 14] = [-40, -20, -16, -12, -8, -4, 0, 2, 3, 4, 5, 6, 7, 8];

/// The chip's measure of a signal, 0 to 63 in use, to the standard's 0 to 255 (Product
/// Specification, "RADIO", `ED_RSSISCALE`).
const LQI_SCALE: u8 = 4;

/// Longer than any frame takes from its length on: 127 bytes of 32 us, and a symbol or two.
const FRAME_TIME: Duration = Duration::from_millis(5);

/// Far longer than an assessment and a frame take, also while an erasure of the flash stops the
/// processor.
const TRANSMISSION_TIME: Duration = Duration::from_millis(500);

/// Times of a radio that samples.
const LISTENING: Duration = Duration::from_micros(SAMPLE.as_micros() as u64);
const RESTING: Duration =
    Duration::from_micros((SAMPLE_PERIOD.as_micros() - SAMPLE.as_micros()) as u64);

/// From this power on the channel is busy, whatever is on it: -75 dBm, the most that the standard
/// allows (IEEE 802.15.4, "CCA"), in steps of 1 dB from -92 dBm (Product Specification, "RADIO").
const BUSY_ENERGY: u8 = 17;

/// A carrier is seen where the correlator exceeds this value more often than that: the threshold is that after a
/// reset, and radio stacks of this chip take twice.
const BUSY_CORRELATION: (u8, u8) = (45, 2);

/// Requests and answers between [`OnChip`] and [`drive`].
pub(crate) struct Shared {
    requests: Queue<NoopRawMutex, Request, 1>,
    /// The number of the request, and its result.
    answer: Signal<NoopRawMutex, (u32, Result<TxOutcome, Error>)>,
    received: Queue<NoopRawMutex, Heard, QUEUE>,
}

impl Shared {
    pub(crate) const fn new() -> Self {
        Self {
            requests: Queue::new(),
            answer: Signal::new(),
            received: Queue::new(),
        }
    }
}

struct Request {
    number: u32,
    kind: Kind,
}

enum Kind {
    Configure {
        channel: Channel,
        power: i8,
        sampled: bool,
    },
    Transmit(Frame),
}

struct Frame {
    bytes: [u8; FRAME_MAX],
    len: usize,
}

/// A received frame.
struct Heard {
    frame: Frame,
    channel: Channel,
    lqi: u8,
}

/// Reason why the radio does not work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// There is no configuration: the first one is missing, or the last one was dropped.
    NotConfigured,
    /// The frame is too short or too long.
    FrameLength,
}

/// The radio, without its task.
pub struct OnChip {
    shared: &'static Shared,
    config: Option<RadioConfig>,
    number: u32,
}

impl OnChip {
    /// `drive` must run with the same.
    pub(crate) const fn new(shared: &'static Shared) -> Self {
        Self {
            shared,
            config: None,
            number: 0,
        }
    }

    async fn ask(&mut self, kind: Kind) -> Result<TxOutcome, Error> {
        self.number = self.number.wrapping_add(1);
        let number = self.number;
        self.shared.requests.send(Request { number, kind }).await;
        loop {
            // Answers to dropped calls come first.
            let (answered, outcome) = self.shared.answer.wait().await;
            if answered == number {
                return outcome;
            }
        }
    }
}

impl Radio for OnChip {
    type Error = Error;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), Error> {
        self.config = None;
        let kind = Kind::Configure {
            channel: config.channel,
            power: nearest_power(config.tx_power),
            sampled: config.sampled,
        };
        let _ = self.ask(kind).await?;
        self.config = Some(*config);
        Ok(())
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, Error> {
        if self.config.is_none() {
            return Err(Error::NotConfigured);
        }
        let frame = Frame::new(frame).ok_or(Error::FrameLength)?;
        self.ask(Kind::Transmit(frame)).await
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Error> {
        let config = self.config.ok_or(Error::NotConfigured)?;
        // The queue outlives a change of the channel: frames heard before are of another network.
        let Heard {
            frame,
            channel,
            lqi,
        } = loop {
            let heard = self.shared.received.receive().await;
            if heard.channel == config.channel {
                break heard;
            }
        };
        for (to, from) in buffer.iter_mut().zip(frame.bytes) {
            *to = from;
        }
        Ok(Received {
            len: frame.len,
            channel,
            rssi: None,
            lqi: Some(lqi),
        })
    }
}

impl Frame {
    /// `None` for a length that no frame has.
    fn new(bytes: &[u8]) -> Option<Self> {
        let mut frame = Self {
            bytes: [0; FRAME_MAX],
            len: bytes.len(),
        };
        let is_possible = bytes.len() >= FRAME_MIN;
        let place = frame.bytes.get_mut(..bytes.len()).filter(|_| is_possible)?;
        // Both are as long; `copy_from_slice` would keep its branch to a panic.
        for (to, from) in place.iter_mut().zip(bytes) {
            *to = *from;
        }
        Some(frame)
    }
}

fn nearest_power(dbm: i8) -> i8 {
    let distance = |power: &i8| power.abs_diff(dbm);
    POWERS.into_iter().min_by_key(distance).unwrap_or(0)
}

/// The channel is busy with energy, or with a frame, also in the middle of one. The driver's own
/// setting leaves both thresholds zero, which switches the correlator off.
fn sense_carriers() {
    let (threshold, count) = BUSY_CORRELATION;
    pac::RADIO.ccactrl().write(|w| {
        w.set_ccamode(Ccamode::CarrierOrEdMode);
        w.set_ccaedthres(BUSY_ENERGY);
        w.set_ccacorrthres(threshold);
        w.set_ccacorrcnt(count);
    });
}

/// Does what [`OnChip`] asks, and receives in between. Never ends.
pub(crate) async fn drive(radio: ieee802154::Radio<'static>, shared: &'static Shared) {
    sense_carriers();
    let mut driver = Driver {
        radio,
        packet: Packet::new(),
        channel: Channel::FIRST,
        sampled: false,
        shared,
    };
    // Nothing is received before the first configuration.
    let mut request = shared.requests.receive().await;
    loop {
        driver.obey(request).await;
        request = driver.receive_until_asked().await;
    }
}

/// End of a reception.
enum End {
    Received,
    Asked(Request),
    /// A radio that samples has listened for long enough.
    Late,
}

struct Driver {
    radio: ieee802154::Radio<'static>,
    packet: Packet,
    channel: Channel,
    sampled: bool,
    shared: &'static Shared,
}

impl Driver {
    async fn obey(&mut self, request: Request) {
        let outcome = match request.kind {
            Kind::Configure {
                channel,
                power,
                sampled,
            } => {
                self.sampled = sampled;
                self.channel = channel;
                self.radio.set_channel(channel.number());
                self.radio.set_transmission_power(power);
                Ok(TxOutcome::Sent)
            }
            Kind::Transmit(frame) => {
                let bytes = frame.bytes.get(..frame.len).unwrap_or_default();
                self.packet.copy_from_slice(bytes);
                let sent = self.radio.try_send(&mut self.packet);
                match with_timeout(TRANSMISSION_TIME, sent).await {
                    Ok(Ok(())) => Ok(TxOutcome::Sent),
                    Ok(Err(_)) => Ok(TxOutcome::ChannelBusy),
                    // The hardware does not do what its manual says. A reset sets it right.
                    Err(_) => say_and_restart(LastWords::restart(Restart::RadioStuck)),
                }
            }
        };
        self.shared.answer.signal((request.number, outcome));
    }

    async fn receive_until_asked(&mut self) -> Request {
        loop {
            let mut until = Instant::MAX;
            if self.sampled {
                if let Some(request) = self.rest().await {
                    return request;
                }
                until = Instant::now() + LISTENING;
            }
            loop {
                match self.receive_one(until).await {
                    End::Received => self.deliver(),
                    End::Asked(request) => {
                        // Complete in the moment in which the reception was given up.
                        if has_received() {
                            self.deliver();
                        }
                        return request;
                    }
                    End::Late => break,
                }
            }
        }
    }

    /// Rests until it has to listen, with radio and crystal off, or until a request comes.
    async fn rest(&mut self) -> Option<Request> {
        pac::RADIO.tasks_disable().write_value(1);
        // Some microseconds, in which it needs the crystal.
        while pac::RADIO.state().read().state() != RadioState::Disabled {}
        pac::CLOCK.tasks_hfclkstop().write_value(1);
        let rested = select(Timer::after(RESTING), self.shared.requests.receive()).await;
        // It takes 0.36 ms (Product Specification, "HFXO").
        pac::CLOCK.events_hfclkstarted().write_value(0);
        pac::CLOCK.tasks_hfclkstart().write_value(1);
        while pac::CLOCK.events_hfclkstarted().read() == 0 {}
        match rested {
            Either::First(()) => None,
            Either::Second(request) => Some(request),
        }
    }

    /// Receives until a packet has come, a request comes, or it is late.
    async fn receive_one(&mut self, mut until: Instant) -> End {
        let Self {
            radio,
            packet,
            shared,
            ..
        } = self;
        loop {
            pac::RADIO.events_framestart().write_value(0);
            let mut frame_over = None;
            // Not longer than a frame takes: a false start must not end all sending.
            let mut is_arriving = || {
                let now = Instant::now();
                is_receiving() && now < *frame_over.get_or_insert(now + FRAME_TIME)
            };
            let mut reception = core::pin::pin!(radio.receive(packet));
            loop {
                let late = Timer::at(until);
                match select3(reception.as_mut(), shared.requests.receive(), late).await {
                    Either3::First(Ok(())) => return End::Received,
                    // A wrong FCS: as if nothing had come.
                    Either3::First(Err(_)) => break,
                    // A frame that arrives would be lost, and to the assessment the channel is busy.
                    Either3::Second(Request {
                        number,
                        kind: Kind::Transmit(_),
                    }) if is_arriving() => {
                        let busy = Ok(TxOutcome::ChannelBusy);
                        shared.answer.signal((number, busy));
                    }
                    Either3::Second(request) => return End::Asked(request),
                    Either3::Third(()) if is_arriving() => {
                        until = Instant::now() + FRAME_TIME;
                    }
                    Either3::Third(()) => return End::Late,
                }
            }
        }
    }

    /// When the queue is full the frame is lost.
    fn deliver(&self) {
        // A packet of a length that no frame has must not be looked into.
        let is_possible = usize::from(self.packet.len()) <= FRAME_MAX;
        if is_possible && let Some(frame) = Frame::new(&self.packet) {
            let _ = self.shared.received.try_send(Heard {
                frame,
                channel: self.channel,
                lqi: self.packet.lqi().saturating_mul(LQI_SCALE),
            });
        }
    }
}

/// A frame has begun to arrive and is not over.
fn is_receiving() -> bool {
    pac::RADIO.events_framestart().read() != 0 && pac::RADIO.events_phyend().read() == 0
}

/// A frame is over that has not been looked at, and its FCS is right.
fn has_received() -> bool {
    pac::RADIO.events_phyend().read() != 0
        && pac::RADIO.crcstatus().read().crcstatus() == Crcstatus::CrcOk
}
