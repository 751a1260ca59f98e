//! tshark, an independent program, reads the capture of a run with the script beside it.

use std::process::Command;

use crate::common::{Files, run};

/// Every frame of the air that is secured is decrypted, those of a sighting among them.
#[test]
#[ignore = "needs tshark: cargo xtask peers"]
fn tshark_decrypts_a_capture() {
    let files = Files::new();
    let pcap = files.path("it's the air.pcap");
    let done = run(&["run", "lab", "--pcap", &pcap]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let frames = |filter: &str| {
        let arguments = ["-Y", filter, "-T", "fields", "-e", "data.data"];
        let shown = Command::new("sh")
            .arg(format!("{pcap}.sh"))
            .args(arguments)
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&shown.stderr);
        assert!(shown.status.success(), "{errors}");
        let text = String::from_utf8(shown.stdout).unwrap();
        text.lines().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(frames("wpan.decrypt_error"), [""; 0]);
    let secured = frames("wpan.security == 1 && wpan.frame_type == 1");
    assert!(secured.len() > 100 && secured.iter().all(|data| !data.is_empty()));
}
