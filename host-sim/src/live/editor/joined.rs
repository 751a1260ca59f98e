//! Changes that two made to the same site, in one.

use std::collections::BTreeSet;

use serde::Deserialize;
use site::{OutlineTable, PillarTable};

use super::{Hindrance, Layout, Placed};

/// The change that holds where both changed the same thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The one that is in the file.
    File,
    /// The one of the page.
    Page,
}

/// Joins the change of a page, from the layout with which it began to the one that is wanted, with those that the
/// file has seen since. Obstacles of both, and of the result, are numbered as in `now`'s file, if it did not change,
/// and otherwise the page's are as in `base`'s.
///
/// # Errors
/// The things that both changed, in words, if no side is preferred.
pub(super) fn joined(
    (base, now): (&Layout, &Layout),
    wanted: &Layout,
    preferred: Option<Side>,
) -> Result<Layout, Vec<String>> {
    let mut join = Join {
        preferred,
        conflicts: Vec::new(),
    };
    let networks = match base.networks.len() == now.networks.len() {
        _ if now.networks == base.networks => wanted.networks.clone(),
        _ if wanted.networks == base.networks => now.networks.clone(),
        true => { base.networks.iter().zip(&now.networks) }
            .zip(&wanted.networks)
            .map(|((base, now), wanted)| join.cameras(base, now, wanted))
            .collect(),
        false => {
            if preferred != Some(Side::File) {
                let words = "the file has another number of networks by now";
                join.conflicts.push(words.to_owned());
            }
            now.networks.clone()
        }
    };
    let obstacles = join.obstacles(&base.obstacles, &now.obstacles, &wanted.obstacles);
    match join.conflicts.is_empty() {
        true => Ok(Layout {
            networks,
            obstacles,
        }),
        false => Err(join.conflicts),
    }
}

struct Join {
    preferred: Option<Side>,
    conflicts: Vec<String>,
}

impl Join {
    /// Returns true if the page's change holds. Without preference both are told.
    fn takes_page(&mut self, words: impl FnOnce() -> String) -> bool {
        match self.preferred {
            Some(side) => side == Side::Page,
            None => {
                self.conflicts.push(words());
                false
            }
        }
    }

    fn cameras(&mut self, base: &[Placed], now: &[Placed], wanted: &[Placed]) -> Vec<Placed> {
        let of = |list: &[Placed], id| list.iter().find(|camera| camera.id == id).copied();
        let mut seen = BTreeSet::new();
        { now.iter().chain(wanted) }
            .map(|camera| camera.id)
            .filter(|id| seen.insert(*id))
            .filter_map(|id| {
                let [base, now, wanted] = [base, now, wanted].map(|list| of(list, id));
                let is_mine = wanted != base && wanted != now;
                let words = || {
                    format!(
                        "camera {id}: {} in the file, {} here",
                        pose(now),
                        pose(wanted)
                    )
                };
                match is_mine && (now == base || self.takes_page(words)) {
                    true => wanted,
                    false => now,
                }
            })
            .collect()
    }

    fn obstacles(
        &mut self,
        base: &[Hindrance],
        now: &[Hindrance],
        wanted: &[Hindrance],
    ) -> Vec<Hindrance> {
        let are_same = |a: &[Hindrance], b: &[Hindrance]| {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.is == b.is)
        };
        if are_same(base, now) {
            return wanted.to_vec();
        }
        if are_same(base, wanted) || are_same(now, wanted) {
            return now.to_vec();
        }
        let mut places: Vec<_> = now.iter().cloned().map(Some).collect();
        let mut added = Vec::new();
        let mut taken = BTreeSet::new();
        for (n, before) in base.iter().enumerate() {
            // The same one, wherever it is in the file by now.
            let mut same = (0..).zip(now).filter(|(_, one)| one.is == before.is);
            let place = same.find_map(|(k, _): (usize, _)| taken.insert(k).then_some(k));
            let after = wanted.iter().find(|one| one.of == Some(n));
            if after.is_some_and(|after| after.is == before.is) {
                continue;
            }
            match (place, after) {
                (Some(k), after) => {
                    let changed = |after: &Hindrance| Hindrance {
                        of: Some(k),
                        is: after.is.clone(),
                    };
                    places[k] = after.map(changed);
                }
                (None, after) => {
                    let words = || format!("the {} was changed here and there", name(&before.is));
                    if self.takes_page(words) {
                        added.extend(after.map(|after| after.is.clone()));
                    }
                }
            }
        }
        let new = wanted.iter().filter(|one| one.of.is_none());
        added.extend(new.map(|one| one.is.clone()));
        let is_new = |is: &OutlineTable| now.iter().all(|known| known.is != *is);
        let added = added.into_iter().filter(is_new);
        let added = added.map(|is| Hindrance { of: None, is });
        places.into_iter().flatten().chain(added).collect()
    }
}

fn pose(camera: Option<Placed>) -> String {
    camera.map_or_else(
        || "removed".to_owned(),
        |camera| {
            let Placed {
                x, y, heading_deg, ..
            } = camera;
            let place = format!("at ({x:.2}, {y:.2}), {heading_deg:.1}\u{b0}");
            let told = camera.mount().into_iter();
            told.filter_map(|(key, value)| Some((key, value?)))
                .fold(place, |text, (key, value)| {
                    format!("{text}, {key} {value:.2}")
                })
        },
    )
}

/// An obstacle in words: its kind and where it began.
fn name(obstacle: &OutlineTable) -> String {
    let (kind, at) = match obstacle {
        OutlineTable::Wall(corners) => ("wall", corners.first().copied()),
        OutlineTable::Block(corners) => ("block", corners.first().copied()),
        &OutlineTable::Pillar(PillarTable { x, y, .. }) => ("pillar", Some([x, y])),
    };
    let at = at.map(|[x, y]| format!(" at ({x:.2}, {y:.2})"));
    format!("{kind}{}", at.unwrap_or_default())
}
