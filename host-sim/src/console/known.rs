//! What the coordinator has told.

use std::fmt;

use calib_core::Pose;
use node_firmware::{
    console::{KeyChange, Network, ToPc},
    message::{Address, Hello, Kind, PoseParts, Report, State},
};

use answers::record::Estimate;

/// A member.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Member {
    /// Its address.
    pub address: Address,
    /// The number by which people know it.
    pub id: u16,
    /// What it is; `None`: it has not said so since the coordinator started.
    pub kind: Option<Kind>,
    /// How far it is, if it is a camera.
    pub report: Option<Report>,
    /// It joined again since, and has another address.
    pub replaced: bool,
}

impl Member {
    /// Whether it is a camera. Only cameras report.
    pub fn is_camera(&self) -> bool {
        match self.kind {
            Some(kind) => kind != Kind::Target,
            None => self.report.is_some(),
        }
    }

    /// Whether it is a reference camera: by its configuration, or because it was elected.
    pub fn is_reference(&self) -> bool {
        matches!(self.kind, Some(Kind::Camera { reference: Some(_) }))
            || self.report.is_some_and(|report| report.duty.is_some())
    }

    /// Its pose, if it has one.
    pub fn estimate(&self) -> Option<Estimate> {
        estimate(self.report?.pose()?)
    }

    /// The name of its [`Status`](calib_core::Status) with a pose; without, a refusal's, or
    /// `no_pose`.
    pub fn status(&self) -> &'static str {
        match self.report.map(|report| report.state) {
            Some(State::Refused(refusal)) => refusal.name(),
            Some(State::Waiting) | None => "no_pose",
            Some(state) => state.status().name(),
        }
    }

    /// `camera`, `target`, or `unknown`.
    pub fn kind_name(&self) -> &'static str {
        if self.is_camera() {
            "camera"
        } else if self.kind.is_some() {
            "target"
        } else {
            "unknown"
        }
    }
}

fn estimate(pose: &PoseParts) -> Option<Estimate> {
    let pose = pose.pose()?;
    Estimate::new(&Pose {
        position: pose.position.map(f64::from),
        heading: pose.heading.into(),
        covariance: pose.covariance.map(f64::from),
    })
}

/// What the coordinator has told.
#[derive(Clone, Debug, Default)]
pub struct Known {
    network: Option<Option<Network>>,
    members: Vec<Member>,
    key_change: Option<KeyChange>,
}

impl Known {
    /// Its network, if it has one.
    pub fn network(&self) -> Option<Network> {
        self.network.flatten()
    }

    /// The members in the order in which they were met.
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// The members that are there, by number: no address that a node has given up.
    pub fn present(&self) -> Vec<&Member> {
        let mut present: Vec<_> = self.members.iter().filter(|m| !m.replaced).collect();
        present.sort_by_key(|member| member.id);
        present
    }

    /// The addresses of a node, the present one last.
    pub fn addresses(&self, id: u16) -> Vec<Address> {
        let of_it = self.members.iter().filter(|member| member.id == id);
        let mut of_it: Vec<_> = of_it.collect();
        of_it.sort_by_key(|member| !member.replaced);
        of_it.iter().map(|member| member.address).collect()
    }

    /// The last change of the site key.
    pub fn key_change(&self) -> Option<KeyChange> {
        self.key_change
    }

    /// Whether there are so many cameras, one at least, and all have a pose.
    pub fn is_calibrated(&self, cameras: usize) -> bool {
        let all: Vec<_> = self
            .present()
            .into_iter()
            .filter(|m| m.is_camera())
            .collect();
        all.len() >= cameras.max(1) && all.iter().all(|camera| camera.estimate().is_some())
    }

    /// Takes a message. Returns what is new in words for people, if anything is.
    pub fn take(&mut self, message: &ToPc) -> Option<String> {
        match *message {
            ToPc::Network(network) => {
                let is_news = self.network.replace(network) != Some(network);
                is_news.then(|| match network {
                    Some(Network { pan, channel }) => {
                        format!("network {pan:04x} on channel {channel}")
                    }
                    None => "no network yet: the coordinator looks for a free one".to_owned(),
                })
            }
            ToPc::Member { address, hello } => self.hello(address, hello),
            ToPc::Report { address, report } => self.report(address, report),
            ToPc::Done { address, done } => {
                let result = if done.success { "done" } else { "failed" };
                Some(format!(
                    "{}: {:?}: {result}",
                    self.name(address),
                    done.command
                ))
            }
            ToPc::Removed { address, success } => {
                let name = self.name(address);
                self.members.retain(|member| member.address != address);
                Some(match success {
                    true => format!("{name}: removed"),
                    false => format!("{name}: was no member"),
                })
            }
            ToPc::KeyChange(change) => {
                let is_news = self.key_change != change;
                self.key_change = change;
                change
                    .filter(|_| is_news)
                    .map(|change| KeyNews(change).to_string())
            }
            // Nobody asks for these here.
            ToPc::Tracked { .. } | ToPc::Sighting { .. } => None,
        }
    }

    /// How people call the member at an address.
    fn name(&self, address: Address) -> String {
        match self.members.iter().find(|member| member.address == address) {
            Some(member) => format!("{} {}", member.kind_name(), member.id),
            None => format!("address {address:04x}"),
        }
    }

    /// The member at an address, if it is this node; made if there was none. Whether it was made.
    fn member(&mut self, address: Address, id: u16) -> (&mut Member, bool) {
        let known = |member: &Member| (member.address, member.id) == (address, id);
        let place = self.members.iter().position(known);
        if place.is_none() {
            // The coordinator gives an address anew once its owner was removed.
            self.members.retain(|member| member.address != address);
            for former in self.members.iter_mut().filter(|member| member.id == id) {
                former.replaced = true;
            }
            self.members.push(Member {
                address,
                id,
                kind: None,
                report: None,
                replaced: false,
            });
        }
        let last = self.members.len() - 1;
        (&mut self.members[place.unwrap_or(last)], place.is_none())
    }

    fn hello(&mut self, address: Address, hello: Hello) -> Option<String> {
        let (member, is_new) = self.member(address, hello.id);
        let is_news = member.kind.replace(hello.kind) != Some(hello.kind) || is_new;
        let member = *member;
        is_news.then(|| {
            let reference = if member.is_reference() {
                ", reference"
            } else {
                ""
            };
            format!(
                "{} {}: member with address {address:04x}{reference}",
                member.kind_name(),
                member.id
            )
        })
    }

    fn report(&mut self, address: Address, report: Report) -> Option<String> {
        let (member, _) = self.member(address, report.id);
        let is_news = member.report.replace(report) != Some(report);
        is_news.then(|| Progress(member).to_string())
    }
}

/// How far a camera is, in words.
struct Progress<'a>(&'a Member);

impl fmt::Display for Progress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let member = self.0;
        write!(f, "camera {}: ", member.id)?;
        match member.estimate() {
            Some(e) => write!(
                f,
                "x {:.3} +/- {:.3}, y {:.3} +/- {:.3}, heading {:.2} +/- {:.2} deg",
                e.x, e.sigma_x, e.y, e.sigma_y, e.heading_deg, e.sigma_heading_deg
            )?,
            None => f.write_str(member.status())?,
        }
        if let Some(report) = member.report {
            write!(f, "; {} sightings", report.sightings)?;
            if report.done {
                f.write_str(", needs no more")?;
            }
        }
        Ok(())
    }
}

/// How a change of the key goes, in words.
struct KeyNews(KeyChange);

impl fmt::Display for KeyNews {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let KeyChange {
            index,
            done,
            unreached,
        } = self.0;
        let state = if done { "in use" } else { "being handed on" };
        write!(f, "site key {index}: {state}")?;
        if unreached > 0 {
            write!(f, "; {unreached} members did not say that they have it")?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use calib_core::Refusal;

    use super::*;

    pub(crate) const CAMERA: Kind = Kind::Camera { reference: None };

    pub(crate) fn member(address: Address, id: u16, kind: Kind) -> ToPc {
        let hello = Hello { id, kind };
        ToPc::Member { address, hello }
    }

    pub(crate) fn reported(address: Address, id: u16, state: State) -> ToPc {
        let report = Report {
            id,
            duty: None,
            sightings: 4,
            used: 3,
            chi_squared: 1.5,
            done: false,
            state,
        };
        ToPc::Report { address, report }
    }

    pub(crate) fn pose() -> State {
        State::Calibrated(PoseParts {
            position: [1.0, -2.0],
            heading: core::f32::consts::FRAC_PI_2,
            covariance: [0.04, 0.0, 0.09, 0.0, 0.0, 0.0001],
        })
    }

    #[test]
    fn only_changes_are_news() {
        let mut known = Known::default();
        let messages = [
            ToPc::Network(None),
            ToPc::Network(Some(Network {
                pan: 0xABC,
                channel: 15,
            })),
            member(1, 7, CAMERA),
            reported(1, 7, State::Waiting),
            reported(1, 7, State::Refused(Refusal::DangerCircle)),
            reported(1, 7, pose()),
        ];
        let news: Vec<_> = messages.iter().map(|m| known.take(m).unwrap()).collect();
        assert_eq!(news[1], "network 0abc on channel 15");
        assert_eq!(news[2], "camera 7: member with address 0001");
        assert_eq!(news[4], "camera 7: danger_circle; 4 sightings");
        assert_eq!(
            news[5],
            "camera 7: x 1.000 +/- 0.200, y -2.000 +/- 0.300, heading 90.00 +/- 0.57 deg; 4 sightings"
        );
        for message in [&messages[1], &messages[2], &messages[5]] {
            assert_eq!(known.take(message), None);
        }
    }

    #[test]
    fn calibrated_is_who_has_poses_only() {
        let mut known = Known::default();
        assert!(!known.is_calibrated(0), "there is no camera");
        known.take(&member(9, 4, Kind::Target));
        known.take(&member(1, 7, CAMERA));
        assert!(!known.is_calibrated(0));
        known.take(&reported(1, 7, pose()));
        assert!(known.is_calibrated(0));
        assert!(!known.is_calibrated(2), "another one is awaited");
        known.take(&reported(2, 8, State::Refused(Refusal::TooFew)));
        assert!(!known.is_calibrated(0));
        known.take(&reported(2, 8, pose()));
        assert!(known.is_calibrated(2));
    }

    #[test]
    fn who_joins_again_has_one_present_address() {
        let mut known = Known::default();
        known.take(&member(5, 7, CAMERA));
        known.take(&member(3, 7, CAMERA));
        known.take(&reported(3, 7, pose()));
        // A refresh tells the former address first, every time.
        assert_eq!(known.take(&member(5, 7, CAMERA)), None);
        assert_eq!(known.addresses(7), [5, 3]);
        assert_eq!(known.present().len(), 1);
        assert!(known.is_calibrated(0));
        // Its place is given to another node.
        let success = true;
        known.take(&ToPc::Removed {
            address: 5,
            success,
        });
        known.take(&member(5, 8, CAMERA));
        assert_eq!(known.addresses(7), [3]);
        assert_eq!(known.addresses(8), [5]);
        known.take(&member(3, 9, CAMERA));
        assert!(
            known.addresses(7).is_empty(),
            "another node has its address"
        );
    }
}
