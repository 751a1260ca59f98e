//! As much of the Thumb-2 instruction set as tells who calls whom and how much stack it takes
//! (ARM v7-M Architecture Reference Manual, A5 to A7).

/// What an instruction does, as far as it matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effect {
    /// Calls, or jumps to, this address.
    Goes(u32),
    /// Calls, or jumps to, an address in a register.
    GoesSomewhere,
    /// Takes so many bytes of the stack.
    Pushes(u32),
    /// Puts an address, or another constant of 32 bits, in a register.
    Holds(u32),
}

/// Decodes one instruction after the other.
#[derive(Debug, Default)]
pub(super) struct Decoder {
    /// Constants put in each register by the last `movw` or `movt`.
    registers: [u32; 16],
}

impl Decoder {
    /// The instruction at the start of the code, which is at this address: its length in bytes,
    /// and its effect.
    pub(super) fn next(&mut self, address: u32, code: &[u8]) -> Option<(u32, Option<Effect>)> {
        let halfword = |at: usize| Some(u16::from_le_bytes([*code.get(at)?, *code.get(at + 1)?]));
        let first = u32::from(halfword(0)?);
        if first >> 11 < 0b11101 {
            return Some((2, narrow(address, first)));
        }
        let second = u32::from(halfword(2)?);
        Some((4, self.wide(address, first, second)))
    }

    fn wide(&mut self, address: u32, first: u32, second: u32) -> Option<Effect> {
        let register = second >> 8 & 0xf;
        match (first, second) {
            // bl; b.w
            _ if first & 0xf800 == 0xf000 && second & 0x9000 == 0x9000 => {
                let sign = first >> 10 & 1;
                let [i1, i2] = [second >> 13 & 1, second >> 11 & 1].map(|j| !(j ^ sign) & 1);
                let offset = sign << 24
                    | i1 << 23
                    | i2 << 22
                    | (first & 0x3ff) << 12
                    | (second & 0x7ff) << 1;
                Some(Effect::Goes(target(address, offset, 25)))
            }
            // b<condition>.w
            _ if first & 0xf800 == 0xf000
                && second & 0xd000 == 0x8000
                && first & 0x0380 != 0x0380 =>
            {
                let offset = (first >> 10 & 1) << 20
                    | (second >> 11 & 1) << 19
                    | (second >> 13 & 1) << 18
                    | (first & 0x3f) << 12
                    | (second & 0x7ff) << 1;
                Some(Effect::Goes(target(address, offset, 21)))
            }
            // movw, movt
            _ if first & 0xfb70 == 0xf240 && second & 0x8000 == 0 => {
                let half = (first & 0xf) << 12
                    | (first >> 10 & 1) << 11
                    | (second >> 12 & 7) << 8
                    | second & 0xff;
                let value = &mut self.registers[register as usize];
                if first & 0x80 == 0 {
                    *value = half;
                    None
                } else {
                    // An address always comes in two halves, the lower one first.
                    *value = half << 16 | *value & 0xffff;
                    Some(Effect::Holds(*value))
                }
            }
            // push.w
            (0xe92d, _) => Some(Effect::Pushes(4 * second.count_ones())),
            // str <register>, [sp, #-n]!
            (0xf84d, _) if second & 0xf00 == 0xd00 => Some(Effect::Pushes(second & 0xff)),
            // strd <registers>, [sp, #-n]!
            (0xe96d, _) => Some(Effect::Pushes(4 * (second & 0xff))),
            // vpush
            _ if first & 0xffbf == 0xed2d && second & 0x0e00 == 0x0a00 => {
                Some(Effect::Pushes(4 * (second & 0xff)))
            }
            // sub.w sp, sp, #<constant>
            _ if first & 0xfbef == 0xf1ad && second & 0x8f00 == 0x0d00 => {
                Some(Effect::Pushes(expand(immediate(first, second))))
            }
            // subw sp, sp, #<constant>
            _ if first & 0xfbff == 0xf2ad && second & 0x8f00 == 0x0d00 => {
                Some(Effect::Pushes(immediate(first, second)))
            }
            // sub.w sp, sp, <register>
            (0xebad, _) if second & 0x0f00 == 0x0d00 => {
                Some(Effect::Pushes(self.registers[second as usize & 0xf]))
            }
            _ => None,
        }
    }
}

fn narrow(address: u32, instruction: u32) -> Option<Effect> {
    match instruction {
        // push
        _ if instruction & 0xfe00 == 0xb400 => {
            Some(Effect::Pushes(4 * (instruction & 0x1ff).count_ones()))
        }
        // sub sp, #<constant>
        _ if instruction & 0xff80 == 0xb080 => Some(Effect::Pushes(4 * (instruction & 0x7f))),
        // bx lr: a return
        0x4770 => None,
        // blx, bx
        _ if instruction & 0xff07 == 0x4700 => Some(Effect::GoesSomewhere),
        // b
        _ if instruction & 0xf800 == 0xe000 => Some(Effect::Goes(target(
            address,
            (instruction & 0x7ff) << 1,
            12,
        ))),
        // b<condition>
        _ if instruction & 0xf000 == 0xd000 && instruction & 0x0e00 != 0x0e00 => {
            Some(Effect::Goes(target(address, (instruction & 0xff) << 1, 9)))
        }
        _ => None,
    }
}

/// Relative to the program counter, which is ahead; `offset` is a signed number of so many bits.
fn target(address: u32, offset: u32, bits: u32) -> u32 {
    let shift = 32 - bits;
    let offset = ((offset << shift) as i32) >> shift;
    address.wrapping_add(4).wrapping_add_signed(offset)
}

fn immediate(first: u32, second: u32) -> u32 {
    (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xff
}

/// `ThumbExpandImm`.
fn expand(immediate: u32) -> u32 {
    let byte = immediate & 0xff;
    match immediate >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte * 0x0101_0101,
        _ => (0x80 | immediate & 0x7f).rotate_right(immediate >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn effect(code: &[u8]) -> Option<Effect> {
        let (len, effect) = Decoder::default().next(0x1000, code).unwrap();
        assert_eq!(len as usize, code.len());
        effect
    }

    /// As an assembler wrote them.
    #[test]
    fn known_instructions() {
        for (code, expected) in [
            (&[0xf0, 0xb5][..], Some(Effect::Pushes(20))), // push {r4-r7, lr}
            (&[0x2d, 0xe9, 0xf0, 0x4f], Some(Effect::Pushes(36))), // push.w {r4-r11, lr}
            (&[0x4d, 0xf8, 0x04, 0x8d], Some(Effect::Pushes(4))), // str r8, [sp, #-4]!
            (&[0x84, 0xb0], Some(Effect::Pushes(16))),     // sub sp, #16
            (&[0xad, 0xf5, 0x80, 0x7d], Some(Effect::Pushes(256))), // sub.w sp, sp, #256
            (&[0xad, 0xf2, 0x04, 0x4d], Some(Effect::Pushes(1028))), // subw sp, sp, #1028
            (&[0x2d, 0xed, 0x04, 0x8b], Some(Effect::Pushes(16))), // vpush {d8, d9}
            (&[0x00, 0xf0, 0x02, 0xf8], Some(Effect::Goes(0x1008))), // bl +8
            (&[0xff, 0xf7, 0xfe, 0xff], Some(Effect::Goes(0x1000))), // bl to itself
            (&[0xff, 0xf7, 0xfe, 0xbf], Some(Effect::Goes(0x1000))), // b.w to itself
            (&[0xfe, 0xe7], Some(Effect::Goes(0x1000))),   // b to itself
            (&[0xfe, 0xd0], Some(Effect::Goes(0x1000))),   // beq to itself
            (&[0x3f, 0xf4, 0xfe, 0xaf], Some(Effect::Goes(0x1000))), // beq.w to itself
            (&[0x98, 0x47], Some(Effect::GoesSomewhere)),  // blx r3
            (&[0x18, 0x47], Some(Effect::GoesSomewhere)),  // bx r3
            (&[0x70, 0x47], None),                         // bx lr
            (&[0x00, 0xbf], None),                         // nop
            (&[0x41, 0xf2, 0x34, 0x20], None),             // movw r0, #0x1234
        ] {
            assert_eq!(effect(code), expected, "{code:x?}");
        }
    }

    #[test]
    fn an_address_comes_in_halves() {
        let mut decoder = Decoder::default();
        // movw r1, #0x5678; movt r1, #0x1234
        decoder.next(0, &[0x45, 0xf2, 0x78, 0x61]).unwrap();
        let (_, whole) = decoder.next(4, &[0xc1, 0xf2, 0x34, 0x21]).unwrap();
        assert_eq!(whole, Some(Effect::Holds(0x1234_5678)));
    }
}
