//! Lenses that are not what they are taken for.

use calib_core::{
    Ray, Refusal, Sighting,
    camera::{Camera, Projection},
    resection::{self, LensFit, Solution},
};
use nalgebra::Point2;
use rand::RngExt;
use test_support::{Random, Truth, chi_squared_band, generator, normal, turn};

const SIGMA: f64 = 0.002;
const PRIOR: f64 = 0.02;
/// Sigma of a column that was rounded to a whole one.
const PIXEL: f64 = 0.288_675;

/// Sightings whose rays come from a lens that is `stretch` off, and the truth.
fn scene(
    rng: &mut Random,
    count: usize,
    projection: Projection,
    stretch: f64,
) -> (Truth, Vec<Sighting<f64>>) {
    let truth = Truth::random(rng);
    let targets: [Point2<f64>; 16] = truth.targets(rng);
    let sightings = targets.iter().take(count).map(|&target| {
        let ray = Ray::from_bearing(truth.bearing_of(target) + SIGMA * normal(rng));
        let seen = ray.stretched(projection, 1.0 / (1.0 + stretch));
        Sighting::new(target, seen, SIGMA)
    });
    (truth, sightings.collect())
}

const PROJECTIONS: [Projection; 2] = [Projection::PinHole, Projection::EqualAngle];

fn solve(
    sightings: &[Sighting<f64>],
    projection: Projection,
) -> Option<(Solution<f64>, LensFit<f64>)> {
    resection::solve_with_lens(&mut sightings.to_vec(), projection, PRIOR).ok()
}

#[test]
fn exact_sightings_give_the_exact_lens() {
    for seed in 0..100 {
        for projection in PROJECTIONS {
            let mut rng = generator(seed);
            let stretch = rng.random_range(-0.08..0.08);
            let truth = Truth::random(&mut rng);
            let targets: [Point2<f64>; 8] = truth.targets(&mut rng);
            let mut sightings = targets.map(|target| {
                let ray = Ray::from_bearing(truth.bearing_of(target));
                // So sharp that the prior has no say.
                Sighting::new(
                    target,
                    ray.stretched(projection, 1.0 / (1.0 + stretch)),
                    1e-7,
                )
            });
            let (solution, lens) =
                resection::solve_with_lens(&mut sightings, projection, PRIOR).unwrap();
            assert!(
                (lens.stretch - stretch).abs() < 1e-5,
                "{seed}: {lens:?} {stretch}"
            );
            assert!((solution.pose.position - truth.position()).norm() < 1e-3);
            // The rays are those of the right lens now.
            assert!(targets.iter().zip(&sightings).all(|(target, s)| {
                turn(truth.bearing_of(*target), s.ray.bearing()).abs() < 1e-5
            }));
        }
    }
}

/// Lenses drawn from their prior: stretch and pose are as far off as their sigmas say, and one in a
/// thousand right ones is called wrong at most as often as by chance.
#[test]
fn sigmas_are_honest_with_an_unknown_lens() {
    let (mut of_stretch, mut of_pose, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..1500 {
        let mut rng = generator(seed);
        let projection = PROJECTIONS[seed as usize % 2];
        let stretch = PRIOR * normal(&mut rng);
        let sightings = rng.random_range(4..12);
        let (truth, sightings) = scene(&mut rng, sightings, projection, stretch);
        let Some((solution, lens)) = solve(&sightings, projection) else {
            continue;
        };
        // Where the pose itself is well known; near the danger circle nothing is to first order.
        if solution.pose.sigma_position() > 0.3 {
            continue;
        }
        of_stretch += ((lens.stretch - stretch) / lens.sigma).powi(2);
        of_pose += solution
            .pose
            .normalised_error(truth.position(), truth.heading)
            .unwrap();
        count += 1.0;
    }
    assert!(count > 700.0, "{count}");
    assert!(
        chi_squared_band(count).contains(&of_stretch),
        "{} of {count}",
        of_stretch / count
    );
    assert!(
        chi_squared_band(3.0 * count).contains(&of_pose),
        "{} of 3",
        of_pose / count
    );
}

/// 47 degrees taken for 45: the usual mistake. A right lens is called wrong once in a thousand times.
#[test]
fn a_wrong_lens_is_told_from_a_right_one() {
    let right = Camera::pin_hole(160, 47_f64.to_radians()).unwrap();
    let wrong = Camera::pin_hole(160, 45_f64.to_radians()).unwrap();
    let [mut told, mut told_single, mut false_alarms, mut count] = [0; 4];
    for seed in 0..2000 {
        let mut rng = generator(seed);
        let truth = Truth::random(&mut rng);
        let columns: Vec<_> = (0..8)
            .map(|_| {
                let place = truth.place(rng.random_range(1.0..8.0), rng.random_range(-0.38..0.38));
                let ray = Ray::from_bearing(truth.bearing_of(place));
                (place, right.column(ray).unwrap() + PIXEL * normal(&mut rng))
            })
            .collect();
        let seen_by = |camera: &Camera<f64>| -> Vec<_> {
            let sighting = |&(place, column)| {
                Sighting::new(place, camera.ray(column), camera.whole_pixel_sigma(column))
            };
            columns.iter().map(sighting).collect()
        };
        let is_off = |sightings: &[Sighting<f64>]| {
            let pose = resection::solve(sightings).ok()?.pose;
            let lens = resection::lens_fit(sightings, &[], Projection::PinHole, &pose, PRIOR)?;
            Some(lens.is_off())
        };
        let (Some(of_wrong), Some(of_right)) = (is_off(&seen_by(&wrong)), is_off(&seen_by(&right)))
        else {
            continue;
        };
        count += 1;
        told += u32::from(of_wrong);
        false_alarms += u32::from(of_right);
        let single: Vec<_> = seen_by(&wrong)
            .iter()
            .map(|s| {
                let ray = Ray {
                    forward: s.ray.forward as f32,
                    left: s.ray.left as f32,
                };
                Sighting::new(s.target.cast::<f32>(), ray, s.bearing_sigma as f32)
            })
            .collect();
        let lens = resection::solve(&single).ok().and_then(|solution| {
            resection::lens_fit(
                &single,
                &[],
                Projection::PinHole,
                &solution.pose,
                PRIOR as f32,
            )
        });
        told_single += u32::from(lens.is_some_and(|lens| lens.is_off()));
    }
    assert!(count > 1900);
    assert!(false_alarms <= 8, "{false_alarms} of {count}");
    assert!(
        told.abs_diff(told_single) <= count / 100,
        "{told} {told_single}"
    );
    assert!(told > count / 4 * 3, "{told} of {count}");
}

/// An independent search: chi squared of every stretch, each with its own best pose.
#[test]
fn the_stretch_is_where_chi_squared_with_its_prior_is_least() {
    for seed in 0..40 {
        let mut rng = generator(seed);
        let (_, sightings) = scene(&mut rng, 6, Projection::PinHole, 0.03);
        let Some((solution, lens)) = solve(&sightings, Projection::PinHole) else {
            continue;
        };
        let chi_squared = |stretch: f64| {
            let stretched: Vec<_> = sightings
                .iter()
                .map(|s| Sighting {
                    ray: s.ray.stretched(Projection::PinHole, 1.0 + stretch),
                    ..*s
                })
                .collect();
            resection::solve(&stretched).map_or(f64::INFINITY, |s| s.chi_squared)
        };
        let least = |cost: &dyn Fn(f64) -> f64| {
            let all = (-1000..1000).map(|n| 1e-4 * f64::from(n));
            all.map(|stretch| (cost(stretch), stretch))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap()
        };
        let (cost, stretch) = least(&|stretch| chi_squared(stretch) + (stretch / PRIOR).powi(2));
        assert!(
            (stretch - lens.stretch).abs() < 0.1 * lens.sigma,
            "{stretch} {lens:?}"
        );
        assert!((cost - solution.chi_squared).abs() < 0.02 * cost.max(1.0));
        // Without the prior, as far as it is to first order.
        let (cost, stretch) = least(&chi_squared);
        if stretch.abs() < 0.05 {
            let fall = chi_squared(0.0) - cost;
            assert!(
                (fall - lens.misfit).abs() < 0.15 * fall.max(1.0),
                "{fall} {lens:?}"
            );
        }
    }
}

#[test]
fn three_sightings_fit_any_lens() {
    let mut rng = generator(7);
    let (_, mut sightings) = scene(&mut rng, 3, Projection::PinHole, 0.05);
    let pose = resection::solve(&sightings).unwrap().pose;
    assert_eq!(
        resection::lens_fit(&sightings, &[], Projection::PinHole, &pose, PRIOR),
        None
    );
    assert_eq!(
        resection::solve_with_lens(&mut sightings, Projection::PinHole, PRIOR),
        Err(Refusal::TooFew)
    );
}

/// Sightings through a lens of one field of view, degrees, and projection, decoded as another.
fn decoded_as_another(
    rng: &mut Random,
    count: usize,
    [is, seems]: [(Projection, f64); 2],
) -> Vec<Sighting<f64>> {
    let [is, seems] = [is, seems]
        .map(|(projection, view)| Camera::new(projection, 160, view.to_radians()).unwrap());
    (0..count)
        .map(|_| {
            let column = rng.random_range(2.0..157.0);
            let (sine, cosine) = is.bearing(column).sin_cos();
            let target = Point2::new(cosine, sine) * rng.random_range(1.5..8.0);
            let column = (column + PIXEL * normal(rng)).clamp(0.0, 159.0);
            Sighting::new(
                target,
                seems.ray(column),
                seems.bearing_sigma(column, PIXEL),
            )
        })
        .collect()
}

fn other_lens(
    sightings: &[Sighting<f64>],
    (projection, view): (Projection, f64),
) -> Option<resection::OtherLens<f64>> {
    let mut scratch = sightings.to_vec();
    let made = sightings.iter().copied();
    let found = resection::other_lens(&made, &mut scratch, projection, view.to_radians());
    // The precision of a node is enough.
    let single: Vec<_> = { sightings.iter() }
        .map(|s| {
            let ray = Ray {
                forward: s.ray.forward as f32,
                left: s.ray.left as f32,
            };
            Sighting::new(s.target.cast(), ray, s.bearing_sigma as f32)
        })
        .collect();
    let view = (view as f32).to_radians();
    let made = single.iter().copied();
    let in_single = resection::other_lens(&made, &mut single.clone(), projection, view);
    assert_eq!(found.is_some(), in_single.is_some());
    if let (Some(found), Some(single)) = (found, in_single) {
        assert_eq!(found.projection, single.projection);
        assert!((found.field_of_view as f32 - single.field_of_view).abs() < 1e-3);
    }
    found
}

#[test]
fn the_lens_that_fits_is_named() {
    use Projection::{EqualAngle, PinHole};
    for (is, seems, most_degrees) in [
        ((PinHole, 47.0), (PinHole, 45.0), 1.0),
        ((PinHole, 42.0), (PinHole, 45.0), 1.0),
        ((EqualAngle, 60.0), (EqualAngle, 64.0), 1.5),
        ((EqualAngle, 100.0), (PinHole, 100.0), 2.0),
    ] {
        let (mut found, mut right, mut poses) = (0, 0, 0);
        for seed in 0..60 {
            let sightings = decoded_as_another(&mut generator(seed), 10, [is, seems]);
            let Some(lens) = other_lens(&sightings, seems) else {
                continue;
            };
            found += 1;
            let is_it = lens.projection == is.0
                && (lens.field_of_view.to_degrees() - is.1).abs() < most_degrees;
            right += u32::from(is_it);
            // The pose is that of the right lens: the camera is the origin.
            let off = lens.solution.pose.position.coords.norm();
            poses += u32::from(off < 4.0 * lens.solution.pose.sigma_position());
        }
        let text = format!("{is:?} as {seems:?}: {found} found, {right} right, {poses} poses");
        assert!(found >= 30 && 10 * right >= 9 * found, "{text}");
        assert!(10 * poses >= 9 * found, "{text}");
    }
}

/// Neither chance nor a wrong sighting is taken for a lens, nor do four sightings tell one.
#[test]
fn a_right_lens_is_not_doubted() {
    let lens = (Projection::PinHole, 45.0);
    let (mut doubted, mut by_one) = (0, 0);
    for seed in 0..1000 {
        let mut rng = generator(seed);
        let count = 5 + seed as usize % 8;
        let mut sightings = decoded_as_another(&mut rng, count, [lens, lens]);
        doubted += u32::from(other_lens(&sightings, lens).is_some());
        sightings[count / 2].ray = Ray::from_bearing(rng.random_range(-0.35..0.35));
        by_one += u32::from(other_lens(&sightings, lens).is_some());
        let other = decoded_as_another(&mut rng, 4, [(Projection::PinHole, 55.0), lens]);
        assert_eq!(other_lens(&other, lens), None);
    }
    assert!(doubted == 0, "{doubted} of 1000");
    assert!(by_one <= 20, "{by_one} of 1000");
}
