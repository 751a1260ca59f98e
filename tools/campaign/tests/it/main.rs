//! Tests of `campaign` through what it offers, one program.

mod known_faults;
