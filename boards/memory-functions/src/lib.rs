//! `memcpy`, `memmove`, `memset` and `memcmp` of a Cortex-M4 in 150 bytes of code, by word, and the division of numbers of
//! 64 bits in 50.
//!
//! The compiler calls them for all that it copies, clears, compares or divides. Those that come with it take 4,400 bytes,
//! because they align what they copy and unroll their loops; this processor reads and writes words at any address.
//! An image that names this crate (`use memory_functions as _`) gets these, since those are weak symbols. On other
//! processors the crate is empty.
//!
//! Names and arguments: C standard, 7.24; Run-time ABI for the Arm Architecture, 4.3.1 and 4.3.4, whose variants
//! for aligned blocks may assume so and need not. As there, no argument is a pointer to the registers of
//! a peripheral. `cargo xtask cortex-m` compares them with loops over bytes, and quotients with
//! what a division is, on an emulated processor.
#![no_std]
#![cfg_attr(
    all(target_os = "none", target_arch = "arm", target_abi = "eabihf"),
    allow(
        unsafe_code,
        reason = "functions that a compiler must not make calls of themselves"
    )
)]

// The bit that traps words at odd addresses, `UNALIGN_TRP` of `CCR`, is clear after a reset (ARM v7-M
// Architecture Reference Manual, B3.2.8), and nothing here sets it.
#[cfg(all(target_os = "none", target_arch = "arm", target_abi = "eabihf"))]
core::arch::global_asm!(
    ".macro begin name:req, more:vararg",
    ".section .text.\\name, \"ax\", %progbits",
    ".p2align 1",
    ".irp other, \\name, \\more",
    ".global \\other",
    ".type \\other, %function",
    ".thumb_func",
    "\\other:",
    ".endr",
    ".endm",
    // r0: to, and the result of the C function; r1: from; r2: bytes.
    "begin memcpy, __aeabi_memcpy, __aeabi_memcpy4, __aeabi_memcpy8",
    "mov r12, r0",
    "subs r2, #4",
    "blo 2f",
    "1: ldr r3, [r1], #4",
    "str r3, [r12], #4",
    "subs r2, #4",
    "bhs 1b",
    "2: adds r2, #4",
    "beq 4f",
    "3: ldrb r3, [r1], #1",
    "strb r3, [r12], #1",
    "subs r2, #1",
    "bne 3b",
    "4: bx lr",
    ".size memcpy, . - memcpy",
    // The same, from the end where the beginning would overwrite what is still to be read.
    "begin memmove, __aeabi_memmove, __aeabi_memmove4, __aeabi_memmove8",
    "subs r3, r0, r1",
    "cmp r3, r2",
    "bhs memcpy",
    "add r1, r2",
    "add r12, r0, r2",
    "subs r2, #4",
    "blo 2f",
    "1: ldr r3, [r1, #-4]!",
    "str r3, [r12, #-4]!",
    "subs r2, #4",
    "bhs 1b",
    "2: adds r2, #4",
    "beq 4f",
    "3: ldrb r3, [r1, #-1]!",
    "strb r3, [r12, #-1]!",
    "subs r2, #1",
    "bne 3b",
    "4: bx lr",
    ".size memmove, . - memmove",
    // r0: where; r1: bytes.
    "begin __aeabi_memclr, __aeabi_memclr4, __aeabi_memclr8",
    "movs r2, #0",
    ".size __aeabi_memclr, . - __aeabi_memclr",
    // r0: where; r1: bytes; r2: the value.
    ".global __aeabi_memset, __aeabi_memset4, __aeabi_memset8",
    ".thumb_func",
    "__aeabi_memset:",
    ".thumb_func",
    "__aeabi_memset4:",
    ".thumb_func",
    "__aeabi_memset8:",
    ".type __aeabi_memset, %function",
    "mov r3, r1",
    "mov r1, r2",
    "mov r2, r3",
    // r0: where, and the result; r1: the value; r2: bytes.
    ".global memset",
    ".thumb_func",
    "memset:",
    ".type memset, %function",
    "uxtb r1, r1",
    "orr r1, r1, r1, lsl #8",
    "orr r1, r1, r1, lsl #16",
    "mov r12, r0",
    "subs r2, #4",
    "blo 2f",
    "1: str r1, [r12], #4",
    "subs r2, #4",
    "bhs 1b",
    "2: adds r2, #4",
    "beq 4f",
    "3: strb r1, [r12], #1",
    "subs r2, #1",
    "bne 3b",
    "4: bx lr",
    ".size memset, . - memset",
    ".size __aeabi_memset, 6",
    // r0, r1: the two; r2: bytes. The result is the difference of the first two bytes that differ.
    "begin memcmp, bcmp",
    "1: subs r2, #1",
    "blo 2f",
    "ldrb r3, [r0], #1",
    "ldrb r12, [r1], #1",
    "subs r3, r3, r12",
    "beq 1b",
    "mov r0, r3",
    "bx lr",
    "2: movs r0, #0",
    "bx lr",
    ".size memcmp, . - memcmp",
    // r1:r0: dividend, and the quotient; r3:r2: divisor, and the remainder. A bit of the quotient each time: a time is
    // divided now and then, and the function that comes with the compiler takes 950 bytes.
    "begin __aeabi_uldivmod",
    "push {{r4, r5, r6, lr}}",
    "movs r4, #0",
    "movs r5, #0",
    "mov r12, #64",
    "1: adds r0, r0, r0",
    "adcs r1, r1, r1",
    "adcs r4, r4, r4",
    "adcs r5, r5, r5",
    "bcs 2f",
    "subs r6, r4, r2",
    "sbcs r6, r5, r3",
    "blo 3f",
    "2: subs r4, r4, r2",
    "sbcs r5, r3",
    "adds r0, #1",
    "3: subs r12, r12, #1",
    "bne 1b",
    "mov r2, r4",
    "mov r3, r5",
    "pop {{r4, r5, r6, pc}}",
    ".size __aeabi_uldivmod, . - __aeabi_uldivmod",
    ".purgem begin",
    ".text",
);
