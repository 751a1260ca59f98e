//! A launch file for ROS 2.

use serde::Serialize;

use super::{ExportError, Frame, in_space, one_line, to_yaml};
use crate::record::{Node, RunRecord, space::IN_PLANE};

/// The parent of a camera's frame. Nothing says where the frames of several networks are to one
/// another, unless all is told in the coordinates of the building.
fn world(record: &RunRecord, network: u16, frame: Frame) -> String {
    match frame {
        Frame::Building => "building".to_owned(),
        Frame::Network if record.has_networks() => format!("world_{network}"),
        Frame::Network => "world".to_owned(),
    }
}

#[derive(Serialize)]
struct Launch {
    launch: Vec<Action>,
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Action {
    Node(LaunchNode),
    Let(Let),
}

/// Starts an executable.
#[derive(Serialize)]
struct LaunchNode {
    pkg: &'static str,
    exec: &'static str,
    name: String,
    args: String,
}

/// Sets a launch configuration.
#[derive(Serialize)]
struct Let {
    name: String,
    value: String,
}

/// A launch file in YAML, for `ros2 launch poses.launch.yaml`: one `static_transform_publisher`
/// per calibrated camera, from the frame `world` to `camera_<id>`, in metres and radians. Where there
/// are several networks, each has a frame `world_<network>` of its own. In the coordinates of the
/// building the one frame is `building`.
///
/// A camera's frame is that of REP 103 for bodies: x along the optical axis, y to the left, z up.
/// A static transform carries no covariance, so the file also sets the launch configuration
/// `camera_<id>_covariance`: 36 numbers, the row-major 6 x 6 matrix of
/// `geometry_msgs/PoseWithCovariance` (x, y, z, roll, pitch, yaw). Roll is positive where the left side is high, as in
/// REP 103. Of a camera whose rows tell no height, z, roll and pitch are 0, and so are their variances.
///
/// # Errors
/// [`ExportError`]
pub fn ros_launch(record: &RunRecord, frame: Frame) -> Result<String, ExportError> {
    let record = frame.of(record).ok_or(ExportError::NoBuilding)?;
    let metres = record.unit.metres;
    let actions = record
        .cameras()
        .filter(|camera| camera.is_calibrated())
        .filter_map(|camera| actions(camera, &world(&record, camera.network, frame), metres));
    let launch = Launch {
        launch: actions.flatten().collect(),
    };
    let head = format!(
        "# Static transforms of cameras, metres and radians: {}; unit `{}` taken as {metres} m\n",
        one_line(&record.title()),
        one_line(&record.unit.name),
    );
    Ok(head + &to_yaml(&launch)?)
}

fn actions(camera: &Node, world: &str, metres: f64) -> Option<[Action; 2]> {
    let estimate = camera.estimate?;
    let pose = estimate.pose();
    let (x, y) = (estimate.x * metres, estimate.y * metres);
    let (id, yaw) = (camera.id, pose.heading);
    let hung = estimate.hung;
    // Rows and columns: x, y, z, roll, pitch, yaw.
    let covariance = match &hung {
        Some(found) => in_space(found, metres),
        None => {
            let scale = nalgebra::Vector3::new(metres, metres, 1.0);
            let c = pose.covariance.component_mul(&(scale * scale.transpose()));
            let mut covariance = vec![0.0; 36];
            for row in 0..3 {
                for column in 0..3 {
                    covariance[6 * IN_PLANE[row] + IN_PLANE[column]] = c[(row, column)];
                }
            }
            covariance
        }
    };
    let value: Vec<_> = covariance.iter().map(f64::to_string).collect();
    let value = value.join(" ");
    let hung = hung.map(|found| found.hung);
    let z = hung.map_or(0.0, |hung| hung.z * metres);
    let [roll, pitch] = hung.map_or([0.0; 2], |hung| {
        [hung.roll_deg, hung.pitch_deg].map(f64::to_radians)
    });
    Some([
        Action::Node(LaunchNode {
            pkg: "tf2_ros",
            exec: "static_transform_publisher",
            name: format!("camera_{id}_pose"),
            args: format!(
                "--x {x} --y {y} --z {z} --roll {roll} --pitch {pitch} --yaw {yaw} --frame-id {world} \
                 --child-frame-id camera_{id}"
            ),
        }),
        Action::Let(Let {
            name: format!("camera_{id}_covariance"),
            value,
        }),
    ])
}
