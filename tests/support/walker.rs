//! A person made of formulas, with sensors that err. It knows nothing of the detector and the
//! filter: it moves, turns, sways and leans, and its sensors read what a rigid body's would.

use std::f64::consts::TAU;

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::RngExt;

use crate::{Random, generator, normal};

/// Readings a second.
pub const RATE: f64 = 100.0;
const GRAVITY: f64 = 9.81;

fn normal3(rng: &mut Random, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * normal(rng))
}

/// Next act of the walker.
pub enum Act {
    /// Stands for some seconds.
    Stand(f64),
    /// Turns by an angle over some seconds, standing.
    Turn(f64, f64),
    /// Walks some steps, turning by an angle over the first second.
    Walk(u32, f64),
}

/// A person who walks, and the readings of the worn sensors.
pub struct Walker {
    /// Source of all random numbers.
    pub rng: Random,
    /// Seconds since the start.
    pub time: f64,
    /// Place of the person, metres.
    pub position: Vector2<f64>,
    /// Direction in which the person walks, radians counter-clockwise from the world's x axis.
    pub facing: f64,
    /// Steps so far.
    pub steps: u32,
    /// Steps per second.
    pub cadence: f64,
    /// Length of a step, metres.
    pub step_length: f64,
    /// Scatter of the length of single steps, relative.
    pub scatter: f64,
    /// Roll and pitch of the sensor on the body.
    pub mount: (f64, f64),
    /// Bias of the gyroscope, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Standard deviation of a gyroscope reading, rad/s.
    pub gyro_noise: f64,
    /// Standard deviation of an acceleration reading, m/s^2.
    pub acceleration_noise: f64,
    /// Standard deviation of a compass reading, uT.
    pub compass_noise: f64,
    /// Standard deviation of the direction of the field, wandering with a correlation of 0.5 s.
    pub field_wander: f64,
    /// Angle by which it has wandered, radians.
    pub wandered: f64,
    /// Direction of magnetic north, radians.
    pub north: f64,
    /// A field of the surroundings added to the earth's, world frame.
    pub disturbance: Vector3<f64>,
    /// Attitude at the last reading.
    pub attitude: Option<Rotation3<f64>>,
    /// All readings so far.
    pub readings: Vec<Reading>,
}

/// Readings of the sensors at one time, in the body frame: x forward, y left, z up.
pub struct Reading {
    /// Specific force, m/s^2.
    pub acceleration: Vector3<f64>,
    /// Angular rate, rad/s.
    pub angular_rate: Vector3<f64>,
    /// Magnetic field, uT.
    pub magnetic_field: Option<Vector3<f64>>,
    /// Direction of the trunk, with the sway.
    pub facing: f64,
}

impl Walker {
    /// A person who has not begun to walk.
    pub fn new(seed: u64) -> Self {
        let mut rng = generator(seed);
        let facing = rng.random_range(0.0..TAU);
        let cadence = rng.random_range(1.5..2.2);
        let mount = (rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2));
        let gyro_bias = normal3(&mut rng, 0.02);
        let north = rng.random_range(0.0..TAU);
        Self {
            rng,
            time: 0.0,
            position: Vector2::zeros(),
            facing,
            steps: 0,
            cadence,
            step_length: 0.7,
            scatter: 0.04,
            mount,
            gyro_bias,
            gyro_noise: 0.003,
            acceleration_noise: 0.05,
            compass_noise: 0.5,
            field_wander: 0.087,
            wandered: 0.0,
            north,
            disturbance: Vector3::zeros(),
            attitude: None,
            readings: Vec::new(),
        }
    }

    /// Does one act after another.
    pub fn act(&mut self, acts: &[Act]) {
        for act in acts {
            match *act {
                Act::Stand(seconds) => self.stand(seconds, 0.0),
                Act::Turn(angle, seconds) => self.stand(seconds, angle),
                Act::Walk(steps, angle) => self.walk(steps, angle),
            }
        }
    }

    fn stand(&mut self, seconds: f64, turn: f64) {
        let count = (seconds * RATE) as u32;
        for _ in 0..count {
            self.facing += turn / f64::from(count);
            self.read(Vector3::zeros(), 0.0);
        }
    }

    fn walk(&mut self, steps: u32, turn: f64) {
        let turning = RATE.min(f64::from(steps) / self.cadence * RATE).floor();
        let mut turned = 0.0;
        for i in 0..steps {
            let length = self.step_length * (1.0 + self.scatter * normal(&mut self.rng));
            // Harder and softer steps do not follow the length: that is the model's error.
            let force = 1.0 + 0.1 * normal(&mut self.rng);
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let count = (RATE / self.cadence).round();
            for k in 0..count as u32 {
                let phase = TAU * f64::from(k) / count;
                if turned < turning {
                    turned += 1.0;
                    self.facing += turn / turning;
                }
                self.position +=
                    Vector2::new(self.facing.cos(), self.facing.sin()) * (length / count);
                // Along, left, up; the second harmonic is the heel's.
                let body = Vector3::new(
                    1.2 * (phase + 0.6).sin(),
                    side * 0.8 * (phase / 2.0).sin(),
                    force * (2.6 * phase.sin() + 0.9 * (2.0 * phase + 0.5).sin())
                        + 0.4 * (3.0 * phase).sin(),
                );
                let world = Rotation3::from_axis_angle(&Vector3::z_axis(), self.facing) * body;
                let sway = side * 0.08 * (phase / 2.0).sin();
                self.read(world, sway);
            }
            self.steps += 1;
        }
    }

    fn read(&mut self, acceleration: Vector3<f64>, sway: f64) {
        let (roll, pitch) = self.mount;
        // The trunk leans a little with each sway.
        let attitude = Rotation3::from_euler_angles(0.0, 0.3 * sway, self.facing + sway)
            * Rotation3::from_euler_angles(roll, pitch, 0.0);
        let rate = match self.attitude {
            Some(before) => (before.inverse() * attitude).scaled_axis() * RATE,
            None => Vector3::zeros(),
        };
        self.attitude = Some(attitude);
        let force = acceleration + Vector3::z() * GRAVITY;
        let rng = &mut self.rng;
        let keep = (-1.0 / (0.5 * RATE)).exp();
        self.wandered =
            keep * self.wandered + (1.0 - keep * keep).sqrt() * self.field_wander * normal(rng);
        let north = self.north + self.wandered;
        let field = Vector3::new(20.0 * north.cos(), 20.0 * north.sin(), -43.0) + self.disturbance;
        let facing = self.facing + sway;
        self.time += 1.0 / RATE;
        self.readings.push(Reading {
            acceleration: attitude.inverse() * force + normal3(rng, self.acceleration_noise),
            angular_rate: rate + self.gyro_bias + normal3(rng, self.gyro_noise),
            magnetic_field: Some(attitude.inverse() * field + normal3(rng, self.compass_noise)),
            facing,
        });
    }
}
