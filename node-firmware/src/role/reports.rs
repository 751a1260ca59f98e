//! Reports of members: a table that is written down.

use calib_core::{Pose, angle};

use super::Unsaved;
use crate::{
    facts::{Fact, FactKey},
    limits::{MEMBERS, MEMBERS_MOST},
    message::{MemberAddress, PoseParts, ProtectionLevel, Report},
};

/// A member: its report, and further knowledge about it.
#[derive(Clone, Debug)]
pub(crate) struct Member<T> {
    pub(crate) address: MemberAddress,
    /// The report that it told of itself last.
    pub(crate) report: Option<Report>,
    /// Slot where that is written down, or is to be.
    slot: Option<u8>,
    pub(crate) more: T,
}

/// Members in the order in which they were met.
#[derive(Clone, Debug)]
pub(crate) struct Reports<T> {
    members: heapless::Vec<Member<T>, MEMBERS>,
}

impl<T: Default> Reports<T> {
    pub(crate) const fn new() -> Self {
        Self {
            members: heapless::Vec::new(),
        }
    }

    pub(crate) fn iter(&self) -> core::slice::Iter<'_, Member<T>> {
        self.members.iter()
    }

    pub(crate) fn iter_mut(&mut self) -> core::slice::IterMut<'_, Member<T>> {
        self.members.iter_mut()
    }

    /// Knowledge about a member.
    pub(crate) fn get(&mut self, address: MemberAddress) -> Option<&mut T> {
        let mut members = self.members.iter_mut();
        let member = members.find(|member| member.address == address)?;
        Some(&mut member.more)
    }

    /// The member with this address, made if there is room.
    // for less flash
    #[inline(never)]
    pub(crate) fn of(&mut self, address: MemberAddress) -> Option<&mut Member<T>> {
        let known = |member: &Member<T>| member.address == address;
        let place = match self.members.iter().position(known) {
            Some(place) => place,
            None => {
                let new = Member {
                    address,
                    report: None,
                    slot: None,
                    more: T::default(),
                };
                self.members.push(new).ok()?;
                self.members.len() - 1
            }
        };
        self.members.get_mut(place)
    }

    /// Takes the record of this slot.
    pub(crate) fn restore(
        &mut self,
        slot: u8,
        address: MemberAddress,
        report: Report,
    ) -> Option<&mut T> {
        let member = self.of(address)?;
        member.slot = Some(slot);
        member.report = Some(report);
        Some(&mut member.more)
    }

    /// A member told its status.
    pub(crate) fn report(
        &mut self,
        address: MemberAddress,
        report: Report,
        unsaved: &mut Unsaved,
    ) -> Option<&mut T> {
        // Not its place in the table: a table that was restored has no gaps, and then one camera
        // would be written over another.
        let is_used = |slot: &u8| self.members.iter().any(|m| m.slot == Some(*slot));
        let free = (0..MEMBERS_MOST as u8).find(|slot| !is_used(slot));
        let member = self.of(address)?;
        member.slot = member.slot.or(free);
        debug_assert!(member.slot.is_some(), "there are as many slots as members");
        if member.report.replace(report) != Some(report)
            && let Some(slot) = member.slot
        {
            unsaved.insert(FactKey::Camera(slot));
        }
        Some(&mut member.more)
    }

    /// No member is known any more.
    pub(crate) fn clear(&mut self, unsaved: &mut Unsaved) {
        self.retain(|_| false, unsaved);
    }

    /// This member is not known any more.
    pub(crate) fn remove(&mut self, address: MemberAddress, unsaved: &mut Unsaved) {
        self.retain(|member| member.address != address, unsaved);
    }

    fn retain(&mut self, is_kept: impl Fn(&Member<T>) -> bool, unsaved: &mut Unsaved) {
        let gone = self.members.iter().filter(|member| !is_kept(member));
        for slot in gone.filter_map(|member| member.slot) {
            unsaved.insert(FactKey::Camera(slot));
        }
        self.members.retain(is_kept);
    }

    /// The fact to be written in this slot.
    pub(crate) fn fact(&self, slot: u8) -> Fact {
        let mut members = self.members.iter();
        let member = members.find(|member| member.slot == Some(slot));
        let told = member.and_then(|member| Some((member.address, member.report?)));
        Fact::Camera(slot, told)
    }
}

/// Two poses of one camera contradict each other from this chi squared on, with three degrees of freedom:
/// chance exceeds it once in a million.
pub const CONTRADICTION: f32 = 30.0;

/// Distance between two poses of one camera, as chi squared. Where both places were given, only headings are
/// compared.
pub fn contradiction(one: &Pose<f32>, other: &Pose<f32>) -> f32 {
    let covariance = one.covariance + other.covariance;
    let both = Pose { covariance, ..*one };
    let off = both.normalised_error(other.position, other.heading);
    off.unwrap_or_else(|| {
        let off = angle::wrap_signed(one.heading - other.heading);
        off * off / covariance.m33.max(f32::MIN_POSITIVE)
    })
}

/// Returns true if a report differs so much from another that others should hear of it.
pub(crate) fn is_news(old: &Report, new: &Report) -> bool {
    let (Some(old_pose), Some(new_pose)) = (old.pose(), new.pose()) else {
        return old.state != new.state || old.done != new.done;
    };
    // A tenth less sigma, or more, or a pose that moved or turned by a third of its sigma.
    let place = |pose: &PoseParts| pose.covariance[0] + pose.covariance[2];
    let turn = |pose: &PoseParts| pose.covariance[5];
    let is_other_variance = |variance: fn(&PoseParts) -> f32| {
        let [old, new] = [variance(old_pose), variance(new_pose)];
        new < 0.81 * old || old < 0.81 * new
    };
    let turned = angle::wrap_signed(new_pose.heading - old_pose.heading);
    let moved = [0, 1].map(|axis| {
        let [a, b] =
            [old_pose, new_pose].map(|pose| pose.position.get(axis).copied().unwrap_or(f32::NAN));
        (a - b) * (a - b)
    });
    // A tenth of what one wrong measurement could do, too: the advice where to stop next foretells no more.
    let levels = |report: &Report| report.joint.unwrap_or(ProtectionLevel::NONE);
    let [old_levels, new_levels] = [old, new].map(levels);
    let is_other = |level: fn(&ProtectionLevel) -> f32| {
        let [old, new] = [level(&old_levels), level(&new_levels)];
        new < 0.9 * old || old < 0.9 * new
    };
    old.done != new.done
        || is_other(|level| level.position)
        || is_other(|level| level.heading)
        || old.status() != new.status()
        || old.duty != new.duty
        || old.mount.is_some() != new.mount.is_some()
        || is_other_variance(place)
        || is_other_variance(turn)
        || moved[0] + moved[1] > 0.1 * place(new_pose)
        || turned * turned > 0.1 * turn(new_pose)
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::message::CameraState;

    const fn report(id: u16) -> Report {
        Report {
            id,
            duty: None,
            sightings: 0,
            used: 0,
            chi_squared: 0.0,
            done: false,
            joint: None,
            state: CameraState::Waiting,
            mount: None,
        }
    }

    fn written(reports: &Reports<()>, unsaved: &mut Unsaved) -> Vec<(u8, Option<MemberAddress>)> {
        let keys = core::iter::from_fn(|| unsaved.take());
        keys.map(|key| match key {
            FactKey::Camera(slot) => match reports.fact(slot) {
                Fact::Camera(slot, told) => (slot, told.map(|(address, _)| address)),
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        })
        .collect()
    }

    #[test]
    fn slots_are_given_once() {
        let mut reports = Reports::<()>::new();
        let mut unsaved = Unsaved::new();
        for (slot, address) in [(1, 10), (0, 11), (3, 12)] {
            reports.restore(slot, address, report(0));
        }
        for address in [20, 10, 21] {
            reports.report(address, report(1), &mut unsaved);
        }
        // As told before: nothing to write.
        reports.report(11, report(0), &mut unsaved);
        let expected = [(1, Some(10)), (2, Some(20)), (4, Some(21))];
        assert_eq!(written(&reports, &mut unsaved), expected);
        for address in 100..300 {
            reports.report(address, report(1), &mut unsaved);
        }
        let slots = written(&reports, &mut unsaved);
        assert_eq!(slots.len(), MEMBERS - 5);
        assert!(reports.iter().all(|member| member.slot.is_some()));
    }

    #[test]
    fn what_is_forgotten_is_erased_or_replaced() {
        let mut reports = Reports::<()>::new();
        let mut unsaved = Unsaved::new();
        for (slot, address) in [(1, 10), (31, 11)] {
            reports.restore(slot, address, report(0));
        }
        reports.clear(&mut unsaved);
        assert_eq!(reports.iter().count(), 0);
        let erased = [(1, None), (31, None)];
        assert_eq!(written(&reports, &mut unsaved.clone()), erased);
        reports.report(12, report(1), &mut unsaved);
        reports.report(13, report(1), &mut unsaved);
        let expected = [(0, Some(12)), (1, Some(13)), (31, None)];
        assert_eq!(written(&reports, &mut unsaved), expected);
        reports.remove(12, &mut unsaved);
        assert_eq!(written(&reports, &mut unsaved.clone()), [(0, None)]);
        reports.report(14, report(1), &mut unsaved);
        assert_eq!(written(&reports, &mut unsaved), [(0, Some(14))]);
    }
}
