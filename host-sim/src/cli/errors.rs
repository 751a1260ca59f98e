//! Errors in plain words, with the files that they are about.

use std::{
    fmt, fs, io,
    path::{Path, PathBuf},
};

use anyhow::anyhow;
use results::recorded::ReadError;
use site::{ScenarioError, durable::folder_of, nearest};

use super::{file_name, tell};

/// Characters of a line of a message.
const LINE_MAX: usize = 2000;

/// Prints an error.
pub(super) fn complain(error: &anyhow::Error) {
    let text = with_causes(error);
    // A parser quotes the line that it refuses, which may be the whole of a file.
    let lines = text
        .lines()
        .map(|line| match line.char_indices().nth(LINE_MAX) {
            Some((end, _)) => format!("{} ...", &line[..end]),
            None => line.to_owned(),
        });
    tell(format_args!(
        "host-sim: {}",
        lines.collect::<Vec<_>>().join("\n")
    ));
}

/// The error with its causes, except causes that it tells itself. The words of parsers and of the operating system
/// that mean nothing to most people are put into plain ones.
pub(super) fn with_causes(error: &anyhow::Error) -> String {
    let file = match error.downcast_ref() {
        Some(ScenarioError::File { path, .. }) => Some(OfFile::unread(Path::new(path))),
        _ => error.downcast_ref().cloned(),
    };
    let mut text = error.to_string();
    for cause in error.chain() {
        let raw = cause.to_string();
        if !text.contains(&raw) {
            text = format!("{text}: {raw}");
        }
        if let Some(plain) = plain(cause, file.as_ref()) {
            text = text.replace(&raw, &plain);
        }
    }
    text
}

/// A file whose error follows.
#[derive(Clone, Debug)]
pub(super) struct OfFile {
    path: PathBuf,
    is_read: bool,
    words: &'static str,
}

impl OfFile {
    /// A file that is read, by its name alone: its error tells the rest.
    pub(super) fn named(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            is_read: true,
            words: "",
        }
    }

    /// A file that cannot be read.
    pub(super) fn unread(path: &Path) -> Self {
        Self {
            words: " cannot be read",
            ..Self::named(path)
        }
    }

    /// A file that cannot be written.
    pub(super) fn unwritten(path: &Path) -> Self {
        Self {
            is_read: false,
            words: " cannot be written",
            ..Self::named(path)
        }
    }

    /// A file or folder that cannot be made.
    pub(super) fn unmade(path: &Path) -> Self {
        Self {
            words: " cannot be made",
            ..Self::unwritten(path)
        }
    }

    /// The reason why the file is not there, and what to do.
    fn why_missing(&self) -> String {
        let folder = folder_of(&self.path);
        if !folder.is_dir() {
            let advice = match self.is_read {
                true => "look at its name",
                false => "make it first",
            };
            return format!("there is no folder {}: {advice}", file_name(folder));
        }
        match near_file(&self.path) {
            Some(near) => format!(
                "there is no such file: did you mean `{}`?",
                file_name(&near)
            ),
            None => {
                let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
                format!(
                    "there is no such file in the folder {}: look at its name, or give the whole path",
                    file_name(&folder)
                )
            }
        }
    }
}

impl fmt::Display for OfFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", file_name(&self.path), self.words)
    }
}

/// The file of the same folder whose name is like this one: but for a slip, or but for its end.
pub(super) fn near_file(path: &Path) -> Option<PathBuf> {
    let (stem, extension) = (path.file_stem()?.to_str()?, path.extension());
    let files = fs::read_dir(folder_of(path))
        .into_iter()
        .flatten()
        .flatten();
    let files: Vec<PathBuf> = files
        .filter(|file| file.path().is_file())
        .map(|file| path.with_file_name(file.file_name()))
        .collect();
    let same_end = files.iter().filter(|file| file.extension() == extension);
    let stems = same_end.filter_map(|file| file.file_stem()?.to_str());
    let of_stem = |near: &str| {
        let mut near = PathBuf::from(near);
        near.as_mut_os_string().extend(
            extension
                .map(|end| [".".as_ref(), end])
                .into_iter()
                .flatten(),
        );
        path.with_file_name(near)
    };
    let near = nearest(stem, stems).map(of_stem);
    let mut others = files.iter();
    near.or_else(|| {
        let same = |file: &&PathBuf| file.file_stem() == path.file_stem();
        others.find(same).cloned()
    })
}

/// The part of a path that is a file where a folder must be.
pub(super) fn file_in_the_way(path: &Path) -> Option<String> {
    let is_file = |part: &&Path| part.exists() && !part.is_dir();
    let part = path.ancestors().find(is_file)?;
    Some(format!(
        "{} is a file, not a folder: name another place",
        file_name(part)
    ))
}

/// Advice to one who names a folder where a file is needed.
pub(super) const IS_FOLDER: &str = "it is a folder: name a file";

/// An error of a parser or of the operating system in plain words, where its own are not.
fn plain(error: &(dyn std::error::Error + 'static), file: Option<&OfFile>) -> Option<String> {
    if let Some(error) = error.downcast_ref::<io::Error>() {
        let words = error.to_string();
        return match (error.kind(), file) {
            (io::ErrorKind::NotFound, Some(file)) if !file.path.exists() => {
                Some(file.why_missing())
            }
            (io::ErrorKind::NotADirectory, Some(file)) => file_in_the_way(&file.path),
            (io::ErrorKind::IsADirectory, _) => Some(IS_FOLDER.to_owned()),
            _ if words.contains("valid UTF-8") => Some("it is no text in UTF-8".to_owned()),
            _ => Some(words.split_once(" (os error ")?.0.to_owned()),
        };
    }
    let error = error.downcast_ref::<serde_json::Error>()?;
    match error.classify() {
        serde_json::error::Category::Syntax => Some(format!("line {} is no JSON", error.line())),
        serde_json::error::Category::Eof => {
            Some(format!("its JSON is cut off in line {}", error.line()))
        }
        _ => None,
    }
}

/// A file's error with its name, and with the line in the form that editors follow.
pub(super) fn of_file(path: &Path, error: ReadError) -> anyhow::Error {
    let name = file_name(path);
    match error {
        ReadError::Io(error) => anyhow::Error::from(error).context(OfFile::unread(path)),
        ReadError::Row(complaint) => anyhow!("{name}:{}: {}", complaint.line, complaint.text),
        error => anyhow!("{name} {error}"),
    }
}

/// A site's error with the name of its file.
pub(super) fn of_site(name: &str, error: ScenarioError) -> anyhow::Error {
    match error.names_file() {
        true => error.into(),
        false => anyhow!("{name}: {error}"),
    }
}
