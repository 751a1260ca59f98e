//! Spinel frames: golden bytes, and that reading what was written gives the same.

use proptest::{collection::vec, option, prelude::*};
use spinel_radio::{
    frame::{Body, Reset, SpinelHeader, SpinelMessage, Tid},
    hdlc,
    property::{Capabilities, Promiscuity, Property, PropertyKey, ProtocolVersion, TxReport},
    status::SpinelStatus,
    stream::{RxFrame, TxFrame},
};
use zigbee_link::wire::{EmitError, Eui64, Malformed, PanId, ShortAddress};

fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

fn emit(message: &SpinelMessage<'_>) -> Vec<u8> {
    let mut buffer = [0; 400];
    let len = message.emit(&mut buffer).unwrap();
    buffer[..len].to_vec()
}

fn is(tid: u8, property: Property<'_>) -> SpinelMessage<'_> {
    SpinelMessage {
        header: SpinelHeader::new(Tid::new(tid).unwrap()),
        body: Body::Is(property),
    }
}

#[track_caller]
fn assert_golden(text: &str, message: &SpinelMessage<'_>) {
    let bytes = hex(text);
    assert_eq!(SpinelMessage::parse(&bytes), Ok(*message));
    assert_eq!(emit(message), bytes);
    let mut buffer = [0; 400];
    for room in 0..bytes.len() {
        assert_eq!(message.emit(&mut buffer[..room]), Err(EmitError::NoRoom));
    }
}

/// Answers of an `ot-rcp`, from the reset to the firmware's name.
#[test]
fn recorded_answers() {
    assert_golden(
        "80 06 00 70",
        &is(0, Property::LastStatus(SpinelStatus(112), None)),
    );
    assert!(SpinelStatus(112).is_reset());
    assert_golden(
        "82 06 01 04 03",
        &is(
            2,
            Property::ProtocolVersion(ProtocolVersion { major: 4, minor: 3 }),
        ),
    );
    let capabilities = [0x05, 0x0C, 0x18, 0x22, 0x81, 0x04, 0x40, 0x41];
    let property = Property::Capabilities(Capabilities(&capabilities));
    assert_golden("86 06 05 05 0C 18 22 81 04 40 41", &is(6, property));
    let address = Eui64([0x18, 0xB4, 0x30, 0, 0, 0, 0, 1]);
    assert_golden(
        "89 06 08 18 B4 30 00 00 00 00 01",
        &is(9, Property::HardwareAddress(address)),
    );
    let firmware = Property::NcpVersion(b"OPENTHREAD/");
    assert_golden(
        "83 06 02 4F 50 45 4E 54 48 52 45 41 44 2F 00",
        &is(3, firmware),
    );
    let unknown = Property::LastStatus(SpinelStatus::PROPERTY_NOT_FOUND, None);
    assert_golden("83 06 00 0D", &is(3, unknown));
}

/// The same, of frames. It adds a structure for its own security, which is passed over.
#[test]
fn recorded_frames() {
    let frame = RxFrame {
        rssi: -20,
        noise: -128,
        channel: 11,
        timestamp: 0x0001_B331_8E75,
        ..RxFrame::new(&[
            0x61, 0x88, 0x07, 0x34, 0x12, 0x02, 0x00, 0x01, 0x00, 0x68, 0x69, 0xB8, 0x60,
        ])
    };
    let told = hex(
        "80 06 71 0D 00 61 88 07 34 12 02 00 01 00 68 69 B8 60 EC 80 00 00 \
         0A 00 0B 00 75 8E 31 B3 01 00 00 00 01 00 00 05 00 00 00 00 00 00",
    );
    assert_eq!(
        SpinelMessage::parse(&told),
        Ok(is(0, Property::Received(frame)))
    );

    // Sent and acknowledged; sent to all; sent and not acknowledged.
    let acknowledged = hex("8B 06 00 00 00 01 05 00 02 00 07 07 C1 00 80 00 00 \
         0A 00 0B 00 88 8E 31 B3 01 00 00 00 01 00 00 05 00 00 00 00 00 00");
    let report = TxReport {
        frame_pending: false,
        header_updated: true,
        acknowledgement: Some(RxFrame {
            rssi: 0,
            channel: 11,
            timestamp: 0x0001_B331_8E88,
            ..RxFrame::new(&[0x02, 0x00, 0x07, 0x07, 0xC1])
        }),
    };
    let expected = Property::LastStatus(SpinelStatus::OK, Some(report));
    assert_eq!(SpinelMessage::parse(&acknowledged), Ok(is(11, expected)));

    let sent = hex("8D 06 00 00 00 01 00 00 00 80 00 00 \
         0A 00 00 00 00 00 00 00 00 00 00 00 01 00 00 05 00 00 00 00 00 00");
    let report = TxReport {
        acknowledgement: Some(RxFrame {
            rssi: 0,
            ..RxFrame::new(&[])
        }),
        ..report
    };
    let expected = Property::LastStatus(SpinelStatus::OK, Some(report));
    assert_eq!(SpinelMessage::parse(&sent), Ok(is(13, expected)));

    let report = TxReport {
        acknowledgement: None,
        ..report
    };
    assert_golden(
        "8C 06 00 11 00 01",
        &is(12, Property::LastStatus(SpinelStatus::NO_ACK, Some(report))),
    );
}

/// OpenThread of before August 2019 tells times in 32 and 16 bits (its pull request 4037 changed that), and of
/// before 2020 no more of a transmission than the acknowledgement.
#[test]
fn frames_of_old_co_processors() {
    let psdu = hex("41 88 07 01 00 02 00 05 00 aa bb cc 11 22");
    let heard = hex("80 06 71 0E 00 41 88 07 01 00 02 00 05 00 AA BB CC 11 22 \
         C4 80 00 00 08 00 0B B4 10 27 00 00 E8 03 01 00 00");
    let frame = RxFrame {
        rssi: -60,
        channel: 11,
        lqi: 180,
        timestamp: 10_001_000,
        ..RxFrame::new(&psdu)
    };
    assert_eq!(
        SpinelMessage::parse(&heard),
        Ok(is(0, Property::Received(frame)))
    );

    let report = |acknowledgement| {
        let report = TxReport {
            frame_pending: false,
            header_updated: false,
            acknowledgement: Some(acknowledgement),
        };
        Ok(is(5, Property::LastStatus(SpinelStatus::OK, Some(report))))
    };
    let sent = hex(
        "85 06 00 00 00 05 00 02 00 07 11 22 C4 80 00 00 08 00 0B B4 10 27 00 00 E8 03 01 00 00",
    );
    let psdu = hex("02 00 07 11 22");
    let acknowledgement = RxFrame {
        psdu: &psdu,
        ..frame
    };
    assert_eq!(SpinelMessage::parse(&sent), report(acknowledgement));
    let unasked = hex("85 06 00 00 00 00 00");
    assert_eq!(SpinelMessage::parse(&unasked), report(RxFrame::new(&[])));
}

#[test]
fn properties() {
    let eui = Eui64([1, 2, 3, 4, 5, 6, 7, 8]);
    for (text, property) in [
        ("85 06 20 01", Property::PhyEnabled(true)),
        ("85 06 21 1A", Property::PhyChannel(26)),
        ("85 06 25 EC", Property::PhyTxPower(-20)),
        (
            "85 06 34 01 02 03 04 05 06 07 08",
            Property::MacExtended(eui),
        ),
        ("85 06 35 42 00", Property::MacShort(ShortAddress(0x42))),
        ("85 06 36 CE FA", Property::MacPan(PanId(0xFACE))),
        ("85 06 37 00", Property::MacRawStream(false)),
        ("85 06 38 02", Property::MacPromiscuous(Promiscuity::Full)),
        ("85 06 83 26 01", Property::MacSourceMatch(true)),
        (
            "85 06 B9 0A AB",
            Property::Other(PropertyKey(1337), &[0xAB]),
        ),
    ] {
        assert_golden(text, &is(5, property));
        let set = SpinelMessage {
            body: Body::Set(property),
            ..is(5, property)
        };
        assert_golden(&text.replacen("06", "03", 1), &set);
    }
    let reserved = hex("85 06 38 03");
    assert_eq!(SpinelMessage::parse(&reserved), Err(Malformed::Reserved));
}

/// Metadata may end after any field; what is missing is what `new` says.
#[test]
fn partial_metadata() {
    let full = TxFrame {
        csma_backoffs: 1,
        retries: 2,
        csma: false,
        header_updated: true,
        retransmission: true,
        security_processed: true,
        delay: 3,
        delay_base: 4,
        channel_after: 12,
        ..TxFrame::new(&[1, 2, 3], 11)
    };
    let bytes = emit(&SpinelMessage {
        header: SpinelHeader::default(),
        body: Body::Set(Property::Send(full)),
    });
    let mut good = 0;
    for len in 0..=bytes.len() {
        match SpinelMessage::parse(&bytes[..len]) {
            Ok(SpinelMessage {
                body: Body::Set(Property::Send(frame)),
                ..
            }) => {
                good += 1;
                let mut expected = TxFrame::new(&[1, 2, 3], 11);
                if good > 1 {
                    expected.csma_backoffs = 1;
                }
                if good > 2 {
                    expected.retries = 2;
                }
                assert_eq!(frame.retries, expected.retries);
                assert_eq!(frame.csma_backoffs, expected.csma_backoffs);
                assert_eq!(frame == full, len == bytes.len());
            }
            other => assert_eq!(other, Err(Malformed::Truncated), "{len}"),
        }
    }
    // The channel and nine more.
    assert_eq!(good, 10);
    let bare = hex("80 06 71 03 00 01 02 03");
    let expected = Property::Received(RxFrame::new(&[1, 2, 3]));
    assert_eq!(
        SpinelMessage::parse(&bare).unwrap().body,
        Body::Is(expected)
    );
}

#[test]
fn numbers_that_cannot_be_written() {
    let mut buffer = [0; 70_000];
    for property in [
        Property::LastStatus(SpinelStatus(1 << 21), None),
        Property::Other(PropertyKey(1 << 21), &[]),
        Property::Received(RxFrame::new(&[0; 65_536])),
    ] {
        assert_eq!(
            is(1, property).emit(&mut buffer),
            Err(EmitError::Impossible)
        );
    }
}

#[test]
fn capabilities_are_packed_numbers() {
    let capabilities = Capabilities(&[5, 34, 0x81, 0x04, 0x80]);
    assert_eq!(capabilities.iter().collect::<Vec<_>>(), [5, 34, 513]);
    assert!(capabilities.contains(Capabilities::MAC_RAW));
    assert!(capabilities.contains(Capabilities::CONFIG_RADIO));
    assert!(!capabilities.contains(4));
}

const PACKED: u32 = 1 << 21;

prop_compose! {
    fn received(psdu: &'static [u8])(
        rssi: i8, noise: i8, flags: u16, channel: u8, lqi: u8, timestamp: u64, error in 0..PACKED,
    ) -> RxFrame<'static> {
        RxFrame { psdu, rssi, noise, flags, channel, lqi, timestamp, error }
    }
}

prop_compose! {
    fn to_send(psdu: &'static [u8])(
        bytes: [u8; 4], bits: [bool; 4], delay: u32, delay_base: u32,
    ) -> TxFrame<'static> {
        let [channel, csma_backoffs, retries, channel_after] = bytes;
        let [csma, header_updated, retransmission, security_processed] = bits;
        TxFrame {
            psdu, channel, csma_backoffs, retries, csma, header_updated, retransmission,
            security_processed, delay, delay_base, channel_after,
        }
    }
}

fn body() -> impl Strategy<Value = Body<'static>> {
    static PSDU: [u8; 127] = [0x7E; 127];
    let report = (
        any::<bool>(),
        any::<bool>(),
        option::of(received(&PSDU[..5])),
    )
        .prop_map(
            |(frame_pending, header_updated, acknowledgement)| TxReport {
                frame_pending,
                header_updated,
                acknowledgement,
            },
        );
    prop_oneof![
        Just(Body::Noop),
        prop_oneof![
            Just(Reset::Default),
            Just(Reset::Platform),
            Just(Reset::Stack),
            Just(Reset::Other(9))
        ]
        .prop_map(Body::Reset),
        (0..PACKED).prop_map(|key| Body::Get(PropertyKey(key))),
        (0..PACKED, option::of(report)).prop_map(|(status, report)| Body::Is(
            Property::LastStatus(SpinelStatus(status), report)
        )),
        (0..PACKED, 0..PACKED).prop_map(|(major, minor)| Body::Is(Property::ProtocolVersion(
            ProtocolVersion { major, minor }
        ))),
        (0..127_usize).prop_map(|len| Body::Is(Property::NcpVersion(&PSDU[..len]))),
        (0..127_usize).prop_map(|len| Body::Is(Property::Capabilities(Capabilities(&PSDU[..len])))),
        any::<[u8; 8]>().prop_map(|eui| Body::Is(Property::HardwareAddress(Eui64(eui)))),
        received(&PSDU).prop_map(|frame| Body::Is(Property::Received(frame))),
        to_send(&PSDU).prop_map(|frame| Body::Set(Property::Send(frame))),
    ]
}

proptest! {
    #[test]
    fn emitting_then_parsing_is_the_identity(body in body(), interface in 0..4_u8, tid in 0..16_u8) {
        let header = SpinelHeader::on_interface(interface, Tid::new(tid).unwrap()).unwrap();
        let message = SpinelMessage { header, body };
        let bytes = emit(&message);
        prop_assert_eq!(SpinelMessage::parse(&bytes), Ok(message));
    }

    /// Any bytes: no panic, and what was understood stays the same when written and read again.
    #[test]
    fn any_bytes(start in 0..4_usize, mut bytes in vec(any::<u8>(), 0..200)) {
        // Most random bytes are no header, no command and no property.
        let starts: [&[u8]; 4] = [&[], &[0x80, 6, 0], &[0x81, 6, 0x71, 20, 0], &[0x82, 3, 0x71, 20, 0]];
        bytes.splice(..0, starts[start].iter().copied());
        if let Ok(message) = SpinelMessage::parse(&bytes) {
            let again = emit(&message);
            prop_assert_eq!(SpinelMessage::parse(&again), Ok(message));
        }
    }

    #[test]
    fn over_a_line(body in body()) {
        let content = emit(&SpinelMessage { header: SpinelHeader::default(), body });
        let mut decoder = hdlc::Decoder::<400>::new();
        let frames: Vec<_> = hdlc::encode(&content)
            .filter_map(|byte| decoder.push(byte).map(<[u8]>::to_vec))
            .collect();
        prop_assert_eq!(frames, [content]);
    }
}
