//! A site's file as people change it at the page: of what they do not change, every letter is kept.

use serde::{Deserialize, Serialize};
use site::{
    Overrides, Scenario, ScenarioError,
    design::{Advice, Design},
};
use toml_edit::{
    Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value, value,
};

/// Further cameras and stops that are advised.
const ADVISED: usize = 3;

/// What can be changed of a site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// The cameras of each network.
    pub networks: Vec<Vec<Placed>>,
    /// Obstacles.
    pub obstacles: Vec<Hindrance>,
}

/// Where a camera is to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placed {
    /// Its number.
    pub id: u16,
    /// Where.
    pub x: f64,
    /// Where.
    pub y: f64,
    /// Direction, degrees from the x axis.
    pub heading_deg: f64,
}

/// An obstacle: one that is in the file, or a new wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hindrance {
    /// Which of the file's obstacles it is, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// The corners of a new wall.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wall: Vec<[f64; 2]>,
}

/// A site with what is expected of it.
#[derive(Clone, Debug, Serialize)]
pub struct Judged {
    /// What is expected; `None` if it cannot be put up.
    pub design: Option<Design>,
    /// Why not.
    pub refused: Option<String>,
    /// Where one more would help most, if that was asked.
    pub advice: Option<Advice>,
}

/// A site as the page begins with it.
#[derive(Clone, Debug, Serialize)]
pub struct Begun {
    /// Its name.
    pub name: String,
    /// Name of its unit of length.
    pub unit: String,
    /// Lowest and highest corner of the place.
    pub bounds: [[f64; 2]; 2],
    /// The outlines of the file's obstacles; a wall's is not closed.
    pub outlines: Vec<Vec<[f64; 2]>>,
    /// Cameras and obstacles.
    pub layout: Layout,
    /// Numbers of nodes without a camera.
    pub taken: Vec<u16>,
}

/// Why a file cannot be edited.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// It is no site.
    #[error(transparent)]
    Site(#[from] ScenarioError),
    /// It is no TOML.
    #[error(transparent)]
    Text(#[from] toml_edit::TomlError),
    /// Its networks are made by a rule.
    #[error("the networks of a `grid` are made by its numbers: there is nothing to place")]
    Grid,
    /// A camera has no place yet.
    #[error("camera {0} has no `x`, `y` and `heading_deg`: give it some first")]
    Unplaced(u16),
    /// The page speaks of something that the file does not have.
    #[error("the file has no such {0}")]
    Unknown(&'static str),
    /// A number is none.
    #[error("a place is not a number")]
    NotFinite,
}

/// The file.
#[derive(Clone, Debug)]
pub struct Editor {
    text: String,
    document: DocumentMut,
    scenario: Scenario,
}

impl Editor {
    /// The text of a site's file.
    ///
    /// # Errors
    /// [`EditError`]
    pub fn new(text: &str) -> Result<Self, EditError> {
        let scenario = Scenario::from_toml(text, &Overrides::default())?;
        let document: DocumentMut = text.parse()?;
        if document.contains_key("grid") {
            return Err(EditError::Grid);
        }
        let editor = Self {
            text: text.to_owned(),
            document,
            scenario,
        };
        editor.layout()?;
        Ok(editor)
    }

    /// What the page has to know.
    ///
    /// # Errors
    /// [`EditError::Unplaced`]
    pub fn begun(&self) -> Result<Begun, EditError> {
        let world = &self.scenario.world;
        let frame = site::Frame {
            origin: nalgebra::Point2::origin(),
            heading: 0.0,
        };
        let outline = |table: &site::ObstacleTable| match table {
            site::ObstacleTable::Wall(corners) => corners.clone(),
            other => { site::obstacles(other).into_iter() }
                .flat_map(|obstacle| {
                    let mut corners = answers::view::outline(&obstacle, &frame);
                    corners.extend(corners.first().copied());
                    corners
                })
                .collect(),
        };
        Ok(Begun {
            name: self.scenario.name.clone(),
            unit: self.scenario.unit.clone(),
            bounds: [world.low, world.high],
            outlines: world.obstacles.iter().map(outline).collect(),
            layout: self.layout()?,
            taken: { self.scenario.networks.iter() }
                .flat_map(|network| network.targets.iter().map(|target| target.id))
                .collect(),
        })
    }

    /// What the file has.
    fn layout(&self) -> Result<Layout, EditError> {
        let placed = |camera: &site::PlacedCamera| {
            let place = camera.place().zip(camera.heading_deg);
            let (place, heading_deg) = place.ok_or(EditError::Unplaced(camera.id))?;
            Ok(Placed {
                id: camera.id,
                x: place.x,
                y: place.y,
                heading_deg,
            })
        };
        let networks = self.scenario.networks.iter();
        let networks = networks.map(|network| network.cameras.iter().map(placed).collect());
        let count = self.scenario.world.obstacles.len();
        Ok(Layout {
            networks: networks.collect::<Result<_, EditError>>()?,
            obstacles: (0..count)
                .map(|n| Hindrance {
                    of: Some(n),
                    wall: Vec::new(),
                })
                .collect(),
        })
    }

    /// The file's text with this layout.
    ///
    /// # Errors
    /// [`EditError`]: the page speaks of something else, or what comes out is no site.
    pub fn text(&self, layout: &Layout) -> Result<String, EditError> {
        let known = self.layout()?;
        if *layout == known {
            return Ok(self.text.clone());
        }
        let mut numbers = { layout.networks.iter().flatten() }
            .flat_map(|camera| [camera.x, camera.y, camera.heading_deg])
            .chain(
                layout
                    .obstacles
                    .iter()
                    .flat_map(|o| o.wall.iter().flatten().copied()),
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
                let network = network(&mut document, n).ok_or(EditError::Unknown("network"))?;
                cameras(network, new, old);
            }
        }
        if layout.obstacles != known.obstacles {
            obstacles(&mut document, &layout.obstacles, known.obstacles.len())?;
        }
        let text = document.to_string();
        Scenario::from_toml(&text, &Overrides::default())?;
        Ok(text)
    }

    /// What to expect of the site with this layout.
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

fn network(document: &mut DocumentMut, n: usize) -> Option<&mut dyn TableLike> {
    match document.get_mut("network")? {
        Item::ArrayOfTables(tables) => Some(tables.get_mut(n)? as &mut dyn TableLike),
        Item::Value(Value::Array(array)) => {
            Some(array.get_mut(n)?.as_inline_table_mut()? as &mut dyn TableLike)
        }
        _ => None,
    }
}

/// Sets a number, with its comment kept, unless it is that already.
fn set(table: &mut dyn TableLike, key: &str, number: f64) {
    // No need for more digits than a tape measure has.
    let number = (number * 1e4).round() / 1e4;
    let old = table.get_mut(key).and_then(Item::as_value_mut);
    let Some(old) = old else {
        table.insert(key, value(number));
        return;
    };
    let known = old
        .as_float()
        .or(old.as_integer().map(|whole| whole as f64));
    if known.is_none_or(|known| (known - number).abs() > 5e-5) {
        let decor = old.decor().clone();
        *old = Value::from(number);
        *old.decor_mut() = decor;
    }
}

fn place(table: &mut dyn TableLike, new: &Placed) {
    set(table, "x", new.x);
    set(table, "y", new.y);
    set(table, "heading_deg", new.heading_deg);
}

fn id_of(table: &dyn TableLike) -> Option<i64> {
    table.get("id")?.as_integer()
}

fn cameras(network: &mut dyn TableLike, new: &[Placed], old: &[Placed]) {
    let is_kept = |id: Option<i64>| new.iter().any(|camera| Some(i64::from(camera.id)) == id);
    let of = |id: Option<i64>| new.iter().find(|camera| Some(i64::from(camera.id)) == id);
    let added = || {
        new.iter()
            .filter(|camera| old.iter().all(|known| known.id != camera.id))
    };
    match network
        .entry("camera")
        .or_insert(Item::ArrayOfTables(ArrayOfTables::new()))
    {
        Item::ArrayOfTables(tables) => {
            tables.retain(|table| is_kept(id_of(table)));
            for table in tables.iter_mut() {
                if let Some(new) = of(id_of(table)) {
                    place(table, new);
                }
            }
            for camera in added() {
                let mut table = Table::new();
                table.insert("id", value(i64::from(camera.id)));
                place(&mut table, camera);
                tables.push(table);
            }
        }
        Item::Value(Value::Array(array)) => {
            let of_value = |one: &Value| one.as_inline_table().and_then(|table| id_of(table));
            array.retain(|one| is_kept(of_value(one)));
            for one in array.iter_mut() {
                let id = of_value(one);
                if let (Some(new), Some(table)) = (of(id), one.as_inline_table_mut()) {
                    place(table, new);
                }
            }
            for camera in added() {
                let mut table = InlineTable::new();
                table.insert("id", Value::from(i64::from(camera.id)));
                place(&mut table, camera);
                append(array, Value::InlineTable(table));
            }
        }
        _ => {}
    }
}

/// Puts a value on a line of its own, if the others are on theirs.
fn append(array: &mut Array, mut value: Value) {
    let prefix = { array.iter().last() }
        .and_then(|last| last.decor().prefix()?.as_str())
        .and_then(|prefix| Some(prefix[prefix.rfind('\n')?..].to_owned()));
    if let Some(prefix) = prefix {
        value.decor_mut().set_prefix(prefix);
        array.push_formatted(value);
    } else {
        array.push(value);
    }
}

fn wall(corners: &[[f64; 2]]) -> Value {
    let round = |number: f64| (number * 1e4).round() / 1e4;
    let corner = |[x, y]: &[f64; 2]| Value::from_iter([round(*x), round(*y)]);
    Value::Array(corners.iter().map(corner).collect())
}

fn obstacles(document: &mut DocumentMut, new: &[Hindrance], count: usize) -> Result<(), EditError> {
    if new.iter().any(|one| one.of.is_some_and(|n| n >= count)) {
        return Err(EditError::Unknown("obstacle"));
    }
    let is_kept = |n: usize| new.iter().any(|one| one.of == Some(n));
    let walls = || {
        new.iter()
            .filter(|one| one.of.is_none())
            .map(|one| wall(&one.wall))
    };
    let world = document.entry("world").or_insert(Item::Table(Table::new()));
    let world = world
        .as_table_like_mut()
        .ok_or(EditError::Unknown("world"))?;
    let list = world
        .entry("obstacle")
        .or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
    let mut n = 0..;
    let mut keep = move || n.next().is_some_and(is_kept);
    match list {
        Item::ArrayOfTables(tables) => {
            tables.retain(|_| keep());
            for wall in walls() {
                let mut table = Table::new();
                table.insert("wall", value(wall));
                tables.push(table);
            }
        }
        Item::Value(Value::Array(array)) => {
            array.retain(|_| keep());
            for wall in walls() {
                append(
                    array,
                    Value::InlineTable(InlineTable::from_iter([("wall", wall)])),
                );
            }
        }
        _ => return Err(EditError::Unknown("obstacle")),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const THESIS: &str = site::BUILT_IN[0].1;

    #[test]
    fn what_is_not_changed_keeps_every_letter() {
        for (name, text) in site::BUILT_IN {
            let Ok(editor) = Editor::new(text) else {
                assert_eq!(name, "grid");
                continue;
            };
            let mut layout = editor.layout().unwrap();
            assert_eq!(editor.text(&layout).unwrap(), text);
            // A wall where nobody looks or walks.
            let [low, _] = editor.begun().unwrap().bounds;
            layout.obstacles.push(Hindrance {
                of: None,
                wall: vec![low, [low[0] + 0.01, low[1]]],
            });
            let added = editor.text(&layout).unwrap();
            let is_in = |line: &str| added.lines().any(|other| other == line);
            let lost: Vec<_> = text.lines().filter(|line| !is_in(line)).collect();
            assert!(lost.len() <= 1, "{name}: {lost:?}");
            let again = Editor::new(&added).unwrap();
            assert_eq!(
                again.layout().unwrap().obstacles.len(),
                layout.obstacles.len()
            );
        }
    }

    #[test]
    fn a_moved_camera_changes_its_line_only() {
        let editor = Editor::new(THESIS).unwrap();
        let mut layout = editor.layout().unwrap();
        layout.networks[0][4].x += 0.25;
        let text = editor.text(&layout).unwrap();
        let differ: Vec<_> = { THESIS.lines().zip(text.lines()) }
            .filter(|(a, b)| a != b)
            .collect();
        assert_eq!(differ.len(), 1);
        assert_eq!(
            differ[0].1.trim(),
            "{ id = 5, x = 21.25, y = 3.0, heading_deg = 90.0 },"
        );
        assert_eq!(Editor::new(&text).unwrap().layout().unwrap(), layout);
    }

    #[test]
    fn cameras_come_and_go() {
        let editor = Editor::new(THESIS).unwrap();
        let mut layout = editor.layout().unwrap();
        layout.networks[0].retain(|camera| camera.id != 7);
        layout.networks[0].push(Placed {
            id: 14,
            x: 1.0,
            y: 2.0,
            heading_deg: 30.0,
        });
        let text = editor.text(&layout).unwrap();
        assert_eq!(Editor::new(&text).unwrap().layout().unwrap(), layout);
    }

    #[test]
    fn what_is_no_site_is_refused() {
        let editor = Editor::new(THESIS).unwrap();
        let known = editor.layout().unwrap();
        let refused = |change: &dyn Fn(&mut Layout)| {
            let mut layout = known.clone();
            change(&mut layout);
            editor.text(&layout).unwrap_err().to_string()
        };
        // A reference.
        let gone = refused(&|layout| layout.networks[0].retain(|camera| camera.id != 1));
        assert!(gone.contains("reference"), "{gone}");
        refused(&|layout| layout.networks[0][3].x = f64::NAN);
        refused(&|layout| layout.networks[0][3].x = 1e9);
        refused(&|layout| layout.networks.push(Vec::new()));
        refused(&|layout| {
            layout.obstacles.push(Hindrance {
                of: Some(7),
                wall: Vec::new(),
            });
        });
        assert!(matches!(
            Editor::new(site::BUILT_IN[2].1),
            Err(EditError::Grid)
        ));
    }
}
