//! Keys, pages and boards, by the commands that users type.
#![cfg(unix)]

mod flash;
mod place;
mod provision;
mod site;
