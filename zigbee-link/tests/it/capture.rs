//! tshark, which was written by others, reads, decrypts and checks what a network sends.

use crate::support;

use std::{
    collections::BTreeMap, fmt::Write as _, fs, path::PathBuf, process::Command, time::Duration,
};

use support::aether::{Aether, eui, key, key_bytes};
use zigbee_link::{
    link::Delivery,
    radio::{pcap_header, pcap_record},
    wire::{Eui64, ShortAddress},
};

const SECOND: Duration = Duration::from_secs(1);

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

/// Values of these fields by tshark, one row per frame.
fn dissect(
    capture: &PathBuf,
    addresses: &[(ShortAddress, u16, Eui64)],
    filter: &str,
    fields: &[&str],
) -> Vec<Vec<String>> {
    let mut tshark = Command::new("tshark");
    tshark.arg("-r").arg(capture);
    for index in [1, 2] {
        let key = hex(&key_bytes(index));
        tshark.arg("-o").arg(format!(
            "uat:ieee802154_keys:\"{key}\",\"{index}\",\"No hash\""
        ));
    }
    for (short, pan, extended) in addresses {
        let extended = hex(&extended.0);
        let entry = format!("\"{:#06x}\",\"{pan:#06x}\",{extended}", short.0);
        tshark
            .arg("-o")
            .arg(format!("uat:802154_addresses:{entry}"));
    }
    for other in [
        "6lowpan",
        "zbee_nwk",
        "lwm",
        "zbee_beacon",
        "thread_beacon",
        "ieee802154_6top",
    ] {
        tshark.args(["--disable-protocol", other]);
    }
    if !filter.is_empty() {
        tshark.args(["-Y", filter]);
    }
    tshark.args(["-T", "fields"]);
    for field in fields {
        tshark.args(["-e", field]);
    }
    let output = tshark.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .map(|line| line.split('\t').map(str::to_owned).collect())
        .collect()
}

/// Join, data, loss with retries, a change of the key, more data.
fn network() -> (Aether, Vec<Vec<u8>>) {
    let mut aether = Aether::new(0.0, 11);
    aether.add(0, key(1));
    for number in 1..=3 {
        aether.add(number, key(1));
        aether.stations[0].node.allow(eui(number).number()).unwrap();
    }
    aether.run(5 * SECOND);
    let mut sent = Vec::new();
    let mut talk = |aether: &mut Aether| {
        for (from, to) in [(1, 2), (2, 0), (0, 3), (3, 1)] {
            let message: [u8; 20] = core::array::from_fn(|i| i as u8 * 3 + sent.len() as u8);
            let destination = aether.short(to).unwrap();
            let now = aether.now;
            let link = &mut aether.stations[from].node.link;
            let ticket = link.send(now, destination, &message).unwrap();
            aether.run(20 * SECOND);
            let delivery = aether.stations[from].node.link.result_of(ticket);
            assert_eq!(delivery, Some(Delivery::Delivered));
            sent.push(message.to_vec());
        }
    };
    talk(&mut aether);
    aether.loss = 0.3;
    talk(&mut aether);
    aether.loss = 0.0;
    aether.stations[0].node.change_key(key(2)).unwrap();
    aether.run(5 * SECOND);
    talk(&mut aether);
    (aether, sent)
}

#[test]
#[ignore = "needs tshark: cargo xtask peers"]
fn tshark_reads_a_whole_network() {
    let (aether, sent) = network();
    let mut file = pcap_header().to_vec();
    for on_air in &aether.heard {
        let record = pcap_record(on_air.at, on_air.channel, Some(-50), &on_air.frame).unwrap();
        file.extend_from_slice(&record);
    }
    let directory = tempfile::tempdir().unwrap();
    let capture = directory.path().join("network.pcap");
    fs::write(&capture, &file).unwrap();

    let network = aether.stations[0].saved.network.unwrap();
    let members = aether.stations[0].node.members();
    let mut addresses: Vec<_> = members
        .map(|member| (member.short, network.pan.0, member.extended))
        .collect();
    addresses.push((ShortAddress(0), network.pan.0, eui(0)));
    let ask = |filter: &str, fields: &[&str]| dissect(&capture, &addresses, filter, fields);

    // Every frame is dissected, its FCS is right, and what is secured is decrypted.
    let all = ask("", &["frame.number", "wpan.fcs_ok", "wpan-tap.ch_num"]);
    assert_eq!(all.len(), aether.heard.len());
    for (row, on_air) in all.iter().zip(&aether.heard) {
        assert!(["1", "True"].contains(&row[1].as_str()), "{row:?}");
        assert_eq!(row[2], on_air.channel.number().to_string());
    }
    for filter in [
        "wpan.decrypt_error",
        "_ws.malformed",
        "_ws.expert.severity >= 0x00600000",
    ] {
        let rows = ask(filter, &["frame.number", "_ws.expert.message"]);
        assert!(rows.is_empty(), "{filter}: {rows:?}");
    }

    // Nothing is secured but with level 6, an explicit key, and ever rising counters.
    let secured = ask(
        "wpan.security == 1",
        &[
            "wpan.aux_sec.sec_level",
            "wpan.aux_sec.key_index",
            "wpan.src64",
            "wpan.src16",
            "wpan.aux_sec.frame_counter",
        ],
    );
    assert!(secured.len() > 60);
    let mut last = BTreeMap::new();
    for row in &secured {
        assert!(["6", "0x06"].contains(&row[0].as_str()), "{row:?}");
        let source = match row[2].as_str() {
            "" => {
                let short = row[3].trim_start_matches("0x");
                let short = ShortAddress(u16::from_str_radix(short, 16).unwrap());
                let of = addresses.iter().find(|(it, ..)| *it == short).unwrap();
                of.2.to_string()
            }
            extended => extended.to_owned(),
        };
        let counter: u32 = row[4].parse().unwrap();
        let before = last.insert(source, counter);
        assert!(before.is_none_or(|before| before < counter), "{row:?}");
    }
    let indices: Vec<_> = secured.iter().map(|row| row[1].as_str()).collect();
    assert!(
        indices.contains(&"1") || indices.contains(&"0x01"),
        "{indices:?}"
    );
    assert!(
        indices.contains(&"2") || indices.contains(&"0x02"),
        "{indices:?}"
    );

    // Each message is in the capture, in clear, behind its two bytes.
    let data = ask("wpan.frame_type == 1", &["data.data"]);
    for message in &sent {
        let text = hex(message);
        let copies = data
            .iter()
            .filter(|row| row[0].len() == 44 && row[0].ends_with(&text));
        assert!(copies.count() >= 1, "{text}");
    }

    // The commands of joining are what tshark, too, takes them for.
    let commands = ask("wpan.frame_type == 3", &["wpan.cmd"]);
    let count = |id: u8| {
        let is_it = |text: &str| {
            let digits = text.trim_start_matches("0x");
            u8::from_str_radix(digits, 16) == Ok(id)
        };
        commands.iter().filter(|row| is_it(&row[0])).count()
    };
    assert!(
        count(7) >= 3 && count(1) >= 3 && count(2) >= 3,
        "{commands:?}"
    );
    let given = ask("wpan.cmd == 2", &["wpan.asoc.addr", "wpan.assoc.status"]);
    assert!(given.len() >= 3, "{given:?}");
}

/// A frame with a wrong integrity code is noticed: the check above can fail.
#[test]
#[ignore = "needs tshark: cargo xtask peers"]
fn tshark_notices_a_forged_frame() {
    let (aether, _) = network();
    let secured = aether
        .heard
        .iter()
        .find(|on_air| on_air.frame[0] & 0x08 != 0)
        .unwrap();
    let mut forged = secured.frame.clone();
    *forged.last_mut().unwrap() ^= 1;
    let mut file = pcap_header().to_vec();
    file.extend_from_slice(&pcap_record(secured.at, secured.channel, None, &forged).unwrap());
    let directory = tempfile::tempdir().unwrap();
    let capture = directory.path().join("forged.pcap");
    fs::write(&capture, &file).unwrap();
    let rows = dissect(&capture, &[], "wpan.decrypt_error", &["frame.number"]);
    assert_eq!(rows.len(), 1);
}
