//! The verdict in sentences.

use std::{collections::BTreeMap, fmt};

use calib_core::{Refusal, Status, camera::Projection};
use node_firmware::message::{Eye, Health, Memory, Restart};

use crate::record::{NodeMount, NodeMove};

use super::{
    Cause, Common, Failing, Finding, Gain, Gained, InView, Instead, NextStop, Protection, Role,
    Trouble, Verdict, Weakness,
};

/// Things to look at, in a rehearsal and of a real node.
const NEVER_JOINED: [&str; 2] = [
    "it never joined: look at `radio`, at distances and at events",
    "it never joined: check its power, its site key, the join window and its distance",
];

/// A status in words for people, with the reason where there is one: the problem and what to do.
pub fn status_words(status: Status, reason: Option<Refusal>) -> String {
    match (status, reason) {
        (Status::Refused, Some(refusal)) => format!("no pose: {refusal}"),
        (Status::Refused, None) => "no pose: its sightings give none".to_owned(),
        (Status::Waiting, _) => "waits for sightings: stop the target in its view".to_owned(),
        (Status::Weak, _) => "weak: not certain or not tested enough".to_owned(),
        (Status::Doubtful, _) => "doubtful: its sightings contradict each other".to_owned(),
        (Status::Calibrated, _) => "calibrated".to_owned(),
    }
}

/// Description of a node's health, as it says itself, with advice.
pub fn health_words(health: &Health) -> String {
    let memory = match health.memory {
        Memory::Flash => None,
        Memory::Ram => Some(
            "its flash is worn out or damaged: it works from RAM, and forgets all when it restarts; \
             replace the board",
        ),
    };
    let camera = match health.camera {
        Eye::Sees => None,
        Eye::Blind => Some(
            "blind: it adapted to the light, and still does not see the target where it should; look \
             at what is before its lens, at the light, and at the colour that it looks for",
        ),
        Eye::Hidden => Some(
            "it sees only a part of the target again and again, and does not use that; look at what stands \
             before its lens",
        ),
        Eye::Several => Some(
            "something else has the target's colour, or only a part of the target has it, and the camera does \
             not use what it sees; look at its view, and let it learn the colour again",
        ),
        Eye::Failed => Some(
            "its camera does not answer, or its picture does not change; check its line, its power \
             and its lens",
        ),
    };
    let restart = match health.restart {
        Restart::Ordinary => None,
        Restart::RadioDeaf => Some("it restarted by itself: its radio heard nothing any more"),
        Restart::RadioStuck => Some("it restarted by itself: its radio did not end a transmission"),
        Restart::CameraStuck => Some("it restarted by itself: the driver of its camera stuck"),
        Restart::Program => Some("it restarted by itself: its program broke or stood still"),
    };
    let steps = health.steps.map(|fault| {
        format!(
            "{fault}; until it works again, stop at marked places and tell each one (`host-sim console --stands ID:X,Y`)"
        )
    });
    let all: Vec<&str> = [memory, camera, restart, steps.as_deref()]
        .into_iter()
        .flatten()
        .collect();
    match all.is_empty() {
        true => "well".to_owned(),
        false => all.join("; "),
    }
}

fn role(role: Role) -> &'static str {
    match role {
        Role::Coordinator => "coordinator",
        Role::Camera => "camera",
        Role::Target => "target",
    }
}

/// When a node was last heard.
struct Since(Option<f64>);

impl fmt::Display for Since {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it does not answer: check its power and its radio; ")?;
        match self.0 {
            Some(seconds) => write!(f, "last heard at {seconds:.0} s"),
            None => f.write_str("it was never heard"),
        }
    }
}

/// Move of a camera, in words.
pub(crate) fn move_words(moved: &NodeMove, unit: &str) -> String {
    let NodeMove {
        after_seconds,
        noticed_seconds,
        distance,
        turn_deg,
    } = *moved;
    format!(
        "moved by {distance:.2} {unit} and turned by {turn_deg:.1} deg after {}, noticed at {}",
        Moment(after_seconds),
        Moment(noticed_seconds)
    )
}

/// A time of a run that may last for months.
struct Moment(f64);

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (hour, day) = (3_600.0, 86_400.0);
        match self.0 {
            seconds if seconds < 3.0 * hour => write!(f, "{seconds:.0} s"),
            seconds if seconds < 3.0 * day => write!(f, "{:.1} h", seconds / hour),
            seconds => write!(f, "{:.2} days", seconds / day),
        }
    }
}

impl fmt::Display for Failing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let role = role(self.role);
        let Self {
            node, times, why, ..
        } = self;
        write!(f, "{role} {node}: its firmware could not go on ")?;
        match times {
            1 => write!(f, "once, and was started again: {why}"),
            _ => write!(
                f,
                "{times} times, and was started again; the last time: {why}"
            ),
        }
    }
}

impl Finding {
    /// Writes the problem, without the name of the camera.
    fn write(&self, f: &mut fmt::Formatter<'_>, verdict: &Verdict) -> fmt::Result {
        let (unit, never_joined) = (&verdict.unit, verdict.never_joined());
        match &self.trouble {
            Trouble::NeverJoined => write!(f, "not calibrated: {never_joined}"),
            Trouble::Fails(_) => f.write_str("not calibrated: its board fails, see below"),
            Trouble::Silent(since) => write!(f, "{}", Since(*since)),
            Trouble::NeverSaw(in_view) => {
                f.write_str("not calibrated: it never saw the target standing still")?;
                match in_view {
                    InView::Stops(count) => write!(
                        f,
                        ", though {count} of its stops are in its view: check the camera, and the \
                         colour that it looks for"
                    ),
                    InView::Elsewhere => f.write_str(", and no stop is in its view"),
                    InView::Sealed => f.write_str(
                        ": it is in a sealed room; no place of the target's path, nor any that can \
                         be walked to from there, is in its view",
                    ),
                    InView::Unknown => Ok(()),
                }
            }
            Trouble::TooFew(n) => write!(f, "not calibrated: {n} of the 3 sightings it needs"),
            Trouble::Refused(Refusal::Inconsistent) => write!(
                f,
                "not calibrated: {}; if that does not help, check lenses and the carrier",
                Refusal::Inconsistent
            ),
            Trouble::Refused(refusal) => write!(f, "not calibrated: {refusal}"),
            Trouble::NoReferences if verdict.references.contains(&self.camera) => f.write_str(
                "not calibrated: no reference has a pose; three stops at least that both of them see are needed",
            ),
            Trouble::NoReferences => f.write_str(
                "not calibrated: the two reference cameras come first, and have no answer yet",
            ),
            Trouble::NoTarget => f.write_str(
                "not calibrated: its network has no references, and waits for a target from another \
                 network",
            ),
            Trouble::NoPose => f.write_str("not calibrated: its pose did not arrive"),
            Trouble::Doubtful {
                agreeing: Some([agreeing, all]),
                ..
            } => write!(
                f,
                "not calibrated: doubtful, it may have been moved, or is stuck: only {agreeing} of its \
                 {all} sightings agree with what everybody else saw. Look at it; then stop the target \
                 four times more in its view"
            ),
            Trouble::Doubtful {
                ratio,
                sigma_position,
                cause,
                agreeing: None,
            } => {
                f.write_str("not calibrated: doubtful, its sightings contradict each other")?;
                if let Some(ratio) = ratio.filter(|ratio| *ratio > 1.0) {
                    write!(f, ", residuals {ratio:.1} times too large")?;
                }
                let advice = match cause {
                    Some(Cause::Sight) => {
                        "it does not see the target where it is: look at its lens, and at what it \
                         takes for the target"
                    }
                    Some(Cause::Carrier) => {
                        "the target was not where it believed to be: look at the carrier"
                    }
                    None => "look at what it takes for the target, at its lens, and at the carrier",
                };
                write!(f, ", predicted sigma {sigma_position:.3} {unit}: {advice}")
            }
            Trouble::Mirrored => f.write_str(
                "not calibrated: it hangs upside down, or its picture is mirrored; its sightings fit once left and \
                 right are exchanged. Turn it over, then walk again",
            ),
            Trouble::OtherLens(lens) => {
                let projection = match lens.projection {
                    Projection::PinHole => "a pin-hole",
                    Projection::EqualAngle => "equal angles",
                };
                write!(
                    f,
                    "not calibrated: doubtful, its sightings do not fit the configured lens: {projection} \
                     of {:.1} deg does; correct `field_of_view_deg` or `projection` if that is its lens, and \
                     look at its lens if not",
                    lens.fov_deg
                )
            }
            Trouble::Tilted(NodeMount {
                pitch_deg, height, ..
            }) => {
                let down = if *pitch_deg < 0.0 { "up" } else { "down" };
                write!(
                    f,
                    "not calibrated: doubtful: its rows tell of a camera {height:.1} {unit} above the ball that looks \
                     {down} by {:.0} deg, and do not all fit that; level it, and look at what it takes for the target",
                    pitch_deg.abs()
                )
            }
            Trouble::Untested { is_reference } => f.write_str(if *is_reference {
                "not calibrated: weak: no target has estimated it with everything else"
            } else {
                "not calibrated: weak: it hangs on a single measurement, and several others were wrong"
            }),
            Trouble::Weak {
                sigma_position,
                sigma_heading_deg,
            } => write!(
                f,
                "not calibrated: weak, predicted sigma {sigma_position:.3} {unit}, \
                 {sigma_heading_deg:.2} deg"
            ),
            Trouble::Wild { stop, sigmas } => {
                let mut stood = verdict.stood.keys();
                let target = stood.find(|(_, other)| other == stop);
                let at = AtStop(verdict, target.map_or(0, |(target, _)| *target), *stop);
                write!(f, "its sighting of the target at {at} is {sigmas:.0} sigmas off")
            }
            // Told together.
            Trouble::Unchecked { .. } => Ok(()),
            Trouble::Deceives(sigmas) => write!(
                f,
                "its pose is {sigmas:.1} predicted sigmas off the truth: it deceives"
            ),
        }
    }
}

/// Describes whether a pose is checked: what one wrong measurement could do to it.
pub fn check_words(level: Option<&Protection>, is_tolerated: bool, unit: &str) -> String {
    match level {
        Some(level) => {
            let Protection {
                position,
                heading_deg,
            } = level;
            let not = if is_tolerated { "" } else { "not " };
            let could = match level.is_boundless() {
                true => "put it anywhere".to_owned(),
                false => {
                    format!("move it by {position:.2} {unit} and turn it by {heading_deg:.1} deg")
                }
            };
            format!("{not}checked: one wrong measurement that was not noticed could {could}")
        }
        None => "not checked: no target has estimated it together with the others".to_owned(),
    }
}

/// Measurement behind a weakness of this camera's pose, or of several.
struct Remedy<'a>(&'a Verdict, Option<Weakness>, Option<u16>);

impl fmt::Display for Remedy<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(verdict, weakness, of) = *self;
        match (weakness, of) {
            (Some(Weakness::Leg { target, from, to }), _) => {
                let [from, to] = [from, to].map(|stop| AtStop(verdict, target, stop));
                write!(f, "the weakest measurement is the leg from {from} to {to}")
            }
            (Some(Weakness::Sightings { camera }), of) if of != Some(camera) => {
                write!(
                    f,
                    "the weakest measurement is a sighting of camera {camera}"
                )
            }
            (Some(Weakness::TooFew), Some(_)) => f.write_str("it has too few sightings"),
            (Some(Weakness::TooFew), None) => f.write_str("each has too few sightings"),
            (_, Some(_)) => f.write_str("the weakest measurement is one of its own sightings"),
            (_, None) => f.write_str("the weakest measurement of each is one of its own sightings"),
        }
    }
}

/// Place of a target's stop: its number tells a reader little, and is told where the place is not known.
struct AtStop<'a>(&'a Verdict, u16, u32);

impl fmt::Display for AtStop<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(verdict, target, stop) = *self;
        match verdict.stood.get(&(target, stop)) {
            Some((network, place)) => {
                let [x, y] = verdict.told_place(*network, *place);
                write!(f, "({x:.1}, {y:.1})")
            }
            None => write!(f, "stop {stop}"),
        }
    }
}

/// An improvement, with the unit of lengths.
struct Gains<'a>(&'a Gain, &'a str);

impl fmt::Display for Gains<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(gain, unit) = *self;
        let Gain {
            camera,
            of,
            from,
            to,
        } = gain;
        match of {
            Gained::Sigma => write!(
                f,
                "camera {camera} from {from:.2} {unit} to about {to:.2} {unit}"
            ),
            Gained::Protection => write!(
                f,
                "one wrong measurement then moves camera {camera} by about {to:.2} {unit}, not {from:.2} {unit}"
            ),
        }
    }
}

/// Frame of places that are told, where no site file tells where the network is.
const FRAME: &str = "Places count from the first reference camera, x towards the second: no site file tells where they are.";

/// A finding in words, with the unit of lengths.
struct Told<'a>(&'a Finding, &'a Verdict);

impl fmt::Display for Told<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(finding, verdict) = *self;
        finding.write(f, verdict)
    }
}

impl Verdict {
    /// Description of one camera's problem, with advice, without its name.
    pub fn words_on(&self, finding: &Finding) -> String {
        if let Trouble::Unchecked {
            protection,
            weakness,
        } = &finding.trouble
        {
            let remedy = Remedy(self, *weakness, Some(finding.camera));
            let check = check_words(protection.as_ref(), false, &self.unit);
            return format!("{check}: {remedy}");
        }
        Told(finding, self).to_string()
    }

    fn never_joined(&self) -> &'static str {
        NEVER_JOINED[usize::from(!self.is_rehearsal)]
    }

    /// The weak poses together, with the largest sigmas.
    fn weak(&self) -> Option<String> {
        let sigmas = |finding: &Finding| match finding.trouble {
            Trouble::Weak {
                sigma_position,
                sigma_heading_deg,
            } => Some((finding.camera, [sigma_position, sigma_heading_deg])),
            _ => None,
        };
        let (ids, sigmas): (Vec<u16>, Vec<_>) = self.findings.iter().filter_map(sigmas).unzip();
        let [sigma_position, sigma_heading_deg] =
            { sigmas.into_iter() }.reduce(|[a, b], [c, d]| [a.max(c), b.max(d)])?;
        let weakest = Trouble::Weak {
            sigma_position,
            sigma_heading_deg,
        };
        let finding = Finding {
            camera: ids[0],
            trouble: weakest,
        };
        let most = if ids.len() > 1 { " at most" } else { "" };
        Some(format!(
            "{}: {}{most}",
            cameras(&ids),
            self.words_on(&finding)
        ))
    }

    /// The unchecked poses, together where one measurement is behind several, or all together at a glance.
    fn unchecked(&self, at_a_glance: bool) -> Vec<String> {
        let mut by_weakness = BTreeMap::<_, Vec<(u16, Option<Protection>)>>::new();
        for Finding { camera, trouble } in &self.findings {
            if let Trouble::Unchecked {
                protection,
                weakness,
            } = trouble
            {
                // A sighting of its own: told once of all such cameras.
                let weakness = weakness.filter(
                    |weakness| !matches!(weakness, Weakness::Sightings { camera: of } if of == camera),
                );
                let key = if at_a_glance { None } else { Some(weakness) };
                let of_it = by_weakness.entry(key).or_default();
                of_it.push((*camera, *protection));
            }
        }
        let told = by_weakness.into_iter().map(|(weakness, unchecked)| {
            let ids: Vec<u16> = unchecked.iter().map(|(id, _)| *id).collect();
            let levels = unchecked.iter().filter_map(|(_, level)| *level);
            let worst = levels.reduce(Protection::or);
            let only = <[u16; 1]>::try_from(ids.as_slice());
            let check = check_words(worst.as_ref(), false, &self.unit);
            let cameras = cameras(&ids);
            match weakness {
                Some(weakness) => {
                    let remedy = Remedy(self, weakness, only.ok().map(|[id]| id));
                    format!("{cameras}: {check}: {remedy}")
                }
                None => format!("{cameras}: {check}"),
            }
        });
        told.collect()
    }

    /// The last of these stops.
    fn next_words(&self, stops: &[NextStop]) -> String {
        let Some((stop, before)) = stops.split_last() else {
            return String::new();
        };
        let mut before = { before.iter() }.filter(|other| other.network == stop.network);
        let first = before.clone().next().is_none();
        let is_there = |other: &NextStop| (other.x, other.y) == (stop.x, stop.y);
        let lead = if first { "Next" } else { "Then" };
        let mut words = match (self.has_networks, first) {
            (true, _) => format!("{lead} in network {}: ", stop.network),
            (false, true) => format!("{lead}: "),
            (false, false) => format!("{lead} "),
        };
        words += match stop.again.is_some() || before.any(is_there) {
            true => "walk back to about ",
            false => "stop the target about ",
        };
        let seen_by = cameras(&stop.seen_by);
        let [x, y] = self.told_place(stop.network, [stop.x, stop.y]);
        words += &format!("({x:.1}, {y:.1}), in view of {seen_by}");
        if let Some(gain) = &stop.helps {
            words += &format!(": {}", Gains(gain, &self.unit));
        }
        words
    }

    fn instead_words(&self) -> Option<String> {
        let mut words = match (self.stops_in_vain, self.instead.is_empty()) {
            (false, true) => return None,
            (true, true) => return Some("The last stops improved nothing.".to_owned()),
            (false, false) => "No further stop helps.",
            (true, false) => "The last stops improved nothing.",
        }
        .to_owned();
        words += " These changes would help:";
        for (number, instead) in self.instead.iter().enumerate() {
            words += if number == 0 { " " } else { "; or " };
            words += &match instead {
                Instead::Carrier(target, _) => {
                    format!("measure the carrier of target {target} to 1 % and 1 deg")
                }
                Instead::References([a, b], _) => {
                    format!("make cameras {a} and {b} the references")
                }
                Instead::Lens(_) => "lenses of 1.5 times the field of view".to_owned(),
                Instead::Camera([a, b], _) => {
                    format!("one more camera half way between cameras {a} and {b}")
                }
                Instead::Tape {
                    camera,
                    target,
                    stop,
                    ..
                } => {
                    let at = AtStop(self, *target, *stop);
                    format!(
                        "a tape measure from camera {camera} to the stop at {at}, for `solve-network`"
                    )
                }
            };
            words += &format!(": {}", Gains(instead.gain(), &self.unit));
        }
        words.push('.');
        Some(words)
    }

    /// The protection of checked poses.
    fn protection_words(&self) -> Option<String> {
        let Protection {
            position,
            heading_deg,
        } = self.protection?;
        Some(format!(
            "Checked: one wrong measurement that was not noticed moves such a pose by {position:.2} {} \
             and turns it by {heading_deg:.1} deg at most.",
            self.unit
        ))
    }

    /// `None` of what was told of another network already.
    fn common_words(&self, common: Common) -> Option<String> {
        Some(match common {
            Common::Lens(ratio) => format!(
                "The cameras see the target {ratio:.1} times farther off than foretold from where \
                 it is: their lenses are not what they are configured to. Check the projection and \
                 the field of view first: no further stop helps before."
            ),
            Common::Carrier(target, ratio) => format!(
                "Target {target} believed to be {ratio:.1} times farther off than foretold from \
                 where it was: its carrier's steps or compass err by more than their sigmas. Give \
                 larger systematic sigmas, or calibrate the carrier."
            ),
            Common::Misfit(ratio) if self.is_rehearsal => format!(
                "The residuals are {ratio:.1} times larger than foretold, though neither lenses \
                 nor the target's places are wrong: the sigmas of sightings are too small."
            ),
            Common::Misfit(ratio) => format!(
                "The residuals are {ratio:.1} times larger than foretold: check projection and \
                 field of view of the cameras first, then the carrier's step length and compass."
            ),
            Common::Reference(camera) => format!(
                "Reference camera {camera} is not there, and without both references no camera of its \
                 network gets a pose: see below what is the matter with it, or put another board or camera \
                 in its place, with the same configuration."
            ),
            Common::TiltedReference(camera) => format!(
                "Reference camera {camera} is not level, its rows do not fit together, and all poses of its network \
                 hang on it: level it."
            ),
            Common::UncheckedGuests(first) => {
                let is_meant = |common: &Common| match common {
                    Common::UncheckedGuests(network) => Some(*network),
                    _ => None,
                };
                let networks = self.once(first, is_meant)?;
                let have = if networks.len() == 1 {
                    "it has"
                } else {
                    "they have"
                };
                format!(
                    "No pose is checked in {}: {have} no references, and a target that brings a \
                     frame from another network estimates the cameras of neither together from then on. No \
                     further stop changes that; references of its own would.",
                    listed("network", &networks)
                )
            }
            Common::Unchecked(first) => {
                let is_meant = |common: &Common| match common {
                    Common::Unchecked(network) => Some(*network),
                    _ => None,
                };
                let networks = self.once(first, is_meant)?;
                let within = match self.has_networks {
                    true => format!(" in {}", listed("network", &networks)),
                    false => String::new(),
                };
                format!(
                    "No pose is checked{within}: no target has estimated the cameras together. It does once \
                     the distance of the references is known and both of them have seen it."
                )
            }
            Common::Overconfident(ratio) => format!(
                "The true errors are {ratio:.1} times larger than foretold: these poses deceive. Where \
                 nothing else is told, a carrier errs by more than it is said to: give larger systematic sigmas."
            ),
            Common::Underconfident(ratio) => format!(
                "The true errors are {ratio:.1} times smaller than foretold: the sigmas configured \
                 are larger than what was rehearsed."
            ),
        })
    }

    /// All networks with a problem, told at the first one only.
    fn once(&self, first: u16, is_meant: impl Fn(&Common) -> Option<u16>) -> Option<Vec<u16>> {
        let networks: Vec<u16> = self.common.iter().filter_map(is_meant).collect();
        (networks.first() == Some(&first)).then_some(networks)
    }
}

/// Rows of each of these sentences, together at most so many: one of each before a second of any. `None` if there is no
/// room for all.
fn at_a_glance(sentences: &[String], room: usize) -> Option<Vec<Vec<String>>> {
    let mut all: Vec<_> = sentences.iter().map(|text| clauses(text, 1)).collect();
    let least = |rows: &mut Vec<String>, text: &String| {
        if rows.is_empty() {
            *rows = clauses(text, SENTENCE_ROWS);
        }
        rows.len()
    };
    let used: usize = { all.iter_mut().zip(sentences) }
        .map(|(rows, text)| least(rows, text))
        .sum();
    let mut spare = room.checked_sub(used)?;
    for (rows, text) in all.iter_mut().zip(sentences) {
        let longer = clauses(text, SENTENCE_ROWS);
        if longer.len() <= rows.len() + spare {
            spare -= longer.len() - rows.len();
            *rows = longer;
        }
    }
    Some(all)
}

/// Rows of a verdict at a glance.
const ROWS: usize = 5;
/// Rows of one of its sentences, at most.
const SENTENCE_ROWS: usize = 2;
/// Columns of a report.
pub(crate) const COLUMNS: usize = 100;

impl Verdict {
    /// The verdict at a glance, in at most five rows of 100 columns: the counts, the gravest problems, and the next
    /// thing to do. A sentence that is too long ends after one of its clauses. [`Display`](fmt::Display) tells all
    /// of it.
    pub fn brief(&self) -> String {
        let mut rows = clauses(&self.counts(), ROWS);
        let problems = self.problems(true);
        let advice = self.advice();
        let first = advice.first().map(|advice| clauses(advice, SENTENCE_ROWS));
        let first = first.unwrap_or_default();
        let mut left = advice.len().saturating_sub(1);
        let room = ROWS.saturating_sub(rows.len() + first.len());
        let told = { (0..=problems.len()).rev() }.find_map(|count| {
            // A row is kept that tells how much is left out.
            let is_all = count == problems.len() && left == 0;
            let free = room.saturating_sub(usize::from(!is_all));
            at_a_glance(&problems[..count], free)
        });
        let told = told.unwrap_or_default();
        left += problems.len() - told.len();
        rows.extend(told.into_iter().flatten());
        rows.extend(first);
        if left > 0 {
            rows.push(format!("and {left} more: --details tells all"));
        }
        rows.join("\n") + "\n"
    }

    /// Numbers of cameras that are calibrated and checked.
    fn counts(&self) -> String {
        let Self {
            expected,
            calibrated,
            checkable,
            checked,
            ..
        } = self;
        let mut counts = format!("{calibrated} of {expected} cameras are calibrated");
        if *checkable > 0 {
            counts += &format!(", {checked} of {checkable} poses are checked");
        }
        counts
            + match self.has_nothing_to_tell() {
                true if *expected == 0 => ": none is known yet.",
                true => "; nothing is left to do.",
                false => ".",
            }
    }

    fn has_nothing_to_tell(&self) -> bool {
        let others = self.absent.len() + self.silent.len() + self.failing.len() + self.unwell.len();
        self.findings.is_empty() && self.common.is_empty() && others == 0
    }

    /// One sentence for each problem; at a glance one for all poses that are not checked.
    fn problems(&self, at_a_glance: bool) -> Vec<String> {
        let mut problems = Vec::new();
        if !at_a_glance || self.has_nothing_to_tell() {
            problems.extend(self.protection_words());
        }
        let (coordinators, silent): (Vec<&_>, Vec<&_>) =
            { self.silent.iter() }.partition(|(_, who, _)| *who == Role::Coordinator);
        problems.extend(coordinators.into_iter().map(|(id, _, since)| {
            match since {
                Some(since) => format!(
                    "coordinator {id}: nothing comes on its line since {since:.0} s: check its cable and its power; \
                     everything else is from before"
                ),
                None => format!(
                    "coordinator {id}: nothing has come on its line: check that this is its port, its cable and its \
                     power"
                ),
            }
        }));
        problems.extend(
            self.common
                .iter()
                .filter_map(|common| self.common_words(*common)),
        );
        // The same problem of several cameras is told once.
        let mut told: Vec<(String, Vec<u16>)> = Vec::new();
        let is_alone = |finding: &&Finding| {
            !matches!(
                finding.trouble,
                Trouble::Unchecked { .. } | Trouble::Weak { .. }
            )
        };
        for finding in self.findings.iter().filter(is_alone) {
            let words = self.words_on(finding);
            match told.iter_mut().find(|(other, _)| *other == words) {
                Some((_, of)) => of.push(finding.camera),
                None => told.push((words, vec![finding.camera])),
            }
        }
        problems.extend({ told.iter() }.map(|(words, of)| format!("{}: {words}", cameras(of))));
        problems.extend(self.weak());
        problems.extend(self.unchecked(at_a_glance));
        let never_joined = self.never_joined();
        let absent = self.absent.iter();
        problems.extend(absent.map(|target| format!("target {target}: {never_joined}")));
        let silent = silent.into_iter();
        problems.extend(
            silent.map(|(id, who, since)| format!("{} {id}: {}", role(*who), Since(*since))),
        );
        let unwell = self.unwell.iter();
        problems.extend(
            unwell
                .map(|(id, who, health)| format!("{} {id}: {}", role(*who), health_words(health))),
        );
        problems.extend(self.failing.iter().map(Failing::to_string));
        let moved = self.moved.iter();
        problems.extend(
            moved.map(|(id, moved)| format!("camera {id}: {}", move_words(moved, &self.unit))),
        );
        for problem in &mut problems {
            problem.insert_str(0, "  ");
        }
        problems
    }

    /// One sentence for each stop that is asked for, or for the changes that help instead.
    fn advice(&self) -> Vec<String> {
        let count = self.next_stops.len();
        let mut advice: Vec<String> = (1..=count)
            .map(|count| self.next_words(&self.next_stops[..count]))
            .collect();
        advice.extend(self.instead_words());
        let is_told = |stop: &NextStop| !self.frames.contains_key(&stop.network);
        // In whose frame places are, where it is not that of the site's file.
        if self.next_stops.iter().any(is_told) {
            advice.push(FRAME.to_owned());
        }
        advice
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.counts())?;
        let sentences = self.problems(false).into_iter().chain(self.advice());
        for sentence in sentences {
            writeln!(f, "{sentence}")?;
        }
        Ok(())
    }
}

/// A sentence in rows of a report: further ones begin where it does.
fn folded(sentence: &str) -> Vec<String> {
    let words = sentence.trim_start();
    let indent = &sentence[..sentence.len() - words.len()];
    let mut rows: Vec<String> = Vec::new();
    for word in words.split_whitespace() {
        match rows.last_mut() {
            Some(row) if row.chars().count() + 1 + word.chars().count() <= COLUMNS => {
                row.push(' ');
                row.push_str(word);
            }
            _ => rows.push(format!("{indent}{word}")),
        }
    }
    rows
}

/// A sentence in so many rows at most: the whole of it, or as many of its first clauses as there is room for.
/// Empty where not even the first one fits.
fn clauses(sentence: &str, most: usize) -> Vec<String> {
    let ends = sentence.match_indices([':', ';', '.', ',']);
    let ends = ends.filter_map(|(at, mark)| {
        let next = sentence[at + mark.len()..].strip_prefix(' ')?;
        // Neither in a list of numbers nor in a place.
        let is_end = mark != "," || next.starts_with(char::is_alphabetic);
        let end = if mark == "." { at + mark.len() } else { at };
        is_end.then_some(end)
    });
    let mut shortened: Vec<usize> = ends.collect();
    shortened.push(sentence.len());
    let rows = { shortened.into_iter().rev() }.map(|end| folded(&sentence[..end]));
    let mut rows = rows.filter(|rows| rows.len() <= most);
    rows.next().unwrap_or_default()
}

/// More cameras than these are counted, and the first ones named.
const MOST_NAMED: usize = 8;

/// `camera 3`, `cameras 3 and 4`, `cameras 3, 4 and 5`
fn cameras(ids: &[u16]) -> String {
    listed("camera", ids)
}

/// The same of other things than cameras.
fn listed(kind: &str, ids: &[u16]) -> String {
    let names: Vec<String> = ids.iter().map(u16::to_string).collect();
    match names.split_last() {
        Some((last, [])) => format!("{kind} {last}"),
        Some(_) if ids.len() > MOST_NAMED => {
            let (named, _) = names.split_at(MOST_NAMED - 2);
            format!("{} {kind}s ({}, ...)", ids.len(), named.join(", "))
        }
        Some((last, rest)) => format!("{kind}s {} and {last}", rest.join(", ")),
        None => format!("no {kind}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_sentence_hides_another() {
        let long = format!(
            "camera 8: it is {}far off: look at its lens",
            "so ".repeat(20)
        );
        let sentences = [long, "camera 4: it waits".to_owned()];
        let rows =
            |room| at_a_glance(&sentences, room).map(|all| all.iter().map(Vec::len).collect());
        assert_eq!(rows(1), None::<Vec<_>>);
        assert_eq!(rows(2), Some(vec![1, 1]));
        let longer = format!("camera 8: {}: {}", "not ".repeat(20), "right ".repeat(10));
        let sentences = [longer, "camera 4: it waits".to_owned()];
        let rows =
            |room| at_a_glance(&sentences, room).map(|all| all.iter().map(Vec::len).collect());
        assert_eq!(rows(2), Some(vec![1, 1]));
        assert_eq!(rows(3), Some(vec![2, 1]));
        assert_eq!(rows(4), Some(vec![2, 1]));
    }
}
