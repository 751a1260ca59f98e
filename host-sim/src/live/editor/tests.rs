//! Tests: parts of a file that are kept, and parts that change.

use std::sync::{Arc, Mutex};

use site::PillarTable;

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
        let [low, _] = editor.begun(0).unwrap().bounds;
        layout.obstacles.push(Hindrance {
            of: None,
            is: OutlineTable::Wall(vec![low, [low[0] + 0.01, low[1]]]),
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
fn a_mount_that_is_set_and_taken_back_leaves_no_trace() {
    let editor = Editor::new(THESIS).unwrap();
    let mut layout = editor.layout().unwrap();
    layout.networks[0][4].pitch_deg = Some(-10.0);
    let tilted = editor.text(&layout).unwrap();
    assert_ne!(tilted, THESIS);
    let editor = Editor::new(&tilted).unwrap();
    layout.networks[0][4].pitch_deg = None;
    assert_eq!(editor.text(&layout).unwrap(), THESIS);
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
        height: Some(2.5),
        pitch_deg: Some(20.0),
        roll_deg: None,
    });
    let text = editor.text(&layout).unwrap();
    assert!(text.contains("height = 2.5, pitch_deg = 20.0 }"), "{text}");
    let editor = Editor::new(&text).unwrap();
    assert_eq!(editor.layout().unwrap(), layout);
    // As the page sends it.
    let sent = serde_json::to_string(&layout).unwrap();
    assert_eq!(serde_json::from_str::<Layout>(&sent).unwrap(), layout);

    // Level again, and the one beside it is rolled.
    let cameras = &mut layout.networks[0];
    let count = cameras.len();
    (cameras[count - 1].height, cameras[count - 1].pitch_deg) = (None, None);
    cameras[count - 2].roll_deg = Some(-3.0);
    let text = editor.text(&layout).unwrap();
    assert!(!text.contains("pitch_deg") && text.contains("roll_deg = -3.0"));
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
    let pillar = OutlineTable::Pillar(PillarTable {
        x: 1.0,
        y: 2.0,
        radius: 0.2,
    });
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
        layout.obstacles[0].is = OutlineTable::Wall(vec![[1.0, 25.0], [2.0, 25.5]]);
        let x = 3.25;
        let (y, radius) = (25.0, 0.1);
        layout.obstacles[1].is = OutlineTable::Pillar(PillarTable { x, y, radius });
        let corners = vec![[4.0, 25.0], [5.0, 25.0], [5.0, 26.5]];
        layout.obstacles[2].is = OutlineTable::Block(corners);
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
        layout.obstacles[0].is = OutlineTable::Wall(vec![[1.0, 25.0], [1.5, 25.2], [2.0, 25.5]]);
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
    assert!(editor.begun(0).unwrap().was_grid);
    let again = Editor::new(&editor.text).unwrap();
    assert!(!again.begun(0).unwrap().was_grid);
    let (was, is) = (&editor.scenario, &again.scenario);
    assert_eq!(was.networks, is.networks);
    assert_eq!(was.world, is.world);
    let mut layout = editor.layout().unwrap();
    layout.networks[0][2].x = 10.5;
    let moved = editor.text(&layout).unwrap();
    assert_eq!(Editor::new(&moved).unwrap().layout().unwrap(), layout);
}

/// A file in memory.
#[derive(Clone)]
struct Paper(Arc<Mutex<Option<String>>>);

impl Paper {
    fn new(text: &str) -> Self {
        Self(Arc::new(Mutex::new(Some(text.to_owned()))))
    }

    fn change(&self, from: &str, to: &str) {
        let mut text = self.0.lock().unwrap();
        let old = text.take().unwrap();
        assert!(old.contains(from), "{from} is not in {old}");
        *text = Some(old.replacen(from, to, 1));
    }

    fn text(&self) -> String {
        self.0.lock().unwrap().clone().unwrap()
    }
}

impl SiteFile for Paper {
    fn text(&self) -> Result<Option<String>, String> {
        Ok(self.0.lock().unwrap().clone())
    }

    fn save(&self, text: &str) -> Option<Result<String, String>> {
        *self.0.lock().unwrap() = Some(text.to_owned());
        Some(Ok("saved".to_owned()))
    }
}

fn asked(begun: &Begun, layout: &Layout, more: &serde_json::Value) -> Asked {
    let mut asked = serde_json::json!({ "version": begun.version, "layout": layout });
    asked
        .as_object_mut()
        .unwrap()
        .extend(more.as_object().unwrap().clone());
    serde_json::from_value(asked).unwrap()
}

/// A page that was opened before another one saved, and an editor of text beside both.
#[test]
fn a_save_keeps_what_others_changed() {
    let walled = THESIS.replacen(
        "[camera]\n",
        "obstacle = [{ wall = [[1, 25], [2, 25]] }, { pillar = { x = 3, y = 25, radius = 0.1 } }] # shelf\n[camera]\n",
        1,
    );
    let paper = Paper::new(&walled);
    let editing = Editing::new(Box::new(paper.clone())).unwrap();
    let [first, second] = [(); 2].map(|()| editing.begun().unwrap());
    let none = serde_json::json!({});

    let mut layout = first.layout.clone();
    layout.networks[0][4].x += 0.25;
    layout.obstacles[1].is = OutlineTable::Pillar(PillarTable {
        x: 3.5,
        y: 25.0,
        radius: 0.1,
    });
    let saved = editing.save(&asked(&first, &layout, &none)).unwrap();
    assert!(!saved.joined);
    paper.change("# shelf", "# the shelf by the door");

    // The second page knows nothing of both.
    let mut layout = second.layout.clone();
    layout.networks[0][5].x += 0.5;
    layout.obstacles[0].is = OutlineTable::Wall(vec![[1.0, 25.0], [2.5, 25.0]]);
    layout.networks[0].push(Placed {
        id: 14,
        x: 1.0,
        y: 2.0,
        heading_deg: 0.0,
        height: None,
        pitch_deg: None,
        roll_deg: None,
    });
    let saved = editing.save(&asked(&second, &layout, &none)).unwrap();
    assert!(saved.joined);
    let by_hand = walled
        .replace("{ id = 5, x = 21.0,", "{ id = 5, x = 21.25,")
        .replace("x = 3,", "x = 3.5,")
        .replace("[2, 25]", "[2.5, 25]")
        .replace("# shelf", "# the shelf by the door");
    let text = paper.text();
    let differ: Vec<_> = { by_hand.lines() }
        .filter(|line| !text.lines().any(|other| other == *line))
        .collect();
    assert_eq!(differ.len(), 1, "{differ:?} in {text}");
    assert!(differ[0].contains("id = 6,"), "{differ:?}");
    assert!(text.contains("id = 14, x = 1.0, y = 2.0"), "{text}");

    // What the save answered is where the page goes on: the same camera again is no conflict.
    let mut layout = saved.layout.clone();
    layout.networks[0][5].x += 0.5;
    let again = editing.save(&asked(&saved.site, &layout, &none)).unwrap();
    assert!(!again.joined);
    assert_eq!(again.layout.networks, layout.networks);
}

#[test]
fn a_change_of_both_is_refused_and_the_user_chooses() {
    let moved = |paper: &Paper| paper.change("id = 5, x = 21.0,", "id = 5, x = 20.0,");
    for (prefer, x, other) in [("page", 21.25, 0.5), ("file", 20.0, 0.5)] {
        let paper = Paper::new(THESIS);
        let editing = Editing::new(Box::new(paper.clone())).unwrap();
        let begun = editing.begun().unwrap();
        let mut layout = begun.layout.clone();
        layout.networks[0][4].x += 0.25;
        layout.networks[0][5].y += other;
        moved(&paper);
        let before = paper.text();
        let plain = asked(&begun, &layout, &serde_json::json!({}));
        let Err(EditError::Conflicts(words)) = editing.save(&plain) else {
            panic!("both moved camera 5");
        };
        assert_eq!(
            words,
            [
                "camera 5: at (20.00, 3.00), 90.0\u{b0} in the file, at (21.25, 3.00), 90.0\u{b0} here"
            ]
        );
        assert_eq!(paper.text(), before, "nothing is written");
        // The page's own text can be had.
        let wish = asked(&begun, &layout, &serde_json::json!({ "download": true }));
        let own = editing.save(&wish).unwrap().text.unwrap();
        assert!(own.contains("id = 5, x = 21.25,"), "{own}");
        assert_eq!(paper.text(), before);
        let wish = asked(&begun, &layout, &serde_json::json!({ "prefer": prefer }));
        let saved = editing.save(&wish).unwrap();
        assert_eq!(saved.layout.networks[0][4].x, x);
        // What only the page changed is there in both cases.
        assert_eq!(saved.layout.networks[0][5], layout.networks[0][5]);
        assert_eq!(
            Editor::new(&paper.text()).unwrap().layout().unwrap(),
            saved.layout
        );
    }
}

#[test]
fn obstacles_that_both_changed_are_told_and_others_are_joined() {
    let [a, b, c, d] = [1.0, 2.0, 3.0, 4.0].map(|x| OutlineTable::Wall(vec![[x, 0.0], [x, 1.0]]));
    let layout = |list: &[(Option<usize>, &OutlineTable)]| Layout {
        networks: Vec::new(),
        obstacles: { list.iter() }
            .map(|&(of, is)| Hindrance { of, is: is.clone() })
            .collect(),
    };
    let base = layout(&[(Some(0), &a), (Some(1), &b)]);
    // The file lost the first, and the page moved the second and added one.
    let now = layout(&[(Some(0), &b)]);
    let wanted = layout(&[(Some(0), &a), (Some(1), &c), (None, &d)]);
    let all = joined::joined((&base, &now), &wanted, None).unwrap();
    assert_eq!(all, layout(&[(Some(0), &c), (None, &d)]));
    // The page removed the second, and the file has moved it.
    let now = layout(&[(Some(0), &a), (Some(1), &d)]);
    let wanted = layout(&[(Some(0), &a)]);
    let told = joined::joined((&base, &now), &wanted, None).unwrap_err();
    assert_eq!(
        told,
        ["the wall at (2.00, 0.00) was changed here and there"]
    );
    let kept = joined::joined((&base, &now), &wanted, Some(Side::File)).unwrap();
    assert_eq!(kept, now);
    // Both have done the same.
    assert_eq!(joined::joined((&base, &now), &now, None).unwrap(), now);
}

#[test]
fn a_file_that_is_no_site_any_more_is_left_alone() {
    let paper = Paper::new(THESIS);
    let editing = Editing::new(Box::new(paper.clone())).unwrap();
    let begun = editing.begun().unwrap();
    let mut layout = begun.layout.clone();
    layout.networks[0][4].x += 0.25;
    let wish = asked(&begun, &layout, &serde_json::json!({}));
    paper.change("[camera]", "[camera");
    let broken = paper.text();
    let error = editing.save(&wish).unwrap_err().to_string();
    assert!(
        error.starts_with("the file is no site as it is by now"),
        "{error}"
    );
    assert_eq!(paper.text(), broken);
    // One that is gone is written anew.
    *paper.0.lock().unwrap() = None;
    editing.save(&wish).unwrap();
    assert!(paper.text().contains("id = 5, x = 21.25,"));
}
