//! A run as tables for people: the layout of the thesis's Tables 4.1 to 4.5, with its own numbers
//! beside ours where it has any.

use std::fmt::{self, Write};

use calib_core::{Refusal, Status};
use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};

use super::table::Words;
use crate::accuracy::GAUSSIAN;
use crate::record::{
    Estimate, Limits, Node, PoseError, Radio, RunRecord,
    published::{Published, exchange},
    space::Hung,
    summary::{Errors, Statistics},
    verdict::Verdict,
};

/// Everything there is to say about one run: the answer, then all details.
pub fn run_report(record: &RunRecord) -> String {
    let verdict = Verdict::of(record);
    join(&[answer(record, &verdict), details(record, &verdict)])
}

/// The answer of a run on one screen, with the verdict on it, which takes long to find: at most five rows of the
/// verdict, and a table of poses of at most 100 columns.
pub fn answer(record: &RunRecord, verdict: &Verdict) -> String {
    let shown = record.for_people();
    let record = shown.as_ref();
    let title = format!("{}\n{}", record.title(), verdict.brief());
    join(&[title, poses_at_a_glance(record), tracking(record)])
}

/// Everything else: the whole verdict, true poses, statistics, traffic, times.
pub fn details(record: &RunRecord, verdict: &Verdict) -> String {
    let shown = record.for_people();
    let record = shown.as_ref();
    let parts = [
        poses(&[record]),
        hanging(record),
        statistics(&[record]),
        record
            .radio
            .as_ref()
            .map_or_else(String::new, |radio| traffic(record, radio)),
        times(record),
        verdict.to_string(),
    ];
    join(&parts)
}

/// The poses and statistics of several runs together, such as the five placements of the lab.
pub fn runs_report(records: &[&RunRecord]) -> String {
    let shown: Vec<_> = records.iter().map(|record| record.for_people()).collect();
    let records: Vec<&RunRecord> = shown.iter().map(AsRef::as_ref).collect();
    join(&[title(&records), poses(&records), statistics(&records)])
}

/// The scenario, the path too if it is that of all, and how many runs.
fn title(records: &[&RunRecord]) -> String {
    match records {
        [] => String::new(),
        [one] => format!("{}\n", one.title()),
        [first, others @ ..] => {
            let common = others.iter().all(|record| record.path == first.path);
            let path = first.path.filter(|_| common);
            let path = path.map_or_else(String::new, |path| format!(", path {path}"));
            format!("{}{path}: {} runs\n", first.scenario, records.len())
        }
    }
}

fn join(parts: &[String]) -> String {
    let parts = parts.iter().filter(|part| !part.is_empty());
    parts.map(String::as_str).collect::<Vec<_>>().join("\n")
}

/// Rows of numbers, the first column on the left.
pub(super) fn table(head: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN).set_header(head);
    for (name, column) in head.iter().zip(table.column_iter_mut()).skip(1) {
        if *name != "status" {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// A table, ending with a line feed.
pub(super) fn print(table: &Table) -> String {
    format!("{}\n", table.trim_fmt())
}

/// Frame of the places of these runs, in words.
fn frame_words(records: &[&RunRecord]) -> &'static str {
    let is_placed = |record: &&RunRecord| record.is_in_building();
    let has_networks = records.iter().any(|record| record.has_networks());
    match (records.iter().all(is_placed), has_networks) {
        (true, _) => "in the frame of the site's file",
        (false, true) => "in the frame of each network",
        (false, false) => "from the first reference camera, x towards the second",
    }
}

/// Longer names of units stand above a table, not in its headings.
const SHORT_UNIT: usize = 5;

/// Poses with what they are worth, in at most 100 columns.
fn poses_at_a_glance(record: &RunRecord) -> String {
    let unit = &record.unit.name;
    let is_short = unit.chars().count() <= SHORT_UNIT;
    let has_truth = record.cameras().any(|camera| camera.error.is_some());
    let of_length = |name: &str| match is_short {
        true => format!("{name}\n[{unit}]"),
        false => name.to_owned(),
    };
    let of_angle = |name: &str| format!("{name}\n[deg]");
    let mut head = vec![
        "camera".to_owned(),
        "status".to_owned(),
        of_length("x"),
        of_length("y"),
        of_angle("heading"),
    ];
    let has_tilted = record.cameras().any(Node::is_tilted);
    if has_tilted {
        head.extend([of_length("z"), of_angle("pitch")]);
    }
    head.extend([of_length("sigma"), of_angle("sigma"), of_length("fault")]);
    head.extend(has_truth.then(|| of_length("error")));
    head.push("seen".to_owned());
    let mut table = table(&head.iter().map(String::as_str).collect::<Vec<_>>());
    for camera in record.cameras() {
        let network = match record.has_networks() {
            true => format!("{}, ", camera.network),
            false => String::new(),
        };
        let star = if camera.reference { "*" } else { "" };
        let number = |value: Option<f64>, digits: usize| Maybe(value, digits).to_string();
        let pose = camera.estimate.as_ref();
        let mut row = vec![
            format!("{network}{}{star}", camera.id),
            camera.status.unwrap_or(Status::Waiting).to_string(),
            number(pose.map(|pose| pose.x), 2),
            number(pose.map(|pose| pose.y), 2),
            pose.map_or_else(String::new, |pose| heading(pose.heading_deg, 1)),
        ];
        if has_tilted {
            let hung = pose.and_then(|pose| pose.hung).map(|found| found.hung);
            row.push(number(hung.map(|hung| hung.z), 2));
            row.push(number(hung.map(|hung| hung.pitch_deg), 1));
        }
        row.extend([
            number(pose.map(Estimate::sigma_position), 3),
            number(pose.map(|pose| pose.sigma_heading_deg), 2),
            match camera.protection {
                _ if !camera.is_checkable(&record.limits) => String::new(),
                Some(level) if camera.is_checked(&record.limits) => number(Some(level.position), 2),
                _ => "open".to_owned(),
            },
        ]);
        if has_truth {
            let error = camera.error.as_ref();
            row.push(number(error.map(|error| error.x.hypot(error.y)), 3));
        }
        row.push(camera.sightings.to_string());
        table.add_row(row);
    }
    let mut legend = vec![format!("Places {}", frame_words(&[record]))];
    legend.extend((!is_short).then(|| format!("lengths in {unit}")));
    let has_reference = record.cameras().any(|camera| camera.reference);
    legend.extend(has_reference.then(|| "* reference".to_owned()));
    legend.push("seen: sightings".to_owned());
    legend.extend(has_tilted.then(|| heights_are(record).to_owned()));
    format!(
        "{}\nfault: how far one unnoticed wrong measurement moves it at most; open: more than is tolerated\n{}",
        legend.join("; "),
        print(&table)
    )
}

/// Meaning of heights, in words.
fn heights_are(record: &RunRecord) -> &'static str {
    match record.networks.iter().all(|own| own.ball_height.is_some()) {
        true => "z: above the floor",
        false => "z: above the ball",
    }
}

/// Height, pitch and roll of the cameras, where one is not level.
fn hanging(record: &RunRecord) -> String {
    if !record.cameras().any(Node::is_tilted) {
        return String::new();
    }
    let mut table = table(&["node", "actual", "found", "predicted sigma", "error"]);
    for camera in record.cameras() {
        let words = |hung: &Hung| triple([hung.z, hung.pitch_deg], hung.roll_deg, [2, 1]);
        let found = camera.estimate.and_then(|estimate| estimate.hung);
        let truth = camera.truth.and_then(|truth| truth.hung);
        let error = camera.error.and_then(|error| error.hung);
        table.add_row([
            camera.id.to_string(),
            truth.as_ref().map_or_else(String::new, words),
            found.map_or_else(String::new, |found| words(&found.hung)),
            found.map_or_else(String::new, |found| {
                triple(
                    [found.sigma_z, found.sigma_pitch_deg],
                    found.sigma_roll_deg,
                    [2, 1],
                )
            }),
            error.map_or_else(String::new, |e| {
                format!("({:+.3}, {:+.2}, {:+.2})", e.z, e.pitch_deg, e.roll_deg)
            }),
        ]);
    }
    format!(
        "Cameras in space (z, pitch, roll) in {} and degrees; {}; pitch: down; roll: left side high\n{}",
        record.unit.name,
        heights_are(record),
        print(&table)
    )
}

/// Tables 4.1 and 4.2: actual and calculated poses, sigmas and errors.
fn poses(records: &[&RunRecord]) -> String {
    let Some(unit) = records.first().map(|record| record.unit.name.as_str()) else {
        return String::new();
    };
    let is_published = records
        .iter()
        .any(|r| Published::beside(r).is_some_and(|p| !p.nodes.is_empty()));
    let has_networks = records.iter().any(|record| record.has_networks());
    let name = match (records.len() > 1, has_networks) {
        (false, false) => "node",
        (true, false) => "path, seed, node",
        (false, true) => "network, node",
        (true, true) => "path, seed, network, node",
    };
    let mut head = vec![
        name,
        "status",
        "actual",
        "calculated",
        "predicted sigma",
        "checked to",
        "error",
        "n",
    ];
    if is_published {
        head.push("error in the thesis");
    }
    let mut table = table(&head);
    let mut has_reference = false;
    for record in records {
        let published = Published::beside(record);
        for camera in record.cameras() {
            has_reference |= camera.reference;
            let mut row = pose_row(camera, &record.limits);
            if has_networks {
                row[0] = format!("{}, {}", camera.network, row[0]);
            }
            if records.len() > 1 {
                let path = record
                    .path
                    .map_or_else(|| "-".to_owned(), |p| p.to_string());
                let seed = record
                    .seed
                    .map_or_else(|| "-".to_owned(), |seed| seed.to_string());
                row[0] = format!("{path}, {seed}, {}", row[0]);
            }
            if is_published {
                let theirs = published.as_ref().and_then(|p| p.node(camera.id));
                row.push(theirs.map_or_else(String::new, |node| error(&node.error())));
            }
            table.add_row(row);
        }
    }
    let star = if has_reference { "; * reference" } else { "" };
    format!(
        "Poses (x, y, heading) in {unit} and degrees; n sightings; checked to: what one wrong \
         measurement that was not noticed could do (place, heading){star}; {}\n{}",
        frame_words(records),
        print(&table)
    )
}

fn pose_row(camera: &Node, limits: &Limits) -> Vec<String> {
    let star = if camera.reference { "*" } else { "" };
    let status = Words(
        camera.status.unwrap_or(Status::Waiting),
        camera.reason.map(Refusal::name),
    );
    let mut row = vec![format!("{}{star}", camera.id), status.to_string()];
    row.push(camera.truth.map_or_else(String::new, |truth| {
        triple([truth.x, truth.y], truth.heading_deg, [2, 1])
    }));
    match &camera.estimate {
        Some(e) => {
            row.push(triple([e.x, e.y], e.heading_deg, [3, 2]));
            row.push(triple([e.sigma_x, e.sigma_y], e.sigma_heading_deg, [3, 2]));
            row.push(match camera.protection {
                _ if !camera.is_checkable(limits) => String::new(),
                Some(level) if camera.is_checked(limits) => {
                    format!("({:.2}, {:.1})", level.position, level.heading_deg)
                }
                _ => "not checked".to_owned(),
            });
            row.push(camera.error.as_ref().map_or_else(String::new, error));
        }
        None => row.extend([const { String::new() }; 4]),
    }
    row.push(camera.sightings.to_string());
    row
}

/// A place with so many digits, an angle with so many.
fn triple([x, y]: [f64; 2], angle: f64, [place, turn]: [usize; 2]) -> String {
    format!("({x:.place$}, {y:.place$}, {angle:.turn$})")
}

/// A heading in [0, 360), also where rounding makes it a full turn.
fn heading(degrees: f64, digits: usize) -> String {
    let rounded = format!("{degrees:.digits$}");
    match rounded.parse() {
        Ok(360.0) => format!("{:.digits$}", 0.0),
        _ => rounded,
    }
}

fn error(e: &PoseError) -> String {
    format!("({:+.3}, {:+.3}, {:+.2})", e.x, e.y, e.heading_deg)
}

/// Tables 4.3 to 4.5, and statistics that say more than a mean of signed errors.
fn statistics(records: &[&RunRecord]) -> String {
    let cameras = || records.iter().flat_map(|record| record.cameras());
    let others = Statistics::of(cameras().filter(|camera| !camera.reference));
    let all = Statistics::of(cameras());
    let ours_is = if records.len() > 1 {
        "these runs"
    } else {
        "this run"
    };
    let mut parts = Vec::new();
    for (name, statistics) in [(", without references", &others), ("", &all)] {
        let Some(s) = statistics else { continue };
        let mut text = String::new();
        let _ = writeln!(text, "Errors of {} cameras{name}", s.count);
        text += &print(&error_table(s));
        if let Some(nees) = s.mean_nees {
            let _ = writeln!(
                text,
                "Mean squared error over predicted covariance {nees:.2} (3 is right)"
            );
        }
        parts.push(text);
    }
    if let Some(thesis) = records.first().and_then(|r| Published::beside(r)) {
        let ours = if thesis.nodes.is_empty() { others } else { all };
        parts.push(beside(&thesis, ours.as_ref(), ours_is));
    }
    join(&parts)
}

fn error_table(s: &Statistics) -> Table {
    let mut table = table(&[
        "component",
        "rms",
        "median",
        "p90",
        "mean",
        "sd",
        "within 1",
        "2",
        "3 sigma",
    ]);
    let within = &s.within_sigmas;
    let rows = [
        ("x", &s.x, within.x, 4),
        ("y", &s.y, within.y, 4),
        ("position", &s.position, None, 4),
        ("heading [deg]", &s.heading_deg, within.heading, 3),
    ];
    for (name, e, shares, digits) in rows {
        let Errors {
            rms,
            median,
            p90,
            mean,
            ..
        } = e;
        let mut row = vec![name.to_owned()];
        row.extend([rms, median, p90, mean].map(|v| format!("{v:.digits$}")));
        row.push(
            e.standard_deviation
                .map_or_else(String::new, |v| format!("{v:.digits$}")),
        );
        row.extend(per_cent(shares));
        table.add_row(row);
    }
    let mut foretold = vec!["foretold".to_owned()];
    foretold.extend(vec![String::new(); 5]);
    foretold.extend(per_cent(Some(GAUSSIAN)));
    table.add_row(foretold);
    table
}

/// Three shares as text, empty if there are none.
pub(super) fn per_cent(shares: Option<[f64; 3]>) -> [String; 3] {
    shares.map_or_else(Default::default, |s| {
        s.map(|s| format!("{:.1} %", 100.0 * s))
    })
}

/// The thesis's statistics beside ours.
fn beside(thesis: &Published, ours: Option<&Statistics>, ours_is: &str) -> String {
    let mut table = table(&["", "x", "y", "heading [deg]"]);
    let mut row = |name: &str, values: [Option<f64>; 3]| {
        let values = values.map(|v| v.map_or_else(String::new, |v| format!("{v:.4}")));
        let [x, y, heading] = values;
        table.add_row(vec![name.to_owned(), x, y, heading]);
    };
    let pose = |e: &PoseError| [e.x, e.y, e.heading_deg].map(Some);
    let of = |get: fn(&Errors) -> Option<f64>| {
        ours.map_or([None; 3], |s| [&s.x, &s.y, &s.heading_deg].map(get))
    };
    row("mean, thesis", pose(&thesis.mean));
    row(&format!("mean, {ours_is}"), of(|e| Some(e.mean)));
    row(
        "standard deviation, thesis",
        pose(&thesis.standard_deviation),
    );
    row(
        &format!("standard deviation, {ours_is}"),
        of(|e| e.standard_deviation),
    );
    if !thesis.nodes.is_empty() {
        let n = thesis.nodes.len() as f64;
        let rms = |get: fn(PoseError) -> f64| {
            let squares: f64 = thesis
                .nodes
                .iter()
                .map(|node| get(node.error()).powi(2))
                .sum();
            Some((squares / n).sqrt())
        };
        row(
            "rms, thesis",
            [rms(|e| e.x), rms(|e| e.y), rms(|e| e.heading_deg)],
        );
        row(&format!("rms, {ours_is}"), of(|e| Some(e.rms)));
    }
    format!(
        "Beside the thesis's Table {}\n{}",
        thesis.table,
        print(&table)
    )
}

/// Cameras no further apart than this, metres, do not look at a room.
const ROOM_METRES: f64 = 3.0;

/// Distance between the outermost cameras of a network, metres.
fn extent(record: &RunRecord, network: u16) -> f64 {
    let own = |node: &&Node| node.network == network;
    let places: Vec<_> = { record.cameras() }
        .filter(own)
        .filter_map(|node| node.truth)
        .collect();
    let pairs = places
        .iter()
        .flat_map(|a| places.iter().map(move |b| (a, b)));
    let apart = pairs.map(|(a, b)| (a.x - b.x).hypot(a.y - b.y));
    apart.fold(0.0, f64::max) * record.unit.metres
}

/// Objects that are followed less of the time are not.
const FOLLOWED: f64 = 0.5;
/// Errors of tracks this many times larger than foretold are told.
const OVERCONFIDENT: f64 = 2.0;

/// Quality of the tracking of objects.
fn tracking(record: &RunRecord) -> String {
    let unit = &record.unit.name;
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
    let lines = record.tracking.iter().map(|is| {
        let extent = extent(record, is.network);
        let doubt = if extent < ROOM_METRES {
            format!(
                "Tracking is made for people who walk about in rooms, and of no use here: these cameras stand within \
                 {extent:.1} m, which is crossed sooner than it expects anybody to turn, and a track within 1 m counts \
                 as right.\n"
            )
        } else {
            // Errors of right covariances have a mean of 2.
            let by = is.nees.map_or(1.0, |nees| (nees / 2.0).sqrt());
            let poor = (is.covered < FOLLOWED).then(|| {
                "Tracking is of little use here: objects in view of two cameras are without a track most of the \
                 time.\n"
                    .to_owned()
            });
            let deceives = (by > OVERCONFIDENT).then(|| {
                format!(
                    "Tracks are {by:.1} times farther off than their covariances say: do not rely on these.\n"
                )
            });
            [poor, deceives].into_iter().flatten().collect()
        };
        format!(
            "Tracking, network {}, {:.0} s: {} objects, with a track {:.1} % of the time in view of two cameras; rms {} \
             {unit} (bound {}), squared error over covariance {} (2 is right); {} breaks, {} swaps, {} ghosts; {} looks\n{doubt}",
            is.network,
            is.seconds,
            is.objects,
            100.0 * is.covered,
            number(is.rms),
            number(is.bound),
            number(is.nees),
            is.breaks,
            is.swaps,
            is.ghosts,
            is.looks,
        )
    });
    lines.collect()
}

/// Traffic per calibrated camera, against the thesis's exchange.
fn traffic(record: &RunRecord, radio: &Radio) -> String {
    let calibrated = record.summary.calibrated;
    let mut text = String::new();
    if calibrated > 0 {
        let sum = |of: fn(&Node) -> Option<u64>| {
            let total: Option<u64> = record.nodes.iter().map(of).sum();
            total.map_or_else(
                || "not counted".to_owned(),
                |total| format!("{:.0}", total as f64 / calibrated as f64),
            )
        };
        let mut table = table(&["bytes per calibrated camera", "this run", "thesis"]);
        let rows = [
            ("payload", sum(|node| node.payload_bytes), exchange::PAYLOAD),
            ("on the air", sum(|node| node.bytes_sent), exchange::ON_AIR),
        ];
        for (name, ours, theirs) in rows {
            table.add_row([name.to_owned(), ours, theirs.to_string()]);
        }
        text += &print(&table);
        text += "This run: all nodes together; on the air with joining, security, \
                 acknowledgements and retries.\nThesis: seven 12-byte packets of its Appendix B, \
                 none lost, in plain frames.\n";
    }
    // A frame for others that is not taken in is no failure.
    let drops = radio.drops.iter().filter(|(why, _)| *why != "filtered");
    let drops: Vec<String> = drops
        .map(|(why, n)| format!("{n} {}", why.replace('_', " ")))
        .collect();
    let drops = if drops.is_empty() {
        "none".to_owned()
    } else {
        drops.join(", ")
    };
    let _ = writeln!(
        text,
        "Radio: {} frames, {} bytes, together {:.2} % of the run's time\n\
         Receptions that failed, which is what retries are for: {drops}",
        radio.frames,
        radio.bytes,
        100.0 * radio.airtime_share
    );
    if let Some(attack) = &radio.attack {
        let _ = writeln!(
            text,
            "Of these from attackers: {} frames, {} bytes; with carriers {:.2} % of the run's time",
            attack.frames,
            attack.bytes,
            100.0 * attack.airtime_share
        );
    }
    text + &wear(record).unwrap_or_default()
}

/// Erasures that a page of the nRF52840's flash lasts for at least (Product Specification, "Flash").
const ENDURANCE: f64 = 10_000.0;
const DAY_S: f64 = 86_400.0;
const YEAR_S: f64 = 365.25 * DAY_S;

/// Wear of the nodes' flash. A run of less than a day tells nothing of years.
fn wear(record: &RunRecord) -> Option<String> {
    let most = { record.nodes.iter() }
        .filter_map(|node| Some((node.page_erasures?, node.id)))
        .max()?;
    let mut text = format!(
        "Flash: its most used page was erased {} times, on node {}",
        most.0, most.1
    );
    // Formatting is done once in the life of a board.
    let erasures = f64::from(most.0.saturating_sub(1));
    if record.sim_seconds >= DAY_S && erasures > 0.0 {
        let years = ENDURANCE / erasures * record.sim_seconds / YEAR_S;
        let _ = write!(
            text,
            "; as it goes on, 10,000 erasures are reached after {years:.1} years"
        );
    }
    text.push('\n');
    Some(text)
}

fn times(record: &RunRecord) -> String {
    let sim = record.sim_seconds;
    match record.wall_seconds {
        Some(wall) if wall > 0.0 => format!(
            "Simulated {sim:.0} s in {wall:.2} s: {:.*} times real time\n",
            // As exact as it is small.
            if sim < 10.0 * wall { 1 } else { 0 },
            sim / wall
        ),
        _ if record.seed.is_some() => format!("Simulated {sim:.0} s\n"),
        _ => format!("Listened for {sim:.0} s\n"),
    }
}

/// A number in a fixed column, or nothing.
pub(super) struct Maybe(pub(super) Option<f64>, pub(super) usize);

impl fmt::Display for Maybe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(Some(value), digits) => write!(f, "{value:.digits$}"),
            Self(None, _) => Ok(()),
        }
    }
}
