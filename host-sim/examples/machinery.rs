//! Speed of the machinery of simulated networks:
//! `cargo run --release -p host-sim --example machinery`.

use std::{cell::Cell, rc::Rc, time::Instant};

use cmucam2_driver::{colour::ColourBounds, device::Cmucam2, session::StartUp};
use cmucam2_emulator::{Configuration, Emulator, Extent, Scene, Shape};
use cmucam2_pair::measure::track_for;
use embassy_futures::select::select;
use node_test::CameraDevice;
use virtual_hardware::{
    executor::{Effort, Executor, Time},
    line::{Line, Side, Uart},
    medium::{Medium, Propagation},
    random::Root,
};

use support::{MILLISECOND, Network, SECOND};

#[path = "../../host/virtual-hardware/tests/it/support.rs"]
#[allow(dead_code, reason = "a part of it is enough here")]
mod support;

fn main() {
    let only = std::env::args().nth(1);
    let runs = |what: &str| only.as_deref().is_none_or(|only| only == what);
    if runs("emulator") {
        emulator();
    }
    if runs("timers") {
        timers();
    }
    if runs("network") {
        network(15, 15, 700);
        network(1000, 33, 100);
    }
    if runs("cameras") {
        cameras(1000, 10, None);
        cameras(1000, 200, Some(20));
    }
}

fn report(what: &str, virtual_time: Time, begin: Instant, effort: Effort) {
    let wall = begin.elapsed().as_secs_f64();
    let simulated = virtual_time as f64 / SECOND as f64;
    let Effort { events, polls } = effort;
    println!(
        "{what}: {simulated:.0} s in {wall:.3} s, {:.0} x real time; \
         {events} events and {polls} polls, {:.2} million events/s",
        simulated / wall,
        events as f64 / wall * 1e-6
    );
}

/// One colour-tracking frame and its packet.
fn emulator() {
    let (cameras, seconds) = (20, 20);
    let begin = Instant::now();
    let bytes: u64 = (0..cameras).map(|seed| track_for(seconds, seed)).sum();
    let frames = (cameras * seconds * 50) as f64;
    let each = begin.elapsed().as_secs_f64() * 1e6 / frames;
    println!("emulator with noise: {each:.2} us a frame ({bytes} bytes)");
    let ball = Extent::centred(0.43, 0.5, 0.1, 0.1);
    let scene = Scene::with_object([210, 105, 40], Shape::Disc, ball);
    let mut camera = Emulator::new(Configuration::default(), scene);
    camera.advance(SECOND);
    for byte in *b"CR 19 32\rTC 170 240 60 150 16 90\r" {
        camera.receive(byte, SECOND);
    }
    let (begin, mut packets) = (Instant::now(), 0_u64);
    while let Some(now) = camera.next_deadline().filter(|&now| now < 400 * SECOND) {
        while let Some((_, byte)) = camera.transmit(now) {
            packets += u64::from(byte == b'\r');
        }
    }
    let each = begin.elapsed().as_secs_f64() * 1e6 / packets as f64;
    println!("emulator, plain: {each:.2} us a frame ({packets} packets)");
}

/// Tasks that select between two timers, so that every second one is cancelled.
fn timers() {
    let mut executor = Executor::new();
    for task in 0..1000 {
        let clock = executor.clock();
        executor.spawn(async move {
            loop {
                select(
                    clock.sleep(MILLISECOND + task),
                    clock.sleep(2 * MILLISECOND),
                )
                .await;
            }
        });
    }
    let begin = Instant::now();
    let _ = executor.run_until(5 * SECOND);
    report(
        "1000 tasks with two timers each",
        5 * SECOND,
        begin,
        executor.effort(),
    );
}

/// `zigbee-link` nodes in networks of so many, which are far apart.
fn network(nodes: u32, size: u32, seconds: Time) {
    let mut executor = Executor::new();
    let root = Root(1);
    let begin = Instant::now();
    let (mut joined, mut frames, mut effort) = (0, 0, Effort::default());
    for cluster in 0..nodes.div_ceil(size) {
        let disk = Propagation::UnitDisk {
            range: 20.0,
            loss: 0.02,
        };
        let clock = executor.clock();
        let medium = Medium::new(&clock, disk, root.seed("medium", cluster.into()));
        let members = size.min(nodes - cluster * size);
        let places = (0..members).map(|n| [f64::from(n % 6), f64::from(n / 6)]);
        let mut network = Network::new(executor, medium, root, places);
        let _ = network.executor.run_until(seconds * SECOND);
        joined += network.joined();
        frames += network.medium.totals().frames;
        effort.events += network.executor.effort().events;
        effort.polls += network.executor.effort().polls;
        executor = Executor::new();
    }
    report(
        &format!("{nodes} nodes, {joined} joined, {frames} frames"),
        seconds * SECOND,
        begin,
        effort,
    );
}

/// Cameras with the driver, each before a ball. They stream at 50 frames a second, or look for five
/// packets at intervals of so many seconds, as at the stops of a target.
fn cameras(count: u64, seconds: Time, interval: Option<Time>) {
    const BAUD: u32 = 38_400;
    let mut executor = Executor::new();
    let packets = Rc::new(Cell::new(0_u64));
    for seed in 0..count {
        let heard = packets.clone();
        let clock = executor.clock();
        let configuration = Configuration {
            baud: BAUD,
            host_baud: BAUD,
            seed,
            ..Configuration::default()
        };
        let ball = Extent::centred(0.43, 0.5, 0.1, 0.1);
        let scene = Scene::with_object([220, 110, 40], Shape::Disc, ball);
        let camera = Emulator::new(configuration, scene);
        let line = Line::to_device(
            &clock,
            Uart::new(BAUD),
            CameraDevice::new(camera, |_, _| ()),
        );
        executor.spawn(async move {
            let mut camera = Cmucam2::new(line.open(Side::Node), clock.clone());
            let mut start_up = StartUp::default();
            start_up.adapt_ms = 2_000;
            let bounds = ColourBounds::new([170, 240, 60, 180, 16, 100]).expect("in order");
            camera.start_up(start_up).run().await.expect("it starts");
            loop {
                let track = camera.track_colour(bounds);
                track.run().await.expect("it tracks");
                let mut packets = 0;
                while interval.is_none() || packets < 5 {
                    camera.next_tracking().run().await.expect("it sends");
                    packets += 1;
                    heard.set(heard.get() + 1);
                }
                camera.stop().run().await.expect("it stops");
                clock.sleep(interval.unwrap_or_default() * SECOND).await;
            }
        });
    }
    let from = 10 * SECOND;
    let _ = executor.run_until(from);
    let (begin, before) = (Instant::now(), executor.effort());
    packets.set(0);
    let _ = executor.run_until(from + seconds * SECOND);
    let after = executor.effort();
    let effort = Effort {
        events: after.events - before.events,
        polls: after.polls - before.polls,
    };
    report(
        &format!("{count} cameras, {} packets", packets.get()),
        seconds * SECOND,
        begin,
        effort,
    );
}
