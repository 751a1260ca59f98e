//! The flash of a board without long stops, and the configuration in it. Which page is what is in
//! [`flash`](crate::flash).

use embassy_futures::yield_now;
use embedded_storage::nor_flash::{self, ErrorType};
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use node_firmware::config::{
    CheckedConfig,
    page::{self, PageError},
};

/// A flash whose driver waits for it. After each page that is erased the other tasks run.
#[derive(Debug)]
pub struct Paged<F>(pub F);

impl<F: ErrorType> ErrorType for Paged<F> {
    type Error = F::Error;
}

impl<F: nor_flash::ReadNorFlash> ReadNorFlash for Paged<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.0.read(offset, bytes)
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
            // The driver refuses a part of a page, and what ends before it starts.
            let next = page.saturating_add(F::ERASE_SIZE as u32).min(to);
            self.0.erase(page, next)?;
            if next >= to {
                return Ok(());
            }
            page = next;
            yield_now().await;
        }
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.0.write(offset, bytes)
    }
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
    use std::{vec, vec::Vec};

    use embedded_storage::nor_flash::{NorFlashErrorKind, check_erase};

    use super::*;

    /// 16 pages of 2 KiB, and what was erased of them.
    #[derive(Default)]
    struct Chip(Vec<(u32, u32)>);

    impl ErrorType for Chip {
        type Error = NorFlashErrorKind;
    }

    impl nor_flash::ReadNorFlash for Chip {
        const READ_SIZE: usize = 1;

        fn read(&mut self, _: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
            bytes.fill(0xFF);
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
            self.0.push((from, to));
            Ok(())
        }

        fn write(&mut self, _: u32, _: &[u8]) -> Result<(), NorFlashErrorKind> {
            Ok(())
        }
    }

    /// What was erased, how often others could run meanwhile, and the result.
    fn erased(from: u32, to: u32) -> (Vec<(u32, u32)>, usize, Result<(), NorFlashErrorKind>) {
        let mut flash = Paged(Chip::default());
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
        (flash.0.0, stops, result)
    }

    #[test]
    fn others_run_between_two_pages() {
        let pages = vec![(4096, 6144), (6144, 8192), (8192, 10240)];
        assert_eq!(erased(4096, 10240), (pages, 2, Ok(())));
        assert_eq!(erased(4096, 6144), (vec![(4096, 6144)], 0, Ok(())));
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
