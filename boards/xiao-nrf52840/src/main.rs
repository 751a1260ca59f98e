//! Use of each pin of a Seeed XIAO nRF52840, and of the XIAO nRF52840 Sense.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

nrf52::board! {
    board: XIAO_NRF52840,
    // D7 and D6.
    camera: receive P1_12, send P1_11,
    // Red, blue and green of the lamp; another one at D10, likewise between the supply and its pin.
    lamps: lit by Low, joined P0_26, target_seen P0_06, calibrated P0_30, may_walk P1_15,
    // Buttons between D0 and D1 and ground.
    buttons: join_window P0_02, learn_colour P0_03,
    // D4 and D5.
    sensor: data P0_04, clock P0_05,
}
