//! A file that several pages, and other programs, may change at the same time.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use super::{Begun, EditError, Editor, Judged, Layout, Side, joined::joined};

/// The file of a site, as the program keeps it. Errors are told in words.
pub trait SiteFile: Send + Sync {
    /// Text that it holds now; `None` if there is no such file any more.
    ///
    /// # Errors
    /// It cannot be read.
    fn text(&self) -> Result<Option<String>, String>;

    /// Writes a text, and tells where; `None` if the browser is to download it.
    ///
    /// # Errors
    /// It cannot be written, or holds what would be lost.
    fn save(&self, text: &str) -> Option<Result<String, String>>;
}

/// A page's question or wish.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asked {
    /// The version of which the layout is a change: [`Begun::version`].
    version: usize,
    /// The wanted layout.
    layout: Layout,
    /// A design is asked for with advice.
    #[serde(default)]
    advice: bool,
    /// The change that holds where page and file changed the same thing.
    #[serde(default)]
    prefer: Option<Side>,
    /// The text is wanted as the page has it, and nothing is written.
    #[serde(default)]
    download: bool,
}

/// Outcome of a save.
#[derive(Clone, Debug, Serialize)]
pub struct Saved {
    /// Description of it; none of a download.
    pub words: Option<String>,
    /// Text for a download.
    pub text: Option<String>,
    /// The file had changed since the page read it, and has both changes now.
    pub joined: bool,
    /// The version to which the page's next change is one.
    pub site: Begun,
    /// The page's layout, with obstacles numbered as in that version.
    pub layout: Layout,
}

/// A site that is edited. Keeps all texts that pages began with.
pub struct Editing {
    file: Box<dyn SiteFile>,
    versions: Mutex<Vec<Arc<Version>>>,
}

struct Version {
    text: String,
    editor: Editor,
}

impl Editing {
    /// A file, if it can be edited as it is.
    ///
    /// # Errors
    /// [`EditError`]
    pub fn new(file: Box<dyn SiteFile>) -> Result<Self, EditError> {
        let this = Self {
            file,
            versions: Mutex::default(),
        };
        this.begun()?;
        Ok(this)
    }

    /// The site as its file has it now.
    ///
    /// # Errors
    /// [`EditError`]
    pub fn begun(&self) -> Result<Begun, EditError> {
        let mut versions = self.versions();
        match self.file.text().map_err(EditError::File)? {
            Some(text) => begun(&mut versions, &text),
            None => Err(EditError::Gone),
        }
    }

    /// Expected results of a layout, with advice if it was asked for.
    ///
    /// # Errors
    /// [`EditError::Unknown`]
    pub fn judge(&self, asked: &Asked) -> Result<Judged, EditError> {
        let version = known(&self.versions(), asked.version)?;
        Ok(version.editor.judge(&asked.layout, asked.advice))
    }

    /// Writes the page's change to what the file holds now.
    ///
    /// # Errors
    /// [`EditError::Conflicts`] if both have changed the same thing, and others. Nothing is written then.
    pub fn save(&self, asked: &Asked) -> Result<Saved, EditError> {
        // Held to the end, so that of two saves the second one sees the first.
        let mut versions = self.versions();
        let version = known(&versions, asked.version)?;
        let Asked { layout, .. } = asked;
        if asked.download {
            return Ok(Saved {
                words: None,
                text: Some(version.editor.text(layout)?),
                joined: false,
                site: version.editor.begun(asked.version)?,
                layout: layout.clone(),
            });
        }
        // What is gone is written anew.
        let text = self.file.text().map_err(EditError::File)?;
        let text = text.unwrap_or_else(|| version.text.clone());
        let now = begun(&mut versions, &text).map_err(|error| EditError::Now(Box::new(error)))?;
        let base = version.editor.layout()?;
        let layout =
            joined((&base, &now.layout), layout, asked.prefer).map_err(EditError::Conflicts)?;
        let joined = now.layout != base;
        let new = known(&versions, now.version)?.editor.text(&layout)?;
        match self.file.save(&new) {
            None => Ok(Saved {
                words: None,
                text: Some(new),
                joined,
                site: now,
                layout,
            }),
            Some(written) => {
                let words = written.map_err(EditError::File)?;
                let site = begun(&mut versions, &new)?;
                let layout = site.layout.clone();
                Ok(Saved {
                    words: Some(words),
                    text: None,
                    joined,
                    site,
                    layout,
                })
            }
        }
    }

    fn versions(&self) -> MutexGuard<'_, Vec<Arc<Version>>> {
        self.versions.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn known(versions: &[Arc<Version>], number: usize) -> Result<Arc<Version>, EditError> {
    let version = versions.get(number).cloned();
    version.ok_or(EditError::Unknown("version"))
}

/// A text as a page begins with it, of a version that is known from now on.
fn begun(versions: &mut Vec<Arc<Version>>, text: &str) -> Result<Begun, EditError> {
    let number = match versions.iter().position(|known| known.text == text) {
        Some(number) => number,
        None => {
            let editor = Editor::new(text)?;
            let text = text.to_owned();
            versions.push(Arc::new(Version { text, editor }));
            versions.len() - 1
        }
    };
    versions[number].editor.begun(number)
}
