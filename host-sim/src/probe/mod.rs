//! A CMUcam2 on a serial port of this computer: the parts of `host-sim probe`.
//!
//! | module | job |
//! |---|---|
//! | [`port`] | The serial port as a UART of the driver; finds the baud rate. |
//! | [`advice`] | Advice on checks when something fails. |
//! | [`colour`] | Judgement of a learnt colour, and a better window. |
//! | [`display`] | A packet as text or JSON, and the summary of a stream. |
//! | [`record`] | Sightings at known places, appended to a file for `host-sim solve`. |
//! | [`picture`] | A frame of the camera as PNG. |
//! | [`stranger`] | The device on the line, if it is no camera that answers. |
//!
//! [`node_firmware::vision::steady`] judges when a blob stands still, and where, as on a node.

pub mod advice;
pub mod colour;
pub mod display;
pub mod picture;
pub mod plug;
pub mod port;
pub mod record;
pub mod stranger;

use calib_core::{Ray, camera::Camera};
use cmucam2_driver::{Cmucam2, geometry::Sensor, packet::Tracking};
use node_firmware::vision::{
    Blob, Grid, Rows,
    steady::{Direction, Shape, Steadiness, Steady},
};

/// The camera on a line.
pub type Device = Cmucam2<port::Port, port::Clock>;

/// Name of a sensor.
pub fn sensor_name(sensor: Option<Sensor>) -> &'static str {
    match sensor {
        Some(Sensor::Ov6620) => "OV6620",
        Some(Sensor::Ov7620) => "OV7620",
        None => "unknown sensor",
    }
}

/// Converts the numbers of a packet to columns counted from 0, and to directions.
#[derive(Clone, Copy, Debug)]
pub struct View {
    columns: u16,
    rows: Option<Rows>,
    first: u8,
    camera: Option<Camera<f64>>,
}

/// Direction of an object, radians.
pub type Bearing = Direction<f64>;

impl View {
    /// A view of `columns` columns whose leftmost one has the number `first` in packets, as has the
    /// uppermost row. Without a camera there are no directions.
    pub fn new(columns: u16, first: u8, camera: Option<Camera<f64>>) -> Self {
        Self {
            columns,
            rows: None,
            first,
            camera,
        }
    }

    /// The same with these rows, so that packets tell elevations, too.
    #[must_use]
    pub fn with_rows(self, rows: Rows) -> Self {
        Self {
            rows: Some(rows),
            ..self
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> u16 {
        self.columns
    }

    /// The number of the leftmost column and of the uppermost row in packets.
    pub fn first(&self) -> u8 {
        self.first
    }

    /// Returns true if directions are known.
    pub fn has_camera(&self) -> bool {
        self.camera.is_some()
    }

    /// A column or row of a packet, counted from 0. Below 0 if the number of the first one is
    /// wrong.
    pub fn from_0(&self, in_packet: u8) -> i16 {
        i16::from(in_packet) - i16::from(self.first)
    }

    /// The blob of a packet, if there is one.
    pub fn blob(&self, tracking: &Tracking) -> Option<Blob> {
        let blob = Blob::from_tracking(tracking, Grid::pixels(self.first))?;
        let rows = self.rows;
        Some(Blob { rows, ..blob })
    }

    /// The direction of what one packet shows, as that of one that stood still. `None` also where it is cut
    /// off by the left or right border, or partly hidden.
    pub fn glance(&self, tracking: &Tracking) -> Option<Bearing> {
        let frame = Steadiness::<2>::new(2, self.columns, Shape::Any);
        let seen = frame.glance(&self.blob(tracking)?)?;
        self.bearing(&seen.steady)
    }

    /// The direction of a blob that stood still.
    pub fn bearing(&self, steady: &Steady) -> Option<Bearing> {
        self.camera.map(|camera| steady.direction(&camera, 0.0))
    }

    /// The column, from 0, that lies in the direction of a blob that stood still. Without a camera
    /// it is the middle of the blob's box.
    pub fn column(&self, steady: &Steady) -> f64 {
        let middle = f64::from(steady.middle());
        self.camera
            .zip(self.bearing(steady))
            .and_then(|(camera, seen)| camera.column(Ray::from_bearing(seen.bearing)))
            .unwrap_or(middle)
    }

    /// The number of the first column that this packet proves, if it contradicts the one assumed.
    pub fn contradiction(&self, tracking: &Tracking) -> Option<u8> {
        let found = tracking.bounding_box()?;
        if self.first > 0 && found.x1 == 0 {
            return Some(0);
        }
        (self.first == 0 && u16::from(found.x2) >= self.columns).then_some(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(x1: u8, x2: u8) -> Tracking {
        Tracking::new([u8::midpoint(x1, x2), 70, x1, 60, x2, 80, 10, 200])
    }

    #[test]
    fn the_middle_of_the_view_is_straight_ahead_however_columns_are_counted() {
        let camera = Camera::pin_hole(87, 45_f64.to_radians()).unwrap();
        for first in [0, 1] {
            let view = View::new(87, first, Some(camera));
            let middle = seen(38 + first, 48 + first);
            assert_eq!(view.glance(&middle).unwrap().bearing, 0.0);
            assert!(view.glance(&seen(37 + first, 48 + first)).unwrap().bearing > 0.0);
        }
        assert_eq!(View::new(88, 0, None).glance(&seen(38, 48)), None);
    }

    /// The middle of mass is cut to a whole column, which is half a column too little in the mean: what is
    /// shown of a packet is the direction that is recorded of many like it.
    #[test]
    fn a_packet_and_a_recording_tell_the_same_direction() {
        let camera = Camera::pin_hole(88, 60_f64.to_radians()).unwrap();
        let view = View::new(88, 1, Some(camera));
        for (x1, mass, x2) in [(21, 25, 30), (21, 25, 29), (60, 69, 79)] {
            let packet = Tracking::new([mass, 70, x1, 60, x2, 80, 10, 200]);
            let mut recorded = Steadiness::<20>::new(20, 88, Shape::Any);
            let blob = view.blob(&packet);
            let recorded = (0..20).map(|_| recorded.push(blob)).last().unwrap();
            assert_eq!(view.glance(&packet), view.bearing(&recorded.unwrap()));
        }
    }

    /// A file that is solved with the same camera gives back the direction that was seen.
    #[test]
    fn the_column_of_a_sighting_lies_in_its_direction() {
        let camera = Camera::pin_hole(88, 60_f64.to_radians()).unwrap();
        let steady = Steady {
            left: 60.5,
            right: 79.5,
            above: None,
            column_sigma: 0.2,
            frames: 5,
            pixels: 20,
            confidence: 201,
        };
        let view = View::new(88, 1, Some(camera));
        let column = view.column(&steady);
        assert!((camera.bearing(column) - view.bearing(&steady).unwrap().bearing).abs() < 1e-12);
        // Nearer to the axis than the middle of the box.
        assert!((69.0..69.9).contains(&column), "{column}");
        assert_eq!(View::new(88, 1, None).column(&steady), 70.0);
    }

    #[test]
    fn a_packet_can_prove_how_columns_are_counted() {
        let (from_0, from_1) = (View::new(88, 0, None), View::new(88, 1, None));
        assert_eq!(from_1.contradiction(&seen(0, 20)), Some(0));
        assert_eq!(from_0.contradiction(&seen(0, 20)), None);
        assert_eq!(from_0.contradiction(&seen(60, 88)), Some(1));
        assert_eq!(from_1.contradiction(&seen(60, 88)), None);
        assert_eq!(from_1.contradiction(&Tracking::LOST), None);
    }
}
