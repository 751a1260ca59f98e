//! Links between nodes that hear each other, kept up to date with a grid: a move costs as much as the links of the
//! node that moves.

use std::collections::HashMap;

use super::{
    Place,
    propagation::{Link, Propagation},
};

/// Cell of the grid.
type Cell = [i64; 2];

pub(super) struct Links {
    pub(super) propagation: Propagation,
    seed: u64,
    places: Vec<Place>,
    /// Links of each node, sorted by the other end.
    links: Vec<Vec<Link>>,
    /// Width of a cell: no link is longer.
    width: f64,
    cells: HashMap<Cell, Vec<u32>>,
    cell_of: Vec<Cell>,
    /// Nodes whose links are out of date.
    moved: Vec<u32>,
    is_moved: Vec<bool>,
    /// Room for the links of the next one.
    spare: Vec<Link>,
}

impl Links {
    pub(super) fn new(propagation: Propagation, seed: u64) -> Self {
        Self {
            width: propagation.reach(),
            propagation,
            seed,
            places: Vec::new(),
            links: Vec::new(),
            cells: HashMap::new(),
            cell_of: Vec::new(),
            moved: Vec::new(),
            is_moved: Vec::new(),
            spare: Vec::new(),
        }
    }

    pub(super) fn place(&self, node: u32) -> Place {
        self.places[node as usize]
    }

    pub(super) fn add(&mut self, place: Place) -> u32 {
        let node = self.places.len() as u32;
        self.places.push(place);
        self.links.push(Vec::new());
        let cell = self.cell(place);
        self.cell_of.push(cell);
        self.cells.entry(cell).or_default().push(node);
        self.is_moved.push(true);
        self.moved.push(node);
        node
    }

    pub(super) fn move_to(&mut self, node: u32, place: Place) {
        let index = node as usize;
        self.places[index] = place;
        if !self.is_moved[index] {
            self.is_moved[index] = true;
            self.moved.push(node);
        }
    }

    /// The links of a node now.
    pub(super) fn of(&mut self, node: u32) -> &[Link] {
        while let Some(moved) = self.moved.pop() {
            self.is_moved[moved as usize] = false;
            self.renew(moved);
        }
        &self.links[node as usize]
    }

    fn cell(&self, place: Place) -> Cell {
        if self.width.is_finite() && self.width > 0.0 {
            place.map(|coordinate| (coordinate / self.width).floor() as i64)
        } else {
            [0; 2]
        }
    }

    fn renew(&mut self, node: u32) {
        let index = node as usize;
        let before = std::mem::take(&mut self.links[index]);
        let mut links = std::mem::take(&mut self.spare);
        links.clear();
        self.move_cell(node);
        let [x, y] = self.cell_of[index];
        let here = (node, self.places[index]);
        for cell in (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y])) {
            for &other in self.cells.get(&cell).into_iter().flatten() {
                let there = (other, self.places[other as usize]);
                if other != node {
                    links.extend(self.propagation.link(self.seed, here, there));
                }
            }
        }
        links.sort_unstable_by_key(|link| link.to);
        for link in &links {
            let others = &mut self.links[link.to as usize];
            let back = Link { to: node, ..*link };
            match others.binary_search_by_key(&node, |other| other.to) {
                Ok(at) => others[at] = back,
                Err(at) => others.insert(at, back),
            }
        }
        // Most stay in reach of a node that moves.
        for old in &before {
            if links.binary_search_by_key(&old.to, |link| link.to).is_err() {
                let others = &mut self.links[old.to as usize];
                others.retain(|other| other.to != node);
            }
        }
        self.links[index] = links;
        self.spare = before;
    }

    fn move_cell(&mut self, node: u32) {
        let index = node as usize;
        let (old, new) = (self.cell_of[index], self.cell(self.places[index]));
        if old == new {
            return;
        }
        if let Some(inhabitants) = self.cells.get_mut(&old) {
            inhabitants.retain(|&inhabitant| inhabitant != node);
        }
        self.cells.entry(new).or_default().push(node);
        self.cell_of[index] = new;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{medium::LogDistance, random::mix};

    fn anywhere(hash: u64) -> Place {
        [mix(hash), mix(hash ^ 1)].map(|part| (part % 10_000) as f64 / 100.0 - 50.0)
    }

    /// Against all pairs, while nodes wander.
    #[test]
    fn the_grid_finds_what_all_pairs_find() {
        let models = [
            Propagation::UnitDisk {
                range: 12.0,
                loss: 0.0,
            },
            Propagation::LogDistance(LogDistance {
                loss_at_one: 70.0,
                ..LogDistance::default()
            }),
        ];
        for model in models {
            let mut links = Links::new(model.clone(), 5);
            let count = 120;
            for n in 0..count {
                links.add(anywhere(n * 1000));
            }
            for step in 0..30 {
                let node = (mix(step) % count) as u32;
                links.move_to(node, anywhere(step * 77 + 3));
                let mut found = 0;
                for a in 0..count as u32 {
                    let mut all = Vec::new();
                    for b in (0..count as u32).filter(|&b| b != a) {
                        let ends = [a, b].map(|node| (node, links.place(node)));
                        all.extend(model.link(5, ends[0], ends[1]));
                    }
                    let kept: Vec<_> = links.of(a).iter().map(|l| (l.to, l.gain)).collect();
                    let all: Vec<_> = all.iter().map(|l| (l.to, l.gain)).collect();
                    assert_eq!(kept, all);
                    found += kept.len();
                }
                assert!(found > 100 && found < 14_000, "{found}");
            }
        }
    }
}
