//! Drawings: well-formed, complete, and possible for odd runs too.

use calib_core::Status;
use results::plot;
use results::record::{RunRecord, summary::Summary, sweep::Sweep};
use roxmltree::Document;

use super::sample::Sample;
use crate::common::{Files, run};

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
const NO_POSE: &str = "#480503";

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
    assert!(texts.contains(&"12 calibrated".to_owned()));
    assert!(texts.contains(&"1 waiting".to_owned()));
    // Every stop has its number beside it.
    for stop in &record.targets[0].stops {
        assert!(texts.contains(&stop.stop.to_string()));
    }
    // A dot and a ring each, and one in the legend.
    assert_eq!(circles(&svg, TARGET), 2 * record.targets[0].stops.len() + 1);
    // The blind camera and the legend.
    assert_eq!(circles(&svg, NO_POSE), 2);
}

/// Errors of hundredths of a unit cannot be seen on a map of 30 units.
#[test]
fn small_errors_are_magnified_and_large_ones_are_not() {
    let scale = |record: &RunRecord| {
        let texts = texts(&plot::map(record).unwrap());
        texts
            .into_iter()
            .find(|text| text.starts_with("errors and ellipses drawn"))
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
        circles(&svg, "#0068A8") + circles(&svg, BAD),
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
        .filter(|n| n.has_tag_name("rect") && n.attribute("fill") == Some("#0068A8"))
        .collect();
    // The boxes of the last panel, after two of 13 cameras each; references have no box of position.
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

/// Places and sizes of a run's drawn estimates, by the names of the attributes.
fn ellipses(svg: &str) -> Vec<[f64; 4]> {
    let document = Document::parse(svg).unwrap();
    let ellipses = document.descendants().filter(|n| n.has_tag_name("ellipse"));
    let number = |n: &roxmltree::Node<'_, '_>, name: &str| n.attribute(name)?.parse().ok();
    ellipses
        .map(|n| ["cx", "cy", "rx", "ry"].map(|name| number(&n, name).unwrap()))
        .collect()
}

#[test]
fn ellipses_are_as_large_as_the_map_says() {
    let record = Sample::default().run();
    let svg = plot::map(&record).unwrap();
    let document = Document::parse(&svg).unwrap();
    let size = ["width", "height"].map(|name| document.root_element().attribute(name).unwrap());
    let size = size.map(|text| text.parse::<f64>().unwrap());
    assert!((400.0..1200.0).contains(&size[0]) && (300.0..1000.0).contains(&size[1]));
    let times = texts(&svg).into_iter().find_map(|text| {
        let times = text.strip_prefix("errors and ellipses drawn ")?;
        times.strip_suffix(" x")?.parse::<f64>().ok()
    });
    let drawn = ellipses(&svg);
    let cameras: Vec<_> = record.cameras().filter(|c| c.estimate.is_some()).collect();
    assert_eq!(drawn.len(), cameras.len());
    // The scale of the map: two cameras, and the distance at which they are drawn.
    let place = |camera: usize| {
        let (truth, error) = (
            cameras[camera].truth.unwrap(),
            cameras[camera].error.unwrap(),
        );
        let times = times.unwrap();
        [truth.x + times * error.x, truth.y + times * error.y]
    };
    let far = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let on_paper = |camera: usize| [drawn[camera][0], drawn[camera][1]];
    let scale = far(on_paper(2), on_paper(9)) / far(place(2), place(9));
    for (camera, [.., long, short]) in cameras.iter().zip(&drawn) {
        let ellipse = camera.estimate.unwrap().pose().ellipse(0.95);
        for (drawn, axis) in [(long, ellipse.semi_major), (short, ellipse.semi_minor)] {
            let expected = axis * times.unwrap() * scale;
            assert!((drawn - expected).abs() < 0.02 + 0.001 * expected);
        }
    }
}

/// Colour and shape show how good a camera's estimate is.
#[test]
fn the_map_tells_what_estimates_are_worth() {
    let mut record = Sample::default().run();
    let cameras: Vec<_> = (0..record.nodes.len())
        .filter(|&node| record.nodes[node].is_camera())
        .collect();
    for (camera, status) in [(3, Status::Refused), (4, Status::Waiting)] {
        let node = &mut record.nodes[cameras[camera]];
        (node.estimate, node.error, node.nees) = (None, None, None);
        node.status = Some(status);
    }
    for (camera, status) in [(6, Status::Weak), (7, Status::Doubtful)] {
        record.nodes[cameras[camera]].status = Some(status);
    }
    let svg = plot::map(&record).unwrap();
    let texts = texts(&svg);
    for text in [
        "9 calibrated",
        "1 weak",
        "1 doubtful",
        "1 refused",
        "1 waiting",
    ] {
        assert!(texts.contains(&text.to_owned()), "{text}: {texts:?}");
    }
    let document = Document::parse(&svg).unwrap();
    let marks = |tag: &str, colour: &str| {
        let nodes = document.descendants().filter(|n| n.has_tag_name(tag));
        nodes
            .filter(|n| {
                n.attribute("fill") == Some(colour) || n.attribute("stroke") == Some(colour)
            })
            .count()
    };
    // An arrow head and a mark each, and the legend's.
    assert_eq!(
        [marks("polygon", "#897004"), marks("polygon", "#B84E63")],
        [3, 3]
    );
    assert_eq!(
        [marks("polyline", NO_POSE), marks("circle", NO_POSE)],
        [2, 2]
    );
}

/// A wall in front of a camera ends its field of view.
#[test]
fn fields_of_view_end_at_walls() {
    let mut record = Sample::default().run();
    record.obstacles.clear();
    let outlines = |record: &RunRecord| {
        let svg = plot::map(record).unwrap();
        let document = Document::parse(&svg).unwrap();
        let outlines = document.descendants().filter(|n| n.has_tag_name("polygon"));
        let views = outlines.filter(|n| n.attribute("fill-opacity") == Some("0.05"));
        let corners = views.map(|n| n.attribute("points").unwrap().to_owned());
        corners.collect::<Vec<_>>()
    };
    let free = outlines(&record);
    let camera = record.cameras().nth(5).unwrap();
    let (truth, range) = (camera.truth.unwrap(), camera.view.unwrap().range);
    let (sin, cos) = truth.heading_deg.to_radians().sin_cos();
    let at = |ahead: f64, left: f64| {
        [
            truth.x + ahead * cos - left * sin,
            truth.y + ahead * sin + left * cos,
        ]
    };
    let near = 0.05 * range;
    record.obstacles.push(vec![at(near, -near), at(near, near)]);
    let walled = outlines(&record);
    assert_eq!((free.len(), walled.len()), (13, 13));
    let reach = |outline: &str| {
        let corners: Vec<[f64; 2]> = outline
            .split(' ')
            .map(|pair| pair.split_once(',').unwrap())
            .map(|(x, y)| [x.parse().unwrap(), y.parse().unwrap()])
            .collect();
        let far = |c: &[f64; 2]| (c[0] - corners[0][0]).hypot(c[1] - corners[0][1]);
        corners.iter().map(far).fold(0.0, f64::max)
    };
    assert!(reach(&walled[5]) < 0.1 * reach(&free[5]));
}

/// Names of a thousand cameras in one place would hide it: only those are written for which there is room.
#[test]
fn a_thousand_cameras_make_a_larger_map_and_are_not_all_named() {
    let mut record = Sample::default().run();
    let camera = record.nodes[5].clone();
    record.nodes.extend((100..1100).map(|id| {
        let mut camera = camera.clone();
        camera.id = id;
        camera
    }));
    let svg = plot::map(&record).unwrap();
    let document = Document::parse(&svg).unwrap();
    let width = document.root_element().attribute("width").unwrap();
    assert!(width.parse::<f64>().unwrap() > 1500.0);
    let texts = texts(&svg);
    let named = (100..1100).filter(|id: &u16| texts.contains(&id.to_string()));
    assert!((1..100).contains(&named.count()));
    assert!(texts.contains(&"1*".to_owned()) && texts.contains(&"13".to_owned()));
}

/// Records may come from anywhere.
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
