//! Branches to panics that the compiler left in an image, and why they are never taken.
//!
//! A reason is part of the program: who changes what it relies on, changes it here too.

/// Some branches that are not taken.
struct Allowed {
    /// How the name of the panic begins.
    panic: &'static str,
    /// Part of the name of a function there, inlined or not.
    function: &'static str,
    reason: &'static str,
}

/// Only on input of the chip itself, of constants, or of other parts of the same library.
const ALLOWED: &[Allowed] = &[
    Allowed {
        panic: "core::panicking::panic_const::panic_const_async_fn_resumed",
        function: "",
        reason: "nobody polls a future that has ended: not `await`, not `join` and `select`, and not the executor",
    },
    Allowed {
        panic: "",
        function: "____embassy_main_task_inner_function",
        reason: "start-up: the task ends with it",
    },
    Allowed {
        panic: "",
        function: "__cortex_m_rt_main",
        reason: "start-up: the one task is spawned once",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "mps2_an386::executor::run",
        reason: "start-up: the executor is made once",
    },
    Allowed {
        panic: "core::cell::",
        function: "node_firmware::run::",
        reason: "the node is borrowed for one statement, by tasks of one executor",
    },
    Allowed {
        panic: "core::cell::",
        function: "zigbee_link::runner::",
        reason: "the node is borrowed for one statement, by tasks of one executor",
    },
    Allowed {
        panic: "core::cell::",
        function: "embassy_sync::",
        reason: "borrowed within its lock, by code that does not come back",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_sync::channel::Channel",
        reason: "borrowed within its lock, by code that does not come back",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_sync::channel::SendFuture",
        reason: "nobody polls a future that has ended",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_embedded_hal::flash::partition::asynch::Partition",
        reason: "start-up: the ranges of the flash are constants of the board",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "node_firmware::run::",
        reason: "nobody polls a future that has ended, nor sends twice what was sent",
    },
    Allowed {
        panic: "core::option::expect_failed",
        function: "heapless::vec::VecInner<T,LenT,heapless::vec::storage::VecStorageInner",
        reason: "lists are collected from lists of the same capacity",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_sync::mutex::MutexGuard",
        reason: "a guard exists only while it is locked",
    },
    Allowed {
        panic: "core::panicking::panic",
        function: "embassy_sync::ring_buffer::RingBuffer",
        reason: "the library keeps its positions within its ring",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_executor::raw::waker::task_from_waker",
        reason: "time is awaited by tasks of the executor only, whose wakers these are",
    },
    Allowed {
        panic: "core::panicking::panic",
        function: "zigbee_link::security::peers::Peers",
        reason: "the place was found in the same list",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "heapless::vec::VecInner<T,LenT,S>::remove",
        reason: "the place was found in the same list",
    },
    Allowed {
        panic: "core::result::unwrap_failed",
        function: "zigbee_link::security::ccm::",
        reason: "a frame has 8 blocks, the counter of CCM 65,536",
    },
    Allowed {
        panic: "core::panicking::panic_const::panic_const_div_by_zero",
        function: "cmucam2_driver::geometry::DownSampling",
        reason: "a factor of zero is refused where it is made",
    },
    Allowed {
        panic: "",
        function: "embedded_io_async::Write::write_all",
        reason: "the UARTs of the boards take at least one byte, and no more than there are",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "defmt_rtt::",
        reason: "nothing that is logged logs, and every frame is acquired and released once",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "defmt_semihosting::",
        reason: "nothing that is logged logs, and every frame is acquired and released once",
    },
    Allowed {
        panic: "core::cell::",
        function: "embassy_nrf::time_driver::",
        reason: "borrowed within a critical section, by code that does not come back",
    },
    Allowed {
        panic: "",
        function: "embassy_nrf::buffered_uarte::",
        reason: "positions in rings and numbers of channels, which the library makes itself",
    },
    Allowed {
        panic: "",
        function: "embassy_nrf::gpiote::",
        reason: "numbers of ports and pins, which the library makes itself",
    },
    Allowed {
        panic: "core::panicking::panic_fmt",
        function: "embassy_nrf::timer::Timer::cc",
        reason: "constant numbers of registers",
    },
    Allowed {
        panic: "",
        function: "embassy_nrf::radio::ieee802154::Radio::disable",
        reason: "states of the radio are those of the manual",
    },
    Allowed {
        panic: "",
        function: "embassy_nrf::radio::ieee802154::Radio::set_channel",
        reason: "`zigbee_link::radio::Channel` is 11 to 26",
    },
    Allowed {
        panic: "",
        function: "embassy_nrf::radio::ieee802154::Radio::set_transmission_power",
        reason: "powers are chosen from the list of those that the chip has",
    },
    Allowed {
        panic: "core::slice::index::",
        function: "semihosting::io::Write::write_all",
        reason: "the emulator writes no more than it was given",
    },
    Allowed {
        panic: "core::panicking::panic",
        function: "semihosting::fd::BorrowedFd",
        reason: "the emulator hands out no such file",
    },
    Allowed {
        panic: "",
        function: "semihosting::sys::",
        reason: "start-up: the emulator's arguments",
    },
    Allowed {
        panic: "",
        function: "postcard::ser::serialize_with_flavor",
        reason: "every message of the panel fits its buffer",
    },
    Allowed {
        panic: "",
        function: "postcard::de::from_bytes_cobs",
        reason: "the frame ends with its zero, so that decoding makes it shorter; tested with any bytes",
    },
    Allowed {
        panic: "",
        function: "cobs::dec::decode_in_place",
        reason: "it reads only what lies before the end of the frame; tested with any bytes",
    },
];

/// The reason, if there is one.
pub(super) fn reason(panic: &str, place: &[String]) -> Option<&'static str> {
    ALLOWED
        .iter()
        .find(|allowed| {
            panic.starts_with(allowed.panic)
                && place.iter().any(|frame| frame.contains(allowed.function))
        })
        .map(|allowed| allowed.reason)
}
