//! Dialogues with a scripted camera, over both traits.

use crate::{both, common};

use cmucam2_driver::{
    Cmucam2, Command, Error, Packet,
    colour::{Colour, ColourBounds},
    command::LineMode,
    geometry::{DownSampling, Sensor, Size, Window},
    packet::{FirmwareVersion, Statistics},
    session::{Answer, Fault},
};
use common::{Async, Blocking, Drive, Overrun, Script};

fn orange() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap()
}

const TC: &str = "TC 170 230 70 130 16 46\r";
const HERE: &str = "T 44 60 30 50 58 70 25 90\r";
const LOST: &str = "T 0 0 0 0 0 0 0 0\r";
const BANNER: &str = "CMUcam2 v1.01 c6\r:";

/// The answer of a query that has one number.
fn value(value: u8) -> Answer {
    Answer::Values([value, 0, 0, 0, 0, 0])
}

fn statistics(answer: Answer) -> Statistics {
    match answer {
        Answer::Packet(Packet::Statistics(statistics)) => statistics,
        other => panic!("{other:?}"),
    }
}

fn camera(error: Fault) -> Result<(), Error<Overrun>> {
    Err(Error::Camera(error))
}

both! {
    fn tracks_a_colour<D>() {
        let script = Script::idle().on(TC, format!("ACK\r{HERE}{HERE}{LOST}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.track_colour(orange())).unwrap();
        for _ in 0..2 {
            let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
            assert_eq!(tracking.centroid(), Some((44, 60)));
            assert_eq!(tracking.confidence(), Some(90));
        }
        let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
        assert!(tracking.is_lost());
        assert_eq!(tracking.centroid(), None);
        line.assert_finished();
        assert_eq!(camera.session().retries(), 0);
    }

    fn another_command_stops_the_stream_and_the_next_packet_starts_it_again<D>() {
        let script = Script::idle()
            .on(TC, format!("ACK\r{HERE}T 44 60"))
            .stopped()
            .on("GB\r", "ACK\r1\r:")
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.track_colour(orange())).unwrap();
        D::drive(camera.next_tracking()).unwrap().unwrap();
        assert_eq!(D::drive(camera.command(Command::GetButton)), Ok(value(1)));
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
        assert_eq!(camera.session().dropped().cut, 1);
    }

    fn a_stopped_stream_has_no_packets<D>() {
        let script = Script::idle().on(TC, "ACK\r").stopped();
        let (mut cam, line) = script.camera();
        D::drive(cam.track_colour(orange())).unwrap();
        D::drive(cam.stop()).unwrap();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::NotStreaming));
        line.assert_finished();
    }

    fn a_sporadic_refusal_is_repeated<D>() {
        let script = Script::idle()
            .on("NF 3\r", "NCK\r:")
            .on("NF 3\r", "NCK\r:")
            .on("NF 3\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::NoiseFilter(3))).unwrap();
        line.assert_finished();
        assert_eq!(camera.session().retries(), 2);
    }

    fn refusal_silence_and_garbage_are_told_apart<D>() {
        let mut script = Script::idle();
        for _ in 0..4 {
            script = script.on("NF 3\r", "NCK\r:");
        }
        let (mut cam, line) = script.camera();
        let refused = Fault::Refused { command: *b"NF" };
        assert_eq!(D::drive(cam.set(Command::NoiseFilter(3))), camera(refused));
        line.assert_finished();
        line.unplug();
        assert_eq!(D::drive(cam.set(Command::NoiseFilter(3))), camera(Fault::Silence));
        line.babble(0xF0);
        assert_eq!(D::drive(cam.set(Command::NoiseFilter(3))), camera(Fault::Garbage));
        assert!(cam.session().dropped().bytes > 0);
    }

    /// The line is good, so the baud rate is: the camera sent something else than it was asked for.
    fn an_answer_of_another_kind_is_no_garbage<D>() {
        let unexpected = |command| Fault::Unexpected { command };
        let mut script = Script::idle();
        for _ in 0..3 {
            script = script.on("GW\r", "ACK\r1 1 88\r:").on("\r", "ACK\r:").on("\r", "ACK\r:");
        }
        let (mut cam, line) = script.on("GW\r", "ACK\r1 1 88\r:").camera();
        let answer = D::drive(cam.command(Command::GetWindow)).map(|_| ());
        assert_eq!(answer, camera(unexpected(*b"GW")));
        line.assert_finished();
        // A stream of one kind that is read as another.
        let script = Script::idle().on("GM\r", "ACK\rS 1 2 3 4 5 6\r");
        let (mut cam, _line) = script.camera();
        D::drive(cam.stream(Command::GetMean)).unwrap();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(unexpected(*b"GM")));
        // Bounds that are none, in either order.
        let (mut cam, _line) = Script::idle().on("GT\r", "ACK\r240 16 0 3 2 1\r:").camera();
        assert_eq!(D::drive(cam.tracking_bounds()).map(|_| ()), camera(unexpected(*b"GT")));
        let text = unexpected(*b"GT").to_string();
        assert!(text.contains("GT") && !text.contains("baud"), "{text}");
    }

    fn a_camera_that_was_never_there_is_silent<D>() {
        let (mut cam, line) = Script::new().camera();
        line.unplug();
        assert_eq!(D::drive(cam.set(Command::Idle)), camera(Fault::Silence));
        // Four carriage returns and nothing else.
        assert_eq!(line.transcript(), "\r\r\r\r");
        assert!(line.now() < 2_000_000);
    }

    fn a_garbled_acknowledgement_is_asked_again<D>() {
        let script = Script::idle()
            .on("PM 1\r", "AxK\r:")
            .on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("PM 1\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        line.assert_finished();
    }

    fn a_late_reply_is_not_taken_for_that_of_the_next_command<D>() {
        // The reply to the first copy arrives while the driver already synchronises.
        let script = Script::idle()
            .on("GI\r", "").then(505_000, "ACK\r7\r:")
            .on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("GI\r", "ACK\r9\r:");
        let (mut camera, line) = script.camera();
        assert_eq!(D::drive(camera.command(Command::GetInputs)), Ok(value(9)));
        line.assert_finished();
    }

    fn a_stray_prompt_does_not_shift_the_replies<D>() {
        // Noise looks like a prompt: the replies to both carriage returns are still to come.
        let script = Script::new()
            .on("\r", ":").then(5_000, "ACK\r:")
            .on("\r", "ACK\r:")
            .on("GI\r", "ACK\r9\r:");
        let (mut camera, line) = script.camera();
        assert_eq!(D::drive(camera.command(Command::GetInputs)), Ok(value(9)));
        line.assert_finished();
        assert_eq!(camera.session().retries(), 0);
    }

    fn poll_mode_asks_for_each_packet<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}:"))
            .on("TC\r", format!("ACK\r{LOST}:"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        assert!(!D::drive(camera.next_tracking()).unwrap().unwrap().is_lost());
        assert!(D::drive(camera.next_tracking()).unwrap().unwrap().is_lost());
        line.assert_finished();
    }

    /// Otherwise packets of the bounds before would pass for those of the new ones.
    fn what_could_not_be_begun_is_not_tracked<D>() {
        const OTHER: [u8; 6] = [20, 30, 40, 50, 60, 70];
        let other = || ColourBounds::new(OTHER).unwrap();
        for (poll, first, refused) in [
            (true, "ST 170 230 70 130 16 46\r", "ST 20 30 40 50 60 70\r"),
            (false, TC, "TC 20 30 40 50 60 70\r"),
        ] {
            let begun = if poll { "ACK\r:" } else { "ACK\r" };
            let mut script = Script::idle()
                .on(if poll { "PM 1\r" } else { "PM 0\r" }, "ACK\r:")
                .on(first, begun);
            if !poll {
                script = script.stopped();
            }
            let script = (0..4).fold(script, |script, _| script.on(refused, "NCK\r:"));
            let (mut cam, line) = script.camera();
            D::drive(cam.set(Command::PollMode(poll))).unwrap();
            D::drive(cam.track_colour(orange())).unwrap();
            let command = *refused.as_bytes().first_chunk().unwrap();
            let fault = camera(Fault::Refused { command });
            assert_eq!(D::drive(cam.track_colour(other())), fault);
            let next = D::drive(cam.next_tracking()).map(|_| ());
            assert_eq!(next, camera(Fault::NotStreaming));
            line.assert_finished();
        }
    }

    fn silence_under_packet_filter_is_no_error<D>() {
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on(TC, format!("ACK\r{HERE}{LOST}"))
            .then(4_000_000, HERE);
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        assert!(D::drive(camera.next_tracking()).unwrap().unwrap().is_lost());
        assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn silence_after_a_sighting_is_looked_into<D>() {
        // Packet filter does not excuse it: the empty packet that must follow did not come.
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on(TC, format!("ACK\r{HERE}"))
            .stopped()
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn silence_after_a_damaged_empty_packet_is_no_error<D>() {
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on(TC, format!("ACK\r{HERE}T 0 0 0 x 0 0 0 0\r"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        line.assert_finished();
    }

    fn a_camera_that_listens_but_never_sends_is_silence<D>() {
        let script = Script::idle()
            .on(TC, "ACK\r")
            .stopped()
            .on("TC\r", "ACK\r");
        let (mut cam, line) = script.camera();
        D::drive(cam.track_colour(orange())).unwrap();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Silence));
        line.assert_finished();
    }

    fn silence_ends_a_cut_image<D>() {
        let lines = cmucam2_driver::command::TrackingLines::Bitmap;
        let cut: &[u8] = &[0xAA, 88, 143, 0xE0];
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on("LM 0 1\r", "ACK\r:")
            .on(TC, [b"ACK\r", cut].concat())
            .then(2_000_000, HERE);
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.set(Command::LineMode(LineMode::Tracking(lines)))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn bounds_that_only_the_camera_knew_are_lost_with_it<D>() {
        let script = Script::idle()
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TW\r", format!("ACK\r{HERE}{BANNER}"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::SetBounds(orange()))).unwrap();
        D::drive(cam.stream(Command::TrackWindow)).unwrap();
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::NotStreaming));
        line.assert_finished();
    }

    fn a_dead_stream_is_silence<D>() {
        let (mut cam, line) = Script::idle().on(TC, format!("ACK\r{HERE}")).camera();
        D::drive(cam.track_colour(orange())).unwrap();
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        line.unplug();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Silence));
    }

    fn a_quiet_camera_is_asked_now_and_then_whether_it_lives<D>() {
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on(TC, "ACK\r")
            .stopped()
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.track_colour(orange())).unwrap();
        for _ in 0..10 {
            assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        }
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn a_banner_in_the_stream_restores_modes_and_stream<D>() {
        let script = Script::idle()
            .on("HR 1\r", "ACK\r:")
            .on("NF 4\r", "ACK\r:")
            .on("CR 18 40 19 32\r", "ACK\r:")
            .on(TC, format!("ACK\r{HERE}T 44 6\r{BANNER}"))
            .on("CR 18 40 19 32\r", "ACK\r:")
            .on("HR 1\r", "ACK\r:")
            .on("NF 4\r", "NCK\r:")
            .on("NF 4\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::HighResolution(true))).unwrap();
        D::drive(cam.set(Command::NoiseFilter(4))).unwrap();
        let light = cmucam2_driver::register::Registers::two(
            cmucam2_driver::register::Register::colour_mode(
                cmucam2_driver::register::ColourMode::Rgb, false),
            cmucam2_driver::register::Register::auto_gain(false),
        );
        D::drive(cam.set(Command::Registers(light))).unwrap();
        D::drive(cam.track_colour(orange())).unwrap();
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        line.assert_finished();
        assert_eq!(cam.session().restarts(), 1);
    }

    /// The blank line that some cameras send before their banner must not complete it.
    fn a_packet_cut_by_a_restart_is_not_completed_by_the_blank_line<D>() {
        let script = Script::idle()
            .on(TC, "ACK\rT 44 60 40 50 50 70 20 2")
            .then(700_000, format!("\r{BANNER}"))
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", "ACK\r");
        let (mut cam, _line) = script.camera();
        D::drive(cam.track_colour(orange())).unwrap();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert_eq!(cam.session().dropped().cut, 1);
    }

    fn a_lost_banner_is_noticed_by_what_stops_the_stream<D>() {
        // An idle camera acknowledges the carriage return, a streaming one does not.
        let script = Script::idle()
            .on("NF 4\r", "ACK\r:")
            .on(TC, format!("ACK\r{HERE}"))
            .on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("NF 4\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::NoiseFilter(4))).unwrap();
        D::drive(cam.track_colour(orange())).unwrap();
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn a_stream_in_poll_mode_is_a_restart_without_a_banner<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{LOST}{LOST}T 0"))
            .stopped()
            .on("TC\r", format!("ACK\r{LOST}{LOST}T 0"))
            .stopped()
            .on("PM 1\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}:"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::PollMode(true))).unwrap();
        D::drive(cam.track_colour(orange())).unwrap();
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert_eq!(cam.session().restarts(), 1);
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn what_looks_like_a_stream_once_is_no_restart<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("ST 170 230 70 130 16 46\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{LOST}{LOST}T 0"))
            .stopped()
            .on("TC\r", format!("ACK\r{HERE}:"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::PollMode(true))).unwrap();
        D::drive(cam.track_colour(orange())).unwrap();
        assert!(D::drive(cam.next_tracking()).unwrap().is_some());
        assert_eq!(cam.session().restarts(), 0);
        line.assert_finished();
    }

    fn a_restart_within_a_command_restores_and_repeats_it<D>() {
        let script = Script::idle()
            .on("PS 2\r", "ACK\r:")
            .on("NF 4\r", format!("AC\r{BANNER}"))
            .on("PS 2\r", "ACK\r:")
            .on("NF 4\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketSkip(2))).unwrap();
        D::drive(camera.set(Command::NoiseFilter(4))).unwrap();
        line.assert_finished();
    }

    fn frame_differencing_does_not_go_on_after_a_restart<D>() {
        let script = Script::idle()
            .on("LF\r", "ACK\r:")
            .on("FD 10\r", format!("ACK\rT 4 5 3 4 5 6 2 60\r{BANNER}"));
        let (mut cam, line) = script.camera();
        D::drive(cam.set(Command::LoadFrame)).unwrap();
        D::drive(cam.stream(Command::FrameDifference(10))).unwrap();
        let tracking = D::drive(cam.next_tracking()).unwrap().unwrap();
        assert_eq!(tracking.centroid(), Some((4, 5)));
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::Restarted));
        assert_eq!(D::drive(cam.next_tracking()).map(|_| ()), camera(Fault::NotStreaming));
        line.assert_finished();
    }

    fn recover_resets_and_restores_a_camera_that_does_not_listen<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("GB\r", "")
            .on("\r", "").on("\r", "").on("\r", "").on("\r", "")
            .on("RS\r", format!("ACK\r\r{BANNER}"))
            .on("PM 1\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        line.fail_next_read();
        assert_eq!(D::drive(camera.command(Command::GetButton)), Err(Error::Uart(Overrun)));
        D::drive(camera.recover()).unwrap();
        line.assert_finished();
    }

    fn reset_forgets_the_modes<D>() {
        let script = Script::idle()
            .on("PM 1\r", "ACK\r:")
            .on("RS\r", format!("ACK\r{BANNER}"))
            .on(TC, format!("ACK\r{HERE}{HERE}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        let version = FirmwareVersion { major: 1, minor: 1, module: Some(6) };
        assert_eq!(D::drive(camera.command(Command::Reset)), Ok(Answer::Version(version)));
        assert_eq!(version.sensor(), Some(Sensor::Ov6620));
        assert!(!camera.session().modes().poll());
        D::drive(camera.track_colour(orange())).unwrap();
        D::drive(camera.next_tracking()).unwrap();
        line.assert_finished();
    }

    fn a_uart_error_ends_the_call_and_the_next_one_clears_up<D>() {
        let script = Script::new()
            .on("\r", "")
            .on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("GI\r", "ACK\r3\r:");
        let (mut camera, line) = script.camera();
        line.fail_next_read();
        assert_eq!(D::drive(camera.command(Command::GetInputs)), Err(Error::Uart(Overrun)));
        assert_eq!(D::drive(camera.command(Command::GetInputs)), Ok(value(3)));
        line.assert_finished();
    }

    fn values_and_windows<D>() {
        let script = Script::idle()
            .on("GW\r", "ACK\r1 1 88 143\r:")
            .on("GS 0\r", "ACK\r128\r:")
            .on("VW 10 20 30 40\r", "ACK\r:")
            .on("DS 2 4\r", "ACK\r:")
            .on("GT\r", "ACK\r170 230 70 130 16 46\r:");
        let (mut camera, line) = script.camera();
        assert_eq!(D::drive(camera.command(Command::GetWindow)), Ok(Answer::Values([1, 1, 88, 143, 0, 0])));
        let pan = cmucam2_driver::servo::Servo::PAN;
        assert_eq!(D::drive(camera.command(Command::GetServo(pan))), Ok(value(128)));
        D::drive(camera.set(Command::VirtualWindow(Some(Window::new(10, 20, 30, 40).unwrap())))).unwrap();
        D::drive(camera.set(Command::DownSample(DownSampling::new(2, 4).unwrap()))).unwrap();
        assert_eq!(camera.session().frame(), Size { width: 88, height: 64 });
        assert_eq!(D::drive(camera.tracking_bounds()), Ok(orange()));
        line.assert_finished();
    }

    fn statistics_once_and_streamed<D>() {
        let script = Script::idle()
            .on("GM\r", "ACK\rS 200 100 30 12 10 8\rS 200 100 30 12 10 8\r")
            .stopped()
            .on("PM 1\r", "ACK\r:")
            .on("GM\r", "ACK\rS 201 101 31 12 10 8\r:");
        let (mut camera, line) = script.camera();
        let mean = statistics(D::drive(camera.command(Command::GetMean)).unwrap()).mean();
        assert_eq!(mean, Some(Colour { red: 200, green: 100, blue: 30 }));
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        assert_eq!(statistics(D::drive(camera.command(Command::GetMean)).unwrap()).mean().unwrap().red, 201);
        line.assert_finished();
    }

    fn sleeping_needs_no_prompt_and_the_next_call_wakes<D>() {
        let script = Script::idle()
            .on("SL\r", "ACK\r")
            .on("\r", "").on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("GB\r", "ACK\r0\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::Sleep)).unwrap();
        assert_eq!(D::drive(camera.command(Command::GetButton)), Ok(value(0)));
        line.assert_finished();
    }

    fn a_lost_acknowledgement_of_sleep_is_not_repeated<D>() {
        let (mut cam, line) = Script::idle().on("SL\r", "").camera();
        assert_eq!(D::drive(cam.set(Command::Sleep)), camera(Fault::Silence));
        line.assert_finished();
    }
}

#[test]
fn the_driver_fits_into_half_a_kilobyte() {
    let bytes = size_of::<Cmucam2<(), ()>>();
    println!("{bytes} bytes");
    assert!(bytes <= 512, "{bytes}");
}
