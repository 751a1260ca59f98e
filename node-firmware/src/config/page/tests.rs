use std::{format, string::ToString, vec::Vec};

use calib_core::camera::Projection;
use proptest::prelude::*;

use super::*;
use crate::{
    config::{
        CameraConfig, RoleConfig, SiteKey, Subjects,
        examples::{ORANGE, camera, coordinator, node, pixy2, tags, target},
    },
    vision::{CameraKind, Lens},
};

fn checked(config: &Config) -> CheckedConfig {
    config.clone().check().unwrap()
}

fn page(config: &Config) -> Vec<u8> {
    let mut buffer = [0; PAGE_MAX];
    let length = encode(&checked(config), &mut buffer).unwrap();
    buffer[..length].to_vec()
}

fn hex(bytes: &[u8]) -> std::string::String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A page with this header and body and the right checksum, by an own bitwise CRC-32.
fn forged(version: u16, length: u16, body: &[u8]) -> Vec<u8> {
    let mut page = b"CNod".to_vec();
    page.extend(version.to_le_bytes());
    page.extend(length.to_le_bytes());
    page.extend(body);
    let checksum = !page.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 }
        })
    });
    page.extend(checksum.to_le_bytes());
    page
}

/// The format is an interface.
#[test]
fn golden_pages() {
    assert_eq!(examples().map(|(_, page)| hex(&page)), GOLDEN);
}

fn examples() -> [(&'static str, Vec<u8>); 5] {
    [
        ("camera", RoleConfig::Camera(camera())),
        ("target", RoleConfig::Target(target())),
        ("coordinator", RoleConfig::Coordinator(coordinator(2))),
        ("pixy2", RoleConfig::Camera(pixy2())),
        ("tags", RoleConfig::Camera(tags())),
    ]
    .map(|(name, role)| (name, page(&node(role))))
}

/// Fuzzing starts from these: of an older version they would lead nowhere. `UPDATE=1` writes them anew.
#[test]
fn the_corpus_for_fuzzing_is_of_this_version() {
    let corpus = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/fuzz/corpus/config_page"
    );
    for (name, page) in examples() {
        let path = format!("{corpus}/{name}");
        // The target puts the checksum there itself.
        let seed = &page[..page.len() - TRAILER];
        if std::env::var_os("UPDATE").is_some() {
            std::fs::write(&path, seed).unwrap();
        }
        assert!(std::fs::read(&path).unwrap() == seed, "{path}");
    }
}

#[test]
fn the_checksum_is_that_of_zip_and_the_rest_is_erased() {
    let config = node(RoleConfig::Camera(camera()));
    let page = page(&config);
    let length = u16::from_le_bytes([page[6], page[7]]);
    assert_eq!(page, forged(UNDISTORTED, length, &page[8..page.len() - 4]));
    let mut buffer = [0; PAGE_MAX];
    let written = encode(&checked(&config), &mut buffer).unwrap();
    assert!(buffer[written..].iter().all(|&byte| byte == 0xFF));
    assert_eq!(decode(&buffer), Ok(checked(&config)));
}

/// Nodes that are updated by radio keep their pages.
#[test]
fn a_page_of_version_10_is_of_a_node_that_does_not_sleep() {
    // As firmware of that version wrote it.
    let golden = GOLDEN_10.as_bytes().chunks(2);
    let golden = golden.map(|digits| std::str::from_utf8(digits).unwrap());
    let page: Vec<u8> = golden
        .map(|digits| u8::from_str_radix(digits, 16).unwrap())
        .collect();
    let mut config = node(RoleConfig::Target(target()));
    assert_eq!(decode(&page), Ok(checked(&config)));
    config.sleeps = true;
    assert_eq!(decode(&self::page(&config)), Ok(checked(&config)));
    let body = &page[8..page.len() - 4];
    let short = forged(SLEEPLESS, body.len() as u16 - 1, &body[..body.len() - 1]);
    assert_eq!(decode(&short), Err(PageError::Body));
}

/// A page of a lens with a distortion is of version 12, which has k1 and k2 behind all else.
#[test]
fn a_distortion_is_in_a_page_of_version_12() {
    let mut config = node(RoleConfig::Camera(camera()));
    let plain = self::page(&config);
    let RoleConfig::Camera(camera) = &mut config.role else {
        unreachable!()
    };
    camera.lens.distortion = [-0.25, 0.5];
    let page = self::page(&config);
    assert_eq!(page[4..6], [12, 0]);
    assert_eq!(plain[4..6], [11, 0]);
    let body = &page[8..page.len() - 4];
    // -0.25 and 0.5 as little-endian floats.
    let behind = [0, 0, 0x80, 0xBE, 0, 0, 0, 0x3F];
    assert_eq!(body.strip_suffix(&behind), Some(&plain[8..plain.len() - 4]));
    assert_eq!(decode(&page), Ok(checked(&config)));
    let of = |version, body: &[u8]| decode(&forged(version, body.len() as u16, body));
    for wrong in [&body[..body.len() - 1], &body[..body.len() - 8]] {
        assert_eq!(of(12, wrong), Err(PageError::Body));
    }
    assert_eq!(of(11, body), Err(PageError::Body));
    let target = self::page(&node(RoleConfig::Target(target())));
    let with_lens = [&target[8..target.len() - 4], &behind[..]].concat();
    assert_eq!(of(12, &with_lens), Err(PageError::Body));
    // 100 degrees of which the corners are folded back.
    let folded = [&body[..body.len() - 8], &(-2_f32).to_le_bytes(), &[0; 4]].concat();
    assert!(matches!(
        of(12, &folded),
        Err(PageError::Value(ConfigError::Lens(_)))
    ));
}

/// The fullest configurations there are.
#[test]
fn everything_fits_into_a_page() {
    let mut config = node(RoleConfig::Coordinator(coordinator(32)));
    config.id = u16::MAX;
    config.channels = 0x07FF_F800;
    assert_eq!(decode(&page(&config)), Ok(checked(&config)));
    let mut full = camera();
    full.lens.principal_column = Some(43.25);
    full.baud = 115_200;
    full.frame_heading_deg = Some(-12.5);
    full.subjects = Subjects::Colours([ORANGE; 4].into_iter().collect());
    config.role = RoleConfig::Camera(full);
    assert_eq!(decode(&page(&config)), Ok(checked(&config)));
    for room in [60, 5] {
        let buffer = &mut [0; PAGE_MAX][..room];
        assert_eq!(encode(&checked(&config), buffer), Err(PageError::Room));
    }
}

#[test]
fn what_is_no_page_says_what_to_do() {
    let good = page(&node(RoleConfig::Target(target())));
    let body = &good[8..good.len() - 4];
    let length = body.len() as u16;
    let mut damaged = good.clone();
    damaged[20] ^= 4;
    let mut other = good.clone();
    other[0] = b'X';
    let mut unknown_role = body.to_vec();
    let at = unknown_role.len() - 24;
    unknown_role.truncate(at);
    let with_more = [body, &[0]].concat();
    for (bytes, error, advice) in [
        (&[][..], PageError::Blank, "provision"),
        (&[0xFF; 512], PageError::Blank, "provision"),
        (&[0; 512], PageError::Blank, "provision"),
        (&other, PageError::Magic, "address"),
        (&good[..7], PageError::Truncated, "write it again"),
        (&good[..good.len() - 1], PageError::Truncated, "again"),
        (
            &forged(UNDISTORTED, 600, body),
            PageError::Truncated,
            "again",
        ),
        (&damaged, PageError::Checksum, "write it again"),
        (
            &forged(VERSION + 1, length, body),
            PageError::Version { found: VERSION + 1 },
            "update the firmware",
        ),
        (
            &forged(4, length, body),
            PageError::Version { found: 4 },
            "older version: make it anew",
        ),
        (
            &forged(UNDISTORTED, at as u16, &unknown_role),
            PageError::Body,
            "provision",
        ),
        (
            &forged(UNDISTORTED, length + 1, &with_more),
            PageError::Body,
            "provision",
        ),
    ] {
        assert_eq!(decode(bytes), Err(error));
        assert!(error.to_string().contains(advice), "{error}");
    }
}

/// A page with a right checksum may still hold values that are not allowed.
#[test]
fn values_are_checked_both_ways() {
    let mut config = node(RoleConfig::Target(target()));
    config.tx_power = 127;
    let error = PageError::Value(ConfigError::TxPower);
    assert_eq!(config.clone().check(), Err(ConfigError::TxPower));
    let mut body = [0; PAGE_MAX];
    let body = postcard::to_slice(&config, &mut body).unwrap();
    let body = [&*body, &[0]].concat();
    assert_eq!(
        decode(&forged(UNDISTORTED, body.len() as u16, &body)),
        Err(error)
    );
}

/// The facts of a role are void after some changes, and good after others.
#[test]
fn whose_memory_it_is() {
    let before = node(RoleConfig::Camera(camera()));
    let after = |change: fn(&mut Config)| {
        let mut config = before.clone();
        change(&mut config);
        assert_ne!(config, before);
        config.owner() != before.owner()
    };
    fn of(config: &mut Config) -> &mut CameraConfig {
        match &mut config.role {
            RoleConfig::Camera(camera) => camera,
            _ => unreachable!(),
        }
    }
    let voids: [fn(&mut Config); 15] = [
        |c| of(c).lens.distortion = [0.0, 0.1],
        |c| of(c).kind = CameraKind::Pixy2,
        |c| c.id += 1,
        |c| c.site_key = SiteKey::new(2, *b"0123456789abcdef"),
        |c| c.site_key = SiteKey::new(1, *b"0123456789abcdeF"),
        |c| c.role = RoleConfig::Target(target()),
        |c| c.role = RoleConfig::Coordinator(coordinator(2)),
        |c| of(c).lens.columns = 87,
        |c| of(c).lens.field_of_view_deg = 46.0,
        |c| of(c).lens.principal_column = Some(43.0),
        |c| of(c).lens.projection = Projection::EqualAngle,
        |c| of(c).first_column = 0,
        |c| of(c).reference = None,
        |c| of(c).baseline = None,
        |c| of(c).frame_heading_deg = Some(0.0),
    ];
    assert_eq!(voids.map(after), [true; 15]);
    let keeps: [fn(&mut Config); 6] = [
        |c| c.tx_power += 1,
        |c| c.sleeps = true,
        |c| c.channels ^= 1 << 11,
        |c| of(c).stops += 1,
        |c| of(c).weak.position += 1.0,
        |c| of(c).subjects = Subjects::Motion { threshold: 10 },
    ];
    assert_eq!(keeps.map(after), [false; 6]);
}

proptest! {
    #[test]
    fn any_bytes_are_taken_without_harm(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let _ = decode(&bytes);
        // With a right header and checksum, the body is looked at.
        let forged = forged(UNDISTORTED, bytes.len() as u16, &bytes);
        if let Ok(config) = decode(&forged) {
            prop_assert_eq!(config.settings().clone().check(), Ok(config));
        }
    }

    /// A burst of up to 32 bits is always found, as for any CRC-32.
    #[test]
    fn no_damaged_page_is_believed(at in 0_usize..40, flips in 1_u32..) {
        let good = page(&node(RoleConfig::Camera(camera())));
        let mut bad = good.clone();
        for (byte, flip) in bad[at..].iter_mut().zip(flips.to_le_bytes()) {
            *byte ^= flip;
        }
        prop_assert!(decode(&bad).is_err());
    }

    #[test]
    fn what_is_written_is_read(
        id: u16, key in any::<[u8; 16]>(), index in 1_u8..,
        columns in 2_u16..=255, view in 1.0_f32..179.0, devices in 0_u8..=32, kind in 0..3,
    ) {
        let mut camera = camera();
        camera.lens = Lens::pin_hole(columns, view);
        let role = match kind {
            0 => RoleConfig::Camera(camera),
            1 => RoleConfig::Target(target()),
            _ => RoleConfig::Coordinator(coordinator(devices)),
        };
        let mut config = node(role);
        config.id = id;
        config.site_key = SiteKey::new(index, key);
        let mut buffer = [0; PAGE_MAX];
        match config.clone().check() {
            Ok(config) => {
                encode(&config, &mut buffer).unwrap();
                prop_assert_eq!(decode(&buffer), Ok(config));
            }
            Err(error) => {
                prop_assert_eq!(error, ConfigError::SiteKey);
                prop_assert!(config.site_key.key().is_none());
            }
        }
    }
}

const GOLDEN: [&str; 5] = [
    "434e6f640b0064000301303132333435363738396162636465668090c210fc0601005800003442000080ac02010001aaf03c8c10500101010100002041000000bf00010000204100030501cdcc4c3d0000803e0000003f000000410000803dcdcc4c3d0000803f0000c03f00672edbb4",
    "434e6f640b0057000301303132333435363738396162636465668090c210fc060202dc0b0000003f0000803c0ad7a33c0000403fd00fc0a90700cdcc4c3d0000803f0000c03f0ad7233c0ad7a33c000048410000f0c10000803e0000003f0068dc2a71",
    "434e6f640b0027000301303132333435363738396162636465668090c210fc0600020102ac02a913d03c0000403f00b91a3331",
    "434e6f640b005f000301303132333435363738396162636465668090c210fc060101bc020000704200008096010102020101010100002041000000bf00010000204100030501cdcc4c3d0000803e0000003f000000410000803dcdcc4c3d0000803f0000c03f004796d6bc",
    "434e6f640b005e000301303132333435363738396162636465668090c210fc060104a00100808d42000080960101030101010100002041000000bf00010000204100030501cdcc4c3d0000803e0000003f000000410000803dcdcc4c3d0000803f0000c03f00ba1133a3",
];

/// The target's, of version 10.
const GOLDEN_10: &str = "434e6f640a0056000301303132333435363738396162636465668090c210fc060202dc0b0000003f0000803c0ad7a33c0000403fd00fc0a90700cdcc4c3d0000803f0000c03f0ad7233c0ad7a33c000048410000f0c10000803e0000003f04eef120";
