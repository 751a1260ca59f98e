//! Tests of `calib-core` through what it offers, one program.

mod alternative;
mod intersection;
mod joint;
mod lens;
mod level;
mod place;
mod pose;
mod reference;
mod resection;
mod scene;
mod serde;
mod space;
mod status;
mod thesis;
mod track;
mod tracking;
mod two_cameras;
mod walk;
