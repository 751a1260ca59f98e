//! Events on a coordinator's line, in files.

use std::{
    collections::BTreeMap,
    fs,
    io::Write,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context, bail};
use clap::Args;
use results::record::{
    RunRecord,
    event::{Event, Looker, What},
};

use super::{OfFile, and, errors::file_in_the_way, files::Files, late::Late, values};

/// Files to write.
#[derive(Args)]
pub(super) struct HappeningsOptions {
    /// Events as they happen, one line of JSON each (docs/events.md).
    #[arg(long, value_name = "FILE", value_parser = values::result())]
    events: Option<PathBuf>,
    /// Packets of cameras that were told to track: a file for each in this folder, such as camera-3.csv.
    #[arg(long, value_name = "DIR", value_parser = values::result())]
    tracked: Option<PathBuf>,
}

impl HappeningsOptions {
    /// These files besides others that are written.
    pub(super) fn among<'a>(&'a self, others: Files<'a>) -> Files<'a> {
        others.writes(&self.events)
    }
}

/// Time between two looks for events.
const LOOKS: Duration = Duration::from_millis(200);

/// Columns of the files of cameras that track: those of the camera's own packet.
const COLUMNS: &str = "seconds,mx,my,left,upper,right,lower,pixels,confidence\n";

/// The files, as they grow.
pub(super) struct Happenings {
    looker: Looker,
    looked: Option<Duration>,
    events: Option<Late>,
    folder: Option<PathBuf>,
    cameras: BTreeMap<u16, Late>,
}

impl Happenings {
    /// Makes the folder, if one is wanted.
    pub(super) fn new(options: &HappeningsOptions) -> anyhow::Result<Self> {
        if let Some(folder) = &options.tracked {
            if let Some(file) = file_in_the_way(folder) {
                bail!("{}: {file}", OfFile::unmade(folder));
            }
            fs::create_dir_all(folder).with_context(|| OfFile::unmade(folder))?;
        }
        Ok(Self {
            looker: Looker::default(),
            looked: None,
            events: options.events.as_deref().map(Late::new),
            folder: options.tracked.clone(),
            cameras: BTreeMap::new(),
        })
    }

    /// Returns true if events are wanted, and it is time to look at the record.
    pub(super) fn is_due(&self, now: Duration) -> bool {
        let is_late = |at| now.saturating_sub(at) >= LOOKS;
        self.events.is_some() && self.looked.is_none_or(is_late)
    }

    /// Takes in what is known by now.
    pub(super) fn look(&mut self, now: Duration, record: &RunRecord) {
        self.looked = Some(now);
        let events = self.looker.look(record);
        self.write(&events);
    }

    /// Writes a message in words.
    pub(super) fn said(&mut self, now: Duration, words: &str) {
        // The first line in the file is that of the record.
        if self.looked.is_some() {
            let words = words.to_owned();
            let what = What::Said { node: None, words };
            self.write(&[Event::new(now.as_secs_f64(), what)]);
        }
    }

    /// Takes in an event that the record does not tell.
    pub(super) fn happened(&mut self, now: Duration, what: &What) {
        let seconds = now.as_secs_f64();
        if self.looked.is_some() {
            self.write(&[Event::new(seconds, what.clone())]);
        }
        if let (
            Some(folder),
            What::Tracked {
                node,
                middle: [mx, my],
                edges: [left, upper, right, lower],
                pixels,
                confidence,
                ..
            },
        ) = (&self.folder, what)
        {
            let file = self.cameras.entry(*node);
            let file = file.or_insert_with(|| begun(folder, *node));
            // Errors are told at the end.
            let _ = writeln!(
                file,
                "{seconds:.3},{mx},{my},{left},{upper},{right},{lower},{pixels},{confidence}"
            );
        }
    }

    fn write(&mut self, events: &[Event]) {
        if let Some(file) = &mut self.events {
            for line in events.iter().filter_map(|event| event.to_line().ok()) {
                let _ = file.write_all(line.as_bytes());
            }
        }
    }

    /// Writes the final record; errors of files are told or returned.
    pub(super) fn finish(mut self, record: Option<&RunRecord>) -> anyhow::Result<()> {
        if let Some(record) = record.filter(|_| self.events.is_some()) {
            let mut events = match self.looked {
                Some(_) => Vec::new(),
                None => self.looker.look(record),
            };
            events.extend(self.looker.end(record, None));
            self.write(&events);
        }
        let files = self.events.into_iter().chain(self.cameras.into_values());
        let mut ended = Ok(());
        for file in files {
            ended = and(ended, file.finish());
        }
        ended
    }
}

fn begun(folder: &Path, node: u16) -> Late {
    let mut file = Late::new(&folder.join(format!("camera-{node}.csv")));
    let _ = file.write_all(COLUMNS.as_bytes());
    file
}
