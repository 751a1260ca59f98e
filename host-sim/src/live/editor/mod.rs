//! A site's file as the user changes it at the page. All text that does not change is kept to the letter.

use serde::{Deserialize, Serialize};
use site::{
    OutlineTable, Overrides, Scenario, ScenarioError,
    design::{Advice, Design},
};
use toml_edit::DocumentMut;

mod editing;
mod file;
mod joined;
#[cfg(test)]
mod tests;

pub use editing::{Asked, Editing, Saved, SiteFile};
pub use joined::Side;

/// Number of further cameras and of further stops that are advised.
const ADVISED: usize = 3;

/// The part of a site that can be changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// The cameras of each network.
    pub networks: Vec<Vec<Placed>>,
    /// Obstacles.
    pub obstacles: Vec<Hindrance>,
}

/// Pose that a camera is to have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placed {
    /// Its number.
    pub id: u16,
    /// Position along the x axis.
    pub x: f64,
    /// Position along the y axis.
    pub y: f64,
    /// Direction, degrees from the x axis.
    pub heading_deg: f64,
    /// Height of its lens above the floor. `None`: that of the ball.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Angle of its optical axis below the horizon, degrees. `None`: level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_deg: Option<f64>,
    /// Turn about that axis, degrees. `None`: upright.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<f64>,
}

impl Placed {
    /// The keys of a file that tell how it hangs, and their values.
    fn mount(&self) -> [(&'static str, Option<f64>); 3] {
        [
            ("height", self.height),
            ("pitch_deg", self.pitch_deg),
            ("roll_deg", self.roll_deg),
        ]
    }
}

/// An obstacle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hindrance {
    /// Number of the file's obstacle that it was, from 0, if any. They stay in their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// Its present kind and numbers; an obstacle of the file keeps its kind.
    pub is: OutlineTable,
}

/// A site with its expected results.
#[derive(Clone, Debug, Serialize)]
pub struct Judged {
    /// The expected results; `None` if the site cannot be put up.
    pub design: Option<Design>,
    /// Reason why the site cannot be put up.
    pub refused: Option<String>,
    /// Place where one more would help most, if that was asked.
    pub advice: Option<Advice>,
}

/// A site as the page begins with it.
#[derive(Clone, Debug, Serialize)]
pub struct Begun {
    /// Number of this version of the file.
    pub version: usize,
    /// Its name.
    pub name: String,
    /// Name of its unit of length.
    pub unit: String,
    /// Lowest and highest corner of the place.
    pub bounds: [[f64; 2]; 2],
    /// It was a `grid`; the saved file names each camera.
    pub was_grid: bool,
    /// Cameras and obstacles.
    pub layout: Layout,
    /// Numbers of nodes without a camera.
    pub taken: Vec<u16>,
}

/// Reason why a file cannot be edited.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// It is not a site.
    #[error(transparent)]
    Site(#[from] ScenarioError),
    /// It is not TOML.
    #[error(transparent)]
    Text(#[from] toml_edit::TomlError),
    /// The networks of its grid cannot be written down.
    #[error("its grid cannot be written as cameras: {0}")]
    Grid(#[from] toml::ser::Error),
    /// A camera has no place yet.
    #[error("camera {0} has no `x`, `y` and `heading_deg`: give it some first")]
    Unplaced(u16),
    /// The page names something that the file does not have.
    #[error("the file has no such {0}")]
    Unknown(&'static str),
    /// A number is not finite.
    #[error("a place is not a number")]
    NotFinite,
    /// The file cannot be read or written, in words.
    #[error("{0}")]
    File(String),
    /// The file was removed.
    #[error("the file was removed meanwhile: a page that is still open can save it anew")]
    Gone,
    /// The file was changed to something that is no site.
    #[error("the file is no site as it is by now: mend it there, then save again ({0})")]
    Now(Box<EditError>),
    /// Page and file have changed the same things, in words.
    #[error("changed here and in the file: {}", .0.join("; "))]
    Conflicts(Vec<String>),
}

/// Editor of a file.
#[derive(Clone, Debug)]
pub struct Editor {
    text: String,
    document: DocumentMut,
    scenario: Scenario,
    was_grid: bool,
}

impl Editor {
    /// An editor of the text of a site's file.
    ///
    /// # Errors
    /// [`EditError`]
    pub fn new(text: &str) -> Result<Self, EditError> {
        let scenario = Scenario::from_toml(text, &Overrides::default())?;
        let mut document: DocumentMut = text.parse()?;
        let was_grid = document.remove("grid").is_some();
        if was_grid {
            file::write_out(&mut document, &scenario)?;
        }
        let editor = Self {
            text: match was_grid {
                true => document.to_string(),
                false => text.to_owned(),
            },
            document,
            scenario,
            was_grid,
        };
        editor.layout()?;
        Ok(editor)
    }

    /// The site as the page needs it at first, by the number of this version.
    ///
    /// # Errors
    /// [`EditError::Unplaced`]
    pub fn begun(&self, version: usize) -> Result<Begun, EditError> {
        let world = &self.scenario.world;
        Ok(Begun {
            version,
            name: self.scenario.name.clone(),
            unit: self.scenario.unit.clone(),
            bounds: [world.low, world.high],
            was_grid: self.was_grid,
            layout: self.layout()?,
            taken: { self.scenario.networks.iter() }
                .flat_map(|network| network.targets.iter().map(|target| target.id))
                .collect(),
        })
    }

    /// Cameras and obstacles of the file.
    fn layout(&self) -> Result<Layout, EditError> {
        let placed = |camera: &site::PlacedCamera| {
            let place = camera.place().zip(camera.heading_deg);
            let (place, heading_deg) = place.ok_or(EditError::Unplaced(camera.id))?;
            Ok(Placed {
                id: camera.id,
                x: place.x,
                y: place.y,
                heading_deg,
                height: camera.height,
                pitch_deg: camera.pitch_deg,
                roll_deg: camera.roll_deg,
            })
        };
        let networks = self.scenario.networks.iter();
        let networks = networks.map(|network| network.cameras.iter().map(placed).collect());
        let obstacles = self.scenario.world.obstacles.iter().enumerate();
        Ok(Layout {
            networks: networks.collect::<Result<_, EditError>>()?,
            obstacles: obstacles
                .map(|(n, is)| Hindrance {
                    of: Some(n),
                    is: is.outline.clone(),
                })
                .collect(),
        })
    }

    /// The file's text with this layout.
    ///
    /// # Errors
    /// [`EditError`]: the page names something else, or the new text is not a site.
    pub fn text(&self, layout: &Layout) -> Result<String, EditError> {
        let known = self.layout()?;
        if *layout == known {
            return Ok(self.text.clone());
        }
        let mut numbers = { layout.networks.iter().flatten() }
            .flat_map(|camera| {
                let mount = camera.mount().into_iter();
                [camera.x, camera.y, camera.heading_deg]
                    .into_iter()
                    .chain(mount.filter_map(|(_, value)| value))
            })
            .chain(
                layout
                    .obstacles
                    .iter()
                    .flat_map(|one| file::numbers_of(&one.is)),
            );
        if !numbers.all(f64::is_finite) {
            return Err(EditError::NotFinite);
        }
        if layout.networks.len() != known.networks.len() {
            return Err(EditError::Unknown("network"));
        }
        let mut document = self.document.clone();
        for (n, (new, old)) in layout.networks.iter().zip(&known.networks).enumerate() {
            if new != old {
                let network =
                    file::network(&mut document, n).ok_or(EditError::Unknown("network"))?;
                file::cameras(network, new, old);
            }
        }
        if layout.obstacles != known.obstacles {
            file::obstacles(&mut document, &layout.obstacles, known.obstacles.len())?;
        }
        let text = document.to_string();
        Scenario::from_toml(&text, &Overrides::default())?;
        Ok(text)
    }

    /// Judges the site with this layout.
    pub fn judge(&self, layout: &Layout, is_advised: bool) -> Judged {
        let judged = || -> Result<_, EditError> {
            let scenario = Scenario::from_toml(&self.text(layout)?, &Overrides::default())?;
            let advice = is_advised
                .then(|| Advice::on(&scenario, ADVISED))
                .transpose()?;
            Ok((Design::of(&scenario)?, advice))
        };
        match judged() {
            Ok((design, advice)) => Judged {
                design: Some(design),
                refused: None,
                advice,
            },
            Err(error) => Judged {
                design: None,
                refused: Some(error.to_string()),
                advice: None,
            },
        }
    }
}
