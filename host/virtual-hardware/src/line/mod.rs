//! UARTs: 8 data bits, no parity, one stop bit, and the time that bytes take.
//!
//! A [`Line`] has a node at one end, which reads and writes through a [`Port`], and at the other an
//! emulated [`Device`] or another port (a console). Bytes arrive at their times, but a reader is
//! woken once for a burst: when everything under way has come, or as much as it reads at once; as
//! with a UART that has DMA and an idle-line interrupt.
//!
//! Each receiver has a buffer. Bytes that come when it is full are lost and counted, as are those that come to a
//! port that is not open. Damage on the way is up to the device; a pulled plug is [`Line::unplug`].

mod device;
mod end;
mod port;

use std::{
    any::Any,
    cell::{Cell, RefCell},
    rc::{Rc, Weak},
};

pub use self::{
    device::Device,
    port::{Port, PortError},
};
use self::{device::Powered, end::End};
use super::executor::{Clock, EventId, Handler, Time};

/// Properties of a UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Uart {
    /// Bits a second, both ways.
    pub baud: u32,
    /// Bytes that wait to be read, at most.
    pub receive_buffer: usize,
    /// Bytes that wait to be sent, at most.
    pub transmit_buffer: usize,
}

impl Uart {
    /// With buffers of 256 and 64 bytes.
    pub const fn new(baud: u32) -> Self {
        Self {
            baud,
            receive_buffer: 256,
            transmit_buffer: 64,
        }
    }
}

/// Counts of bytes that have come to an end of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes that arrived, lost ones included.
    pub received: u64,
    /// Bytes lost because the buffer was full.
    pub overrun: u64,
    /// Bytes lost because the port was not open.
    pub unheard: u64,
    /// Bytes sent.
    pub sent: u64,
}

/// One of the two ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The node's.
    Node,
    /// The other one's, of a line that has a port there.
    Far,
}

enum Far {
    Device(Powered),
    Port(Box<End>),
}

struct State {
    node: End,
    far: Far,
    is_plugged: bool,
}

struct Shared {
    state: RefCell<State>,
    clock: Clock,
    own: Weak<Shared>,
    planned: Cell<Option<(Time, EventId)>>,
}

/// A line. See the [module](self).
#[derive(Clone)]
pub struct Line(Rc<Shared>);

impl Line {
    /// A line to a device that is switched on now.
    pub fn to_device(clock: &Clock, uart: Uart, mut device: impl Device) -> Self {
        if clock.time() > 0 {
            device.power_up(clock.time());
        }
        Self::new(clock, uart, Far::Device(Powered::new(Box::new(device))))
    }

    /// A line to another port, such as a console.
    pub fn between_ports(clock: &Clock, node: Uart, far: Uart) -> Self {
        Self::new(clock, node, Far::Port(Box::new(End::new(far))))
    }

    fn new(clock: &Clock, uart: Uart, far: Far) -> Self {
        let state = State {
            node: End::new(uart),
            far,
            is_plugged: true,
        };
        Self(Rc::new_cyclic(|own| Shared {
            state: RefCell::new(state),
            clock: clock.clone(),
            own: own.clone(),
            planned: Cell::new(None),
        }))
    }

    /// Opens an end, with empty buffers. It is closed when the port is dropped; each end has one
    /// port at a time. The far end of a line to a device never gets or sends anything.
    pub fn open(&self, side: Side) -> Port {
        self.0.act(|state, now| {
            if let Some(end) = state.end(side) {
                end.open(now);
            }
        });
        Port::new(self.0.clone(), side)
    }

    /// Pulls the plug: bytes under way and those that follow are lost in both directions. The device loses its
    /// power, if that came through the plug.
    pub fn unplug(&self, with_power: bool) {
        self.0.act(|state, _| {
            state.is_plugged = false;
            if let Far::Device(device) = &mut state.far {
                device.has_power &= !with_power;
            }
        });
    }

    /// Puts the plug back. A device that had lost its power starts anew.
    pub fn plug(&self) {
        self.0.act(|state, now| {
            state.is_plugged = true;
            if let Far::Device(device) = &mut state.far {
                device.power_up(now);
            }
        });
    }

    /// Does something to the device, if there is one of this type: a brown-out, other faults, its
    /// button.
    pub fn with_device<D: Device, T>(&self, act: impl FnOnce(&mut D, Time) -> T) -> Option<T> {
        self.0.act(|state, now| match &mut state.far {
            Far::Device(far) => {
                let device: &mut dyn Any = &mut *far.device;
                device.downcast_mut().map(|device| act(device, now))
            }
            Far::Port(_) => None,
        })
    }

    /// Counts of bytes that have come to an end; none of those to a device.
    pub fn counts(&self, side: Side) -> Counts {
        self.0.act(|state, _| {
            let end = state.end(side);
            end.map_or_else(Counts::default, |end| end.counts)
        })
    }
}

impl Shared {
    /// Does something, after everything that was due before.
    fn act<T>(&self, act: impl FnOnce(&mut State, Time) -> T) -> T {
        let now = self.clock.time();
        let mut state = self.state.borrow_mut();
        state.advance(now);
        let result = act(&mut state, now);
        let next = state.next();
        drop(state);
        self.plan(next);
        result
    }

    fn plan(&self, next: Option<Time>) {
        if self.planned.get().map(|(at, _)| at) == next {
            return;
        }
        if let Some((_, event)) = self.planned.take() {
            self.clock.cancel(event);
        }
        if let Some(at) = next {
            let event = self.clock.call_at(at, self.own.clone(), 0);
            self.planned.set(Some((at, event)));
        }
    }
}

impl Handler for Shared {
    fn event(&self, _: u64) {
        self.planned.set(None);
        self.act(|_, _| ());
    }
}

impl State {
    fn end(&mut self, side: Side) -> Option<&mut End> {
        match (side, &mut self.far) {
            (Side::Node, _) => Some(&mut self.node),
            (Side::Far, Far::Port(end)) => Some(end),
            (Side::Far, Far::Device(_)) => None,
        }
    }

    /// Does everything that is due until now, and wakes the tasks that wait for it.
    fn advance(&mut self, now: Time) {
        let Self {
            node,
            far,
            is_plugged,
        } = self;
        match far {
            Far::Device(device) => device.advance(now, node, *is_plugged),
            Far::Port(far) => {
                far.deliver(now, node, *is_plugged);
                node.deliver(now, far, *is_plugged);
                far.wake();
            }
        }
        node.wake();
    }

    /// Time of the next event that must be handled.
    fn next(&self) -> Option<Time> {
        let own = match &self.far {
            Far::Device(device) => [device.next(&self.node), None],
            Far::Port(far) => [
                self.node
                    .is_waiting()
                    .then(|| far.burst(self.node.room()))
                    .flatten(),
                far.is_waiting()
                    .then(|| self.node.burst(far.room()))
                    .flatten(),
            ],
        };
        let far = match &self.far {
            Far::Device(_) => None,
            Far::Port(far) => far.sent_at(),
        };
        own.into_iter()
            .chain([self.node.sent_at(), far])
            .flatten()
            .min()
    }
}
