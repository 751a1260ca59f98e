//! Video in real time: a thread reads it, the camera looks at the newest picture.

use std::{
    io,
    path::Path,
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, anyhow};
use cmucam2_emulator::Picture;
use host_sim::video::{Video, VideoError};

use super::super::{OfFile, tell};

/// The name that stands for the standard input.
const STANDARD_INPUT: &str = "-";

/// A video that is being shown.
pub(super) struct Film {
    name: String,
    newest: Arc<Mutex<Newest>>,
}

#[derive(Default)]
struct Newest {
    /// The newest picture, until the camera has taken it.
    picture: Option<Arc<Picture>>,
    /// Set when there are no more pictures.
    end: Option<Result<(), VideoError>>,
}

impl Film {
    /// Reads the first picture, and starts a thread that reads the others.
    ///
    /// A file is shown at its rate. The program that writes a pipe sets the pace itself.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let is_input = path.as_os_str() == STANDARD_INPUT;
        let name = match is_input {
            true => "the standard input".to_owned(),
            false => path.display().to_string(),
        };
        let is_file = !is_input && path.is_file();
        let video = match is_input {
            true => Video::new(io::BufReader::new(io::stdin())),
            false => Video::open(path),
        };
        let mut video = video.with_context(|| OfFile::named(path))?;
        let first = video
            .next_picture()
            .and_then(|first| first.ok_or(VideoError::Empty));
        let newest = Newest {
            picture: Some(Arc::new(first.with_context(|| name.clone())?)),
            end: None,
        };
        let (width, height) = video.size();
        let rate = video.rate();
        tell(format_args!(
            "it sees {name}: {width} x {height} pixels, {rate:.3} pictures a second"
        ));
        let newest = Arc::new(Mutex::new(newest));
        let to = newest.clone();
        thread::Builder::new()
            .name("video".to_owned())
            .spawn(move || show(video, is_file, &to))?;
        Ok(Self { name, newest })
    }

    /// The newest picture, if there is one since the last call.
    pub(super) fn take(&self) -> anyhow::Result<Option<Arc<Picture>>> {
        let Ok(mut newest) = self.newest.lock() else {
            return Err(anyhow!("{}: reading it failed", self.name));
        };
        let picture = newest.picture.take();
        let end = newest.end.take();
        drop(newest);
        match end {
            None => {}
            Some(Ok(())) => tell(format_args!(
                "{} has ended: its last picture stays",
                self.name
            )),
            // The camera stays, and what it saw last.
            Some(Err(error)) => tell(format_args!("{}: {error}", self.name)),
        }
        Ok(picture)
    }
}

fn show(mut video: Video, at_its_rate: bool, to: &Mutex<Newest>) {
    let begun = Instant::now();
    loop {
        if at_its_rate {
            let due = Duration::try_from_secs_f64(video.next_at()).unwrap_or(Duration::MAX);
            thread::sleep(due.saturating_sub(begun.elapsed()));
        }
        let next = video.next_picture();
        let Ok(mut newest) = to.lock() else { return };
        match next {
            Ok(Some(picture)) => newest.picture = Some(Arc::new(picture)),
            Ok(None) => {
                newest.end = Some(Ok(()));
                return;
            }
            Err(error) => {
                newest.end = Some(Err(error));
                return;
            }
        }
    }
}
