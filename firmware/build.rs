//! Link arguments of the bare-metal binaries. They stand here and not in .cargo/config.toml because a RUSTFLAGS
//! variable would replace those silently, and the binaries would link at the wrong addresses.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../memory.x");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    // link.x includes memory.x; the linker does not look into the workspace's root by itself.
    let directory = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("../memory.x", directory.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", directory.display());
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bin=stm32g474=-Tdefmt.x");
    // One memory.x, two boards.
    println!("cargo:rustc-link-arg-bin=qemu_an386=--defsym=__board_qemu=1");
    Ok(())
}
