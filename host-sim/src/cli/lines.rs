//! The coordinators of a site, each on a line of its own.

use std::{
    cell::Cell,
    collections::VecDeque,
    fs,
    sync::{Arc, atomic::AtomicBool},
    time::Duration,
};

use anyhow::{anyhow, bail};
use embedded_io::{Read, ReadReady, Write};
use host_sim::{
    console::session::{Failure, MISSING, News, Session, Wish, frame},
    logging::{NEWS, Throttle},
    probe::{
        plug::Plug,
        port::{OpenError, Port, PortError},
    },
};
use results::{
    record::RunRecord,
    view::{SitePlan, are_calibrated},
};
use site::Scenario;
use tracing::{debug, info, warn};

/// Time after which a line that failed is opened again.
const AGAIN: Duration = Duration::from_secs(2);

/// One coordinator's line.
pub(super) struct Line {
    pub(super) path: String,
    /// Prefix of its messages: tells the lines apart, where there are several.
    pub(super) prefix: String,
    pub(super) session: Session,
    /// The number that its network has in the file of the site, or among the lines.
    pub(super) network: Cell<u16>,
    baud: u32,
    interrupted: Arc<AtomicBool>,
    /// `Err`: the line is away, and was last looked for at this time.
    port: Result<Port, Duration>,
    /// The device at its end, if it is known by a serial number.
    plug: Option<Plug>,
    /// At its other end is a program, not a device.
    is_program: bool,
    /// News of the line itself.
    said: VecDeque<News>,
    damaged: Throttle,
    /// Words on why it cannot be opened again, which are told once.
    complaint: Option<String>,
}

/// Problem of one line.
pub(super) enum Trouble {
    Interrupted,
    /// A wish cannot be fulfilled, or the coordinator does not answer.
    Wish(Failure),
}

/// Reason why talking was given up.
pub(super) enum Ended {
    Interrupted,
    /// The programs at the other ends have ended, such as simulations.
    Over,
    Failed(anyhow::Error),
}

/// All lines. A wish for one node goes to the coordinator that has it, once one does.
pub(super) struct Lines {
    pub(super) all: Vec<Line>,
    waiting: VecDeque<Wish>,
    /// Time since which no coordinator has the node that the first waiting wish concerns.
    missing: Option<Duration>,
}

impl Lines {
    /// Every coordinator gets the wishes that concern all its network.
    pub(super) fn open(
        (paths, baud): (&[String], u32),
        wishes: Vec<Wish>,
        interrupted: &Arc<AtomicBool>,
    ) -> Result<Self, OpenError> {
        let is_one = paths.len() == 1;
        let concerns_all = |wish: &Wish| {
            let is_of_a_node =
                matches!(wish, Wish::Remove(_) | Wish::Command(..) | Wish::Stands(..));
            is_one || !is_of_a_node
        };
        let (everybodys, waiting): (Vec<_>, VecDeque<_>) =
            wishes
                .into_iter()
                .fold(Default::default(), |(mut all, mut waiting), wish| {
                    match concerns_all(&wish) {
                        true => all.push(wish),
                        false => waiting.push_back(wish),
                    }
                    (all, waiting)
                });
        let open = |(number, path): (u16, &String)| {
            let port = Port::open(path, baud, interrupted.clone())?;
            debug!(port = path, "the line is there");
            Ok(Line {
                path: path.clone(),
                prefix: match is_one {
                    true => String::new(),
                    false => format!("{path}: "),
                },
                network: Cell::new(number),
                session: Session::new(everybodys.iter().copied()),
                baud,
                interrupted: interrupted.clone(),
                port: Ok(port),
                plug: Plug::of(path),
                is_program: is_pseudo_terminal(path),
                said: VecDeque::new(),
                damaged: Throttle::default(),
                complaint: None,
            })
        };
        Ok(Self {
            all: (1..)
                .zip(paths)
                .map(open)
                .collect::<Result<_, OpenError>>()?,
            waiting,
            missing: None,
        })
    }

    /// Tells lengths in the unit of this site.
    pub(super) fn of_site(mut self, site: Option<&Scenario>) -> Self {
        if let Some(site) = site {
            for line in &mut self.all {
                line.session.tell_in(&site.unit);
            }
        }
        self
    }

    /// Asks for cameras' sightings, too.
    pub(super) fn with_sightings(mut self) -> Self {
        for line in &mut self.all {
            line.session.want_sightings();
        }
        self
    }

    /// Reads the bytes that have come, and sends those that are due.
    pub(super) fn exchange(&mut self, now: Duration) -> Result<(), Ended> {
        self.hand_out(now)?;
        for line in &mut self.all {
            line.exchange(now).map_err(|trouble| match trouble {
                Trouble::Interrupted => Ended::Interrupted,
                Trouble::Wish(failure) => Ended::Failed(anyhow!("{}: {failure}", line.path)),
            })?;
        }
        match self.all.iter().all(Line::is_over) {
            true => Err(Ended::Over),
            false => Ok(()),
        }
    }

    /// The line of the coordinator that heard last of this member.
    pub(super) fn of(&self, id: u16) -> Option<usize> {
        let heard = |line: &Line| Some(line.session.known().member(id)?.heard);
        let lines = self.all.iter().enumerate();
        let lines = lines.filter_map(|(n, line)| Some((heard(line)?, n)));
        lines.max().map(|(_, n)| n)
    }

    /// All cameras, each with the line of its coordinator.
    pub(super) fn cameras(&self) -> Vec<(usize, u16)> {
        let lines = self.all.iter().enumerate();
        let cameras = lines.flat_map(|(n, line)| {
            let cameras = line.session.known().cameras().into_iter();
            cameras.map(move |camera| (n, camera.id))
        });
        cameras.filter(|(n, id)| self.of(*id) == Some(*n)).collect()
    }

    /// Gives the next wish to the coordinator whose member it concerns.
    fn hand_out(&mut self, now: Duration) -> Result<(), Ended> {
        let Some(&(Wish::Remove(id) | Wish::Command(id, _) | Wish::Stands(id, _))) =
            self.waiting.front()
        else {
            return Ok(());
        };
        let are_done = self.all.iter().all(|line| line.session.is_done());
        if !are_done {
            return Ok(());
        }
        if let Some(of) = self.of(id) {
            self.all[of].session.wish(self.waiting[0]);
            self.waiting.pop_front();
            self.missing = None;
        } else if self.all.iter().all(|line| line.session.is_settled(now))
            && now.saturating_sub(*self.missing.get_or_insert(now)) >= MISSING
        {
            let lines = self.all.iter();
            let members = lines.flat_map(|line| line.session.known().present());
            let members = members.map(|member| member.id).collect();
            let failure = Failure::NoMember { id, members };
            return Err(Ended::Failed(anyhow!("{failure}")));
        }
        Ok(())
    }

    /// Returns true if every wish was confirmed.
    pub(super) fn are_done(&self) -> bool {
        self.waiting.is_empty() && self.all.iter().all(|line| line.session.is_done())
    }

    /// Returns true if any coordinator has told anything.
    pub(super) fn have_answered(&self) -> bool {
        self.all.iter().any(|line| line.session.has_answered())
    }

    /// Returns true if a coordinator has answered, and all that have are at the end of their lists of members.
    pub(super) fn are_listed(&self, now: Duration) -> bool {
        let mut answered = self.all.iter().filter(|line| line.session.has_answered());
        self.have_answered() && answered.all(|line| line.session.is_settled(now))
    }

    /// Fails if a coordinator never answered, and tells why that may be.
    pub(super) fn check_answered(&self) -> anyhow::Result<()> {
        match self.all.iter().find(|line| !line.session.has_answered()) {
            Some(line) => bail!("{}: {}", line.path, line.session.why_nothing()),
            None => Ok(()),
        }
    }

    /// Returns true if all members are listed with their sightings, there are at least `cameras` cameras, and
    /// at least one, and all have good poses.
    pub(super) fn are_calibrated(&self, now: Duration, cameras: usize) -> bool {
        let views = self.all.iter().map(|line| line.session.known());
        let is_told = |line: &Line| line.session.is_settled(now) && line.session.has_sightings(now);
        are_calibrated(views, cameras) && self.all.iter().all(is_told)
    }

    /// Record of all networks, as far as they are known.
    pub(super) fn record(
        &self,
        now: Duration,
        site: Option<&Scenario>,
    ) -> anyhow::Result<RunRecord> {
        if let [line] = &self.all[..] {
            let (number, record) = record(&line.session, now, site)?;
            // Of several networks of a site, the coordinators of the others may be told of elsewhere.
            let number = number.unwrap_or(1);
            line.network.set(number);
            return RunRecord::joined([(number, record)])
                .ok_or_else(|| anyhow!("there is no network"));
        }
        let mut parts = Vec::new();
        for (line, ordinal) in self.all.iter().zip(1..) {
            let (number, part) = record(&line.session, now, site)?;
            let number = number.unwrap_or(ordinal);
            line.network.set(number);
            if parts.iter().any(|(known, _)| *known == number) {
                // A coordinator without members yet may be that of any network.
                if line.session.known().members().is_empty() {
                    continue;
                }
                bail!(
                    "{}: is the coordinator of network {number} of the site too",
                    line.path
                );
            }
            parts.push((number, part));
        }
        RunRecord::joined(parts).ok_or_else(|| anyhow!("there is no network"))
    }
}

impl Line {
    /// Returns true if the port is open.
    pub(super) fn is_open(&self) -> bool {
        self.port.is_ok()
    }

    /// Returns true if the program at the other end has ended.
    fn is_over(&self) -> bool {
        self.is_program && !self.is_open()
    }

    /// The next thing to tell people. It is in the log by then.
    pub(super) fn news(&mut self) -> Option<String> {
        let news = self.said.pop_front().or_else(|| self.session.news())?;
        let port = &self.path;
        let words = news.words();
        match &news {
            News::Network(_) => info!(target: NEWS, port, "{words}"),
            News::Trouble(_) => warn!(port, "{words}"),
            News::Mended(_) => info!(port, "{words}"),
        }
        Some(words.to_owned())
    }

    /// Reads the bytes that have come, and sends those that are due. A line that is away is looked for, once it is
    /// time.
    pub(super) fn exchange(&mut self, now: Duration) -> Result<(), Trouble> {
        if self
            .port
            .as_ref()
            .is_err_and(|at| now.saturating_sub(*at) >= AGAIN)
        {
            self.port = self.opened_again(now).ok_or(now);
        }
        let Ok(port) = &mut self.port else {
            return Ok(());
        };
        let exchanged = exchange(port, &mut self.session, now);
        if let Some(count) = self.damaged.count(self.session.damaged()) {
            debug!(port = self.path, count, "damaged or unknown messages");
        }
        match exchanged {
            Ok(Ok(())) => Ok(()),
            Ok(Err(failure)) => Err(Trouble::Wish(failure)),
            Err(PortError::Interrupted) => Err(Trouble::Interrupted),
            Err(PortError::Io(_)) => {
                // The port is closed here, because it can be open only once.
                self.port = Err(now);
                let words = match self.is_program {
                    true => "the program at the other end of the line has ended",
                    false => "the line is gone: was it unplugged? It is waited for",
                };
                self.said.push_back(News::Trouble(words.to_owned()));
                Ok(())
            }
        }
    }

    /// The port, if it is there again, by whatever name. Another device that has its name now is left alone.
    fn opened_again(&mut self, now: Duration) -> Option<Port> {
        let path = match &self.plug {
            Some(plug) => plug.path()?,
            None => self.path.clone(),
        };
        match Port::open(&path, self.baud, self.interrupted.clone()) {
            Ok(port) => {
                self.is_program = is_pseudo_terminal(&path);
                self.complaint = None;
                self.session.begin_again(now);
                self.said.push_back(News::Mended(match path == self.path {
                    true => "the line is there again".to_owned(),
                    false => format!("the line is there again, as {path}"),
                }));
                Some(port)
            }
            Err(OpenError::Missing { .. }) => None,
            Err(error) => {
                let words = Some(error.to_string());
                if self.complaint != words {
                    self.said.extend(words.clone().map(News::Trouble));
                    self.complaint = words;
                }
                None
            }
        }
    }
}

/// Returns true if a path leads to an end of a pseudo-terminal: another program is at its other end.
fn is_pseudo_terminal(path: &str) -> bool {
    let device = fs::canonicalize(path).unwrap_or_default();
    // The second is that of macOS, whose terminals have a letter and digits.
    device.starts_with("/dev/pts") || device.to_string_lossy().starts_with("/dev/ttys")
}

/// Record of one network, as far as it is known, and the network's number in the file of the site.
fn record(
    session: &Session,
    now: Duration,
    site: Option<&Scenario>,
) -> anyhow::Result<(Option<u16>, RunRecord)> {
    let view = session.known();
    let members: Vec<u16> = view.members().iter().map(|member| member.id).collect();
    let plan = match site {
        Some(site) => SitePlan::new(site, &members)?,
        None => None,
    };
    let number = plan.as_ref().map(SitePlan::number);
    Ok((number, view.record(now, plan.as_ref())))
}

/// Reads the bytes that have come, and sends those that are due.
fn exchange(
    port: &mut Port,
    session: &mut Session,
    now: Duration,
) -> Result<Result<(), Failure>, PortError> {
    let mut bytes = [0; 512];
    while port.read_ready()? {
        let count = port.read(&mut bytes)?;
        session.heard(now, &bytes[..count]);
    }
    loop {
        match session.poll(now) {
            Ok(Some(message)) => port.write_all(&frame(&message))?,
            Ok(None) => return Ok(Ok(())),
            Err(failure) => return Ok(Err(failure)),
        }
    }
}
