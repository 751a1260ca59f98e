//! The LIS3MDL: a compass.
//!
//! Facts are those of its datasheet, `DocID024204`, by the names of its sections and registers.

/// Bytes of a reading.
pub(super) const DATA: usize = 6;

/// "`CTRL_REG2` (21h)": bit 2 resets.
pub(super) const RESET: [u8; 2] = [0x21, 0x04];

/// After a reset.
pub(super) const SETTINGS: [[u8; 2]; 5] = [
    // "`CTRL_REG1` (20h)": x and y as exact as can be; 20 Hz.
    [0x20, 0x74],
    // "`CTRL_REG2` (21h)": 4 gauss, of which the earth has half of one.
    [0x21, 0x00],
    // "`CTRL_REG4` (23h)": z as exact as can be.
    [0x23, 0x0C],
    // "`CTRL_REG5` (24h)": bit 6, both bytes of a number are of one reading.
    [0x24, 0x40],
    // "`CTRL_REG3` (22h)": it goes on measuring; after a reset it is off.
    [0x22, 0x00],
];

/// Not read in one go with the numbers: reads that pass the last axis begin again at the first.
/// "`STATUS_REG` (27h)": bit 3, all three axes are new.
pub(super) const STATUS: u8 = 0x27;
const NEW: u8 = 0x08;
/// "`OUT_X_L` (28h)" and the five after it. The highest bit makes longer reads go on ("I2C
/// operation").
pub(super) const OUT: u8 = 0x28 | 0x80;
/// "Magnetic characteristics": 6842 a gauss, which is 100 uT.
pub(super) const FIELD: f32 = 100.0 / 6842.0;

/// Returns true if there is a new reading, from the status.
pub(super) const fn is_new(status: u8) -> bool {
    status & NEW != 0
}

/// The least and the most of each axis: when the sensor was turned in all directions, the hard iron
/// is in their middle.
#[derive(Debug)]
pub(super) struct Extent {
    least: [i16; 3],
    most: [i16; 3],
}

impl Default for Extent {
    fn default() -> Self {
        Self {
            least: [i16::MAX; 3],
            most: [i16::MIN; 3],
        }
    }
}

impl Extent {
    pub(super) fn add(&mut self, numbers: [i16; 3]) {
        let limits = self.least.iter_mut().zip(&mut self.most);
        for ((least, most), number) in limits.zip(numbers) {
            *least = number.min(*least);
            *most = number.max(*most);
        }
    }

    /// Its middle, x, y and z, and its half, uT.
    // So that nothing is computed where nothing is logged.
    #[inline(always)]
    pub(super) fn in_ut(&self) -> [[f32; 3]; 2] {
        let ([a, b, c], [x, y, z]) = (self.least, self.most);
        let half = |number: i32| number as f32 * (FIELD / 2.0);
        let axis = |least, most| {
            [
                i32::from(most) + i32::from(least),
                i32::from(most) - i32::from(least),
            ]
            .map(half)
        };
        let [[a, x], [b, y], [c, z]] = [axis(a, x), axis(b, y), axis(c, z)];
        [[a, b, c], [x, y, z]]
    }
}
