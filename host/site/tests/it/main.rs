//! Tests of the public interface of `site`, one program.

mod docs;
mod planned_accuracy;
mod scenario;
mod site_file;
mod world;
