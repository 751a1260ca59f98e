//! Tests of `pixy2-driver` through what it offers, one program.

mod session;
