//! Judgements of runs in files, a line each: a campaign that was cut short goes on, and its parts add up.

use std::{
    collections::BTreeSet,
    fs::{self, File, OpenOptions},
    io::Write,
    path::Path,
};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::{judgement::Judgement, scenario::Draw};

/// A run that was judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Seed of the campaign.
    pub seed: u64,
    /// Faults that were drawn.
    pub draw: Draw,
    /// Number of the run.
    pub number: u64,
    /// Judgement of it.
    pub judgement: Judgement,
    /// Everything unusual about it.
    pub ingredients: BTreeSet<String>,
}

/// Beginning of each line.
const BEGIN: &str = "{\"seed\":";

/// The runs of a file. A last line that was cut off is left out.
///
/// # Errors
/// It cannot be read, has other lines, or is of another campaign.
pub fn read(path: &Path, seed: u64, draw: Draw) -> Result<Vec<Judged>> {
    let name = path.display();
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {name}"))?;
    let (whole, rest) = text.split_at(text.rfind('\n').map_or(0, |end| end + 1));
    // A file of something else that has no line is no journal, and must not be cut off.
    ensure!(
        rest.starts_with(BEGIN) || BEGIN.starts_with(rest),
        "{name}: its last line is no run of a campaign"
    );
    let lines = whole.lines().enumerate();
    lines
        .map(|(line, text)| {
            let run: Judged = serde_json::from_str(text)
                .with_context(|| format!("{name}, line {}: no run of a campaign", line + 1))?;
            ensure!(
                (run.seed, run.draw) == (seed, draw),
                "{name} has runs of seed {}, {:?}: give another file, or --seed and --draw of that campaign",
                run.seed,
                run.draw
            );
            Ok(run)
        })
        .collect()
}

/// Opens a file to append to it, behind its last whole line. Makes one if there is none.
///
/// # Errors
/// It cannot be written.
pub fn append(path: &Path) -> Result<File> {
    let open = || -> std::io::Result<File> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        let text = fs::read(path)?;
        let whole = text.iter().rposition(|byte| *byte == b'\n');
        file.set_len(whole.map_or(0, |end| end as u64 + 1))?;
        Ok(file)
    };
    open().with_context(|| format!("cannot write {}", path.display()))
}

/// Writes the line of a run.
///
/// # Errors
/// It cannot be written.
pub fn write(file: &mut File, run: &Judged) -> Result<()> {
    let mut line = serde_json::to_string(run)?;
    line.push('\n');
    Ok(file.write_all(line.as_bytes())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judgement::Failure;

    fn run(number: u64) -> Judged {
        Judged {
            seed: 7,
            draw: Draw::Daily,
            number,
            judgement: Judgement {
                failures: vec![Failure::Deceives {
                    camera: 3,
                    error: 0.1 + 0.2,
                    sigmas: None,
                }],
                cameras: Vec::new(),
            },
            ingredients: ["loss".to_owned()].into(),
        }
    }

    /// Runs as they were, to the last bit, also behind a line that was cut off.
    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs.jsonl");
        assert!(read(&path, 7, Draw::Daily).is_err(), "there is none");
        write(&mut append(&path).unwrap(), &run(1)).unwrap();
        append(&path)
            .unwrap()
            .write_all(b"{\"seed\":7,\"nu")
            .unwrap();
        assert_eq!(read(&path, 7, Draw::Daily).unwrap(), [run(1)]);
        write(&mut append(&path).unwrap(), &run(2)).unwrap();
        assert_eq!(read(&path, 7, Draw::Daily).unwrap(), [run(1), run(2)]);
        let other = read(&path, 8, Draw::Daily).unwrap_err().to_string();
        assert!(other.contains("seed 7"), "{other}");
        append(&path).unwrap().write_all(b"nothing").unwrap();
        let other = read(&path, 7, Draw::Daily).unwrap_err().to_string();
        assert!(other.contains("last line"), "{other}");
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"\n").unwrap();
        let broken = read(&path, 7, Draw::Daily).unwrap_err().to_string();
        assert!(broken.contains("line 3"), "{broken}");
    }
}
