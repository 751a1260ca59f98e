//! One flash for several users, which each keep to a range of it.
//!
//! Does the same as `embassy_embedded_hal::flash::partition` with an `embassy_sync` mutex, in a fraction of
//! the code: all is in one task, so that one waker is enough for all users that wait.

use core::{
    cell::{Cell, RefCell, RefMut},
    future::poll_fn,
    ops::{Deref, DerefMut},
    task::{Poll, Waker},
};

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// A flash, and the user that waits until it is free.
pub(super) struct SharedFlash<F> {
    flash: RefCell<F>,
    waits: Cell<Option<Waker>>,
}

/// The flash while one user has it.
struct Busy<'a, F> {
    flash: RefMut<'a, F>,
    waits: &'a Cell<Option<Waker>>,
}

impl<F> SharedFlash<F> {
    pub(super) const fn new(flash: F) -> Self {
        Self {
            flash: RefCell::new(flash),
            waits: Cell::new(None),
        }
    }

    /// For one of the users.
    pub(super) const fn user(&self) -> FlashUser<'_, F> {
        FlashUser(self)
    }

    /// Waits until the other user is ready.
    async fn lock(&self) -> Busy<'_, F> {
        poll_fn(|context| match self.flash.try_borrow_mut() {
            Ok(flash) => Poll::Ready(Busy {
                flash,
                waits: &self.waits,
            }),
            Err(_) => {
                self.waits.set(Some(context.waker().clone()));
                Poll::Pending
            }
        })
        .await
    }
}

impl<F> Deref for Busy<'_, F> {
    type Target = F;

    fn deref(&self) -> &F {
        &self.flash
    }
}

impl<F> DerefMut for Busy<'_, F> {
    fn deref_mut(&mut self) -> &mut F {
        &mut self.flash
    }
}

impl<F> Drop for Busy<'_, F> {
    /// No user is polled before this function has returned, and the flash is free.
    fn drop(&mut self) {
        if let Some(waker) = self.waits.take() {
            waker.wake();
        }
    }
}

/// The flash for one of its users.
pub(super) struct FlashUser<'a, F>(&'a SharedFlash<F>);

impl<F: ErrorType> ErrorType for FlashUser<'_, F> {
    type Error = F::Error;
}

impl<F: ReadNorFlash> ReadNorFlash for FlashUser<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.0.lock().await.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        let flash = self.0.flash.try_borrow();
        debug_assert!(flash.is_ok(), "asked while an operation is under way");
        flash.map_or(0, |flash| flash.capacity())
    }
}

impl<F: NorFlash> NorFlash for FlashUser<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        self.0.lock().await.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.0.lock().await.write(offset, bytes).await
    }
}
