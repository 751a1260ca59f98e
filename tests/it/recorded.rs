//! Recordings in, poses out: the work of `host-sim solve` and `host-sim solve-network` on a file, by
//! the library.

use std::{fs::File, io::BufReader};

use calib_core::{Status, camera::Camera};
use host_sim::network::{Options, Simulation};
use nalgebra::{Matrix2, Point2, Vector2};
use results::accuracy::Comparisons;
use results::answer::{Settings, Solver};
use results::network::{self, NetworkSolution};
use results::record::{RunRecord, sightings::Sightings};
use results::recorded::{self, sightings::Assumptions};
use site::{Overrides, ScatterTable, Scenario, SensorTable};
use test_support::{
    Truth,
    batch::Batch,
    chi_squared_band, data, generator, normal, turn,
    walk::{CarrierErrors, SeenAt, Walk, WalkedLeg},
};

fn open(name: &str) -> BufReader<File> {
    BufReader::new(File::open(data(name)).unwrap())
}

/// Eleven cameras of Table 4.1 from Stage's blobs, decoded with their own camera model and with that of
/// the thesis: the camera model alone makes the thesis's errors.
#[test]
fn the_camera_model_makes_the_difference() {
    let view = 60_f64.to_radians();
    let accuracy = |camera: Camera<f64>| {
        let assumptions = Assumptions {
            camera: Some(camera),
            ..Assumptions::default()
        };
        let recording = recorded::sightings::read(
            open("stage13/seed1_sightings.csv"),
            &assumptions,
            |complaint| panic!("{complaint}"),
        )
        .unwrap();
        let truths = recorded::truth::read(
            open("thesis/table_4_1_truth.csv"),
            &recording,
            |complaint| panic!("{complaint}"),
        )
        .unwrap();
        let mut solver = Solver::new(Settings::default());
        let (mut comparisons, mut chi_squared, mut freedom) = (Comparisons::default(), 0.0, 0);
        for ((id, case), truth) in recording.cases().zip(&truths) {
            let answer = solver.answer(id, case);
            // With the wrong model it is doubtful.
            assert!(answer.is_kept(), "node {id}");
            let solution = answer.solution.unwrap();
            comparisons.add(&solution.pose, truth.as_ref());
            chi_squared += solution.chi_squared;
            freedom += solution.degrees_of_freedom();
        }
        let accuracy = comparisons.finish().unwrap();
        assert_eq!(accuracy.compared, 11);
        (accuracy, chi_squared / freedom as f64)
    };
    let (equal_angle, fit) = accuracy(Camera::equal_angle(88, view).unwrap());
    assert!(equal_angle.position.median < 0.08, "{equal_angle:?}");
    assert!(equal_angle.heading_degrees.median < 1.0, "{equal_angle:?}");
    assert!(equal_angle.position.rms < 0.1, "{equal_angle:?}");
    // Whole-pixel sigmas explain the residuals of the right model, and not those of the wrong one.
    let (pin_hole, misfit) = accuracy(Camera::pin_hole(88, view).unwrap());
    assert!(
        pin_hole.position.median > 2.0 * equal_angle.position.median,
        "{pin_hole:?}"
    );
    assert!(fit < 3.0 && misfit > 2.0 * fit, "{fit} {misfit}");
}

/// Sigmas of scale and compass, degrees, of a carrier of whom little is known.
const UNKNOWN: [f64; 2] = [0.05, 2.0];

/// A run of thesis-13 whose carrier is drawn from what its nodes are told of him, as its record
/// stands in a file.
fn rehearsal(seed: u64) -> RunRecord {
    let changes = Overrides {
        seed: Some(seed),
        path: Some(1 + seed % 3),
        stops: Some(4),
        scatter: Some(ScatterTable::USUAL),
        ..Overrides::default()
    };
    let mut scenario = Scenario::load("thesis-13", &changes).unwrap();
    let mut random = generator(1000 + seed);
    scenario.sensor = Some(SensorTable {
        scale_bias: UNKNOWN[0] * normal(&mut random),
        heading_bias_deg: UNKNOWN[1] * normal(&mut random),
        ..SensorTable::DRIFT
    });
    scenario.firmware.systematic_scale = Some(UNKNOWN[0]);
    scenario.firmware.systematic_heading_deg = Some(UNKNOWN[1]);
    scenario.firmware.standing_sigma = Some(0.0);
    let record = Simulation::new(scenario, Options::default())
        .unwrap()
        .run(|_| ());
    RunRecord::from_json(&record.to_json(false).unwrap()).unwrap()
}

/// The measurements of a record for the batch, with the truth to begin from. The references come
/// first, then all others by number.
fn walk(record: &RunRecord, sightings: &Sightings) -> (Vec<u16>, Walk) {
    let references = sightings.references.unwrap().cameras;
    let mut ids = references.to_vec();
    let others = record.cameras().map(|camera| camera.id);
    ids.extend(others.filter(|id| !references.contains(id)));
    let truth = |id: &u16| {
        let camera = record.cameras().find(|camera| camera.id == *id).unwrap();
        let truth = camera.truth.unwrap();
        Truth {
            x: truth.x,
            y: truth.y,
            heading: truth.heading_deg.to_radians(),
        }
    };
    let bearings = sightings.bearings.iter().map(|seen| SeenAt {
        stop: seen.stop as usize - 1,
        camera: ids.iter().position(|id| *id == seen.camera).unwrap(),
        bearing: seen.bearing_deg.to_radians(),
        sigma: seen.sigma_deg.to_radians(),
    });
    let legs = sightings.legs.iter().map(|leg| {
        let [xx, xy, yy] = leg.covariance;
        WalkedLeg {
            displacement: Vector2::new(leg.dx, leg.dy),
            covariance: Matrix2::new(xx, xy, xy, yy),
        }
    });
    let places = record.targets[0].stops.iter();
    let walk = Walk {
        cameras: ids.iter().map(truth).collect(),
        places: places.map(|stop| Point2::new(stop.x, stop.y)).collect(),
        carrier: [1.0, 0.0],
        errors: CarrierErrors::UNKNOWN,
        legs: legs.collect(),
        bearings: bearings.collect(),
        ranges: Vec::new(),
        visits: Vec::new(),
        lens_sigma: 0.0,
        principal_sigma: 0.0,
    };
    (ids, walk)
}

/// The measurements of a run's nodes, solved again: the batch optimum to a hundredth of a sigma, with
/// honest sigmas, and no worse than the nodes' own poses.
#[test]
fn a_run_with_an_unknown_carrier_is_solved_again() {
    let (mut nees, mut numbers, mut carriers, mut runs) = (0.0, 0, 0.0, 0);
    // Squared errors of place: solved again and of the batch; then, where nodes have a pose, solved again
    // and theirs.
    let mut squares = [0.0; 4];
    for seed in 1..=12 {
        let record = rehearsal(seed);
        let sightings = &record.sightings[0];
        let solved = network::solve(sightings, &network::Settings::default()).unwrap();
        let [solution] = solved.as_slice() else {
            panic!("{seed}: {} solutions", solved.len());
        };
        if solution.status != Status::Calibrated {
            // The failure is told, not hidden.
            assert_ne!(solution.reason, None, "{seed}");
            continue;
        }
        runs += 1;
        let (ids, walk) = walk(&record, sightings);
        let own = |solution: &NetworkSolution, id: u16| {
            let camera = solution.cameras.iter().find(|camera| camera.camera == id);
            camera.and_then(|camera| camera.estimate)
        };
        let prior = [UNKNOWN[0], UNKNOWN[1].to_radians()];
        let takes_part = |n: usize| own(solution, ids[n]).is_some();
        let batch = Batch::solve(&walk, prior, takes_part).unwrap();
        for (n, id) in ids.iter().enumerate().skip(2) {
            let Some(estimate) = own(solution, *id) else {
                continue;
            };
            let pose = estimate.pose();
            let truth = &walk.cameras[n];
            let (expected, covariance) = batch.camera(n).unwrap();
            if solution.findings.is_empty() {
                let off = [
                    pose.position.x - expected.x,
                    pose.position.y - expected.y,
                    turn(pose.heading, expected.z),
                ];
                for (i, off) in off.into_iter().enumerate() {
                    let sigma = covariance[(i, i)].sqrt();
                    assert!(
                        off.abs() < 0.01 * sigma,
                        "{seed}, camera {id}: {off} of {sigma}"
                    );
                }
            }
            let place = truth.position();
            let square = (pose.position - place).norm_squared();
            squares[0] += square;
            squares[1] += (expected.xy() - place.coords).norm_squared();
            nees += pose.normalised_error(place, truth.heading).unwrap();
            numbers += 3;
            let node = record.cameras().find(|camera| camera.id == *id).unwrap();
            if let Some(estimate) = node.estimate {
                squares[2] += square;
                squares[3] += (estimate.pose().position - place).norm_squared();
            }
        }
        let carrier = solution.carrier.unwrap();
        let (_, covariance) = batch.pair(0);
        let ratio = carrier.sigma_scale / covariance.m11.sqrt();
        assert!((ratio - 1.0).abs() < 0.01, "{seed}: {ratio}");
        // The carrier's real readings: his bias is in no record.
        let mut random = generator(1000 + seed);
        let scale = 1.0 + UNKNOWN[0] * normal(&mut random);
        carriers += ((carrier.scale - scale) / carrier.sigma_scale).powi(2);
    }
    assert!(runs >= 10, "{runs} of 12 runs");
    // Cameras of a run share the target's errors.
    let band = chi_squared_band(f64::from(numbers) / 3.0);
    assert!(band.contains(&(nees / 3.0)), "{nees} of {numbers}");
    assert!(
        chi_squared_band(f64::from(runs)).contains(&carriers),
        "{carriers} of {runs}"
    );
    let [solved, batch, beside, nodes] = squares.map(f64::sqrt);
    assert!((solved / batch - 1.0).abs() < 0.1, "{solved}, {batch}");
    assert!(beside > 0.0 && beside <= 1.1 * nodes, "{beside}, {nodes}");
}

/// A run of a scenario; each of its seeds has another geometry.
fn run_of(name: &str, stops: Option<usize>, seed: u64, has_exact_lenses: bool) -> RunRecord {
    let changes = Overrides {
        seed: Some(seed),
        path: Some(1 + seed % 3),
        stops,
        scatter: Some(ScatterTable::USUAL),
        ..Overrides::default()
    };
    let mut scenario = Scenario::load(name, &changes).unwrap();
    if !has_exact_lenses {
        scenario.camera.field_of_view_sigma = None;
        scenario.camera.principal_sigma = None;
    }
    let mut random = generator(2000 + seed);
    scenario.sensor = Some(SensorTable {
        scale_bias: UNKNOWN[0] * normal(&mut random),
        heading_bias_deg: UNKNOWN[1] * normal(&mut random),
        ..SensorTable::DRIFT
    });
    scenario.firmware.systematic_scale = Some(UNKNOWN[0]);
    scenario.firmware.systematic_heading_deg = Some(UNKNOWN[1]);
    let record = Simulation::new(scenario, Options::default())
        .unwrap()
        .run(|_| ());
    RunRecord::from_json(&record.to_json(false).unwrap()).unwrap()
}

/// The nodes' last reports of their poses, and a computer's poses from the same measurements. A node reports
/// a pose again only when it moved by a third of its sigma, or is a tenth surer. So the two may differ by as
/// much, and where the last bearing was reported they are the same.
#[test]
fn a_computer_and_the_nodes_agree() {
    let settings = network::Settings {
        // As nodes do.
        fit_legs: true,
        ..network::Settings::default()
    };
    let mut equal = 0;
    for (name, stops, has_exact_lenses) in [
        ("thesis-13", Some(3), true),
        ("thesis-13", Some(10), true),
        ("thesis-13", Some(6), false),
        ("lab", None, true),
        ("office", None, true),
    ] {
        // Squared differences in sigmas of the computer and of the nodes, and squared logarithms of
        // sigmas over each other.
        let mut differences = [0.0; 2];
        let (mut sigmas, mut count) = (0.0, 0);
        let mut errors = [0.0; 2];
        for seed in 1..=3 {
            let record = run_of(name, stops, seed, has_exact_lenses);
            let mut solutions = Vec::new();
            for sightings in &record.sightings {
                solutions.extend(network::solve(sightings, &settings).unwrap());
            }
            for solution in &solutions {
                for solved in solution.cameras.iter().filter(|camera| !camera.reference) {
                    let node = { record.cameras() }
                        .find(|node| (node.network, node.id) == (solution.network, solved.camera))
                        .unwrap();
                    assert_eq!(node.estimate.is_some(), solved.estimate.is_some());
                    let (Some(told), Some(solved)) = (node.estimate, solved.estimate) else {
                        continue;
                    };
                    let (told, solved) = (told.pose(), solved.pose());
                    let by_computer = solved.normalised_error(told.position, told.heading);
                    let by_nodes = told.normalised_error(solved.position, solved.heading);
                    differences[0] += by_computer.unwrap() / 3.0;
                    differences[1] += by_nodes.unwrap() / 3.0;
                    equal += usize::from(by_computer.unwrap() < 1e-3);
                    sigmas += (told.sigma_position() / solved.sigma_position())
                        .ln()
                        .powi(2);
                    let truth = node.truth.unwrap();
                    errors[0] += (solved.position - truth.position()).norm_squared();
                    errors[1] += (told.position - truth.position()).norm_squared();
                    count += 1;
                }
            }
        }
        let mean = |sum: f64| (sum / f64::from(count)).sqrt();
        let [by_computer, by_nodes] = differences.map(mean);
        assert!(count >= 10, "{name}: {count}");
        assert!(
            by_computer < 0.33 && by_nodes < 0.33,
            "{name}: {by_computer}, {by_nodes}"
        );
        assert!(mean(sigmas) < 0.1, "{name}: {}", mean(sigmas));
        let [solved, told] = errors.map(mean);
        assert!(
            solved <= 1.1 * told && told <= 1.1 * solved,
            "{name}: {solved}, {told}"
        );
    }
    assert!(equal >= 20, "{equal} are the same");
}
