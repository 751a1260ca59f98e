//! Only the parts that every image has.
#![cfg_attr(target_os = "none", no_std, no_main)]

bench_size::image!(bench_size::task::empty);
