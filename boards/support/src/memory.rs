//! The flash of a board without long stops, and the configuration in it. The owners of its parts are those of
//! [`board_facts`].

use core::future::Future;

use embassy_futures::yield_now;
use embedded_storage::nor_flash::{self, ErrorType};
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use node_firmware::{
    config::{
        CheckedConfig,
        page::{self, PageError},
    },
    hardware::Done,
};

/// Bytes that are looked at together; a part of every page.
const LOOK: usize = 64;

/// A flash whose driver waits for it. After each page the other tasks run.
///
/// A page that reads as erased is not erased again: on new flash, logs would begin with a second or two
/// in which the UART is not read. An erasure that power ended in its last moments may leave such a page
/// too; bits that rot in it are found by the checksums of the records. So may a write, of which a chip that
/// checks each unit then refuses another one: a log that was refused leaves the page so that it is erased.
#[derive(Debug)]
pub struct Paged<F>(pub F);

impl<F: ErrorType> ErrorType for Paged<F> {
    type Error = F::Error;
}

impl<F: nor_flash::ReadNorFlash> ReadNorFlash for Paged<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(
        &mut self,
        offset: u32,
        bytes: &mut [u8],
    ) -> impl Future<Output = Result<(), F::Error>> {
        Done::new(self.0.read(offset, bytes))
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: nor_flash::NorFlash> NorFlash for Paged<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        let mut page = from;
        loop {
            // The driver refuses a part of a page, and a range that ends before it starts.
            let next = page.saturating_add(F::ERASE_SIZE as u32).min(to);
            if !is_blank(&mut self.0, page, next) {
                self.0.erase(page, next)?;
            }
            if next >= to {
                return Ok(());
            }
            page = next;
            yield_now().await;
        }
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> impl Future<Output = Result<(), F::Error>> {
        Done::new(self.0.write(offset, bytes))
    }
}

/// Returns true if this is one whole page, and erased.
fn is_blank<F: nor_flash::NorFlash>(flash: &mut F, from: u32, to: u32) -> bool {
    let size = F::ERASE_SIZE as u32;
    if to.checked_sub(from) != Some(size) || !from.is_multiple_of(size) {
        return false;
    }
    let mut bytes = [0; LOOK];
    // A page that cannot be read is for the driver to refuse.
    (from..to)
        .step_by(LOOK)
        .all(|at| flash.read(at, &mut bytes).is_ok() && bytes.iter().all(|&byte| byte == 0xff))
}

/// The configuration in the page at this place.
///
/// # Errors
/// There is none, or it is not in order.
pub fn read_config<F: nor_flash::ReadNorFlash>(
    flash: &mut F,
    page: u32,
) -> Result<CheckedConfig, PageError> {
    let mut bytes = [0; page::PAGE_MAX];
    // Within the flash.
    let read = flash.read(page, &mut bytes);
    read.map_err(|_| PageError::Truncated)?;
    page::decode(&bytes)
}

#[cfg(test)]
mod tests {
    use core::{
        future::Future,
        pin::pin,
        task::{Context, Poll, Waker},
    };
    use std::{cell::RefCell, rc::Rc, vec, vec::Vec};

    use embassy_futures::block_on;
    use embedded_storage::nor_flash::{NorFlashErrorKind, check_erase, check_read};
    use flash_log::{Entry, Log, LogError};

    use super::*;

    /// 16 pages of 2 KiB: the one byte that is not erased in each that is used, and the erased ranges.
    #[derive(Default)]
    struct Chip {
        used: Vec<u32>,
        erased: Vec<(u32, u32)>,
    }

    impl ErrorType for Chip {
        type Error = NorFlashErrorKind;
    }

    impl nor_flash::ReadNorFlash for Chip {
        const READ_SIZE: usize = 1;

        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
            check_read(self, offset, bytes.len())?;
            for (at, byte) in (offset..).zip(bytes) {
                *byte = if self.used.contains(&at) { 0xfe } else { 0xff };
            }
            Ok(())
        }

        fn capacity(&self) -> usize {
            16 * 2048
        }
    }

    impl nor_flash::NorFlash for Chip {
        const WRITE_SIZE: usize = 8;
        const ERASE_SIZE: usize = 2048;

        fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
            check_erase(self, from, to)?;
            self.erased.push((from, to));
            Ok(())
        }

        fn write(&mut self, _: u32, _: &[u8]) -> Result<(), NorFlashErrorKind> {
            Ok(())
        }
    }

    /// Erased ranges, number of times that others could run meanwhile, and the result, where every page is used.
    fn erased(from: u32, to: u32) -> (Vec<(u32, u32)>, usize, Result<(), NorFlashErrorKind>) {
        erased_of((0..16).map(|page| page * 2048), from, to)
    }

    fn erased_of(
        used: impl Iterator<Item = u32>,
        from: u32,
        to: u32,
    ) -> (Vec<(u32, u32)>, usize, Result<(), NorFlashErrorKind>) {
        let mut flash = Paged(Chip {
            used: used.collect(),
            erased: Vec::new(),
        });
        let mut stops = 0;
        let result = {
            let mut erasing = pin!(flash.erase(from, to));
            loop {
                match erasing
                    .as_mut()
                    .poll(&mut Context::from_waker(Waker::noop()))
                {
                    Poll::Ready(result) => break result,
                    Poll::Pending => stops += 1,
                }
            }
        };
        (flash.0.erased, stops, result)
    }

    #[test]
    fn others_run_between_two_pages() {
        let pages = vec![(4096, 6144), (6144, 8192), (8192, 10240)];
        assert_eq!(erased(4096, 10240), (pages, 2, Ok(())));
        assert_eq!(erased(4096, 6144), (vec![(4096, 6144)], 0, Ok(())));
    }

    #[test]
    fn blank_pages_are_left() {
        assert_eq!(erased_of([].into_iter(), 0, 32768), (vec![], 15, Ok(())));
        for at in [4096, 4096 + 63, 4096 + 64, 6143] {
            let (pages, _, result) = erased_of([at, 8192].into_iter(), 0, 8192);
            assert_eq!((pages, result), (vec![(4096, 6144)], Ok(())), "{at}");
        }
        // A range that is no whole page is for the driver to refuse.
        let unaligned = Err(NorFlashErrorKind::NotAligned);
        assert_eq!(erased_of([].into_iter(), 8, 2056).2, unaligned);
    }

    /// 4 pages of an STM32L4, where a unit whose write was cut reads as erased and refuses to be written.
    #[derive(Clone, Default)]
    struct Checked(Rc<RefCell<State>>);

    #[derive(Default)]
    struct State {
        bytes: Vec<u8>,
        spoilt: Vec<u32>,
        cut: u32,
        writes: u32,
    }

    impl ErrorType for Checked {
        type Error = NorFlashErrorKind;
    }

    impl nor_flash::ReadNorFlash for Checked {
        const READ_SIZE: usize = 1;

        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
            check_read(self, offset, bytes.len())?;
            bytes.copy_from_slice(&self.0.borrow().bytes[offset as usize..][..bytes.len()]);
            Ok(())
        }

        fn capacity(&self) -> usize {
            4 * 2048
        }
    }

    impl nor_flash::NorFlash for Checked {
        const WRITE_SIZE: usize = 8;
        const ERASE_SIZE: usize = 2048;

        fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
            check_erase(self, from, to)?;
            let mut state = self.0.borrow_mut();
            state.bytes[from as usize..to as usize].fill(0xff);
            state.spoilt.retain(|at| !(from..to).contains(at));
            Ok(())
        }

        fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
            let mut state = self.0.borrow_mut();
            state.writes += 1;
            if state.writes == state.cut {
                state.spoilt.push(offset);
            }
            let end = offset + bytes.len() as u32;
            if state.spoilt.iter().any(|at| (offset..end).contains(at)) {
                return Err(NorFlashErrorKind::Other);
            }
            state.bytes[offset as usize..end as usize].copy_from_slice(bytes);
            Ok(())
        }
    }

    #[test]
    fn a_unit_that_only_looks_erased_is_got_over() {
        let start = |chip: &Checked, first: u8| {
            block_on(async {
                let mut log = Log::<_, 128>::new(Paged(chip.clone()), 0..4 * 2048)?;
                log.open().await?;
                for number in 0..60 {
                    let entry = Entry::new(number % 7, &[first; 20]).ok_or(LogError::Full)?;
                    log.append(&entry).await?;
                }
                Ok::<_, LogError<NorFlashErrorKind>>(())
            })
        };
        for cut in 1..70 {
            let chip = Checked::default();
            *chip.0.borrow_mut() = State {
                bytes: vec![0xff; 4 * 2048],
                cut,
                ..State::default()
            };
            let starts: Vec<_> = (0..5).map(|first| start(&chip, first)).collect();
            assert!(starts[0].is_err(), "{cut}");
            assert!(starts[3..].iter().all(Result::is_ok), "{cut}: {starts:?}");
        }
    }

    #[test]
    fn no_page_more_than_asked_for() {
        let unaligned = Err(NorFlashErrorKind::NotAligned);
        let outside = Err(NorFlashErrorKind::OutOfBounds);
        assert_eq!(erased(0, 2048 + 8), (vec![(0, 2048)], 1, unaligned));
        assert_eq!(erased(8, 2048), (vec![], 0, unaligned));
        assert_eq!(erased(4096, 2048), (vec![], 0, outside));
        assert_eq!(erased(32768, 34816), (vec![], 0, outside));
        let (_, _, result) = erased(u32::MAX - 7, u32::MAX);
        assert!(result.is_err());
    }

    #[test]
    fn an_erased_page_is_no_configuration() {
        let config = read_config(&mut Chip::default(), 2048);
        assert_eq!(config, Err(PageError::Blank));
    }
}
