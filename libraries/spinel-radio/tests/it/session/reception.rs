//! Received frames.

use spinel_radio::{
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc,
    property::Property,
    stream::RxFrame,
};
use zigbee_link::radio::{Channel, FRAME_MAX, PSDU_MAX};

use crate::session::bench::{BROADCAST, Bench, CONFIG, line, received, with_fcs};

#[test]
fn the_queue_is_bounded_and_loses_the_newest() {
    let mut bench = Bench::configured();
    for number in 0..3 {
        let mut frame = BROADCAST.to_vec();
        frame[2] = number;
        bench.session.input(&received(&with_fcs(&frame)), bench.now);
    }
    assert_eq!(bench.session.counters().queue_full, 1);
    for number in 0..2 {
        assert_eq!(bench.receive().unwrap()[2], number);
    }
    assert_eq!(bench.receive(), None);
}

#[test]
fn what_is_not_delivered() {
    let mut bench = Bench::new();
    // Before there is a configuration.
    bench
        .session
        .input(&received(&with_fcs(BROADCAST)), bench.now);
    assert_eq!(bench.receive(), None);

    let mut bench = Bench::configured();
    let psdu = with_fcs(BROADCAST);
    let bad_fcs = RxFrame {
        flags: RxFrame::BAD_FCS,
        ..RxFrame::new(&psdu)
    };
    let error = RxFrame {
        error: 6,
        ..RxFrame::new(&psdu)
    };
    let long = [0x41; FRAME_MAX + 3];
    for frame in [
        bad_fcs,
        error,
        RxFrame::new(&long),
        RxFrame::new(&[1, 2, 3, 4]),
        RxFrame::new(&[]),
    ] {
        let told = line(Tid::UNSOLICITED, Property::Received(frame));
        bench.session.input(&told, bench.now);
    }
    assert_eq!(bench.session.counters().unusable, 5);
    // Another interface.
    let message = SpinelMessage {
        header: SpinelHeader::on_interface(1, Tid::UNSOLICITED).unwrap(),
        body: Body::Is(Property::Received(RxFrame::new(&psdu))),
    };
    let mut content = [0; 64];
    let len = message.emit(&mut content).unwrap();
    let foreign: Vec<u8> = hdlc::encode(&content[..len]).collect();
    bench.session.input(&foreign, bench.now);
    assert_eq!(bench.receive(), None);
}

#[test]
fn what_is_known_of_a_received_frame() {
    let mut bench = Bench::configured();
    let psdu = with_fcs(BROADCAST);
    let frame = RxFrame {
        rssi: -71,
        lqi: 200,
        channel: 26,
        ..RxFrame::new(&psdu)
    };
    let mut buffer = [0; PSDU_MAX];
    bench.session.input(
        &line(Tid::UNSOLICITED, Property::Received(frame)),
        bench.now,
    );
    let full = bench.session.receive(&mut buffer).unwrap();
    assert_eq!(
        (full.rssi, full.lqi, full.channel),
        (Some(-71), Some(200), Channel::LAST)
    );
    bench.session.input(&received(&psdu), bench.now);
    let bare = bench.session.receive(&mut buffer).unwrap();
    assert_eq!(
        (bare.rssi, bare.lqi, bare.channel),
        (None, None, CONFIG.channel)
    );
}
