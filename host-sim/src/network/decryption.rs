//! Key and addresses that Wireshark needs to read a capture of a simulation.

use std::fmt::Write as _;

use super::{KEY_INDEX, Simulation, secret};
use node_firmware::role::COORDINATOR;
use virtual_hardware::random::Root;
use zigbee_link::wire::Eui64;

/// Protocols that Wireshark would otherwise see in payloads, though they are of none of these.
const OTHERS: [&str; 6] = [
    "6lowpan",
    "zbee_nwk",
    "lwm",
    "zbee_beacon",
    "thread_beacon",
    "ieee802154_6top",
];

impl Simulation {
    /// A shell script, named after a capture with `.sh`, that shows it decrypted. It has the simulation's
    /// own key, which is drawn from its seed, and the owners of the short addresses. It is complete at
    /// the end of a run, when these are known.
    pub fn decryption_script(&self) -> String {
        let mut script = "#!/bin/sh\n\
             # Shows the capture decrypted, with the key that this simulation drew from its seed:\n\
             #   sh FILE.pcap.sh [OPTIONS OF TSHARK]\n\
             #   WIRESHARK=wireshark sh FILE.pcap.sh\n\
             exec \"${WIRESHARK:-tshark}\" -r \"${0%.sh}\" \\\n"
            .to_owned();
        let key = hex(&secret(Root(self.scenario.seed)));
        let index = KEY_INDEX;
        // This cannot fail: a `String` takes all.
        let _ = writeln!(
            script,
            " -o 'uat:ieee802154_keys:\"{key}\",\"{index}\",\"No hash\"' \\"
        );
        for console in &self.consoles {
            let view = console.view();
            let Some(network) = view.network() else {
                continue;
            };
            let members = view.members().iter().map(|m| (m.address, m.id));
            for (address, id) in members.chain([(COORDINATOR.0, console.id())]) {
                let node = self.node(id);
                let Some(Eui64(extended)) = node.and_then(|node| node.extended()) else {
                    continue;
                };
                let (pan, extended) = (network.pan, hex(&extended));
                let _ = writeln!(
                    script,
                    " -o 'uat:802154_addresses:\"{address:#06x}\",\"{pan:#06x}\",{extended}' \\"
                );
            }
        }
        for other in OTHERS {
            let _ = writeln!(script, " --disable-protocol {other} \\");
        }
        script + " \"$@\"\n"
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
