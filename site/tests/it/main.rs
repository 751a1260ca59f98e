//! Tests of `site` through what it offers, one program.

mod docs;
mod planned_accuracy;
mod scenario;
mod site_file;
mod world;
