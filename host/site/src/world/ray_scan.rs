//! A planar scan with one ray for each column.
//!
//! It works like the blob finder of Stage 4.3: rays go in the directions of the columns' middles, a ball is
//! seen where it is the first that a ray hits within the range, and a blob is a run of columns that hit the
//! same ball. There is no noise; things between two rays are not seen.

use nalgebra::Vector2;

use super::{
    Camera, View, World,
    obstacle::hit_disc,
    sight::{Patch, Sight, wrapped},
};
use cmucam2_emulator::{Extent, Shape};

/// The targets `near` as a scan has them.
pub(super) fn look(world: &World, camera: &Camera, near: &[usize]) -> View {
    let columns = camera.lens.columns() as usize;
    // For each column, the distance of the first thing that its ray hits, and the target if it is one.
    let mut hits: Vec<Option<(f64, usize)>> = vec![None; columns];
    for &index in near {
        let target = &world.targets[index];
        let to = target.place - camera.place;
        let bearing = wrapped(to.y.atan2(to.x) - camera.heading);
        let half = super::half_width(to.norm(), target.radius);
        let border = camera.lens.half_view();
        let [left, right] = [bearing + half, bearing - half].map(|edge| {
            let column = camera.lens.column(edge.clamp(-border, border));
            column.clamp(0.0, columns as f64 - 1.0)
        });
        let first = left as usize;
        for (column, nearest) in (first..).zip(&mut hits[first..=right.ceil() as usize]) {
            let ray = ray(camera, column);
            let hit = hit_disc(camera.place, ray, target.place, target.radius);
            let nearer = |distance: f64| {
                distance <= camera.range && nearest.is_none_or(|(other, _)| distance < other)
            };
            if let Some(distance) = hit.filter(|&distance| nearer(distance)) {
                *nearest = Some((distance, index));
            }
        }
    }
    for (column, hit) in hits.iter_mut().enumerate() {
        let Some((distance, _)) = *hit else {
            continue;
        };
        let ray = ray(camera, column);
        let end = camera.place + ray * distance;
        let hidden = world
            .obstacles_near(camera.place, end, 0.0)
            .into_iter()
            // Its cameras look along the plane of the balls.
            .filter(|&index| world.obstacles[index].top > 0.0)
            .filter_map(|index| world.obstacles[index].shape.hit(camera.place, ray))
            .any(|obstacle| obstacle < distance);
        if hidden {
            *hit = None;
        }
    }

    let mut view = View::default();
    let mut column = 0;
    for run in hits.chunk_by(|a, b| a.map(|(_, target)| target) == b.map(|(_, target)| target)) {
        let [first, last] = [column, column + run.len() - 1];
        column += run.len();
        if let Some((_, index)) = run[0] {
            blob(&mut view, world, camera, index, [first, last]);
        }
    }
    view.sights
        .sort_by(|(_, a), (_, b)| b.distance.total_cmp(&a.distance));
    view
}

/// One run of columns.
fn blob(view: &mut View, world: &World, camera: &Camera, index: usize, run: [usize; 2]) {
    let (lens, target) = (&camera.lens, &world.targets[index]);
    let columns = run.map(|column| column as f64);
    let to = target.place - camera.place;
    let half_width = super::half_width(to.norm(), target.radius);
    let across = Extent::of_pixels(columns, [0.0, 0.0], lens.columns(), 1.0);
    view.patches.push(Patch {
        target: Some(index),
        colour: Some(target.colour),
        shape: Shape::Box,
        extent: Extent {
            top: lens.down(half_width.min(1.0)),
            bottom: lens.down(-half_width.min(1.0)),
            ..across
        },
    });
    // A column stands for half a column to both sides.
    let visible = [
        lens.bearing(columns[1] + 0.5),
        lens.bearing(columns[0] - 0.5),
    ];
    match view.sights.iter_mut().find(|(other, _)| *other == index) {
        Some((_, sight)) => sight.visible.insert(0, visible),
        None => view.sights.push((
            index,
            Sight {
                distance: to.norm(),
                bearing: wrapped(to.y.atan2(to.x) - camera.heading),
                half_width,
                is_high_enough: true,
                visible: vec![visible],
            },
        )),
    }
}

fn ray(camera: &Camera, column: usize) -> Vector2<f64> {
    let (sin, cos) = (camera.heading + camera.lens.bearing(column as f64)).sin_cos();
    Vector2::new(cos, sin)
}
