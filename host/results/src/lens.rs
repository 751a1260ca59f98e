//! Do all sightings of a recording fit the lens that they were decoded with?

use calib_core::{
    Ray, Sighting,
    camera::{Camera, Projection},
    fit::one_in_a_thousand,
    resection,
};

use crate::recorded::sightings::Recording;

/// Estimate of the lens from the sightings of all cases together, as if one camera had made all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensReport {
    /// The projection that fits best.
    pub projection: Projection,
    /// The field of view that goes with it, radians, from the centre of the first column to that of
    /// the last one.
    pub field_of_view: f64,
    /// Standard deviation of `field_of_view`.
    pub field_of_view_sigma: f64,
    /// Sum of all cases' chi squared with this lens.
    pub chi_squared: f64,
    /// The same with the lens as given.
    pub chi_squared_as_given: f64,
    /// Cases of four sightings or more, which tell.
    pub cases: usize,
}

/// Explanation of sightings that do not fit together: the one that fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Misfit {
    /// Another lens.
    Lens(LensReport),
    /// Left and right are exchanged: a plan whose y axis runs downwards, or cameras that hang upside down.
    Mirrored {
        /// Sum of all cases' chi squared with the bearings negated.
        chi_squared: f64,
        /// The same with the bearings as given.
        chi_squared_as_given: f64,
        /// Cases of four sightings or more, which tell.
        cases: usize,
    },
}

/// One lens for all cases.
struct Pooled {
    stretch: f64,
    sigma: f64,
    chi_squared: f64,
}

/// Unknowns of a pose.
const POSE: usize = 3;

/// Rounds of "stretch all rays, solve all cases again", at most.
const ROUNDS: usize = 30;
/// A stretch that changes by no more than this is found.
const FOUND: f64 = 1e-7;
/// Least and largest stretch.
const STRETCHES: [f64; 2] = [-0.8, 5.0];
/// Stretches from which that of a lens is sought that is not as told.
const STARTS: [f64; 7] = [0.0, -0.3, 0.4, -0.55, 1.0, 2.0, 3.5];
/// Prior of a lens that is not as told: of its focal length nothing is known.
const ANY: f64 = 10.0;
/// Cases with which all starts are tried.
const TRIED: usize = 200;

/// The lens that fits best, if the given one does not, or that all is mirrored. With the other one chi squared is less by more than
/// chance takes off in one of a thousand recordings. `None` also where too little is recorded to
/// tell. `prior_sigma` is that of the focal length, relative.
pub fn check(
    recording: &Recording,
    camera: &Camera<f64>,
    field_of_view: f64,
    prior_sigma: f64,
) -> Option<Misfit> {
    let cases: Vec<&[Sighting<f64>]> = recording
        .cases()
        .filter(|(_, case)| case.unreadable == 0 && case.sightings.len() >= 4)
        .map(|(_, case)| &case.sightings[..])
        .filter(|sightings| {
            STARTS.iter().any(|start| {
                let stretched = |ray: Ray<f64>| ray.stretched(camera.projection(), 1.0 + start);
                resection::solve(&changed(sightings, stretched)).is_ok()
            })
        })
        .collect();
    if cases.is_empty() {
        return None;
    }
    let as_given = total(&cases, |ray| ray);
    let redundant = cases.iter().map(|case| case.len() - POSE).sum();
    let most = one_in_a_thousand::<f64>(redundant);
    let mirrored = total(&cases, |ray| Ray {
        left: -ray.left,
        ..ray
    });
    if as_given > most && mirrored <= most {
        return Some(Misfit::Mirrored {
            chi_squared: mirrored,
            chi_squared_as_given: as_given,
            cases: cases.len(),
        });
    }
    let half_view = field_of_view / 2.0;
    let given = camera.projection();
    let decoded = |projection| move |ray: Ray<f64>| ray.decoded(given, projection, half_view);
    let projections = [Projection::PinHole, Projection::EqualAngle];
    let near = projections.map(|projection| {
        let lens = (projection, prior_sigma);
        pooled(&cases, decoded(projection), lens, 0.0).chi_squared
    });
    // A right lens is as good as the best one near it but for chance.
    let is_better = |chi_squared: f64| as_given - chi_squared > one_in_a_thousand::<f64>(1);
    if !(as_given > most || near.into_iter().any(is_better)) {
        return None;
    }
    // It is another one, so that what was told of it tells nothing.
    let few = cases.get(..TRIED).unwrap_or(&cases);
    let candidates = projections.map(|projection| {
        let (lens, decoded) = ((projection, ANY), decoded(projection));
        let starts = STARTS.map(|start| pooled(few, decoded, lens, start));
        let best = { starts.iter() }.min_by(|a, b| a.chi_squared.total_cmp(&b.chi_squared));
        let start = best.map_or(0.0, |best| best.stretch);
        (projection, pooled(&cases, decoded, lens, start))
    });
    // Another projection has to be better than the same with another focal length.
    let cost = |(projection, pooled): &(Projection, Pooled)| {
        let other = if *projection == given {
            0.0
        } else {
            one_in_a_thousand(1)
        };
        pooled.chi_squared + other
    };
    let [a, b] = candidates;
    let (projection, best) = if cost(&a) <= cost(&b) { a } else { b };
    if !is_better(best.chi_squared) {
        return None;
    }
    // A lens that does not fit either explains nothing.
    if as_given > most && best.chi_squared > most {
        return None;
    }
    let factor = 1.0 + best.stretch;
    let (field_of_view, slope) = match projection {
        Projection::PinHole => {
            let tangent = half_view.tan();
            let slope = 2.0 * tangent / (1.0 + (factor * tangent).powi(2));
            (2.0 * (factor * tangent).atan(), slope)
        }
        Projection::EqualAngle => (field_of_view * factor, field_of_view),
    };
    Some(Misfit::Lens(LensReport {
        projection,
        field_of_view,
        field_of_view_sigma: slope * best.sigma,
        chi_squared: best.chi_squared,
        chi_squared_as_given: as_given,
        cases: cases.len(),
    }))
}

fn changed(sightings: &[Sighting<f64>], ray: impl Fn(Ray<f64>) -> Ray<f64>) -> Vec<Sighting<f64>> {
    let changed = sightings.iter().map(|s| Sighting {
        ray: ray(s.ray),
        ..*s
    });
    changed.collect()
}

/// A case that no pose fits is as bad as one that is a hundred sigmas off.
const HOPELESS: f64 = 1e4;

fn total(cases: &[&[Sighting<f64>]], ray: impl Fn(Ray<f64>) -> Ray<f64>) -> f64 {
    let solved = cases
        .iter()
        .map(|case| resection::solve(&changed(case, &ray)));
    solved.map(|s| s.map_or(HOPELESS, |s| s.chi_squared)).sum()
}

fn pooled(
    cases: &[&[Sighting<f64>]],
    decoded: impl Fn(Ray<f64>) -> Ray<f64>,
    (projection, prior_sigma): (Projection, f64),
    start: f64,
) -> Pooled {
    let prior = prior_sigma.powi(-2);
    let (mut stretch, mut sigma) = (start, prior_sigma);
    for _ in 0..ROUNDS {
        let (mut information, mut pull) = (prior, -stretch * prior);
        for case in cases {
            let sightings = changed(case, |ray| {
                decoded(ray).stretched(projection, 1.0 + stretch)
            });
            let fit = resection::solve(&sightings).ok().and_then(|solution| {
                let pose = &solution.pose;
                resection::lens_fit(&sightings, &[], projection, pose, prior_sigma)
            });
            if let Some(fit) = fit {
                // Each was computed with a prior of its own.
                let of_case = fit.sigma.powi(-2);
                information += of_case - prior;
                pull += fit.stretch * of_case;
            }
        }
        let [least, most] = STRETCHES;
        let before = stretch;
        // The rays have the stretch so far already.
        let factor = (1.0 + stretch) * (1.0 + pull / information);
        stretch = (factor - 1.0).clamp(least, most);
        sigma = (1.0 + stretch) * information.powf(-0.5);
        if (stretch - before).abs() < FOUND {
            break;
        }
    }
    Pooled {
        stretch,
        sigma,
        chi_squared: total(cases, |ray| {
            decoded(ray).stretched(projection, 1.0 + stretch)
        }),
    }
}
