//! Results of a finished run: record, reports, drawings, exports, comparisons, sweeps.

mod bad_input;
mod check;
mod checked;
mod drawings;
mod exports;
mod foretold;
mod further;
mod kept;
mod networks;
mod outputs;
mod record;
mod reports;
mod rooms;
mod sample;
mod sweep;
