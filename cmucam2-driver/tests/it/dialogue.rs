//! Dialogues with a scripted camera, over both traits: those of the files in `dialogues`, and the methods that make
//! types of answers.
//!
//! A dialogue begins with `== name`, and an idle camera unless the next line is `fresh`. Its steps, a line each:
//!
//! | step | |
//! |---|---|
//! | `do COMMAND => ANSWER`, `start COMMAND => ANSWER` | a request, and its outcome; the exchanges that follow are all that it makes |
//! | `set COMMAND` | a mode, which is acknowledged at once |
//! | `next`, `stop`, `recover`, `start-up`, `upload` | the other requests |
//! | `part N` | the next part of an image, with a buffer of so many bytes; a row is told with its bytes |
//! | `learn HOW`, `track HOW` | `window`, or the margin to either side of the mean |
//! | `N STEP` | that step so many times |
//! | `> LINE < BYTES` | an exchange: the line that the camera is sent, and its bytes a millisecond later |
//! | `>> BYTES < BYTES` | the same for bytes that are no line |
//! | `<+MS BYTES` | more bytes, so much later |
//! | `listens`, `stopped` | the exchanges by which an idle and a streaming camera are stopped |
//! | `unplug`, `babble BYTE`, `fail-read`, `inject BYTES` | events on the line |
//! | `is NAME VALUE`, `sent BYTES`, `takes MS MS` | what the session tells, all that was sent, the time of the last request |
//!
//! In bytes `|` is a carriage return, `\NN` a byte, `$N(BYTES)` so many times these; `$here`, `$lost` and `$banner`
//! are the lines below.

use cmucam2_driver::{
    Cmucam2, Command, Error,
    session::{Answer, Fault, Learn, Request, StartUp},
};

use crate::{
    both,
    command::{self, orange},
    common::{Async, Blocking, Drive, MockDelay, MockUart, Overrun, Script},
};

const HERE: &str = "T 44 60 30 50 58 70 25 90|";
const LOST: &str = "T 0 0 0 0 0 0 0 0|";
const BANNER: &str = "CMUcam2 v1.01 c6|:";

/// Bytes as the files tell them.
pub(crate) fn bytes(text: &str) -> Vec<u8> {
    let names = [("$here", HERE), ("$lost", LOST), ("$banner", BANNER)];
    let named = |text: String, (name, line): &(&str, &str)| text.replace(name, line);
    let text = names.iter().fold(text.to_owned(), named);
    let (mut out, mut rest) = (Vec::new(), &text[..]);
    while let Some(first) = rest.bytes().next() {
        rest = &rest[1..];
        match first {
            b'|' => out.push(b'\r'),
            b'\\' => {
                let (digits, after) = rest.split_at(2);
                out.push(u8::from_str_radix(digits, 16).unwrap());
                rest = after;
            }
            b'$' => {
                let (count, after) = rest.split_once('(').unwrap();
                let (repeated, after) = after.split_once(')').unwrap();
                out.extend(bytes(repeated).repeat(count.parse().unwrap()));
                rest = after;
            }
            _ => out.push(first),
        }
    }
    out
}

/// An outcome as the files tell it; packets are told by their lines.
fn told(outcome: Result<Answer, Error<Overrun>>) -> Vec<u8> {
    match outcome {
        Ok(Answer::Packet(packet)) => return packet.line().as_bytes().to_vec(),
        Ok(Answer::Bounds(bounds)) => format!("Bounds {:?}", bounds.values()),
        Ok(answer) => format!("{answer:?}"),
        Err(Error::Camera(Fault::Refused { command })) => {
            format!("Refused {}", command.escape_ascii())
        }
        Err(Error::Camera(Fault::Unexpected { command })) => {
            format!("Unexpected {}", command.escape_ascii())
        }
        Err(Error::Camera(fault)) => format!("{fault:?}"),
        Err(error) => format!("{error:?}"),
    }
    .into_bytes()
}

/// A step that is no exchange, and the number of exchanges until the next one.
struct Step<'a> {
    text: &'a str,
    exchanges: usize,
}

/// The camera's part of a dialogue, and the steps of the host's.
fn read(lines: &[&'static str]) -> (Script, Vec<Step<'static>>) {
    let (mut script, mut steps) = (Script::idle(), Vec::<Step<'_>>::new());
    for &line in lines {
        let (count, line) = match line.split_once(' ') {
            Some((count, line)) if count.parse::<u8>().is_ok() => (count.parse().unwrap(), line),
            _ => (1, line),
        };
        for _ in 0..count {
            let (verb, rest) = line.split_once(' ').unwrap_or((line, ""));
            let (sent, reply) = rest.split_once("< ").unwrap_or((rest, ""));
            let (sent, reply) = (bytes(sent.trim_end()), bytes(reply));
            let exchanges = match verb {
                ">" => {
                    script = script.on_bytes(&[&sent[..], b"\r"].concat(), reply);
                    1
                }
                ">>" => {
                    script = script.on_bytes(&sent, reply);
                    1
                }
                "listens" => {
                    script = script.on("\r", "ACK\r:").on("\r", "ACK\r:");
                    2
                }
                "stopped" => {
                    script = script.stopped();
                    2
                }
                "fresh" => {
                    script = Script::new();
                    0
                }
                _ => {
                    if let Some(after) = verb.strip_prefix("<+") {
                        script = script.then(after.parse::<u64>().unwrap() * 1_000, bytes(rest));
                        continue;
                    }
                    steps.push(Step {
                        text: line,
                        exchanges: 0,
                    });
                    if verb == "set" {
                        script = script.on_bytes(format!("{rest}\r").as_bytes(), "ACK\r:");
                        1
                    } else {
                        0
                    }
                }
            };
            if let Some(step) = steps.last_mut() {
                step.exchanges += exchanges;
            }
        }
    }
    (script, steps)
}

struct Host {
    camera: Cmucam2<MockUart, MockDelay>,
    line: MockUart,
    /// Times at which the last request began and ended.
    times: [u64; 2],
}

impl Host {
    /// The outcome of a request, unless the step is none.
    fn ask<D: Drive>(&mut self, verb: &str, rest: &str) -> Option<Vec<u8>> {
        let how = || match rest {
            "window" => Learn::TrackWindow,
            margin => Learn::Mean {
                window: None,
                margin: margin.parse().unwrap(),
            },
        };
        let track = verb == "track";
        let request = match verb {
            "do" | "set" => Request::Do(command::named(rest).into()),
            "start" => Request::Start(command::named(rest).into()),
            "next" => Request::Next,
            "stop" => Request::Stop,
            "recover" => Request::Recover,
            "start-up" => Request::StartUp(StartUp::default()),
            "learn" | "track" => Request::Learn { how: how(), track },
            "upload" => return Some(told(D::drive(self.camera.upload_difference(&[b'd'; 64])))),
            "part" => {
                let mut row = vec![0; rest.parse().unwrap()];
                let part = D::drive(self.camera.next_part(&mut row));
                let told = told(part);
                return Some(match part {
                    Ok(Answer::Row { bytes, .. }) => {
                        [&told, &b" "[..], &row[..bytes.into()]].concat()
                    }
                    _ => told,
                });
            }
            _ => return None,
        };
        Some(told(D::drive(self.camera.request(request))))
    }

    fn step<D: Drive>(&mut self, step: &str) {
        let (request, expected) = match step.split_once(" => ") {
            Some((request, expected)) => (request, bytes(expected)),
            None => (step, b"Done".to_vec()),
        };
        let (verb, rest) = request.split_once(' ').unwrap_or((request, ""));
        let begun = self.line.now();
        if let Some(outcome) = self.ask::<D>(verb, rest) {
            let [outcome, expected] = [outcome, expected].map(|it| it.escape_ascii().to_string());
            assert_eq!(outcome, expected);
            self.times = [begun, self.line.now()];
            return;
        }
        match verb {
            "unplug" => self.line.unplug(),
            "babble" => self.line.babble(bytes(rest)[0]),
            "fail-read" => self.line.fail_next_read(),
            "inject" => self.line.inject(bytes(rest)),
            "sent" => assert_eq!(self.line.transcript().as_bytes(), bytes(rest)),
            "takes" => {
                let [from, to] = self.times.map(|at| at / 1_000);
                let (least, most) = rest.split_once(' ').unwrap();
                let limits = least.parse::<u64>().unwrap()..most.parse().unwrap();
                assert!(limits.contains(&(to - from)), "{} ms", to - from);
            }
            "is" => {
                let (name, value) = rest.split_once(' ').unwrap();
                assert_eq!(self.value(name), value, "{name}");
            }
            _ => panic!("no such step"),
        }
    }

    fn value(&self, name: &str) -> String {
        let session = self.camera.session();
        match name {
            "retries" => session.retries().to_string(),
            "restarts" => session.restarts().to_string(),
            "cut" => session.dropped().cut.to_string(),
            "drops" => (session.dropped().bytes > 0).to_string(),
            "polled" => session.modes().poll().to_string(),
            "window" => format!("{:?}", session.modes().window()),
            "frame" => format!("{} {}", session.frame().width, session.frame().height),
            _ => panic!("nothing is called {name}"),
        }
    }
}

/// Plays all dialogues of a file. A failure is told with those that went well before it.
fn play<D: Drive>(file: &'static str) {
    for dialogue in file.split("== ").skip(1) {
        let lines = dialogue.lines().filter(|line| !line.starts_with('#'));
        let lines: Vec<_> = lines.filter(|line| !line.is_empty()).collect();
        println!("{}", lines[0]);
        let (script, steps) = read(&lines[1..]);
        let (camera, line) = script.camera();
        let mut host = Host {
            camera,
            line,
            times: [0; 2],
        };
        let mut left: usize = steps.iter().map(|step| step.exchanges).sum();
        for step in steps {
            println!("  {}", step.text);
            host.step::<D>(step.text);
            left -= step.exchanges;
            // The first exchanges are those of an idle camera.
            if host.times[1] > 0 {
                assert_eq!(host.line.left(), left);
            }
        }
        host.line.assert_finished();
    }
}

both! {
    fn requests<D>() {
        play::<D>(include_str!("dialogues/requests.txt"));
    }

    fn images<D>() {
        play::<D>(include_str!("dialogues/images.txt"));
    }

    fn start_up<D>() {
        play::<D>(include_str!("dialogues/start_up.txt"));
    }

    fn open_points<D>() {
        play::<D>(include_str!("dialogues/open_points.txt"));
    }

    fn tracks_a_colour<D>() {
        let seen = "T 44 60 30 50 58 70 25 90\rT 0 0 0 0 0 0 0 0\r";
        let script = Script::idle().on("TC 170 230 70 130 16 46\r", format!("ACK\r{seen}"));
        let (mut camera, line) = script.camera();
        D::drive(camera.track_colour(orange())).unwrap();
        let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
        assert_eq!(tracking.centroid(), Some((44, 60)));
        assert_eq!(tracking.confidence(), Some(90));
        let tracking = D::drive(camera.next_tracking()).unwrap().unwrap();
        assert!(tracking.is_lost());
        assert_eq!(tracking.centroid(), None);
        line.assert_finished();
        assert_eq!(camera.session().retries(), 0);
    }

    /// The line is good, so the baud rate is: the camera sent something else than it was asked for.
    fn an_answer_of_another_kind_is_no_garbage<D>() {
        let unexpected = |command| Error::Camera(Fault::Unexpected { command });
        // A stream of one kind that is read as another.
        let (mut camera, _line) = Script::idle().on("GM\r", "ACK\rS 1 2 3 4 5 6\r").camera();
        D::drive(camera.stream(Command::GetMean)).unwrap();
        assert_eq!(D::drive(camera.next_tracking()), Err(unexpected(*b"GM")));
        // Bounds that are none, in either order.
        let (mut camera, _line) = Script::idle().on("GT\r", "ACK\r240 16 0 3 2 1\r:").camera();
        assert_eq!(D::drive(camera.tracking_bounds()), Err(unexpected(*b"GT")));
        let text = unexpected(*b"GT").to_string();
        assert!(text.contains("GT") && !text.contains("baud"), "{text}");
    }

    fn answers_are_types<D>() {
        let script = Script::idle()
            .on("GV\r", "ACK\rCMUcam2 v1.01 c6\r:")
            .on("GT\r", "ACK\r170 230 70 130 16 46\r:")
            .on("GT\r", "ACK\r170 70 16 230 130 46\r:")
            .on("TW\r", "ACK\rT 44 60 30 50 58 70 25 90\r")
            .stopped()
            .on("GT\r", "ACK\r170 230 70 130 16 46\r:");
        let (mut camera, line) = script.camera();
        assert_eq!(D::drive(camera.version()).unwrap().banner().as_bytes(), b"CMUcam2 v1.01 c6");
        for _ in 0..2 {
            assert_eq!(D::drive(camera.tracking_bounds()), Ok(orange()));
        }
        assert_eq!(D::drive(camera.learn(Learn::default())), Ok(orange()));
        line.assert_finished();
    }
}

#[test]
fn the_driver_fits_into_half_a_kilobyte() {
    let bytes = size_of::<Cmucam2<(), ()>>();
    println!("{bytes} bytes");
    assert!(bytes <= 512, "{bytes}");
}
