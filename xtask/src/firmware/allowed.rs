//! Branches to panics that the compiler left in an image, and why they are never taken.
//!
//! A reason is part of the program: who changes what it relies on, changes it here too. What is
//! listed and no longer in any image is an error, so that the list holds nothing that was not
//! looked at.

use std::collections::BTreeSet;

use super::panics::is_ours;

/// Some branches that are not taken.
struct Allowed {
    /// The name of the panic.
    panic: &'static str,
    /// How the name of the function there begins, inlined or not, one of these. None: anywhere.
    functions: &'static [&'static str],
    /// How the name of a function farther out begins, one of these, for a function that anybody
    /// might call. None: whoever calls it.
    callers: &'static [&'static str],
    reason: &'static str,
}

const BOUNDS: &str = "core::panicking::panic_bounds_check";
const BORROWED: &str = "core::cell::panic_already_borrowed";
const BORROWED_MUTABLY: &str = "core::cell::panic_already_mutably_borrowed";
const DIVISION: &str = "core::panicking::panic_const::panic_const_div_by_zero";
const LENGTHS: &str = "core::slice::copy_from_slice_impl::len_mismatch_fail";
const MESSAGE: &str = "core::panicking::panic_fmt";
const SLICE: &str = "core::slice::index::slice_index_fail";
/// `assert!`, `unreachable!` and others with a text only.
const TEXT: &str = "core::panicking::panic";

const BORROWED_ONCE: &str = "borrowed within its lock, by code that does not come back";
const CLOCKS: &str = "start-up: the clocks are constants of the board";
const COBS: &str =
    "the frame ends with its zero, and is read up to there only; tested with any bytes";
const I2C: &str = "the bus has a constant rate, of a clock that is a constant of the board";
const LOGGER: &str = "nothing that is logged logs, and every frame is acquired and released once";
const NODE: &str = "the node is borrowed for one statement, by tasks of one executor";
const PAGES: &str =
    "the node's part of the flash is whole pages of it, and its writes are whole units";
const RING: &str = "the library keeps its positions within its ring";
const TIMEOUT: &str = "the time after which the watchdog acts is a constant that it can have";
const WRITE: &str = "the UARTs of the boards take at least one byte, and no more than there are";

/// Only on input of the chip itself, of constants, or of other parts of the same library.
const ALLOWED: &[Allowed] = &[
    // Every `async fn` has it, and the functions it is inlined into are those of this project.
    Allowed {
        panic: "core::panicking::panic_const::panic_const_async_fn_resumed",
        functions: &[],
        callers: &[],
        reason: "nobody polls a future that has ended: not `await`, not `join` and `select`, and not the executor",
    },
    Allowed {
        panic: "core::result::unwrap_failed",
        functions: &[
            "nrf52840::node::__cortex_m_rt_main",
            "nucleo_l476rg::node::__cortex_m_rt_main",
        ],
        callers: &[],
        reason: "start-up: the one task is spawned once",
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_nrf::chip::Peripherals::take_with_cs",
            "embassy_stm32::_generated::Peripherals::take_with_cs",
            "nrf52840::node::____embassy_main_task",
            "nucleo_l476rg::node::____embassy_main_task",
        ],
        callers: &[],
        reason: "start-up: peripherals and cells of statics are taken once",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_nrf::buffered_uarte::_version::BufferedUarteRx::new_innerer"],
        callers: &[],
        reason: "start-up: numbers of channels, which the library makes itself",
    },
    Allowed {
        panic: BORROWED,
        functions: &["embassy_nrf::rng::State::borrow_mut"],
        callers: &[],
        reason: "start-up: borrowed within a critical section, by code that does not come back",
    },
    Allowed {
        panic: "core::option::unwrap_failed",
        functions: &["embassy_stm32::rcc::init_rcc"],
        callers: &[],
        reason: CLOCKS,
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_stm32::rcc::init_rcc"],
        callers: &[],
        reason: CLOCKS,
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_stm32::rcc::init_rcc",
            "embassy_stm32::time_driver::driver::RtcDriver::init_timer",
        ],
        callers: &[],
        reason: CLOCKS,
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_stm32::wdg::IndependentWatchdog<T>::new"],
        callers: &[],
        reason: TIMEOUT,
    },
    Allowed {
        panic: DIVISION,
        functions: &["embassy_stm32::wdg::IndependentWatchdog<T>::new"],
        callers: &[],
        reason: TIMEOUT,
    },
    Allowed {
        panic: MESSAGE,
        functions: &["mps2_an386::executor::run"],
        callers: &[],
        reason: "start-up: the executor is made once",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_embedded_hal::flash::partition::asynch::Partition<M,T>::new"],
        callers: &[],
        reason: "start-up: the ranges of the flash are constants of the board",
    },
    Allowed {
        panic: SLICE,
        functions: &[
            "semihosting::sys::arm_compat::sys_get_cmdline_uninit",
            "semihosting::sys::env::next_from_cmdline",
        ],
        callers: &[],
        reason: "start-up: the emulator's arguments",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embedded_io_async::Write::write_all"],
        callers: &[],
        reason: WRITE,
    },
    Allowed {
        panic: SLICE,
        functions: &["embedded_io_async::Write::write_all"],
        callers: &[],
        reason: WRITE,
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "<embassy_sync::channel::SendFuture<M,T,_> as core::future::future::Future>::poll",
        ],
        callers: &[],
        reason: "nobody polls a future that has ended",
    },
    // One branch for several of the above and below, of which the compiler kept no place.
    Allowed {
        panic: MESSAGE,
        functions: &["node_firmware::run::drive::RoleDriver<R>::poll_devices"],
        callers: &[],
        reason: "nobody polls a future that has ended, nor sends twice what was sent",
    },
    Allowed {
        panic: BORROWED,
        functions: &["zigbee_link::runner::"],
        callers: &[],
        reason: NODE,
    },
    Allowed {
        panic: BORROWED_MUTABLY,
        functions: &["zigbee_link::runner::"],
        callers: &[],
        reason: NODE,
    },
    Allowed {
        panic: BORROWED,
        functions: &[
            "embassy_sync::mutex::Mutex<M,T>::lock",
            "embassy_sync::pipe::Pipe<M,_>::",
        ],
        callers: &[],
        reason: BORROWED_ONCE,
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_sync::channel::Channel<M,T,_>::lock"],
        callers: &[],
        reason: BORROWED_ONCE,
    },
    Allowed {
        panic: MESSAGE,
        functions: &["<embassy_sync::mutex::MutexGuard<M,T> as core::ops::drop::Drop>::drop"],
        callers: &[],
        reason: "a guard exists only while it is locked",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_sync::ring_buffer::RingBuffer<_>::wrap"],
        callers: &[],
        reason: RING,
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_executor::raw::waker::task_from_waker"],
        callers: &[],
        reason: "time is awaited by tasks of the executor only, whose wakers these are",
    },
    Allowed {
        panic: "core::option::expect_failed",
        functions: &["<heapless::vec::VecInner<T,LenT,heapless::vec::storage::VecStorageInner<"],
        callers: &["node_firmware::role::camera::", "node_firmware::vision::"],
        reason: "lists are collected from lists of the same capacity",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["heapless::vec::VecInner<T,LenT,S>::remove"],
        callers: &["node_firmware::role::camera::stops::"],
        reason: "the place was found in the same list, or is the first of a full one",
    },
    Allowed {
        panic: DIVISION,
        functions: &["cmucam2_driver::geometry::DownSampling::apply"],
        callers: &[],
        reason: "a factor of zero is refused where it is made",
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "defmt_rtt::RttEncoder::",
            "defmt_semihosting::SemihostingEncoder::",
        ],
        callers: &[],
        reason: LOGGER,
    },
    Allowed {
        panic: BORROWED,
        functions: &[
            "embassy_nrf::time_driver::RtcDriver::trigger_alarm",
            "<embassy_nrf::time_driver::RtcDriver as embassy_time_driver::Driver>::schedule_wake",
            "embassy_stm32::time_driver::driver::RtcDriver::trigger_alarm",
            "<embassy_stm32::time_driver::driver::RtcDriver as embassy_time_driver::Driver>::schedule_wake",
        ],
        callers: &[],
        reason: "borrowed within a critical section, by code that does not come back",
    },
    Allowed {
        panic: TEXT,
        functions: &[
            "core::ptr::drop_in_place<embassy_nrf::buffered_uarte::_version::BufferedUarteRx>",
            "embassy_nrf::buffered_uarte::_version::BufferedUarteRx::fill_buf",
            "<embassy_nrf::buffered_uarte::_version::InterruptHandler<U> as",
        ],
        callers: &[],
        reason: "positions in rings and numbers of channels, which the library makes itself",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_nrf::gpiote::handle_gpiote_interrupt"],
        callers: &[],
        reason: "numbers of ports and pins, which the library makes itself",
    },
    Allowed {
        panic: BOUNDS,
        functions: &[
            "embassy_nrf::gpiote::handle_gpiote_interrupt",
            "<embassy_nrf::gpiote::PortInputFuture as core::future::future::Future>::poll",
        ],
        callers: &[],
        reason: "numbers of ports and pins, which the library makes itself",
    },
    Allowed {
        panic: LENGTHS,
        functions: &[
            "embassy_sync::pipe::Pipe<M,_>::try_read_with_context",
            "embassy_sync::pipe::Pipe<M,_>::try_write_with_context",
        ],
        callers: &[],
        reason: RING,
    },
    Allowed {
        panic: SLICE,
        functions: &[
            "embassy_sync::pipe::Pipe<M,_>::try_read_with_context",
            "embassy_sync::pipe::Pipe<M,_>::try_write_with_context",
        ],
        callers: &[],
        reason: RING,
    },
    Allowed {
        panic: TEXT,
        functions: &["stm32_metapac::exti::regs::Lines::set_line"],
        callers: &[],
        reason: "numbers of ports and pins, which the library makes itself",
    },
    Allowed {
        panic: BOUNDS,
        functions: &[
            "embassy_stm32::exti::on_irq",
            "<embassy_stm32::exti::ExtiInputFuture as core::future::future::Future>::poll",
        ],
        callers: &[],
        reason: "numbers of ports and pins, which the library makes itself",
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_stm32::rcc::RccInfo::disable_with_cs",
            "embassy_stm32::rcc::RccInfo::enable_and_reset_with_cs",
        ],
        callers: &[],
        reason: "numbers of peripherals, which the library makes itself",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_stm32::i2c::_version::Timings::new"],
        callers: &[],
        reason: I2C,
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_stm32::i2c::_version::Timings::new",
            "embassy_stm32::i2c::I2c<M,embassy_stm32::i2c::mode::Master>::new_inner",
        ],
        callers: &[],
        reason: I2C,
    },
    Allowed {
        panic: DIVISION,
        functions: &["embassy_stm32::i2c::_version::Timings::new"],
        callers: &[],
        reason: I2C,
    },
    Allowed {
        panic: SLICE,
        functions: &[
            "embassy_stm32::i2c::_version::<impl embassy_stm32::i2c::I2c<M,IM>>::blocking_transaction",
        ],
        callers: &[],
        reason: "groups of operations end where the list does",
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_stm32::flash::common::get_sector",
            "embassy_stm32::flash::common::write_chunk_unlocked",
        ],
        callers: &[],
        reason: PAGES,
    },
    Allowed {
        panic: DIVISION,
        functions: &["embassy_stm32::flash::common::get_sector"],
        callers: &[],
        reason: "the sizes of banks and pages are constants of the library",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_nrf::timer::Timer::cc"],
        callers: &[],
        reason: "constant numbers of registers",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_nrf::radio::ieee802154::Radio::disable"],
        callers: &[],
        reason: "states of the radio are those of the manual",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_nrf::radio::ieee802154::Radio::set_channel"],
        callers: &[],
        reason: "`zigbee_link::radio::Channel` is 11 to 26",
    },
    Allowed {
        panic: MESSAGE,
        functions: &["embassy_nrf::radio::ieee802154::Radio::set_transmission_power"],
        callers: &[],
        reason: "powers are chosen from the list of those that the chip has",
    },
    Allowed {
        panic: LENGTHS,
        functions: &["embassy_nrf::twim::Twim::set_tx_buffer"],
        callers: &[],
        reason: "the copy is cut to the length of what is copied, and what is longer is an error before",
    },
    Allowed {
        panic: MESSAGE,
        functions: &[
            "embassy_nrf::twim::Twim::setup_operations",
            "embassy_nrf::twim::Twim::transaction",
        ],
        callers: &[],
        reason: "`node_firmware::steps` asks for one write, or a write and a read",
    },
    Allowed {
        panic: TEXT,
        functions: &["embassy_nrf::twim::Twim::check_operations"],
        callers: &[],
        reason: "`node_firmware::steps` asks for one write, or a write and a read",
    },
    Allowed {
        panic: SLICE,
        functions: &["semihosting::io::Write::write_all"],
        callers: &[],
        reason: "the emulator writes no more than it was given",
    },
    Allowed {
        panic: TEXT,
        functions: &["semihosting::fd::BorrowedFd::borrow_raw"],
        callers: &[],
        reason: "the emulator hands out no such file",
    },
    Allowed {
        panic: TEXT,
        functions: &["postcard::ser::serialize_with_flavor"],
        callers: &["board_support::panel::frame"],
        reason: "every message of the panel fits its buffer",
    },
    Allowed {
        panic: BOUNDS,
        functions: &["cobs::dec::decode_in_place_report"],
        callers: &[],
        reason: COBS,
    },
    Allowed {
        panic: LENGTHS,
        functions: &[
            "<&mut postcard::de::deserializer::Deserializer<F> as serde_core::de::Deserializer>::deserialize_f32",
        ],
        callers: &[],
        reason: "it asked for four bytes",
    },
    Allowed {
        panic: LENGTHS,
        functions: &[
            "<embassy_nrf::nvmc::Nvmc as embedded_storage::nor_flash::ReadNorFlash>::read",
            "embassy_stm32::flash::common::blocking_read",
        ],
        callers: &[],
        reason: "it takes as many bytes as it was asked for",
    },
    Allowed {
        panic: LENGTHS,
        functions: &[
            "embassy_nrf::buffered_uarte::_version::BufferedUarteRx::read",
            "embassy_nrf::buffered_uarte::_version::BufferedUarteTx::write",
        ],
        callers: &[],
        reason: "both sides are as long as the shorter of them",
    },
    Allowed {
        panic: SLICE,
        functions: &[
            "embassy_nrf::buffered_uarte::_version::BufferedUarteRx::read",
            "embassy_nrf::buffered_uarte::_version::BufferedUarteTx::write",
        ],
        callers: &[],
        reason: "both sides are as long as the shorter of them",
    },
    Allowed {
        panic: LENGTHS,
        functions: &["embassy_nrf::radio::ieee802154::Packet::copy_from_slice"],
        callers: &[],
        reason: "both sides are as long as the frame",
    },
    Allowed {
        panic: SLICE,
        functions: &["postcard::varint::varint_u"],
        callers: &[],
        reason: "the buffer is as long as the longest number",
    },
    Allowed {
        panic: SLICE,
        functions: &["postcard::de::from_bytes_cobs"],
        callers: &[],
        reason: COBS,
    },
];

/// Why a branch is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Grant {
    pub(super) reason: &'static str,
    /// Which entry, and which of its functions.
    entry: (usize, usize),
}

/// The reason, if there is one: for the name of the panic, and the functions that lead there by
/// being inlined or called, innermost first.
pub(super) fn grant(panic: &str, place: &[String]) -> Option<Grant> {
    ALLOWED.iter().enumerate().find_map(|(entry, allowed)| {
        let begins =
            |name: &str, starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
        let is_known = |name: &String| begins(name, allowed.callers);
        if allowed.panic != panic || !(allowed.callers.is_empty() || place.iter().any(is_known)) {
            return None;
        }
        let mut functions = allowed.functions.iter();
        let there = innermost(place);
        let function = functions.position(|start| there.iter().any(|name| name.starts_with(start)));
        let function = function.or(allowed.functions.is_empty().then_some(0))?;
        Some(Grant {
            reason: allowed.reason,
            entry: (entry, function),
        })
    })
}

/// The functions that an entry can speak of: those of libraries up to the first function of this
/// project, and that one too where only the language's own library stands between. Who calls
/// these has its own reasons.
fn innermost(place: &[String]) -> &[String] {
    let is_of_language = |name: &String| {
        ["core::", "<core::", "<u8>::"]
            .iter()
            .any(|start| name.starts_with(start))
    };
    let libraries = place.iter().take_while(|name| !is_ours(name)).count();
    let language = place.iter().take_while(|name| is_of_language(name)).count();
    let end = if language == libraries {
        libraries + 1
    } else {
        libraries
    };
    place.get(..end).unwrap_or(place)
}

/// What is allowed and does not occur.
pub(super) fn unused(grants: &BTreeSet<Grant>) -> Vec<String> {
    let used: BTreeSet<_> = grants.iter().map(|grant| grant.entry).collect();
    let mut unused = Vec::new();
    for (entry, allowed) in ALLOWED.iter().enumerate() {
        for place in 0..allowed.functions.len().max(1) {
            if !used.contains(&(entry, place)) {
                let function = allowed.functions.get(place).unwrap_or(&"any function");
                unused.push(format!("{} in {function}", allowed.panic));
            }
        }
    }
    unused
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(name: &str) -> [String; 2] {
        [
            "core::cell::RefCell<T>::borrow_mut".to_owned(),
            format!("{name} (src/a.rs:1)"),
        ]
    }

    #[test]
    fn only_the_panic_and_the_function_that_were_looked_at() {
        let known = place("zigbee_link::runner::run::{{closure}}");
        let grant_of = |panic, place: &[String]| grant(panic, place).map(|grant| grant.reason);
        assert_eq!(grant_of(BORROWED, &known), Some(NODE));
        assert_eq!(grant_of(SLICE, &known), None);
        assert_eq!(
            grant_of(BORROWED, &place("other::zigbee_link::runner::run")),
            None
        );
    }

    #[test]
    fn not_for_what_is_called_from_there() {
        let mut list = place("heapless::vec::VecInner<T,LenT,S>::push").to_vec();
        list.push("zigbee_link::runner::run (src/a.rs:1)".to_owned());
        assert_eq!(grant(BORROWED, &list), None);
    }

    #[test]
    fn only_for_callers_that_were_looked_at() {
        let mut list = place("heapless::vec::VecInner<T,LenT,S>::remove").to_vec();
        let entry = ALLOWED
            .iter()
            .find(|allowed| !allowed.callers.is_empty() && allowed.panic == MESSAGE);
        let known = entry.unwrap().callers[0];
        list.push("node_firmware::new".to_owned());
        assert!(grant(MESSAGE, &list).is_none());
        list.push(known.to_owned());
        assert!(grant(MESSAGE, &list).is_some());
    }

    #[test]
    fn what_does_not_occur_is_named() {
        let all = unused(&BTreeSet::new());
        let granted = grant(BORROWED, &place("zigbee_link::runner::run")).unwrap();
        let others = unused(&[granted].into());
        assert_eq!(others.len(), all.len() - 1);
        let gone = format!("{BORROWED} in zigbee_link::runner::");
        assert!(all.contains(&gone) && !others.contains(&gone));
    }
}
