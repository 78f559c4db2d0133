//! A QEMU process: its start and its certain end, two FIFOs, its monitor's events and its LEDs.

use super::LinkError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{CWD, FileType, Mode, OFlags, mknodat};
use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

const QEMU: &str = "qemu-system-arm";
const ELF_BELOW_TARGET: &str = "thumbv7em-none-eabihf/firmware/qemu_an386";
/// The environment variable that names another firmware.
const ELF_VARIABLE: &str = "NEARFIELD_FIRMWARE_ELF";
/// Waiting goes in slices of this, between which the emulator is looked after.
const SLICE: Duration = Duration::from_millis(100);
/// A live emulator that says nothing for this many slices is stuck (a minute: filling the maps takes a second or two).
const SLICES: u32 = 600;

/// The relay coils as LEDs show them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Relays {
    pub(super) a: bool,
    pub(super) b: bool,
}

/// A running QEMU; killed and cleared away when dropped.
pub(super) struct Emulator {
    child: Child,
    requests: File,
    replies: File,
    monitor: BufReader<UnixStream>,
    directory: TempDir,
    trace_read: u64,
    relays: Relays,
}

impl Emulator {
    /// Starts the emulator's firmware in this mode.
    pub(super) fn launch(mode: &str) -> Result<Self, LinkError> {
        let elf = emulator_firmware()?;
        let directory = tempfile::Builder::new()
            .prefix("nearfield-")
            .tempdir()
            .map_err(|source| LinkError::System { action: "make a temporary directory", source })?;
        let requests = make_fifo(&directory.path().join("requests"))?;
        let replies = make_fifo(&directory.path().join("replies"))?;
        let mut child = spawn(&elf, mode, directory.path())?;
        let monitor = match connect(&mut child, directory.path()) {
            Ok(monitor) => monitor,
            Err(error) => {
                end(&mut child);
                return Err(error);
            }
        };
        let mut emulator =
            Self { child, requests, replies, monitor, directory, trace_read: 0, relays: Relays::default() };
        // The machine starts stopped: once it waits for a request, its monitor takes no orders any more and gives no
        // answers, not even to the order to continue. Events still come.
        emulator.order("qmp_capabilities")?;
        emulator.wait_for_monitor("qmp_capabilities", |message| message.get("return").is_some())?;
        emulator.order("cont")?;
        Ok(emulator)
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.requests
            .write_all(bytes)
            .map_err(|source| LinkError::System { action: "send to the emulator", source })
    }

    /// Fills `bytes`, or says that the emulator has ended or is stuck.
    pub(super) fn receive(&mut self, bytes: &mut [u8], waiting_for: &'static str) -> Result<(), LinkError> {
        let mut filled = 0;
        let mut slices = 0;
        while filled < bytes.len() {
            match self.replies.read(&mut bytes[filled..]) {
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    slices += 1;
                    if slices > SLICES || self.has_ended() {
                        return Err(self.silent(waiting_for));
                    }
                    wait_readable(&self.replies)?;
                }
                Err(source) => {
                    return Err(LinkError::System { action: "read from the emulator", source });
                }
            }
        }
        Ok(())
    }

    /// Waits until the monitor tells of this event.
    pub(super) fn wait_for_event(&mut self, event: &'static str) -> Result<(), LinkError> {
        self.wait_for_monitor(event, |message| message["event"] == event)
    }

    /// The relay coils, from QEMU's trace of the board's first two LEDs.
    pub(super) fn relays(&mut self) -> Result<Relays, LinkError> {
        let failed = |source| LinkError::System { action: "read the emulator's LED trace", source };
        let path = self.directory.path().join("leds");
        let length = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
        if length > self.trace_read {
            let text = std::fs::read_to_string(&path).map_err(failed)?;
            self.trace_read = length;
            for line in text.lines() {
                let lit = line.trim_end().ends_with("-> 100%");
                if line.contains("USERLED0") {
                    self.relays.a = lit;
                } else if line.contains("USERLED1") {
                    self.relays.b = lit;
                }
            }
        }
        Ok(self.relays)
    }

    /// Waits until both relays are seen open. QEMU lights its LEDs at a reset, though the register that they show is
    /// cleared; the firmware's first act puts them out.
    pub(super) fn wait_until_open(&mut self) -> Result<(), LinkError> {
        for _ in 0..SLICES {
            if self.relays()? == Relays::default() {
                return Ok(());
            }
            std::thread::sleep(SLICE / 20);
        }
        Err(self.silent("the relays to open after the reset"))
    }

    fn order(&mut self, command: &'static str) -> Result<(), LinkError> {
        writeln!(self.monitor.get_mut(), "{{\"execute\": \"{command}\"}}")
            .map_err(|source| LinkError::System { action: "command the emulator's monitor", source })
    }

    fn wait_for_monitor(
        &mut self,
        waiting_for: &'static str,
        wanted: impl Fn(&serde_json::Value) -> bool,
    ) -> Result<(), LinkError> {
        let mut line = String::new();
        let mut slices = 0;
        loop {
            match self.monitor.read_line(&mut line) {
                Ok(0) => return Err(self.silent(waiting_for)),
                Ok(_) => {
                    let message = serde_json::from_str(&line).unwrap_or_default();
                    if wanted(&message) {
                        return Ok(());
                    }
                    line.clear();
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    slices += 1;
                    if slices > SLICES || self.has_ended() {
                        return Err(self.silent(waiting_for));
                    }
                }
                Err(source) => {
                    return Err(LinkError::System { action: "read the emulator's monitor", source });
                }
            }
        }
    }

    fn has_ended(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    fn silent(&self, waiting_for: &'static str) -> LinkError {
        LinkError::Silent { waiting_for, said: words_of(self.directory.path()) }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

/// Kills and reaps; both fail only for a process that has ended already.
fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Where the emulator's firmware is: `$NEARFIELD_FIRMWARE_ELF`, or the build directory that this program lies in, or
/// `target` in the working directory.
///
/// # Errors
/// There is none; says where it was looked for.
pub fn emulator_firmware() -> Result<PathBuf, LinkError> {
    let missing = |path: PathBuf| LinkError::NoFirmware { path };
    if let Some(path) = std::env::var_os(ELF_VARIABLE).map(PathBuf::from) {
        return path.canonicalize().map_err(|_| missing(path));
    }
    let program = std::env::current_exe().unwrap_or_default();
    let beside = program.ancestors().skip(1).map(|directory| directory.join(ELF_BELOW_TARGET));
    let here = Path::new("target").join(ELF_BELOW_TARGET);
    beside.chain([here.clone()]).find_map(|path| path.canonicalize().ok()).ok_or_else(|| missing(here))
}

/// A FIFO that this process holds open for both ways, so that opening never waits for the other end. Reading from it
/// never blocks.
fn make_fifo(path: &Path) -> Result<File, LinkError> {
    let failed = |source| LinkError::System { action: "make a FIFO", source };
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).map_err(|error| failed(error.into()))?;
    let flags = i32::try_from(OFlags::NONBLOCK.bits()).unwrap_or_default();
    OpenOptions::new().read(true).write(true).custom_flags(flags).open(path).map_err(failed)
}

fn spawn(elf: &Path, mode: &str, directory: &Path) -> Result<Child, LinkError> {
    let errors = File::create(directory.join("errors"))
        .map_err(|source| LinkError::System { action: "make a log file", source })?;
    let output =
        errors.try_clone().map_err(|source| LinkError::System { action: "make a log file", source })?;
    Command::new(QEMU)
        .current_dir(directory)
        .args(["-machine", "mps2-an386", "-S", "-display", "none", "-monitor", "none", "-serial", "null"])
        // 32 ns of emulated time an instruction, and none while it waits: every run is the same.
        .args(["-icount", "shift=5,sleep=off"])
        .args(["-qmp", "unix:monitor,server=on,wait=off"])
        .args(["-trace", "led_change_intensity", "-D", "leds"])
        .arg("-semihosting-config")
        .arg(format!("enable=on,target=native,arg=firmware,arg={mode}"))
        .arg("-kernel")
        .arg(elf)
        .stdin(Stdio::null())
        .stdout(output)
        .stderr(errors)
        .spawn()
        .map_err(|source| LinkError::NoEmulator { program: QEMU, source })
}

fn connect(child: &mut Child, directory: &Path) -> Result<BufReader<UnixStream>, LinkError> {
    let path = directory.join("monitor");
    for _ in 0..SLICES {
        match UnixStream::connect(&path) {
            Ok(stream) => {
                stream
                    .set_read_timeout(Some(SLICE))
                    .map_err(|source| LinkError::System { action: "set up the monitor", source })?;
                return Ok(BufReader::new(stream));
            }
            Err(_) if matches!(child.try_wait(), Ok(None)) => std::thread::sleep(SLICE / 20),
            Err(_) => break,
        }
    }
    Err(LinkError::Silent { waiting_for: "the monitor's socket", said: words_of(directory) })
}

fn wait_readable(file: &File) -> Result<(), LinkError> {
    let slice = Timespec::try_from(SLICE).unwrap_or(Timespec { tv_sec: 0, tv_nsec: 0 });
    match poll(&mut [PollFd::new(file, PollFlags::IN)], Some(&slice)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(LinkError::System { action: "wait for the emulator", source: error.into() }),
    }
}

fn words_of(directory: &Path) -> String {
    let words = std::fs::read_to_string(directory.join("errors")).unwrap_or_default();
    if words.trim().is_empty() { "(nothing)".to_owned() } else { words.trim().to_owned() }
}
