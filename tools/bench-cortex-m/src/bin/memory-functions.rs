//! Checks that `memory-functions` does what the C standard and the Run-time ABI ask, on an emulated Cortex-M4:
//! `cargo xtask cortex-m` runs it.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod on_board {
    #![allow(unsafe_code, reason = "what is tested takes pointers")]

    use core::{ffi::c_void, hint::black_box, panic::PanicInfo};

    use cortex_m as _;
    use cortex_m_semihosting::{debug, hprintln};
    use memory_functions as _;

    unsafe extern "C" {
        fn memcpy(to: *mut c_void, from: *const c_void, bytes: usize) -> *mut c_void;
        fn memmove(to: *mut c_void, from: *const c_void, bytes: usize) -> *mut c_void;
        fn memset(to: *mut c_void, value: i32, bytes: usize) -> *mut c_void;
        fn memcmp(one: *const c_void, other: *const c_void, bytes: usize) -> i32;
        fn __aeabi_memset(to: *mut c_void, bytes: usize, value: i32);
        fn __aeabi_memclr(to: *mut c_void, bytes: usize);
    }

    /// Longest block, and bytes in which it may start before or behind the middle.
    const LONGEST: usize = 23;
    const AROUND: usize = 9;
    const LEN: usize = LONGEST + 4 * AROUND;

    type Memory = [u8; LEN];

    fn filled() -> Memory {
        core::array::from_fn(|i| black_box(i as u8 * 37 + 200))
    }

    /// Byte by byte, which the compiler cannot tell from anything else.
    fn expect(memory: &Memory, expected: impl Fn(usize) -> u8, what: &str, at: [usize; 3]) {
        for (i, byte) in memory.iter().enumerate() {
            let expected = black_box(expected(i));
            assert_eq!(*black_box(byte), expected, "{what} {at:?}, byte {i}");
        }
    }

    fn copies(at @ [to, from, bytes]: [usize; 3]) {
        let old = filled();
        let mut memory = old;
        let start = memory.as_mut_ptr();
        let copied = |i: usize| {
            if i.wrapping_sub(to) < bytes {
                old[from + i - to]
            } else {
                old[i]
            }
        };
        // SAFETY: both blocks are within `memory`; what they share, `memmove` may have.
        let result = unsafe { memmove(start.add(to).cast(), start.add(from).cast(), bytes) };
        assert_eq!(result, start.wrapping_add(to).cast());
        expect(&memory, copied, "memmove", at);
        let mut memory = old;
        let start = memory.as_mut_ptr();
        // SAFETY: both blocks are within an array, each in its own.
        let result = unsafe { memcpy(start.add(to).cast(), old.as_ptr().add(from).cast(), bytes) };
        assert_eq!(result, start.wrapping_add(to).cast());
        expect(&memory, copied, "memcpy", at);
    }

    fn sets(at @ [to, _, bytes]: [usize; 3]) {
        let old = filled();
        for value in [0, 1, 0x80, -1, 0x1234] {
            let set = |i: usize| {
                if i.wrapping_sub(to) < bytes {
                    value as u8
                } else {
                    old[i]
                }
            };
            let mut memory = old;
            let place = memory.as_mut_ptr().wrapping_add(to).cast();
            // SAFETY: the block is within the array.
            assert_eq!(unsafe { memset(place, value, bytes) }, place);
            expect(&memory, set, "memset", at);
            let mut memory = old;
            let place = memory.as_mut_ptr().wrapping_add(to).cast();
            // SAFETY: the block is within the array.
            unsafe { __aeabi_memset(place, bytes, value) };
            expect(&memory, set, "__aeabi_memset", at);
        }
        let mut memory = old;
        let place = memory.as_mut_ptr().wrapping_add(to).cast();
        // SAFETY: the block is within the array.
        unsafe { __aeabi_memclr(place, bytes) };
        let cleared = |i: usize| {
            if i.wrapping_sub(to) < bytes {
                0
            } else {
                old[i]
            }
        };
        expect(&memory, cleared, "__aeabi_memclr", at);
    }

    fn compares([to, from, bytes]: [usize; 3]) {
        let one = filled();
        let mut other = [0; LEN];
        // Byte by byte: copying a slice is what is under test.
        #[expect(clippy::manual_memcpy)]
        for i in 0..bytes {
            other[from + i] = one[to + i];
        }
        let compare = |other: &Memory| {
            let [one, other] = [
                one.as_ptr().wrapping_add(to),
                other.as_ptr().wrapping_add(from),
            ];
            // SAFETY: both blocks are within an array.
            unsafe { memcmp(one.cast(), other.cast(), bytes) }
        };
        assert_eq!(compare(&other), 0);
        for i in 0..bytes {
            for change in [1, 0x80] {
                let mut changed = other;
                changed[from + i] ^= change;
                let expected = one[to + i].cmp(&changed[from + i]);
                assert_eq!(compare(&changed).cmp(&0), expected, "byte {i} of {bytes}");
            }
        }
    }

    /// Quotient and remainder are right if they give the dividend, and the remainder is less than the divisor.
    fn divides(dividend: u64, divisor: u64) {
        let (n, d) = (black_box(dividend), black_box(divisor));
        let (quotient, rest) = (n / d, n % d);
        let product = quotient.checked_mul(d);
        let whole = product.and_then(|product| product.checked_add(rest));
        assert!(
            rest < d && whole == Some(n),
            "{dividend:x} by {divisor:x}: {quotient:x}, {rest:x}"
        );
    }

    /// All ones and a single one of each length, their neighbours, and what lies between.
    fn numbers() -> impl Iterator<Item = u64> {
        (0..64).flat_map(|bits| {
            let power = 1_u64 << bits;
            let between = 0x9e37_79b9_7f4a_7c15_u64.rotate_left(bits) >> (63 - bits);
            [power - 1, power, power + 1, between, u64::MAX - power]
        })
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        for dividend in numbers() {
            for divisor in numbers().filter(|divisor| *divisor > 0) {
                divides(dividend, divisor);
            }
        }
        for bytes in 0..=LONGEST {
            for to in 0..=2 * AROUND {
                for from in 0..=2 * AROUND {
                    let at = [to, from, bytes];
                    copies(at);
                    if to < 4 && from < 4 {
                        sets(at);
                        compares(at);
                    }
                }
            }
        }
        loop {
            debug::exit(debug::EXIT_SUCCESS);
        }
    }

    #[panic_handler]
    fn panic(info: &PanicInfo<'_>) -> ! {
        hprintln!("error {}", info);
        loop {
            debug::exit(debug::EXIT_FAILURE);
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this runs on an emulated processor: type `cargo xtask cortex-m`");
    std::process::exit(1);
}
