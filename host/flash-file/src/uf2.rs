//! UF2 (<https://github.com/microsoft/uf2>): blocks of 512 bytes, each with 256 bytes for an address.

use std::collections::BTreeMap;

/// Bytes of a block.
const BLOCK: usize = 512;
/// Bytes of it before those of the flash.
const HEAD: usize = 32;
/// Bytes of the flash in a block.
const PAYLOAD: usize = 256;
/// Bytes of a block for them.
const ROOM: usize = 476;

const FIRST_MAGIC: u32 = 0x0a32_4655;
const SECOND_MAGIC: u32 = 0x9e5d_5157;
const LAST_MAGIC: u32 = 0x0ab1_6f30;
/// The block tells its family.
const HAS_FAMILY: u32 = 0x2000;

/// A file of these bytes by their addresses. Between them, and around them up to whole blocks, the flash is erased.
pub(crate) fn file(family: u32, parts: &BTreeMap<u32, Vec<u8>>) -> Vec<u8> {
    let mut blocks = BTreeMap::new();
    for (&start, part) in parts {
        for (at, &byte) in (start as usize..).zip(part) {
            let block = blocks.entry(at / PAYLOAD).or_insert([0xff; PAYLOAD]);
            block[at % PAYLOAD] = byte;
        }
    }
    let count = blocks.len() as u32;
    let mut file = Vec::new();
    for (number, (at, payload)) in (0_u32..).zip(blocks) {
        let address = (at * PAYLOAD) as u32;
        let head = [
            FIRST_MAGIC,
            SECOND_MAGIC,
            HAS_FAMILY,
            address,
            PAYLOAD as u32,
            number,
            count,
            family,
        ];
        file.extend(head.into_iter().flat_map(u32::to_le_bytes));
        file.extend(payload);
        file.extend([0; ROOM - PAYLOAD]);
        file.extend(LAST_MAGIC.to_le_bytes());
    }
    file
}

/// The family of the first block of a file.
pub fn family(file: &[u8]) -> Option<u32> {
    word(file, 28)
}

/// So many bytes at an address, if blocks of a file hold them all. What is no block is left.
pub fn read(file: &[u8], address: u32, len: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![None; len];
    for block in file.as_chunks::<BLOCK>().0 {
        let magic = [word(block, 0)?, word(block, 4)?, word(block, BLOCK - 4)?];
        if magic != [FIRST_MAGIC, SECOND_MAGIC, LAST_MAGIC] {
            continue;
        }
        let (start, count) = (word(block, 12)?, word(block, 16)? as usize);
        let payload = block.get(HEAD..HEAD + count.min(ROOM))?;
        for (at, &byte) in (u64::from(start)..).zip(payload) {
            let place = at.checked_sub(address.into());
            let place = place.and_then(|place| bytes.get_mut(usize::try_from(place).ok()?));
            if let Some(place) = place {
                *place = Some(byte);
            }
        }
    }
    bytes.into_iter().collect()
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(u32::from_le_bytes(*bytes))
}
