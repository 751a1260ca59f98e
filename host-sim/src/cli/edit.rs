//! `host-sim edit`

use std::{
    io,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{Mutex, MutexGuard, PoisonError, atomic::Ordering},
    thread,
    time::Duration,
};

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use host_sim::live::{Editing, Editor, Judged, SiteFile, serve_editor};
use site::{BUILT_IN, FILE_MAX, nearest};

use super::{
    errors::near_file,
    file_name,
    files::{Files, place},
    interrupt,
    live::{self, ServeOptions, open_browser},
    log_options::LogOptions,
    print, values, whole_file, with_causes,
};

/// Opens a site in a browser, where cameras and walls are placed, and tells what to expect before
/// anything is mounted: who sees what, how well cameras would know their poses, and how well they would
/// then tell where a target is.
///
/// Prints where to look; everything stays on this computer. Goes on until Ctrl-C. The file that is read
/// is never written, unless --save names it. A save writes the page's change to what the file holds then,
/// so that what others changed meanwhile stays.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    /// `thesis-13`, `lab`, `grid`, `office`, or the file of a site.
    #[arg(value_name = "SITE|FILE.toml")]
    site: String,
    /// File that the page saves to. Default: the browser downloads the file.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "json", value_parser = values::result())]
    save: Option<PathBuf>,
    /// --save may replace a file that is there and is not the one that is edited.
    #[arg(long, requires = "save")]
    replace: bool,
    /// Opens nothing, but writes what to expect, and where a further camera or stop would help most.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["open", "listen", "http_port"])]
    json: Option<PathBuf>,
    #[command(flatten)]
    serve: ServeOptions,
    #[command(flatten)]
    log: LogOptions,
}

const EPILOGUE: &str = "\
Examples:
  host-sim edit office.toml --open
  host-sim edit office --save mine.toml
  host-sim edit mine.toml --save mine.toml      to go on with it
  host-sim edit office.toml --json -            to be read by programs

Exit codes:
  0  Ctrl-C, or --json was written
  2  wrong options, or the file or the address is not to be had";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.log.start(live::LOG)?;
    let name = arguments.site.as_str();
    let text = match BUILT_IN.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => (*text).to_owned(),
        None => whole_file::read(Path::new(name), FILE_MAX)
            .map_err(|error| how_to_begin(name, error))?,
    };
    // --save may name the file that is read; --json never does.
    let read = !is_built_in(name);
    let json = arguments.json.iter().filter(|file| *file != Path::new("-"));
    Files::default()
        .reads(read.then_some(name))
        .writes(json)
        .check()?;
    Files::default().writes(&arguments.save).check()?;
    if let Some(file) = &arguments.json {
        let editor = Editor::new(&text).map_err(|error| anyhow!("{name}: {error}"))?;
        let judged = editor.judge(&editor.begun(0)?.layout, true);
        write(file, &judged)?;
        return Ok(ExitCode::SUCCESS);
    }
    let file = Kept::new(arguments, text)?;
    let editing = Editing::new(Box::new(file)).map_err(|error| anyhow!("{name}: {error}"))?;
    let interrupted = interrupt::watch()?;
    let address = arguments.serve.address();
    let server = serve_editor(address, name.to_owned(), editing)?;
    print(&format!("{}\n", server.url()))?;
    if arguments.serve.open {
        open_browser(&server.url());
    }
    while !interrupted.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(100));
    }
    Ok(ExitCode::SUCCESS)
}

fn is_built_in(name: &str) -> bool {
    BUILT_IN.iter().any(|(known, _)| *known == name)
}

/// The file of a site that is edited, and the one that it is saved to.
struct Kept {
    /// The file that is read, unless the site is built in.
    read: Option<PathBuf>,
    /// Text of a site that is built in.
    text: String,
    save: Option<PathBuf>,
    /// Text that a save replaces: that of `save` before the first save, if this is another file than `read`.
    replaced: Mutex<Option<Option<String>>>,
}

impl Kept {
    /// Refuses to take the place of another file unasked.
    fn new(arguments: &Arguments, text: String) -> anyhow::Result<Self> {
        let read = (!is_built_in(&arguments.site)).then(|| PathBuf::from(&arguments.site));
        let save = arguments.save.clone();
        let is_other =
            |save: &&PathBuf| read.as_ref().is_none_or(|read| place(read) != place(save));
        let replaced = save.as_ref().filter(is_other).map(|save| if_there(save));
        let replaced = replaced.transpose()?;
        if let (Some(save), Some(Some(_)), false) = (&save, &replaced, arguments.replace) {
            let name = file_name(save);
            bail!(
                "{name} is there already: go on with it (`host-sim edit {name} --save {name}`), name another \
                 file, or give --replace too"
            );
        }
        Ok(Self {
            read,
            text,
            save,
            replaced: Mutex::new(replaced),
        })
    }

    fn replaced(&self) -> MutexGuard<'_, Option<Option<String>>> {
        self.replaced.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Text of a file, if there is one.
fn if_there(path: &Path) -> anyhow::Result<Option<String>> {
    match path.try_exists() {
        Ok(false) => Ok(None),
        _ => whole_file::read(path, FILE_MAX).map(Some),
    }
}

impl SiteFile for Kept {
    fn text(&self) -> Result<Option<String>, String> {
        let read = match &self.save {
            Some(save) if self.replaced().is_none() => Some(save),
            _ => self.read.as_ref(),
        };
        match read {
            Some(file) => if_there(file).map_err(|error| with_causes(&error)),
            None => Ok(Some(self.text.clone())),
        }
    }

    fn save(&self, text: &str) -> Option<Result<String, String>> {
        let file = self.save.as_ref()?;
        let mut replaced = self.replaced();
        let written = || {
            if let Some(known) = &*replaced {
                ensure!(
                    if_there(file)? == *known,
                    "another program has written {} since `host-sim edit` was started: nothing was written \
                     now. Download this page's, and begin again with that file",
                    file_name(file)
                );
            }
            whole_file::write(file, text)
        };
        Some(match written() {
            Ok(()) => {
                *replaced = None;
                Ok(format!("saved as {}", file_name(file)))
            }
            Err(error) => Err(with_causes(&error)),
        })
    }
}

/// Adds a hint to the error of a missing file: the site that was probably meant, or a way to begin, for a user has no
/// file before the first save.
fn how_to_begin(name: &str, error: anyhow::Error) -> anyhow::Error {
    let is_missing = |cause: &io::Error| cause.kind() == io::ErrorKind::NotFound;
    if !error.downcast_ref().is_some_and(is_missing) {
        return error;
    }
    let path = Path::new(name);
    let is_path = path.extension().is_some() || path.components().count() > 1;
    let built_in = || nearest(name, BUILT_IN.map(|(known, _)| known)).filter(|_| !is_path);
    let near = near_file(path).map(|near| file_name(&near));
    match near.or_else(|| built_in().map(str::to_owned)) {
        Some(meant) => anyhow!("there is no file {name}: did you mean `{meant}`?"),
        None => anyhow!(
            "there is no file {name}: begin with a site that is built in, as `host-sim edit office \
             --save my-site.toml` does"
        ),
    }
}

fn write(file: &Path, judged: &Judged) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(judged).context("no JSON can be made of it")?;
    if file == Path::new("-") {
        return Ok(print(&(json + "\n"))?);
    }
    whole_file::write(file, json + "\n")
}
