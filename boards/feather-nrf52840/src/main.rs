//! Use of each pin of an Adafruit Feather nRF52840 Express.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

nrf52::board! {
    board: FEATHER_NRF52840,
    // RX and TX.
    camera: receive P0_24, send P0_25,
    // The red and the blue lamp; two others at D5 and D6, likewise between their pins and ground.
    lamps: lit by High, joined P1_15, target_seen P1_10, calibrated P1_08, may_walk P0_07,
    // The button USER, and one between D9 and ground.
    buttons: join_window P1_02, learn_colour P0_26,
    // SDA and SCL.
    sensor: data P0_12, clock P0_11,
}
