//! Flash that loses its power.

use std::{cell::Cell, rc::Rc};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use virtual_bench::{
    executor::{Ended, Executor, Time},
    flash::{Flash, PAGE, PAGE_TIME, WORD_TIME},
    random::Root,
};

use crate::support::SECOND;

fn flash(executor: &Executor) -> Flash {
    Flash::new(&executor.clock(), 2, Root(3).stream("flash", 0))
}

#[test]
fn times_bits_and_bounds() {
    let mut executor = Executor::new();
    let chip = flash(&executor);
    let (mut flash, clock) = (chip.clone(), executor.clock());
    executor.spawn(async move {
        flash.write(8, &[0xF0; 12]).await.unwrap();
        assert_eq!(clock.time(), 3 * 41_000);
        // Bits only fall.
        flash.write(12, &[0x3C; 4]).await.unwrap();
        let mut bytes = [0; 12];
        flash.read(6, &mut bytes).await.unwrap();
        let expected = [
            0xFF, 0xFF, 0xF0, 0xF0, 0xF0, 0xF0, 0x30, 0x30, 0x30, 0x30, 0xF0, 0xF0,
        ];
        assert_eq!(bytes, expected);
        let before = clock.time();
        flash.erase(0, 2 * PAGE as u32).await.unwrap();
        assert_eq!(clock.time() - before, 2 * 85_000_000);
        assert!(flash.bytes().iter().all(|&byte| byte == 0xFF));
        let kind = |result: Result<(), _>| {
            result.map_err(|error: virtual_bench::flash::FlashError| error.kind())
        };
        let unaligned = Err(NorFlashErrorKind::NotAligned);
        let outside = Err(NorFlashErrorKind::OutOfBounds);
        assert_eq!(kind(flash.write(2, &[0; 4]).await), unaligned);
        assert_eq!(kind(flash.write(0, &[0; 3]).await), unaligned);
        assert_eq!(kind(flash.erase(0, 100).await), unaligned);
        assert_eq!(kind(flash.erase(4096, 0).await), outside);
        assert_eq!(kind(flash.write(2 * PAGE as u32, &[0; 4]).await), outside);
    });
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
    let wear = chip.wear();
    assert_eq!((wear.erasures, wear.words, wear.torn), (vec![1, 1], 4, 0));
}

/// Cuts the power at a time after the next operation has begun.
fn cut_after(
    executor: &mut Executor,
    chip: &Flash,
    victim: virtual_bench::executor::TaskId,
    after: Time,
) {
    let (chip, clock, spawner) = (chip.clone(), executor.clock(), executor.spawner());
    executor.spawn(async move {
        chip.next_operation().await;
        clock.sleep(after).await;
        spawner.kill(victim);
    });
}

/// The power fails in the third of four words: two are written, of the third some bits, the fourth
/// is untouched.
#[test]
fn a_torn_write() {
    let mut executor = Executor::new();
    let chip = flash(&executor);
    let (mut flash, clock) = (chip.clone(), executor.clock());
    let is_done = Rc::new(Cell::new(false));
    let done = is_done.clone();
    let victim = executor.spawn(async move {
        clock.sleep(1000).await;
        flash.write(0, &[0; 16]).await.unwrap();
        done.set(true);
    });
    cut_after(&mut executor, &chip, victim, 2 * WORD_TIME + WORD_TIME / 2);
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    assert!(!is_done.get());
    let bytes = chip.bytes().to_vec();
    assert_eq!(bytes[..8], [0; 8]);
    assert!(bytes[8..12] != [0; 4] && bytes[8..12] != [0xFF; 4]);
    assert_eq!(bytes[12..16], [0xFF; 4]);
    assert_eq!((chip.wear().words, chip.wear().torn), (3, 1));
}

#[test]
fn a_torn_erasure_leaves_the_next_page_and_spoils_its_own() {
    let mut executor = Executor::new();
    let chip = flash(&executor);
    block_on(chip.programmer().write(0, &[0; 2 * PAGE])).unwrap();
    assert_eq!(executor.clock().time(), 0);
    let (mut flash, clock) = (chip.clone(), executor.clock());
    let victim = executor.spawn(async move {
        clock.sleep(1).await;
        flash.erase(0, 2 * PAGE as u32).await.unwrap();
    });
    cut_after(&mut executor, &chip, victim, PAGE_TIME / 3);
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    let bytes = chip.bytes();
    assert!(bytes[..PAGE].iter().any(|&byte| byte != 0xFF));
    assert!(bytes[..PAGE].iter().any(|&byte| byte != 0));
    assert!(bytes[PAGE..].iter().all(|&byte| byte == 0));
}
