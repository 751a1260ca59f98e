//! Poses that are wrong by more than they claim: are they told from those that are right?

use calib_core::{
    Pose, Ray, Sighting,
    resection::{self, Solution},
};
use nalgebra::{Point2, Vector2};
use rand::RngExt;
use test_support::{Random, Truth, generator, normal, turn};

/// Arrangement of the targets before the camera.
#[derive(Clone, Copy, Debug)]
enum Layout {
    /// Anywhere in view.
    Scattered,
    /// Near a circle through the camera.
    Circle,
    /// Near each other.
    Cluster,
}

impl Layout {
    fn targets(self, truth: &Truth, count: usize, rng: &mut Random) -> Vec<Point2<f64>> {
        let mut some = |place: &mut dyn FnMut(&mut Random) -> Point2<f64>| {
            (0..count).map(|_| place(rng)).collect::<Vec<_>>()
        };
        match self {
            Self::Scattered => some(&mut |rng| {
                truth.place(rng.random_range(1.0..8.0), rng.random_range(-0.5..0.5))
            }),
            Self::Circle => {
                let mut circle = None;
                some(&mut |rng| {
                    let (radius, centre, off) = *circle.get_or_insert_with(|| {
                        (
                            rng.random_range(1.0..5.0),
                            rng.random_range(-0.7..0.7),
                            10_f64.powf(rng.random_range(-4.5..-0.5)),
                        )
                    });
                    let bearing: f64 = rng.random_range(-0.5..0.5);
                    let chord = 2.0 * radius * (bearing - centre).cos();
                    truth.place(chord * (1.0 + off * normal(rng)), bearing)
                })
            }
            Self::Cluster => {
                let mut cluster = None;
                some(&mut |rng| {
                    let (middle, spread) = *cluster.get_or_insert_with(|| {
                        let range = rng.random_range(2.0..8.0);
                        let spread = range * 10_f64.powf(rng.random_range(-3.0..-0.4));
                        (truth.place(range, rng.random_range(-0.4..0.4)), spread)
                    });
                    middle + Vector2::new(normal(rng), normal(rng)) * spread
                })
            }
        }
    }
}

/// A camera's sightings, with noise as their sigmas say, and the results from them.
struct Case {
    truth: Truth,
    /// Mean distance of the targets.
    range: f64,
    sightings: Vec<Sighting<f64>>,
    solution: Solution<f64>,
}

impl Case {
    fn random(seed: u64, counts: core::ops::Range<usize>, are_places_known: bool) -> Option<Self> {
        let mut rng = generator(seed);
        let layouts = [Layout::Circle, Layout::Cluster, Layout::Scattered];
        let layout = layouts[(seed % 5 / 2) as usize];
        let count = rng.random_range(counts);
        let truth = Truth::random(&mut rng);
        let targets = layout.targets(&truth, count, &mut rng);
        let sigma = 10_f64.powf(rng.random_range(-2.7..-1.7));
        let target_sigma = match are_places_known {
            true => 0.0,
            false => 10_f64.powf(rng.random_range(-2.5..-1.0)),
        };
        let sightings: Vec<_> = targets
            .iter()
            .map(|&target| {
                let off = Vector2::new(normal(&mut rng), normal(&mut rng)) * target_sigma;
                let bearing = truth.bearing_of(target) + sigma * normal(&mut rng);
                Sighting::new(target + off, Ray::from_bearing(bearing), sigma)
                    .with_target_sigma(target_sigma)
            })
            .collect();
        let ranges = targets.iter().map(|t| (t - truth.position()).norm());
        Some(Self {
            truth,
            range: ranges.sum::<f64>() / count as f64,
            solution: resection::solve(&sightings).ok()?,
            sightings,
        })
    }

    /// Returns true if a reader would believe the pose.
    fn looks_good(&self) -> bool {
        self.pose().sigma_position() < 0.1 * self.range && !self.solution.fit().is_bad()
    }

    fn pose(&self) -> &Pose<f64> {
        &self.solution.pose
    }

    fn is_wrong(&self) -> bool {
        let error = (self.pose().position - self.truth.position()).norm();
        error > 4.0 * self.pose().sigma_position()
    }

    fn alternative(&self) -> Option<Point2<f64>> {
        let sigma = self.pose().sigma_position();
        resection::alternative(&self.sightings, &[], self.pose(), sigma)
    }

    /// Returns true if single precision tells an alternative, or refuses the pose.
    fn is_told_in_single_precision(&self) -> bool {
        let single = |s: &Sighting<f64>| Sighting {
            target: s.target.cast::<f32>(),
            ray: Ray {
                forward: s.ray.forward as f32,
                left: s.ray.left as f32,
            },
            bearing_sigma: s.bearing_sigma as f32,
            target_covariance: s.target_covariance.cast(),
        };
        let sightings: Vec<_> = self.sightings.iter().map(single).collect();
        resection::solve(&sightings).map_or(true, |Solution { pose, .. }| {
            resection::alternative(&sightings, &[], &pose, pose.sigma_position()).is_some()
        })
    }

    /// Chi squared of a place with its best heading.
    fn chi_squared(&self, place: Point2<f64>) -> f64 {
        let seen: Vec<(f64, f64)> = self
            .sightings
            .iter()
            .map(|s| {
                let to = s.target - place;
                let across = Vector2::new(-to.y, to.x) / to.norm_squared();
                let by_place = (across.transpose() * s.target_covariance * across).x;
                let heading = to.y.atan2(to.x) - s.ray.bearing();
                (heading, 1.0 / (s.bearing_sigma.powi(2) + by_place))
            })
            .collect();
        let sum = |heading: f64| -> f64 {
            seen.iter()
                .map(|(h, w)| w * turn(*h, heading).powi(2))
                .sum()
        };
        // The mean of each sighting's own heading and its neighbours, whichever way round.
        let total: f64 = seen.iter().map(|(_, w)| w).sum();
        let around = |centre: f64| {
            let mean = seen.iter().map(|(h, w)| w * turn(*h, centre)).sum::<f64>() / total;
            sum(centre + mean)
        };
        seen.iter()
            .map(|(h, _)| around(*h))
            .fold(f64::INFINITY, f64::min)
    }

    /// Searches everywhere within thrice the range.
    fn is_there_another_place(&self) -> bool {
        let limit = self.chi_squared(self.pose().position) + 9.0;
        let mut radius = 5.0 * self.pose().sigma_position();
        while radius < 3.0 * self.range {
            for step in 0..90 {
                let (y, x) = f64::from(4 * step).to_radians().sin_cos();
                let place = self.pose().position + Vector2::new(x, y) * radius;
                if self.chi_squared(place) < limit {
                    return true;
                }
            }
            radius *= 1.2;
        }
        false
    }
}

fn cases(
    seeds: core::ops::Range<u64>,
    counts: core::ops::Range<usize>,
    are_places_known: bool,
) -> impl Iterator<Item = Case> {
    seeds.filter_map(move |seed| Case::random(seed, counts.clone(), are_places_known))
}

/// Near the danger circle and among clustered targets many poses claim a sigma below a tenth of the
/// range and are more than four sigmas off.
#[test]
fn a_wrong_pose_has_an_alternative_and_a_right_one_has_none() {
    for (counts, are_places_known) in [
        (3..4, true),
        (3..4, false),
        (4..5, true),
        (4..5, false),
        (5..9, true),
        (5..9, false),
    ] {
        let [mut right, mut wrong] = [[0_u32; 3]; 2];
        for case in cases(0..8000, counts.clone(), are_places_known).filter(Case::looks_good) {
            let told = [
                case.alternative().is_some(),
                case.is_told_in_single_precision(),
            ];
            let count = if case.is_wrong() {
                &mut wrong
            } else {
                &mut right
            };
            count[0] += 1;
            for (count, told) in count[1..].iter_mut().zip(told) {
                *count += u32::from(told);
            }
        }
        let scene = format!("{counts:?} sightings, places known: {are_places_known}");
        let [all, told @ ..] = wrong;
        assert!(all > 30, "{scene}: only {all} wrong poses");
        assert!(
            told.iter()
                .all(|&told| f64::from(told) >= 0.95 * f64::from(all)),
            "{scene}: told {told:?} of {all}"
        );
        let [all, told @ ..] = right;
        assert!(all > 1000, "{scene}: only {all} right poses");
        assert!(
            told.iter()
                .all(|&told| f64::from(told) <= 0.005 * f64::from(all)),
            "{scene}: told {told:?} of {all}"
        );
    }
}

/// An independent evaluation of the cost confirms each, and a search of the whole plane finds hardly
/// any that was missed.
#[test]
fn an_alternative_is_what_a_search_finds() {
    let [mut found, mut missed] = [0, 0];
    for case in cases(0..1500, 3..7, true).filter(Case::looks_good) {
        if let Some(place) = case.alternative() {
            if case.sightings.iter().any(|s| s.target == place) {
                continue;
            }
            let off = (place - case.pose().position).norm() / case.pose().sigma_position();
            assert!((off - 5.0).abs() < 1e-9, "{off} sigmas");
            let rise = case.chi_squared(place) - case.chi_squared(case.pose().position);
            assert!(rise < 9.0 + 1e-6, "rise {rise}");
            found += 1;
        } else {
            missed += u32::from(case.is_there_another_place());
        }
    }
    assert!(
        found > 25 && missed * 20 <= found,
        "found {found}, missed {missed}"
    );
}

/// Nearer to a target than its own sigma, a pose's linear prediction is void.
#[test]
fn a_pose_within_its_sigma_of_a_target_has_an_alternative() {
    let [mut near, mut missed] = [0, 0];
    for case in cases(0..20_000, 3..6, true) {
        let pose = case.pose();
        let is_near = |s: &Sighting<f64>| (s.target - pose.position).norm() < pose.sigma_position();
        if case.sightings.iter().any(is_near) && pose.sigma_position() < case.range {
            near += 1;
            missed += u32::from(case.alternative().is_none());
        }
    }
    assert!(near > 100);
    assert_eq!(missed, 0, "of {near}");
}
