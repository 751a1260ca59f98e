//! Knowledge of a PC on a coordinator's line about its network, simulated or real.
//!
//! [`NetworkView`] takes the messages of the coordinator and the time. It tells members, poses and
//! sightings, and makes a [`RunRecord`](crate::record::RunRecord) of them, so that tables, verdict,
//! drawings and exports of a real network are those of a simulated one. A site file adds what a PC is not
//! told: lenses, walls, the place in the building. A simulation adds the truth itself.

use std::{collections::BTreeMap, fmt, time::Duration};

use calib_core::{Pose, Refusal, Status, angle::wrap_signed};
use node_firmware::{
    console::{KeyChangeReport, NetworkInfo, ToPc},
    message::{
        CameraState, Duty, Health, Hello, ListedSighting, MemberAddress, MemberKind, PoseParts,
        References, Report, Seen, SitePlace,
    },
    role::{CONTRADICTION, COORDINATOR, contradiction},
};

use crate::record::{
    Estimate, Node, NodeLens, NodeMount, NodeMove, Protection,
    verdict::{health_words, move_words, status_words},
};

mod command;
mod record;
mod site;

pub use command::{COMMAND_NAMES, command_name, parse_command};
pub use site::{SitePlan, area, building_place, limits, outline};

/// A coordinator that tells nothing for so long does not answer any more.
const SILENCE: Duration = Duration::from_secs(20);

/// Name of the unit of lengths where no site's file tells it.
pub(crate) const UNKNOWN_UNIT: &str = "units";

/// A camera that was asked for its sightings does not wait longer with its answer.
const PATIENCE: Duration = Duration::from_secs(15);

/// A member.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Its address.
    pub address: MemberAddress,
    /// The number by which people know it.
    pub id: u16,
    /// Kind of member; `None`: it has not told it since the coordinator started.
    pub kind: Option<MemberKind>,
    /// Its last report, if it is a camera.
    pub report: Option<Report>,
    /// Its health, as it says itself.
    pub health: Health,
    /// A reference camera that does not answer the coordinator, before any camera has a pose.
    pub absent: bool,
    /// It joined again since, and has another address.
    pub replaced: bool,
    /// When something new of it was heard.
    pub heard: Option<Duration>,
    /// When it first reported a pose.
    pub posed: Option<Duration>,
    /// Its last calibrated pose, and when it told it.
    good: Option<(Duration, Pose<f32>)>,
    /// The same of an earlier walk.
    former: Option<(Duration, Pose<f32>)>,
    /// When its pose became doubtful.
    doubted: Option<Duration>,
    /// Its last move.
    pub moved: Option<NodeMove>,
    /// The sightings that it told when it was asked, by their place in its list.
    pub sightings: BTreeMap<u8, ListedSighting>,
    /// When it was asked for them, and has not answered since.
    asked: Option<Duration>,
    /// A target: its stops, when they began, and where it believed to stand.
    stops: BTreeMap<u16, (Duration, Option<SitePlace>)>,
    /// Its duty as a reference, as the coordinator told it.
    appointed: Option<Duty>,
}

impl Member {
    /// Returns true if it is a camera. Only cameras report.
    pub fn is_camera(&self) -> bool {
        match self.kind {
            Some(kind) => kind != MemberKind::Target,
            None => self.report.is_some(),
        }
    }

    /// Returns true if it is a reference camera: by its configuration, or because it was elected.
    pub fn is_reference(&self) -> bool {
        matches!(self.kind, Some(MemberKind::Camera { reference: Some(_) }))
            || self.duty().is_some()
    }

    /// Its duty as a reference, once it did it or was told to.
    pub fn duty(&self) -> Option<Duty> {
        let done = self.report.and_then(|report| report.duty);
        done.or(self.appointed)
    }

    /// Its pose, whatever that is worth.
    pub fn pose(&self) -> Option<Pose<f64>> {
        let report = self.report?;
        exact(report.pose()?)
    }

    /// Its pose with sigmas, if it has one.
    pub fn estimate(&self) -> Option<Estimate> {
        Estimate::new(&self.pose()?)
    }

    /// Most that one unnoticed wrong measurement could do to its pose, if a target estimated it together with all
    /// that was measured; it is not told of a reference.
    pub fn protection(&self) -> Option<Protection> {
        let level = self.report?.joint.filter(|_| !self.is_reference())?;
        let is_bounded = level.position.max(level.heading) < f32::MAX;
        is_bounded.then(|| Protection {
            position: level.position.into(),
            heading_deg: f64::from(level.heading).to_degrees(),
        })
    }

    /// Status of the camera.
    pub fn status(&self) -> Status {
        self.report
            .map_or(Status::Waiting, |report| report.status())
    }

    /// Direction that it sees, as a level camera in its place would; `None` without the row of one that is not level.
    pub(crate) fn upright(&self, seen: Seen) -> Option<Seen> {
        self.report
            .map_or(Some(seen), |report| report.upright(seen))
    }

    /// Why it has no pose.
    pub fn reason(&self) -> Option<Refusal> {
        match self.report?.state {
            CameraState::Refused(refusal) => Some(refusal),
            _ => None,
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

    /// Returns true if it did not answer, though it was asked.
    pub fn is_silent(&self, now: Duration) -> bool {
        let waited = |asked: Duration| now.saturating_sub(asked) >= PATIENCE;
        self.absent || self.asked.is_some_and(waited)
    }

    /// Returns true if it has sightings to tell that it has not told.
    pub fn has_untold_sightings(&self) -> bool {
        let report = self.report.filter(|report| report.duty.is_none());
        report.is_some_and(|report| self.sightings.len() != usize::from(report.sightings))
    }

    /// Fills in what is known of it. Its true place must be there before.
    pub fn describe(&self, node: &mut Node) {
        node.address = Some(self.address);
        node.health = self.health;
        node.heard_seconds = self.heard.map(|at| at.as_secs_f64());
        node.calibrated_seconds = self.posed.map(|at| at.as_secs_f64());
        if !self.is_camera() {
            return;
        }
        node.status = Some(self.status());
        node.reason = self.reason();
        node.moved = self.moved;
        if let Some(pose) = self.pose() {
            node.set_pose(&pose);
        }
        node.protection = self.protection();
        if let Some(report) = self.report {
            node.sightings = report.sightings.into();
            node.used = report.used.into();
            node.chi_squared = Some(report.chi_squared.into());
            node.done = report.done;
            node.lens = report.state.lens().map(|lens| NodeLens {
                projection: lens.projection(),
                fov_deg: lens.field_of_view_deg().into(),
            });
            node.mount = report.mount.map(|mount| {
                let [pitch_deg, roll_deg] = mount.degrees().map(f64::from);
                NodeMount {
                    height: mount.height.into(),
                    pitch_deg,
                    roll_deg,
                }
            });
        }
    }
}

/// The pose as the node sent it.
fn exact(parts: &PoseParts) -> Option<Pose<f64>> {
    let pose = parts.pose()?;
    Some(Pose {
        position: pose.position.map(f64::from),
        heading: pose.heading.into(),
        covariance: pose.covariance.map(f64::from),
    })
}

/// Knowledge that the coordinator has told.
#[derive(Clone, Debug, Default)]
pub struct NetworkView {
    network: Option<Option<NetworkInfo>>,
    members: Vec<Member>,
    key_change: Option<KeyChangeReport>,
    /// People were told that another network has the same PAN identifier.
    told_conflict: bool,
    /// Of the coordinator itself.
    health: Health,
    /// The unit of lengths, where a site's file tells it.
    unit: Option<String>,
    /// When the coordinator last told anything.
    spoke: Option<Duration>,
    /// The references, as the coordinator told them.
    references: Option<References>,
}

/// Returns true if these networks together have so many cameras, at least one, and all are calibrated.
pub fn are_calibrated<'a>(
    views: impl IntoIterator<Item = &'a NetworkView>,
    cameras: usize,
) -> bool {
    let (mut all, mut calibrated) = (0, 0);
    for view in views {
        all += view.cameras().len();
        calibrated += view.calibrated();
    }
    all >= cameras.max(1) && calibrated == all
}

impl NetworkView {
    /// Tells lengths in this unit.
    pub fn tell_in(&mut self, unit: &str) {
        self.unit = Some(unit.to_owned());
    }

    /// Returns true if the coordinator is silent, or never spoke: nothing is known of its members from then on.
    pub fn is_silent(&self, now: Duration) -> bool {
        now.saturating_sub(self.spoke.unwrap_or_default()) >= SILENCE
    }

    /// Takes note that something came damaged: answers may have been lost with it, and are waited for anew.
    pub fn missed(&mut self, now: Duration) {
        let asked = self.members.iter_mut().filter_map(|m| m.asked.as_mut());
        asked.for_each(|asked| *asked = now);
    }

    /// The unit of lengths.
    pub fn unit(&self) -> &str {
        self.unit.as_deref().unwrap_or(UNKNOWN_UNIT)
    }

    /// Its network, if it has one.
    pub fn network(&self) -> Option<NetworkInfo> {
        self.network.flatten()
    }

    /// Health of the coordinator, as it says itself.
    pub fn health(&self) -> Health {
        self.health
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
    pub fn addresses(&self, id: u16) -> Vec<MemberAddress> {
        let of_it = self.members.iter().filter(|member| member.id == id);
        let mut of_it: Vec<_> = of_it.collect();
        of_it.sort_by_key(|member| !member.replaced);
        of_it.iter().map(|member| member.address).collect()
    }

    /// The last change of the site key.
    pub fn key_change(&self) -> Option<KeyChangeReport> {
        self.key_change
    }

    /// The present member of this number.
    pub fn member(&self, id: u16) -> Option<&Member> {
        let mut members = self.members.iter();
        members.find(|member| member.id == id && !member.replaced)
    }

    /// The number of the node that has, or had, this address.
    pub fn id_of(&self, address: MemberAddress) -> Option<u16> {
        let mut members = self.members.iter();
        Some(members.find(|member| member.address == address)?.id)
    }

    /// The cameras that are there, by number.
    pub fn cameras(&self) -> Vec<&Member> {
        let present = self.present().into_iter();
        present.filter(|member| member.is_camera()).collect()
    }

    /// Number of cameras that have the status `calibrated`.
    pub fn calibrated(&self) -> usize {
        let cameras = self.cameras().into_iter();
        cameras
            .filter(|camera| camera.status() == Status::Calibrated)
            .count()
    }

    /// Returns true if a sighting that the camera at this address tells is one that it had not told, of a stop
    /// that began while the PC listened.
    pub fn is_seen_now(&self, address: MemberAddress, told: &ListedSighting) -> bool {
        let at = |address| self.members.iter().find(|m| m.address == address);
        let same = |known: &ListedSighting| (known.target, known.stop) == (told.target, told.stop);
        let is_known = at(address).is_none_or(|camera| camera.sightings.values().any(same));
        !is_known && at(told.target).is_some_and(|target| target.stops.contains_key(&told.stop))
    }

    /// The member at this address is asked for its sightings.
    pub fn asks(&mut self, now: Duration, address: MemberAddress) {
        let mut members = self.members.iter_mut();
        if let Some(member) = members.find(|member| member.address == address) {
            member.asked.get_or_insert(now);
        }
    }

    /// Takes a message. Returns the news in words for people, if there is any.
    pub fn take(&mut self, now: Duration, message: &ToPc) -> Option<String> {
        self.spoke = Some(now);
        let news = self.learn(now, message);
        let told = match *message {
            // The coordinator tells these again when it is asked, for every member.
            ToPc::Member { address, .. } | ToPc::Report { address, .. } if news.is_some() => {
                address
            }
            ToPc::Done { address, done } if done.outcome.is_success() => address,
            ToPc::Tracked { address, .. }
            | ToPc::Sighting { address, .. }
            | ToPc::Stopped { address, .. } => address,
            _ => return news,
        };
        let mut members = self.members.iter_mut();
        if let Some(member) = members.find(|member| member.address == told) {
            member.heard = Some(now);
        }
        news
    }

    fn learn(&mut self, now: Duration, message: &ToPc) -> Option<String> {
        match *message {
            ToPc::Network(network) => {
                let is_news = self.network.replace(network) != Some(network);
                is_news.then(|| match network {
                    Some(NetworkInfo { pan, channel }) => {
                        format!("network {pan:04x} on channel {channel}")
                    }
                    None => "no network yet: the coordinator looks for a free one".to_owned(),
                })
            }
            ToPc::Member { address, hello } => self.hello(address, hello),
            ToPc::Report { address, report } => self.report(now, address, report),
            ToPc::Done { address, done } => {
                Some(format!(
                    "{}: {}: {}",
                    self.name(address),
                    command_name(done.command),
                    done.outcome
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
            ToPc::Sighting { address, sighting } => {
                self.sighting(address, sighting);
                None
            }
            ToPc::Pan { changes: true, .. } => {
                self.told_conflict = false;
                Some("the network takes another PAN identifier".to_owned())
            }
            ToPc::Pan { conflict_s, .. } => conflict_s
                .filter(|_| !std::mem::replace(&mut self.told_conflict, true))
                .map(|seconds| {
                    format!(
                        "another network with the same PAN identifier was heard {seconds} s ago, or \
                         another device pretends to be one: `host-sim console --change-pan` takes another"
                    )
                }),
            ToPc::Health { address, health } => {
                let name = self.name(address);
                let known = match address {
                    address if address == COORDINATOR.0 => &mut self.health,
                    _ => &mut self.at(address)?.health,
                };
                let before = std::mem::replace(known, health);
                (before != health).then(|| format!("{name}: {}", health_words(&health)))
            }
            ToPc::Reference { address, present } => {
                let name = self.name(address);
                let member = self.at(address)?;
                let is_news = std::mem::replace(&mut member.absent, !present) == present;
                is_news.then(|| match present {
                    true => format!("{name}: the reference camera answers again"),
                    false => format!(
                        "{name}: the reference camera does not answer, and no camera gets a pose without \
                         it: check its power and its radio, or put another one in its place"
                    ),
                })
            }
            ToPc::References(references) => self.appoint(references),
            ToPc::Stopped {
                address,
                stop,
                place,
            } => {
                let finite = |(p, c): &SitePlace| p.iter().chain(c).all(|x| x.is_finite());
                let place = place.filter(finite);
                let known = self.at(address)?.stops.entry(stop).or_insert((now, None));
                known.1 = place.or(known.1);
                None
            }
            // `Tracked` and `Object` are not asked for here.
            _ => None,
        }
    }

    /// Duty of the camera with this address, as the coordinator told it.
    fn duty_of(&self, address: MemberAddress) -> Option<Duty> {
        let References { first, second, .. } = self.references?;
        let duties = [(first, Duty::First), (second, Duty::Second)];
        duties
            .into_iter()
            .find_map(|(of, duty)| (of == address).then_some(duty))
    }

    /// These are the references. It is news where they were elected.
    fn appoint(&mut self, references: Option<References>) -> Option<String> {
        self.references = references;
        let mut is_news = false;
        for n in 0..self.members.len() {
            let duty = self.duty_of(self.members[n].address);
            let member = &mut self.members[n];
            let is_elected = member.kind == Some(MemberKind::Camera { reference: None });
            is_news |= std::mem::replace(&mut member.appointed, duty) != duty && is_elected;
        }
        let References { first, second, .. } = references?;
        is_news.then(|| {
            let [first, second] = [first, second].map(|address| self.name(address));
            format!("{first} and {second} are the reference cameras")
        })
    }

    fn at(&mut self, address: MemberAddress) -> Option<&mut Member> {
        let mut members = self.members.iter_mut();
        members.find(|member| member.address == address)
    }

    /// Name that people know of the member at an address.
    fn name(&self, address: MemberAddress) -> String {
        match self.members.iter().find(|member| member.address == address) {
            Some(member) => format!("{} {}", member.kind_name(), member.id),
            None if address == COORDINATOR.0 => "coordinator".to_owned(),
            None => format!("address {address:04x}"),
        }
    }

    /// The member at an address, if it is this node; made if there was none. The flag is true if it was made.
    fn member_at(&mut self, address: MemberAddress, id: u16) -> (&mut Member, bool) {
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
                health: Health::default(),
                absent: false,
                replaced: false,
                heard: None,
                posed: None,
                good: None,
                former: None,
                doubted: None,
                moved: None,
                appointed: self.duty_of(address),
                sightings: BTreeMap::new(),
                asked: None,
                stops: BTreeMap::new(),
            });
        }
        let last = self.members.len() - 1;
        (&mut self.members[place.unwrap_or(last)], place.is_none())
    }

    fn hello(&mut self, address: MemberAddress, hello: Hello) -> Option<String> {
        let (member, is_new) = self.member_at(address, hello.id);
        let is_news = member.kind.replace(hello.kind) != Some(hello.kind) || is_new;
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

    fn report(&mut self, now: Duration, address: MemberAddress, report: Report) -> Option<String> {
        let (member, _) = self.member_at(address, report.id);
        let is_news = member.report.replace(report) != Some(report);
        if report.pose().is_some() {
            member.posed.get_or_insert(now);
        }
        let moved = member.compare(now);
        let address = member.address;
        let member = self.members.iter().find(|own| own.address == address);
        { member.filter(|_| is_news) }.map(|member| {
            let progress = Progress(member, self.unit());
            match moved {
                Some(moved) => format!("{progress}; {}", move_words(&moved, self.unit())),
                None => progress.to_string(),
            }
        })
    }
}

/// Chi squared, with three degrees of freedom, by which another pose confirms a doubt: chance exceeds it once in a hundred
/// times.
const CONFIRMS_DOUBT: f32 = 11.3;
/// Pause of reports that parts one walk from the next. The first sightings after a move may still be taken for the former
/// place, so poses are compared with those of the walk before.
const PAUSE: Duration = Duration::from_secs(3600);

impl Member {
    /// Compares the pose that it just told with that of the walk before. Returns a move that this tells, once.
    fn compare(&mut self, now: Duration) -> Option<NodeMove> {
        let status = self.status();
        if status == Status::Doubtful && self.good.is_some() {
            self.doubted.get_or_insert(now);
        }
        let pose = self.report?.pose()?.pose();
        let pose = pose.filter(|_| status == Status::Calibrated)?;
        let last = self.good.replace((now, pose))?;
        if last.0 + PAUSE < now {
            self.former = Some(last);
        }
        let doubted = self.doubted.take();
        let (after, former) = self.former?;
        let limit = doubted.map_or(CONTRADICTION, |_| CONFIRMS_DOUBT);
        let is_moved = contradiction(&former, &pose) > limit;
        let after_seconds = after.as_secs_f64();
        let told = self
            .moved
            .filter(|told| told.after_seconds == after_seconds);
        if !is_moved && told.is_none() {
            return None;
        }
        let moved = NodeMove {
            after_seconds,
            noticed_seconds: told.map_or(doubted.unwrap_or(now).as_secs_f64(), |told| {
                told.noticed_seconds
            }),
            distance: (pose.position - former.position).norm().into(),
            turn_deg: wrap_signed(pose.heading - former.heading)
                .to_degrees()
                .into(),
        };
        self.moved = Some(moved);
        told.is_none().then_some(moved)
    }
}

impl NetworkView {
    /// A camera lists all that it has, from the first to the last.
    fn sighting(&mut self, address: MemberAddress, sighting: ListedSighting) {
        let mut members = self.members.iter_mut();
        if let Some(member) = members.find(|member| member.address == address) {
            member.asked = None;
            member.sightings.insert(sighting.index, sighting);
            // It may have forgotten others since.
            member.sightings.retain(|index, _| *index < sighting.count);
        }
    }
}

/// Progress of a camera, in words, with the unit of lengths. Places are told in the table, which knows their frame.
struct Progress<'a>(&'a Member, &'a str);

impl fmt::Display for Progress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(member, unit) = *self;
        write!(f, "camera {}: ", member.id)?;
        let status = member.status();
        match member.estimate() {
            Some(e) => write!(
                f,
                "{status}: sigma of its place {:.3} {unit}, of its heading {:.2} deg",
                e.sigma_position(),
                e.sigma_heading_deg
            )?,
            None => f.write_str(&status_words(status, member.reason()))?,
        }
        if let Some(level) = member.protection() {
            let Protection {
                position,
                heading_deg,
            } = level;
            f.write_str("; one unnoticed wrong measurement ")?;
            match level.is_boundless() {
                true => f.write_str("may put it anywhere")?,
                false => write!(
                    f,
                    "moves it by {position:.2} {unit} and turns it by {heading_deg:.1} deg at most"
                )?,
            }
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

/// Progress of a change of the key, in words.
struct KeyNews(KeyChangeReport);

impl fmt::Display for KeyNews {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let KeyChangeReport {
            index,
            done,
            unreached,
            ..
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
mod tests {
    use calib_core::Refusal;

    use super::*;
    use crate::record::{Role, verdict::Verdict};

    const NOW: Duration = Duration::ZERO;

    const CAMERA: MemberKind = MemberKind::Camera { reference: None };

    fn member(address: MemberAddress, id: u16, kind: MemberKind) -> ToPc {
        let hello = Hello { id, kind };
        ToPc::Member { address, hello }
    }

    fn reported(address: MemberAddress, id: u16, state: CameraState) -> ToPc {
        let report = Report {
            id,
            duty: None,
            sightings: 4,
            used: 3,
            chi_squared: 1.5,
            done: false,
            joint: None,
            state,
            mount: None,
        };
        ToPc::Report { address, report }
    }

    fn pose() -> CameraState {
        CameraState::Calibrated(PoseParts {
            position: [1.0, -2.0],
            heading: core::f32::consts::FRAC_PI_2,
            covariance: [0.04, 0.0, 0.09, 0.0, 0.0, 0.0001],
        })
    }

    #[test]
    fn only_changes_are_news() {
        let mut known = NetworkView::default();
        let messages = [
            ToPc::Network(None),
            ToPc::Network(Some(NetworkInfo {
                pan: 0xABC,
                channel: 15,
            })),
            member(1, 7, CAMERA),
            reported(1, 7, CameraState::Waiting),
            reported(1, 7, CameraState::Refused(Refusal::DangerCircle)),
            reported(1, 7, pose()),
        ];
        let news: Vec<_> = messages
            .iter()
            .map(|m| known.take(NOW, m).unwrap())
            .collect();
        assert_eq!(news[1], "network 0abc on channel 15");
        assert_eq!(news[2], "camera 7: member with address 0001");
        assert_eq!(
            news[4],
            "camera 7: no pose: the camera is on the circle through the targets: stop the target \
             nearer or farther; 4 sightings"
        );
        assert_eq!(
            news[5],
            "camera 7: calibrated: sigma of its place 0.361 units, of its heading 0.57 deg; 4 sightings"
        );
        for message in [&messages[1], &messages[2], &messages[5]] {
            assert_eq!(known.take(NOW, message), None);
        }
    }

    /// The coordinator tells which cameras it elected, before they have a pose: that is news once, and the record has them.
    #[test]
    fn elected_references_are_known_before_they_have_a_pose() {
        let mut known = NetworkView::default();
        for id in [4, 5, 6] {
            known.take(NOW, &member(id, id, MemberKind::Camera { reference: None }));
        }
        let references = |first, second| {
            let positions = None;
            ToPc::References(Some(References {
                first,
                second,
                positions,
            }))
        };
        let news = known.take(NOW, &references(6, 4));
        assert_eq!(
            news.unwrap(),
            "camera 6 and camera 4 are the reference cameras"
        );
        assert_eq!(known.take(NOW, &references(6, 4)), None);
        let of = |known: &NetworkView| {
            let record = known.record(NOW, None);
            let cameras = record.cameras().filter(|camera| camera.reference);
            cameras.map(|camera| camera.id).collect::<Vec<_>>()
        };
        assert_eq!(of(&known), [4, 6]);
        // They gave way.
        assert_eq!(known.take(NOW, &ToPc::References(None)), None);
        assert!(of(&known).is_empty());
        // Told before its hello.
        known.take(NOW, &references(6, 7));
        known.take(NOW, &member(7, 7, MemberKind::Camera { reference: None }));
        assert_eq!(of(&known), [6, 7]);
    }

    /// A camera that was turned by 5 degrees: at once, or after a doubt, and never of itself.
    #[test]
    fn a_move_is_told_once() {
        let turned = |degrees: f32| {
            CameraState::Calibrated(PoseParts {
                position: [1.0, -2.0],
                heading: degrees.to_radians(),
                covariance: [0.04, 0.0, 0.09, 0.0, 0.0, 0.0001],
            })
        };
        let doubtful = |degrees| match turned(degrees) {
            CameraState::Calibrated(parts) => CameraState::Doubtful(parts),
            other => other,
        };
        let mut known = NetworkView::default();
        let mut tell = |minutes: u64, state| {
            let now = Duration::from_secs(60 * minutes);
            known.take(now, &reported(1, 7, state)).unwrap()
        };
        let day = 24 * 60;
        assert!(!tell(0, turned(90.0)).contains("moved"));
        assert!(!tell(day, turned(91.0)).contains("moved"));
        assert!(!tell(2 * day, doubtful(91.0)).contains("moved"));
        let told = tell(2 * day + 9, turned(96.0));
        let words = "; moved by 0.00 units and turned by 5.0 deg after 24.0 h, noticed at 48.0 h";
        assert!(told.ends_with(words), "{told}");
        // More of the same walk is no other move.
        assert!(!tell(2 * day + 12, turned(97.0)).contains("moved"));
        // A doubt that the same pose ends was none.
        assert!(!tell(3 * day, doubtful(97.0)).contains("moved"));
        assert!(!tell(3 * day + 5, turned(97.1)).contains("moved"));
        // The first pose of a walk may still lie between the two.
        assert!(!tell(4 * day, turned(99.1)).contains("moved"));
        let told = tell(4 * day + 6, turned(107.1));
        let words = "turned by 10.0 deg after 3.00 days, noticed at 4.00 days";
        assert!(told.ends_with(words), "{told}");
        let moved = known.members[0].moved.unwrap();
        assert!((moved.noticed_seconds - (4.0 * 86_400.0 + 360.0)).abs() < 1.0);
    }

    /// When it began is when it was told first, and the place the one told last.
    #[test]
    fn stops_of_a_target_are_told() {
        let mut known = NetworkView::default();
        known.take(NOW, &member(9, 4, MemberKind::Target));
        let told = |place| ToPc::Stopped {
            address: 9,
            stop: 3,
            place,
        };
        let place = |x| Some(([x, 2.0], [0.04, 0.0, 0.09]));
        let mut stops = |seconds, place| {
            known.take(Duration::from_secs(seconds), &told(place));
            known.record(NOW, None).targets[0].stops.clone()
        };
        assert_eq!(stops(10, None), []);
        assert_eq!(stops(11, place(f32::NAN)), []);
        let [first] = stops(12, place(1.0))[..] else {
            panic!("one stop")
        };
        assert_eq!((first.stop, first.seconds), (3, Some(10.0)));
        let [last] = stops(13, place(5.0))[..] else {
            panic!("one stop")
        };
        assert_eq!((last.x, last.y, last.seconds), (5.0, 2.0, Some(10.0)));
        let sigma_y = last.believed.unwrap().sigma_y;
        assert!((sigma_y - 0.3).abs() < 1e-6);
    }

    #[test]
    fn calibrated_is_who_has_poses_only() {
        let mut known = NetworkView::default();
        assert!(!are_calibrated([&known], 0), "there is no camera");
        known.take(NOW, &member(9, 4, MemberKind::Target));
        known.take(NOW, &member(1, 7, CAMERA));
        assert!(!are_calibrated([&known], 0));
        known.take(NOW, &reported(1, 7, pose()));
        assert!(are_calibrated([&known], 0));
        assert!(!are_calibrated([&known], 2), "another one is awaited");
        known.take(NOW, &reported(2, 8, CameraState::Refused(Refusal::TooFew)));
        assert!(!are_calibrated([&known], 0));
        known.take(NOW, &reported(2, 8, pose()));
        assert!(are_calibrated([&known], 2));
    }

    /// Cameras of whom nothing is told because nothing is told at all are not called silent, nor those whose
    /// answers were damaged on the line.
    #[test]
    fn a_silent_coordinator_is_told_as_such() {
        let at = Duration::from_secs;
        let mut known = NetworkView::default();
        known.take(at(0), &member(1, 7, CAMERA));
        known.take(at(0), &reported(1, 7, pose()));
        known.asks(at(1), 1);
        let silent = |known: &NetworkView, now| {
            let record = known.record(at(now), None);
            let nodes = record.nodes.iter().filter(|node| node.silent);
            nodes.map(|node| (node.id, node.role)).collect::<Vec<_>>()
        };
        assert_eq!(silent(&known, 19), []);
        let coordinator = (::site::coordinator_id(0), Role::Coordinator);
        assert_eq!(silent(&known, 300), [coordinator]);
        let words = Verdict::of(&known.record(at(300), None)).to_string();
        let told = "coordinator 60000: nothing comes on its line since 0 s";
        assert!(words.contains(told), "{words}");
        assert!(!words.contains("camera 7: it does not answer"), "{words}");
        // It answers, and the camera does not.
        known.take(at(310), &ToPc::Network(None));
        assert_eq!(silent(&known, 310), [(7, Role::Camera)]);
        known.missed(at(310));
        assert_eq!(silent(&known, 311), []);
        known.take(at(324), &ToPc::Network(None));
        assert_eq!(silent(&known, 324), []);
        known.take(at(326), &ToPc::Network(None));
        assert_eq!(silent(&known, 326), [(7, Role::Camera)]);
    }

    #[test]
    fn a_coordinator_that_never_spoke_is_named() {
        let known = NetworkView::default();
        let words = |seconds| {
            let record = known.record(Duration::from_secs(seconds), None);
            Verdict::of(&record).to_string()
        };
        assert_eq!(
            words(5),
            "0 of 0 cameras are calibrated: none is known yet.\n"
        );
        let silent = words(30);
        assert!(
            silent.contains("coordinator 60000: nothing has come on its line"),
            "{silent}"
        );
    }

    #[test]
    fn who_joins_again_has_one_present_address() {
        let mut known = NetworkView::default();
        known.take(NOW, &member(5, 7, CAMERA));
        known.take(NOW, &member(3, 7, CAMERA));
        known.take(NOW, &reported(3, 7, pose()));
        // A refresh tells the former address first, every time.
        assert_eq!(known.take(NOW, &member(5, 7, CAMERA)), None);
        assert_eq!(known.addresses(7), [5, 3]);
        assert_eq!(known.present().len(), 1);
        assert!(are_calibrated([&known], 0));
        // Its place is given to another node.
        let success = true;
        known.take(
            NOW,
            &ToPc::Removed {
                address: 5,
                success,
            },
        );
        known.take(NOW, &member(5, 8, CAMERA));
        assert_eq!(known.addresses(7), [3]);
        assert_eq!(known.addresses(8), [5]);
        known.take(NOW, &member(3, 9, CAMERA));
        assert!(
            known.addresses(7).is_empty(),
            "another node has its address"
        );
    }
}
