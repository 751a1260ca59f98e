//! A package for Nordic's boot loader with DFU: a ZIP file of a manifest, an image, and an init packet (nRF5 SDK,
//! "DFU bootloader", `dfu-cc.proto`). It is not signed: the boot loader of the dongle does not ask for that.

pub mod serial;

use std::io::{Cursor, Write};

use serde_json::json;
use sha2::{Digest, Sha256};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

const IMAGE: &str = "node.bin";
const INIT: &str = "node.dat";

/// Number that the boot loader would compare with that of the image before; a dongle's takes any.
const VERSION: u64 = 1;

/// An image, and the packet that tells a boot loader about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Package {
    init: Vec<u8>,
    image: Vec<u8>,
}

impl Package {
    /// A package of this image.
    pub(crate) fn new(hardware: u32, image: Vec<u8>) -> Self {
        Self {
            init: init_packet(hardware, &image),
            image,
        }
    }

    /// The package as a ZIP file.
    pub fn file(&self) -> Vec<u8> {
        let Self { init, image } = self;
        let manifest = json!({
            "manifest": { "application": { "bin_file": IMAGE, "dat_file": INIT } }
        });
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        // The same bytes from the same image, at any time.
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default());
        for (name, bytes) in [
            ("manifest.json", manifest.to_string().as_bytes()),
            (INIT, init),
            (IMAGE, image),
        ] {
            let written = zip
                .start_file(name, options)
                .and_then(|()| Ok(zip.write_all(bytes)?));
            written.expect("memory takes all");
        }
        zip.finish().expect("memory takes all").into_inner()
    }
}

/// `Packet { command: Command { op_code: INIT, init: InitCommand } }`.
fn init_packet(hardware: u32, image: &[u8]) -> Vec<u8> {
    const APPLICATION: u64 = 0;
    const SHA256: u64 = 3;
    const INIT_COMMAND: u64 = 1;
    const GENERATED_CRC: u64 = 1;
    // With the last byte first, as numbers are on the chip.
    let mut digest = Sha256::digest(image);
    digest.reverse();
    let hash = [number(1, SHA256), bytes(2, &digest)].concat();
    let init = [
        number(1, VERSION),
        number(2, hardware.into()),
        // Any SoftDevice, or none.
        bytes(3, &[0]),
        number(4, APPLICATION),
        number(5, 0),
        number(6, 0),
        number(7, image.len() as u64),
        bytes(8, &hash),
        // No package for debugging.
        number(9, 0),
        bytes(10, &[number(1, GENERATED_CRC), bytes(2, &[])].concat()),
    ];
    let command = [number(1, INIT_COMMAND), bytes(2, &init.concat())];
    bytes(1, &command.concat())
}

/// A field that is a number (Protocol Buffers, "Encoding").
fn number(field: u64, value: u64) -> Vec<u8> {
    [varint(field << 3), varint(value)].concat()
}

/// A field of some bytes: a message, or a packed list.
fn bytes(field: u64, value: &[u8]) -> Vec<u8> {
    [
        varint(field << 3 | 2),
        varint(value.len() as u64),
        value.to_vec(),
    ]
    .concat()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}
