//! Everything that was set is set again, and a call that is abandoned does no harm.

use crate::{command::named, common};

use std::{
    future::Future,
    pin::pin,
    task::{Context, Waker},
};

use cmucam2_driver::{
    Command,
    register::{Register, Registers},
    session::{Answer, Fault, Policy, Request, Session},
};
use common::{Async, Drive, Script};

const BANNER: &str = "CMUcam2 v1.01 c6\r:";

/// Each mode there is but the registers, in another state than after a reset, in the order in which they are set again.
const MODES: &str = "CT 1,HR 1,DS 2 4,VW 1 2 88 143,BM 1,DC 2,DM 255,HD 1,HC 1 2,HT 1,FS 1,L0 2,L1 1,LM 0 2,LM 1 1,\
                     NF 2,OM 0 3,OM 1 63,PD 1,PF 1,PM 1,PS 9,SP 16 8 20 12 6 10,SM 11,SV 0 128,SV 1 46,SV 2 210,SV 3 99,\
                     SO 4 1,ST 170 230 70 130 16 46,TI 1,CP 0,RM 1";

fn modes() -> Vec<Command> {
    let mut all: Vec<_> = MODES.split(',').map(named).collect();
    let registers = [registers(0..5), registers(5..10)];
    all.splice(1..1, registers.map(Command::Registers));
    all
}

fn registers(numbers: std::ops::Range<u8>) -> Registers {
    let pairs: Vec<_> = numbers
        .map(|number| Register(number).with(number + 100))
        .collect();
    Registers::new(&pairs).unwrap()
}

/// A camera that acknowledges all, and the lines that it got.
fn drive(session: &mut Session, request: Request, now: &mut u64) -> (Answer, Vec<String>) {
    let mut told = Vec::new();
    session.begin(request, *now);
    loop {
        if let Some(outcome) = session.outcome() {
            return (outcome.unwrap(), told);
        }
        let line = session.pending().to_vec();
        session.sent(line.len());
        let Some(text) = line.strip_suffix(b"\r") else {
            *now = session.deadline().unwrap();
            session.tick(*now);
            continue;
        };
        let reply = match text {
            b"RS" => format!("ACK\r{BANNER}"),
            _ => "ACK\r:".to_owned(),
        };
        if !text.is_empty() {
            told.push(String::from_utf8(text.to_vec()).unwrap());
        }
        for byte in reply.bytes() {
            session.receive(byte, *now, &mut []);
        }
    }
}

#[test]
fn every_mode_is_set_again_once_and_in_an_order_that_works() {
    let mut session = Session::new(Policy::default());
    let mut now = 0;
    // Set in the opposite order, and each twice: it is the state that counts, not the history.
    for command in modes().into_iter().rev().chain(modes().into_iter().rev()) {
        drive(&mut session, Request::Do(command.into()), &mut now);
    }
    let (_, told) = drive(&mut session, Request::Recover, &mut now);
    let mut expected = modes();
    expected.insert(0, Command::Reset);
    // Registers come in the order in which they were first set.
    expected.swap(2, 3);
    let line = |command: &Command| {
        let line = command.line();
        String::from_utf8_lossy(line.as_bytes())
            .trim_end()
            .to_owned()
    };
    assert_eq!(told, expected.iter().map(line).collect::<Vec<_>>());

    // After a reset that was asked for there is nothing to restore.
    drive(&mut session, Request::Do(Command::Reset.into()), &mut now);
    let (_, told) = drive(&mut session, Request::Recover, &mut now);
    assert_eq!(told, ["RS"]);
}

#[test]
fn more_registers_than_can_be_remembered_are_refused_before_anything_is_sent() {
    let mut session = Session::new(Policy::default());
    let mut now = 0;
    for numbers in [0..5, 5..10] {
        let command = Command::Registers(registers(numbers));
        drive(&mut session, Request::Do(command.into()), &mut now);
    }
    session.begin(
        Request::Do(Command::Registers(registers(10..11)).into()),
        now,
    );
    assert_eq!(session.outcome(), Some(Err(Fault::TooManyRegisters)));
    assert!(session.pending().is_empty());
    // A known one may change, and the defaults make room.
    for command in [
        Command::Registers(registers(9..10)),
        Command::Registers(Registers::DEFAULTS),
        Command::Registers(registers(10..15)),
    ] {
        drive(&mut session, Request::Do(command.into()), &mut now);
    }
    assert_eq!(session.modes().register(Register(10)), Some(110));
    assert_eq!(session.modes().register(Register(0)), None);
}

#[test]
fn a_future_that_is_dropped_leaves_a_camera_that_the_next_call_can_use() {
    let whole = Script::idle().on("GI\r", "ACK\r7\r:");
    let (mut camera, line) = whole.camera();
    assert_eq!(
        Async::drive(camera.command(Command::GetInputs)),
        Ok(Answer::Values([7, 0, 0, 0, 0, 0]))
    );
    line.assert_finished();
    // Dropped after ever more polls: in the middle of writing, of waiting, of reading.
    for polls in 0..60 {
        let script = Script::idle().chunk(1);
        let (mut camera, line) = script.camera();
        {
            let mut future = pin!(camera.command(Command::GetInputs).run());
            let mut context = Context::from_waker(Waker::noop());
            for _ in 0..polls {
                assert!(future.as_mut().poll(&mut context).is_pending());
                if line.transcript().ends_with("\r\r") {
                    break;
                }
            }
        }
        // The camera, whatever it heard, is idle and says so.
        line.replace(Script::idle().on("NF 3\r", "ACK\r:"));
        Async::drive(camera.set(Command::NoiseFilter(3))).unwrap();
        line.assert_finished();
    }
}

#[test]
fn the_reply_to_an_abandoned_command_is_not_taken_for_that_of_the_next() {
    let script = Script::idle()
        .on("NF 3\r", "ACK\r:")
        .on("GI\r", "ACK\r7\r:")
        .on("\r", "ACK\r:")
        .on("\r", "ACK\r:")
        .on("GI\r", "ACK\r9\r:");
    let (mut camera, line) = script.camera();
    Async::drive(camera.set(Command::NoiseFilter(3))).unwrap();
    {
        let mut future = pin!(camera.command(Command::GetInputs).run());
        let mut context = Context::from_waker(Waker::noop());
        while !line.transcript().ends_with("GI\r") {
            assert!(future.as_mut().poll(&mut context).is_pending());
        }
    }
    assert_eq!(
        Async::drive(camera.command(Command::GetInputs)),
        Ok(Answer::Values([9, 0, 0, 0, 0, 0]))
    );
    line.assert_finished();
}
