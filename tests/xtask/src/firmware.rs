//! Builds the firmware and seals its images: the length and the CRC of what is flashed are written into the place that
//! memory.x reserves behind the vectors. A firmware that was built without this chore is unsealed, fails its own
//! self-test and never closes its relays.

use crate::run::{self, FIRMWARE_PROFILE, FIRMWARE_TARGET, Step};
use crate::setup;
use anyhow::{Context as _, Result, bail};
use nearfield_firmware::selftest::program::{ImageSeal, SEAL_BYTES};
use object::read::elf::{FileHeader as _, ProgramHeader as _};
use object::{Endianness, Object as _, ObjectSection as _, elf};
use std::path::Path;

/// The board's and the emulator's.
const BINARIES: [&str; 2] = ["stm32g474", "qemu_an386"];

/// Builds and seals both, where the target may not be there yet.
pub fn set_up_and_build() -> Result<()> {
    setup::firmware_target()?;
    build()
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_firmware::selftest::program::{ProgramCheck, Progress};

    const ORIGIN: u32 = 0x0800_0000;
    /// Bytes of the vectors, before the seal.
    const VECTORS: u32 = 64;

    /// A small ELF file: vectors and seal in one segment, code in another one that begins at this offset from the
    /// flash's beginning. Sections: none, `.image_seal`, names.
    fn elf_file(code_at: u32) -> Vec<u8> {
        const NAMES: &[u8] = b"\0.image_seal\0.shstrtab\0\0";
        let (header, segments, sections) = (52_u32, 2_u32, 3_u32);
        let data = header + 32 * segments;
        let seal = SEAL_BYTES as u32;
        let (code, code_length) = (data + VECTORS + seal, 200);
        let names = code + code_length;
        let section_table = names + NAMES.len() as u32;
        let mut file = Vec::new();
        let words = |file: &mut Vec<u8>, words: &[u32]| {
            words.iter().for_each(|word| file.extend_from_slice(&word.to_le_bytes()));
        };
        file.extend_from_slice(b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0");
        // Executable, Arm.
        file.extend_from_slice(&[2, 0, 40, 0]);
        words(&mut file, &[1, ORIGIN, header, section_table, 0]);
        for half in [header, 32, segments, 40, sections, 2] {
            file.extend_from_slice(&(half as u16).to_le_bytes());
        }
        let load = |offset, address: u32, length| [1, offset, address, address, length, length, 5, 4];
        words(&mut file, &load(data, ORIGIN, VECTORS + seal));
        words(&mut file, &load(code, ORIGIN + code_at, code_length));
        file.extend((0..VECTORS + seal + code_length).map(|place| (place * 7) as u8));
        file.extend_from_slice(NAMES);
        words(&mut file, &[0; 10]);
        words(&mut file, &[1, 1, 2, ORIGIN + VECTORS, data + VECTORS, seal, 0, 0, 1, 0]);
        words(&mut file, &[13, 3, 0, 0, names, NAMES.len() as u32, 0, 0, 1, 0]);
        file
    }

    const CODE_AT: u32 = VECTORS + SEAL_BYTES as u32;

    fn sealed() -> Vec<u8> {
        let mut file = elf_file(CODE_AT);
        let (seal, offset) = seal_of(&file).unwrap();
        file[offset..offset + SEAL_BYTES].copy_from_slice(&seal.to_bytes());
        file
    }

    /// What the firmware's own self-test makes of the flashed image.
    fn verdict(file: &[u8]) -> Progress {
        let (_, image) = image_of(file).unwrap();
        let seal = image[VECTORS as usize..].first_chunk().unwrap();
        let mut check = ProgramCheck::new(seal, VECTORS);
        for _ in 0..image.len() {
            let Some(wanted) = check.wanted() else { return check.feed(&[]) };
            let end = ((wanted.start + wanted.length) as usize).min(image.len());
            match check.feed(&image[wanted.start as usize..end]) {
                Progress::Underway => {}
                end => return end,
            }
        }
        panic!("the check does not end");
    }

    #[test]
    fn a_sealed_image_passes_the_firmwares_own_test_and_an_unsealed_one_does_not() {
        assert_eq!(verdict(&elf_file(CODE_AT)), Progress::Damaged);
        assert_eq!(verdict(&sealed()), Progress::Intact);
    }

    #[test]
    fn sealing_again_changes_nothing() {
        let file = sealed();
        let (seal, offset) = seal_of(&file).unwrap();
        assert_eq!(file[offset..offset + SEAL_BYTES], seal.to_bytes());
    }

    #[test]
    fn every_byte_that_is_flashed_is_sealed() {
        let file = sealed();
        let first = 52 + 64;
        for place in first..first + VECTORS as usize + SEAL_BYTES + 200 {
            let mut file = file.clone();
            file[place] ^= 0x20;
            assert_eq!(verdict(&file), Progress::Damaged, "byte {place} of the file");
        }
    }

    #[test]
    fn an_image_with_a_gap_is_refused() {
        let error = seal_of(&elf_file(CODE_AT + 4)).unwrap_err().to_string();
        assert!(error.contains("gap from 0x8000050 to 0x8000054"), "{error}");
    }

    #[test]
    fn what_is_no_firmware_is_refused() {
        assert!(seal_of(b"not an ELF file").is_err());
        let mut nameless = elf_file(CODE_AT);
        let name = nameless.windows(11).position(|bytes| bytes == b".image_seal").unwrap();
        nameless[name + 1] = b'x';
        let error = seal_of(&nameless).unwrap_err().to_string();
        assert!(error.contains(".image_seal"), "{error}");
    }
}
