//! Builds the firmware and seals its images: the length and the CRC of what is flashed are written into the place that
//! memory.x reserves behind the vectors. A firmware that was built without this chore is unsealed, fails its own
//! self-test and never closes its relays.

use crate::run::{self, FIRMWARE_PROFILE, FIRMWARE_TARGET, Step};
use anyhow::{Context as _, Result, bail};
use nearfield_firmware::selftest::program::{ImageSeal, SEAL_BYTES};
use object::read::elf::{FileHeader as _, ProgramHeader as _};
use object::{Endianness, Object as _, ObjectSection as _, elf};
use std::path::Path;

/// The board's and the emulator's.
const BINARIES: [&str; 2] = ["stm32g474", "qemu_an386"];

/// Builds and seals both.
pub fn build() -> Result<()> {
    let arguments = ["build", "--package", "nearfield-firmware", "--bins", "--target", FIRMWARE_TARGET];
    Step::cargo(&[&arguments[..], &["--profile", FIRMWARE_PROFILE]].concat()).run()?;
    for name in BINARIES {
        let path = run::firmware_elf(name);
        let seal = seal_file(&path).with_context(|| format!("cannot seal {}", path.display()))?;
        eprintln!("sealed {name}: {} bytes, CRC {:#010x}", seal.length, seal.checksum);
    }
    Ok(())
}

/// Seals an ELF file in place; sealing again changes nothing.
fn seal_file(path: &Path) -> Result<ImageSeal> {
    let mut file = std::fs::read(path)?;
    let (seal, offset) = seal_of(&file)?;
    file.get_mut(offset..offset + SEAL_BYTES)
        .context("the seal's place lies outside the file")?
        .copy_from_slice(&seal.to_bytes());
    std::fs::write(path, file)?;
    Ok(seal)
}

/// The seal of an ELF file's image, and where in the file it belongs.
fn seal_of(file: &[u8]) -> Result<(ImageSeal, usize)> {
    let (start, image) = image_of(file)?;
    let parsed = object::File::parse(file)?;
    let section =
        parsed.section_by_name(".image_seal").context("it has no section .image_seal; see memory.x")?;
    let (offset, size) = section.file_range().context("its section .image_seal has no bytes")?;
    if size != SEAL_BYTES as u64 {
        bail!("its section .image_seal has {size} bytes instead of {SEAL_BYTES}");
    }
    let place = usize::try_from(section.address() - start)?;
    let before = image.get(..place).context("its seal lies outside the image")?;
    let after = image.get(place + SEAL_BYTES..).context("its seal lies outside the image")?;
    let seal = ImageSeal::of(before, after).context("it is longer than the flash")?;
    Ok((seal, usize::try_from(offset)?))
}

/// What is flashed: where it begins, and its bytes.
fn image_of(file: &[u8]) -> Result<(u64, Vec<u8>)> {
    let header = elf::FileHeader32::<Endianness>::parse(file)?;
    let endian = header.endian()?;
    let mut segments = Vec::new();
    for segment in header.program_headers(endian, file)? {
        if segment.p_type(endian) == elf::PT_LOAD && segment.p_filesz(endian) > 0 {
            let bytes = segment.data(endian, file).ok().context("a segment lies outside the file")?;
            segments.push((u64::from(segment.p_paddr(endian)), bytes));
        }
    }
    segments.sort_by_key(|(address, _)| *address);
    let start = segments.first().context("it has nothing to flash")?.0;
    let mut image = Vec::new();
    for (address, bytes) in segments {
        let end = start + image.len() as u64;
        if address != end {
            // A flashing tool fills gaps with whatever it likes, and no seal would hold.
            bail!("its image has a gap from {end:#x} to {address:#x}; memory.x must close it");
        }
        image.extend_from_slice(bytes);
    }
    Ok((start, image))
}
