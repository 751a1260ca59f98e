//! The log: records of happenings on the standard error output, with levels, for commands that run for months.
//!
//! Parts of the program make records with the macros of `tracing`. [`start`] decides which of them are written, and how.

use std::{
    io::{self, Write},
    str::FromStr,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use indicatif::ProgressBar;
use tracing::{Event, Level, Subscriber, level_filters::LevelFilter};
use tracing_subscriber::{
    filter::Targets,
    fmt::{
        self, FmtContext, FormatEvent, FormatFields,
        format::{Format, Full, Writer},
    },
    layer::SubscriberExt,
    registry::LookupSpan,
    util::{SubscriberInitExt, TryInitError},
};

/// Target of the records of what a network tells: members that join, poses, health.
pub const NEWS: &str = "host_sim::news";

/// Choice of records: `LEVEL` of all, and `TARGET=LEVEL` of parts of the program, with commas between.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    all: Option<LevelFilter>,
    parts: Vec<(String, LevelFilter)>,
}

/// Part of a filter that cannot be understood.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no filter of the log: a level is needed (error, warn, info, debug, trace or off), or levels of parts of \
     the program, such as info,host_sim::live=debug"
)]
pub struct FilterError(String);

impl FromStr for Filter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let mut filter = Self::default();
        for part in text.split(',').map(str::trim) {
            let wrong = || FilterError(part.to_owned());
            match part.split_once('=') {
                Some((target, named)) if !target.trim().is_empty() => {
                    let level = level(named).ok_or_else(wrong)?;
                    filter.parts.push((target.trim().to_owned(), level));
                }
                _ => filter.all = Some(level(part).ok_or_else(wrong)?),
            }
        }
        Ok(filter)
    }
}

/// A level by its name. That of `tracing` takes numbers and nothing at all, too.
fn level(name: &str) -> Option<LevelFilter> {
    let name = name.trim();
    let is_word = !name.is_empty() && name.chars().all(char::is_alphabetic);
    name.parse().ok().filter(|_| is_word)
}

impl Filter {
    /// This filter over the usual one of a command, which holds where this one names nothing.
    fn over(&self, usual: &Self) -> Targets {
        let base = match self.all {
            Some(_) => &Self::default(),
            None => usual,
        };
        let all = self.all.or(base.all).unwrap_or(LevelFilter::OFF);
        let parts = base.parts.iter().chain(&self.parts).cloned();
        Targets::new().with_default(all).with_targets(parts)
    }
}

/// Begins to write records, once for the program: those of a filter over the usual one of the command. Time stamps are
/// left out, and priorities added, where the journal of systemd reads them.
///
/// # Errors
/// They are written already.
pub fn start(filter: &Filter, usual: &Filter) -> Result<(), TryInitError> {
    let layer = fmt::layer().with_writer(|| Records).with_ansi(false);
    let filter = filter.over(usual);
    let registry = tracing_subscriber::registry().with(filter);
    match is_journal() {
        true => {
            let format = Journal(Format::default().without_time().with_ansi(false));
            registry.with(layer.event_format(format)).try_init()
        }
        false => registry.with(layer).try_init(),
    }
}

/// Returns true if the standard error output goes to the journal of systemd. The variable alone does not tell: programs
/// inherit it, and their outputs may lead elsewhere (`JOURNAL_STREAM` in systemd.exec(5)).
#[cfg(unix)]
fn is_journal() -> bool {
    let is_it = |named: String| {
        let open = rustix::fs::fstat(io::stderr()).ok()?;
        Some(named == format!("{}:{}", open.st_dev, open.st_ino))
    };
    let named = std::env::var("JOURNAL_STREAM").ok();
    named.and_then(is_it).unwrap_or(false)
}

#[cfg(not(unix))]
fn is_journal() -> bool {
    false
}

/// Form of records for the journal: the priority first, as sd-daemon(3) has it.
struct Journal(Format<Full, ()>);

impl<S, N> FormatEvent<S, N> for Journal
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> std::fmt::Result {
        let priority = match *event.metadata().level() {
            Level::ERROR => 3,
            Level::WARN => 4,
            Level::INFO => 6,
            _ => 7,
        };
        write!(writer, "<{priority}>")?;
        self.0.format_event(context, writer, event)
    }
}

/// Drawing on the terminal that steps aside for a record.
static DRAWING: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Has a drawing on the terminal step aside for each record from now on.
pub fn keep_clear_of(drawing: &ProgressBar) {
    *DRAWING.lock().unwrap_or_else(PoisonError::into_inner) = Some(drawing.clone());
}

/// Writer of one record.
struct Records;

impl Write for Records {
    fn write(&mut self, record: &[u8]) -> io::Result<usize> {
        // A failure here cannot be told anywhere.
        let tell = || drop(io::stderr().write_all(record));
        let drawing = DRAWING.lock().unwrap_or_else(PoisonError::into_inner);
        match &*drawing {
            Some(drawing) => drawing.suspend(tell),
            None => tell(),
        }
        Ok(record.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Shortest time between two records of happenings that may come in floods.
const PERIOD: Duration = Duration::from_secs(60);

/// Happenings of one kind of which strangers can make any number: the first makes a record, and then all of a minute
/// together make one.
#[derive(Debug, Default)]
pub struct Throttle(Mutex<Flood>);

#[derive(Debug, Default)]
struct Flood {
    told: Option<Instant>,
    untold: u64,
}

impl Throttle {
    /// Counts happenings. Returns the number since the last record, if it is time for one.
    pub fn count(&self, more: u64) -> Option<u64> {
        self.count_at(Instant::now(), more)
    }

    fn count_at(&self, now: Instant, more: u64) -> Option<u64> {
        let mut flood = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        flood.untold += more;
        let is_late = |told: Instant| now.saturating_duration_since(told) >= PERIOD;
        if flood.untold == 0 || !flood.told.is_none_or(is_late) {
            return None;
        }
        flood.told = Some(now);
        Some(std::mem::take(&mut flood.untold))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_is_levels_of_all_and_of_parts() {
        let usual: Filter = "host_sim=info,host_sim::news=warn".parse().unwrap();
        let is_on = |filter: &str, target: &str, level| {
            let filter: Filter = filter.parse().unwrap();
            filter.over(&usual).would_enable(target, &level)
        };
        let none = Filter::default().over(&usual);
        assert!(none.would_enable("host_sim::cli::lines", &Level::INFO));
        assert!(!none.would_enable("host_sim::cli::lines", &Level::DEBUG));
        assert!(!none.would_enable(NEWS, &Level::INFO));
        assert!(!none.would_enable("rumqttc", &Level::ERROR));
        // One level is that of all.
        assert!(is_on("debug", NEWS, Level::DEBUG));
        assert!(is_on("debug", "rumqttc::state", Level::DEBUG));
        assert!(!is_on("off", "host_sim::live::server", Level::ERROR));
        // What a filter does not name stays as usual.
        let part = "host_sim::live=debug, rumqttc = TRACE";
        assert!(is_on(part, "host_sim::live::server", Level::DEBUG));
        assert!(is_on(part, "rumqttc::state", Level::TRACE));
        assert!(is_on(part, "host_sim::mqtt::reader", Level::INFO));
        assert!(!is_on(part, "host_sim::mqtt::reader", Level::DEBUG));
        assert!(!is_on(part, NEWS, Level::INFO));
        assert!(is_on("warn,host_sim::news=info", NEWS, Level::INFO));
    }

    #[test]
    fn words_that_are_no_level_are_refused() {
        for (text, wrong) in [
            ("", ""),
            ("loud", "loud"),
            ("3", "3"),
            ("info,", ""),
            ("info,host_sim::live", "host_sim::live"),
            ("host_sim::live=", "host_sim::live="),
            ("=debug", "=debug"),
            ("host_sim=debug=info", "host_sim=debug=info"),
        ] {
            let error = text.parse::<Filter>().unwrap_err();
            assert_eq!(error, FilterError(wrong.to_owned()), "{text}");
        }
    }

    #[test]
    fn a_flood_makes_a_record_a_minute() {
        let (flood, begin) = (Throttle::default(), Instant::now());
        let at = |seconds| begin + Duration::from_secs(seconds);
        assert_eq!(flood.count_at(at(0), 0), None);
        assert_eq!(flood.count_at(at(0), 2), Some(2));
        for _ in 0..1_000 {
            assert_eq!(flood.count_at(at(59), 1), None);
        }
        assert_eq!(flood.count_at(at(60), 0), Some(1_000));
        assert_eq!(flood.count_at(at(200), 0), None);
        assert_eq!(flood.count_at(at(200), 1), Some(1));
    }
}
