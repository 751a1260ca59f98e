//! Words of errors and addresses for people.

use zigbee_link::{
    link::SendError,
    network::MembersFull,
    radio::{Channel, ChecksumError},
    runner::RunnerError,
    security::{CounterError, Refused, RotationError, SealError, TableFull},
    store::StoreError,
    wire::{Address, EmitError, Eui64, Malformed, PanId, ShortAddress},
};

#[test]
fn addresses_as_they_are_printed_on_devices() {
    let extended = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1]);
    assert_eq!(extended.to_string(), "ac:de:48:00:00:00:00:01");
    assert_eq!(
        Address::Extended(extended).to_string(),
        "ac:de:48:00:00:00:00:01"
    );
    assert_eq!(Address::Short(ShortAddress(0x42)).to_string(), "0x0042");
    assert_eq!(PanId(0xBEEF).to_string(), "0xbeef");
    assert_eq!(Channel::LAST.to_string(), "26");
}

/// Every error says something, each something else, and what wraps an error says what that says.
#[test]
fn errors_say_what_went_wrong() {
    type Store = StoreError<()>;
    let malformed = [
        Malformed::Truncated,
        Malformed::TrailingBytes,
        Malformed::Reserved,
        Malformed::Unsupported,
        Malformed::PanCompression,
        Malformed::ObsoleteSecurity,
        Malformed::UnknownCommand,
    ];
    let refused = [
        Refused::NotForSecurity,
        Refused::Unsecured,
        Refused::Level,
        Refused::Key,
        Refused::NoSource,
        Refused::UnknownShort(ShortAddress(0x42)),
        Refused::OwnAddress,
        Refused::Replayed,
        Refused::Mic,
    ];
    let sending = [
        SendError::NotJoined,
        SendError::QueueFull,
        SendError::TooLong,
        SendError::Destination,
    ];
    let stores = [
        Store::Layout,
        Store::NotProvisioned,
        Store::Corrupt,
        Store::Full,
        Store::Flash(()),
    ];
    let mut texts: Vec<String> = Vec::new();
    texts.extend(malformed.map(|error| error.to_string()));
    texts.extend(refused.map(|error| error.to_string()));
    texts.extend(sending.map(|error| error.to_string()));
    texts.extend(stores.map(|error| error.to_string()));
    texts.extend([EmitError::NoRoom, EmitError::Impossible].map(|error| error.to_string()));
    texts.extend([CounterError::NotReserved, CounterError::Exhausted].map(|e| e.to_string()));
    texts.extend([RotationError::SameIndex, RotationError::NotInstalled].map(|e| e.to_string()));
    texts.push(MembersFull.to_string());
    texts.push(TableFull.to_string());
    texts.push(ChecksumError::<()>::TooLong.to_string());
    texts.push(ChecksumError::Radio(()).to_string());
    for text in &texts {
        assert!(text.len() > 10, "{text:?}");
    }
    let distinct: std::collections::BTreeSet<_> = texts.iter().collect();
    assert_eq!(distinct.len(), texts.len());

    for (wrapped, error) in [
        (
            Refused::from(Malformed::Truncated).to_string(),
            Malformed::Truncated.to_string(),
        ),
        (
            SealError::from(EmitError::NoRoom).to_string(),
            EmitError::NoRoom.to_string(),
        ),
        (
            SealError::Counter(CounterError::Exhausted).to_string(),
            CounterError::Exhausted.to_string(),
        ),
        (
            RunnerError::<(), ()>::Store(Store::Corrupt).to_string(),
            Store::Corrupt.to_string(),
        ),
        (
            RunnerError::<(), ()>::Radio(()).to_string(),
            ChecksumError::Radio(()).to_string(),
        ),
    ] {
        assert_eq!(wrapped, error);
    }
    assert!(
        Refused::UnknownShort(ShortAddress(0x42))
            .to_string()
            .contains("0x0042")
    );
}
