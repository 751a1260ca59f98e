//! Every point that the sources leave open, in every variant, through the whole driver.

use crate::{both, common};

use cmucam2_driver::{
    Command, Packet,
    colour::{ColourBounds, ColourChannel},
    command::RawMode,
    geometry::Size,
    packet::{FirmwareVersion, Histogram},
    session::{Answer, Learn},
    uncertain,
};
use common::{Async, Blocking, Drive, Script};

const HERE: &str = "T 44 60 30 50 58 70 25 90\r";
const LOST: &str = "T 0 0 0 0 0 0 0 0\r";
const VERSION: FirmwareVersion = FirmwareVersion {
    major: 1,
    minor: 1,
    module: Some(6),
};

fn histogram(answer: Answer) -> Histogram {
    match answer {
        Answer::Packet(Packet::Histogram(histogram)) => histogram,
        other => panic!("{other:?}"),
    }
}

fn orange() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap()
}

both! {
    fn reset_with_and_without_a_blank_line_and_with_its_acknowledgement_lost<D>() {
        for reply in [
            "ACK\rCMUcam2 v1.01 c6\r:",
            "ACK\r\rCMUcam2 v1.01 c6\r:",
            "ACK\r\r\rCMUcam2 v1.01 c6:",
            "CMUcam2 v1.01 c6\r:",
        ] {
            let (mut camera, line) = Script::idle().on("RS\r", reply).camera();
            assert_eq!(D::drive(camera.command(Command::Reset)), Ok(Answer::Version(VERSION)), "{reply}");
            line.assert_finished();
        }
    }

    fn version_with_and_without_a_carriage_return<D>() {
        for reply in ["ACK\rCMUcam2 v1.01 c6\r:", "ACK\rCMUcam2 v1.01 c6:"] {
            let (mut camera, line) = Script::idle().on("GV\r", reply).camera();
            assert_eq!(D::drive(camera.version()), Ok(VERSION), "{reply}");
            line.assert_finished();
        }
    }

    fn the_sensor_decides_the_frame<D>() {
        for (module, frame) in [
            (6, Size { width: 88, height: 143 }),
            (7, Size { width: 160, height: 239 }),
            (3, Size::LARGEST),
        ] {
            let reply = format!("ACK\rCMUcam2 v1.0 c{module}\r:");
            let (mut camera, _) = Script::idle().on("GV\r", reply).camera();
            D::drive(camera.version()).unwrap();
            assert_eq!(camera.session().frame(), frame);
        }
    }

    fn bounds_in_either_order<D>() {
        for reply in ["170 230 70 130 16 46", "170 70 16 230 130 46"] {
            let script = Script::idle().on("GT\r", format!("ACK\r{reply}\r:"));
            let (mut camera, _) = script.camera();
            assert_eq!(D::drive(camera.tracking_bounds()), Ok(orange()), "{reply}");
        }
    }

    fn coordinates_from_zero_or_one<D>() {
        let script = Script::idle()
            .on("GV\r", "ACK\rCMUcam2 v1.01 c6\r:")
            .on("TC\r", "ACK\rT 0 0 0 0 87 142 255 20\rT 1 1 1 1 88 143 255 20\r");
        let (mut camera, _) = script.camera();
        D::drive(camera.version()).unwrap();
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        for corner in [(87, 142), (88, 143)] {
            let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
            let target = tracking.bounding_box().unwrap();
            assert_eq!((target.x2, target.y2), corner);
        }
        let frame = Size { width: 88, height: 143 };
        assert_eq!(uncertain::last_coordinate(frame), frame);
    }

    fn coordinates_relative_to_the_window_or_not<D>() {
        let script = Script::idle()
            .on("VW 40 60 80 100\r", "ACK\r:")
            .on("TC\r", "ACK\rT 5 6 1 2 9 10 5 250\rT 45 66 41 62 49 70 5 250\r");
        let (mut camera, _) = script.camera();
        let window = cmucam2_driver::geometry::Window::new(40, 60, 80, 100).unwrap();
        D::drive(camera.set(Command::VirtualWindow(Some(window)))).unwrap();
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        for at in [(5, 6), (45, 66)] {
            let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
            assert_eq!(tracking.centroid(), Some(at));
        }
    }

    fn frame_separators<D>() {
        let body: &[u8] = &[20, 30, 40, 2, 50, 60, 70];
        for first in [&b""[..], b"\x02"] {
            for last in [&b""[..], b"\x02"] {
                let frame = [b"ACK\r\x01\x03\x02", first, body, last, b"\x03:"].concat();
                let (mut camera, line) = Script::idle().on("SF 0\r", frame).camera();
                let mut row = [0; 88];
                D::drive(camera.stream(Command::SendFrame(Some(ColourChannel::Red)))).unwrap();
                let Answer::Header(header) = D::drive(camera.next_part(&mut row)).unwrap() else {
                    panic!("no header");
                };
                assert_eq!((header.width, header.height, header.row_bytes), (3, 2, 3));
                for pixels in [[20, 30, 40], [50, 60, 70]] {
                    let part = D::drive(camera.next_part(&mut row)).unwrap();
                    assert_eq!(part, Answer::Row { bytes: 3, intact: true });
                    assert_eq!(row[..3], pixels);
                }
                let part = D::drive(camera.next_part(&mut row)).unwrap();
                assert_eq!(part, Answer::End { rows: 2, intact: true });
                line.assert_finished();
            }
        }
    }

    fn track_window_with_and_without_statistics<D>() {
        for statistics in ["", "S 200 100 16 9 9 9\r"] {
            let script = Script::idle()
                .on("TW\r", format!("ACK\r{statistics}{HERE}"))
                .stopped()
                .on("GT\r", "ACK\r170 230 70 130 16 46\r:");
            let (mut camera, line) = script.camera();
            assert_eq!(D::drive(camera.learn(Learn::TrackWindow)), Ok(orange()));
            line.assert_finished();
            let script = Script::idle().on("TW\r", format!("ACK\r{statistics}{HERE}"));
            let (mut camera, _) = script.camera();
            D::drive(camera.stream(Command::TrackWindow)).unwrap();
            assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        }
    }

    fn a_histogram_once_or_as_a_stream<D>() {
        let line = format!("H{}\r", " 9".repeat(28));
        let once = Script::idle().on("GH 1\r", format!("ACK\r{line}:"));
        let stream = Script::idle().on("GH 1\r", format!("ACK\r{line}{line}{line}")).stopped();
        let slow = Script::idle().on("GH 1\r", format!("ACK\r{line}")).stopped();
        for script in [once, stream, slow] {
            let (mut camera, uart) = script.on("GB\r", "ACK\r1\r:").camera();
            let histogram = histogram(D::drive(camera.command(Command::GetHistogram(ColourChannel::Green))).unwrap());
            assert_eq!(histogram.bins(), [9; 28]);
            D::drive(camera.command(Command::GetButton)).unwrap();
            uart.assert_finished();
        }
    }

    fn other_numbers_of_bins_once_they_were_asked_for<D>() {
        for bins in [7, 14, 28] {
            let line = format!("H{}\r", " 9".repeat(bins));
            let script = Script::idle()
                .on("HC 1 0\r", "ACK\r:")
                .on("GH 0\r", format!("ACK\r{line}:"));
            let (mut camera, _) = script.camera();
            D::drive(camera.set(Command::HistogramConfiguration { bins: 1, scale: 0 })).unwrap();
            let histogram = histogram(D::drive(camera.command(Command::GetHistogram(ColourChannel::Red))).unwrap());
            assert_eq!(histogram.bins().len(), bins);
        }
    }

    fn packet_filter_with_and_without_a_first_empty_packet<D>() {
        for first in ["", LOST] {
            let script = Script::idle()
                .on("PF 1\r", "ACK\r:")
                .on("TC\r", format!("ACK\r{first}"));
            let (mut camera, line) = script.camera();
            D::drive(camera.set(Command::PacketFilter(true))).unwrap();
            D::drive(camera.stream(Command::TrackColour(None))).unwrap();
            if !first.is_empty() {
                assert!(D::drive(camera.next_tracking()).unwrap().unwrap().is_lost());
            }
            assert_eq!(D::drive(camera.next_tracking()), Ok(None));
            line.assert_finished();
        }
    }

    fn packet_filter_in_poll_mode_may_send_nothing<D>() {
        let script = Script::idle()
            .on("PF 1\r", "ACK\r:")
            .on("PM 1\r", "ACK\r:")
            .on("TC\r", "ACK\r:")
            .on("TC\r", format!("ACK\r{HERE}:"));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::PacketFilter(true))).unwrap();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        assert_eq!(D::drive(camera.next_tracking()), Ok(None));
        assert!(D::drive(camera.next_tracking()).unwrap().is_some());
        line.assert_finished();
    }

    fn a_stream_stops_with_and_without_an_acknowledgement<D>() {
        for reply in [":", "ACK\r:", "44 60\r:", "T 44 6:"] {
            let script = Script::idle()
                .on("TC\r", format!("ACK\r{HERE}"))
                .on("\r", reply)
                .on("\r", "ACK\r:")
                .on("NF 3\r", "ACK\r:");
            let (mut camera, line) = script.camera();
            D::drive(camera.stream(Command::TrackColour(None))).unwrap();
            D::drive(camera.next_tracking()).unwrap();
            D::drive(camera.stop()).unwrap();
            D::drive(camera.set(Command::NoiseFilter(3))).unwrap();
            line.assert_finished();
            assert_eq!(camera.session().restarts(), 0);
        }
    }

    fn a_frame_that_cannot_be_stopped_is_drained<D>() {
        // 58 is the prompt: each pixel looks like one.
        let rest = vec![58; 3_000];
        let script = Script::idle()
            .on("SF\r", [&b"ACK\r\x01\x58\x8F\x02"[..], &[58; 500]].concat())
            .on("\r", [&rest[..], b"\x03:"].concat())
            .on("\r", "ACK\r:")
            .on("NF 3\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        let mut row = [0; 264];
        D::drive(camera.stream(Command::SendFrame(None))).unwrap();
        D::drive(camera.next_part(&mut row)).unwrap();
        D::drive(camera.next_part(&mut row)).unwrap();
        D::drive(camera.set(Command::NoiseFilter(3))).unwrap();
        line.assert_finished();
    }

    fn sleep_with_and_without_a_prompt<D>() {
        for reply in ["ACK\r", "ACK\r:"] {
            let script = Script::idle()
                .on("SD\r", reply)
                .on("\r", "ACK\r:").on("\r", "ACK\r:")
                .on("GB\r", "ACK\r0\r:");
            let (mut camera, line) = script.camera();
            D::drive(camera.set(Command::DeepSleep)).unwrap();
            assert_eq!(D::drive(camera.command(Command::GetButton)), Ok(Answer::Values([0; 6])));
            line.assert_finished();
        }
    }

    fn an_upload_is_acknowledged_before_or_after_its_bytes<D>() {
        let blocks = [100; 64];
        let before = Script::idle().on("UD\r", "ACK\r").on_bytes(&blocks, ":");
        let after = Script::idle().on("UD\r", "").on_bytes(&blocks, "ACK\r:");
        for script in [before, after] {
            let (mut camera, line) = script.chunk(64).camera();
            D::drive(camera.upload_difference(&blocks)).unwrap();
            line.assert_finished();
        }
    }

    fn raw_statistics_values_and_tracking<D>() {
        let script = Script::idle()
            .on("RM 1\r", "ACK\r:")
            .on("GS 0\r", b"ACK\r\xFF\x80:")
            .on("PM 1\r", "ACK\r:")
            .on("GM\r", b"ACK\r\xFFS\xC8\x64\x1E\x09\x09\x09:")
            .on("TC\r", b"ACK\r\xFFT\x2C\x3C\x1E\x32\x3A\x46\x19\x5A:");
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::RawMode(RawMode::OUTPUT))).unwrap();
        assert_eq!(D::drive(camera.command(Command::GetServo(cmucam2_driver::servo::Servo::PAN))), Ok(Answer::Values([128, 0, 0, 0, 0, 0])));
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        let Ok(Answer::Packet(Packet::Statistics(statistics))) = D::drive(camera.command(Command::GetMean)) else {
            panic!("no S packet");
        };
        assert_eq!(statistics.mean().unwrap().red, 200);
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
        assert_eq!(tracking.centroid(), Some((44, 60)));
        line.assert_finished();
    }
}
