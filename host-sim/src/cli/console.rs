//! `host-sim console`

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{self, IsTerminal, Write},
    path::PathBuf,
    process::ExitCode,
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use clap::Args;
use host_sim::{
    console::{output, session::Wish},
    logging,
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use node_firmware::limits::{COLOURS_MAX, CONSOLE_BAUD};
use results::view::{COMMAND_NAMES, parse_command};
use results::{
    record::{
        RunRecord,
        event::{ObjectPlace, What},
        verdict::Verdict,
    },
    view::SitePlan,
};
use site::{BUILT_IN, Overrides, Scenario, key_file, nearest};

use super::{
    OfFile, and, end,
    files::Files,
    happenings::{Happenings, HappeningsOptions},
    interrupt,
    lines::{Ended, Line, Lines},
    log_options::LogOptions,
    of_site, print,
    run_outputs::{FOR_RESULTS, RecordOutputs},
    tell, values,
};

/// Talks to the coordinator of a real network: its members, their poses, and what you want of them.
///
/// Prints what changes, on a terminal with the list of members below, until Ctrl-C; then the list.
/// With something to do it ends when that is confirmed, unless --seconds or --until-calibrated is
/// given too. Things are done in this order: --join-window, --remove, --change-key, --change-pan,
/// --stands, --command.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
pub(super) struct Arguments {
    /// The serial port of the coordinator, such as /dev/ttyACM0 or a link in /dev/serial/by-id. Of a site with several networks, those of all
    /// coordinators: they are shown, and told in results, as one.
    #[arg(long, value_name = "DEV", required = true)]
    port: Vec<String>,
    /// Bits per second.
    #[arg(long, value_name = "RATE", default_value_t = CONSOLE_BAUD, value_parser = values::whole(1, u32::MAX))]
    baud: u32,
    /// Stop after so many seconds.
    #[arg(long, value_name = "N", value_parser = values::seconds)]
    seconds: Option<Duration>,
    /// Stop when every camera is calibrated, of --site all that it names; exit code 1 if --seconds are
    /// over before.
    #[arg(long)]
    until_calibrated: bool,
    /// The same, and there are at least so many cameras.
    #[arg(long, value_name = "N", value_parser = values::count, default_value_t = 1, requires = "until_calibrated")]
    cameras: usize,
    /// The file of which the nodes were provisioned: it tells who is expected, the unit, lenses and
    /// walls (for advice where to stop next), and the place in the building.
    #[arg(long, value_name = "FILE.toml")]
    site: Option<String>,
    #[command(flatten)]
    log: LogOptions,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: RecordOutputs,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    happenings: HappeningsOptions,
    /// Let new nodes join for so long; 0 lets none join.
    #[arg(long, value_name = "SECONDS", help_heading = "Things to do", value_parser = values::whole(0, u16::MAX))]
    join_window: Option<u16>,
    /// Send a member away: its place is free then. Can be given several times.
    #[arg(long, value_name = "ID", help_heading = "Things to do", value_parser = values::whole(1, u16::MAX))]
    remove: Vec<u16>,
    /// Give all members the site key of this file, made by `host-sim keygen --index N`.
    #[arg(long, value_name = "FILE", help_heading = "Things to do")]
    change_key: Option<PathBuf>,
    /// Take another PAN identifier, where another network has the same one.
    #[arg(long, help_heading = "Things to do")]
    change_pan: bool,
    /// Tell a target whose step sensor fails where it stands: its number, and a place in the frame of --site. The
    /// cameras look then; go to the next place when its lamp shows that it may walk on.
    #[arg(long, value_name = "ID:X,Y", value_parser = place, requires = "site", help_heading = "Things to do")]
    stands: Vec<(u16, [f64; 2])>,
    /// Have a camera do something: initialise, learn-colour, learn-background, track, stop-tracking,
    /// forget; `all:track` has every camera do it. Can be given several times.
    #[arg(long, value_name = "ID:NAME", value_parser = command, help_heading = "Things to do")]
    command: Vec<Wish>,
}

const EPILOGUE: &str = "\
Examples:
  host-sim console --port /dev/ttyACM0 --site office.toml --until-calibrated --csv poses.csv
  host-sim console --port /dev/ttyACM0 --join-window 60 --seconds 60
  host-sim console --port /dev/ttyACM0 --port /dev/ttyACM1 --site building.toml
  host-sim console --port /dev/ttyACM0 --command 2:learn-colour
  host-sim console --port /dev/ttyACM0 --site office.toml --stands 30:2.5,4.0
  host-sim console --port /dev/ttyACM0 --command all:track --seconds 600 --events walk.ndjson
  host-sim console --port /dev/ttyACM0 --join-window 0 --remove 3 --change-key new.sitekey

Commands: `initialise` resets the camera and lets it adapt to the light; `learn-colour` takes the
object in the middle of the view as the first colour, `learn-colour=1` as the second, and so on;
`learn-background` takes the present view as the background; `track` has it tell what it sees of the
first colour, `track=1` of the second, until `stop-tracking`; `forget` drops pose and sightings.
Once cameras know their poses and two of them track, the coordinator tells where objects are.

A line that goes away is waited for. A device with a USB serial number is found again by whatever
name; any device is if --port is its link in /dev/serial/by-id.

Lengths are in the unit in which the site was configured. Results are those of `host-sim run`, with
what a real network does not tell left empty; `host-sim report run` reads --json. In the end there is
the verdict: what is the matter with whom, and where to stop the target next.

The coordinator does not say whether the join window is open, only that it got what came after the
wish. No key is ever printed.

With --log, records on the standard error output tell of the lines too, with their ports.

Exit codes:
  0    what was asked for is done; of listening: every camera is calibrated
  1    listening was ended, by --seconds, Ctrl-C or the end of a simulation, and a camera is not calibrated
  2    wrong options, something could not be done, or a file failed
  130  Ctrl-C before what was asked for was done";

/// Time for which a quiet line is left alone.
const POLL: Duration = Duration::from_millis(10);

/// `30:2.5,4.0`
fn place(text: &str) -> Result<(u16, [f64; 2]), String> {
    let parse = || {
        let (id, place) = text.split_once(':')?;
        let (x, y) = place.split_once(',')?;
        let [x, y] =
            [x, y].map(|number| number.trim().parse().ok().filter(|x: &f64| x.is_finite()));
        Some((id.parse().ok()?, [x?, y?]))
    };
    parse().ok_or_else(|| "a target and its place are needed, such as 30:2.5,4.0".to_owned())
}

/// `2:learn-colour`, `all:track`
fn command(text: &str) -> Result<Wish, String> {
    let parse = || {
        let (id, name) = text.split_once(':')?;
        let command = parse_command(name)?;
        Some(match id {
            "all" => Wish::Everybody(command),
            id => Wish::Command(id.parse().ok()?, command),
        })
    };
    parse().ok_or_else(|| {
        let [_, name] = text
            .split_once(':')
            .map_or(["", text], |(id, name)| [id, name]);
        let meant = nearest(name, COMMAND_NAMES).map(|name| format!("; did you mean `{name}`?"));
        let of_colour = name.split_once('=').map(|_| {
            format!(
                "; `learn-colour` and `track` take the number of a colour, 0 to {}",
                COLOURS_MAX - 1
            )
        });
        format!(
            "a camera and one of {} are needed, such as 2:learn-colour{}",
            COMMAND_NAMES.join(", "),
            of_colour.or(meant).unwrap_or_default()
        )
    })
}

/// Outcome of talking to the coordinators.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    Done,
    /// There are cameras that are not calibrated.
    TimeIsUp,
    /// The line ended before all cameras were calibrated.
    Unfinished,
    /// Listening was ended.
    Enough,
    /// Something is left to do.
    Interrupted,
}

/// Records without --log: what happens stands among the news on the standard output.
const LOG: &str = "host_sim=error";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.log.start(LOG)?;
    // Errors in a file are told before the program waits for the coordinator.
    let site = arguments.site.as_deref();
    let file = site.filter(|name| !BUILT_IN.iter().any(|(known, _)| known == name));
    let files = Files::default()
        .reads(&arguments.port)
        .reads(file)
        .reads(&arguments.change_key);
    arguments.outputs.check(arguments.happenings.among(files))?;
    let site = site.map(read_site).transpose()?;
    check_ports(&arguments.port)?;
    if arguments.change_pan && arguments.port.len() > 1 {
        bail!("--change-pan is for one network: give the --port of its coordinator alone");
    }
    let wishes = wishes(arguments, site.as_ref())?;
    let listens = wishes.is_empty() || arguments.until_calibrated || arguments.seconds.is_some();
    let interrupted = interrupt::watch()?;
    let ports = (&arguments.port[..], arguments.baud);
    let mut lines = Lines::open(ports, wishes, &interrupted)?.of_site(site.as_ref());
    if listens {
        lines = lines.with_sightings();
    }
    let mut screen = Screen::new();
    let mut happenings = Happenings::new(&arguments.happenings)?;
    let begin = Instant::now();
    let ended = talk(
        arguments,
        site.as_ref(),
        &mut lines,
        (&mut screen, &mut happenings),
        begin,
    );
    let finished = screen.finish(&lines);
    let mut ended = and(ended, finished.map_err(Into::into));
    let mut code = 0;
    if lines.have_answered() {
        let result = lines.record(begin.elapsed(), site.as_ref());
        if let (true, Ok(record)) = (listens, &result) {
            let verdict = Verdict::of(record);
            let calibrated = verdict.expected > 0 && verdict.is_good();
            code = u8::from(!calibrated);
            let screen = arguments.outputs.screen(record, &verdict);
            ended = and(ended, print(&format!("\n{screen}")).map_err(Into::into));
            if let Some(words) = site.as_ref().and_then(|site| strangers(site, record)) {
                tell(words);
            }
            if site.is_none() {
                tell(
                    "the unit is not known, and no next stop can be named: `--site FILE.toml` tells both",
                );
            }
        }
        ended = and(ended, happenings.finish(result.as_ref().ok()));
        let written =
            result.and_then(|record| arguments.outputs.write(&record, false, &end::End::Whole));
        ended = and(ended, written);
    }
    Ok(match ended? {
        End::Done | End::Enough => ExitCode::from(code),
        End::TimeIsUp => {
            tell("the time is over, and not every camera is calibrated");
            ExitCode::from(1)
        }
        End::Unfinished => {
            tell("the other end has ended, and not every camera is calibrated");
            ExitCode::from(1)
        }
        End::Interrupted => {
            tell("interrupted");
            ExitCode::from(interrupt::INTERRUPTED)
        }
    })
}

fn wishes(arguments: &Arguments, site: Option<&Scenario>) -> anyhow::Result<Vec<Wish>> {
    let mut wishes: Vec<_> = arguments
        .join_window
        .map(Wish::JoinWindow)
        .into_iter()
        .collect();
    wishes.extend(arguments.remove.iter().copied().map(Wish::Remove));
    if let Some(path) = &arguments.change_key {
        let key = key_file::read(path).with_context(|| OfFile::named(path))?;
        wishes.push(Wish::ChangeKey(key));
    }
    wishes.extend(arguments.change_pan.then_some(Wish::ChangePan));
    for &(id, place) in &arguments.stands {
        let network = site.and_then(|site| Some((site, site.network_of_target(id)?)));
        let (site, network) =
            network.with_context(|| format!("the site has no target {id}: look at --stands"))?;
        let place = site.told_place(network, place.into()).context(
            "places can be told only in a network whose reference cameras the site names, with `x` and `y`",
        )?;
        wishes.push(Wish::Stands(id, place));
    }
    wishes.extend(&arguments.command);
    Ok(wishes)
}

/// Refuses a port that is named twice: each byte can be read only once.
pub(super) fn check_ports(ports: &[String]) -> anyhow::Result<()> {
    let mut numbered = (0..).zip(ports);
    let twice = numbered.any(|(n, path): (usize, _)| ports[..n].contains(path));
    ensure!(!twice, "the same --port is given twice");
    Ok(())
}

pub(super) fn read_site(name: &str) -> anyhow::Result<Scenario> {
    let site = Scenario::load(name, &Overrides::default());
    // Errors in it are told before any waiting.
    let checked = site.and_then(|site| SitePlan::new(&site, &[]).map(|_| site));
    checked.map_err(|error| of_site(name, error))
}

/// Words on cameras that the site's file does not have.
fn strangers(site: &Scenario, record: &RunRecord) -> Option<String> {
    let known = { site.networks.iter() }.flat_map(|network| &network.cameras);
    let known: BTreeSet<u16> = known.map(|camera| camera.id).collect();
    let strange = record.cameras().map(|camera| camera.id);
    let strange: Vec<_> = { strange.filter(|id| !known.contains(id)) }
        .map(|id| id.to_string())
        .collect();
    (!strange.is_empty() && !known.is_empty()).then(|| {
        format!(
            "the file of the site has no camera {}: is it the file of this network? Units and places above are its",
            strange.join(", ")
        )
    })
}

/// Returns true if all cameras of the site are calibrated.
fn is_complete(lines: &Lines, now: Duration, site: Option<&Scenario>) -> bool {
    let summary = lines.record(now, site).map(|record| record.summary);
    summary.is_ok_and(|summary| summary.calibrated == summary.expected)
}

/// Talks to the coordinators until there is nothing left to do.
fn talk(
    arguments: &Arguments,
    site: Option<&Scenario>,
    lines: &mut Lines,
    (screen, happenings): (&mut Screen, &mut Happenings),
    begin: Instant,
) -> anyhow::Result<End> {
    let has_wishes = !lines.are_done();
    loop {
        let now = begin.elapsed();
        match lines.exchange(now) {
            Ok(()) => {}
            Err(Ended::Failed(error)) => {
                // The last bytes may tell more.
                screen.show(now, lines, happenings)?;
                return Err(error);
            }
            Err(Ended::Over) => {
                screen.show(now, lines, happenings)?;
                lines.check_answered()?;
                ensure!(lines.are_done(), "it ended before everything was done");
                let is_complete = is_complete(lines, now, site);
                return Ok(match arguments.until_calibrated && !is_complete {
                    true => End::Unfinished,
                    false => End::Enough,
                });
            }
            Err(Ended::Interrupted) if lines.are_done() && !arguments.until_calibrated => {
                return Ok(End::Enough);
            }
            Err(Ended::Interrupted) => return Ok(End::Interrupted),
        }
        if happenings.is_due(now) && lines.have_answered() {
            happenings.look(now, &lines.record(now, site)?);
        }
        screen.show(now, lines, happenings)?;
        if lines.are_done() {
            if arguments.until_calibrated {
                if lines.are_calibrated(now, arguments.cameras)
                    && site.is_none_or(|_| is_complete(lines, now, site))
                {
                    return Ok(End::Done);
                }
            } else if has_wishes && arguments.seconds.is_none() {
                return Ok(End::Done);
            }
        }
        if arguments.seconds.is_some_and(|seconds| now >= seconds) {
            lines.check_answered()?;
            if !lines.are_done() {
                bail!("--seconds were over before everything was done");
            }
            return Ok(if arguments.until_calibrated {
                End::TimeIsUp
            } else {
                End::Done
            });
        }
        thread::sleep(POLL);
    }
}

/// Output of news: lines, and on a terminal the list of members below them.
struct Screen(Option<ProgressBar>, Objects);

/// Time of the last message about each object of a network.
#[derive(Default)]
struct Objects(BTreeMap<(u16, u16), Duration>);

impl Objects {
    /// Shortest time between two messages about one object.
    const PERIOD: Duration = Duration::from_secs(1);

    /// Words for people about an event, if any.
    fn words(&mut self, now: Duration, what: &What) -> Option<String> {
        match what {
            What::Tracked {
                node,
                middle: [mx, my],
                edges: [left, upper, right, lower],
                pixels,
                confidence,
                ..
            } => Some(format!(
                "camera {node}: tracks {mx}, {my} in {left}, {upper} to {right}, {lower}; {pixels} pixels, \
                 confidence {confidence}"
            )),
            What::Object {
                network,
                object,
                is,
            } => {
                let words = self.place(now, (*network, *object), is.as_ref())?;
                Some(format!("object {object}: {words}"))
            }
            _ => None,
        }
    }

    fn place(
        &mut self,
        now: Duration,
        which: (u16, u16),
        is: Option<&ObjectPlace>,
    ) -> Option<String> {
        let Some(object) = is else {
            self.0.remove(&which);
            return Some("no camera sees it any more".to_owned());
        };
        let is_recent = |at: &Duration| now.saturating_sub(*at) < Self::PERIOD;
        if self.0.get(&which).is_some_and(is_recent) {
            return None;
        }
        self.0.insert(which, now);
        let ([xx, _, yy], [vx, vy]) = (object.covariance, object.velocity);
        Some(format!(
            "at {:.2}, {:.2} +/- {:.2}, goes {:.1} a second",
            object.x,
            object.y,
            (xx + yy).sqrt(),
            vx.hypot(vy)
        ))
    }
}

impl Screen {
    fn new() -> Self {
        let style = ProgressStyle::with_template("{msg}");
        let bar = io::stdout().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stdout());
            // A drawing that came too soon after the last one is made then.
            bar.enable_steady_tick(Duration::from_secs(1));
            logging::keep_clear_of(&bar);
            bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        });
        Self(bar, Objects::default())
    }

    fn show(
        &mut self,
        now: Duration,
        lines: &mut Lines,
        happenings: &mut Happenings,
    ) -> io::Result<()> {
        let mut is_news = false;
        for line in &mut lines.all {
            while let Some(news) = line.news() {
                is_news = true;
                let news = format!("{}{news}", line.prefix);
                happenings.said(now, &news);
                self.tell(now, &news)?;
            }
            while let Some(what) = line.session.happening(line.network.get()) {
                happenings.happened(now, &what);
                if let Some(words) = self.1.words(now, &what) {
                    self.tell(now, &format!("{}{words}", line.prefix))?;
                }
            }
        }
        if let Some(bar) = self.0.as_ref().filter(|_| is_news) {
            bar.set_message(tables(lines));
        }
        Ok(())
    }

    fn tell(&self, now: Duration, words: &str) -> io::Result<()> {
        let line = format!("{:8.1} s  {words}", now.as_secs_f64());
        match &self.0 {
            Some(bar) => bar.suspend(|| print_line(&line)),
            None => print_line(&line),
        }
    }

    fn finish(self, lines: &Lines) -> io::Result<()> {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
        if lines.have_answered() {
            print_line(&tables(lines))?;
        }
        Ok(())
    }
}

/// The members of each network.
fn tables(lines: &Lines) -> String {
    let table = |line: &Line| {
        let table = output::table(line.session.known());
        match lines.all.len() {
            1 => table.trim_end().to_owned(),
            _ => format!("{}\n{}", line.path, table.trim_end()),
        }
    };
    let tables: Vec<_> = lines.all.iter().map(table).collect();
    tables.join("\n\n")
}

fn print_line(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}
