//! What members told of themselves: a table that is written down.

use crate::{
    limits::MEMBERS,
    memory::Fact,
    message::{Address, Report},
};

/// A member: its report, and what else is known of it.
#[derive(Clone, Debug)]
pub(crate) struct Member<T> {
    pub(crate) address: Address,
    /// What it told of itself last.
    pub(crate) report: Option<Report>,
    /// Where that is written down, or is to be.
    slot: Option<u8>,
    /// It is to be.
    unsaved: bool,
    pub(crate) more: T,
}

/// Members in the order in which they were met.
#[derive(Clone, Debug)]
pub(crate) struct Reports<T> {
    members: heapless::Vec<Member<T>, MEMBERS>,
    /// Slots that are to be emptied.
    emptied: u32,
}

impl<T: Default> Reports<T> {
    pub(crate) const fn new() -> Self {
        const { assert!(MEMBERS <= u32::BITS as usize) };
        Self {
            members: heapless::Vec::new(),
            emptied: 0,
        }
    }

    pub(crate) fn iter(&self) -> core::slice::Iter<'_, Member<T>> {
        self.members.iter()
    }

    pub(crate) fn iter_mut(&mut self) -> core::slice::IterMut<'_, Member<T>> {
        self.members.iter_mut()
    }

    /// What is known of a member.
    pub(crate) fn get(&mut self, address: Address) -> Option<&mut T> {
        let mut members = self.members.iter_mut();
        let member = members.find(|member| member.address == address)?;
        Some(&mut member.more)
    }

    /// The member with this address, made if there is room.
    // Not inlined: for the sake of flash.
    #[inline(never)]
    pub(crate) fn of(&mut self, address: Address) -> Option<&mut Member<T>> {
        let known = |member: &Member<T>| member.address == address;
        let place = match self.members.iter().position(known) {
            Some(place) => place,
            None => {
                let new = Member {
                    address,
                    report: None,
                    slot: None,
                    unsaved: false,
                    more: T::default(),
                };
                self.members.push(new).ok()?;
                self.members.len() - 1
            }
        };
        self.members.get_mut(place)
    }

    /// Takes what was written down in this slot.
    pub(crate) fn restore(&mut self, slot: u8, address: Address, report: Report) -> Option<&mut T> {
        let member = self.of(address)?;
        member.slot = Some(slot);
        member.report = Some(report);
        Some(&mut member.more)
    }

    /// A member told how far it is.
    pub(crate) fn report(&mut self, address: Address, report: Report) -> Option<&mut T> {
        // Not its place in the table: a table that was recalled has no gaps, and then one camera
        // would be written over another.
        let is_used = |slot: &u8| self.members.iter().any(|m| m.slot == Some(*slot));
        let free = (0..MEMBERS as u8).find(|slot| !is_used(slot));
        let member = self.of(address)?;
        member.unsaved |= member.report != Some(report);
        member.slot = member.slot.or(free);
        member.report = Some(report);
        Some(&mut member.more)
    }

    /// Nobody is known any more.
    pub(crate) fn clear(&mut self) {
        self.retain(|_| false);
    }

    /// This member is not known any more.
    pub(crate) fn remove(&mut self, address: Address) {
        self.retain(|member| member.address != address);
    }

    fn retain(&mut self, is_kept: impl Fn(&Member<T>) -> bool) {
        let gone = self.members.iter().filter(|member| !is_kept(member));
        let slots = gone.filter_map(|member| member.slot);
        self.emptied = slots.fold(self.emptied, |slots, slot| {
            slots | 1_u32.checked_shl(slot.into()).unwrap_or_default()
        });
        self.members.retain(is_kept);
    }

    /// The next fact to write down. None is ever lost: what is written is what is known then.
    pub(crate) fn unsaved(&mut self) -> Option<Fact> {
        if self.emptied != 0 {
            let slot = self.emptied.trailing_zeros();
            self.emptied &= self.emptied - 1;
            return Some(Fact::Camera(slot as u8, None));
        }
        self.members.iter_mut().find_map(|member| {
            let report = core::mem::take(&mut member.unsaved).then_some(member.report?)?;
            Some(Fact::Camera(member.slot?, Some((member.address, report))))
        })
    }
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
            state: CameraState::Waiting,
        }
    }

    fn written(reports: &mut Reports<()>) -> Vec<(u8, Option<Address>)> {
        let facts = core::iter::from_fn(|| reports.unsaved());
        facts
            .map(|fact| match fact {
                Fact::Camera(slot, kept) => (slot, kept.map(|(address, _)| address)),
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn slots_are_given_once() {
        let mut reports = Reports::<()>::new();
        for (slot, address) in [(1, 10), (0, 11), (3, 12)] {
            reports.restore(slot, address, report(0));
        }
        for address in [20, 10, 21] {
            reports.report(address, report(1));
        }
        // As told before: nothing to write.
        reports.report(11, report(0));
        let expected = [(1, Some(10)), (2, Some(20)), (4, Some(21))];
        assert_eq!(written(&mut reports), expected);
        for address in 100..150 {
            reports.report(address, report(1));
        }
        let slots = written(&mut reports);
        assert_eq!(slots.len(), MEMBERS - 5);
        assert!(reports.iter().all(|member| member.slot.is_some()));
    }

    #[test]
    fn what_is_forgotten_is_erased_before_others_take_its_room() {
        let mut reports = Reports::<()>::new();
        for (slot, address) in [(1, 10), (31, 11)] {
            reports.restore(slot, address, report(0));
        }
        reports.clear();
        assert_eq!(reports.iter().count(), 0);
        reports.report(12, report(1));
        reports.report(13, report(1));
        let expected = [(1, None), (31, None), (0, Some(12)), (1, Some(13))];
        assert_eq!(written(&mut reports), expected);
        reports.remove(12);
        reports.report(14, report(1));
        assert_eq!(written(&mut reports), [(0, None), (0, Some(14))]);
    }
}
