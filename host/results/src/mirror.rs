//! Cameras that hang upside down, and pictures that are mirrored.

use calib_core::{Ray, Sighting, resection};

/// A camera's bearings once left and right are exchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mirror {
    /// They fit worse, or are too few to tell: three fit some pose in any case, and four often do.
    Worse,
    /// They fit as well as they should, but no better than as they are.
    AsGood,
    /// They fit better than as they are.
    Better,
}

impl Mirror {
    pub(crate) fn of(sightings: &[Sighting<f64>]) -> Self {
        let mirrored: Vec<_> = { sightings.iter() }
            .map(|seen| Sighting {
                ray: Ray {
                    left: -seen.ray.left,
                    ..seen.ray
                },
                ..*seen
            })
            .collect();
        let Some(found) =
            { (mirrored.len() > 4).then(|| resection::solve(&mirrored).ok()) }.flatten()
        else {
            return Self::Worse;
        };
        let straight = resection::solve(sightings);
        match straight.map_or(f64::INFINITY, |straight| straight.chi_squared) {
            _ if found.fit().is_bad() => Self::Worse,
            straight if straight > found.chi_squared => Self::Better,
            _ => Self::AsGood,
        }
    }
}
