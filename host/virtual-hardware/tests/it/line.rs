//! UARTs between two programs.

use std::{cell::RefCell, rc::Rc};

use embedded_io_async::{Read, Write};

use virtual_hardware::{
    executor::{Ended, Executor, Time},
    line::{Line, Side, Uart},
};

use crate::support::SECOND;

/// By hand: at 9600 baud a bit is 104,166 ns and a byte ten of them.
#[test]
fn byte_times_of_a_console() {
    const BYTE: Time = 1_041_660;
    let mut executor = Executor::new();
    let clock = executor.clock();
    let line = Line::between_ports(&clock, Uart::new(9600), Uart::new(9600));
    let (mut node, mut far) = (line.open(Side::Node), line.open(Side::Far));
    let log = Rc::new(RefCell::new(Vec::new()));
    let writer = clock.clone();
    executor.spawn(async move {
        node.write_all(b"abc").await.unwrap();
        assert_eq!(writer.time(), 0);
        node.flush().await.unwrap();
        assert_eq!(writer.time(), 3 * BYTE);
        // 64 fit the buffer of the UART, 32 more when half of them have gone, and the last 4 after
        // another 32.
        node.write_all(&[b'x'; 100]).await.unwrap();
        assert_eq!(writer.time(), (3 + 32 + 32) * BYTE);
        let mut answer = [0; 8];
        assert_eq!(node.read(&mut answer).await, Ok(2));
        assert_eq!(&answer[..2], b"ok");
        // A port that is dropped sends no more.
        node.flush().await.unwrap();
    });
    let list = log.clone();
    executor.spawn(async move {
        let mut bytes = [0; 50];
        loop {
            let count = far.read(&mut bytes).await.unwrap();
            list.borrow_mut().push((clock.time(), count));
            if count == 3 {
                far.write_all(b"ok").await.unwrap();
            }
        }
    });
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    let log = log.borrow();
    assert_eq!(log[0], (3 * BYTE, 3));
    assert_eq!(log.iter().map(|(_, count)| count).sum::<usize>(), 103);
    for &(at, _) in &*log {
        assert_eq!(at % BYTE, 0);
    }
    assert_eq!(log.last().unwrap().0, 103 * BYTE);
    assert!(log.len() <= 7, "{log:?}");
}

/// A buffer of four bytes that is not read keeps the first four.
#[test]
fn overrun() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let small = Uart {
        receive_buffer: 4,
        ..Uart::new(115_200)
    };
    let line = Line::between_ports(&clock, small, Uart::new(115_200));
    let (mut node, mut far) = (line.open(Side::Node), line.open(Side::Far));
    executor.spawn(async move {
        far.write_all(b"0123456789").await.unwrap();
        far.flush().await.unwrap();
        assert_eq!(node.received(), b"0123");
        far.write_all(b"abc").await.unwrap();
        far.flush().await.unwrap();
        assert_eq!(node.received(), b"abc");
    });
    assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
    let counts = line.counts(Side::Node);
    assert_eq!((counts.received, counts.overrun), (13, 6));
}
