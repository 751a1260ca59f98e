//! The start-up of the thesis (Appendix A: "Initialize", "Object kept", "Start to track"), byte by
//! byte, and other ways to learn a colour.

use crate::{both, common};

use cmucam2_driver::{
    Command, Error,
    colour::ColourBounds,
    session::{Fault, Learn, StartUp},
};
use common::{Async, Blocking, Drive, Script};

const HERE: &str = "T 44 60 30 50 58 70 25 90\r";
const BANNER: &str = "CMUcam2 v1.00 c6\r:";

fn orange() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap()
}

fn started() -> Script {
    Script::idle()
        .on("RS\r", "ACK\r\r")
        .then(700_000, BANNER)
        .on("CR 18 44 19 33\r", "ACK\r:")
        .on("CR 18 40 19 32\r", "ACK\r:")
}

both! {
    /// The golden transcript: the bytes sent are those that the script expects, in this order; the camera
    /// adapts for five seconds between the two register commands.
    fn the_thesis_start_up_byte_by_byte<D>() {
        let script = started()
            .on("TW\r", format!("ACK\r{HERE}{HERE}T 44"))
            .on("\r", ":")
            .on("\r", "ACK\r:")
            .on("GT\r", "ACK\r170 230 70 130 16 46\r:")
            .on("TC 170 230 70 130 16 46\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        let begin = line.now();
        D::drive(camera.start_up(StartUp::default())).unwrap();
        let adapted = line.now() - begin;
        assert!((5_700_000..6_500_000).contains(&adapted), "{adapted} us");
        let bounds = D::drive(camera.learn_and_track(Learn::default())).unwrap();
        assert_eq!(bounds, orange());
        let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
        assert_eq!(tracking.centroid(), Some((44, 60)));
        line.assert_finished();
        assert_eq!(
            line.transcript(),
            "\r\rRS\rCR 18 44 19 33\rCR 18 40 19 32\rTW\r\r\rGT\rTC 170 230 70 130 16 46\r"
        );
    }

    fn a_camera_that_dies_while_it_adapts_begins_again<D>() {
        let script = Script::idle()
            .on("RS\r", format!("ACK\r{BANNER}"))
            .on("CR 18 44 19 33\r", "ACK\r:").then(2_000_000, BANNER)
            .on("RS\r", format!("ACK\r{BANNER}"))
            .on("CR 18 44 19 33\r", "ACK\r:")
            .on("CR 18 40 19 32\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.start_up(StartUp::default())).unwrap();
        line.assert_finished();
    }

    fn a_camera_that_always_dies_is_given_up<D>() {
        let mut script = Script::idle();
        for _ in 0..4 {
            script = script
                .on("RS\r", format!("ACK\r{BANNER}"))
                .on("CR 18 44 19 33\r", "ACK\r:").then(2_000_000, BANNER);
        }
        let (mut camera, line) = script.camera();
        let result = D::drive(camera.start_up(StartUp::default()));
        assert_eq!(result, Err(Error::Camera(Fault::Restarted)));
        line.assert_finished();
    }

    fn track_window_may_tell_its_mean_first<D>() {
        // The order of GT is then told by the mean; blue targets are the ambiguous ones.
        let blue = ColourBounds::new([20, 80, 90, 150, 170, 230]).unwrap();
        for reply in ["20 80 90 150 170 230", "20 90 170 80 150 230"] {
            let script = Script::idle()
                .on("TW\r", format!("ACK\rS 50 120 200 9 9 9\r{HERE}"))
                .stopped()
                .on("GT\r", format!("ACK\r{reply}\r:"));
            let (mut camera, line) = script.camera();
            assert_eq!(D::drive(camera.learn(Learn::TrackWindow)), Ok(blue));
            line.assert_finished();
        }
    }

    fn a_refusal_while_learning_is_repeated<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("TW\r", format!("ACK\r{HERE}:"))
            .on("GT\r", "NCK\r:")
            .on("GT\r", "ACK\r170 70 16 230 130 46\r:")
            .on("ST 170 230 70 130 16 46\r", "NCK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}:"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        D::drive(camera.learn_and_track(Learn::TrackWindow)).unwrap();
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn the_mean_of_the_window_and_a_margin<D>() {
        let script = Script::idle()
            .on("GV\r", "ACK\rCMUcam2 v1.00 c6\r:")
            .on("VW 22 35 66 108\r", "ACK\r:")
            .on("GM\r", "ACK\rS 200 100 30 12 10 8\r")
            .stopped()
            .on("VW\r", "ACK\r:")
            .on("TC 170 230 70 130 16 60\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.version()).unwrap();
        let how = Learn::Mean { window: None, margin: 30 };
        let bounds = D::drive(camera.learn_and_track(how)).unwrap();
        assert_eq!(bounds.values(), [170, 230, 70, 130, 16, 60]);
        assert_eq!(camera.session().modes().window(), None);
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn learned_bounds_survive_a_restart<D>() {
        let script = Script::idle()
            .on("TW\r", format!("ACK\r{HERE}"))
            .stopped()
            .on("GT\r", "ACK\r170 230 70 130 16 46\r:")
            .on("TC 170 230 70 130 16 46\r", format!("ACK\r{BANNER}"))
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.learn_and_track(Learn::TrackWindow)).unwrap();
        let result = D::drive(camera.next_tracking());
        assert_eq!(result, Err(Error::Camera(Fault::Restarted)));
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }
}
