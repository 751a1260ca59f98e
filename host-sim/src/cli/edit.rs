//! `host-sim edit`

use std::{
    io,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::atomic::Ordering,
    thread,
    time::Duration,
};

use anyhow::{Context, anyhow};
use clap::Args;
use host_sim::live::{Editing, Editor, Judged, Save, serve_editor};
use site::{BUILT_IN, FILE_MAX};

use super::{
    files::Files,
    interrupt,
    live::{ServeOptions, open_browser},
    print, values, whole_file,
};

/// Opens a site in a browser, where cameras and walls are placed, and tells what to expect before
/// anything is mounted: who sees what, how well cameras would know their poses, and how well they would
/// then tell where a target is.
///
/// Prints where to look; everything stays on this computer. Goes on until Ctrl-C. The file that is read
/// is never written, unless --save names it.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    /// `thesis-13`, `lab`, `grid`, `office`, or the file of a site.
    #[arg(value_name = "SITE|FILE.toml")]
    site: String,
    /// File that the page saves to. Default: the browser downloads the file.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "json", value_parser = values::result())]
    save: Option<PathBuf>,
    /// Opens nothing, but writes what to expect, and where a further camera or stop would help most.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["open", "listen", "http_port"])]
    json: Option<PathBuf>,
    #[command(flatten)]
    serve: ServeOptions,
}

const EPILOGUE: &str = "\
Examples:
  host-sim edit office.toml --open
  host-sim edit office --save mine.toml
  host-sim edit office.toml --json -            to be read by programs

Exit codes:
  0  Ctrl-C, or --json was written
  2  wrong options, or the file or the address is not to be had";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let name = arguments.site.as_str();
    let text = match BUILT_IN.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => (*text).to_owned(),
        None => whole_file::read(Path::new(name), FILE_MAX)
            .map_err(|error| how_to_begin(name, error))?,
    };
    // --save may name the file that is read; --json never does.
    let read = BUILT_IN.iter().all(|(known, _)| *known != name);
    let json = arguments.json.iter().filter(|file| *file != Path::new("-"));
    Files::default()
        .reads(read.then_some(name))
        .writes(json)
        .check()?;
    Files::default().writes(&arguments.save).check()?;
    let editor = Editor::new(&text).map_err(|error| anyhow!("{name}: {error}"))?;
    if let Some(file) = &arguments.json {
        let judged = editor.judge(&editor.begun()?.layout, true);
        write(file, &judged)?;
        return Ok(ExitCode::SUCCESS);
    }
    let interrupted = interrupt::watch()?;
    let save = arguments.save.clone().map(|file| -> Save {
        Box::new(move |text| {
            let written = whole_file::write(&file, text);
            written.map_err(|error| format!("{error:#}"))?;
            Ok(format!("saved as {}", file.display()))
        })
    });
    let address = arguments.serve.address();
    let server = serve_editor(address, name.to_owned(), Editing { editor, save })?;
    print(&format!("{}\n", server.url()))?;
    if arguments.serve.open {
        open_browser(&server.url());
    }
    while !interrupted.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(100));
    }
    Ok(ExitCode::SUCCESS)
}

/// Adds a hint to the error of a missing file: a user has no file before the first save.
fn how_to_begin(name: &str, error: anyhow::Error) -> anyhow::Error {
    let is_missing = |cause: &io::Error| cause.kind() == io::ErrorKind::NotFound;
    match error.downcast_ref().is_some_and(is_missing) {
        true => anyhow!(
            "there is no file {name}: begin with a site that is built in, as `host-sim edit office \
             --save my-site.toml` does"
        ),
        false => error,
    }
}

fn write(file: &Path, judged: &Judged) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(judged).context("no JSON can be made of it")?;
    if file == Path::new("-") {
        return Ok(print(&(json + "\n"))?);
    }
    whole_file::write(file, json + "\n")
}
