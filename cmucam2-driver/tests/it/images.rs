//! Frames and line modes through the driver.

use crate::{both, common};

use cmucam2_driver::{
    Command, Error, Packet,
    colour::ColourChannel,
    command::{LedMode, LineMode, StatisticsLines, TrackingLines},
    packet::Tracking,
    parser::{ImageHeader, ImageKind},
    session::{Answer, Fault},
};
use common::{Async, Blocking, Drive, Overrun, Script};

const T: &str = "T 2 1 1 1 3 2 1 100\r";

fn here() -> Packet {
    Packet::Tracking(Tracking::new([2, 1, 1, 1, 3, 2, 1, 100]))
}

fn frame(rows: &[&[u8]]) -> Vec<u8> {
    let mut bytes = vec![1, 3, 2];
    for row in rows {
        bytes.push(2);
        bytes.extend_from_slice(row);
    }
    bytes.push(3);
    bytes
}

fn ack(bytes: &[&[u8]]) -> Vec<u8> {
    [&b"ACK\r"[..], &bytes.concat()].concat()
}

const INTACT: Answer = Answer::Row {
    bytes: 3,
    intact: true,
};

both! {
    fn a_frame_needs_room_for_a_row_only<D>() {
        let colour = [100_u8; 9];
        let script = Script::idle()
            .on("SF\r", ack(&[&frame(&[&colour, &colour]), b":"]))
            .on("GB\r", "ACK\r0\r:");
        let (mut camera, line) = script.camera();
        D::drive(camera.stream(Command::SendFrame(None))).unwrap();
        let mut small = [0; 8];
        let header = D::drive(camera.next_part(&mut small)).unwrap();
        assert!(matches!(header, Answer::Header(ImageHeader { row_bytes: 9, .. })));
        let refused = D::drive(camera.next_part(&mut small));
        assert_eq!(refused, Err(Error::Camera(Fault::RowBuffer { needed: 9 })));
        // Nothing is lost by the refusal.
        let mut row = [0; 9];
        for _ in 0..2 {
            let part = D::drive(camera.next_part(&mut row)).unwrap();
            assert_eq!(part, Answer::Row { bytes: 9, intact: true });
            assert_eq!(row, colour);
        }
        let end = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(end, Answer::End { rows: 2, intact: true });
        D::drive(camera.command(Command::GetButton)).unwrap();
        let over = D::drive(camera.next_part(&mut row));
        assert_eq!(over, Err(Error::Camera(Fault::NotStreaming)));
        line.assert_finished();
    }

    fn a_damaged_row_is_told_and_the_next_one_is_whole<D>() {
        let rows = frame(&[&[20, 30], &[40, 50, 60]]);
        let (mut camera, _) = Script::idle().on("SF 1\r", ack(&[&rows, b":"])).camera();
        let mut row = [0; 3];
        D::drive(camera.stream(Command::SendFrame(Some(ColourChannel::Green)))).unwrap();
        D::drive(camera.next_part(&mut row)).unwrap();
        let cut = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(cut, Answer::Row { bytes: 2, intact: false });
        assert_eq!(D::drive(camera.next_part(&mut row)), Ok(INTACT));
        assert_eq!(row, [40, 50, 60]);
        let end = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(end, Answer::End { rows: 2, intact: false });
    }

    fn a_frame_that_breaks_off_is_an_error_and_the_camera_is_usable<D>() {
        let script = Script::idle()
            .on("SF 1\r", ack(&[&[1, 3, 2, 2, 20, 30]]))
            .on("\r", "ACK\r:").on("\r", "ACK\r:")
            .on("L0 1\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        let mut row = [0; 3];
        D::drive(camera.stream(Command::SendFrame(Some(ColourChannel::Green)))).unwrap();
        D::drive(camera.next_part(&mut row)).unwrap();
        let result = D::drive(camera.next_part(&mut row));
        assert_eq!(result, Err(Error::Camera(Fault::Garbage)));
        D::drive(camera.set(Command::Led0(LedMode::On))).unwrap();
        line.assert_finished();
    }

    fn a_restart_within_a_frame_restores_the_modes<D>() {
        let script = Script::idle()
            .on("NF 5\r", "ACK\r:")
            .on("SF 1\r", ack(&[&[1, 3, 2, 2, 20, 30], b"CMUcam2 v1.01 c6\r:"]))
            .on("NF 5\r", "ACK\r:");
        let (mut camera, line) = script.camera();
        let mut row = [0; 3];
        D::drive(camera.set(Command::NoiseFilter(5))).unwrap();
        D::drive(camera.stream(Command::SendFrame(Some(ColourChannel::Green)))).unwrap();
        D::drive(camera.next_part(&mut row)).unwrap();
        // The beginning of the banner looks like pixels.
        let mut result = D::drive(camera.next_part(&mut row));
        while result.is_ok() {
            result = D::drive(camera.next_part(&mut row));
        }
        assert_eq!(result, Err(Error::Camera(Fault::Restarted)));
        line.assert_finished();
    }

    fn frames_follow_each_other_until_they_are_stopped<D>() {
        let one = frame(&[&[20, 30, 40], &[50, 60, 70]]);
        let script = Script::idle()
            .on("FS 1\r", "ACK\r:")
            .on("SF 0\r", ack(&[&one, &one, &one[..6]]))
            .stopped();
        let (mut camera, line) = script.camera();
        let mut row = [0; 3];
        D::drive(camera.set(Command::FrameStream(true))).unwrap();
        D::drive(camera.stream(Command::SendFrame(Some(ColourChannel::Red)))).unwrap();
        for _ in 0..2 {
            assert!(matches!(D::drive(camera.next_part(&mut row)), Ok(Answer::Header(_))));
            assert_eq!(D::drive(camera.next_part(&mut row)), Ok(INTACT));
            assert_eq!(D::drive(camera.next_part(&mut row)), Ok(INTACT));
            let end = D::drive(camera.next_part(&mut row)).unwrap();
            assert_eq!(end, Answer::End { rows: 2, intact: true });
        }
        D::drive(camera.stop()).unwrap();
        line.assert_finished();
    }

    fn a_bitmap_before_each_packet_is_read_or_skipped<D>() {
        let bitmap: &[u8] = &[0xAA, 3, 2, 0b1110_0000, 0b0100_0000, 0xAA, 0xAA];
        let script = Script::idle()
            .on("LM 0 1\r", "ACK\r:")
            .on("TC\r", ack(&[bitmap, T.as_bytes(), bitmap, T.as_bytes()]));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::LineMode(LineMode::Tracking(TrackingLines::Bitmap)))).unwrap();
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        let mut row = [0; 22];
        let header = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(header, Answer::Header(ImageHeader {
            kind: ImageKind::Bitmap, width: 3, height: 2, row_bytes: 1,
        }));
        for bits in [0b1110_0000, 0b0100_0000] {
            let part = D::drive(camera.next_part(&mut row)).unwrap();
            assert_eq!(part, Answer::Row { bytes: 1, intact: true });
            assert_eq!(row[0], bits);
        }
        let end = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(end, Answer::End { rows: 2, intact: true });
        assert_eq!(D::drive(camera.next_part(&mut row)), Ok(Answer::Packet(here())));
        assert_eq!(D::drive(camera.next_packet()), Ok(Some(here())));
        line.assert_finished();
    }

    fn rows_of_means_in_poll_mode<D>() {
        let means: &[u8] = &[0xFE, 100, 110, 120, 130, 140, 150, 0xFD];
        let script = Script::idle()
            .on("LM 1 1\r", "ACK\r:")
            .on("PM 1\r", "ACK\r:")
            .on("GM\r", ack(&[means, b"S 115 125 135 9 9 9\r:"]))
            .on("GM\r", ack(&[means, b"S 115 125 135 9 9 9\r:"]));
        let (mut camera, line) = script.camera();
        D::drive(camera.set(Command::LineMode(LineMode::Statistics(StatisticsLines::Means)))).unwrap();
        D::drive(camera.set(Command::PollMode(true))).unwrap();
        D::drive(camera.stream(Command::GetMean)).unwrap();
        let mut row = [0; 6];
        assert!(matches!(D::drive(camera.next_part(&mut row)), Ok(Answer::Header(_))));
        for first in [100, 130] {
            assert_eq!(D::drive(camera.next_part(&mut row)), Ok(INTACT));
            assert_eq!(row[0], first);
        }
        let end = D::drive(camera.next_part(&mut row)).unwrap();
        assert_eq!(end, Answer::End { rows: 2, intact: true });
        assert!(matches!(D::drive(camera.next_part(&mut row)), Ok(Answer::Packet(_))));
        // The one-shot query skips them.
        let Ok(Answer::Packet(Packet::Statistics(statistics))) = D::drive(camera.command(Command::GetMean)) else {
            panic!("no S packet");
        };
        assert_eq!(statistics.mean().unwrap().red, 115);
        line.assert_finished();
    }

    fn an_overrun_in_a_stream_costs_a_packet_and_not_the_stream<D>() {
        let script = Script::idle().on("TC\r", ack(&[T.as_bytes()]));
        let (mut camera, line) = script.camera();
        D::drive(camera.stream(Command::TrackColour(None))).unwrap();
        assert!(D::drive(camera.next_packet()).unwrap().is_some());
        line.inject("T 2 1 1");
        line.fail_next_read();
        assert_eq!(D::drive(camera.next_packet()), Err(Error::Uart(Overrun)));
        line.inject(format!(" 1 3\r{T}"));
        assert_eq!(D::drive(camera.next_packet()), Ok(Some(here())));
        line.assert_finished();
    }
}
