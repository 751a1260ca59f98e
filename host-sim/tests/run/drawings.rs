//! Drawings: well-formed, complete, and possible for odd runs too.

use host_sim::{
    plot,
    record::{RunRecord, summary::Summary, sweep::Sweep},
};
use roxmltree::Document;

use crate::sample::Sample;

type Draw = fn(&RunRecord) -> Result<String, plot::PlotError>;
const ALL: [Draw; 3] = [plot::map, plot::errors, plot::residuals];

fn texts(svg: &str) -> Vec<String> {
    let document = Document::parse(svg).unwrap();
    let texts = document.descendants().filter(|n| n.has_tag_name("text"));
    texts
        .map(|n| n.text().unwrap_or_default().trim().to_owned())
        .collect()
}

fn circles(svg: &str, colour: &str) -> usize {
    let document = Document::parse(svg).unwrap();
    let circles = document.descendants().filter(|n| n.has_tag_name("circle"));
    circles
        .filter(|n| [n.attribute("fill"), n.attribute("stroke")].contains(&Some(colour)))
        .count()
}

const TARGET: &str = "#E66E14";
const BAD: &str = "#C81E32";

#[test]
fn the_map_names_every_camera_and_shows_every_stop() {
    let record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    let svg = plot::map(&record).unwrap();
    let texts = texts(&svg);
    for id in 3..=13 {
        assert!(texts.contains(&id.to_string()));
    }
    assert!(texts.contains(&"1*".to_owned()) && texts.contains(&record.title()));
    assert!(texts.contains(&"1 not calibrated".to_owned()));
    // A dot and a ring each, and one in the legend.
    assert_eq!(circles(&svg, TARGET), 2 * record.targets[0].stops.len() + 1);
    // The blind camera and the legend.
    assert_eq!(circles(&svg, BAD), 2);
}

/// Errors of hundredths of a unit cannot be seen on a map of 30 units.
#[test]
fn small_errors_are_magnified_and_large_ones_are_not() {
    let scale = |record: &RunRecord| {
        let texts = texts(&plot::map(record).unwrap());
        texts
            .into_iter()
            .find(|text| text.starts_with("errors drawn"))
    };
    let record = Sample::default().run();
    assert!(scale(&record).is_some());
    let mut far = record.clone();
    far.nodes[5].estimate.as_mut().unwrap().x += 4.0;
    far.nodes[5].error.as_mut().unwrap().x += 4.0;
    assert_eq!(scale(&far), None);
}

#[test]
fn every_sighting_is_in_both_panels_of_the_residuals() {
    let record = Sample::default().run();
    let sightings: usize = record.cameras().map(|c| c.sightings).sum();
    let svg = plot::residuals(&record).unwrap();
    assert_eq!(
        circles(&svg, "#1F62B2") + circles(&svg, BAD),
        2 * sightings + 2
    );
}

#[test]
fn odd_runs_can_be_drawn() {
    let plain = Sample::default();
    let mut empty = plain.run();
    empty.nodes.clear();
    empty.targets.clear();
    empty.obstacles.clear();
    let mut odd = plain.run();
    odd.scenario = "a <b> & \"c\"".to_owned();
    odd.unit.name = "<&>".to_owned();
    let mut unknown = plain.run();
    for node in &mut unknown.nodes {
        (node.truth, node.error, node.nees) = (None, None, None);
    }
    let mut nobody = plain.run();
    for node in &mut nobody.nodes {
        (node.estimate, node.error) = (None, None);
        node.residuals.clear();
    }
    let mut many = plain.run();
    let camera = many.nodes[5].clone();
    many.nodes.extend((100..1100).map(|id| {
        let mut camera = camera.clone();
        camera.id = id;
        camera
    }));
    for mut record in [empty, odd, unknown, nobody, many] {
        record.summary = Summary::of(&record.nodes);
        for draw in ALL {
            let svg = draw(&record).unwrap();
            assert!(Document::parse(&svg).is_ok() && !svg.contains("NaN"));
        }
    }
}

#[test]
fn a_sweep_is_drawn_with_every_camera() {
    let mut sweep = Sweep::default();
    for seed in 0..4 {
        let sample = Sample {
            seed,
            blind: &[6],
            ..Sample::default()
        };
        sweep.add(&sample.run()).unwrap();
    }
    let svg = plot::sweep(&sweep.finish().unwrap()).unwrap();
    let texts = texts(&svg);
    // In both panels of cameras.
    assert_eq!(texts.iter().filter(|t| *t == "13").count(), 2);
    assert!(texts.contains(&"Errors over 4 runs: thesis-13".to_owned()));
}
