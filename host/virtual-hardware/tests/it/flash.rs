//! Flash that loses its power.

use std::{cell::Cell, rc::Rc};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use virtual_hardware::{
    executor::{Ended, Executor, Time},
    flash::{Flash, FlashError, PAGE, PAGE_TIME, WORD_TIME},
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
        let mut bytes = [0; 12];
        flash.read(4, &mut bytes).await.unwrap();
        assert_eq!(bytes[..4], [0xFF; 4]);
        assert_eq!(bytes[4..], [0xF0; 8]);
        let before = clock.time();
        flash.erase(0, 2 * PAGE as u32).await.unwrap();
        assert_eq!(clock.time() - before, 2 * 85_000_000);
        assert!(flash.bytes().iter().all(|&byte| byte == 0xFF));
        let unaligned = Err(FlashError::NotAligned);
        let outside = Err(FlashError::OutOfBounds);
        assert_eq!(flash.read(2, &mut bytes).await, unaligned);
        assert_eq!(flash.write(2, &[0; 4]).await, unaligned);
        assert_eq!(flash.write(0, &[0; 3]).await, unaligned);
        assert_eq!(flash.erase(0, 100).await, unaligned);
        assert_eq!(flash.erase(4096, 0).await, outside);
        assert_eq!(flash.write(2 * PAGE as u32, &[0; 4]).await, outside);
    });
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
    let wear = chip.wear();
    assert_eq!((wear.erasures, wear.words, wear.torn), (vec![1, 1], 3, 0));
    assert_eq!(wear.reads, 1);
}

/// Cuts the power at a time after the next operation has begun.
fn cut_after(
    executor: &mut Executor,
    chip: &Flash,
    victim: virtual_hardware::executor::TaskId,
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

/// Pages of any size, without time: a task is not needed.
fn small() -> Flash<256> {
    Flash::without_time(2, Root(3).stream("flash", 0))
}

#[test]
#[should_panic(expected = "written twice")]
fn a_word_is_written_once() {
    let mut flash = small();
    block_on(async {
        flash.write(0, &[0xFF; 8]).await.unwrap();
        flash.erase(0, 256).await.unwrap();
        flash.write(0, &[0xFF; 8]).await.unwrap();
        let _ = flash.write(4, &[0; 4]).await;
    });
}

/// The third change is torn; nothing works until there is power again.
#[test]
fn the_power_lasts_for_so_many_changes() {
    block_on(async {
        let mut flash = small();
        flash.power(Some(3));
        flash.write(0, &[0; 8]).await.unwrap();
        assert!(flash.has_power());
        let failed = Err(FlashError::Failed);
        assert_eq!(flash.write(8, &[0; 8]).await, failed);
        assert!(!flash.has_power());
        assert_eq!(flash.read(0, &mut [0; 4]).await, failed);
        assert_eq!(flash.erase(0, 256).await, failed);
        {
            let bytes = flash.bytes();
            assert_eq!(bytes[..8], [0; 8]);
            assert!(bytes[8..12] != [0; 4] && bytes[8..12] != [0xFF; 4]);
            assert_eq!(bytes[12..16], [0xFF; 4]);
        }
        // The last change of an erasure of two pages.
        flash.power(Some(2));
        assert_eq!(flash.erase(0, 512).await, failed);
        assert_eq!(flash.bytes()[..256], [0xFF; 256]);
        flash.power(None);
        assert_eq!(flash.erase(0, 512).await, Ok(()));
        assert_eq!((flash.wear().torn, flash.wear().words), (2, 3));
    });
}

/// In time, too: a torn word takes as long as a whole one.
#[test]
fn power_fails_in_its_time() {
    let mut executor = Executor::new();
    let chip = flash(&executor);
    chip.power(Some(2));
    let (mut flash, clock) = (chip.clone(), executor.clock());
    executor.spawn(async move {
        assert_eq!(flash.write(0, &[0; 16]).await, Err(FlashError::Failed));
        assert_eq!(clock.time(), 2 * WORD_TIME);
    });
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    assert_eq!((chip.wear().words, chip.wear().torn), (2, 1));
}

#[test]
fn a_copy_is_another_chip_and_rots_alone() {
    block_on(async {
        let mut flash = small();
        flash.write(0, &[0; 4]).await.unwrap();
        let mut copy = flash.copy();
        copy.bytes_mut()[1] ^= 8;
        let mut bytes = [1; 4];
        copy.read(0, &mut bytes).await.unwrap();
        assert_eq!(bytes, [0, 8, 0, 0]);
        copy.fail_read(2);
        assert_eq!(copy.read(0, &mut bytes).await, Ok(()));
        assert_eq!(copy.read(0, &mut bytes).await, Err(FlashError::Failed));
        assert_eq!(copy.read(0, &mut bytes).await, Ok(()));
        flash.read(0, &mut bytes).await.unwrap();
        assert_eq!(bytes, [0; 4]);
    });
}
