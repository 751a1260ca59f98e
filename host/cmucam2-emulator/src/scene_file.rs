//! Scenes as people write them: TOML.
//!
//! ```toml
//! light = [1.0, 0.95, 0.85]    # colour of the light; white if missing
//! noise = 2.0                  # standard deviation of each pixel, levels
//! flicker = 0.02               # change of the light from frame to frame, fraction
//!
//! [camera]                     # for angles and places in the world
//! fov_deg = 45.0               # horizontal field of view
//! distortion = [0.0, 0.0]      # k1 and k2 of its lens
//! x = 0.0
//! y = 0.0
//! height = 0.4
//! heading_deg = 0.0
//! servo_step_deg = 0.0         # how far a step of the pan servo turns the camera
//!
//! [background]                 # one of:
//! plain = [110, 110, 110]
//! # gradient = { top = [130, 130, 135], bottom = [80, 80, 78] }
//! # blocks = { columns = 4, rows = 3, colours = [[90, 90, 90], [140, 140, 140]] }
//!
//! [[object]]                   # from back to front; what comes later covers what came before
//! colour = [220, 110, 40]
//! shape = "disc"               # or "box"; or { tag = 3 }, for cameras that look for tags
//! repeat = true                # begin anew after the last stop
//! # Where it is: one stop for something that stands, more for a way. Each has a time in seconds
//! # (0 if missing) and one of three forms.
//! stops = [
//!   { at = 0.0, bearing_deg = 15.0, elevation_deg = -5.0, size_deg = 6.0 },
//!   { at = 5.0, bearing_deg = -15.0, elevation_deg = -5.0, size_deg = 6.0 },
//! ]
//! # { at = 0.0, picture = [0.5, 0.5], size = [0.1, 0.1] }          fractions of the picture
//! # { at = 0.0, x = 2.0, y = 0.1, height = 0.15, radius = 0.15 }   in the world
//! ```
//! Bearings are positive to the left, elevations upwards. A size is one number above 0, or width and
//! height. All stops of an object have the same form.

use std::fmt;

use calib_core::camera::Projection;
use serde::Deserialize;

use super::{
    lens::{Lens, PIXEL_ASPECT, Pose},
    scene::{Background, Form, Object, Place, Rgb, Scene, Shape, Way},
    sensor::{Sensor, Size},
};

/// Reason why a scene file cannot be used.
#[derive(Debug)]
pub enum SceneError {
    /// It is not TOML, or has fields that a scene does not have.
    Toml(toml::de::Error),
    /// Its numbers make no sense.
    Sense(String),
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Toml(error) => error.fmt(f),
            Self::Sense(why) => f.write_str(why),
        }
    }
}

impl std::error::Error for SceneError {}

impl From<toml::de::Error> for SceneError {
    fn from(error: toml::de::Error) -> Self {
        Self::Toml(error)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default = "white")]
    light: [f64; 3],
    #[serde(default)]
    noise: f64,
    #[serde(default)]
    flicker: f64,
    #[serde(default)]
    camera: CameraTable,
    background: Background,
    #[serde(default, rename = "object")]
    objects: Vec<ObjectTable>,
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CameraTable {
    fov_deg: f64,
    x: f64,
    y: f64,
    height: f64,
    heading_deg: f64,
    servo_step_deg: f64,
    distortion: [f64; 2],
}

impl Default for CameraTable {
    /// The thesis's field of view.
    fn default() -> Self {
        Self {
            fov_deg: 45.0,
            x: 0.0,
            y: 0.0,
            height: 0.0,
            heading_deg: 0.0,
            servo_step_deg: 0.0,
            distortion: [0.0; 2],
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectTable {
    colour: Rgb,
    #[serde(default)]
    shape: Shape,
    #[serde(default)]
    repeat: bool,
    stops: Vec<Stop>,
}

/// A stop of any form, which follows from the fields that are there.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Stop {
    #[serde(default)]
    at: f64,
    picture: Option<[f64; 2]>,
    size: Option<SizeField>,
    bearing_deg: Option<f64>,
    elevation_deg: Option<f64>,
    size_deg: Option<SizeField>,
    x: Option<f64>,
    y: Option<f64>,
    height: Option<f64>,
    radius: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum SizeField {
    Both(f64),
    Each([f64; 2]),
}

impl SizeField {
    fn each(self) -> [f64; 2] {
        match self {
            Self::Both(size) => [size; 2],
            Self::Each(sizes) => sizes,
        }
    }
}

fn sense(holds: bool, why: impl Into<String>) -> Result<(), SceneError> {
    if holds {
        Ok(())
    } else {
        Err(SceneError::Sense(why.into()))
    }
}

impl Scene {
    /// Reads a scene for a camera with this sensor. The format is that of the files in
    /// `host/cmucam2-emulator/scenes`, see `host-sim camera --help`.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn from_toml(text: &str, sensor: Sensor) -> Result<Self, SceneError> {
        let size = Size::of(sensor, false);
        Self::of_frame(text, [size.width, size.height].map(u16::from), PIXEL_ASPECT)
    }

    /// The same for another camera: columns and rows of its frame, and the number of rows that are as much as a
    /// column.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn of_frame(text: &str, frame: [u16; 2], aspect: f64) -> Result<Self, SceneError> {
        let file: File = toml::from_str(text)?;
        let camera = file.camera;
        let view = camera.fov_deg.to_radians();
        let lens = Lens::of_frame(Projection::PinHole, view, frame, aspect);
        let Some(lens) = lens else {
            return Err(SceneError::Sense(
                "camera.fov_deg must be above 0 and below 180".into(),
            ));
        };
        let Some(lens) = lens.with_distortion(camera.distortion) else {
            return Err(SceneError::Sense(
                "camera.distortion must be k1 and k2 of a lens that does not fold its picture back: check their signs"
                    .into(),
            ));
        };
        let levels = (0.0..=100.0).contains(&file.noise);
        sense(levels, "noise must be 0 to 100 levels")?;
        sense(
            (0.0..=1.0).contains(&file.flicker),
            "flicker must be 0 to 1",
        )?;
        let light = file
            .light
            .iter()
            .all(|factor| (0.0..=16.0).contains(factor));
        sense(light, "light must be three factors from 0 to 16")?;
        for (name, value) in [
            ("x", camera.x),
            ("y", camera.y),
            ("height", camera.height),
            ("heading_deg", camera.heading_deg),
            ("servo_step_deg", camera.servo_step_deg),
        ] {
            let why = format!("camera.{name} is {value}: it must be finite");
            sense(value.is_finite(), why)?;
        }
        let pose = Pose {
            x: camera.x,
            y: camera.y,
            height: camera.height,
            heading: camera.heading_deg.to_radians(),
        };
        let mut objects = Vec::new();
        for (number, object) in (1..).zip(&file.objects) {
            objects.push(object.read(number, lens, pose)?);
        }
        if let Background::Blocks {
            columns,
            rows,
            colours,
        } = &file.background
        {
            let any = *columns > 0 && *rows > 0 && !colours.is_empty();
            sense(any, "background.blocks needs columns, rows and colours")?;
        }
        Ok(Self {
            background: file.background,
            objects,
            light: file.light,
            noise: file.noise,
            flicker: file.flicker,
            servo_step: camera.servo_step_deg / camera.fov_deg,
        })
    }
}

impl ObjectTable {
    fn read(&self, number: usize, lens: Lens, pose: Pose) -> Result<Object, SceneError> {
        let mut stops = Vec::new();
        let mut form = None;
        for (place, stop) in (1..).zip(&self.stops) {
            let wrong = |why| SceneError::Sense(format!("stop {place} of object {number} {why}"));
            let (its, numbers) = stop.read(lens, pose).map_err(wrong)?;
            sense(
                *form.get_or_insert(its) == its,
                format!("the stops of object {number} are not of one form"),
            )?;
            stops.push((stop.at, numbers));
        }
        let Some(form) = form else {
            return Err(SceneError::Sense(format!("object {number} has no stops")));
        };
        let ordered = self.stops.windows(2).all(|pair| pair[0].at < pair[1].at)
            && self.stops.iter().all(|stop| stop.at >= 0.0);
        sense(
            ordered,
            format!("the stops of object {number} must be later and later"),
        )?;
        Ok(Object {
            colour: self.colour,
            shape: self.shape,
            place: Place::Moving(Way {
                form,
                stops,
                repeat: self.repeat,
            }),
        })
    }
}

impl Stop {
    /// Its form and numbers, or the fault that it has.
    fn read(&self, lens: Lens, pose: Pose) -> Result<(Form, [f64; 4]), String> {
        let picture = self.picture.is_some() || self.size.is_some();
        let angles =
            self.bearing_deg.is_some() || self.elevation_deg.is_some() || self.size_deg.is_some();
        let world = [self.x, self.y, self.height, self.radius]
            .iter()
            .any(Option::is_some);
        let (form, numbers, sizes) = match (picture, angles, world) {
            (true, false, false) => {
                let [x, y] = need("picture", self.picture)?;
                let sizes = need("size", self.size)?.each();
                (Form::Picture, [x, y, sizes[0], sizes[1]], sizes)
            }
            (false, true, false) => {
                let bearing = need("bearing_deg", self.bearing_deg)?;
                let elevation = self.elevation_deg.unwrap_or(0.0);
                let sizes = need("size_deg", self.size_deg)?.each();
                let degrees = [bearing, elevation, sizes[0], sizes[1]];
                (Form::Angles(lens), degrees.map(f64::to_radians), sizes)
            }
            (false, false, true) => {
                let (x, y) = (need("x", self.x)?, need("y", self.y)?);
                let radius = need("radius", self.radius)?;
                let height = self.height.unwrap_or(0.0);
                (Form::World(lens, pose), [x, y, height, radius], [radius; 2])
            }
            (false, false, false) => return Err("has no place: see `--help`".to_owned()),
            _ => {
                return Err(
                    "has more than one place: give `picture` and `size`, or `bearing_deg`, \
                     `elevation_deg` and `size_deg`, or `x`, `y`, `height` and `radius`"
                        .to_owned(),
                );
            }
        };
        if !numbers.into_iter().all(f64::is_finite) {
            return Err("has a number that is not finite".to_owned());
        }
        if !sizes.into_iter().all(|size| size > 0.0) {
            return Err("has a size or radius that is not above 0".to_owned());
        }
        Ok((form, numbers))
    }
}

fn need<T>(name: &str, value: Option<T>) -> Result<T, String> {
    value.ok_or_else(|| format!("has no `{name}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Scene, String> {
        Scene::from_toml(text, Sensor::Ov6620).map_err(|error| error.to_string())
    }

    #[test]
    fn every_form_of_a_place_is_read() {
        let scene = read(
            "[background]\nplain = [1, 2, 3]\n\
             [[object]]\ncolour = [200, 0, 0]\nstops = [{ picture = [0.5, 0.25], size = 0.1 }]\n\
             [[object]]\ncolour = [0, 200, 0]\nshape = { tag = 3 }\n\
             stops = [{ bearing_deg = 0, size_deg = [2.0, 3.0] }]\n\
             [[object]]\ncolour = [0, 0, 200]\nstops = [{ x = 2, y = 0, radius = 0.1 }]\n",
        )
        .unwrap();
        let patches: Vec<_> = scene.patches(0.0).collect();
        assert_eq!(patches.len(), 3);
        assert!((patches[0].extent.top - 0.2).abs() < 1e-12);
        assert_eq!(patches[1].shape, Shape::Tag(3));
        let middle = f64::midpoint(patches[2].extent.left, patches[2].extent.right);
        assert!((middle - 0.5).abs() < 1e-12);
    }

    /// Places of the balls of the shipped scenes at the start.
    #[test]
    fn the_shipped_scenes_are_what_they_say() {
        for (text, left, ahead) in [
            (include_str!("../scenes/orange-ball.toml"), 0.05, 0.8),
            (include_str!("../scenes/rolling-ball.toml"), 0.7, 2.0),
        ] {
            for sensor in [Sensor::Ov6620, Sensor::Ov7620] {
                let scene = Scene::from_toml(text, sensor).unwrap();
                let size = Size::of(sensor, false);
                let lens = Lens::new(45_f64.to_radians(), size.width, size.height).unwrap();
                let bearing = f64::atan2(left, ahead);
                let place = lens.extent(bearing, 0.0, 0.0, 0.0).unwrap().left;
                let ball = scene.patches(0.0).next().unwrap().extent;
                assert!((f64::midpoint(ball.left, ball.right) - place).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn what_makes_no_sense_is_said() {
        let plain = "[background]\nplain = [1, 2, 3]\n";
        let camera = |line: &str| format!("{plain}[camera]\n{line}\n");
        let object =
            |stops: &str| format!("{plain}[[object]]\ncolour = [1, 2, 3]\nstops = [{stops}]\n");
        let ball = object("{ x = 1, y = 1, radius = 1 }");
        let gradient = "[background.gradient]\ntop = [1, 2, 3]\nbottom = [1, 2, 3]\nmiddle = 1\n";
        let nose = format!("nose = 1\n{plain}");
        let lost = ball.replace("[[object]]", "[camera]\nheight = nan\n[[object]]");
        for (text, part) in [
            ("", "background"),
            ("[background]\nplain = [1, 2, 300]\n", "300"),
            (&nose, "nose"),
            (gradient, "middle"),
            (&camera("fov_deg = 180.0"), "below 180"),
            (
                &camera("distortion = [-3.0, 0.0]"),
                "camera.distortion must be k1 and k2",
            ),
            (
                &camera("heading_deg = inf"),
                "camera.heading_deg is inf: it must be finite",
            ),
            (
                &camera("servo_step_deg = nan"),
                "camera.servo_step_deg is NaN",
            ),
            (&lost, "camera.height is NaN"),
            (&object(""), "object 1 has no stops"),
            (
                &object("{ x = 1, y = 1, radius = 1 }, { at = 1, bearing_deg = 1, size_deg = 1 }"),
                "not of one form",
            ),
            (
                &object("{ x = 1, y = 1, radius = 1, hieght = 0.3 }"),
                "unknown field `hieght`",
            ),
            (
                &object("{ x = 1, y = 1, radius = -1 }"),
                "stop 1 of object 1 has a size or radius that is not above 0",
            ),
            (
                &object("{ picture = [0.5, 0.5], size = [0.1, 0.0] }"),
                "not above 0",
            ),
            (&object("{ x = 1, y = 1 }"), "has no `radius`"),
            (
                &object("{ x = 1, y = 1, radius = 1, size_deg = 2 }"),
                "more than one place",
            ),
            (&object("{ at = 1 }"), "no place"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }
}
