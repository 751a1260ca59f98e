//! The plane that cameras look over: what each of them sees at a moment.
//!
//! Balls move in one plane, as in the thesis (section 2.4). Cameras may hang above or below it, and may be tilted and
//! rolled. Walls and what else blocks sight stand on the floor, and reach to the ceiling or have a height. Lengths are in
//! the scenario's unit, angles in radians, times in nanoseconds as in the camera
//! [emulator](cmucam2_emulator::Emulator).
//!
//! | part | job |
//! |---|---|
//! | [`World`] | Cameras, targets and obstacles, and who sees whom. |
//! | [`View`] | View of one camera, ready to be painted into its [`Scene`](cmucam2_emulator::Scene). |
//! | [`Walker`] | Moves a target along its stops. |
//! | [`StepSensor`] | Measures the target's steps on the way. |
//!
//! # Outline of a target
//! In the camera's own horizontal plane a ball is seen from a distance `d` up to `asin(r / d)` to both sides of its
//! bearing. So the middle of the *angles* of its two edges is its bearing, while the middle of their columns is not
//! quite, for a pin-hole camera. It is the same with rows.
//!
//! # Example
//! ```
//! use cmucam2_emulator::Lens;
//! use site::world::{Camera, Mount, Target, Variant, World};
//! use nalgebra::Point2;
//!
//! let camera = Camera {
//!     place: Point2::new(0.0, 0.0),
//!     heading: 0.0,
//!     mount: Mount::LEVEL,
//!     lens: Lens::new(60_f64.to_radians(), 88, 143).unwrap(),
//!     range: 8.0,
//!     variant: Variant::Cmucam2,
//! };
//! let ball = Target { place: Point2::new(3.0, 0.0), above: 0.0, radius: 0.15, colour: [230, 105, 35] };
//! let mut world = World::new(vec![camera], vec![], vec![ball]);
//! let mut scene = cmucam2_emulator::Scene::default();
//! world.look(0).paint([110, 110, 110], &mut scene.objects);
//! assert_eq!(scene.objects.len(), 1);
//! world.move_target(0, Point2::new(-3.0, 0.0));
//! assert!(world.look(0).sights.is_empty());
//! ```

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point2, Vector2, Vector3};
use rstar::{
    AABB, RTree,
    primitives::{GeomWithData, Rectangle},
};

use cmucam2_emulator::{Lens, Rgb};

mod obstacle;
mod ray_scan;
mod sight;
mod step_sensor;
mod walker;

pub use obstacle::{Obstacle, Shape as ObstacleShape};
pub use sight::{Patch, Sight, View};
pub use step_sensor::{SensorErrors, StepSensor};
pub use walker::{Event, Gait, Mood, Stride, Walker};

/// Nanoseconds since the start of the simulation.
pub type Time = cmucam2_emulator::Time;

/// Model by which a camera's picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The outline as it is; the emulator renders and counts pixels.
    Cmucam2,
    /// A scan with one ray for each column, as the blob finder of the Stage simulator: what the
    /// emulator is given are boxes whose borders are exactly those columns whose rays hit.
    Stage,
}

/// A camera of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Its place.
    pub place: Point2<f64>,
    /// Direction of its optical axis, radians counter-clockwise from the x axis.
    pub heading: f64,
    /// Its mounting.
    pub mount: Mount,
    /// Its real lens, whatever its node believes.
    pub lens: Lens,
    /// Distance up to which it sees.
    pub range: f64,
    /// Model by which its picture is made.
    pub variant: Variant,
}

/// Mounting of a camera: radians and units of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Height above the middle of the ball.
    pub height: f64,
    /// Angle of the optical axis below the horizon.
    pub pitch: f64,
    /// Turn about the optical axis, positive where the left side is high.
    pub roll: f64,
}

impl Mount {
    /// Level, at the height of the ball.
    pub const LEVEL: Self = Self {
        height: 0.0,
        pitch: 0.0,
        roll: 0.0,
    };

    /// A place so far above the plane of the balls in the axes of the camera, forward, left and up: `azimuth` radians
    /// left of its heading, so far off on the floor.
    fn seen(&self, azimuth: f64, distance: f64, above: f64) -> Vector3<f64> {
        let (sin, cos) = azimuth.sin_cos();
        let (ahead, aside) = (distance * cos, distance * sin);
        let (sp, cp) = self.pitch.sin_cos();
        let (sr, cr) = self.roll.sin_cos();
        let height = self.height - above;
        let forward = ahead * cp + height * sp;
        let up = ahead * sp - height * cp;
        Vector3::new(forward, aside * cr + up * sr, up * cr - aside * sr)
    }
}

/// A coloured ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Its middle.
    pub place: Point2<f64>,
    /// Height of its middle above that at which the balls of its network are carried.
    pub above: f64,
    /// Its radius.
    pub radius: f64,
    /// Its colour.
    pub colour: Rgb,
}

/// Share of a camera's range by which a target may move before it is looked for elsewhere.
const SLACK: f64 = 0.25;

type Spot = GeomWithData<[f64; 2], usize>;
type Area = GeomWithData<Rectangle<[f64; 2]>, usize>;

/// Everything there is. A view of one camera costs what stands near it, not what there is.
#[derive(Clone, Debug)]
pub struct World {
    cameras: Vec<Camera>,
    obstacles: Vec<Obstacle>,
    targets: Vec<Target>,
    camera_areas: RTree<Area>,
    obstacle_areas: RTree<Area>,
    /// Where targets are, or have been a little while ago.
    target_spots: RTree<Spot>,
    /// Place of each target among them.
    spots: Vec<Point2<f64>>,
    /// Distance that a target may be off its spot.
    slack: f64,
    largest_target: f64,
    revision: u64,
}

impl World {
    /// A world in which targets and cameras can move. All numbers must be finite.
    pub fn new(cameras: Vec<Camera>, obstacles: Vec<Obstacle>, targets: Vec<Target>) -> Self {
        let camera_areas = cameras.iter().enumerate().map(|(index, camera)| {
            let reach = Vector2::repeat(camera.range);
            area(camera.place - reach, camera.place + reach, index)
        });
        let obstacle_areas = obstacles.iter().enumerate().map(|(index, obstacle)| {
            let (low, high) = obstacle.shape.bounds();
            area(low, high, index)
        });
        let target_spots = targets
            .iter()
            .enumerate()
            .map(|(index, target)| Spot::new(target.place.into(), index));
        Self {
            camera_areas: RTree::bulk_load(camera_areas.collect()),
            obstacle_areas: RTree::bulk_load(obstacle_areas.collect()),
            target_spots: RTree::bulk_load(target_spots.collect()),
            spots: targets.iter().map(|target| target.place).collect(),
            slack: SLACK * { cameras.iter() }
                .map(|camera| camera.range)
                .fold(0.0, f64::max),
            largest_target: targets.iter().map(|t| t.radius).fold(0.0, f64::max),
            cameras,
            obstacles,
            targets,
            revision: 0,
        }
    }

    /// Its cameras.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// Its obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// Its targets, where they are now.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// Changes whenever a target or a camera moves: as long as it is the same, so is every view.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Puts one more target up, and returns its index.
    pub fn add_target(&mut self, target: Target) -> usize {
        let index = self.targets.len();
        self.target_spots
            .insert(Spot::new(target.place.into(), index));
        self.spots.push(target.place);
        self.largest_target = self.largest_target.max(target.radius);
        self.targets.push(target);
        self.revision += 1;
        index
    }

    /// Puts a target somewhere else.
    ///
    /// # Panics
    /// There is no such target.
    pub fn move_target(&mut self, index: usize, place: Point2<f64>) {
        let target = &mut self.targets[index];
        if target.place == place {
            return;
        }
        target.place = place;
        self.revision += 1;
        let spot = &mut self.spots[index];
        if (place - *spot).norm() > self.slack {
            self.target_spots.remove(&Spot::new((*spot).into(), index));
            self.target_spots.insert(Spot::new(place.into(), index));
            *spot = place;
        }
    }

    /// Carries a target so much higher than the height told.
    ///
    /// # Panics
    /// There is no such target.
    pub fn raise_target(&mut self, index: usize, above: f64) {
        let target = &mut self.targets[index];
        if target.above != above {
            target.above = above;
            self.revision += 1;
        }
    }

    /// Puts a camera somewhere else, and turns it to a heading, radians.
    ///
    /// # Panics
    /// There is no such camera.
    pub fn move_camera(&mut self, index: usize, place: Point2<f64>, heading: f64) {
        let camera = &mut self.cameras[index];
        let reach = Vector2::repeat(camera.range);
        let of = |place: Point2<f64>| area(place - reach, place + reach, index);
        self.camera_areas.remove(&of(camera.place));
        self.camera_areas.insert(of(place));
        (camera.place, camera.heading) = (place, heading);
        self.revision += 1;
    }

    /// View of a camera now.
    ///
    /// # Panics
    /// There is no such camera.
    pub fn look(&self, camera: usize) -> View {
        let camera = &self.cameras[camera];
        let reach = camera.range + self.largest_target;
        let around = Vector2::repeat(reach + self.slack);
        let mut near: Vec<_> = self
            .target_spots
            .locate_in_envelope(envelope(camera.place - around, camera.place + around))
            .map(|spot| spot.data)
            .filter(|&index| (self.targets[index].place - camera.place).amax() <= reach)
            .collect();
        // The tree's order depends on what moved before.
        near.sort_unstable();
        match camera.variant {
            Variant::Cmucam2 => sight::look(self, camera, &near),
            Variant::Stage => ray_scan::look(self, camera, &near),
        }
    }

    /// Sight that a camera would have of a ball, were there no targets. `None` out of range, out of the picture
    /// or hidden by obstacles.
    ///
    /// # Panics
    /// There is no such camera.
    pub fn sight(&self, camera: usize, place: Point2<f64>, radius: f64) -> Option<Sight> {
        sight::sight(self, &self.cameras[camera], place, radius)
    }

    /// The cameras that would see something of a ball, in ascending order.
    pub fn cameras_that_see(&self, place: Point2<f64>, radius: f64) -> Vec<usize> {
        let mut cameras: Vec<_> = self
            .camera_areas
            .locate_in_envelope_intersecting(envelope(place, place))
            .map(|area| area.data)
            .filter(|&camera| self.sight(camera, place, radius).is_some())
            .collect();
        cameras.sort_unstable();
        cameras
    }

    /// The obstacle that comes nearer than `clearance` to the straight way between two places.
    pub fn obstacle_on_way(
        &self,
        from: Point2<f64>,
        to: Point2<f64>,
        clearance: f64,
    ) -> Option<usize> {
        self.obstacles_near(from, to, clearance)
            .into_iter()
            .find(|&index| self.obstacles[index].shape.distance_to_way(from, to) < clearance)
    }

    fn obstacles_near(&self, a: Point2<f64>, b: Point2<f64>, margin: f64) -> Vec<usize> {
        let margin = Vector2::repeat(margin);
        let low = a.inf(&b) - margin;
        let high = a.sup(&b) + margin;
        let mut near: Vec<_> = self
            .obstacle_areas
            .locate_in_envelope_intersecting(envelope(low, high))
            .map(|area| area.data)
            .collect();
        near.sort_unstable();
        near
    }
}

fn envelope(low: Point2<f64>, high: Point2<f64>) -> AABB<[f64; 2]> {
    AABB::from_corners(low.into(), high.into())
}

fn area(low: Point2<f64>, high: Point2<f64>, index: usize) -> Area {
    Area::new(Rectangle::from_aabb(envelope(low, high)), index)
}

/// Half the angle under which a ball is seen, radians; all before the eye from within.
fn half_width(distance: f64, radius: f64) -> f64 {
    if distance > radius {
        (radius / distance).asin()
    } else {
        FRAC_PI_2
    }
}
