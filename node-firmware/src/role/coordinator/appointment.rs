//! Appointment of the reference cameras: those configured, or the first two that saw a target (thesis 2.3).
//!
//! Without both of them no camera gets a pose. So the coordinator asks them now and then, until there is a pose. If an
//! elected one does not answer, or its camera fails, or both find no pose for long, the election begins anew: the next
//! camera that sees a target becomes a reference. No camera replaces a configured one: people are told.

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use super::{CoordinatorRole, MemberNotification};
use crate::{
    console::ToPc,
    facts::FactKey,
    message::{Duty, Health, MemberAddress, MemberKind, References, StopNumber},
};

/// Time between two questions to the references.
const PROBE: Duration = Duration::from_secs(30);

/// Questions (four minutes) after which elected references without a pose give way: they may see too few stops in
/// common. Cameras keep their sightings, so that other ones may have enough by then.
const PATIENCE: u8 = 8;

/// Time from the message to the first reference until the second one is told: four attempts of the link.
pub(super) const FIRST_KNOWS: Duration = Duration::from_millis(300);

/// Messages in a row that did not arrive, each repeated by the network, after which a camera counts as absent.
const UNREACHED: u8 = 2;

/// The first camera that saw a target, at this stop of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Trigger {
    pub(super) camera: MemberAddress,
    pub(super) target: MemberAddress,
    pub(super) stop: StopNumber,
}

/// The references, or the progress of their election.
#[derive(Clone, Debug)]
pub(super) struct Appointment {
    references: Option<References>,
    /// True if the references were restored.
    restored: bool,
    trigger: Option<Trigger>,
    /// Time of the next question whether they are there.
    probe_at: Option<Instant>,
    /// Questions left until they give way.
    patience: u8,
}

impl Appointment {
    pub(super) const fn new() -> Self {
        Self {
            references: None,
            restored: false,
            trigger: None,
            probe_at: None,
            patience: PATIENCE,
        }
    }

    /// Time of the next question whether they are there.
    pub(super) const fn next_probe(&self) -> Option<Instant> {
        self.probe_at
    }

    /// Begins to ask for the references, since no camera has a pose.
    pub(super) fn watch(&mut self, now: Instant) {
        if self.references.is_some() {
            self.probe_at.get_or_insert(now + PROBE);
        }
    }

    pub(super) const fn references(&self) -> Option<References> {
        self.references
    }

    /// Restores the references.
    pub(super) const fn restore(&mut self, references: Option<References>) {
        self.references = references;
        self.restored = references.is_some();
    }

    /// Returns true if a camera has seen a target first.
    pub(super) const fn is_triggered(&self) -> bool {
        self.trigger.is_some()
    }

    /// Returns true if a camera that sends a hello has to be told the references. A reference may have missed or lost
    /// them. After a restart of this node any camera may be a former one that was not told.
    pub(super) fn concerns(&self, camera: MemberAddress, is_news: bool) -> bool {
        self.references.is_some_and(|references| {
            is_news && self.restored || references.duty_of(ShortAddress(camera)).is_some()
        })
    }

    /// Forgets a member. If it was a reference, there are none any more: returns true then.
    fn forget(&mut self, address: MemberAddress) -> bool {
        self.trigger
            .take_if(|trigger| [trigger.camera, trigger.target].contains(&address));
        let is_it = |references: &mut References| {
            let duty = references.duty_of(ShortAddress(address));
            duty.is_some()
        };
        self.references.take_if(is_it).is_some()
    }
}

impl CoordinatorRole {
    /// Forgets a member as a reference, or as the camera that triggered.
    pub(super) fn forget(&mut self, now: Instant, address: MemberAddress) {
        self.members.remove(address, &mut self.unsaved);
        let former = self.appointment.references();
        if self.appointment.forget(address) {
            self.unsaved.insert(FactKey::References);
            self.on_dismissed(now, former);
        }
    }

    /// Dismisses the references.
    fn on_dismissed(&mut self, now: Instant, former: Option<References>) {
        self.appointment.probe_at = None;
        self.tell_elected();
        if let Some(references) = former {
            for camera in [references.first, references.second] {
                self.notify(now, camera, MemberNotification::References);
            }
        }
    }

    /// Returns true if a camera knows its pose: then there is a frame.
    pub(super) fn has_frame(&self) -> bool {
        let mut reports = self.reports();
        reports.any(|(_, report)| report.pose().is_some())
    }

    /// Returns the camera that is configured as this reference, and its position. Of several the one that came last: it
    /// replaces the others.
    fn camera_with(&self, wanted: Duty) -> Option<(MemberAddress, Option<[f32; 2]>)> {
        self.members
            .iter()
            .rev()
            .find_map(|member| match member.more.hello?.kind {
                MemberKind::Camera {
                    reference: Some(reference),
                } if reference.duty == wanted => Some((member.address, reference.position)),
                _ => None,
            })
    }

    pub(super) fn appoint_configured(&mut self, now: Instant) {
        if let (Some((first, at)), Some((second, to))) = (
            self.camera_with(Duty::First),
            self.camera_with(Duty::Second),
        ) {
            let references = References {
                first,
                second,
                positions: at.zip(to).map(|(at, to)| [at, to]),
            };
            self.appoint(now, references);
        }
    }

    fn appoint(&mut self, now: Instant, references: References) {
        if self.appointment.references == Some(references) {
            return;
        }
        let former = self.appointment.references.replace(references);
        self.appointment.patience = PATIENCE;
        self.appointment.watch(now);
        self.unsaved.insert(FactKey::References);
        self.tell_elected();
        // Former references too.
        for references in former.into_iter().chain([references]) {
            self.notify(now, references.first, MemberNotification::References);
            // It sends its sightings to the first one at once, which is to know its duty by then.
            let due = now + FIRST_KNOWS;
            self.notify(due, references.second, MemberNotification::References);
        }
    }

    /// Tells the PC which cameras were elected. Configured ones tell it in their hello.
    pub(super) fn tell_elected(&mut self) {
        if !self.is_configured() {
            let references = self.appointment.references();
            self.tasks.tell(ToPc::References(references));
        }
    }

    /// Returns true if the references are configured, or one of them.
    fn is_configured(&self) -> bool {
        let mut duties = [Duty::First, Duty::Second].iter();
        duties.any(|&duty| self.camera_with(duty).is_some())
    }

    /// Asks the references when it is time, as long as no camera has a pose and a target waits for them.
    pub(super) fn probe(&mut self, now: Instant) {
        if self.appointment.probe_at.take_if(|at| *at <= now).is_none() {
            return;
        }
        if self.appointment.references.is_none() || self.has_frame() {
            return;
        }
        self.appointment.probe_at = Some(now + PROBE);
        if !self.members.iter().any(|member| member.more.is_target()) {
            return;
        }
        // Configured ones do not give way: the count begins anew.
        self.appointment.patience = self.appointment.patience.wrapping_sub(1);
        if self.appointment.patience == 0 {
            self.dismiss(now);
        }
        if let Some(references) = self.appointment.references {
            for camera in [references.first, references.second] {
                self.notify(now, camera, MemberNotification::References);
            }
        }
    }

    /// Notes that a camera was reached, or was not.
    pub(super) fn on_reached(&mut self, now: Instant, camera: MemberAddress, is_there: bool) {
        let Some(known) = self.members.get(camera) else {
            return;
        };
        let was_there = known.unreached < UNREACHED;
        known.unreached = match is_there {
            true => 0,
            false => known.unreached.saturating_add(1),
        };
        let present = known.unreached < UNREACHED;
        if was_there != present {
            self.tasks.tell(ToPc::Reference {
                address: camera,
                present,
            });
        }
        if !present && self.is_reference(camera) {
            self.dismiss(now);
        }
    }

    fn is_reference(&self, camera: MemberAddress) -> bool {
        let references = self.appointment.references;
        references.is_some_and(|references| references.duty_of(ShortAddress(camera)).is_some())
    }

    /// Takes the health of a member.
    pub(super) fn on_health(&mut self, now: Instant, address: MemberAddress, health: Health) {
        let Some(member) = self.members.of(address) else {
            return;
        };
        member.more.health = health;
        self.tasks.tell(ToPc::Health { address, health });
        if !health.camera.works() && self.is_reference(address) {
            self.dismiss(now);
        }
    }

    /// Begins a new election because a reference fails, unless the references are configured, or have found a pose.
    fn dismiss(&mut self, now: Instant) {
        if self.is_configured() || self.has_frame() {
            return;
        }
        let former = self.appointment.references.take();
        self.appointment.trigger = None;
        self.unsaved.insert(FactKey::References);
        self.on_dismissed(now, former);
    }

    /// Notes that a camera saw a target. The first one triggers; the next one that sees the target at the same stop
    /// becomes its helper (thesis 2.3). If cameras know their poses already, as from a former network, the target finds
    /// its place from them: a second frame must not begin.
    pub(super) fn on_trigger(&mut self, now: Instant, trigger: Trigger) {
        if self.appointment.references.is_some() || self.is_configured() || self.has_frame() {
            return;
        }
        let Trigger {
            camera,
            target,
            stop,
        } = trigger;
        match self.appointment.trigger {
            Some(first) if (first.target, first.stop) == (target, stop) => {
                if first.camera != camera {
                    let references = References {
                        first: first.camera,
                        second: camera,
                        positions: None,
                    };
                    self.appoint(now, references);
                }
            }
            _ => self.appointment.trigger = Some(trigger),
        }
    }
}
