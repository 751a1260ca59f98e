//! The list of the keys.

use node_firmware::{config::BaudRate, message::StopNumber};

use super::{
    Key,
    Kind::{
        Choice, Flag, Levels, Number, Numbers, OneOf, Places, Rates, Same, Table, Tables, Text,
        Texts, Whole, Wholes,
    },
    Used::{Both, Nodes, Rehearsal},
    Without::{Camera, Is, Needed, Target},
    limits::*,
};
use crate::{FIRST_COORDINATOR, PATH_MAX, check::MOST_NETWORKS, event, firmware};

/// In the order of [`BaudRate::ALL`].
const BAUD_RATES: [u32; BaudRate::ALL.len()] = {
    let mut rates = [0; BaudRate::ALL.len()];
    let mut n = 0;
    while n < rates.len() {
        rates[n] = BaudRate::ALL[n].bits_per_second();
        n += 1;
    }
    rates
};

const MOST: usize = usize::MAX;

const fn key(
    path: &'static str,
    kind: super::Kind,
    default: super::Without,
    used: super::Used,
    what: &'static str,
) -> Key {
    Key {
        path,
        kind,
        default,
        used,
        what,
    }
}

/// All of them: those of `[firmware]` and those of events are where these are declared.
pub const KEYS: &[Key] = &{
    let parts = [SITE, firmware::KEYS, REHEARSAL, event::KEYS];
    const COUNT: usize = SITE.len() + firmware::KEYS.len() + REHEARSAL.len() + event::KEYS.len();
    let mut all = [SITE[0]; COUNT];
    let (mut part, mut from, mut n) = (0, 0, 0);
    while n < all.len() {
        while n - from == parts[part].len() {
            from = n;
            part += 1;
        }
        all[n] = parts[part][n - from];
        n += 1;
    }
    all
};

#[rustfmt::skip]
const SITE: &[Key] = &[
    key("name", Text, Needed, Both, "What the site is called."),
    key("about", Texts, Is(""), Both, "What it is, for people."),
    key("unit", Text, Is("units"), Both, "Name of the unit of length; all lengths are in it. `m`, `metres` and `units` are one metre long."),
    key("unit_metres", Number(1e-4, LARGE, " metres"), Is("1, for `m`, `metres` and `units`"), Both, "How many metres one unit is: for exports in metres and for the medium `log-distance`."),
    key("key_file", Text, Is("asked for"), Nodes, "Name of the file with the site's key, from where this file is. Never the key itself."),
    key("seed", Whole(0.0, 9.3e18, ""), Is("1"), Rehearsal, "The seed of every random number."),
    key("path", Whole(1.0, PATH_MAX as f64, ""), Is("1"), Rehearsal, "Which of the planned ways targets take."),
    key("stops", STOPS, Is("3"), Both, "Stops that are planned in view of each camera, and that each camera waits for."),
    key("placement", Choice(&["planned", "checked", "anywhere"]), Is("planned"), Rehearsal, "How stops are chosen: where they help most; there, and then on until every pose is checked; or anywhere in view."),
    key("world", Table, Is(""), Rehearsal, "The place."),
    key("camera", Table, Is(""), Both, "What all cameras are, unless one says otherwise."),
    key("firmware", Table, Is(""), Nodes, "What all nodes are configured to, unless one says otherwise."),
    key("network[]", Tables, Is("there, unless there is a `grid`"), Both, "A coordinator and what joins it, one hop apart; again for the next network."),
    key("walk", Table, Is(""), Rehearsal, "How targets walk."),
    key("sensor", Table, Is("assumed: reports the way from goal to goal"), Rehearsal, "How step sensors err."),
    key("clock_ppm", Number(0.0, 500.0, " millionths"), Is("40"), Rehearsal, "By how much nodes' clocks run too fast or too slow at most; each by an error of its own, evenly. Crystals have 20 at room temperature, and some more outside."),
    key("radio", Table, Is("`unit-disk` of range 45"), Rehearsal, "The radio medium."),
    key("scatter", Table, Is(""), Rehearsal, "How far cameras stand from where this file has them, drawn from the seed."),
    key("published", Choice(&["thesis-4.1", "thesis-3.1"]), Is("none"), Rehearsal, "Which of the thesis's results stand beside this site's: the simulation's, by path, or the laboratory's."),
    key("object[]", Tables, Is("none"), Rehearsal, "Something that cameras track once they are calibrated, if the run goes on with that: `run --track`."),
    key("event[]", Tables, Is("none"), Rehearsal, "Something that happens by order of a script."),
    key("grid", Table, Is("none"), Rehearsal, "Networks to be made, in place of `network`."),

    key("network[].channel", CHANNEL, Is("15"), Nodes, "Its radio channel."),
    key("network[].channels", Wholes(11.0, 26.0, ": channels of the 2.4 GHz band"), Is("`channel` alone"), Nodes, "Several, of which its coordinator takes the quietest; in place of `channel`."),
    key("network[].references", Table, Needed, Both, "The two cameras that span its frame."),
    key("network[].camera[]", Tables, Needed, Both, "Its cameras, two or more."),
    key("network[].target[]", Tables, Is("there, unless there is a `frame_of`"), Both, "Its targets, one or more; none where they come from another network. A network has 100 members at most."),
    key("network[].frame", Table, Is("from the places of the references"), Both, "Where its frame is in the building, if its references have no `x` and `y`."),
    key("network[].coordinator", Numbers(2, -LARGE, LARGE, ": x and y"), Is("the middle of its cameras"), Rehearsal, "Where its coordinator stands."),
    key("network[].allow", Wholes(1.0, 65535.0, ": numbers of nodes"), Is("none"), Nodes, "Nodes that may join besides its own cameras and targets."),
    key("network[].area", Places(2, 2, ": the lowest corner and the highest one"), Is("the world"), Rehearsal, "Where its targets may go."),

    key("network[].references.cameras", Levels(2, 1.0, FIRST_COORDINATOR as f64 - 1.0, ": the `id`s of two cameras of this network"), Needed, Both, "The first one is the origin of the frame, the x axis points to the second one. Where they are elected: those in whose view the walk begins."),
    key("network[].references.elected", Flag, Is("false"), Nodes, "They are not configured; who sees the target first becomes one."),
    key("network[].references.frame_of", Whole(1.0, MOST_NETWORKS, ": the number of a network that has references"), Is("none"), Both, "There are none: its cameras wait for the targets of that network, which bring its frame. `cameras` are then those in whose view the walk goes on."),
    key("network[].references.baseline_known", Flag, Is("true, unless `elected` or `frame_of`"), Nodes, "Nodes are told the distance of the two."),
    key("network[].references.baseline", LENGTH, Is("that of their `x` and `y`"), Nodes, "That distance as it was measured."),
    key("network[].references.baseline_sigma", Number(0.0, 0.5, " of it"), Target("survey-sigma.baseline"), Nodes, "Standard deviation of that distance: 0.01 by tape. Nothing tests it. 0 promises that it is exact."),
    key("network[].references.position_sigma", Number(0.0, 1000.0, " in the unit of the site"), Is("1 cm"), Nodes, "Standard deviation of the place of each along each axis. 0 promises that they are exact."),
    key("network[].references.frame_heading_known", Flag, Is("true, unless `elected` or `frame_of`"), Nodes, "Nodes are told from which direction the step sensor's headings count."),
    key("network[].references.compass_deg", DIRECTION, Is("the frame's x axis; 0 if not known"), Both, "That direction in the building."),

    key("network[].frame.x", COORDINATE, Needed, Both, "The first reference's place in the building."),
    key("network[].frame.y", COORDINATE, Needed, Both, "The first reference's place in the building."),
    key("network[].frame.heading_deg", DIRECTION, Needed, Both, "Direction from the first reference to the second one in the building."),

    key("network[].camera[].id", NODE, Needed, Both, "Number of the node; no other of the site has it."),
    key("network[].camera[].x", COORDINATE, Is("only needed in a rehearsal"), Both, "Where it stands in the building. Of the references, nodes are told what follows from it."),
    key("network[].camera[].y", COORDINATE, Is("only needed in a rehearsal"), Both, "Where it stands in the building."),
    key("network[].camera[].heading_deg", DIRECTION, Is("only needed in a rehearsal"), Rehearsal, "Where it looks: counter-clockwise from the x axis."),
    key("network[].camera[].height", Number(-LARGE, LARGE, " in the unit of the site"), Is("that of the ball"), Rehearsal, "Height of its lens above the floor."),
    key("network[].camera[].pitch_deg", Number(-90.0, 90.0, " degrees"), Is("0, level"), Rehearsal, "Angle of its optical axis below the horizon."),
    key("network[].camera[].roll_deg", Number(-180.0, 180.0, " degrees"), Is("0, upright"), Rehearsal, "Its turn about the optical axis: positive where its left side is high, 180 upside down."),
    key("network[].camera[].kind", Same("camera.kind"), Is("`[camera]`'s"), Both, "Which camera this one is."),
    key("network[].camera[].sensor", Same("camera.sensor"), Is("`[camera]`'s"), Both, "Its own image sensor."),
    key("network[].camera[].projection", Same("camera.projection"), Is("`[camera]`'s"), Both, "Its own lens."),
    key("network[].camera[].field_of_view_deg", Same("camera.field_of_view_deg"), Is("`[camera]`'s"), Both, "Its own lens."),
    key("network[].camera[].distortion", Same("camera.distortion"), Is("`[camera]`'s"), Both, "Its own lens."),
    key("network[].camera[].range", Same("camera.range"), Is("`[camera]`'s"), Rehearsal, "How far this one sees."),
    key("network[].camera[].model", Same("camera.model"), Is("`[camera]`'s"), Nodes, "What its own node believes."),
    key("network[].camera[].baud", Same("camera.baud"), Is("`[camera]`'s"), Both, "Its own line."),
    key("network[].camera[].faults", Same("camera.faults"), Is("`[camera]`'s"), Rehearsal, "Its own faults."),
    key("network[].camera[].firmware", Same("firmware"), Is("`[firmware]`'s"), Nodes, "Its own parameters; what is not in it comes from `[firmware]`."),

    key("network[].target[].id", NODE, Needed, Both, "Number of the node; no other of the site has it."),
    key("network[].target[].colour", Levels(3, 0.0, 255.0, ": red, green and blue"), Is("[230, 105, 35], orange"), Both, "Its colour. Targets of one colour look the same to a camera, which tells four apart."),
    key("network[].target[].window", Table, Is("`colour`, and `colour_tolerance` around it"), Nodes, "Levels that cameras take for its colour, where they were measured."),
    key("network[].target[].radius", LENGTH, Is("0.15"), Rehearsal, "Its radius."),
    key("network[].target[].height", Number(-LARGE, LARGE, " in the unit of the site"), Is("a metre"), Rehearsal, "Height of the middle of its ball above the floor. All targets of a network have one."),
    key("network[].target[].stops", Places(3, StopNumber::MAX as usize, "; leave it out to have them planned"), Is("planned"), Rehearsal, "Where it stops, first where it begins."),
    key("network[].target[].firmware", Same("firmware"), Is("`[firmware]`'s"), Nodes, "Its own parameters, such as its carrier's; what is not in it comes from `[firmware]`."),
    key("network[].target[].window.red", LEVEL, Needed, Nodes, "Of red."),
    key("network[].target[].window.green", LEVEL, Needed, Nodes, "Of green."),
    key("network[].target[].window.blue", LEVEL, Needed, Nodes, "Of blue."),

    key("camera.field_of_view_deg", Number(1.0, 360.0, " degrees: below 170 for a pin-hole"), Is("asked for; a rehearsal assumes 60, of a Pixy 75, of an OpenMV Cam 70.8"), Both, "Angle from the middle of the first column to that of the last one."),
    key("camera.projection", Choice(&["pin-hole", "equal-angle"]), Is("asked for; a rehearsal assumes that of the variant"), Both, "How directions are spread over the columns."),
    key("camera.distortion", Numbers(2, -10.0, 10.0, ": k1 and k2"), Is("[0, 0], none"), Both, "Radial distortion of the lens: a tangent `r` off the axis (with equal angles, an angle) is seen at `r (1 + k1 r^2 + k2 r^4)`, as OpenCV has it."),
    key("camera.kind", Choice(&["cmucam2", "pixy2", "pixy", "openmv", "openmv-tags"]), Camera("kind"), Both, "Which camera it is. All but a CMUcam2 are taught the targets' colours beforehand: the first colour of their network as signature 1, and so on. With `openmv-tags`, an OpenMV Cam that looks for AprilTags, the first target of a network wears tag 0, the next one tag 1, and so on. `motion` is nothing to these."),
    key("camera.sensor", Choice(&["ov6620", "ov7620"]), Is("ov6620"), Both, "The image sensor of a CMUcam2: 88 columns or 160."),
    key("camera.baud", OneOf(&BAUD_RATES), Is("38400; 19200 of others"), Both, "Baud rate that a CMUcam2's jumpers select, or that was set in another camera."),
    key("camera.model", Table, Is("the real lens"), Nodes, "The lens that nodes believe to have, where it is not the real one."),
    key("camera.field_of_view_sigma", Number(0.0, 0.5, " of the focal length"), Target("lens-sigma.focal"), Nodes, "Standard deviation of what is said of the lens: 0.02 by the sheet of that very lens. 0 promises that it is exact."),
    key("camera.principal_sigma", Number(0.0, 50.0, " columns"), Is("2"), Nodes, "Standard deviation of the column of the optical axis. 0 promises that it is exact."),
    key("camera.tilt_sigma_deg", Number(0.0, 20.0, " degrees"), Target("lens-sigma.tilt-deg"), Nodes, "Standard deviation of the pitch and roll of a camera that is put up level, and of the roll of any other. Rows tell a camera whose pitch is farther off: its pitch, roll and height are then found from them. 0 promises that all are exactly level; then nothing tests it."),
    key("camera.range", LENGTH, Is("8"), Rehearsal, "How far cameras see. `openmv-tags` see no farther than a tag as wide as the smallest target has 11 columns."),
    key("camera.variant", Choice(&["cmucam2", "stage"]), Is("cmucam2"), Rehearsal, "How pictures come about: rendered and counted, or by a scan of equal angles as in Stage."),
    key("camera.noise", Number(0.0, 100.0, " levels"), Is("2"), Rehearsal, "Noise of a pixel, standard deviation."),
    key("camera.flicker", Number(0.0, 1.0, " of the light"), Is("0.01"), Rehearsal, "Change of the light from frame to frame."),
    key("camera.faults", Rates, Is("none"), Rehearsal, "How often a fault of the camera or its line happens, by name."),
    key("camera.model.projection", Choice(&["pin-hole", "equal-angle"]), Is("the real one"), Nodes, "How directions are spread over the columns."),
    key("camera.model.field_of_view_deg", Number(1.0, 360.0, " degrees: below 170 for a pin-hole"), Is("the real one"), Nodes, "As it was measured."),
    key("camera.model.principal_column", Number(0.0, 315.0, ": a column of the lens"), Is("the middle"), Nodes, "Column of the optical axis."),
    key("camera.model.distortion", Numbers(2, -10.0, 10.0, ": k1 and k2"), Is("the real one"), Nodes, "As it was measured. [0, 0]: nodes know of none."),
];

#[rustfmt::skip]
const REHEARSAL: &[Key] = &[
    key("world.low", Numbers(2, -LARGE, LARGE, ": x and y"), Is("[-2, -2]"), Rehearsal, "Its lowest corner."),
    key("world.high", Numbers(2, -LARGE, LARGE, ": x and y"), Is("[28, 28]"), Rehearsal, "Its highest corner."),
    key("world.obstacle[]", Tables, Is("none"), Rehearsal, "What blocks sight and ways: one of the three that follow."),
    key("world.obstacle[].wall", Places(2, MOST, ""), Is(""), Rehearsal, "A thin wall along these corners."),
    key("world.obstacle[].block", Places(3, MOST, "; two make a `wall`"), Is(""), Rehearsal, "A polygon."),
    key("world.obstacle[].height", Number(0.0, LARGE, " in the unit of the site"), Is("it reaches to the ceiling"), Rehearsal, "Height of its top above the floor: cameras that hang higher look over it."),
    key("world.obstacle[].pillar", Table, Is(""), Rehearsal, "A disc."),
    key("world.obstacle[].pillar.x", COORDINATE, Needed, Rehearsal, "Its middle."),
    key("world.obstacle[].pillar.y", COORDINATE, Needed, Rehearsal, "Its middle."),
    key("world.obstacle[].pillar.radius", LENGTH, Needed, Rehearsal, "Its radius."),

    key("walk.speed", Number(1e-3, 1e3, " units a second"), Is("0.2"), Rehearsal, "How fast."),
    key("walk.arrive_within", Number(1e-4, 1e3, " units"), Is("0.02"), Rehearsal, "A leg ends so near to its goal."),
    key("walk.bob_sigma", Number(0.0, 1e3, " units"), Is("0"), Rehearsal, "Standard deviation of the height at which the ball is carried, drawn anew for each stop."),
    key("walk.step_length", Number(1e-3, 1e3, " units"), Is("0.1"), Rehearsal, "How far a step goes."),
    key("walk.patience_s", SECONDS, Is("600"), Rehearsal, "How long a target stands without being told to walk on."),
    key("walk.walks", Whole(1.0, 1_000.0, ""), Is("1"), Rehearsal, "How often they walk: each walk visits the stops of the one before, from the last to the first."),
    key("walk.every_s", SECONDS, Is("86400"), Rehearsal, "From the begin of a walk to that of the next; a walk that is late begins when the one before has ended."),

    key("sensor.measures", Flag, Is("false"), Rehearsal, "It measures what was walked; otherwise it reports the way from goal to goal, as in the thesis."),
    key("sensor.leg_distance", Number(0.0, 1.0, " of the distance"), Is("0"), Rehearsal, "Error of all distances of a leg, standard deviation."),
    key("sensor.leg_heading_deg", SPREAD, Is("0"), Rehearsal, "Error of all headings of a leg, standard deviation."),
    key("sensor.undeclared_distance", Number(0.0, 1.0, " of the distance"), Is("0"), Rehearsal, "As `leg_distance`, and the sensor does not tell it."),
    key("sensor.undeclared_heading_deg", SPREAD, Is("0"), Rehearsal, "As `leg_heading_deg`, and the sensor does not tell it."),
    key("sensor.step_distance", Number(0.0, 1.0, " of the distance"), Is("0"), Rehearsal, "Error of each step's distance, standard deviation."),
    key("sensor.step_heading_deg", SPREAD, Is("0"), Rehearsal, "Error of each step's heading, standard deviation."),
    key("sensor.scale_bias", Number(-0.9, 9.0, " of the distance"), Is("0"), Rehearsal, "Constant error of distances. Within twice `systematic_scale`, nodes expect it."),
    key("sensor.heading_bias_deg", Number(-180.0, 180.0, " degrees"), Is("0"), Rehearsal, "Constant error of headings. Within twice `systematic_heading_deg`, nodes expect it."),

    key("radio.medium", Choice(&["unit-disk", "log-distance"]), Needed, Rehearsal, "Everybody within a distance is heard; or path loss with the logarithm of the distance, shadowing and capture."),
    key("radio.range", LENGTH, Is("needed for `unit-disk`"), Rehearsal, "That distance, only for `unit-disk`."),
    key("radio.exponent", Number(1.0, 8.0, ": 2 in free space, 3 indoors"), Is("3"), Rehearsal, "Of the path loss, only for `log-distance`."),
    key("radio.shadowing_db", Number(0.0, 30.0, " dB"), Is("4"), Rehearsal, "Standard deviation for each link, only for `log-distance`."),
    key("radio.loss", SHARE, Is("0"), Rehearsal, "Share of the frames that are lost besides."),

    key("scatter.position", SIGMA, Is("0"), Rehearsal, "Standard deviation of x and of y."),
    key("scatter.heading_deg", SPREAD, Is("0"), Rehearsal, "Standard deviation of the heading."),

    key("object[].path", Places(2, MOST, ""), Is("the way of the first network's target, each object from another of its stops"), Rehearsal, "Where it goes, to and fro."),
    key("object[].speed", Number(1e-3, 1e3, " units a second"), Is("that of `walk`"), Rehearsal, "How fast."),
    key("object[].colour", Levels(3, 0.0, 255.0, ": red, green and blue"), Is("[230, 105, 35], orange"), Rehearsal, "Its colour."),
    key("object[].radius", LENGTH, Is("0.15"), Rehearsal, "Its radius."),

    key("event[].at_s", SECONDS, Needed, Rehearsal, "When, since the start."),
    key("event[].action", Table, Needed, Rehearsal, "What: one of those that follow."),

    key("grid.nodes", Whole(2.0, 20_000.0, ""), Is("52"), Rehearsal, "Cameras in all. The last network has two at least, so that one more is made where one would be left."),
    key("grid.cell_nodes", Whole(2.0, 98.0, ": a network has 100 members at most, and a target joins too"), Is("13"), Rehearsal, "Cameras of a cell; each cell is a network."),
    key("grid.cell_size", Number(SMALL, 1e4, ": three times the cameras' range or more"), Is("24"), Rehearsal, "Side of a cell."),
    key("grid.one_frame", Flag, Is("false"), Rehearsal, "Only the first cell has references and a target, which walks through all of them."),
];
