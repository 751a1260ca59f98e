//! One target under libFuzzer. `cargo xtask fuzz` builds this with the flags that libFuzzer needs.

#![cfg_attr(fuzzing, no_main)]

#[cfg(fuzzing)]
mod fuzzed {
    use std::{env, sync::LazyLock};

    use fuzz::{Target, target};

    /// The target that the environment names.
    static TARGET: LazyLock<&'static Target> = LazyLock::new(|| {
        let name = env::var("FUZZ_TARGET").unwrap_or_default();
        target(&name).unwrap_or_else(|| panic!("FUZZ_TARGET names no target: `{name}`"))
    });

    libfuzzer_sys::fuzz_target!(|input: &[u8]| (TARGET.run)(input));
}

#[cfg(not(fuzzing))]
fn main() -> std::process::ExitCode {
    eprintln!("libFuzzer is not built in: type `cargo xtask fuzz`");
    std::process::ExitCode::FAILURE
}
