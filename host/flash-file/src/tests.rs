//! Files beside those of other programs, read by parsers of their own.

use board_facts::{
    BOARDS, FEATHER_NRF52840, NRF52833_DK, NRF52840_DK, NUCLEO_L476RG, PCA10059, XIAO_NRF52840,
};

use super::*;

/// An image for an ARM processor, of these parts, each with its bytes at its physical address (System V ABI, "Object
/// files").
fn elf(parts: &[(u32, &[u8])]) -> Vec<u8> {
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|w| w.to_le_bytes()).collect() };
    let halves =
        |halves: &[u16]| -> Vec<u8> { halves.iter().flat_map(|h| h.to_le_bytes()).collect() };
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    // Executable, ARM; headers of parts from byte 52 on.
    file.extend(halves(&[2, 40]));
    file.extend(words(&[1, 0, 52, 0, 0]));
    file.extend(halves(&[52, 32, parts.len() as u16, 0, 0, 0]));
    let mut data = Vec::new();
    for (address, bytes) in parts {
        let offset = 52 + 32 * parts.len() + data.len();
        let len = bytes.len() as u32;
        file.extend(words(&[
            1,
            offset as u32,
            0x2000_0000,
            *address,
            len,
            len,
            4,
            4,
        ]));
        data.extend_from_slice(bytes);
    }
    file.extend(data);
    file
}

/// An image of these parts, whatever they are.
fn image(board: &'static Board, parts: &[(u32, &[u8])]) -> Image {
    let parts = parts.iter().map(|(at, bytes)| (*at, bytes.to_vec()));
    Image {
        board,
        parts: parts.collect(),
    }
}

/// The begin of an image: its stack grows down from 0x20001000 (`ARMv7-M` Architecture Reference Manual, "The vector
/// table").
const VECTORS: [u8; 64] = {
    let mut vectors = [0; 64];
    (vectors[1], vectors[3]) = (0x10, 0x20);
    vectors
};

fn pattern(len: u32) -> Vec<u8> {
    (0..len).map(|i| (i * 7 + 3) as u8).collect()
}

/// Address and payload of each block (<https://github.com/microsoft/uf2>, "File format").
fn blocks(file: &[u8], family: u32) -> Vec<(u32, Vec<u8>)> {
    assert!(file.len().is_multiple_of(512));
    let count = file.len() / 512;
    let blocks = file.chunks(512).enumerate().map(|(number, block)| {
        let word = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap());
        assert_eq!(
            (word(0), word(4), word(508)),
            (0x0a32_4655, 0x9e5d_5157, 0x0ab1_6f30)
        );
        assert_eq!((word(8), word(28)), (0x2000, family));
        assert_eq!((word(20), word(24)), (number as u32, count as u32));
        (word(12), block[32..32 + word(16) as usize].to_vec())
    });
    blocks.collect()
}

/// Files of a ZIP file without compression, in their order (APPNOTE.TXT, "Local file header").
fn files(mut zip: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    while zip.starts_with(b"PK\x03\x04") {
        let half = |at: usize| usize::from(u16::from_le_bytes([zip[at], zip[at + 1]]));
        assert_eq!(half(8), 0, "stored");
        let bytes = half(18) | half(20) << 16;
        let name = 30..30 + half(26);
        let data = name.end + half(28);
        let text = String::from_utf8(zip[name].to_vec()).unwrap();
        files.push((text, zip[data..data + bytes].to_vec()));
        zip = &zip[data + bytes..];
    }
    assert!(zip.starts_with(b"PK\x01\x02"), "the central directory");
    files
}

/// Beginnings and ends of the blocks that `uf2utils` 0.9.8 makes of 512 bytes at 0x27000 and 256 at 0xac000.
#[test]
fn a_uf2_file_is_that_of_another_program() {
    let heads = [
        "5546320a57515d9e00200000007002000001000000000000030000004028a5ad030a11181f262d34",
        "5546320a57515d9e00200000007102000001000001000000030000004028a5ad030a11181f262d34",
        "5546320a57515d9e0020000000c00a000001000002000000030000004028a5ad5a5a5a5a5a5a5a5a",
    ];
    let image = image(&XIAO_NRF52840, &[(0x0002_7000, &pattern(512))]);
    let (ending, file) = image.file(Some(&[0x5a; 256]), false).unwrap();
    assert_eq!((ending, file.len()), ("uf2", heads.len() * 512));
    for (block, head) in file.chunks(512).zip(heads) {
        let hex: String = block[..40]
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        assert_eq!(hex, head);
        assert!(block[288..508].iter().all(|&byte| byte == 0));
        assert_eq!(block[508..], [0x30, 0x6f, 0xb1, 0x0a]);
    }
}

/// Parts that begin and end anywhere. A byte that is in none is erased, and no block is written twice.
#[test]
fn a_uf2_file_holds_each_byte_once() {
    let (first, second) = (pattern(1000), pattern(77));
    let parts: [(u32, &[u8]); 2] = [(0x0002_6000, &first), (0x0002_6000 + 1004, &second)];
    let image = image(&FEATHER_NRF52840, &parts);
    let page = pattern(512);
    let (_, file) = image.file(Some(&page), false).unwrap();
    let blocks = blocks(&file, 0xada5_2840);
    let mut flash = vec![0xff; 1 << 20];
    let mut last = None;
    for (address, payload) in &blocks {
        assert!(last < Some(*address) && payload.len() == 256);
        last = Some(*address);
        flash[*address as usize..][..256].copy_from_slice(payload);
    }
    let mut expected = vec![0xff; 1 << 20];
    expected[0x0002_6000..][..1000].copy_from_slice(&first);
    expected[0x0002_6000 + 1004..][..77].copy_from_slice(&second);
    expected[0x000a_c000..][..512].copy_from_slice(&page);
    assert!(flash == expected);
    // Without a page, the one on the board stays.
    let (_, file) = image.file(None, false).unwrap();
    assert_eq!(self::blocks(&file, 0xada5_2840).len(), blocks.len() - 2);
}

/// Whatever is asked for, nothing is written outside of the board's regions.
#[test]
fn a_file_stays_within_the_regions() {
    for board in BOARDS {
        let region = &board.regions.image;
        let [start, end] = [region.start, region.end].map(|place| board.address(place));
        let elf = elf(&[(start, &VECTORS), (end - 64, &[2; 64])]);
        let image = Image::of(board, &elf).unwrap();
        match image.file(Some(&[3; 512]), false) {
            None => assert!(board.loader.is_none()),
            Some(("uf2", file)) => {
                for (address, payload) in blocks(&file, 0xada5_2840) {
                    let block = address..address + payload.len() as u32;
                    let page = page(board);
                    let is_in =
                        |part: &Range<u32>| part.start <= block.start && block.end <= part.end;
                    assert!(is_in(&(start..end)) || is_in(&page), "{block:x?}");
                }
            }
            Some((_, package)) => {
                let (name, image) = files(&package).pop().unwrap();
                assert_eq!((&*name, image.len() as u32), ("node.bin", end - start));
            }
        }
    }
}

/// The init packet that `nrfutil pkg generate` makes, version 6.0.0a1, with `--hw-version 52 --sd-req 0
/// --application-version 1` and 300 bytes.
#[test]
fn a_package_is_that_of_another_program() {
    let init = "0a420801123e080110341a010020002800300038ac024224080312207234ad2d4f15a1bc15171a0321200db0984b66\
                829aa0a1cfaf1cc826873f77044800520408011200";
    let image = image(&PCA10059, &[(0x1000, &pattern(300))]);
    let (ending, package) = image.file(None, false).unwrap();
    let files = files(&package);
    let names: Vec<_> = files.iter().map(|(name, _)| &**name).collect();
    assert_eq!(
        (ending, &*names),
        ("zip", &["manifest.json", "node.dat", "node.bin"][..])
    );
    let [manifest, dat, bin] = [0, 1, 2].map(|number| &files[number].1);
    let manifest: serde_json::Value = serde_json::from_slice(manifest).unwrap();
    let parts =
        serde_json::json!({"application": {"bin_file": "node.bin", "dat_file": "node.dat"}});
    assert_eq!(manifest, serde_json::json!({ "manifest": parts }));
    let hex: String = dat.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!((&*hex, bin), (init, &pattern(300)));
}

/// Of a dongle the page is between the vectors and the code: 0x200 behind the start.
#[test]
fn a_package_has_the_page_in_the_image() {
    let image = image(&PCA10059, &[(0x1000, &[1; 256]), (0x1400, &[2; 100])]);
    let page = pattern(52);
    let (_, package) = image.file(Some(&page), false).unwrap();
    let (_, bin) = files(&package).pop().unwrap();
    let erased = |len| vec![0xff; len];
    let expected = [
        vec![1; 256],
        erased(256),
        page,
        erased(512 - 52),
        vec![2; 100],
    ];
    assert_eq!(bin, expected.concat());
}

#[test]
fn images_of_other_boards_are_refused() {
    let of = |board, elf: &[u8]| Image::of(board, elf).map(|_| ());
    let kit = elf(&[(0, &VECTORS)]);
    assert_eq!(of(&NRF52840_DK, &kit), Ok(()));
    for board in [&PCA10059, &FEATHER_NRF52840, &XIAO_NRF52840, &NUCLEO_L476RG] {
        let start = board.address(board.regions.image.start);
        assert_eq!(of(board, &kit), Err(ImageError::Before(0, start)));
    }
    let feather = elf(&[(0x0002_6000, &VECTORS)]);
    assert_eq!(
        of(&XIAO_NRF52840, &feather),
        Err(ImageError::Before(0x0002_6000, 0x0002_7000))
    );
    // It has room there, but no board starts in the middle of its region.
    assert_eq!(
        of(&NRF52840_DK, &feather),
        Err(ImageError::Elsewhere(0x0002_6000, 0))
    );
    let long = elf(&[(0x0009_9ffd, &[0; 4])]);
    assert_eq!(
        of(&XIAO_NRF52840, &long),
        Err(ImageError::Behind(0x0009_a001, 0x0009_a000))
    );
    let over = elf(&[(0x11fd, &[0; 4])]);
    assert_eq!(of(&PCA10059, &over), Err(ImageError::OnPage(0x1200)));
    assert_eq!(of(&NRF52840_DK, &elf(&[])), Err(ImageError::Empty));
    assert_eq!(of(&NRF52840_DK, b"none"), Err(ImageError::NoElf));
    let mut other = kit.clone();
    other[18] = 62;
    assert_eq!(of(&NRF52840_DK, &other), Err(ImageError::NotArm));
    // A copy that was interrupted, from the byte on that tells an ELF file of 32 bits.
    for length in 5..kit.len() {
        assert_eq!(of(&NRF52840_DK, &kit[..length]), Err(ImageError::CutOff));
    }
}

/// RAM of the chips: 256, 128 and 96 KiB from 0x20000000 on.
#[test]
fn an_image_has_its_stack_in_the_ram_of_the_chip() {
    let with_stack = |board: &'static Board, stack: u32| {
        let mut vectors = VECTORS;
        vectors[..4].copy_from_slice(&stack.to_le_bytes());
        let start = board.address(board.regions.image.start);
        Image::of(board, &elf(&[(start, &vectors)])).map(|_| ())
    };
    for (board, end) in [
        (&NRF52840_DK, 0x2004_0000),
        (&NRF52833_DK, 0x2002_0000),
        (&NUCLEO_L476RG, 0x2001_8000),
    ] {
        for stack in [0x2000_0100, end] {
            assert_eq!(with_stack(board, stack), Ok(()));
        }
        for stack in [0, 0x1fff_fff8, 0x2000_0000, end + 8, u32::MAX] {
            assert_eq!(with_stack(board, stack), Err(ImageError::Stack(stack)));
        }
    }
    let short = elf(&[(0, &[0, 0x10])]);
    assert!(Image::of(&NRF52840_DK, &short).is_err());
}

/// Variables of an image, of which only some have a value in the flash.
#[test]
fn an_image_has_its_variables_in_the_ram_of_the_chip() {
    // The second part is at 0x20000000 when it runs. Its length there is the sixth word of the second header.
    let with_memory = |board: &'static Board, bytes: u32| {
        let mut image = elf(&[(0, &VECTORS), (0x100, &[1; 4])]);
        image[52 + 32 + 20..][..4].copy_from_slice(&bytes.to_le_bytes());
        Image::of(board, &image).map(|_| ())
    };
    for (board, most) in [(&NRF52840_DK, 256 << 10), (&NRF52833_DK, 128 << 10)] {
        assert_eq!(with_memory(board, most), Ok(()));
        let end = u64::from(0x2000_0004 + most);
        let memory = Err(ImageError::Memory(0x2000_0000, end));
        assert_eq!(with_memory(board, most + 4), memory);
    }
}

/// A board that has the boot loader for updates takes their images over a cable, too, and the loader itself.
#[test]
fn images_for_updates_and_their_loader_are_images() {
    let image = elf(&[(0x8000, &VECTORS), (0x0006_7fc0, &[2; 64])]);
    assert!(Image::of(&NRF52840_DK, &image).is_ok());
    assert_eq!(updated(&NRF52840_DK, &image).unwrap().len(), 384 << 10);
    let long = elf(&[(0x8000, &VECTORS), (0x0006_7fc0, &[2; 65])]);
    let behind = Err(ImageError::Behind(0x0006_8001, 0x0006_8000));
    assert_eq!(Image::of(&NRF52840_DK, &long).map(|_| ()), behind);
    let program = elf(&[(0, &VECTORS)]);
    assert!(Image::of(&NRF52840_DK, &program).is_ok());
    assert_eq!(loader(&NRF52840_DK, &program).as_deref(), Ok(&VECTORS[..]));
    // Other boards have no such loader.
    let at = elf(&[(0x8000, &VECTORS)]);
    let elsewhere = Err(ImageError::Elsewhere(0x8000, 0));
    assert_eq!(Image::of(&NRF52833_DK, &at).map(|_| ()), elsewhere);
    assert_eq!(
        updated(&NRF52840_DK, &program),
        Err(ImageError::Before(0, 0x8000))
    );
}

/// Memory of the Feather, which is a part of its flash behind that for images.
#[test]
fn a_uf2_file_makes_a_node_forget() {
    let feather = image(&FEATHER_NRF52840, &[(0x0002_6000, &[1; 256])]);
    let (_, file) = feather.file(None, true).unwrap();
    let mut blocks = blocks(&file, 0xada5_2840).into_iter();
    assert_eq!(blocks.next(), Some((0x0002_6000, vec![1; 256])));
    let erased = (0x0009_a000..0x000a_c000).step_by(256);
    assert!(blocks.eq(erased.map(|address| (address, vec![0xff; 256]))));
    // One piece does not reach so far.
    let dongle = image(&PCA10059, &[(0x1000, &[1; 256])]);
    assert!(dongle.file(None, true).is_none());
}

#[test]
fn bytes_are_found_in_a_uf2_file() {
    let image = image(&XIAO_NRF52840, &[(0x0002_7000, &pattern(600))]);
    let (_, mut file) = image.file(None, false).unwrap();
    file.splice(0..0, [0; 512]);
    let read = |at, len| uf2::read(&file, at, len);
    assert_eq!(
        read(0x0002_7000 + 250, 300).unwrap(),
        pattern(600)[250..550]
    );
    assert_eq!(read(0x0002_7000 + 600, 168), Some(vec![0xff; 168]));
    assert_eq!(read(0x0002_7000 + 600, 169), None);
    assert_eq!(read(0x0002_6fff, 2), None);
    assert_eq!(uf2::read(&file[..511], 0, 1), None);
}
