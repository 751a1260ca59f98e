//! A packet as text or JSON, and the summary of a stream.

use std::{fmt, time::Duration};

use cmucam2_driver::{packet::Tracking, parser::DroppedBytes, session::Session};
use serde::Serialize;

use super::View;

/// Characters from left to right of the view in [`Screen`]. Odd, so that there is a middle.
const STRIP: usize = 25;

/// Content of a packet, with columns and rows counted from 0.
///
/// As JSON this is an interface: names and meaning stay. Everything but `seconds` is null when
/// nothing is tracked; the last three are null without a camera, too, and where the blob is cut off by the
/// left or right border or partly hidden: then its middle is not the middle of what is seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PacketLine {
    /// Time since the first packet was awaited.
    pub seconds: f64,
    /// The middle of mass, cut to a whole column by the camera.
    pub column: Option<i16>,
    /// As `column`, from the top.
    pub row: Option<i16>,
    /// Leftmost column.
    pub x1: Option<i16>,
    /// Uppermost row.
    pub y1: Option<i16>,
    /// Rightmost column.
    pub x2: Option<i16>,
    /// Lowermost row.
    pub y2: Option<i16>,
    /// `min(255, (n + 4) / 8)` of `n` tracked pixels.
    pub pixels: Option<u8>,
    /// `min(255, 256 n / area of the box)`.
    pub confidence: Option<u8>,
    /// Radians, positive to the left: the middle between both edges, as it is recorded.
    pub bearing_rad: Option<f64>,
    /// Standard deviation of `bearing_rad`, as far as it comes from whole columns.
    pub sigma_rad: Option<f64>,
    /// Radians above the camera's own horizontal plane; null also where the blob is cut off at the top or bottom.
    pub elevation_rad: Option<f64>,
}

impl PacketLine {
    /// The packet that came after so long.
    pub fn new(after: Duration, tracking: &Tracking, view: &View) -> Self {
        // Milliseconds: smaller times are the serial port's jitter.
        let seconds = after.as_millis() as f64 / 1e3;
        let middle = tracking.centroid();
        let found = tracking.bounding_box();
        let column = middle.map(|(x, _)| view.from_0(x));
        let bearing = view.glance(tracking);
        let seen = |value: Option<u8>| value.filter(|_| !tracking.is_lost());
        Self {
            seconds,
            column,
            row: middle.map(|(_, y)| view.from_0(y)),
            x1: found.map(|found| view.from_0(found.x1)),
            y1: found.map(|found| view.from_0(found.y1)),
            x2: found.map(|found| view.from_0(found.x2)),
            y2: found.map(|found| view.from_0(found.y2)),
            pixels: seen(tracking.pixels()),
            confidence: seen(tracking.confidence()),
            bearing_rad: bearing.map(|b| b.bearing),
            sigma_rad: bearing.map(|b| b.sigma),
            elevation_rad: bearing.and_then(|b| b.elevation),
        }
    }
}

impl fmt::Display for PacketLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:8.3} s  ", self.seconds)?;
        let (Some(column), Some(row)) = (self.column, self.row) else {
            return f.write_str("nothing tracked");
        };
        write!(f, "column {column:3} row {row:3}")?;
        if let (Some(x1), Some(y1), Some(x2), Some(y2)) = (self.x1, self.y1, self.x2, self.y2) {
            write!(f, "  box {x1:3} {y1:3} to {x2:3} {y2:3}")?;
        }
        if let (Some(pixels), Some(confidence)) = (self.pixels, self.confidence) {
            write!(f, "  pixels {pixels:3}  confidence {confidence:3}")?;
        }
        if let (Some(bearing), Some(sigma)) = (self.bearing_rad, self.sigma_rad) {
            write!(f, "  bearing {} deg", Degrees(bearing, sigma))?;
            write!(f, "{}", Height(self.elevation_rad))?;
        }
        Ok(())
    }
}

/// Elevation of an object, radians, in words: nothing where it is not known.
#[derive(Clone, Copy, Debug)]
pub struct Height(pub Option<f64>);

impl fmt::Display for Height {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(elevation) => write!(f, ", {:+.1} deg up", elevation.to_degrees()),
            None => Ok(()),
        }
    }
}

/// An angle and its sigma, radians, shown in degrees.
#[derive(Clone, Copy, Debug)]
pub struct Degrees(pub f64, pub f64);

impl fmt::Display for Degrees {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:+7.2} +/- {:.2}",
            self.0.to_degrees(),
            self.1.to_degrees()
        )
    }
}

/// One line for a screen, the most important first: narrow terminals cut it off.
///
/// It begins with the view from left to right: where the box is, and its middle.
#[derive(Clone, Copy, Debug)]
pub struct Screen<'a> {
    /// The last packet.
    pub line: &'a PacketLine,
    /// The view.
    pub view: &'a View,
    /// Packets so far.
    pub tally: &'a Tally,
}

impl fmt::Display for Screen<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.line;
        let last = usize::from(self.view.columns().saturating_sub(1)).max(1);
        let cell =
            |column: i16| usize::try_from(column).unwrap_or(0).min(last) * (STRIP - 1) / last;
        let span = line.x1.zip(line.x2).map(|(x1, x2)| cell(x1)..=cell(x2));
        let middle = line.column.map(cell);
        for place in 0..STRIP {
            f.write_str(match &span {
                _ if middle == Some(place) => "O",
                Some(span) if span.contains(&place) => "=",
                _ if place == STRIP / 2 => ":",
                _ => ".",
            })?;
        }
        match line.column {
            Some(column) => write!(f, " column {column:3}")?,
            None => f.write_str(" nothing tracked")?,
        }
        if let (Some(bearing), Some(sigma)) = (line.bearing_rad, line.sigma_rad) {
            write!(f, "  bearing {} deg", Degrees(bearing, sigma))?;
            write!(f, "{}", Height(line.elevation_rad))?;
        }
        if let (Some(pixels), Some(confidence)) = (line.pixels, line.confidence) {
            write!(f, "  confidence {confidence:3}  pixels {pixels:3}")?;
        }
        if let Some(rate) = self.tally.rate() {
            write!(f, "  {rate:.1} a second")?;
        }
        Ok(())
    }
}

/// Describes a suspicious first look with a colour, if it is one.
pub fn doubt(tracking: &Tracking, view: &View) -> Option<&'static str> {
    let Some(found) = tracking.bounding_box() else {
        return Some(
            "nothing in view has this colour: is the object lit, and was it in the middle when its \
             colour was learnt?",
        );
    };
    if 4 * u16::from(found.x2.saturating_sub(found.x1)) >= 3 * view.columns() {
        return Some(
            "this colour is all over the view: was the object in the middle, is the background of \
             another colour, and did the camera have a few seconds to adapt to the light?",
        );
    }
    let sparse = tracking.confidence().is_some_and(|value| value < 50);
    sparse.then_some(
        "the tracked pixels fill little of their box: something else in view has this colour, too",
    )
}

/// Counts while a stream runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    packets: u64,
    lost: u64,
    first: Option<Duration>,
    last: Duration,
}

impl Tally {
    /// Counts a packet.
    pub fn add(&mut self, after: Duration, tracking: &Tracking) {
        self.packets += 1;
        self.lost += u64::from(tracking.is_lost());
        self.first = self.first.or(Some(after));
        self.last = after;
    }

    /// Packets so far.
    pub fn packets(&self) -> u64 {
        self.packets
    }

    /// Packets a second, from the first to the last.
    pub fn rate(&self) -> Option<f64> {
        let time = self.last.checked_sub(self.first?)?.as_secs_f64();
        let intervals = self.packets.checked_sub(1)?;
        (intervals > 0 && time > 0.0).then(|| intervals as f64 / time)
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.packets == 1 { "" } else { "s" };
        write!(f, "{} packet{plural}", self.packets)?;
        if let Some(rate) = self.rate() {
            write!(f, ", {rate:.1} a second")?;
        }
        if self.lost > 0 {
            write!(f, ", {} of them without a target", self.lost)?;
        }
        Ok(())
    }
}

/// The driver's counters of failures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counters {
    /// Bytes that came and made no sense.
    pub dropped: DroppedBytes,
    /// Commands that had to be repeated.
    pub retries: u16,
    /// Restarts of the camera that were not ordered.
    pub restarts: u16,
}

impl Counters {
    /// The counters as they are now.
    pub fn of(session: &Session) -> Self {
        Self {
            dropped: *session.dropped(),
            retries: session.retries(),
            restarts: session.restarts(),
        }
    }
}

/// Failures on the line between two looks at the counters.
#[derive(Clone, Copy, Debug)]
pub struct Garbled {
    /// Counters at the beginning.
    pub before: Counters,
    /// Counters at the end.
    pub after: Counters,
}

impl fmt::Display for Garbled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (a, b) = (&self.before.dropped, &self.after.dropped);
        let counts = [
            (b.malformed.saturating_sub(a.malformed), "malformed"),
            (b.cut.saturating_sub(a.cut), "cut short"),
            (
                b.fields.saturating_sub(a.fields),
                "with a wrong number of fields",
            ),
            (
                b.impossible.saturating_sub(a.impossible),
                "with impossible numbers",
            ),
            (b.images.saturating_sub(a.images), "in images"),
            (b.noise.saturating_sub(a.noise), "noise between lines"),
        ];
        let bytes = b.bytes.saturating_sub(a.bytes);
        write!(f, "{bytes} bytes garbled")?;
        let mut separator = ": ";
        for (count, kind) in counts {
            if count > 0 {
                write!(f, "{separator}{count} {kind}")?;
                separator = ", ";
            }
        }
        let retries = self.after.retries.saturating_sub(self.before.retries);
        if retries > 0 {
            write!(f, "; commands repeated: {retries}")?;
        }
        let restarts = self.after.restarts.saturating_sub(self.before.restarts);
        if restarts > 0 {
            write!(f, "; restarts of the camera: {restarts}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use calib_core::camera::Camera;

    use super::*;

    fn view() -> View {
        let camera = Camera::pin_hole(88, 45_f64.to_radians()).unwrap();
        View::new(88, 0, Some(camera))
    }

    const SEEN: Tracking = Tracking::new([21, 70, 18, 60, 26, 82, 20, 201]);

    /// The edges are at columns 17.5 and 26.5: atan(tan(22.5 deg) 26 / 43.5) = 13.906 and, with 17,
    /// 9.195 degrees, 11.550 in the mean; columns are 0.514 and 0.532 degrees wide there, and sigma is
    /// 0.204 of that.
    #[test]
    fn a_packet_as_text() {
        let line = PacketLine::new(Duration::from_micros(1_234_567), &SEEN, &view());
        assert_eq!(
            line.to_string(),
            "   1.234 s  column  21 row  70  box  18  60 to  26  82  pixels  20  confidence 201  \
             bearing  +11.55 +/- 0.11 deg"
        );
        let blind = View::new(88, 0, None);
        let line = PacketLine::new(Duration::ZERO, &SEEN, &blind);
        assert!(line.to_string().ends_with("confidence 201"));
        let line = PacketLine::new(Duration::ZERO, &Tracking::LOST, &view());
        assert_eq!(line.to_string(), "   0.000 s  nothing tracked");
    }

    #[test]
    fn a_packet_as_json() {
        let json = |tracking, view: View| {
            let line = PacketLine::new(Duration::from_millis(40), tracking, &view);
            serde_json::to_string(&line).unwrap()
        };
        assert_eq!(
            json(&SEEN, View::new(88, 1, None)),
            r#"{"seconds":0.04,"column":20,"row":69,"x1":17,"y1":59,"x2":25,"y2":81,"pixels":20,"confidence":201,"bearing_rad":null,"sigma_rad":null,"elevation_rad":null}"#
        );
        assert_eq!(
            json(&Tracking::LOST, view()),
            r#"{"seconds":0.04,"column":null,"row":null,"x1":null,"y1":null,"x2":null,"y2":null,"pixels":null,"confidence":null,"bearing_rad":null,"sigma_rad":null,"elevation_rad":null}"#
        );
    }

    #[test]
    fn the_screen_shows_left_and_right_first() {
        let screen = |tracking| {
            let line = &PacketLine::new(Duration::ZERO, &tracking, &view());
            let (view, tally) = (&view(), &Tally::default());
            Screen { line, view, tally }.to_string()
        };
        let at = |x1, mx, x2| screen(Tracking::new([mx, 70, x1, 60, x2, 82, 20, 201]));
        assert_eq!(
            at(2, 6, 10),
            "=O=.........:............ column   6  bearing  +19.62 +/- 0.10 deg  confidence 201  \
             pixels  20"
        );
        // What is cut off or partly hidden has no middle.
        assert!(!at(0, 4, 8).contains("bearing"));
        assert!(!at(2, 3, 10).contains("bearing"));
        assert!(at(77, 87, 87).starts_with("............:........===O column  87"));
        assert_eq!(
            screen(Tracking::LOST),
            "............:............ nothing tracked"
        );
    }

    #[test]
    fn rates_and_garbage() {
        let mut tally = Tally::default();
        for number in 0..26 {
            let tracking = if number == 3 { Tracking::LOST } else { SEEN };
            tally.add(Duration::from_millis(500 + 40 * number), &tracking);
        }
        assert_eq!(
            tally.to_string(),
            "26 packets, 25.0 a second, 1 of them without a target"
        );
        let before = Counters {
            retries: 7,
            ..Counters::default()
        };
        let garbled = |after| Garbled { before, after }.to_string();
        assert_eq!(garbled(before), "0 bytes garbled");
        let dropped = DroppedBytes {
            bytes: 12,
            cut: 2,
            noise: 1,
            ..DroppedBytes::default()
        };
        let after = Counters {
            dropped,
            retries: 8,
            restarts: 2,
        };
        assert_eq!(
            garbled(after),
            "12 bytes garbled: 2 cut short, 1 noise between lines; commands repeated: 1; restarts \
             of the camera: 2"
        );
    }

    #[test]
    fn a_colour_that_is_nowhere_everywhere_or_scattered() {
        let doubts = |numbers| doubt(&Tracking::new(numbers), &view());
        assert_eq!(doubt(&SEEN, &view()), None);
        assert!(doubt(&Tracking::LOST, &view()).unwrap().contains("nothing"));
        let wide = doubts([44, 70, 1, 1, 88, 143, 255, 250]).unwrap();
        assert!(wide.contains("all over"));
        let scattered = doubts([44, 70, 20, 20, 60, 120, 5, 3]).unwrap();
        assert!(scattered.contains("something else"));
    }
}
