//! The few semihosting calls that are used: files (FIFOs), words to the emulator's user, the command line, the end.

use core::hint::black_box;
use core::ptr::read_volatile;
use cortex_m_semihosting::{debug, hio, nr, syscall};

/// Calls the emulator with a block of arguments.
fn call(number: usize, arguments: [usize; 3]) -> usize {
    let block = black_box(arguments);
    // SAFETY: the callers pass addresses and lengths of live buffers, in the order that the call's number requires.
    unsafe { syscall(number, &block) }
}

/// A file of the emulator's working directory.
pub(crate) struct File(usize);

/// What a file is opened for; the numbers are semihosting's.
#[derive(Clone, Copy)]
pub(crate) enum Access {
    Read = 1,
    Write = 5,
}

impl File {
    /// `path` must end with a zero byte.
    pub(crate) fn open(path: &'static core::ffi::CStr, access: Access) -> Option<Self> {
        let handle = call(nr::OPEN, [path.as_ptr() as usize, access as usize, path.count_bytes()]);
        (handle != usize::MAX).then_some(Self(handle))
    }

    /// Fills `bytes`; `false` at the end of the file. The emulated processor stands still while it waits.
    pub(crate) fn read_exact(&mut self, bytes: &mut [u8]) -> bool {
        let mut rest = bytes;
        while !rest.is_empty() {
            let wanted = rest.len();
            let missing = call(nr::READ, [self.0, rest.as_mut_ptr() as usize, wanted]);
            // The emulator has written into the buffer behind the compiler's back.
            black_box(&mut *rest);
            match wanted.checked_sub(missing) {
                Some(got) if got > 0 => rest = rest.get_mut(got..).unwrap_or_default(),
                _ => return false,
            }
        }
        true
    }

    /// Writes all of `bytes`; `false` if the emulator cannot.
    pub(crate) fn write_all(&mut self, bytes: &[u8]) -> bool {
        call(nr::WRITE, [self.0, bytes.as_ptr() as usize, bytes.len()]) == 0
    }
}

/// Prints on the emulator's standard output.
pub(crate) fn print(text: &str) {
    if let Ok(mut output) = hio::hstdout() {
        let _ = output.write_all(text.as_bytes());
    }
}

/// The command line's last word.
pub(crate) fn last_word(buffer: &mut [u8; 96]) -> &str {
    let block = [buffer.as_mut_ptr() as usize, buffer.len()];
    // SAFETY: the block names a live buffer and its length, as GET_CMDLINE requires.
    let failed = unsafe { syscall(nr::GET_CMDLINE, black_box(&block)) } != 0;
    // SAFETY: an element of a live array, which the emulator has written behind the compiler's back.
    let length = unsafe { read_volatile(&raw const block[1]) };
    black_box(&mut *buffer);
    if failed {
        return "";
    }
    let line = buffer.get(..length).and_then(|bytes| core::str::from_utf8(bytes).ok()).unwrap_or("");
    line.split_ascii_whitespace().next_back().unwrap_or("")
}

/// Ends the emulator.
pub(crate) fn exit() {
    debug::exit(debug::EXIT_SUCCESS);
}
