//! The driver's [`Session`](cmucam2_driver::session::Session) and the camera of `cmucam2-emulator`
//! on one line, in virtual time: for tests and measurements. The two share no code, so this is
//! where they meet.

mod link;
pub mod measure;

pub use link::Link;
