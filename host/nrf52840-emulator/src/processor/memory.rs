//! Memory that is in two places at once: where a chip's bus reads and writes it, and where the code that
//! a processor has translated looks for it.

use std::{io, os::fd::OwnedFd, ptr};

use rustix::{
    fs::ftruncate,
    io::pwrite,
    mm::{MapFlags, ProtFlags, mmap, mmap_anonymous, munmap},
    param::page_size,
};

/// Size to which the begins and ends of regions are aligned: the largest page of a processor that `rigless` has.
const PAGE: usize = 4096;

const READ_WRITE: ProtFlags = ProtFlags::READ.union(ProtFlags::WRITE);

/// A file without a name, which is nowhere but in memory.
#[cfg(target_os = "linux")]
fn file() -> io::Result<OwnedFd> {
    use rustix::fs::{MemfdFlags, memfd_create};

    Ok(memfd_create("nrf52840", MemfdFlags::CLOEXEC)?)
}

#[cfg(not(target_os = "linux"))]
fn file() -> io::Result<OwnedFd> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Place of some bytes of the guest, in an order of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Region {
    pub(super) start: u64,
    pub(super) length: u64,
    pub(super) is_writable: bool,
}

/// The regions of a chip, one after the other.
#[derive(Debug)]
pub(super) struct Memory {
    file: OwnedFd,
    regions: Vec<Region>,
    /// Places of the regions on the chip's bus.
    places: Vec<*mut u8>,
    length: usize,
}

// SAFETY: the places are only handed back to the system, which does not care for threads.
unsafe impl Send for Memory {}

impl Memory {
    /// # Errors
    /// The system's, or its pages are larger than those of the processor.
    pub(super) fn new() -> io::Result<Self> {
        if page_size() > PAGE {
            return Err(io::ErrorKind::Unsupported.into());
        }
        Ok(Self {
            file: file()?,
            regions: Vec::new(),
            places: Vec::new(),
            length: 0,
        })
    }

    pub(super) fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// Puts the bytes at a place behind those of the regions before: they stay there, and can be
    /// [shown](Window::show) as well.
    ///
    /// # Errors
    /// The system's, or they are not whole pages.
    ///
    /// # Safety
    /// The bytes at `place` are the caller's for as long as this lives.
    pub(super) unsafe fn push(&mut self, region: Region, place: *mut u8) -> io::Result<()> {
        let length = region.length as usize;
        if !length.is_multiple_of(PAGE) || !place.addr().is_multiple_of(PAGE) {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        let offset = self.length as u64;
        ftruncate(&self.file, offset + region.length)?;
        // SAFETY: the caller's promise; nothing writes to them while this looks.
        let bytes = unsafe { std::slice::from_raw_parts(place, length) };
        let mut written = 0;
        while written < length {
            written += pwrite(&self.file, &bytes[written..], offset + written as u64)?;
        }
        // SAFETY: the same bytes come to the same place, which is the caller's.
        unsafe {
            let flags = MapFlags::SHARED | MapFlags::FIXED;
            mmap(place.cast(), length, READ_WRITE, flags, &self.file, offset)?;
        }
        self.regions.push(region);
        self.places.push(place);
        self.length += length;
        Ok(())
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        for (region, place) in self.regions.iter().zip(&self.places) {
            // SAFETY: the place is its owner's, who has no use for the bytes any more, but for the place. Where
            // this fails the shared bytes stay, and are shared with no other.
            let _ = unsafe {
                let flags = MapFlags::PRIVATE | MapFlags::FIXED;
                mmap_anonymous(place.cast(), region.length as usize, READ_WRITE, flags)
            };
        }
    }
}

/// Addresses where a processor's code looks for the memory of the chip that it is.
#[derive(Debug)]
pub(super) struct Window {
    start: *mut u8,
    length: usize,
}

// SAFETY: addresses of its own memory.
unsafe impl Send for Window {}

impl Window {
    /// One for memory like this.
    pub(super) fn new(memory: &Memory) -> io::Result<Self> {
        let length = memory.length;
        // SAFETY: wherever there is room.
        let start =
            unsafe { mmap_anonymous(ptr::null_mut(), length, READ_WRITE, MapFlags::PRIVATE)? };
        Ok(Self {
            start: start.cast(),
            length,
        })
    }

    /// The regions of this memory, and the addresses where they are seen.
    pub(super) fn places(&self, memory: &Memory) -> Vec<(Region, *mut u8)> {
        let mut at = self.start;
        let place = |region: &Region| {
            let place = at;
            at = at.wrapping_add(region.length as usize);
            (*region, place)
        };
        memory.regions.iter().map(place).collect()
    }

    /// From now on this memory is seen here.
    ///
    /// # Errors
    /// The system's, or it is not like the memory that this was made for.
    pub(super) fn show(&mut self, memory: &Memory) -> io::Result<()> {
        if memory.length != self.length {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        // SAFETY: its own addresses; nothing but translated code looks there, and none runs. Where this fails
        // there may be a hole, where nothing looks any more: the caller drops the processor.
        let shown = unsafe {
            let flags = MapFlags::SHARED | MapFlags::FIXED;
            mmap(
                self.start.cast(),
                self.length,
                READ_WRITE,
                flags,
                &memory.file,
                0,
            )
        };
        // Memory in a hole by then is not its own: nothing is handed back.
        shown.inspect_err(|_| self.length = 0)?;
        Ok(())
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        if self.length == 0 {
            return;
        }
        // SAFETY: its own addresses, and the processor that looked there has been dropped.
        let _ = unsafe { munmap(self.start.cast(), self.length) };
    }
}

#[cfg(test)]
mod tests {
    use std::alloc::{Layout, alloc_zeroed, dealloc};

    use super::*;

    /// Two chips and a window that shows either: what one side writes the other reads, and nothing crosses.
    #[test]
    fn a_window_shows_the_memory_of_one_chip_at_a_time() {
        let length = 2 * PAGE;
        let layout = Layout::from_size_align(length, PAGE).unwrap();
        // SAFETY: the length is not 0.
        let places = [1_u8, 2].map(|first| unsafe {
            let place = alloc_zeroed(layout);
            *place = first;
            place
        });
        let mut memories = places.map(|place| {
            let mut memory = Memory::new().unwrap();
            let region = Region {
                start: 0,
                length: length as u64,
                is_writable: true,
            };
            // SAFETY: `places` outlives it.
            unsafe { memory.push(region, place).unwrap() };
            memory
        });
        let mut window = Window::new(&memories[0]).unwrap();
        let seen = window.places(&memories[0])[0].1;
        // SAFETY: all of this is allocated here, and one thread uses it.
        unsafe {
            for (place, memory) in places.iter().zip(&memories) {
                window.show(memory).unwrap();
                assert_eq!(*seen, **place);
                *seen.add(length - 1) = **place + 10;
                *place.add(1) = **place + 20;
                assert_eq!(*seen.add(1), **place + 20);
            }
            assert_eq!(*places[0].add(length - 1), 11);
            assert_eq!(*places[1].add(length - 1), 12);
            let other = Region {
                start: 0,
                length: 1,
                is_writable: true,
            };
            assert!(memories[0].push(other, places[0]).is_err());
            drop(memories);
            for place in places {
                *place = 3;
                dealloc(place, layout);
            }
        }
    }
}
