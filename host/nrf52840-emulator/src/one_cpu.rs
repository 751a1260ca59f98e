//! A simulation and all its chips on one CPU of the computer.
//!
//! One of them runs at a time, for some microseconds, and then the next. Left alone, the system moves each to
//! the CPU that idles, which costs more than the chip takes. Other simulations run on other CPUs.

use std::{
    env,
    fs::File,
    sync::atomic::{AtomicUsize, Ordering},
};

static HELD: AtomicUsize = AtomicUsize::new(0);

/// The thread that has made this, and the threads that it starts, stay on one CPU while this
/// lives.
#[derive(Debug)]
pub(crate) struct OneCpu {
    /// CPUs of the thread before, if they are known.
    before: Option<system::Cpus>,
    /// Tells others that the CPU is taken, until it is closed.
    _lock: Option<File>,
}

impl OneCpu {
    /// One that no other simulation is on, if there is one. Where the system knows nothing of this, or refuses,
    /// all is slower and the same.
    pub(crate) fn take() -> Self {
        HELD.fetch_add(1, Ordering::Relaxed);
        let before = system::cpus();
        let cpus = before.as_ref().map(system::numbers).unwrap_or_default();
        let free = cpus.iter().find_map(|cpu| Some((*cpu, lock(*cpu)?)));
        // Where all are taken one is as good as the other.
        let any = cpus.get(std::process::id() as usize % cpus.len().max(1));
        if let Some(cpu) = free.as_ref().map(|(cpu, _)| cpu).or(any) {
            system::stay_on(*cpu);
        }
        Self {
            before,
            _lock: free.map(|(_, lock)| lock),
        }
    }

    /// Number of CPUs that this process has taken.
    pub(crate) fn held() -> usize {
        HELD.load(Ordering::Relaxed)
    }
}

impl Drop for OneCpu {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            system::go_back(before);
        }
        HELD.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Locks a CPU's file, unless it is locked.
fn lock(cpu: usize) -> Option<File> {
    let path = env::temp_dir().join(format!("nrf52840-emulator-cpu-{cpu}.lock"));
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(path)
        .ok()?;
    file.try_lock().ok()?;
    Some(file)
}

#[cfg(target_os = "linux")]
mod system {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

    pub(super) type Cpus = CpuSet;

    pub(super) fn cpus() -> Option<Cpus> {
        sched_getaffinity(None).ok()
    }

    pub(super) fn numbers(cpus: &Cpus) -> Vec<usize> {
        { 0..CpuSet::MAX_CPU }
            .filter(|cpu| cpus.is_set(*cpu))
            .collect()
    }

    pub(super) fn stay_on(cpu: usize) {
        let mut one = CpuSet::new();
        one.set(cpu);
        let _ = sched_setaffinity(None, &one);
    }

    pub(super) fn go_back(before: &Cpus) {
        let _ = sched_setaffinity(None, before);
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    pub(super) type Cpus = ();

    pub(super) fn cpus() -> Option<Cpus> {
        None
    }

    pub(super) fn numbers((): &Cpus) -> Vec<usize> {
        Vec::new()
    }

    pub(super) fn stay_on(_: usize) {}

    pub(super) fn go_back((): &Cpus) {}
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn who_takes_one_and_what_he_starts_are_on_one_cpu_until_he_drops_it() {
        let cpus = || system::numbers(&system::cpus().unwrap());
        let before = cpus();
        let one = OneCpu::take();
        // Other tests have some, too.
        assert!(OneCpu::held() > 0);
        let own = cpus();
        assert_eq!(own.len(), 1);
        assert!(before.contains(&own[0]));
        let started = std::thread::spawn(cpus).join().unwrap();
        assert_eq!(started, own);
        drop(one);
        assert_eq!(cpus(), before);
    }
}
