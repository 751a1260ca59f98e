//! Tests: parts of a file that are kept, and parts that change.

use super::*;

const THESIS: &str = site::BUILT_IN[0].1;

#[test]
fn what_is_not_changed_keeps_every_letter() {
    for (name, text) in site::BUILT_IN {
        let editor = Editor::new(text).unwrap();
        let mut layout = editor.layout().unwrap();
        let text = match name {
            // The text of a grid changes.
            "grid" => editor.text(&layout).unwrap(),
            _ => text.to_owned(),
        };
        assert_eq!(editor.text(&layout).unwrap(), text);
        // A wall outside every view and way.
        let [low, _] = editor.begun().unwrap().bounds;
        layout.obstacles.push(Hindrance {
            of: None,
            is: ObstacleTable::Wall(vec![low, [low[0] + 0.01, low[1]]]),
        });
        let added = editor.text(&layout).unwrap();
        let is_in = |line: &str| added.lines().any(|other| other == line);
        let lost: Vec<_> = text.lines().filter(|line| !is_in(line)).collect();
        assert!(lost.len() <= 1, "{name}: {lost:?}");
        let again = Editor::new(&added).unwrap();
        assert_eq!(
            again.layout().unwrap().obstacles.len(),
            layout.obstacles.len()
        );
    }
}

#[test]
fn a_moved_camera_changes_its_line_only() {
    let editor = Editor::new(THESIS).unwrap();
    let mut layout = editor.layout().unwrap();
    layout.networks[0][4].x += 0.25;
    let text = editor.text(&layout).unwrap();
    let differ: Vec<_> = { THESIS.lines().zip(text.lines()) }
        .filter(|(a, b)| a != b)
        .collect();
    assert_eq!(differ.len(), 1);
    assert_eq!(
        differ[0].1.trim(),
        "{ id = 5, x = 21.25, y = 3.0, heading_deg = 90.0 },"
    );
    assert_eq!(Editor::new(&text).unwrap().layout().unwrap(), layout);
}

#[test]
fn cameras_come_and_go() {
    let editor = Editor::new(THESIS).unwrap();
    let mut layout = editor.layout().unwrap();
    layout.networks[0].retain(|camera| camera.id != 7);
    layout.networks[0].push(Placed {
        id: 14,
        x: 1.0,
        y: 2.0,
        heading_deg: 30.0,
    });
    let text = editor.text(&layout).unwrap();
    assert_eq!(Editor::new(&text).unwrap().layout().unwrap(), layout);
}

#[test]
fn what_is_no_site_is_refused() {
    let editor = Editor::new(THESIS).unwrap();
    let known = editor.layout().unwrap();
    let refused = |change: &dyn Fn(&mut Layout)| {
        let mut layout = known.clone();
        change(&mut layout);
        editor.text(&layout).unwrap_err().to_string()
    };
    // A reference.
    let gone = refused(&|layout| layout.networks[0].retain(|camera| camera.id != 1));
    assert!(gone.contains("reference"), "{gone}");
    refused(&|layout| layout.networks[0][3].x = f64::NAN);
    refused(&|layout| layout.networks[0][3].x = 1e9);
    refused(&|layout| layout.networks.push(Vec::new()));
    let pillar = ObstacleTable::Pillar {
        x: 1.0,
        y: 2.0,
        radius: 0.2,
    };
    for of in [Some(7), Some(0)] {
        let is = pillar.clone();
        let one = Hindrance { of, is };
        refused(&|layout| layout.obstacles.extend([one.clone(), one.clone()]));
    }
}

/// All three kinds of obstacles, in both styles of TOML.
#[test]
fn a_moved_obstacle_changes_its_numbers_only() {
    let inline = "obstacle = [\n  { wall = [[1.0, 25.0], [2.0, 25.0]] }, # the door\n  \
        { pillar = { x = 3.0, y = 25.0, radius = 0.1 } },\n  { block = [[4, 25], [5, 25], [5, 26]] },\n]\n";
    let tables = "[[world.obstacle]]\nwall = [[1.0, 25.0], [2.0, 25.0]] # the door\n\
        [[world.obstacle]]\n[world.obstacle.pillar]\nx = 3.0\ny = 25.0\nradius = 0.1\n\
        [[world.obstacle]]\nblock = [[4, 25], [5, 25], [5, 26]]\n";
    for obstacles in [inline, tables] {
        let text = THESIS.replacen("[camera]\n", &format!("{obstacles}[camera]\n"), 1);
        let editor = Editor::new(&text).unwrap();
        let mut layout = editor.layout().unwrap();
        assert_eq!(layout.obstacles.len(), 3, "{text}");
        layout.obstacles[0].is = ObstacleTable::Wall(vec![[1.0, 25.0], [2.0, 25.5]]);
        let x = 3.25;
        let (y, radius) = (25.0, 0.1);
        layout.obstacles[1].is = ObstacleTable::Pillar { x, y, radius };
        let corners = vec![[4.0, 25.0], [5.0, 25.0], [5.0, 26.5]];
        layout.obstacles[2].is = ObstacleTable::Block(corners);
        let moved = editor.text(&layout).unwrap();
        let by_hand = text
            .replace("[2.0, 25.0]", "[2.0, 25.5]")
            .replace("x = 3.0,", "x = 3.25,")
            .replace("x = 3.0\n", "x = 3.25\n")
            .replace("[5, 26]", "[5, 26.5]");
        assert_eq!(moved, by_hand);
        assert_eq!(
            Editor::new(&moved)
                .unwrap()
                .layout()
                .unwrap()
                .obstacles
                .len(),
            3
        );
        // One corner more, and then one obstacle less.
        layout.obstacles[0].is = ObstacleTable::Wall(vec![[1.0, 25.0], [1.5, 25.2], [2.0, 25.5]]);
        let more = editor.text(&layout).unwrap();
        assert!(more.contains("# the door"), "{more}");
        layout.obstacles.remove(1);
        let fewer = editor.text(&layout).unwrap();
        let again = Editor::new(&fewer).unwrap().layout().unwrap().obstacles;
        let is = |of: &[Hindrance]| -> Vec<_> { of.iter().map(|one| one.is.clone()).collect() };
        assert_eq!(is(&again), is(&layout.obstacles));
    }
}

#[test]
fn a_grid_is_written_out_as_the_cameras_that_it_makes() {
    let (_, text) = site::BUILT_IN[2];
    let editor = Editor::new(text).unwrap();
    assert!(editor.begun().unwrap().was_grid);
    let again = Editor::new(&editor.text).unwrap();
    assert!(!again.begun().unwrap().was_grid);
    let (was, is) = (&editor.scenario, &again.scenario);
    assert_eq!(was.networks, is.networks);
    assert_eq!(was.world, is.world);
    let mut layout = editor.layout().unwrap();
    layout.networks[0][2].x = 10.5;
    let moved = editor.text(&layout).unwrap();
    assert_eq!(Editor::new(&moved).unwrap().layout().unwrap(), layout);
}
