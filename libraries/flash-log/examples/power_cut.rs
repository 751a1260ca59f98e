//! A log in a flash of RAM that loses its power: `cargo run -p flash-log --example power_cut`.
//!
//! A counter is written again and again. The power fails at every place in turn, and the log then holds the value
//! before or the one that was being written: never another one, and never none.

use embassy_futures::block_on;
use flash_log::{Entry, Log, LogError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use virtual_hardware::flash::{Flash, FlashError};

const PAGE: usize = 256;
const COUNTER: u8 = 7;

/// Writes the next values of the counter, and returns the last that the log has promised to keep.
async fn count(flash: Flash<PAGE>, to: u32) -> Result<u32, u32> {
    let mut kept = 0;
    let counting = async {
        let mut log = Log::<_, 32>::new(flash, 0..2 * PAGE as u32)?;
        log.open().await?;
        for value in 1..=to {
            let entry = Entry::new(COUNTER, &value.to_le_bytes()).ok_or(LogError::Full)?;
            log.append(&entry).await?;
            kept = value;
        }
        Ok::<(), LogError<FlashError>>(())
    };
    match counting.await {
        Ok(()) => Ok(kept),
        Err(_) => Err(kept),
    }
}

/// The counter in the flash, after a start.
async fn read(flash: Flash<PAGE>) -> Result<u32, LogError<FlashError>> {
    let mut log = Log::<_, 32>::new(flash, 0..2 * PAGE as u32)?;
    log.open().await?;
    let entry = log.find(COUNTER).await?;
    Ok(entry.map_or(0, |entry| {
        let value = entry.value().first_chunk().copied();
        u32::from_le_bytes(value.unwrap_or_default())
    }))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut cuts = 0;
    // So many words are written and pages erased before the power fails.
    for changes in 1.. {
        let flash = Flash::without_time(2, ChaCha8Rng::seed_from_u64(changes.into()));
        flash.power(Some(changes));
        let counted = block_on(count(flash.programmer(), 20));
        let is_over = counted.is_ok();
        let kept = counted.unwrap_or_else(|kept| kept);
        flash.power(None);
        let found = block_on(read(flash))?;
        assert!(found == kept || found == kept + 1, "{found} after {kept}");
        if is_over {
            break;
        }
        cuts += 1;
    }
    println!("the power failed at {cuts} places, and nothing was lost");
    Ok(())
}
