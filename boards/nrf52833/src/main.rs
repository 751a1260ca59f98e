//! Use of each pin of an nRF52833-DK: as on an nRF52840-DK.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

nrf52::board! {
    board: NRF52833_DK,
    camera: receive P1_01, send P1_02,
    // The kit's debug probe makes a serial port of them.
    console: receive P0_08, send P0_06,
    // LED1 to LED4, between the supply and their pins.
    lamps: lit by Low, joined P0_13, target_seen P0_14, calibrated P0_15, may_walk P0_16,
    // Buttons 1 and 2.
    buttons: join_window P0_11, learn_colour P0_12,
    sensor: data P0_26, clock P0_27,
}
