//! Drawings: well-formed, complete, and possible for odd runs too.

use answers::plot;
use answers::record::{RunRecord, summary::Summary, sweep::Sweep};
use roxmltree::Document;

use crate::{
    common::{Files, run},
    sample::Sample,
};

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
    assert!(texts.contains(&"1 without pose (cross)".to_owned()));
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

/// The stop of a row of the table is drawn over its number.
#[test]
fn stops_of_a_sweep_are_over_their_numbers() {
    let mut sweep = Sweep::default();
    for seed in 0..4 {
        let mut record = Sample {
            seed,
            ..Sample::default()
        }
        .run();
        for stop in &mut record.targets[0].stops {
            stop.stop += 1;
        }
        sweep.add(&record).unwrap();
    }
    let svg = plot::sweep(&sweep.finish().unwrap()).unwrap();
    let document = Document::parse(&svg).unwrap();
    let number = |node: roxmltree::Node<'_, '_>, name: &str| -> f64 {
        node.attribute(name).unwrap().parse().unwrap()
    };
    let boxes: Vec<_> = document
        .descendants()
        .filter(|n| n.has_tag_name("rect") && n.attribute("fill") == Some("#1F62B2"))
        .collect();
    // The last panel's, after two of 13 cameras each; references have no box of position.
    let stops = &boxes[boxes.len() - 39..];
    let lowest = number(stops[0], "y");
    let label = |text: &str| {
        let labels = document.descendants().filter(|n| n.has_tag_name("text"));
        let labels = labels.filter(|n| n.text().map(str::trim) == Some(text));
        let mut below = labels.filter(|n| number(*n, "y") > lowest);
        number(below.next_back().unwrap(), "x")
    };
    let middle = |stop: usize| {
        let drawn = stops[stop - 1];
        number(drawn, "x") + number(drawn, "width") / 2.0
    };
    let pitch = (middle(39) - middle(1)) / 38.0;
    for stop in [10, 20, 30] {
        let off = (middle(stop) - label(&stop.to_string())) / pitch;
        assert!(off.abs() < 0.2, "stop {stop} is off by {off}");
    }
}

/// How far coordinates of evenly drawn corners are at most off those of an ellipse: a constant, a
/// cosine and a sine.
fn off_ellipse(coordinates: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = coordinates.clone().count() as f64;
    let turns = (0..).map(|k| (f64::from(k) * std::f64::consts::TAU / n).sin_cos());
    let values = coordinates.zip(turns);
    let (mut mean, mut sine, mut cosine) = (0.0, 0.0, 0.0);
    for (value, (sin, cos)) in values.clone() {
        mean += value / n;
        sine += 2.0 * value * sin / n;
        cosine += 2.0 * value * cos / n;
    }
    values
        .map(|(value, (sin, cos))| (value - mean - sine * sin - cosine * cos).abs())
        .fold(0.0, f64::max)
}

/// Corners of whole pixels make small ellipses lumpy.
#[test]
fn ellipses_are_round() {
    let record = Sample::default().run();
    let svg = plot::map(&record).unwrap();
    let document = Document::parse(&svg).unwrap();
    let root = document.root_element();
    let box_width = root
        .attribute("viewBox")
        .unwrap()
        .split(' ')
        .nth(2)
        .unwrap();
    let [box_width, width] = [box_width, root.attribute("width").unwrap()];
    let grid = box_width.parse::<f64>().unwrap() / width.parse::<f64>().unwrap();
    let mut small = 0;
    for polygon in document.descendants().filter(|n| n.has_tag_name("polygon")) {
        let points: Vec<(f64, f64)> = polygon
            .attribute("points")
            .unwrap()
            .split_whitespace()
            .map(|pair| pair.split_once(',').unwrap())
            .map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap()))
            .collect();
        if points.len() != 48 {
            continue;
        }
        small += 1;
        let corners: Vec<_> = points.iter().map(|&(x, y)| [x, y]).collect();
        for axis in 0..2 {
            let off = off_ellipse(corners.iter().map(|corner| corner[axis])) / grid;
            assert!(off < 0.15, "{off} pixels: {corners:?}");
        }
    }
    assert!(small >= 11);
    // Its size is what it was.
    let size = ["width", "height"].map(|name| root.attribute(name).unwrap());
    let size = size.map(|text| text.parse::<f64>().unwrap());
    assert!((400.0..1200.0).contains(&size[0]) && (300.0..1000.0).contains(&size[1]));
}

/// Records come from anywhere.
#[test]
fn control_characters_of_a_record_stay_out_of_drawings_and_off_the_screen() {
    let mut record = Sample::default().run();
    record.scenario = "a\u{1b}[31m\u{0}b\u{fffe}".to_owned();
    record.unit.name = "m\u{8}".to_owned();
    for draw in ALL {
        let svg = draw(&record).unwrap();
        let document = Document::parse(&svg).unwrap();
        assert!(
            document
                .descendants()
                .any(|n| n.text().is_some_and(|t| t.contains("[31mb")))
        );
    }
    let mut sweep = Sweep::default();
    sweep.add(&record).unwrap();
    let svg = plot::sweep(&sweep.finish().unwrap()).unwrap();
    assert!(Document::parse(&svg).is_ok());
    let files = Files::new();
    let file = files.write("run.json", &record.to_json(false).unwrap());
    for what in ["run", "runs", "sweep"] {
        let done = run(&["report", what, &file]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        assert!(done.stdout.contains("[31m"), "{}", done.stdout);
        assert!(!done.stdout.contains(|c: char| c.is_control() && c != '\n'));
    }
}
