//! The codec: golden bytes, and that parsing then emitting is the identity.

use proptest::{collection::vec, prelude::*};
use zigbee_link::wire::{
    Address, Association, AssociationStatus, AuxHeader, Beacon, DeviceCapabilities, EmitError,
    Eui64, Frame, FrameType, FrameVersion, Header, Level, MacCommand, Malformed, PanId, Panned,
    ShortAddress, Superframe,
};

const DEVICE: Eui64 = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1]);
const OTHER: Eui64 = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 2]);

fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

fn short(address: u16) -> Address {
    Address::Short(ShortAddress(address))
}

/// The bytes say what the header says, both ways, and the rest is the payload.
#[track_caller]
fn assert_golden(text: &str, header: &Header, payload: &[u8]) {
    let bytes = hex(text);
    let frame = Frame::parse(&bytes).unwrap();
    assert_eq!(frame.header(), header);
    assert_eq!(frame.payload(), payload);
    let mut buffer = [0; 127];
    let len = header.emit(&mut buffer).unwrap();
    assert_eq!(&buffer[..len], frame.header_bytes());
    for room in 0..len {
        assert_eq!(header.emit(&mut buffer[..room]), Err(EmitError::NoRoom));
    }
    // Cut off anywhere, the header is no header.
    for cut in 0..len {
        assert_eq!(Frame::parse(&bytes[..cut]), Err(Malformed::Truncated));
    }
}

/// IEEE 802.15.4-2006, annex C.2, with an index in place of the implicit key.
#[test]
fn secured_beacon_of_the_standard() {
    let header = Header {
        sequence: 0x84,
        source: Panned::new(PanId(0x4321), Address::Extended(DEVICE)),
        security: Some(AuxHeader {
            level: Level::Mic64,
            counter: 5,
            key_index: 9,
        }),
        ..Header::new(FrameType::Beacon, 0)
    };
    let payload = hex("55 CF 00 00 51 52 53 54 22 3B C1 EC 84 1A B5 53");
    assert_golden(
        "08 D0 84 21 43 01 00 00 00 00 48 DE AC 0A 05 00 00 00 09 \
         55 CF 00 00 51 52 53 54 22 3B C1 EC 84 1A B5 53",
        &header,
        &payload,
    );
    let beacon = Beacon::parse(&payload[..8]).unwrap();
    assert!(beacon.superframe.pan_coordinator() && beacon.superframe.association_permit());
    assert_eq!(beacon.payload, [0x51, 0x52, 0x53, 0x54]);
}

/// The same of C.2.2.
#[test]
fn encrypted_data_of_the_standard() {
    let header = Header {
        sequence: 0x84,
        ack_request: true,
        destination: Panned::new(PanId(0x4321), Address::Extended(OTHER)),
        source: Panned::compressed(Address::Extended(DEVICE)),
        security: Some(AuxHeader {
            level: Level::Enc,
            counter: 5,
            key_index: 9,
        }),
        ..Header::new(FrameType::Data, 0)
    };
    assert_golden(
        "69 DC 84 21 43 02 00 00 00 00 48 DE AC 01 00 00 00 00 48 DE AC \
         0C 05 00 00 00 09 D4 3E 02 2B",
        &header,
        &hex("D4 3E 02 2B"),
    );
}

/// The same of C.2.3.
#[test]
fn secured_command_of_the_standard() {
    let header = Header {
        sequence: 0x84,
        ack_request: true,
        destination: Panned::new(PanId(0x4321), Address::Extended(OTHER)),
        source: Panned::new(PanId::BROADCAST, Address::Extended(DEVICE)),
        security: Some(AuxHeader {
            level: Level::EncMic64,
            counter: 5,
            key_index: 9,
        }),
        ..Header::new(FrameType::Command, 0)
    };
    assert_golden(
        "2B DC 84 21 43 02 00 00 00 00 48 DE AC FF FF 01 00 00 00 00 48 DE AC 0E 05 00 00 00 09 \
         01 D8 4F DE 52 90 61 F9 C6 F1",
        &header,
        &hex("01 D8 4F DE 52 90 61 F9 C6 F1"),
    );
}

/// By hand: control 0x9869 (data, secured, acknowledgement requested, compressed, short to short,
/// version 1).
#[test]
fn data_frame_of_this_crate() {
    let header = Header {
        ack_request: true,
        destination: Panned::new(PanId(0xBEEF), short(0)),
        source: Panned::compressed(short(0x42)),
        security: Some(AuxHeader {
            level: Level::EncMic64,
            counter: 0x1234_5678,
            key_index: 5,
        }),
        ..Header::new(FrameType::Data, 7)
    };
    assert_golden(
        "69 98 07 EF BE 00 00 42 00 0E 78 56 34 12 05 00 01 02 03 04 05 06 07",
        &header,
        &[0, 1, 2, 3, 4, 5, 6, 7],
    );
}

/// The beacon of a Zigbee network: version 0, from the short address of its coordinator.
#[test]
fn beacon_of_another_network() {
    let header = Header {
        version: FrameVersion::V2003,
        frame_pending: true,
        source: Panned::new(PanId(0x1A62), short(0)),
        ..Header::new(FrameType::Beacon, 0x6A)
    };
    let payload = hex("FF CF 00 00 00 22 84");
    assert_golden(
        "10 80 6A 62 1A 00 00 FF CF 00 00 00 22 84",
        &header,
        &payload,
    );
}

#[test]
fn what_no_header_is() {
    let cases = [
        ("04 00 00", Malformed::Unsupported), // reserved type
        ("05 00 00", Malformed::Unsupported), // multipurpose
        ("02 00 6A", Malformed::Unsupported), // an immediate acknowledgement
        ("02 18 6A EF BE 42 00", Malformed::Unsupported),
        ("01 20 00", Malformed::Unsupported),       // version 2
        ("01 22 00 00 80", Malformed::Unsupported), // and its information elements
        ("01 30 00", Malformed::Unsupported),       // version 3
        ("81 00 00", Malformed::Reserved),          // bit 7
        ("01 11 00", Malformed::Reserved),          // suppression in version 1
        ("01 12 00", Malformed::Reserved),          // elements in version 1
        ("01 04 00", Malformed::Reserved),          // address mode 1
        ("41 88 00 EF BE", Malformed::Truncated),   // destination cut off
        ("41 08 00 EF BE 00 00", Malformed::PanCompression),
        ("41 80 00 EF BE 00 00", Malformed::PanCompression),
        ("09 08 00 EF BE 00 00 05", Malformed::ObsoleteSecurity),
        ("09 10 00 8E 00 00 00 00 01", Malformed::Reserved), // bit 7 of the security control
        ("09 10 00 2E 00 00 00 00 01", Malformed::Reserved), // suppressed counter
        ("09 10 00 4E 00 00 00 00 01", Malformed::Reserved), // slot number in the nonce
        ("09 10 00 06 00 00 00 00", Malformed::Unsupported), // implicit key
        (
            "09 10 00 16 00 00 00 00 A1 A2 A3 A4 05",
            Malformed::Unsupported,
        ), // source of 4 bytes
        (
            "09 10 00 1E 00 00 00 00 A1 A2 A3 A4 A5 A6 A7 A8 05",
            Malformed::Unsupported,
        ), // source of 8 bytes
        (
            "09 10 00 0E 00 00 00 00 05 01 02 03 04 05 06 07",
            Malformed::Truncated,
        ), // 7 of 8 MIC bytes
    ];
    for (text, error) in cases {
        assert_eq!(Frame::parse(&hex(text)), Err(error), "{text}");
    }
    let obsolete = Header {
        version: FrameVersion::V2003,
        security: Some(AuxHeader {
            level: Level::EncMic64,
            counter: 0,
            key_index: 1,
        }),
        ..Header::new(FrameType::Data, 0)
    };
    assert_eq!(obsolete.emit(&mut [0; 64]), Err(EmitError::Impossible));
    let no_destination = Header {
        source: Panned::compressed(short(1)),
        ..Header::new(FrameType::Data, 0)
    };
    assert_eq!(
        no_destination.emit(&mut [0; 64]),
        Err(EmitError::Impossible)
    );
    let no_pan = Header {
        destination: Panned::compressed(short(1)),
        ..Header::new(FrameType::Data, 0)
    };
    assert_eq!(no_pan.emit(&mut [0; 64]), Err(EmitError::Impossible));
}

#[test]
fn commands() {
    let golden = [
        (
            "01 CA",
            MacCommand::AssociationRequest(DeviceCapabilities::LISTENING),
        ),
        (
            "02 42 00 00",
            MacCommand::AssociationResponse(Association {
                short: ShortAddress(0x42),
                status: AssociationStatus::Successful,
            }),
        ),
        (
            "02 FF FF 01",
            MacCommand::AssociationResponse(Association {
                short: ShortAddress::BROADCAST,
                status: AssociationStatus::AtCapacity,
            }),
        ),
        ("03 02", MacCommand::Disassociation { reason: 2 }),
        ("04", MacCommand::DataRequest),
        ("05", MacCommand::PanIdConflict),
        ("06", MacCommand::Orphan),
        ("07", MacCommand::BeaconRequest),
        (
            "08 EF BE 00 00 0F 42 00",
            MacCommand::CoordinatorRealignment {
                pan: PanId(0xBEEF),
                coordinator: ShortAddress(0),
                channel: 15,
                short: ShortAddress(0x42),
                page: None,
            },
        ),
        (
            "08 EF BE 00 00 0F 42 00 00",
            MacCommand::CoordinatorRealignment {
                pan: PanId(0xBEEF),
                coordinator: ShortAddress(0),
                channel: 15,
                short: ShortAddress(0x42),
                page: Some(0),
            },
        ),
    ];
    for (text, command) in golden {
        let bytes = hex(text);
        assert_eq!(MacCommand::parse(&bytes), Ok(command));
        let mut buffer = [0; 16];
        let len = command.emit(&mut buffer).unwrap();
        assert_eq!(&buffer[..len], bytes);
        for room in 0..len {
            assert_eq!(command.emit(&mut buffer[..room]), Err(EmitError::NoRoom));
        }
    }
    assert_eq!(MacCommand::parse(&[]), Err(Malformed::Truncated));
    assert_eq!(MacCommand::parse(&[0]), Err(Malformed::UnknownCommand));
    assert_eq!(MacCommand::parse(&[9]), Err(Malformed::UnknownCommand));
    assert_eq!(MacCommand::parse(&[7, 0]), Err(Malformed::TrailingBytes));
}

#[test]
fn beacons() {
    let beacon = Beacon::new(Superframe::beaconless(true), b"hello");
    let mut buffer = [0; 64];
    let len = beacon.emit(&mut buffer).unwrap();
    assert_eq!(buffer[..len], hex("FF CF 00 00 68 65 6C 6C 6F"));
    assert_eq!(Beacon::parse(&buffer[..len]), Ok(beacon));
    // One time slot and its direction; one short and one extended pending address.
    let full = hex("FF 4F 01 00 42 00 10 11 21 43 01 02 03 04 05 06 07 08 AA");
    let beacon = Beacon::parse(&full).unwrap();
    assert_eq!(beacon.time_slots, hex("01 00 42 00 10"));
    assert_eq!(beacon.pending, hex("11 21 43 01 02 03 04 05 06 07 08"));
    assert_eq!(beacon.payload, [0xAA]);
    let len = beacon.emit(&mut buffer).unwrap();
    assert_eq!(buffer[..len], full);
    let wrong = Beacon {
        pending: &[1],
        ..beacon
    };
    assert_eq!(wrong.emit(&mut buffer), Err(EmitError::Impossible));
    for cut in 0..18 {
        assert_eq!(Beacon::parse(&full[..cut]), Err(Malformed::Truncated));
    }
}

/// Bytes that are often a frame: reserved bits cleared, length random.
fn nearly_frames() -> impl Strategy<Value = Vec<u8>> {
    (any::<u16>(), vec(any::<u8>(), 0..90)).prop_map(|(control, rest)| {
        let mut bytes = (control & !0x2384).to_le_bytes().to_vec();
        bytes.extend(rest);
        bytes
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn parse_then_emit_is_the_identity(bytes in nearly_frames()) {
        if let Ok(frame) = Frame::parse(&bytes) {
            let mut buffer = [0; 127];
            let len = frame.header().emit(&mut buffer).unwrap();
            prop_assert_eq!(&buffer[..len], frame.header_bytes());
            prop_assert_eq!([frame.header_bytes(), frame.payload()].concat(), bytes);
        }
    }

    #[test]
    fn commands_and_beacons_survive(bytes in vec(any::<u8>(), 0..40)) {
        let mut buffer = [0; 127];
        if let Ok(command) = MacCommand::parse(&bytes) {
            let len = command.emit(&mut buffer).unwrap();
            prop_assert_eq!(&buffer[..len], &bytes);
        }
        if let Ok(beacon) = Beacon::parse(&bytes) {
            let len = beacon.emit(&mut buffer).unwrap();
            prop_assert_eq!(&buffer[..len], &bytes);
        }
    }

    #[test]
    fn any_bytes_are_harmless(bytes in vec(any::<u8>(), 0..=127)) {
        let _ = Frame::parse(&bytes).map(|frame| (frame.header().mic_len(), frame.payload().len()));
    }
}
