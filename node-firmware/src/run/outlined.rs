//! Futures whose stack is their own.

use core::{
    future::Future,
    pin::Pin,
    task::{Context, Poll},
};

/// A future that is never inlined into the one that awaits it, so that its stack is free again while others
/// run. Pinned where it is made: a large future that is passed by value is copied on the stack.
pub(super) struct Outlined<'a, F>(pub(super) Pin<&'a mut F>);

impl<F: Future> Future for Outlined<'_, F> {
    type Output = F::Output;

    #[inline(never)] // for less stack
    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        self.0.as_mut().poll(context)
    }
}
