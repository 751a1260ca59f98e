//! Several networks of one site, each told by its coordinator, as one record.

use calib_core::angle::wrap_positive;

use super::{Place, RunRecord, heading_degrees, summary::Summary};

impl RunRecord {
    /// Several networks of one site, each as its coordinator tells it, as one: the record and the number of each.
    /// `None` of none.
    ///
    /// A target that went from one network to another is where it was heard last. Networks whose place in the
    /// building the file tells stand where it says; how others stand to each other is not known.
    pub fn joined(parts: impl IntoIterator<Item = (u16, Self)>) -> Option<Self> {
        let parts = parts.into_iter().map(|(number, mut part)| {
            let own = part.networks.iter_mut().map(|own| &mut own.network);
            let nodes = part.nodes.iter_mut().map(|node| &mut node.network);
            let targets = part.targets.iter_mut().map(|target| &mut target.network);
            let sightings = part.sightings.iter_mut().map(|own| &mut own.network);
            for of in own.chain(nodes).chain(targets).chain(sightings) {
                *of = number;
            }
            part
        });
        Self::together(parts)
    }

    /// Parts of one site as one, each with networks of its own; `None` of none. As [`joined`](Self::joined), for
    /// networks that have their numbers.
    pub fn together(parts: impl IntoIterator<Item = Self>) -> Option<Self> {
        let mut parts: Vec<_> = parts.into_iter().collect();
        for part in &mut parts {
            part.networks.sort_by_key(|own| own.network);
        }
        parts.sort_by_key(|part| part.networks.first().map(|own| own.network));
        let mut parts = parts.into_iter();
        let mut all = parts.next()?;
        let first = { all.networks.first() }.and_then(|network| network.building);
        for part in parts {
            for mut network in part.networks {
                if let (Some(first), Some(own)) = (first, network.building) {
                    let [first, own] = [first.isometry(), own.isometry()];
                    let between = first.inverse() * own;
                    network.frame = Place::new(
                        between.translation.x,
                        between.translation.y,
                        heading_degrees(wrap_positive(between.rotation.angle())),
                    );
                }
                all.networks.push(network);
            }
            for node in part.nodes {
                let known = all.nodes.iter_mut().find(|known| known.id == node.id);
                match known {
                    None => all.nodes.push(node),
                    Some(known) if known.heard_seconds < node.heard_seconds => *known = node,
                    Some(_) => {}
                }
            }
            for target in part.targets {
                let there = all.nodes.iter().find(|node| node.id == target.id);
                let is_there = there.is_some_and(|node| node.network == target.network);
                match all.targets.iter_mut().find(|known| known.id == target.id) {
                    None => all.targets.push(target),
                    Some(known) if is_there => *known = target,
                    Some(_) => {}
                }
            }
            all.sightings.extend(part.sightings);
            all.tracking.extend(part.tracking);
            all.sim_seconds = all.sim_seconds.max(part.sim_seconds);
        }
        all.networks.sort_by_key(|own| own.network);
        all.sightings.sort_by_key(|own| own.network);
        all.tracking.sort_by_key(|own| own.network);
        all.nodes.sort_by_key(|node| node.id);
        all.targets.sort_by_key(|target| target.id);
        all.summary = Summary::of(&all.nodes);
        Some(all)
    }

    /// The same, with all times later by so many seconds: a part that was begun after the others.
    #[must_use]
    pub fn later(mut self, by: f64) -> Self {
        self.sim_seconds += by;
        for node in &mut self.nodes {
            let times = [&mut node.calibrated_seconds, &mut node.heard_seconds];
            let failures = node.failures.iter_mut().map(|failure| &mut failure.seconds);
            let moves = node.moved.iter_mut();
            let moves = moves.flat_map(|own| [&mut own.after_seconds, &mut own.noticed_seconds]);
            let times = times.into_iter().flatten().chain(failures).chain(moves);
            times.for_each(|seconds| *seconds += by);
        }
        let stops = self.targets.iter_mut().flat_map(|own| &mut own.stops);
        let times = stops.filter_map(|stop| stop.seconds.as_mut());
        times.for_each(|seconds| *seconds += by);
        self
    }
}
