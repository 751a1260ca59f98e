use std::{collections::VecDeque, pin::pin, task::Context, vec::Vec};

use calib_core::camera::Camera;
use cmucam2_driver::packet::Tracking;
use core::task::{Poll, Waker};

use super::*;
use crate::vision::{Grid, LearntColour, Lens};

fn lens() -> Camera<f32> {
    Lens::pin_hole(88, 45.0).camera().unwrap()
}

fn at(column: u8) -> Option<Blob> {
    let packet = Tracking::new([column, 70, column - 4, 60, column + 4, 80, 20, 201]);
    Blob::from_tracking(&packet, Grid::pixels(0, 143))
}

fn clipped() -> Option<Blob> {
    let packet = Tracking::new([3, 70, 0, 60, 6, 80, 20, 201]);
    Blob::from_tracking(&packet, Grid::pixels(0, 143))
}

/// The look, and the number of its frames.
fn judge(blobs: impl IntoIterator<Item = Option<Blob>>) -> (Look, usize) {
    let mut judge = Judge::new(lens(), Patience::default(), Shape::Any);
    let mut blobs = blobs.into_iter().enumerate();
    blobs
        .find_map(|(n, blob)| Some((judge.push(blob)?, n + 1)))
        .unwrap()
}

#[test]
fn five_frames_are_a_look() {
    let (look, frames) = judge([at(43); 9]);
    let Look::Steady(seen) = look else {
        panic!("{look:?}")
    };
    assert_eq!(frames, 5);
    // Half a column left of the axis; sqrt(1/24 + 0.05^2) columns.
    let column = 22.5_f32.to_radians().tan() / 43.5;
    assert!((seen.bearing - 0.5 * column).abs() < 1e-4);
    assert!(
        (seen.sigma / column - 0.2102).abs() < 2e-3,
        "{}",
        seen.sigma / column
    );
}

#[test]
fn what_will_not_change_is_told_at_once() {
    assert_eq!(judge([None; 9]), (Look::Nothing, 5));
    assert_eq!(judge([clipped(); 9]), (Look::Clipped, 5));
    // The flicker of a frame costs four more.
    let flicker = [at(43), at(43), None, at(43), at(43), at(43), at(43), at(43)];
    assert!(matches!(judge(flicker), (Look::Steady(_), 8)));
    let comes_in = [None, None, None, None].into_iter().chain([at(43); 9]);
    assert!(matches!(judge(comes_in), (Look::Steady(_), 9)));
}

#[test]
fn a_look_ends() {
    let moving = (10..70).map(at);
    assert_eq!(judge(moving), (Look::Unsteady, 20));
    let flickers = (0..60).map(|n| if n % 3 == 0 { None } else { at(43) });
    assert_eq!(judge(flickers), (Look::Unsteady, 20));
    let merged = Tracking::new([34, 70, 30, 60, 49, 80, 20, 90]);
    let merged = Blob::from_tracking(&merged, Grid::pixels(0, 143));
    assert_eq!(judge([merged; 60]), (Look::Lopsided, 20));
    // Fewer frames at most than must agree: those that must agree.
    let patience = Patience {
        frames: 9,
        frames_most: 1,
        ..Patience::default()
    };
    let mut hasty = Judge::new(lens(), patience, Shape::Any);
    let looks: Vec<_> = (0..9).map(|_| hasty.push(at(43))).collect();
    assert!(looks[..8].iter().all(Option::is_none) && looks[8].is_some());
}

#[test]
fn a_judge_forgets_the_look_before() {
    let mut judge = Judge::new(lens(), Patience::default(), Shape::Any);
    for _ in 0..4 {
        assert_eq!(judge.push(at(43)), None);
    }
    judge.clear();
    assert_eq!(judge.push(at(43)), None);
}

/// A camera that plays a script and notes what it is asked.
#[derive(Default)]
struct Script {
    frames: VecDeque<Result<Option<Blob>, VisionError>>,
    asked: Vec<&'static str>,
}

impl BlobCamera for Script {
    async fn start_up(&mut self) -> Result<(), VisionError> {
        self.asked.push("start up");
        Ok(())
    }
    async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
        unreachable!()
    }
    async fn learn_background(&mut self) -> Result<(), VisionError> {
        unreachable!()
    }
    async fn begin(&mut self, _: Subject) -> Result<(), VisionError> {
        self.asked.push("begin");
        Ok(())
    }
    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        self.frames.pop_front().unwrap()
    }
    async fn end(&mut self) -> Result<(), VisionError> {
        self.asked.push("end");
        Ok(())
    }
}

fn look_at(
    subject: Subject,
    frames: impl IntoIterator<Item = Result<Option<Blob>, VisionError>>,
) -> (Result<Look, VisionError>, Vec<&'static str>) {
    let mut script = Script {
        frames: frames.into_iter().collect(),
        ..Script::default()
    };
    let mut judge = Judge::new(lens(), Patience::default(), Shape::Any);
    let result = {
        let mut future = pin!(look(&mut script, subject, &mut judge));
        match future
            .as_mut()
            .poll(&mut Context::from_waker(Waker::noop()))
        {
            Poll::Ready(result) => result,
            Poll::Pending => panic!("the script never waits"),
        }
    };
    (result, script.asked)
}

const COLOUR: Subject = Subject::Colour(crate::config::examples::ORANGE);

/// That takes long, and loses a background: the caller of the look decides.
#[test]
fn a_look_does_not_start_the_camera_up() {
    let (result, asked) = look_at(COLOUR, [Ok(at(43)); 5]);
    assert!(matches!(result, Ok(Look::Steady(_))));
    assert_eq!(asked, ["begin", "end"]);
    let motion = Subject::Motion { threshold: 10 };
    for subject in [COLOUR, motion] {
        for error in [
            VisionError::Restarted,
            VisionError::Silent,
            VisionError::Closed,
        ] {
            let frames = [Ok(at(43)); 4].into_iter().chain([Err(error)]);
            let (result, asked) = look_at(subject, frames);
            assert_eq!((result, asked), (Err(error), ["begin"].to_vec()));
        }
    }
}
