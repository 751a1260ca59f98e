//! Appointment of the reference cameras: those configured, or the first two that saw a target (thesis 2.3).
//!
//! Without both of them no camera gets a pose. So until there is one the coordinator asks now and then
//! whether they are there. If one of them does not answer, or its camera does not serve, or both find no pose for
//! long, the elected ones are none any more, and the next camera that sees a target becomes one. No camera takes the
//! place of a configured one: people are told.

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use super::{CoordinatorRole, MemberNotification};
use crate::{
    console::ToPc,
    facts::FactKey,
    message::{Duty, Health, MemberAddress, MemberKind, References, StopNumber},
};

/// Time between two questions whether a reference camera is there.
const PROBE: Duration = Duration::from_secs(30);

/// After so many questions, four minutes, elected references that found no pose give way: they may share too few of
/// the places where the target stands. Cameras keep what they saw, so that others may have seen enough by then.
const PATIENCE: u8 = 8;

/// After a camera is told that it is the first reference, before another one is told that it is the
/// second: four attempts of the link.
pub(super) const FIRST_KNOWS: Duration = Duration::from_millis(300);

/// After so many messages in a row that did not reach it, it is not there. Each was repeated by the network.
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
    /// References were appointed in a former run.
    restored: bool,
    trigger: Option<Trigger>,
    /// Time of the next question whether they are there.
    probe_at: Option<Instant>,
    /// Questions until they give way.
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

    /// No camera has a pose: the references, if there are any, have to be there.
    pub(super) fn watch(&mut self, now: Instant) {
        if self.references.is_some() {
            self.probe_at.get_or_insert(now + PROBE);
        }
    }

    pub(super) const fn references(&self) -> Option<References> {
        self.references
    }

    /// Takes the references of a former run.
    pub(super) const fn restore(&mut self, references: Option<References>) {
        self.references = references;
        self.restored = references.is_some();
    }

    /// Returns true if a camera triggered.
    pub(super) const fn is_triggered(&self) -> bool {
        self.trigger.is_some()
    }

    /// Returns true if a camera that presents itself has to be told the references. A reference may have
    /// missed them, or forgotten. After a restart of this node it is not known which camera was one before,
    /// and was not told.
    pub(super) fn concerns(&self, camera: MemberAddress, is_news: bool) -> bool {
        self.references.is_some_and(|references| {
            is_news && self.restored || references.duty_of(ShortAddress(camera)).is_some()
        })
    }

    /// This member is not known any more. If it was a reference camera, there are none. Returns true if that
    /// is so.
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
    /// Knows nothing of a member any more.
    pub(super) fn forget(&mut self, now: Instant, address: MemberAddress) {
        self.members.remove(address, &mut self.unsaved);
        let former = self.appointment.references();
        if self.appointment.forget(address) {
            self.unsaved.insert(FactKey::References);
            self.on_dismissed(now, former);
        }
    }

    /// These cameras are references no more, and there are none.
    fn on_dismissed(&mut self, now: Instant, former: Option<References>) {
        self.appointment.probe_at = None;
        self.tell_elected();
        if let Some(references) = former {
            for camera in [references.first, references.second] {
                self.notify(now, camera, MemberNotification::References);
            }
        }
    }

    /// Returns true if a camera knows its pose, so that there is a frame of the site.
    pub(super) fn has_frame(&self) -> bool {
        let mut reports = self.reports();
        reports.any(|(_, report)| report.pose().is_some())
    }

    /// The camera that is configured as this reference, and its position. Of several, the one that was met
    /// last: it is there in place of the others.
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
        // Former ones too.
        for references in former.into_iter().chain([references]) {
            self.notify(now, references.first, MemberNotification::References);
            // It tells the first one its sightings at once, which knows by then how to use them.
            let due = now + FIRST_KNOWS;
            self.notify(due, references.second, MemberNotification::References);
        }
    }

    /// Tells the PC which cameras were elected. Configured ones say it themselves in their hello.
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

    /// Asks, when it is time, whether the references are there: as long as no camera has a pose, and there is
    /// a target that waits for them.
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
        // Configured ones do not give way: for them it begins anew.
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

    /// A camera was told the references, or said something itself; or it was not reached.
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

    /// A member tells its health.
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

    /// One of the references does not serve: others may take their places, unless they are configured, or
    /// have done their duty.
    fn dismiss(&mut self, now: Instant) {
        if self.is_configured() || self.has_frame() {
            return;
        }
        let former = self.appointment.references.take();
        self.appointment.trigger = None;
        self.unsaved.insert(FactKey::References);
        self.on_dismissed(now, former);
    }

    /// The first camera to see a target triggers; the next one that sees it at the same stop becomes its
    /// helper (thesis 2.3). Not where cameras know their poses, as they may from a former network: the target
    /// finds its place from them, and a second frame would begin here.
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
