//! A line that carries only noise at full speed. Cameras that do not keep to the protocol in other ways are those of
//! the fuzz target `cmucam2_session`.

use cmucam2_driver::{
    Command,
    session::{Fault, Policy, Request, Session},
};

#[test]
fn noise_for_ever_is_garbage_in_bounded_time() {
    for byte in [0x00, b'T', b'\r', b'5', 0xFF, b'A'] {
        let mut session = Session::new(Policy::default());
        let mut now = 0;
        session.begin(Request::Do(Command::GetVersion.into()), now);
        let outcome = loop {
            if let Some(outcome) = session.outcome() {
                break outcome;
            }
            session.sent(session.pending().len());
            now += 87;
            session.receive(byte, now, &mut []);
            session.tick(now);
        };
        assert_eq!(outcome, Err(Fault::Garbage), "{byte}");
        assert!(now < 60_000_000, "{byte}: {now} us");
    }
}
