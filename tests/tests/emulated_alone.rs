//! The emulated board by itself, on its own clock and with its own tasks, and with no host at all: whatever is done to
//! its reset button, its relays never close. Its LEDs are read through QEMU's monitor, not from its own words.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::link::{LinkError, emulator_firmware};
use nearfield_shared::causes::StopCause;
use nearfield_shared::status::{Channels, STATUS_LENGTH, StateCode, Status};
use nearfield_shared::units::Micros;
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::stage::Stage;
use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::FileExt as _;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// Offsets in the memory that the board shares, see the binary's `shared_memory`.
const STATUS: u64 = 0x1000;
const STORED_RIG: u64 = 0x2000;
const INPUTS: u64 = 0x2100;
const MEMORY_LENGTH: u64 = 16 << 20;

/// A board in QEMU; killed when dropped.
struct Board {
    child: Child,
    memory: File,
    monitor: BufReader<UnixStream>,
    _directory: TempDir,
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Board {
    fn start(rig: &[u8]) -> Result<Self, LinkError> {
        let elf = emulator_firmware()?;
        let directory = TempDir::new().unwrap();
        let path = directory.path().join("memory");
        let memory = OpenOptions::new().read(true).write(true).create_new(true).open(path).unwrap();
        memory.set_len(MEMORY_LENGTH).unwrap();
        memory.write_all_at(rig, STORED_RIG).unwrap();
        let child = Command::new("qemu-system-arm")
            .current_dir(directory.path())
            .args(["-machine", "mps2-an386,memory-backend=shared"])
            .args(["-object", "memory-backend-file,id=shared,size=16M,mem-path=memory,share=on"])
            .args(["-display", "none", "-monitor", "none", "-serial", "null"])
            // Emulated time runs as fast as this machine can: nothing here depends on how fast that is.
            .args(["-icount", "shift=5,sleep=off", "-qmp", "unix:monitor,server=on,wait=off"])
            .args(["-semihosting-config", "enable=on,target=native,arg=firmware,arg=shared-memory"])
            .arg("-kernel")
            .arg(elf)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .map_err(|source| LinkError::NoEmulator { program: "qemu-system-arm", source })?;
        let socket = directory.path().join("monitor");
        let stream = (0..1000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(10));
            UnixStream::connect(&socket).ok()
        });
        let monitor = BufReader::new(stream.expect("QEMU's monitor"));
        let mut board = Self { child, memory, monitor, _directory: directory };
        board.order(r#"{"execute": "qmp_capabilities"}"#);
        Ok(board)
    }

    fn order(&mut self, order: &str) -> serde_json::Value {
        writeln!(self.monitor.get_mut(), "{order}").unwrap();
        loop {
            let mut line = String::new();
            assert!(self.monitor.read_line(&mut line).unwrap() > 0, "QEMU has ended");
            let answer: serde_json::Value = serde_json::from_str(&line).unwrap();
            if let Some(value) = answer.get("return") {
                return value.clone();
            }
        }
    }

    /// The LED register, by QEMU's monitor.
    fn leds(&mut self) -> u32 {
        let order =
            r#"{"execute": "human-monitor-command", "arguments": {"command-line": "xp /1wx 0x40028000"}}"#;
        let answer = self.order(order);
        let word = answer.as_str().and_then(|text| text.split("0x").nth(1)).map(str::trim);
        u32::from_str_radix(word.expect("a word"), 16).unwrap()
    }

    /// The board's last status; `None` before the first one, or while it is being written.
    fn status(&self) -> Option<Status> {
        let mut bytes = [0; STATUS_LENGTH];
        self.memory.read_exact_at(&mut bytes, STATUS).unwrap();
        Status::parse(&bytes).ok()
    }
}

#[test]
fn without_a_host_the_relays_never_close() {
    let stage = Stage::new();
    let mut board = match Board::start(&stage.rig.to_bytes()) {
        Ok(board) => board,
        Err(error) => return without_emulator(&error),
    };
    let mut looks = 0_u32;
    let last = loop {
        assert_eq!(board.leds(), 0);
        looks += 1;
        // The button, pressed and released at the pace of the looks.
        board.memory.write_all_at(&[u8::from(looks.is_multiple_of(3))], INPUTS).unwrap();
        let Some(status) = board.status() else { continue };
        assert_eq!(status.relay_command, Channels::OPEN);
        assert_eq!(status.relay_readback, Channels::OPEN);
        if status.now > Micros::from_millis(20_000) {
            break status;
        }
    };
    assert_eq!(last.state, StateCode::Stopped);
    assert!(last.live_causes.contains(StopCause::LinkTimeout));
    assert_eq!(last.calibration, Some(stage.rig.calibration_id()), "it is not for want of a calibration");
    assert_eq!(last.accepted, 0);
}
