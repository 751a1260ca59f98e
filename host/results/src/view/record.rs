//! A real network as a record.

use std::{collections::BTreeMap, time::Duration};

use calib_core::{Ray, Sighting, level::Row};
use nalgebra::{Matrix2, Point2};
use node_firmware::message::{Duty, ListedSighting, MemberKind, Seen, SitePlace};
use site::coordinator_id;

use super::{
    Member, NetworkView, SitePlan, UNKNOWN_UNIT,
    site::{usual_limits, usually_told},
};
use crate::record::{
    self, Believed, FORMAT, Node, Place, Role, RunRecord, Stop, Target, Unit, summary::Summary,
};

impl NetworkView {
    /// Record of a network without truth. Values that the site file does not tell, or where there is none, are
    /// not known, but that a weak pose is one by the firmware's own limits.
    pub fn record(&self, now: Duration, site: Option<&SitePlan>) -> RunRecord {
        let site = site.map(|site| site.with_references(self.references()));
        let site = site.as_ref();
        let mut nodes: Vec<Node> = site.map(SitePlan::nodes).unwrap_or_default();
        let hanging = site.map_or_else(usually_told, |site| site.hanging);
        let ball_height = site.and_then(SitePlan::ball_height);
        for member in self.present() {
            let role = match member.kind {
                _ if member.is_camera() => Role::Camera,
                Some(MemberKind::Target) => Role::Target,
                // It has not said what it is.
                _ => continue,
            };
            let place = nodes.iter().position(|node| node.id == member.id);
            let place = place.unwrap_or_else(|| {
                nodes.push(Node::new(member.id, role));
                nodes.len() - 1
            });
            self.describe(now, member, &mut nodes[place]);
            if role == Role::Camera {
                nodes[place].set_hung(&self.rows(member), &hanging);
            }
        }
        if self.is_silent(now) {
            let number = site.map_or(1, SitePlan::number);
            let id = coordinator_id(number.saturating_sub(1));
            let mut coordinator = Node::new(id, Role::Coordinator);
            coordinator.silent = true;
            coordinator.heard_seconds = self.spoke.map(|at| at.as_secs_f64());
            nodes.push(coordinator);
        }
        nodes.sort_by_key(|node| node.id);
        let weak = usual_limits();
        RunRecord {
            format: FORMAT,
            scenario: site.map_or_else(|| "network".to_owned(), |site| site.name.clone()),
            published: None,
            path: None,
            seed: None,
            unit: site.map_or_else(
                || Unit {
                    name: UNKNOWN_UNIT.to_owned(),
                    metres: 1.0,
                },
                |site| site.unit.clone(),
            ),
            limits: site.map_or(weak, |site| site.limits),
            networks: vec![record::Network {
                network: 1,
                frame: Place::ORIGIN,
                building: site.and_then(SitePlan::building),
                pan: self.network().map(|network| network.pan),
                channel: self.network().map(|network| network.channel),
                ball_height,
            }],
            summary: Summary::of(&nodes),
            nodes,
            targets: self.targets(),
            sightings: Vec::new(),
            obstacles: site.map(SitePlan::obstacles).unwrap_or_default(),
            area: site.map(SitePlan::area).unwrap_or_default(),
            radio: None,
            tracking: Vec::new(),
            stops_in_vain: false,
            sim_seconds: now.as_secs_f64(),
            wall_seconds: None,
        }
    }

    /// The numbers of the cameras that became the references, if both did.
    fn references(&self) -> Option<[u16; 2]> {
        let has = |duty: Duty| {
            let mut cameras = self.cameras().into_iter();
            let is_it = |m: &&Member| m.duty() == Some(duty);
            cameras.find(is_it).map(|camera| camera.id)
        };
        Some([has(Duty::First)?, has(Duty::Second)?])
    }

    fn describe(&self, now: Duration, member: &Member, node: &mut Node) {
        member.describe(node);
        // A coordinator that is silent itself tells of no answers.
        node.silent = member.is_silent(self.spoke.unwrap_or(now));
        if node.is_camera() {
            node.expected = true;
            node.reference |= member.is_reference();
            let told: Vec<_> = member.sightings.values().map(|s| (self, s)).collect();
            let sightings: Vec<_> = told
                .iter()
                .filter_map(|(view, told)| {
                    let seen = member.upright(told.seen)?;
                    Some((view.id_of(told.target)?, told.stop, sighting(told, &seen)))
                })
                .collect();
            if !sightings.is_empty() {
                let all = sightings.iter();
                node.set_sightings(all.map(|(target, stop, s)| (*target, u32::from(*stop), s)));
            }
        }
    }

    /// The rows in which a camera saw its stops, where those are known in the frame of the site.
    fn rows(&self, camera: &Member) -> Vec<Row<f64>> {
        let rows = camera.sightings.values().filter_map(|told| {
            let target = self.id_of(told.target)?;
            let own = self.present().into_iter().find(|m| m.id == target);
            let own = own.and_then(|target| target.stops.get(&told.stop));
            let (place, variance) = match own {
                Some((at, Some(place))) => {
                    let believed = own_stop(told.stop.into(), *at, place).believed?;
                    (Point2::new(believed.x, believed.y), believed.variance())
                }
                // What a reference saw before the frame was known has no place in it.
                _ if camera.is_reference() => return None,
                _ => {
                    let sigma = each_axis(told);
                    (Point2::from(told.position.map(f64::from)), sigma * sigma)
                }
            };
            Some(Row {
                target: place,
                target_variance: variance,
                bearing: told.seen.bearing.into(),
                elevation: told.seen.elevation.radians()?,
                sigma: told.seen.sigma.into(),
            })
        });
        rows.collect()
    }

    /// Where the targets said they stood, as far as they or cameras told.
    fn targets(&self) -> Vec<Target> {
        let mut targets = BTreeMap::<u16, BTreeMap<u16, ListedSighting>>::new();
        for member in self
            .present()
            .iter()
            .filter(|m| m.kind == Some(MemberKind::Target))
        {
            targets.entry(member.id).or_default();
        }
        for told in self.cameras().iter().flat_map(|c| c.sightings.values()) {
            if let Some(target) = self.id_of(told.target) {
                targets.entry(target).or_default().insert(told.stop, *told);
            }
        }
        let targets = targets.into_iter().map(|(id, told)| {
            let mut stops: BTreeMap<u32, Stop> = told
                .values()
                .map(|told| (told.stop.into(), stop(told)))
                .collect();
            // The target's own report came at once, and tells more.
            let own = self.present().into_iter().filter(|m| m.id == id);
            for (number, (at, place)) in own.flat_map(|m| &m.stops) {
                if let Some(place) = place {
                    let number = u32::from(*number);
                    stops.insert(number, own_stop(number, *at, place));
                }
            }
            let stops: Vec<Stop> = stops.into_values().collect();
            Target {
                id,
                network: 1,
                path: stops.iter().map(|stop| [stop.x, stop.y]).collect(),
                stops,
            }
        });
        targets.collect()
    }
}

fn stop(told: &ListedSighting) -> Stop {
    let [x, y] = told.position.map(f64::from);
    let sigma = each_axis(told);
    Stop {
        stop: told.stop.into(),
        seconds: None,
        x,
        y,
        believed: Some(Believed {
            x,
            y,
            sigma_x: sigma,
            sigma_y: sigma,
        }),
    }
}

fn own_stop(stop: u32, at: Duration, (place, covariance): &SitePlace) -> Stop {
    let [x, y] = place.map(f64::from);
    let [xx, _, yy] = covariance.map(f64::from);
    Stop {
        stop,
        seconds: Some(at.as_secs_f64()),
        x,
        y,
        believed: Some(Believed {
            x,
            y,
            sigma_x: xx.max(0.0).sqrt(),
            sigma_y: yy.max(0.0).sqrt(),
        }),
    }
}

/// The camera tells that of both axes together.
fn each_axis(told: &ListedSighting) -> f64 {
    f64::from(told.position_sigma) / 2_f64.sqrt()
}

fn sighting(told: &ListedSighting, seen: &Seen) -> Sighting<f64> {
    let sigma = each_axis(told);
    Sighting {
        target: Point2::from(told.position.map(f64::from)),
        ray: Ray::from_bearing(f64::from(seen.bearing)),
        bearing_sigma: seen.sigma.into(),
        target_covariance: Matrix2::identity() * (sigma * sigma),
    }
}
