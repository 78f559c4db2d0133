//! Flash, RAM, stack and instructions of the firmware against the committed budget.

use crate::run::{self, Step};
use crate::setup::QEMU;
use anyhow::{Context as _, Result, bail};
use clap::Args;
use object::{Object as _, ObjectSection as _, SectionFlags, SectionKind, elf};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What the firmware needs, or may need at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Figures {
    /// Flash of the board's binary, bytes: code, constants and initial values.
    flash_bytes: u64,
    /// Static RAM of the board's binary, bytes: variables and buffers, without the stack.
    static_ram_bytes: u64,
    /// Deepest stack seen in the emulated binary, bytes, over start, configuration and scans with every outcome.
    stack_bytes: u64,
    /// Instructions from the last byte of a 1152-column line-scan to the relay command, on the emulated Cortex-M4.
    scan_instructions: u64,
}

/// What the project aims at.
const GOAL: Figures = Figures {
    flash_bytes: 96 * 1024,
    static_ram_bytes: 48 * 1024,
    stack_bytes: 32 * 1024,
    scan_instructions: 150_000,
};

impl Figures {
    fn rows(&self) -> [(&'static str, u64); 4] {
        [
            ("flash, bytes", self.flash_bytes),
            ("static RAM, bytes", self.static_ram_bytes),
            ("deepest stack, bytes", self.stack_bytes),
            ("instructions for one 1152-column scan", self.scan_instructions),
        ]
    }

    /// Headroom of a newly written budget: 3 % against compiler noise, and where the goal is met never beyond it.
    fn with_headroom(self) -> Self {
        let more = |figure: u64, goal: u64| {
            let loose = figure + figure / 32;
            if figure <= goal { loose.min(goal) } else { loose }
        };
        Self {
            flash_bytes: more(self.flash_bytes, GOAL.flash_bytes),
            static_ram_bytes: more(self.static_ram_bytes, GOAL.static_ram_bytes),
            stack_bytes: more(self.stack_bytes, GOAL.stack_bytes),
            scan_instructions: more(self.scan_instructions, GOAL.scan_instructions),
        }
    }
}

fn budget_file() -> PathBuf {
    run::root().join("tests").join("budget.toml")
}

/// What is done with the figures.
#[derive(Debug, Default, Args)]
pub struct Options {
    /// Keep the measured figures plus headroom as the new budget
    #[arg(long)]
    write: bool,
}

/// Measures the built firmware and compares, or replaces the budget.
pub fn check(options: &Options) -> Result<()> {
    let (flash_bytes, static_ram_bytes) = sizes(&run::firmware_elf("stm32g474"))?;
    let (stack_bytes, scan_instructions) = emulated(&run::firmware_elf("qemu_an386"))?;
    let measured = Figures { flash_bytes, static_ram_bytes, stack_bytes, scan_instructions };
    let path = budget_file();
    if options.write {
        let text = toml::to_string(&measured.with_headroom())?;
        let head = "# The firmware's budget; `cargo xtask budget` enforces it, `cargo xtask budget --write` renews it.\n\
                    # Sizes: board; stack and instructions (worst of six scenes, all checks on): emulator.\n";
        std::fs::write(&path, format!("{head}{text}")).with_context(|| path.display().to_string())?;
    }
    let text = std::fs::read_to_string(&path).with_context(|| format!("the budget {}", path.display()))?;
    let budget: Figures = toml::from_str(&text).with_context(|| format!("the budget {}", path.display()))?;
    eprintln!("\n{:<40} {:>10} {:>10}", "budget", "measured", "at most");
    let mut over = Vec::new();
    for ((name, measured), (_, most)) in measured.rows().into_iter().zip(budget.rows()) {
        eprintln!("{name:<40} {measured:>10} {most:>10}");
        if measured > most {
            over.push(name);
        }
    }
    if !over.is_empty() {
        bail!(
            "over budget: {}. Make it smaller, or renew the budget knowingly with `--write`",
            over.join("; ")
        );
    }
    Ok(())
}

/// Flash and static RAM of a board binary, from its sections.
fn sizes(elf: &Path) -> Result<(u64, u64)> {
    const RAM: u64 = 0x2000_0000;
    let bytes =
        std::fs::read(elf).with_context(|| format!("{} (built by `cargo xtask firmware`)", elf.display()))?;
    let file = object::File::parse(&*bytes).with_context(|| elf.display().to_string())?;
    let (mut flash, mut ram) = (0, 0);
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        let stored = section.kind() != SectionKind::UninitializedData && section.file_range().is_some();
        if stored {
            flash += section.size();
        }
        if section.address() >= RAM {
            ram += section.size();
        }
    }
    Ok((flash, ram))
}

/// Deepest stack and instructions for one scan, as the emulated binary's own measurement prints them.
fn emulated(elf: &Path) -> Result<(u64, u64)> {
    let kernel = elf.display().to_string();
    let (_, output) = Step::program(
        QEMU,
        &[
            "-machine",
            "mps2-an386",
            "-icount",
            "shift=5,sleep=off",
            "-display",
            "none",
            "-monitor",
            "none",
            "-serial",
            "null",
            "-semihosting-config",
            "enable=on,target=native,arg=firmware,arg=measure",
            "-kernel",
            &kernel,
        ],
    )
    .capture()?;
    Ok((printed(&output, "stack_bytes")?, printed(&output, "scan_instructions")?))
}

/// The figure of the line `measure <name> <value>`.
fn printed(output: &str, name: &str) -> Result<u64> {
    output
        .lines()
        .filter_map(|line| line.trim().strip_prefix("measure ")?.strip_prefix(name)?.trim().parse().ok())
        .next()
        .with_context(|| format!("the emulated measurement printed no `{name}`; it said:\n{output}"))
}
