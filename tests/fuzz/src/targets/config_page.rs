//! A configuration page of any bytes, with its checksum put right: a page that is read can be written, and is then
//! read as the same.

use flash_log::Crc32;
use node_firmware::config::page::{self, PAGE_MAX};

/// Bytes before the configuration, the last two of which are its length.
const HEADER: usize = 8;

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let _ = page::decode(bytes);
    if bytes.len() < HEADER {
        return;
    }
    let mut right = bytes.to_vec();
    let length = (bytes.len() - HEADER) as u16;
    right[6..HEADER].copy_from_slice(&length.to_le_bytes());
    let sum = Crc32::of(&right);
    right.extend(sum.to_le_bytes());
    let Ok(config) = page::decode(&right) else {
        return;
    };
    let mut again = [0; PAGE_MAX];
    if page::encode(&config, &mut again).is_ok() {
        assert_eq!(page::decode(&again).as_ref(), Ok(&config));
    }
}
