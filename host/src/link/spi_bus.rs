//! The SPI bus of a Raspberry Pi: spidev, and the READY line by the GPIO chip's label. **Built, not run on hardware.**

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use gpiocdev::line::Value;
use gpiocdev::request::{Config, Request};
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};

use super::board::{Bus, Transaction};

/// spidev and the READY line.
pub struct SpiBus {
    device: Spidev,
    ready: Request,
    line: u32,
}

/// spidev refuses longer transfers than its buffer; the kernel's default is 4096 bytes.
const BUFFER_SIZE: &str = "/sys/module/spidev/parameters/bufsiz";

impl SpiBus {
    /// Mode 0, 8 bits, chip select by the kernel.
    ///
    /// # Errors
    /// The device, the GPIO chip or the line cannot be opened, or the kernel's buffer is too small; the text says what to do.
    pub fn open(device: &Path, hertz: u32, chip_label: &str, line: u32) -> io::Result<Self> {
        check_buffer(Path::new(BUFFER_SIZE), size_of::<Transaction>())?;
        let mut spi = Spidev::open(device).map_err(|error| {
            let help = "enable SPI (raspi-config) and put the user into the group `spi`";
            io::Error::new(error.kind(), format!("{}: {error}; {help}", device.display()))
        })?;
        let options =
            SpidevOptions::new().bits_per_word(8).max_speed_hz(hertz).mode(SpiModeFlags::SPI_MODE_0).build();
        spi.configure(&options)?;
        let chip = chip_named(chip_label)?;
        let mut config = Config::default();
        config.on_chip(&chip).with_line(line).as_input();
        let ready =
            Request::from_config(config).with_consumer("nearfield ready").request().map_err(|error| {
                io::Error::other(format!("READY, line {line} of {}: {error}", chip.display()))
            })?;
        Ok(Self { device: spi, ready, line })
    }

    fn is_ready(&self) -> io::Result<bool> {
        let value = self.ready.value(self.line).map_err(io::Error::other)?;
        Ok(value == Value::Active)
    }
}

impl Bus for SpiBus {
    fn wait_until_ready(&mut self, longest: Duration) -> io::Result<bool> {
        let begun = std::time::Instant::now();
        // The controller needs microseconds to milliseconds: polling is simpler than edges, which can be missed.
        while !self.is_ready()? {
            if begun.elapsed() >= longest {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_micros(100));
        }
        Ok(true)
    }

    fn transfer(&mut self, out: &Transaction, back: &mut Transaction) -> io::Result<()> {
        let mut transfer = SpidevTransfer::read_write(out, back);
        self.device.transfer(&mut transfer)
    }
}

fn check_buffer(path: &Path, needed: usize) -> io::Result<()> {
    // A kernel that does not tell has the default.
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(()) };
    match text.trim().parse::<usize>() {
        Ok(size) if size < needed => Err(io::Error::other(format!(
            "spidev's buffer has {size} bytes, a line-scan {needed}; add spidev.bufsiz=4096 to the kernel's command line"
        ))),
        _ => Ok(()),
    }
}

/// The chip with this label: numbers change from kernel to kernel.
fn chip_named(label: &str) -> io::Result<PathBuf> {
    let chips = gpiocdev::chip::chips().map_err(io::Error::other)?;
    let mut labels = Vec::new();
    for path in chips {
        let info = gpiocdev::Chip::from_path(&path).and_then(|chip| chip.info()).map_err(io::Error::other)?;
        if info.label == label {
            return Ok(path);
        }
        labels.push(info.label.clone());
    }
    let known = if labels.is_empty() { "none".to_owned() } else { labels.join(", ") };
    Err(io::Error::new(
        io::ErrorKind::NotFound,
        format!("no GPIO chip is labelled {label} (there are: {known})"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named_with_what_to_do() {
        let error =
            SpiBus::open(Path::new("/dev/no-such-spidev"), 16_000_000, "pinctrl-rp1", 25).err().unwrap();
        assert!(error.to_string().starts_with("/dev/no-such-spidev: "), "{error}");
        assert!(error.to_string().contains("raspi-config"), "{error}");
        let unknown = chip_named("no such chip").unwrap_err().to_string();
        assert!(unknown.contains("no GPIO chip is labelled no such chip"), "{unknown}");
    }

    #[test]
    fn a_buffer_that_is_too_small_is_found_before_the_first_transfer() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for (text, sound) in [("4096\n", true), ("3944", true), ("3943", false), ("nonsense", true)] {
            std::fs::write(file.path(), text).unwrap();
            let checked = check_buffer(file.path(), 3944);
            assert_eq!(checked.is_ok(), sound, "{text}");
            assert!(checked.err().is_none_or(|error| error.to_string().contains("spidev.bufsiz=4096")));
        }
        assert!(check_buffer(Path::new("/no/such/file"), 3944).is_ok());
    }
}
