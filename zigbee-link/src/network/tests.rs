use super::*;

const NOW: Instant = Instant(1000);

fn key(index: u8) -> Key {
    Key::new(index, core::array::from_fn(|i| index + i as u8)).unwrap()
}

/// A coordinator that runs, with a member, and has nothing more to write down.
fn running() -> Node<4, 4, 2> {
    let own = Eui64([9; 8]);
    let settings = NetworkSettings {
        extended: own,
        channels: Channels::ALL,
        tx_power: 0,
        protection: Protection::EncMic64,
        seed: 1,
        sleeps: false,
    };
    let network = Membership {
        pan: PanId(0xBEEF),
        channel: Channel::FIRST,
        short: ShortAddress::COORDINATOR,
        coordinator: own,
    };
    let saved = Saved {
        counter_limit: 0,
        active_key: key(1),
        next_key: None,
        network: Some(network),
        extended: None,
        former_key: None,
    };
    let member = Member {
        extended: Eui64([1; 8]),
        short: ShortAddress(1),
    };
    let mut node = Node::coordinator(settings, &saved, [Some(member), None]);
    let mut buffer = [0; FRAME_MAX];
    while let Some(action) = node.poll(NOW, &mut buffer) {
        if let Action::Save(record) = action {
            node.saved(record);
        }
    }
    node
}

/// A record that changes while it is written down is written down again.
#[test]
fn what_was_saved_is_no_longer_what_is() {
    let mut node = running();
    let mut buffer = [0; FRAME_MAX];
    for (index, other) in [(2, 3), (4, 4)] {
        node.change_key(key(index)).unwrap();
        let record = Record::NextKey(Some(key(index)));
        assert_eq!(node.poll(NOW, &mut buffer), Some(Action::Save(record)));
        if other != index {
            node.change_key(key(other)).unwrap();
        }
        node.saved(record);
        let again = Record::NextKey(Some(key(other)));
        let is_saved_again = node.poll(NOW, &mut buffer) == Some(Action::Save(again));
        assert_eq!(is_saved_again, other != index);
        node.saved(again);
    }
}

#[test]
fn a_command_waits_until_it_is_due() {
    let mut node = running();
    let mut buffer = [0; FRAME_MAX];
    let due = NOW + Duration::from_millis(100);
    let everybody = Address::Short(ShortAddress::BROADCAST);
    node.common
        .command(due, everybody, MacCommand::PanIdConflict);
    assert_eq!(node.deadline(), Some(due));
    assert_eq!(node.poll(Instant(due.0 - 1), &mut buffer), None);
    let sent = node.poll(due, &mut buffer);
    assert!(matches!(sent, Some(Action::Transmit(_))), "{sent:?}");
    assert_eq!(node.poll(due, &mut buffer), None);
}
