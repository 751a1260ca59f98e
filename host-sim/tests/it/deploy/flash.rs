//! Calls of probe-rs by `host-sim flash`; a script takes the place of probe-rs.

use std::{
    fs,
    io::{ErrorKind, Read, Write},
    ops::Range,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use node_firmware::config::page::PAGE_MAX;

use super::place::{CARRIER, Place};
use crate::common::LineEnd;

/// Notes its calls. It fails at the call that is named in `FAIL`. The file `read` has the contents of the
/// board's flash, as probe-rs prints them; without it the flash is erased.
const PROBE_RS: &str = r#"
here="${0%/*}"
echo "$*" >> "$here/calls"
case "$*" in "${FAIL:-never}"*) exit 3 ;; esac
case "$1" in read)
    if [ -e "$here/read" ]; then while read -r line; do echo "$line"; done < "$here/read"
    else at=0; while [ $at -lt 512 ]; do printf 'ff '; at=$((at + 1)); done; fi
esac
"#;

/// Highest end of an image.
const IMAGE_END: u32 = 0x000e_d000;

fn place() -> Place {
    let place = Place::with_key();
    fs::write(place.path("image.elf"), elf(0, IMAGE_END)).unwrap();
    provision(&place, "target", "page.bin");
    place
}

fn provision(place: &Place, role: &str, name: &str) {
    let role_option = format!("--role={role}");
    let out = format!("--out={name}");
    let words = [
        "provision",
        "--site-key=site.sitekey",
        &role_option,
        "--id=4",
        &out,
        "--overwrite",
    ];
    let asked: &[_] = match role {
        "camera" => &["--field-of-view=45"],
        _ => &CARRIER,
    };
    place.run(&[&words[..], asked].concat()).ok();
}

/// The begin of an image: its stack begins at 0x20001000 (ARMv7-M Architecture Reference Manual, "The vector table").
const BEGIN: &[u8; 8] = b"\0\x10\0\x20code";

/// An image for an ARM processor that begins there, with 4 more bytes before its end if that is not the end of
/// [`BEGIN`] (System V ABI, "Object files").
fn elf(start: u32, end: u32) -> Vec<u8> {
    let half = |number: u16| number.to_le_bytes().to_vec();
    let word = |number: u32| number.to_le_bytes().to_vec();
    let mut parts = vec![(start, &BEGIN[..])];
    if end > start + BEGIN.len() as u32 {
        parts.push((end - 4, b"last"));
    }
    let (header, part) = (52, 32);
    let mut file = [
        // 32 bits, little-endian, version 1; executable, ARM.
        b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec(),
        half(2),
        half(40),
        word(1),
        word(0),
        word(header),
        word(0),
        word(0),
        half(header as u16),
        half(part as u16),
        half(parts.len() as u16),
        half(0),
        half(0),
        half(0),
    ]
    .concat();
    let mut offset = header + part * parts.len() as u32;
    for &(address, bytes) in &parts {
        let length = bytes.len() as u32;
        // To be loaded: offset, virtual and physical address, bytes in the file and in memory, readable.
        let words = [1, offset, 0x2000_0000, address, length, length, 4, 4];
        file.extend(words.map(u32::to_le_bytes).concat());
        offset += length;
    }
    file.extend(parts.iter().flat_map(|(_, bytes)| *bytes));
    file
}

fn install(place: &Place) {
    place.install("probe-rs", PROBE_RS);
}

/// The board has this page, printed as old versions of probe-rs do, or as new ones.
fn board_has(place: &Place, page: &str, with_addresses: bool) {
    let page = fs::read(place.path(page)).unwrap();
    let text: String = page
        .chunks(8)
        .enumerate()
        .map(|(line, bytes)| {
            let address = format!("{:08x}: ", 0x000f_f000 + 8 * line);
            let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            let start = if with_addresses { address.as_str() } else { "" };
            format!("{start}{}\n", bytes.join(" "))
        })
        .collect();
    place.write("bin/read", &text);
}

/// Arguments of the calls of probe-rs, without the folder of the test.
fn calls(place: &Place) -> Vec<String> {
    let calls = fs::read_to_string(place.path("bin/calls")).unwrap_or_default();
    let folder = format!("{}/", place.path("").canonicalize().unwrap().display());
    let calls = calls.replace(&folder, "");
    calls.lines().map(str::to_owned).collect()
}

const LOOK: &str = "read --chip nRF52840_xxAA b8 0x000ff000 512";
const IMAGE: &str = "download --chip nRF52840_xxAA --verify --binary-format elf image.elf";
const PAGE: &str = "download --chip nRF52840_xxAA --verify --binary-format bin \
                    --base-address 0x000ff000 page.bin";
const RESET: &str = "reset --chip nRF52840_xxAA";
const FLASH: [&str; 4] = [
    "flash",
    "nrf52840",
    "--image=image.elf",
    "--config=page.bin",
];

#[test]
fn image_page_and_reset() {
    let place = place();
    install(&place);
    let run = place.run(&FLASH);
    assert!(run.stderr.contains("role = \"target\""), "{}", run.stderr);
    run.ok();
    assert_eq!(calls(&place), [LOOK, IMAGE, PAGE, RESET]);
}

/// Another board's flash has other addresses, and so have its pages: 0x080ed800 to 0x080fffff.
#[test]
fn another_board() {
    let place = place();
    install(&place);
    let chip = "--chip STM32L476RGTx";
    let words = [
        "flash",
        "nucleo-l476rg",
        "--image=image.elf",
        "--config=page.bin",
        "--erase-memory",
    ];
    // The image of the other board, and one that is too long.
    place.run(&words).fails("before the board's image");
    fs::write(place.path("image.elf"), elf(0x0800_0000, 0x0808_0001)).unwrap();
    place.run(&words).fails("behind the part for images");
    assert!(calls(&place).is_empty());
    fs::write(place.path("image.elf"), elf(0x0800_0000, 0x0808_0000)).unwrap();
    place.run(&words[..4]).ok();
    place.run(&words).ok();
    let image = format!("download {chip} --verify --binary-format elf image.elf");
    let bytes = format!("download {chip} --verify --binary-format bin --base-address");
    let page = format!("{bytes} 0x080ff800 page.bin");
    let reset = format!("reset {chip}");
    let look = format!("read {chip} b8 0x080ff800 512");
    let mut calls = calls(&place);
    let erase = calls.remove(6);
    let expected = [&look, &image, &page, &reset, &image, &page, &reset];
    assert_eq!(calls, expected.map(String::clone));
    let (start, file) = erase.rsplit_once(' ').unwrap();
    assert_eq!(start, format!("{bytes} 0x080ed800"));
    assert!(file.ends_with("image.erased.bin"), "{file}");
    assert!(fs::read(place.path(file)).unwrap() == vec![0xFF; 0x1_2000]);
}

#[test]
fn an_image_alone_for_one_of_several_probes() {
    let place = place();
    install(&place);
    place
        .run(&[&FLASH[..3], &["--probe=1366:1015:00012"]].concat())
        .ok();
    let probe = "--chip nRF52840_xxAA --probe 1366:1015:00012";
    let expected = [IMAGE, RESET].map(|call| call.replace("--chip nRF52840_xxAA", probe));
    assert_eq!(calls(&place), expected);
}

/// The memory is at 0x000ed000 to 0x000fefff.
#[test]
fn the_memory_is_erased_last() {
    let place = place();
    install(&place);
    let run = place.run(&[FLASH.as_slice(), &["--erase-memory"]].concat());
    run.ok();
    let calls = calls(&place);
    let [image, page, erase, reset] = calls.as_slice() else {
        panic!("{calls:?}");
    };
    assert_eq!([image, page, reset], [IMAGE, PAGE, RESET]);
    let (start, file) = erase.rsplit_once(' ').unwrap();
    assert_eq!(
        start,
        "download --chip nRF52840_xxAA --verify --binary-format bin --base-address 0x000ed000"
    );
    assert!(fs::read(place.path(file)).unwrap() == vec![0xFF; 0x1_2000]);
}

/// `UICR.APPROTECT` (nRF52840 Product Specification, 4.5): 0x00 in its lowest byte closes the port on
/// every revision. It is written last, with the rest of its page kept.
#[test]
fn a_locked_board_is_closed_last() {
    let place = place();
    install(&place);
    place.run(&[FLASH.as_slice(), &["--lock"]].concat()).ok();
    let calls = calls(&place);
    let [LOOK, IMAGE, PAGE, lock, RESET] = calls.iter().map(String::as_str).collect::<Vec<_>>()[..]
    else {
        panic!("{calls:?}");
    };
    let (start, file) = lock.rsplit_once(' ').unwrap();
    assert_eq!(
        start,
        "download --chip nRF52840_xxAA --restore-unwritten --binary-format bin --base-address 0x10001208"
    );
    assert_eq!(fs::read(place.path(file)).unwrap(), [0, 0xFF, 0xFF, 0xFF]);
}

/// Nothing of the board can be read before that.
#[test]
fn a_locked_board_is_erased_first() {
    let place = place();
    install(&place);
    place.run(&[FLASH.as_slice(), &["--unlock"]].concat()).ok();
    let erase = "erase --chip nRF52840_xxAA --allow-erase-all";
    assert_eq!(calls(&place), [erase, IMAGE, PAGE, RESET]);
    place
        .run(&["flash", "nrf52840", "--image=image.elf", "--unlock"])
        .fails("--config");
    place
        .run_with(&FLASH, &[("FAIL", "read")])
        .fails("was locked is written with --unlock");
}

/// RDP level 1, with `OpenOCD` (its manual, "stm32l4x").
#[test]
fn another_board_is_locked_with_another_program() {
    let place = place();
    install(&place);
    fs::write(place.path("image.elf"), elf(0x0800_0000, 0x0808_0000)).unwrap();
    let words = [
        "flash",
        "nucleo-l476rg",
        "--image=image.elf",
        "--config=page.bin",
        "--probe=0483:374b:066A",
        "--lock",
    ];
    place.run(&words).fails("apt-get install openocd");
    assert!(calls(&place).is_empty());
    place.install("openocd", PROBE_RS);
    let run = place.run(&words);
    assert!(run.stderr.contains("from its power"), "{}", run.stderr);
    run.ok();
    let open_ocd = |action| {
        format!(
            "-f interface/stlink.cfg -c adapter serial 066A -f target/stm32l4x.cfg -c init; reset halt; \
             stm32l4x {action} 0; stm32l4x option_load 0; shutdown"
        )
    };
    assert_eq!(calls(&place)[3..], [open_ocd("lock")]);
    let unlock = [&words[..5], &["--unlock"]].concat();
    place.run(&unlock).ok();
    assert_eq!(calls(&place)[4], open_ocd("unlock"));
    assert_eq!(calls(&place).len(), 4 + 4);
}

#[test]
fn a_dry_run_tells_the_commands() {
    let place = place();
    let run = place.run(&[FLASH.as_slice(), &["--dry-run"]].concat());
    assert!(run.stderr.contains("probe-rs is not installed"));
    let told = run.ok();
    install(&place);
    assert_eq!(
        place.run(&[FLASH.as_slice(), &["--dry-run"]].concat()).ok(),
        told
    );
    assert!(calls(&place).is_empty());
    place.run(&FLASH).ok();
    let folder = format!("{}/", place.path("").canonicalize().unwrap().display());
    let told: Vec<_> = told.lines().map(|line| line.replace(&folder, "")).collect();
    let done: Vec<_> = calls(&place)
        .iter()
        .map(|call| format!("probe-rs {call}"))
        .collect();
    assert_eq!(told, done);
}

/// As in the README, without a named image.
#[test]
fn the_image_is_where_it_was_built() {
    let place = place();
    let flash = ["flash", "nrf52840", "--config=page.bin"];
    let built = "target/firmware/nrf52840-node.elf";
    let missing = "nrf52840-node.elf: type `cargo xtask firmware`";
    let run = place.run(&[&flash[..], &["--dry-run"]].concat());
    assert!(run.stderr.contains(missing), "{}", run.stderr);
    let told = run.ok();
    let image = told.lines().nth(1).unwrap();
    assert!(image.ends_with(built), "{image}");
    install(&place);
    place.run(&flash).fails(missing);
    assert!(calls(&place).is_empty());
    fs::create_dir_all(place.path("target/firmware")).unwrap();
    fs::rename(place.path("image.elf"), place.path(built)).unwrap();
    place.run(&flash).ok();
    assert_eq!(
        calls(&place),
        [LOOK, &IMAGE.replace("image.elf", built), PAGE, RESET]
    );
}

/// Another node's board, or this one with its memory as another node: nothing is written.
#[test]
fn a_board_that_is_another_node_is_refused() {
    for with_addresses in [false, true] {
        let place = place();
        install(&place);
        board_has(&place, "page.bin", with_addresses);
        place.run(&FLASH).ok();
        assert_eq!(calls(&place), [LOOK, IMAGE, PAGE, RESET]);

        provision(&place, "camera", "other.bin");
        board_has(&place, "other.bin", with_addresses);
        place.run(&FLASH).fails(
            "the board is node 4, a camera; the page has another role, and nothing was written",
        );
        fs::remove_file(place.path("site.sitekey")).unwrap();
        place.run(&["keygen"]).ok();
        provision(&place, "target", "other.bin");
        board_has(&place, "other.bin", with_addresses);
        place.run(&FLASH).fails("another site key, and nothing");
        assert_eq!(calls(&place)[4..], [LOOK, LOOK]);

        place
            .run(&[FLASH.as_slice(), &["--erase-memory"]].concat())
            .ok();
        assert_eq!(calls(&place).len(), 6 + 4);
    }
}

#[test]
fn a_board_that_cannot_be_compared_is_not_written() {
    let place = place();
    install(&place);
    let something = "12 34 56 78 9a bc de f0 ".repeat(64);
    let cut = &something[..300];
    for (read, message) in [
        (something.as_str(), "cannot be compared"),
        (cut, "printed 100 bytes"),
        ("WARN probe: slow", "printed 0 bytes"),
    ] {
        place.write("bin/read", &format!("{read}\n"));
        place.run(&FLASH).fails(message);
        assert_eq!(calls(&place).last().map(String::as_str), Some(LOOK));
    }
    place
        .run(&[FLASH.as_slice(), &["--erase-memory"]].concat())
        .ok();
}

#[test]
fn nothing_is_skipped() {
    let place = place();
    place.run(&FLASH).fails("cargo install probe-rs-tools");
    install(&place);
    place.write("damaged.bin", "not a page");
    place.write("text.elf", "stands for an image");
    let page = fs::read(place.path("page.bin")).unwrap();
    fs::write(place.path("cut.bin"), &page[..20]).unwrap();
    fs::write(
        place.path("long.bin"),
        [page, vec![0xFF; PAGE_MAX]].concat(),
    )
    .unwrap();
    // Its contents end within the flash, but reach beyond the image's end; those of the other one begin in RAM.
    fs::write(place.path("large.elf"), elf(0, IMAGE_END + 1)).unwrap();
    fs::write(place.path("ram.elf"), elf(0, 0x2000_1000)).unwrap();
    let image = elf(0, IMAGE_END);
    fs::write(place.path("cut.elf"), &image[..image.len() - 1]).unwrap();
    let mut other = image;
    let stack = other.windows(8).position(|part| part == BEGIN).unwrap();
    // At the top of the RAM of a larger chip.
    other[stack + 2] = 5;
    fs::write(place.path("stack.elf"), &other).unwrap();
    fs::write(place.path("middle.elf"), elf(0x0002_7000, 0x0002_7008)).unwrap();
    other[18] = 3;
    fs::write(place.path("other.elf"), other).unwrap();
    for (error, words) in [
        ("none.elf cannot be read", "--image=none.elf"),
        ("it is no image", "--image=text.elf"),
        ("it is cut off", "--image=cut.elf"),
        ("it begins at 0x27000", "--image=middle.elf"),
        ("its stack begins at 0x20051000", "--image=stack.elf"),
        ("no image for an ARM", "--image=other.elf"),
        ("behind the part for images", "--image=large.elf"),
        ("behind the part for images", "--image=ram.elf"),
        ("is no page", "--image=image.elf --config=damaged.bin"),
        ("cut off", "--image=image.elf --config=cut.bin"),
        (
            "1024 bytes, a page has 512",
            "--image=image.elf --config=long.bin",
        ),
        ("cannot be read", "--image=image.elf --config=none.bin"),
        ("--config", "--image=image.elf --erase-memory"),
    ] {
        let words = ["flash", "nrf52840"].into_iter().chain(words.split(' '));
        let words: Vec<_> = words.collect();
        place.run(&words).fails(error);
    }
    place
        .run(&["flash", "nrf9160", "--config=page.bin"])
        .fails("possible values");
    place.run(&["flash"]).fails("BOARD");
    assert!(calls(&place).is_empty());
}

#[test]
fn a_failure_ends_it() {
    let place = place();
    install(&place);
    let page = PAGE.strip_suffix("page.bin").unwrap().trim_end();
    place
        .run_with(&FLASH, &[("FAIL", page)])
        .fails("the board is not complete");
    assert_eq!(calls(&place), [LOOK, IMAGE, PAGE]);
    place
        .run_with(&FLASH, &[("FAIL", "read")])
        .fails("nothing was written");
    assert_eq!(calls(&place)[3..], [LOOK]);
}

/// Texts of boot loaders, as they show them (Adafruit's boot loader, `ghostfat.c`).
const XIAO: &str = "UF2 Bootloader 0.6.1\r\nModel: Seeed XIAO nRF52840\r\nBoard-ID: nRF52840-SeeedXiao-v1\r\n\
                    Date: Nov 12 2021\r\nSoftDevice: S140 version 7.3.0\r\n";

/// A block of a UF2 file (<https://github.com/microsoft/uf2>, "File format").
fn block(address: u32, bytes: &[u8]) -> Vec<u8> {
    let head = [
        0x0a32_4655,
        0x9e5d_5157,
        0x2000,
        address,
        256,
        0,
        1,
        0x2886_0044,
    ];
    let mut block: Vec<u8> = head.into_iter().flat_map(u32::to_le_bytes).collect();
    block.extend(bytes);
    block.resize(288, 0xff);
    block.resize(508, 0);
    block.extend(0x0ab1_6f30_u32.to_le_bytes());
    block
}

/// A volume whose board has this page, or none.
fn volume(place: &Place, about: &str, page: &[u8]) -> PathBuf {
    let folder = place.path("volume");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("INFO_UF2.TXT"), about).unwrap();
    let (first, second) = page.split_at(page.len().min(256));
    let shown = [block(0x000a_c000, first), block(0x000a_c100, second)];
    fs::write(folder.join("CURRENT.UF2"), shown.concat()).unwrap();
    folder
}

/// A boot loader, which goes away once it has all blocks. Returns their addresses with their bytes.
fn boot_loader(folder: &Path) -> thread::JoinHandle<Vec<(u32, Vec<u8>)>> {
    let folder = folder.to_owned();
    thread::spawn(move || {
        loop {
            let file = fs::read(folder.join("NODE.UF2")).unwrap_or_default();
            let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
            if file.len() >= 512 && file.len() == 512 * word(24) as usize {
                fs::remove_file(folder.join("INFO_UF2.TXT")).unwrap();
                let blocks = (0..file.len()).step_by(512);
                let blocks = blocks.map(|at| (word(at + 12), file[at + 32..at + 288].to_vec()));
                return blocks.collect();
            }
            thread::sleep(Duration::from_millis(5));
        }
    })
}

/// No probe-rs is there: the file goes to the volume. The XIAO's image begins at 0x27000, its page is at 0xac000.
#[test]
fn a_boot_loader_takes_image_and_page() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x0002_7000, 0x0002_7008)).unwrap();
    let page = fs::read(place.path("page.bin")).unwrap();
    let words = [
        "flash",
        "xiao-nrf52840",
        "--volume=volume",
        "--image=image.elf",
        "--config=page.bin",
    ];
    // Older and newer boot loaders of all boards name the SoftDevice in either way.
    let short = XIAO.replace(" version", "");
    for (about, board_has) in [(XIAO, &[][..]), (&short, &page)] {
        let folder = volume(&place, about, board_has);
        let loader = boot_loader(&folder);
        place.run(&words).ok();
        let blocks = loader.join().unwrap();
        let addresses: Vec<_> = blocks.iter().map(|(address, _)| *address).collect();
        assert!(addresses.starts_with(&[0x0002_7000]), "{addresses:x?}");
        assert!(blocks[0].1.starts_with(&[&BEGIN[..], b"\xff"].concat()));
        let written: Vec<u8> = blocks[1..]
            .iter()
            .flat_map(|(_, bytes)| bytes.clone())
            .collect();
        assert_eq!(addresses[1], 0x000a_c000);
        assert!(written.starts_with(&page));
        fs::remove_dir_all(folder).unwrap();
    }
    // The image alone leaves the page.
    let folder = volume(&place, XIAO, &page);
    let loader = boot_loader(&folder);
    place.run(&words[..4]).ok();
    assert_eq!(loader.join().unwrap().len(), 1);
}

/// Nothing is written to another board, to one whose program begins elsewhere, or over another node.
#[test]
fn a_boot_loader_of_another_board_gets_nothing() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x0002_7000, 0x0002_7008)).unwrap();
    provision(&place, "camera", "other.bin");
    let other = fs::read(place.path("other.bin")).unwrap();
    let words = [
        "flash",
        "xiao-nrf52840",
        "--volume=volume",
        "--image=image.elf",
        "--config=page.bin",
    ];
    let mut damaged = other.clone();
    damaged[20] ^= 1;
    let feather = XIAO.replace("SeeedXiao-v1", "Feather-revE");
    let old = XIAO.replace("7.3.0", "6.1.1");
    for (about, page, error) in [
        (&*feather, &[][..], "not that of a Seeed XIAO nRF52840"),
        (&old, &[], "has the SoftDevice `S140 version 6.1.1`"),
        (
            &old.replace(" version", ""),
            &[],
            "has the SoftDevice `S140 6.1.1`",
        ),
        (XIAO, &other, "another role"),
        (XIAO, &damaged, "cannot be compared"),
    ] {
        let folder = volume(&place, about, page);
        place.run(&words).fails(error);
        assert!(!folder.join("NODE.UF2").exists());
    }
    // One that forgets may be any node. Its memory is at 0x9a000 to 0xabfff.
    let folder = volume(&place, XIAO, &other);
    let loader = boot_loader(&folder);
    let forget = [&words[..], &["--erase-memory"]].concat();
    place.run(&forget).ok();
    let blocks = loader.join().unwrap();
    let erased = blocks.iter().filter(|(address, bytes)| {
        (0x0009_a000..0x000a_c000).contains(address) && bytes.iter().all(|&byte| byte == 0xff)
    });
    assert_eq!(erased.count(), 0x1_2000 / 256);
    // A development kit has its probe, and an image is for one board.
    let kit = ["flash", "nrf52840", "--volume=volume", "--image=image.elf"];
    place.run(&kit).fails("has no boot loader");
    fs::write(place.path("image.elf"), elf(0x0002_6000, 0x0002_6008)).unwrap();
    place.run(&words).fails("before the board's image");
}

/// A volume and a serial port are different ways to different boards.
#[test]
fn an_option_of_the_other_kind_of_boot_loader_is_refused() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x0002_7000, 0x0002_7008)).unwrap();
    let folder = volume(&place, XIAO, &[]);
    for (board, option, error) in [
        ("xiao-nrf52840", "--port=/dev/ttyACM0", "leave --port out"),
        ("pca10059", "--volume=volume", "leave --volume out"),
    ] {
        let words = ["flash", board, "--image=image.elf", option];
        place.run(&words).fails(error);
    }
    assert!(!folder.join("NODE.UF2").exists());
}

/// A package for a dongle is a file, too, which another program may bring; it holds the site key.
#[test]
fn a_file_for_a_boot_loader() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x1000, 0x1008)).unwrap();
    let words = [
        "flash",
        "pca10059",
        "--image=image.elf",
        "--config=page.bin",
        "--file=node.zip",
    ];
    let run = place.run(&words);
    assert!(
        run.stderr.contains("dfu usb-serial -pkg node.zip"),
        "{}",
        run.stderr
    );
    run.ok();
    let path = place.path("node.zip");
    assert_eq!(
        fs::metadata(&path).unwrap().permissions().mode() & 0o777,
        0o600
    );
    let package = fs::read(path).unwrap();
    let page = fs::read(place.path("page.bin")).unwrap();
    let has = |bytes: &[u8]| package.windows(bytes.len()).any(|part| part == bytes);
    assert!(has(&page) && has(b"manifest.json"));
    let forget = [&words[..], &["--erase-memory"]].concat();
    place.run(&forget).fails("cannot erase the memory");
}

/// A file that is there may be anything, such as the key of a site.
#[test]
fn a_file_is_written_over_only_if_that_is_said() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x1000, 0x1008)).unwrap();
    let key = fs::read(place.path("site.sitekey")).unwrap();
    let page = fs::read(place.path("page.bin")).unwrap();
    let words = [
        "flash",
        "pca10059",
        "--image=image.elf",
        "--config=page.bin",
    ];
    let run = |more: &[&str]| place.run(&[&words[..], more].concat());
    run(&["--file=site.sitekey"])
        .fails("site.sitekey exists: name another file with --file, or use --overwrite");
    assert_eq!(fs::read(place.path("site.sitekey")).unwrap(), key);
    // A file that is read is none for a result, whatever is said.
    run(&["--file=page.bin", "--overwrite"]).fails("page.bin is read");
    assert_eq!(fs::read(place.path("page.bin")).unwrap(), page);
    run(&["--file=node.zip"]).ok();
    let first = fs::read(place.path("node.zip")).unwrap();
    place.write("node.zip", "something else");
    run(&["--file=node.zip"]).fails("node.zip exists");
    run(&["--file=node.zip", "--overwrite"]).ok();
    assert_eq!(fs::read(place.path("node.zip")).unwrap(), first);
    run(&["--overwrite"]).fails("--file");
}

/// The page of a dongle goes with the image before, whichever way the new one comes.
#[test]
fn a_dongle_gets_no_image_without_a_page() {
    let place = place();
    fs::write(place.path("image.elf"), elf(0x1000, 0x1008)).unwrap();
    for way in [
        &["--file=node.zip"][..],
        &["--port=none"],
        &["--dry-run"],
        &[],
    ] {
        let words = ["flash", "pca10059", "--image=image.elf"];
        place
            .run(&[&words[..], way].concat())
            .fails("name it with --config");
    }
    assert!(!place.path("node.zip").exists());
}

/// Steps with a boot loader, of which none is taken: no probe-rs, no volume and no port is there.
#[test]
fn a_dry_run_tells_the_steps_with_a_boot_loader() {
    let place = place();
    fs::write(place.path("xiao.elf"), elf(0x0002_7000, 0x0002_7008)).unwrap();
    fs::write(place.path("dongle.elf"), elf(0x1000, 0x1008)).unwrap();
    let files = || fs::read_dir(place.path("")).unwrap().count();
    let before = files();
    let steps = |words: &[&str]| {
        let run = place.run(&[words, &["--dry-run", "--config=page.bin"]].concat());
        assert!(run.stderr.contains("role = \"target\""), "{}", run.stderr);
        assert!(!run.stderr.contains("probe-rs"), "{}", run.stderr);
        run.ok().lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let xiao = ["flash", "xiao-nrf52840", "--image=xiao.elf"];
    let press = "press its button RST twice, quickly";
    let usual = [
        format!("wait for the volume of a Seeed XIAO nRF52840: {press}"),
        "check that it has the SoftDevice S140 7.3.0".to_owned(),
        "compare the board's page with page.bin".to_owned(),
        "copy one file to it: the image xiao.elf, the page page.bin".to_owned(),
        "wait until the board has started".to_owned(),
    ];
    assert_eq!(steps(&xiao), usual);
    let named = steps(&[&xiao[..], &["--volume=none", "--erase-memory"]].concat());
    assert!(named[0].contains("XIAO nRF52840 in none:"), "{named:?}");
    assert!(
        !named.iter().any(|step| step.contains("compare")),
        "{named:?}"
    );
    assert!(
        named[2].ends_with("the page page.bin, an erased memory"),
        "{named:?}"
    );
    let file = ["write node.uf2: the image xiao.elf, the page page.bin"];
    assert_eq!(steps(&[&xiao[..], &["--file=node.uf2"]].concat()), file);

    let dongle = ["flash", "pca10059", "--image=dongle.elf"];
    let sent = steps(&dongle);
    assert!(
        sent[0].starts_with("wait for the serial port of a nRF52840 dongle"),
        "{sent:?}"
    );
    assert!(
        sent[1].starts_with("send one package to it: the image dongle.elf"),
        "{sent:?}"
    );
    let sent = steps(&[&dongle[..], &["--port=none"]].concat());
    assert!(
        sent[0].starts_with("wait for the serial port none: press"),
        "{sent:?}"
    );
    let file = steps(&[&dongle[..], &["--file=node.zip"]].concat());
    assert!(file[1].contains("-pkg node.zip"), "{file:?}");
    assert_eq!(files(), before);
    // A probe is asked for by name.
    let probe = place.run(&[&xiao[..], &["--probe=1366:1015", "--dry-run"]].concat());
    assert!(
        probe
            .ok()
            .starts_with("probe-rs download --chip nRF52840_xxAA")
    );
    // The dongle's page is in a sector of its image: neither may be erased with the other.
    let probe = [&dongle[..], &["--probe=1366:1015", "--dry-run"]].concat();
    let commands = place.run(&probe).ok();
    let mut downloads = commands
        .lines()
        .filter(|line| line.contains("probe-rs download"));
    let is_kept = |line: &str| line.contains(" --restore-unwritten ");
    assert!(
        downloads.next().is_some_and(is_kept) && downloads.all(is_kept),
        "{commands}"
    );
    // An image that is still to be made is no error, and one for another board is.
    let words = ["flash", "xiao-nrf52840", "--dry-run"];
    let run = place.run(&words);
    assert!(
        run.stderr.contains("type `cargo xtask firmware`"),
        "{}",
        run.stderr
    );
    assert!(run.ok().contains("xiao-nrf52840-node.elf\n"));
    place
        .run(&[&words[..], &["--image=dongle.elf"]].concat())
        .fails("before the board's image");
}

/// Faults of a dongle's boot loader.
#[derive(Clone, Debug, Default)]
struct Faults {
    /// The line spoils the first byte of these writes of the image.
    spoils: Range<usize>,
    /// Extended error at the end of the packet that tells about an image.
    refuses: Option<u8>,
}

/// Nordic's boot loader at a serial line, as far as a transfer needs it (nRF5 SDK 17, "DFU protocol" and "DFU serial
/// transport"), until it has an image of so many bytes. Returns what it has, and the longest frame.
fn dongle(
    mut line: LineEnd,
    length: usize,
    faults: Faults,
) -> thread::JoinHandle<(Vec<u8>, usize)> {
    const OBJECT: u32 = 256;
    const FRAME: u16 = 67;
    thread::spawn(move || {
        let (mut parts, mut object) = ([Vec::new(), Vec::new()], Vec::new());
        let (mut kind, mut writes, mut longest) = (0, 0, 0);
        loop {
            // A frame, and its length on the line.
            let (mut frame, mut count) = (Vec::new(), 0);
            loop {
                let mut byte = [0];
                match line.read(&mut byte) {
                    Ok(1) => {}
                    Ok(_) => panic!("the line is closed"),
                    Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                    // The other side has gone.
                    Err(_) => return (parts[1].clone(), longest),
                }
                count += 1;
                match (byte[0], frame.last()) {
                    (0xc0, _) => break,
                    (0xdc, Some(0xdb)) => *frame.last_mut().unwrap() = 0xc0,
                    (0xdd, Some(0xdb)) => {}
                    (byte, _) => frame.push(byte),
                }
            }
            longest = longest.max(count);
            let Some(&request) = frame.first() else {
                continue;
            };
            let told: Vec<u8> = match request {
                1 => {
                    kind = usize::from(frame[1]) - 1;
                    let asked = u32::from_le_bytes(frame[2..6].try_into().unwrap());
                    assert!(asked <= OBJECT, "{asked}");
                    object.clear();
                    Vec::new()
                }
                2 => Vec::new(),
                3 => {
                    let have = [&parts[kind][..], &object].concat();
                    let crc = crc32(&have);
                    [have.len() as u32, crc].map(u32::to_le_bytes).concat()
                }
                4 if kind == 0 && faults.refuses.is_some() => {
                    let refusal = [0x60, 4, 0x0b, faults.refuses.unwrap(), 0xc0];
                    line.write_all(&refusal).unwrap();
                    continue;
                }
                4 => {
                    parts[kind].append(&mut object);
                    Vec::new()
                }
                6 => [OBJECT, 0, 0].map(u32::to_le_bytes).concat(),
                7 => FRAME.to_le_bytes().to_vec(),
                8 => {
                    writes += kind;
                    if kind == 1 && faults.spoils.contains(&writes) {
                        frame[1] ^= 1;
                    }
                    object.extend(&frame[1..]);
                    continue;
                }
                9 => frame[1..].to_vec(),
                // Not supported.
                other => {
                    line.write_all(&[0x60, other, 2, 0xc0]).unwrap();
                    continue;
                }
            };
            let mut answer = Vec::new();
            for byte in [&[0x60, request, 1][..], &told].concat() {
                match byte {
                    0xc0 => answer.extend([0xdb, 0xdc]),
                    0xdb => answer.extend([0xdb, 0xdd]),
                    byte => answer.push(byte),
                }
            }
            answer.push(0xc0);
            line.write_all(&answer).unwrap();
            if parts[1].len() == length {
                return (parts[1].clone(), longest);
            }
        }
    })
}

/// CRC-32 (ISO-HDLC), a bit at a time.
fn crc32(bytes: &[u8]) -> u32 {
    let bits = bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 * (crc & 1))
        })
    });
    !bits
}

/// Without another program: image and page go over the serial line of the boot loader.
#[test]
fn a_dongle_takes_image_and_page_over_its_line() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    let place = place();
    fs::write(place.path("image.elf"), elf(0x1000, 0x1008)).unwrap();
    let page = fs::read(place.path("page.bin")).unwrap();
    // The page is 0x200 behind the image's begin.
    let length = 0x200 + page.len();
    let flash = |faults, config: &[&str]| {
        let (device, mut kept, name) = LineEnd::pair();
        // A transfer before was interrupted in a frame.
        kept.write_all(&[0x77, 1]).unwrap();
        let loader = dongle(device, length, faults);
        let port = format!("--port={name}");
        let words = ["flash", "pca10059", "--image=image.elf", &port];
        let run = place.run(&[&words, config].concat());
        drop(kept);
        (run, loader)
    };
    let config = &["--config=page.bin"];
    // What the line spoils is sent again.
    for spoils in [0..0, 3..4, 2..20] {
        let faults = Faults {
            spoils,
            ..Faults::default()
        };
        let (run, loader) = flash(faults, config);
        run.ok();
        let (image, longest) = loader.join().unwrap();
        assert_eq!(image.len(), length);
        assert!(image.starts_with(BEGIN) && image.ends_with(&page));
        assert!(image[8..0x200].iter().all(|&byte| byte == 0xff));
        assert!(longest <= 67, "{longest}");
    }
    let damaged = Faults {
        spoils: 0..usize::MAX,
        ..Faults::default()
    };
    let (run, _) = flash(damaged, config);
    run.fails("damaged on the way");
    let other = Faults {
        refuses: Some(6),
        ..Faults::default()
    };
    let (run, _) = flash(other, config);
    run.fails("for other hardware");
}
