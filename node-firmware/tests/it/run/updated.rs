//! Updates by radio of whole nodes, in air that loses frames.

use std::{cell::RefCell, rc::Rc, time::Duration};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::ReadNorFlash;
use node_firmware::{
    config::{CoordinatorConfig, RoleConfig},
    console::{FromPc, ToPc},
    hardware::Updates,
    message::UpdatePacket,
};
use node_test::{Bench, Board, FACTS, PAGE, SECOND};
use radio_update::{
    package::{Package, public_key},
    packet::{PACKET_MAX, Packet},
    sender::{Sender, Transmit},
    stamp::{STAMP, Stamp, board_number},
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use virtual_hardware::{
    flash::Flash,
    medium::{Event, Propagation},
};

use crate::support::site::camera_config;

const SECRET: [u8; 32] = [3; 32];
const STAMP_OF_NODES: Stamp = Stamp {
    board: board_number("a board"),
    roles: 7,
    version: 1,
};

/// An image that nothing compresses.
fn image(length: usize) -> Vec<u8> {
    let mut image: Vec<u8> = { 0..length as u32 }
        .map(|at| (at.wrapping_mul(2_654_435_761) >> 23) as u8)
        .collect();
    let stamp = Stamp {
        version: 2,
        ..STAMP_OF_NODES
    };
    image[..STAMP].copy_from_slice(&stamp.bytes());
    image
}

/// Gives a node room for an image of so many bytes.
fn with_updates(board: &mut Board, length: usize) -> u32 {
    let whole = |bytes: usize| bytes.next_multiple_of(4096) as u32;
    let spare = whole(FACTS as usize);
    let state = spare + whole(length) + 4096;
    let pages = (state + 2 * 4096) as usize / PAGE;
    board.flash = Flash::without_time(pages, ChaCha8Rng::seed_from_u64(board.config.id.into()));
    board.updates = Some(Updates {
        state: state..state + 4096,
        header: state + 4096..state + 2 * 4096,
        spare: spare..state,
        board: STAMP_OF_NODES.board,
        version: STAMP_OF_NODES.version,
        roles: STAMP_OF_NODES.roles,
        key: Some(public_key(&SECRET)),
    });
    spare
}

/// Airtime of a frame with FCS, microseconds: 32 a byte, and 6 bytes of preamble and length.
fn airtime(bytes: usize) -> u64 {
    32 * (bytes as u64 + 2 + 6)
}

/// So many cameras take an image, each losing this share of all frames. Every node ends with its boot loader about to
/// change images, and the image is whole. Returns airtime of all frames during the update, as a share of that of the
/// image's blocks, and the seconds that it took.
fn update(cameras: usize, length: usize, loss: f64) -> (f64, f64) {
    let everywhere = Propagation::UnitDisk { range: 1e6, loss };
    let mut bench = Bench::in_air(everywhere, 1);
    let mut config = CoordinatorConfig::default();
    config.join_window_s = 600;
    let mut boards = vec![bench.coordinator(config)];
    for _ in 0..cameras {
        boards.push(bench.node(RoleConfig::Camera(camera_config(None))));
    }
    let mut spare = 0;
    let ends: Vec<Rc<RefCell<Option<String>>>> = boards
        .iter_mut()
        .zip(1..)
        .map(|(board, seed)| {
            spare = with_updates(board, length);
            let end = Rc::new(RefCell::new(None));
            let (firmware, told) = (board.firmware(&bench, seed), end.clone());
            bench.executor.spawn(async move {
                let why = firmware.await;
                told.replace(Some(why));
            });
            end
        })
        .collect();
    let pc = boards[0].pc();
    let members = || {
        let told = pc.told().into_iter();
        let addresses = told.filter_map(|message| match message {
            ToPc::Member { address, .. } => Some(address),
            _ => None,
        });
        addresses.collect::<std::collections::BTreeSet<_>>()
    };
    while members().len() < cameras {
        bench.run_for(SECOND);
    }
    pc.forget();

    let on_air = Rc::new(RefCell::new(0));
    let counted = on_air.clone();
    bench.medium.watch(move |_, event: Event<'_>| {
        if let Event::Sent { frame, .. } = event {
            *counted.borrow_mut() += airtime(frame.len());
        }
    });
    let package = Package::sign(&image(length), &SECRET).unwrap();
    let blocks = package.blocks();
    let begun = bench.clock.time();
    let mut sender = Sender::new(package, (0..=cameras as u16).collect::<Vec<_>>(), 0);
    let is_over = |end: &Rc<RefCell<Option<String>>>| end.borrow().is_some();
    while !ends[1..].iter().all(is_over) {
        let now = Duration::from_nanos(bench.clock.time() - begun);
        assert!(now < Duration::from_secs(1800), "{:?}", sender.nodes());
        for message in pc.told() {
            match message {
                ToPc::Update { address, packet } => sender.on_packet(now, address, packet.bytes()),
                ToPc::UpdateSent => sender.on_sent(now),
                _ => {}
            }
        }
        pc.forget();
        while let Some(Transmit { to, packet }) = sender.poll(now) {
            let (to, packet) = (to.unwrap_or(0xFFFF), UpdatePacket::new(&packet).unwrap());
            pc.wish(FromPc::Update { to, packet });
        }
        bench.run_for(SECOND / 200);
    }
    let (air, took) = (*on_air.borrow(), bench.clock.time() - begun);
    // The others never come back here. The coordinator is the last.
    pc.wish(FromPc::Update {
        to: 0,
        packet: install(&sender),
    });
    bench.run_for(2 * SECOND);
    for (board, end) in boards.iter().zip(&ends) {
        assert_eq!(
            end.borrow().as_deref(),
            Some("the boot loader changes images")
        );
        let mut taken = vec![0; length.next_multiple_of(4)];
        block_on(board.flash.programmer().read(spare, &mut taken)).unwrap();
        assert_eq!(taken[..length], image(length));
    }
    // A frame of a block has 71 bytes of packet, 2 of message, and 25 of the link.
    let of_image = blocks as u64 * airtime(71 + 2 + 25);
    (air as f64 / of_image as f64, took as f64 / 1e9)
}

fn install(sender: &Sender) -> UpdatePacket {
    let install = Packet::Install {
        package: sender.package().name(),
    };
    let mut buffer = [0; PACKET_MAX];
    let length = install.write(&mut buffer);
    UpdatePacket::new(&buffer[..length]).unwrap()
}

#[test]
fn all_nodes_of_a_network_take_an_image() {
    for (cameras, loss) in [(4, 0.0), (4, 0.3)] {
        let (share, seconds) = update(cameras, 20_000, loss);
        println!(
            "{cameras} cameras, loss {loss}: {share:.2} of the image's airtime, {seconds:.0} s"
        );
    }
}

/// Forty nodes and a short image; at night a hundred, and one as long as that of all roles.
#[test]
fn many_nodes_take_an_image_in_little_more_than_its_airtime() {
    let (cameras, length) = test_support::amount((40, 120_000), (100, 331_000));
    let (share, seconds) = update(cameras, length, 0.01);
    println!("{cameras} cameras: {share:.2} of the image's airtime, {seconds:.0} s");
    assert!(share <= 1.3, "{share}");
}
