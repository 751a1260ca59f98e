//! The USB device of the chip as a PC may ask for it: of an endpoint that it has not, nothing is asked. The library
//! would panic, and restart the node.

use embassy_usb::driver::{
    Bus, Driver, EndpointAddress, EndpointAllocError, EndpointType, Event, Unsupported,
};

/// Endpoints in each direction (Product Specification, "USBD").
const ENDPOINTS: usize = 8;

/// A driver that is asked for endpoints of the chip only.
pub(crate) struct Guarded<T>(pub(crate) T);

impl<'d, D: Driver<'d>> Driver<'d> for Guarded<D> {
    type EndpointOut = D::EndpointOut;
    type EndpointIn = D::EndpointIn;
    type ControlPipe = D::ControlPipe;
    type Bus = Guarded<D::Bus>;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointOut, EndpointAllocError> {
        self.0
            .alloc_endpoint_out(kind, address, packet, interval_ms)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointIn, EndpointAllocError> {
        self.0.alloc_endpoint_in(kind, address, packet, interval_ms)
    }

    fn start(self, packet: u16) -> (Self::Bus, Self::ControlPipe) {
        let (bus, control) = self.0.start(packet);
        (Guarded(bus), control)
    }
}

impl<B: Bus> Bus for Guarded<B> {
    async fn enable(&mut self) {
        self.0.enable().await;
    }

    async fn disable(&mut self) {
        self.0.disable().await;
    }

    async fn poll(&mut self) -> Event {
        self.0.poll().await
    }

    fn endpoint_set_enabled(&mut self, address: EndpointAddress, enabled: bool) {
        if address.index() < ENDPOINTS {
            self.0.endpoint_set_enabled(address, enabled);
        }
    }

    fn endpoint_set_stalled(&mut self, address: EndpointAddress, stalled: bool) {
        if address.index() < ENDPOINTS {
            self.0.endpoint_set_stalled(address, stalled);
        }
    }

    fn endpoint_is_stalled(&mut self, address: EndpointAddress) -> bool {
        address.index() < ENDPOINTS && self.0.endpoint_is_stalled(address)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}
