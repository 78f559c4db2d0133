//! The self-tests that an emulated board can make: registers, RAM, program, stack, stored rig. It has no second
//! oscillator, no supply to measure, no random number generator and no settings that could flip: those tests are
//! recorded as passed, for the schedule's sake. Its watchdog is shown to bite by the tests that run the emulator.

use crate::bare_metal::memory::{Words, region, stack, test_block};
use crate::bare_metal::{program, registers, start_up};
use nearfield_firmware::selftest::memory::{Region, block_of};
use nearfield_firmware::selftest::program::ProgramCheck;
use nearfield_firmware::selftest::schedule::Schedule;
use nearfield_firmware::selftest::stack::StackCheck;
use nearfield_firmware::selftest::{Outcome, SelfTestKind, SelfTestReport, configuration};
use nearfield_shared::rig::COMPACT_LENGTH;
use nearfield_shared::units::{CalibrationId, Micros};

unsafe extern "C" {
    static _ram_start: u32;
    static _ram_end: u32;
}

/// What the tests work on.
pub(crate) struct SelfTests {
    schedule: Schedule,
    program: ProgramCheck,
    stack: StackCheck,
    regions: [Region; 2],
    next_block: usize,
    stored_rig: [u8; COMPACT_LENGTH],
}

/// The stack's memory as it is.
fn stack_words() -> Words {
    // SAFETY: it is only read.
    unsafe { Words::new(stack()) }
}

impl SelfTests {
    /// All tests at start.
    pub(crate) fn start(now: Micros, rig: &[u8; COMPACT_LENGTH], in_use: Option<CalibrationId>) -> Self {
        let ram = region((&raw const _ram_start) as usize, (&raw const _ram_end) as usize);
        let mut tests = Self {
            schedule: Schedule::new(),
            program: program::check(),
            stack: StackCheck::new(),
            regions: [ram, stack()],
            next_block: 0,
            stored_rig: *rig,
        };
        for kind in [
            SelfTestKind::Clock,
            SelfTestKind::Supply,
            SelfTestKind::Registers,
            SelfTestKind::Random,
            SelfTestKind::Watchdog,
        ] {
            tests.schedule.record_start(kind, Outcome::Passed, now);
        }
        let stack = loop {
            match tests.stack.step(&stack_words()) {
                Outcome::Pending => {}
                outcome => break outcome,
            }
        };
        for (kind, outcome) in [
            (SelfTestKind::Processor, registers::check_processor()),
            (SelfTestKind::FloatingPoint, registers::check_floating_point()),
            (SelfTestKind::Memory, start_up::march_outcome()),
            (SelfTestKind::Program, program::check_whole()),
            (SelfTestKind::Configuration, configuration::check(rig, in_use)),
            (SelfTestKind::Stack, stack),
        ] {
            if outcome != Outcome::Passed {
                crate::semihosting::print(kind.words());
                crate::semihosting::print("\n");
            }
            tests.schedule.record_start(kind, outcome, now);
        }
        tests
    }

    /// A tick's part of the tests.
    pub(crate) fn step(&mut self, now: Micros, in_use: Option<CalibrationId>) -> SelfTestReport {
        let kind = self.schedule.next();
        let outcome = match kind {
            SelfTestKind::Processor => registers::check_processor(),
            SelfTestKind::FloatingPoint => registers::check_floating_point(),
            SelfTestKind::Configuration => configuration::check(&self.stored_rig, in_use),
            SelfTestKind::Stack => self.stack.step(&stack_words()),
            SelfTestKind::Program => program::step(&mut self.program),
            SelfTestKind::Memory => self.memory_step(),
            SelfTestKind::Registers | SelfTestKind::Supply | SelfTestKind::Clock => Outcome::Passed,
            // Only at start, or never next.
            SelfTestKind::Watchdog | SelfTestKind::Random | SelfTestKind::Schedule => Outcome::Failed,
        };
        self.schedule.record(kind, outcome, now);
        self.schedule.report()
    }

    fn memory_step(&mut self) -> Outcome {
        let Some(block) = block_of(&self.regions, self.next_block) else {
            self.next_block = 0;
            return Outcome::Passed;
        };
        self.next_block += 1;
        // SAFETY: RAM that no DMA writes to; the other stack is outside the stack's memory.
        match unsafe { test_block(block) } {
            Outcome::Passed => Outcome::Pending,
            outcome => outcome,
        }
    }
}
