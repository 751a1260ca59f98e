//! Checks that hold for any input of code that reads bytes, frames or files.
//!
//! Each target takes bytes and panics where a promise is broken. They run in two ways:
//!
//! - in every test run, over the corpus and inputs mutated from it (`tests/it.rs`);
//! - guided by coverage, with libFuzzer: `cargo xtask fuzz`.

/// One check of any input.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Name of the target, and of its folder in `corpus`.
    pub name: &'static str,
    /// Tries one input.
    ///
    /// # Panics
    /// A promise is broken.
    pub run: fn(&[u8]),
}

macro_rules! targets {
    ($($name:ident)*) => {
        mod targets {
            $(pub(crate) mod $name;)*
        }

        /// All targets, by name.
        pub const TARGETS: &[Target] = &[
            $(Target { name: stringify!($name), run: targets::$name::run },)*
        ];
    };
}

targets! {
    answers_files
    cmucam2_parser
    cmucam2_session
    config_page
    console_line
    flash_log_open
    inertial_session
    link_node
    link_security
    link_spinel
    link_wire
    node_roles
    pixy_session
    pixy_stream
    radio_update
    site_file
}

/// Returns the target of this name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}
