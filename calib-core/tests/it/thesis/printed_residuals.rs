//! The six residuals of thesis 2.6.1, as they are in print.
//!
//! Unknowns `x = (theta_0, theta_1, lambda_0^0, lambda_0^1, lambda_1^0, lambda_1^1)`: two headings
//! and the distance from each camera `k` to the target at each stop `n`. With signed offsets and
//! `b_k^n = theta_k + phi_k^n`:
//! ```text
//! r1 = lambda_1^0 sin(b_1^0 - b_0^0) - d sin b_0^0
//! r2 = lambda_0^0 sin(b_1^0 - b_0^0) - d sin b_1^0
//! r3 = lambda_0^1 sin(b_1^1 - b_0^1) - d sin b_1^1
//! r4 = lambda_1^1 sin(b_1^1 - b_0^1) - d sin b_0^1
//! r5 = lambda_0^1 cos b_0^1 - lambda_1^1 cos b_1^1 - lambda_0^0 cos b_0^0 + lambda_1^0 cos b_1^0
//! r6 = the same with sines
//! ```
//! The print has three slips, corrected here: `lambda_0^1` in r2, and `phi_0^1` for `phi_1^1` in
//! r5 and r6.
//!
//! **The Jacobian of these six has rank 4.** r5 and r6 come from adding (3) and (4), from which the
//! displacement cancels, and follow from r1 to r4. Whatever the headings are, distances exist that
//! make all six zero, so (5) inverts a singular matrix and (6) stays where it was started.
//! `reference::solve` uses the displacement instead.

use nalgebra::{Matrix6, Vector6};

/// Inputs of the printed residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Offsets {
    /// `phi_0^0` and `phi_0^1`: camera 0 at both stops, radians, signed.
    pub(crate) camera0: [f64; 2],
    /// `phi_1^0` and `phi_1^1`.
    pub(crate) camera1: [f64; 2],
    /// Distance `d` between the cameras.
    pub(crate) baseline: f64,
}

impl Offsets {
    /// The world bearings `b_0^0, b_0^1, b_1^0, b_1^1`.
    fn bearings(&self, x: &Vector6<f64>) -> [f64; 4] {
        let ([a, b], [c, d]) = (self.camera0, self.camera1);
        [x.x + a, x.x + b, x.y + c, x.y + d]
    }

    /// `(r1, ..., r6)` at `x`.
    pub(crate) fn residuals(&self, x: &Vector6<f64>) -> Vector6<f64> {
        let [b00, b01, b10, b11] = self.bearings(x);
        let (l00, l01, l10, l11) = (x.z, x.w, x.a, x.b);
        let d = self.baseline;
        let apex0 = (b10 - b00).sin();
        let apex1 = (b11 - b01).sin();
        Vector6::new(
            l10 * apex0 - d * b00.sin(),
            l00 * apex0 - d * b10.sin(),
            l01 * apex1 - d * b11.sin(),
            l11 * apex1 - d * b01.sin(),
            l01 * b01.cos() - l11 * b11.cos() - l00 * b00.cos() + l10 * b10.cos(),
            l01 * b01.sin() - l11 * b11.sin() - l00 * b00.sin() + l10 * b10.sin(),
        )
    }

    /// Derivatives of the residuals (rows) by the unknowns (columns). Rank 4 at every solution.
    pub(crate) fn jacobian(&self, x: &Vector6<f64>) -> Matrix6<f64> {
        let [b00, b01, b10, b11] = self.bearings(x);
        let (l00, l01, l10, l11) = (x.z, x.w, x.a, x.b);
        let d = self.baseline;
        let o = 0.0;
        let (s0, c0) = (b10 - b00).sin_cos();
        let (s1, c1) = (b11 - b01).sin_cos();
        let (s00, c00) = b00.sin_cos();
        let (s01, c01) = b01.sin_cos();
        let (s10, c10) = b10.sin_cos();
        let (s11, c11) = b11.sin_cos();
        Matrix6::from_rows(
            &[
                [-l10 * c0 - d * c00, l10 * c0, o, o, s0, o].into(),
                [-l00 * c0, l00 * c0 - d * c10, s0, o, o, o].into(),
                [-l01 * c1, l01 * c1 - d * c11, o, s1, o, o].into(),
                [-l11 * c1 - d * c01, l11 * c1, o, o, o, s1].into(),
                [
                    l00 * s00 - l01 * s01,
                    l11 * s11 - l10 * s10,
                    -c00,
                    c01,
                    c10,
                    -c11,
                ]
                .into(),
                [
                    l01 * c01 - l00 * c00,
                    l10 * c10 - l11 * c11,
                    -s00,
                    s01,
                    s10,
                    -s11,
                ]
                .into(),
            ]
            .map(|row: Vector6<f64>| row.transpose()),
        )
    }
}
