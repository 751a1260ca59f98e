//! As much of the Thumb-2 instruction set as tells the calls of functions and the stack that they take (ARM v7-M
//! Architecture Reference Manual, A5 to A7).

/// Effect of an instruction, as far as it matters here.
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
    /// Puts the word at this address of the code in a register.
    Loads(u32, u32),
}

/// Decodes one instruction after the other of a function.
#[derive(Debug, Default)]
pub(super) struct Decoder {
    /// Constants that registers hold: not after anything else that may put the address of a function
    /// there, in the order of addresses.
    constants: [Option<u32>; 16],
}

impl Decoder {
    /// The instruction at the start of the code, which is at this address: its length in bytes,
    /// and its effect. `literal` reads a word of the code.
    pub(super) fn next(
        &mut self,
        address: u32,
        code: &[u8],
        literal: impl Fn(u32) -> Option<u32>,
    ) -> Option<(u32, Option<Effect>)> {
        let halfword = |at: usize| Some(u16::from_le_bytes([*code.get(at)?, *code.get(at + 1)?]));
        let first = u32::from(halfword(0)?);
        let (len, effect) = if first >> 11 < 0b11101 {
            (2, self.narrow(address, first))
        } else {
            (4, self.wide(address, first, u32::from(halfword(2)?)))
        };
        let effect = match effect {
            Some(Effect::Loads(register, from)) => {
                let value = literal(from);
                self.constants[register as usize] = value;
                value.map(Effect::Holds)
            }
            other => other,
        };
        // A function may change these (Procedure Call Standard for the Arm Architecture, 6.1.1).
        if let Some(Effect::Goes(_) | Effect::GoesSomewhere) = effect
            && !is_conditional(first)
        {
            for register in [0, 1, 2, 3, 12] {
                self.constants[register] = None;
            }
        }
        Some((len, effect))
    }

    /// Something else is in these registers now.
    fn forget(&mut self, list: u32) {
        for (register, constant) in self.constants.iter_mut().enumerate() {
            if list >> register & 1 != 0 {
                *constant = None;
            }
        }
    }

    /// Calls, or jumps to, the address that a register holds.
    fn through(&self, register: u32) -> Effect {
        match self.constants[register as usize & 0xf] {
            Some(function) => Effect::Goes(function & !1),
            None => Effect::GoesSomewhere,
        }
    }

    fn narrow(&mut self, address: u32, instruction: u32) -> Option<Effect> {
        let (low, middle) = (instruction & 7, instruction >> 8 & 7);
        match instruction {
            // push
            _ if instruction & 0xfe00 == 0xb400 => {
                return Some(Effect::Pushes(4 * (instruction & 0x1ff).count_ones()));
            }
            // sub sp, #<constant>
            _ if instruction & 0xff80 == 0xb080 => {
                return Some(Effect::Pushes(4 * (instruction & 0x7f)));
            }
            // bx lr: a return
            0x4770 => {}
            // blx, bx
            _ if instruction & 0xff07 == 0x4700 => return Some(self.through(instruction >> 3)),
            // b
            _ if instruction & 0xf800 == 0xe000 => {
                let offset = (instruction & 0x7ff) << 1;
                return Some(Effect::Goes(target(address, offset, 12)));
            }
            // b<condition>
            _ if instruction & 0xf000 == 0xd000 && instruction & 0x0e00 != 0x0e00 => {
                return Some(Effect::Goes(target(address, (instruction & 0xff) << 1, 9)));
            }
            // ldr <register>, [pc, #n]
            _ if instruction & 0xf800 == 0x4800 => {
                let from = ((address + 4) & !3) + 4 * (instruction & 0xff);
                return Some(Effect::Loads(middle, from));
            }
            // mov <register>, <register>
            _ if instruction & 0xff00 == 0x4600 => {
                let from = self.constants[instruction as usize >> 3 & 0xf];
                self.constants[(low | instruction >> 4 & 8) as usize] = from;
            }
            // cmp <register>, #<constant>; tst, cmp, cmn; cmp of high registers: none is changed
            _ if instruction & 0xf800 == 0x2800
                || [0x4200, 0x4280, 0x42c0].contains(&(instruction & 0xffc0))
                || instruction & 0xff00 == 0x4500 => {}
            // mov, add and sub of a constant; ldr <register>, [sp, #n]; add to pc and sp
            _ if instruction & 0xe000 == 0x2000
                || instruction & 0xf800 == 0x9800
                || instruction & 0xf000 == 0xa000 =>
            {
                self.forget(1 << middle);
            }
            // shifts, add, sub and what else computes; ldr of all kinds but str
            _ if instruction < 0x4400
                || instruction & 0xf000 == 0x5000 && instruction & 0x0e00 >= 0x0600
                || (0x6000..0x9000).contains(&instruction) && instruction & 0x0800 != 0 =>
            {
                self.forget(1 << low);
            }
            // add of high registers
            _ if instruction & 0xff00 == 0x4400 => {
                self.forget(1 << (low | instruction >> 4 & 8));
            }
            // ldm, pop
            _ if instruction & 0xf800 == 0xc800 || instruction & 0xfe00 == 0xbc00 => {
                self.forget(instruction & 0xff);
            }
            _ => {}
        }
        None
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
                let value = &mut self.constants[register as usize];
                if first & 0x80 == 0 {
                    *value = Some(half);
                    None
                } else {
                    // An address always comes in two halves, the lower one first.
                    *value = value.map(|low| half << 16 | low & 0xffff);
                    value.map(Effect::Holds)
                }
            }
            // ldr.w <register>, [pc, #n]
            _ if first & 0xff7f == 0xf85f => {
                let (base, offset) = ((address + 4) & !3, second & 0xfff);
                let from = match first & 0x80 {
                    0 => base.wrapping_sub(offset),
                    _ => base + offset,
                };
                match second >> 12 {
                    15 => Some(Effect::GoesSomewhere),
                    register => Some(Effect::Loads(register, from)),
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
                let bytes = self.constants[second as usize & 0xf];
                Some(Effect::Pushes(bytes.unwrap_or_default()))
            }
            // ldr.w and the like
            _ if first & 0xfe10 == 0xf810 => {
                self.forget(1 << (second >> 12));
                None
            }
            // ldm.w
            _ if [0xe890, 0xe910].contains(&(first & 0xffd0)) => {
                self.forget(second);
                None
            }
            // ldrd, ldrex
            _ if first & 0xfe50 == 0xe850 => {
                self.forget(1 << (second >> 12) | 1 << register);
                None
            }
            // Instructions that compute: with a constant, with a register, and products of two
            _ if first & 0xf800 == 0xf000 && second & 0x8000 == 0
                || first & 0xfe00 == 0xea00
                || first & 0xfe00 == 0xfa00 =>
            {
                self.forget(1 << register);
                if first & 0xff80 == 0xfb80 {
                    self.forget(1 << (second >> 12));
                }
                None
            }
            _ => None,
        }
    }
}

fn is_conditional(first: u32) -> bool {
    let is_narrow = first & 0xf000 == 0xd000;
    is_narrow || first & 0xf800 == 0xe000
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
        let (len, effect) = Decoder::default().next(0x1000, code, |_| None).unwrap();
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
        let mut next = |code| decoder.next(0, code, |_| None).unwrap();
        next(&[0x45, 0xf2, 0x78, 0x61]);
        let (_, whole) = next(&[0xc1, 0xf2, 0x34, 0x21]);
        assert_eq!(whole, Some(Effect::Holds(0x1234_5678)));
    }

    /// A register's value from before the call, by its code.
    #[test]
    fn a_call_through_a_register_that_holds_a_constant() {
        let call = [0xb0, 0x47]; // blx r6
        let after = |before: &[&[u8]]| {
            let mut decoder = Decoder::default();
            for code in before {
                decoder.next(0x1000, code, |at| Some(at | 1)).unwrap();
            }
            decoder.next(0x1010, &call, |_| None).unwrap().1
        };
        let load = [0x02, 0x4e]; // ldr r6, [pc, #8]
        let known = Some(Effect::Goes(0x100c));
        assert_eq!(after(&[&load]), known);
        assert_eq!(after(&[]), Some(Effect::GoesSomewhere));
        for (code, expected) in [
            (&[0x00, 0xf0, 0x02, 0xf8][..], known),                   // bl
            (&[0x26, 0x60], known),                                   // str r6, [r4]
            (&[0x00, 0x2e], known),                                   // cmp r6, #0
            (&[0x26, 0x68], Some(Effect::GoesSomewhere)),             // ldr r6, [r4]
            (&[0xd4, 0xf8, 0x00, 0x60], Some(Effect::GoesSomewhere)), // ldr.w r6, [r4]
            (&[0xd4, 0xe9, 0x00, 0x56], Some(Effect::GoesSomewhere)), // ldrd r5, r6, [r4]
            (&[0x06, 0x46], Some(Effect::GoesSomewhere)),             // mov r6, r0
            (&[0x70, 0xbc], Some(Effect::GoesSomewhere)),             // pop {r4, r5, r6}
            (&[0x66, 0x19], Some(Effect::GoesSomewhere)),             // adds r6, r4, r5
        ] {
            assert_eq!(after(&[&load, code]), expected, "{code:x?}");
        }
        let moved = [0x33, 0x46]; // mov r3, r6
        let mut decoder = Decoder::default();
        for code in [&load, &moved] {
            decoder.next(0x1000, code, |_| Some(0x2001)).unwrap();
        }
        let called = decoder.next(0, &[0x98, 0x47], |_| None).unwrap().1; // blx r3
        assert_eq!(called, Some(Effect::Goes(0x2000)));
    }
}
