//! Who the reference cameras are: those configured, or the first two that saw a target (thesis 2.3).

use zigbee_link::{Instant, wire::ShortAddress};

use super::{CoordinatorRole, MemberNotification};
use crate::{
    facts::FactKey,
    message::{Duty, MemberAddress, MemberKind, References, StopNumber},
};

/// The first camera that saw a target, at this stop of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Trigger {
    pub(super) camera: MemberAddress,
    pub(super) target: MemberAddress,
    pub(super) stop: StopNumber,
}

/// Who the references are, or how far their election is.
#[derive(Clone, Debug)]
pub(super) struct Appointment {
    references: Option<References>,
    /// References were appointed in a former run.
    restored: bool,
    trigger: Option<Trigger>,
}

impl Appointment {
    pub(super) const fn new() -> Self {
        Self {
            references: None,
            restored: false,
            trigger: None,
        }
    }

    pub(super) const fn references(&self) -> Option<References> {
        self.references
    }

    /// Takes what was written down in a former run.
    pub(super) const fn restore(&mut self, references: Option<References>) {
        self.references = references;
        self.restored = references.is_some();
    }

    /// Whether a camera triggered.
    pub(super) const fn is_triggered(&self) -> bool {
        self.trigger.is_some()
    }

    /// Whether a camera that presents itself has to be told who the references are. A reference may
    /// have missed it, or forgotten. After a restart of this node nobody knows who was one before,
    /// and was not told.
    pub(super) fn concerns(&self, camera: MemberAddress, is_news: bool) -> bool {
        self.references.is_some_and(|references| {
            is_news && self.restored || references.duty_of(ShortAddress(camera)).is_some()
        })
    }

    /// This member is not known any more. If it was a reference camera, there are none: whether
    /// that is so.
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
    pub(super) fn forget(&mut self, address: MemberAddress) {
        self.members.remove(address, &mut self.unsaved);
        if self.appointment.forget(address) {
            self.unsaved.insert(FactKey::References);
            // Nobody is to be told any more: what stays due would keep the node awake.
            for member in self.members.iter_mut() {
                let notifications = &mut member.more.notifications;
                notifications.cancel(MemberNotification::References);
            }
        }
    }

    /// Whether a camera knows its pose, so that there is a frame of the site.
    fn has_frame(&self) -> bool {
        let mut reports = self.reports();
        reports.any(|(_, report)| report.pose().is_some())
    }

    /// The camera that is configured as this reference, and its position. Of several the one that
    /// was met last, which is there in place of the others.
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
        self.unsaved.insert(FactKey::References);
        // Those that are none any more, too.
        for references in former.into_iter().chain([references]) {
            for camera in [references.first, references.second] {
                self.notify(now, camera, MemberNotification::References);
            }
        }
    }

    /// The first camera to see a target triggers; the next one that sees it at the same stop
    /// becomes its helper (thesis 2.3). Not where cameras know their poses, as they may from a former
    /// network: the target finds its place from them, and a second frame would begin here.
    pub(super) fn on_trigger(&mut self, now: Instant, trigger: Trigger) {
        let is_configured = [Duty::First, Duty::Second]
            .iter()
            .any(|&duty| self.camera_with(duty).is_some());
        if self.appointment.references.is_some() || is_configured || self.has_frame() {
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
