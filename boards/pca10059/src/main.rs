//! Use of each pin of an nRF52840 dongle (PCA10059), by the names that are printed on it.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

nrf52::board! {
    board: PCA10059,
    camera: receive P0_24, send P0_20,
    // LD1, and blue, green and red of LD2, between the supply and their pins.
    lamps: lit by Low, joined P0_06, target_seen P0_12, calibrated P1_09, may_walk P0_08,
    // SW1, and a button between 0.17 and ground.
    buttons: join_window P1_06, learn_colour P0_17,
    sensor: data P0_13, clock P0_15,
}
