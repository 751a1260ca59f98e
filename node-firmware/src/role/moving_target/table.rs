//! Knowledge of a target about the cameras (Appendix B: camera id, x, y, angle), and their answers.

use zigbee_link::Instant;

use super::{ANSWER_WITHIN, READY_AFTER};
use crate::{
    facts::Fact,
    message::{Duty, MemberAddress, Report, Sight, StopAnswer},
    role::{Reports, Unsaved},
};

/// A camera that could not be reached is tried again at every so many-th stop only.
const AWAY_RETRY: u8 = 4;

/// A camera that does not answer is asked so often at one stop.
const TRIES: u8 = 3;

/// A camera in the table of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CameraEntry {
    /// Its address in the network.
    pub address: MemberAddress,
    /// The report that it told of itself last.
    pub report: Option<Report>,
    /// Sightings it counted.
    pub counted: u8,
    /// It needs no more stops.
    pub done: bool,
}

/// Knowledge about a camera besides its report.
#[derive(Clone, Debug, Default)]
struct Answers {
    counted: u8,
    done: bool,
    /// The target was not in its view when it answered last. As long as that is so it answers only when it is
    /// asked.
    not_in_view: bool,
    question: Question,
    /// Number of questions to it at this stop.
    tries: u8,
    /// Stops since it was reached last.
    away: u8,
}

/// State of the question to a camera at the present stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Question {
    /// It has not answered.
    #[default]
    Open,
    /// It is being asked.
    Asked,
    /// It was asked and is expected to answer until then.
    Delivered(Instant),
    /// It was not ready, or not reached, and is asked again then.
    Again(Instant),
    /// It answered, or it cannot be reached.
    Settled,
}

impl Answers {
    const fn know(&mut self, report: &Report) {
        self.counted = report.sightings;
        self.done = report.done;
    }
}

#[derive(Clone, Debug)]
pub(super) struct Table {
    cameras: Reports<Answers>,
}

impl Table {
    pub(super) const fn new() -> Self {
        Self {
            cameras: Reports::new(),
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = CameraEntry> {
        self.cameras.iter().map(|camera| CameraEntry {
            address: camera.address,
            report: camera.report,
            counted: camera.more.counted,
            done: camera.more.done,
        })
    }

    /// There is a camera with this address.
    pub(super) fn meet(&mut self, address: MemberAddress) {
        // Where there is no room, it is one camera less to ask.
        self.cameras.of(address);
    }

    /// Takes the record of this slot.
    pub(super) fn restore(&mut self, slot: u8, address: MemberAddress, report: Report) {
        if let Some(camera) = self.cameras.restore(slot, address, report) {
            camera.know(&report);
        }
    }

    /// A camera told its status.
    pub(super) fn report(&mut self, address: MemberAddress, report: Report, unsaved: &mut Unsaved) {
        if let Some(camera) = self.cameras.report(address, report, unsaved) {
            camera.away = 0;
            camera.know(&report);
        }
    }

    /// No camera is known any more.
    pub(super) fn clear(&mut self, unsaved: &mut Unsaved) {
        self.cameras.clear(unsaved);
    }

    /// Returns true if this camera may be the first reference: one that has told a pose says so with it. It
    /// tells its solutions before that report, so the last report may be from before; or only the roster, or
    /// an answer to a stop, says that it is there.
    pub(super) fn may_be_first(&self, address: MemberAddress) -> bool {
        let mut cameras = self.cameras.iter();
        let camera = cameras.find(|camera| camera.address == address);
        camera.is_some_and(|camera| {
            let pose_of = camera.report.filter(|report| report.pose().is_some());
            pose_of.is_none_or(|report| report.duty == Some(Duty::First))
        })
    }

    /// The report to write down in this slot.
    pub(super) fn fact(&self, slot: u8) -> Fact {
        self.cameras.fact(slot)
    }

    /// A camera answered the present stop.
    pub(super) fn on_answer(&mut self, now: Instant, address: MemberAddress, look: &StopAnswer) {
        if let Some(camera) = self.cameras.of(address) {
            let camera = &mut camera.more;
            camera.question = match look.sight {
                Sight::NotReady => Question::Again(now + READY_AFTER),
                _ => Question::Settled,
            };
            camera.counted = look.counted;
            camera.done = look.done;
            camera.not_in_view = look.sight == Sight::NotInView;
            camera.away = 0;
        }
    }

    /// A new stop is told. Where the target does not know its place (`lost`), cameras that are done can help,
    /// too. The target does not wait for those that did not see it at the stop before.
    pub(super) fn new_stop(&mut self, lost: bool) {
        for camera in self.answers() {
            camera.tries = 0;
            camera.question = if camera.not_in_view || camera.done && !lost {
                Question::Settled
            } else {
                Question::Open
            };
            if camera.away > 0 {
                camera.away = camera.away.wrapping_add(1);
                if camera.away % AWAY_RETRY != 0 {
                    camera.question = Question::Settled;
                }
            }
        }
    }

    /// Cameras that did not answer although they were asked are asked again, a few times; those
    /// that were not ready are, too.
    pub(super) fn give_up(&mut self, now: Instant) {
        for camera in self.answers() {
            match camera.question {
                Question::Delivered(until) if until <= now => {
                    camera.question = if camera.tries < TRIES && camera.away == 0 {
                        Question::Open
                    } else {
                        Question::Settled
                    };
                }
                Question::Again(at) if at <= now => camera.question = Question::Open,
                _ => {}
            }
        }
    }

    /// No camera is asked any more at this stop.
    pub(super) fn close(&mut self) {
        for camera in self.answers() {
            if matches!(camera.question, Question::Open | Question::Again(_)) {
                camera.question = Question::Settled;
            }
        }
    }

    /// The camera to ask next, if fewer than `at_a_time` are being asked.
    pub(super) fn ask(&mut self, at_a_time: usize) -> Option<MemberAddress> {
        if self.asked_now() >= at_a_time {
            return None;
        }
        let mut cameras = self.cameras.iter_mut();
        let camera = cameras.find(|camera| camera.more.question == Question::Open)?;
        camera.more.question = Question::Asked;
        Some(camera.address)
    }

    /// The question was delivered, or not.
    pub(super) fn on_asked(&mut self, now: Instant, address: MemberAddress, delivered: bool) {
        if let Some(camera) = self.cameras.get(address)
            && camera.question == Question::Asked
        {
            // It may have come through even if nothing came back: then the camera looks now.
            camera.question = Question::Delivered(now + ANSWER_WITHIN);
            camera.tries = camera.tries.saturating_add(1);
            if delivered {
                camera.away = 0;
            } else if camera.tries >= TRIES {
                camera.away = camera.away.max(1);
            }
        }
    }

    /// The target waits for no camera.
    pub(super) fn is_settled(&self) -> bool {
        self.cameras
            .iter()
            .all(|camera| camera.more.question == Question::Settled)
    }

    /// When the patience with the next camera ends.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.cameras
            .iter()
            .filter_map(|camera| match camera.more.question {
                Question::Delivered(at) | Question::Again(at) => Some(at),
                _ => None,
            })
            .min()
    }

    /// Returns true if a camera can be asked now.
    pub(super) fn can_ask(&self, at_a_time: usize) -> bool {
        self.asked_now() < at_a_time
            && self
                .cameras
                .iter()
                .any(|camera| camera.more.question == Question::Open)
    }

    /// Number of cameras that are being asked.
    fn asked_now(&self) -> usize {
        let asked = self.cameras.iter();
        asked
            .filter(|camera| camera.more.question == Question::Asked)
            .count()
    }

    fn answers(&mut self) -> impl Iterator<Item = &mut Answers> {
        self.cameras.iter_mut().map(|camera| &mut camera.more)
    }
}
