use std::{string::ToString, vec::Vec};

use calib_core::camera::Camera;
use proptest::prelude::*;

use super::*;
use crate::vision::{Grid, Rows};
use cmucam2_driver::packet::Tracking;

const COLUMNS: u16 = 88;

const ROUND: Shape = Shape::Round {
    rows_per_column: 2.0,
    optics: None,
};

fn blob(values: [u8; 8]) -> Option<Blob> {
    Blob::from_tracking(&Tracking::new(values), Grid::pixels(1))
}

/// Nine columns wide around column 43 (44 in packets).
fn at(column: u8) -> Option<Blob> {
    blob([column, 70, column - 4, 60, column + 4, 80, 20, 201])
}

fn last<I: IntoIterator<Item = Option<Blob>>>(blobs: I) -> Result<Steady, Unsteady> {
    last_of(ROUND, blobs)
}

fn last_of<I: IntoIterator<Item = Option<Blob>>>(
    shape: Shape,
    blobs: I,
) -> Result<Steady, Unsteady> {
    let mut steadiness = Steadiness::<10>::new(10, COLUMNS, shape);
    let judged = blobs.into_iter().map(|blob| steadiness.push(blob));
    judged.last().unwrap_or(Err(Unsteady::Few))
}

#[test]
fn a_blob_that_stands_still_is_known_to_the_rounding_of_its_edges() {
    let steady = last([at(44); 10]).unwrap();
    assert_eq!(
        (steady.left, steady.right, steady.middle()),
        (38.5, 47.5, 43.0)
    );
    assert!((steady.column_sigma - 24_f32.sqrt().recip()).abs() < 1e-6);
    assert_eq!(
        (steady.frames, steady.pixels, steady.confidence),
        (10, 20, 201)
    );
    assert_eq!(last([at(44); 9]), Err(Unsteady::Few));
}

/// Edges at 39 and 46 have their middle between two columns.
#[test]
fn half_columns_count() {
    let even = blob([43, 70, 40, 60, 47, 78, 20, 201]);
    assert_eq!(last([even; 10]).unwrap().middle(), 42.5);
}

/// Five of 44 and five of 45: the median between them, the variance 10/36.
#[test]
fn noise_widens_the_sigma() {
    let steady = last([44, 45, 44, 45, 44, 45, 44, 45, 44, 45].map(at)).unwrap();
    assert_eq!(steady.middle(), 43.5);
    let expected = (1.0 / 24.0 + std::f32::consts::PI / 2.0 / 36.0).sqrt();
    assert!((steady.column_sigma - expected).abs() < 1e-6);
}

#[test]
fn one_wrong_packet_of_ten_does_no_harm() {
    let one = |wrong| {
        let mut blobs = [at(44); 10];
        blobs[3] = wrong;
        last(blobs)
    };
    assert_eq!(one(at(80)).unwrap().middle(), 43.0);
    assert_eq!(one(None).unwrap().frames, 9);
    let cut = blob([44, 70, 1, 60, 48, 80, 20, 201]);
    assert_eq!(one(cut).unwrap().frames, 9);
}

#[test]
fn what_is_lost_cut_off_or_moving_is_refused() {
    let mut blobs = [at(44); 10];
    blobs[3] = None;
    blobs[7] = None;
    let lost = Unsteady::Lost {
        lost: 2,
        frames: 10,
    };
    assert_eq!(last(blobs), Err(lost));
    for (x1, x2) in [(1, 9), (80, 88), (81, 87)] {
        let cut = blob([x1 + 4, 70, x1, 60, x2, 80, 20, 201]);
        assert_eq!(last([cut; 10]), Err(Unsteady::Clipped));
    }
    let slowly = last((0..10).map(|step| at(44 + step / 5 * 2)));
    assert_eq!(
        slowly,
        Err(Unsteady::Moving {
            from: 43.0,
            to: 45.0
        })
    );
    let fast = last((0..10).map(|step| at(30 + step)));
    assert!(matches!(fast, Err(Unsteady::Moving { .. })));
}

/// Two columns from one half to the other, also where the halves have no frame in their middle.
#[test]
fn a_drift_is_seen_in_any_number_of_frames() {
    for frames in 4..=12_u8 {
        let mut steadiness = Steadiness::<12>::new(usize::from(frames), COLUMNS, ROUND);
        let judged = (0..frames).map(|n| steadiness.push(at(44 + 2 * u8::from(n >= frames / 2))));
        let moving = Err(Unsteady::Moving {
            from: 43.0,
            to: 45.0,
        });
        assert_eq!(judged.last(), Some(moving), "{frames}");
    }
}

#[test]
fn the_last_frames_count() {
    let moved_in = (20..40).map(at).chain([at(40); 10]);
    assert_eq!(last(moved_in).unwrap().middle(), 39.0);
}

/// 20 columns wide, its mass at a fifth: a ball with something else of its colour far right.
#[test]
fn what_is_not_one_ball_is_refused() {
    let merged = blob([34, 70, 30, 60, 49, 80, 20, 90]);
    let refused = last([merged; 10]).unwrap_err();
    assert_eq!(refused, Unsteady::Lopsided { by: 4.0 });
    assert!(refused.to_string().contains("partly hidden"), "{refused}");
    let mirrored = blob([45, 70, 30, 60, 49, 80, 20, 90]);
    assert!(matches!(
        last([mirrored; 10]),
        Err(Unsteady::Lopsided { .. })
    ));
}

/// A blob is judged by its shape before it is believed.
#[test]
fn the_shape_is_judged() {
    let wide = |by| Some(Unsteady::Wide { by });
    let sparse = |filled| Some(Unsteady::Sparse { filled });
    for (told, shape, why) in [
        ([40, 70, 36, 61, 44, 78, 20, 201], ROUND, None),
        // Two balls side by side.
        ([40, 70, 31, 61, 49, 78, 40, 201], ROUND, wide(10.0)),
        ([40, 70, 31, 61, 49, 78, 40, 201], Shape::Any, None),
        // A crescent, and a ball with a speck; a person.
        ([40, 70, 36, 61, 44, 78, 20, 120], ROUND, sparse(120)),
        ([40, 70, 36, 61, 44, 78, 20, 120], Shape::Any, None),
        ([40, 70, 36, 31, 44, 108, 20, 14], Shape::Any, sparse(14)),
        // So few pixels fill their box by chance; some cameras do not tell.
        ([40, 70, 39, 68, 41, 73, 1, 100], ROUND, None),
        ([40, 70, 36, 61, 44, 78, 20, 0], ROUND, None),
    ] {
        let mut steadiness = Steadiness::<5>::new(5, COLUMNS, shape);
        let judged = (0..5).map(|_| steadiness.push(blob(told))).last().unwrap();
        assert_eq!(judged.err(), why, "{told:?} {shape:?}");
    }
}

/// Through a lens of 100 degrees a ball at 40 degrees is wider than tall by a third.
#[test]
fn far_from_the_axis_a_ball_is_wide() {
    let picture = Picture::new(100.0);
    let judge = |hidden_from: f64, optics| {
        let blob = picture.ball(-0.7, 0.0, 0.1, hidden_from);
        let shape = Shape::Round {
            rows_per_column: 2.0,
            optics,
        };
        let mut steadiness = Steadiness::<5>::new(5, COLUMNS, shape);
        (0..5).map(|_| steadiness.push(blob)).last().unwrap()
    };
    let lens = Some(picture.on_node());
    assert!(judge(88.0, lens).is_ok());
    assert!(matches!(judge(88.0, None), Err(Unsteady::Wide { .. })));
    let half = 43.5 + picture.focal * 0.7_f64.tan();
    assert!(matches!(judge(half, lens), Err(Unsteady::Lopsided { .. })));
}

/// A unit of 5.5 columns is known to 5.5 times the sigma.
#[test]
fn blocks_are_known_less_well() {
    let grid = Grid::blocks(1, 16, COLUMNS, 143);
    let packet = Tracking::new([7, 9, 6, 8, 8, 10, 9, 255]);
    let steady = last([Blob::from_tracking(&packet, grid); 10]).unwrap();
    assert_eq!((steady.left, steady.right), (27.0, 43.5));
    assert!((steady.column_sigma - 5.5 / 24_f32.sqrt()).abs() < 1e-5);
}

/// A view, in the angles of a camera: decides which of its pixels belong to it.
struct Picture {
    camera: Camera<f64>,
    /// Columns at a tangent of 1.
    focal: f64,
}

impl Picture {
    fn new(view_deg: f64) -> Self {
        let half = (view_deg / 2.0).to_radians();
        Self {
            camera: Camera::pin_hole(COLUMNS, 2.0 * half).unwrap(),
            focal: 43.5 / half.tan(),
        }
    }

    /// A ball of angular radius `radius` at `bearing`, level with the camera or `up` radians above
    /// it, of which only columns below `hidden_from` are to be seen. Pixels are twice as wide as
    /// tall. A pixel is the ball's when the line of sight through its middle is within the cone.
    fn ball(&self, bearing: f64, up: f64, radius: f64, hidden_from: f64) -> Option<Blob> {
        let centre = [up.cos() * bearing.cos(), up.cos() * bearing.sin(), up.sin()];
        let mut own: Vec<(u8, u8)> = Vec::new();
        for column in 0..88_u8 {
            for row in 0..143_u8 {
                let left = (43.5 - f64::from(column)) / self.focal;
                let above = (71.0 - f64::from(row)) / (2.0 * self.focal);
                let length = (1.0 + left * left + above * above).sqrt();
                let cos = (centre[0] + centre[1] * left + centre[2] * above) / length;
                if cos >= radius.cos() && f64::from(column) < hidden_from {
                    own.push((column, row));
                }
            }
        }
        let n = own.len() as u32;
        let mean =
            |of: fn(&(u8, u8)) -> u8| own.iter().map(|p| u32::from(of(p))).sum::<u32>() / n.max(1);
        let (mx, my) = (mean(|p| p.0) as u8, mean(|p| p.1) as u8);
        let bounds = |of: fn(&(u8, u8)) -> u8| {
            let values = || own.iter().map(of);
            Some((values().min()?, values().max()?))
        };
        let ((x1, x2), (y1, y2)) = (bounds(|p| p.0)?, bounds(|p| p.1)?);
        let area = (u32::from(x2 - x1) + 1) * (u32::from(y2 - y1) + 1);
        let numbers = [mx, my, x1, y1, x2, y2].map(|value| value + 1);
        let [mx, my, x1, y1, x2, y2] = numbers;
        blob([
            mx,
            my,
            x1,
            y1,
            x2,
            y2,
            ((n + 4) / 8).min(255) as u8,
            (256 * n / area).min(255) as u8,
        ])
    }

    fn on_node(&self) -> Camera<f32> {
        let view = 2.0 * self.camera.bearing(0.0);
        Camera::pin_hole(COLUMNS, view as f32).unwrap()
    }

    fn judge(&self, blob: Option<Blob>) -> Result<(Steady, Direction<f64>), Unsteady> {
        // As nodes know their lens.
        let shape = Shape::Round {
            rows_per_column: 2.0,
            optics: Some(self.on_node()),
        };
        let steady = last_of(shape, [blob; 10])?;
        Ok((steady, steady.direction(&self.camera, 0.0)))
    }
}

/// The same blob in a frame of the CMUcam2.
fn in_rows(blob: Blob) -> Blob {
    let rows = Some(Rows {
        count: 143,
        per_column: 2.0,
    });
    Blob { rows, ..blob }
}

/// A ball that is cut off at the top is refused, as its row is not known. A tall object of any shape is not: its row
/// is unknown.
#[test]
fn a_ball_cut_off_at_the_top_is_refused() {
    let packet = |y1, y2| blob([44, 20, 36, y1, 52, y2, 255, 201]).map(in_rows);
    assert!(last([packet(3, 36); 10]).is_ok());
    assert_eq!(last([packet(1, 34); 10]), Err(Unsteady::Clipped));
    assert_eq!(last([packet(110, 142); 10]), Err(Unsteady::Clipped));
    let mut tall = Steadiness::<10>::new(10, COLUMNS, Shape::Any);
    let mut seen = Err(Unsteady::Few);
    for _ in 0..10 {
        seen = tall.push(packet(1, 143));
    }
    assert_eq!(seen.unwrap().above, None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// A round target is seen where it is, to within the rounding of its edges: half a column for
    /// both together, and a little where no row of pixels goes through its widest place. Nothing
    /// casts doubt on its shape.
    #[test]
    fn a_ball_is_seen_where_it_is(
        view in 40.0_f64..70.0, place in -0.75_f64..0.75, up in -0.1_f64..0.1,
        radius in 0.02_f64..0.1,
    ) {
        let picture = Picture::new(view);
        let bearing = place * (view / 2.0).to_radians();
        let blob = picture.ball(bearing, up, radius, 88.0);
        prop_assume!(blob.is_some_and(|blob| !blob.is_clipped(COLUMNS)));
        let blob = blob.map(in_rows);
        let (steady, direction) = picture.judge(blob).unwrap();
        // A row is as much as half a column.
        let elevation = steady.seen(&picture.on_node(), 0.0).elevation.radians::<f64>();
        let row = picture.camera.bearing_sigma(43.5, 0.5);
        let off = (elevation.unwrap() - up).abs() / row;
        prop_assert!(off < 0.75, "off by {off} rows");
        // A ball aside, and above or below, is a little longer than wide.
        let rounding = 24_f32.sqrt().recip();
        prop_assert!(steady.column_sigma < 1.5 * rounding, "{}", steady.column_sigma);
        let column = picture.camera.bearing_sigma(f64::from(steady.middle()), 1.0);
        let off = (direction.bearing - bearing).abs() / column;
        prop_assert!(off < 0.65, "off by {off} columns");
    }

    /// However much of the target is hidden, the direction that is given is wrong by no more than rounding or
    /// its sigma explains, and a half hidden target is never accepted. (The last sliver of a target looks
    /// like a small one: that cannot be told.)
    #[test]
    fn a_ball_partly_hidden_is_refused_or_doubted(
        place in -0.5_f64..0.5, radius in 0.03_f64..0.22, hidden in -0.5_f64..1.0,
    ) {
        let picture = Picture::new(45.0);
        let bearing = place * 22.5_f64.to_radians();
        let edge = 43.5 - picture.focal * (bearing - hidden * radius).tan();
        let blob = picture.ball(bearing, 0.0, radius, edge);
        prop_assume!(blob.is_some_and(|blob| !blob.is_clipped(COLUMNS)));
        if let Ok((steady, direction)) = picture.judge(blob) {
            let column = picture.camera.bearing_sigma(f64::from(steady.middle()), 1.0);
            let off = (direction.bearing - bearing).abs();
            prop_assert!(
                off < 1.6 * column || off < 4.0 * direction.sigma,
                "off by {} columns, sigma {}", off / column, direction.sigma / column
            );
            prop_assert!(hidden > 0.0 || steady.right - steady.left < 6.0, "{hidden} is accepted");
        }
    }

    #[test]
    fn any_packets_are_judged(
        packets in prop::collection::vec(any::<[u8; 8]>(), 0..40), first in 0_u8..2,
    ) {
        let mut steadiness = Steadiness::<10>::new(5, COLUMNS, ROUND);
        for values in packets {
            let blob = Blob::from_tracking(&Tracking::new(values), Grid::pixels(first));
            if let Ok(steady) = steadiness.push(blob) {
                prop_assert!(steady.column_sigma >= 0.2 && steady.column_sigma.is_finite());
                prop_assert!(steady.left > 0.0 && steady.right < 85.5);
            }
        }
    }
}

/// Over many balls the errors of direction and of width are as large as the sigma says, and have no
/// sign.
#[test]
fn the_sigma_is_that_of_the_errors() {
    let picture = Picture::new(45.0);
    let camera = Camera::pin_hole(COLUMNS, 45_f32.to_radians()).unwrap();
    let (mut sums, mut squares, mut count) = ([0.0; 2], [0.0; 2], 0.0);
    // An irrational step visits all fractions of a column evenly.
    for step in 0..1500 {
        let fraction = |factor: f64| (f64::from(step) * factor).fract();
        let bearing = (fraction(0.618_033_988_75) - 0.5) * 0.5;
        let radius = 0.03 + 0.05 * fraction(0.754_877_666_25);
        let up = (fraction(0.569_840_290_998) - 0.5) * 0.2;
        let Ok((steady, direction)) = picture.judge(picture.ball(bearing, up, radius, 88.0)) else {
            panic!("not steady: {bearing} {radius}");
        };
        let seen = steady.seen(&camera, 0.0);
        // Planes through the vertical touch the ball where its shadow on the ground ends.
        let half_width = (radius.sin() / up.cos()).asin();
        let off = [
            direction.bearing - bearing,
            f64::from(seen.half_width) * 1e-4 - half_width,
        ];
        for (n, off) in off.into_iter().enumerate() {
            let normed = off / direction.sigma;
            sums[n] += normed;
            squares[n] += normed * normed;
        }
        count += 1.0;
    }
    for (sum, squares) in sums.into_iter().zip(squares) {
        let (mean, rms): (f64, f64) = (sum / count, (squares / count).sqrt());
        std::println!("mean {mean:.3} rms {rms:.3}");
        assert!(mean.abs() < 0.1, "mean {mean}");
        assert!((0.9..1.1).contains(&rms), "rms {rms}");
    }
}

/// The middle of the box lies further out than the ball: a quarter of a column here, more than the
/// sigma of rounding. The mean of the angles does not.
#[test]
fn the_mean_of_angles_is_the_middle_of_a_ball() {
    let camera = Camera::<f64>::pin_hole(COLUMNS, 60_f64.to_radians()).unwrap();
    let (bearing, radius) = (0.4_f64, 0.08);
    let column = |angle: f64| 43.5 - 43.5 / 30_f64.to_radians().tan() * angle.tan();
    let steady = Steady {
        above: None,
        left: column(bearing + radius) as f32,
        right: column(bearing - radius) as f32,
        column_sigma: 0.2,
        frames: 5,
        pixels: 20,
        confidence: 201,
    };
    assert!((steady.direction(&camera, 0.0).bearing - bearing).abs() < 1e-6);
    let outwards = f64::from(steady.middle()) - column(bearing);
    assert!((-0.25..-0.23).contains(&outwards), "{outwards}");
}

#[test]
fn the_floor_is_what_remains() {
    let camera = Camera::<f32>::pin_hole(COLUMNS, 1.0).unwrap();
    let steady = last([at(44); 10]).unwrap();
    let floor = steady.seen(&camera, 3.0);
    let none = steady.seen(&camera, 0.0);
    assert!(
        (floor.sigma / none.sigma - (9.0_f32 + 1.0 / 24.0).sqrt() * 24_f32.sqrt()).abs() < 1e-3
    );
}

/// One frame of a moving object: nine columns and twice as many rows are round here.
#[test]
fn a_glance_is_one_frame() {
    let steadiness = Steadiness::<10>::new(10, COLUMNS, ROUND);
    let glance = |x1, x2, middle| {
        let seen = blob([middle, 70, x1, 61, x2, 78, 20, 201]).unwrap();
        steadiness.glance(&seen)
    };
    let round = glance(40, 48, 44).unwrap();
    assert_eq!((round.steady.middle(), round.is_wide), (43.0, false));
    assert!((round.steady.column_sigma - 24_f32.sqrt().recip()).abs() < 1e-6);
    assert_eq!(round.steady.frames, 1);
    // Cut off by the border; half hidden by a wall.
    assert_eq!(glance(1, 9, 5), None);
    assert_eq!(glance(44, 48, 46), None);
    // Two of them side by side are one wide box, with its middle of mass where the larger one is.
    let both = glance(30, 48, 36).unwrap();
    assert_eq!((both.steady.middle(), both.is_wide), (38.0, true));
    // For an object without a shape it is not known.
    let any = Steadiness::<10>::new(10, COLUMNS, Shape::Any);
    let seen = blob([39, 70, 30, 61, 48, 78, 20, 201]).unwrap();
    assert!(!any.glance(&seen).unwrap().is_wide);
}
