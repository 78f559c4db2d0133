//! The self-tests of this board: all of them at start, and a slice of one in each tick. What they mean is judged in
//! `nearfield_firmware::selftest`.
//!
//! | test | at start | a slice while running |
//! |---|---|---|
//! | processor, floating point | once | whole, once a round |
//! | RAM | destructive, before start-up | a block of 32 words, interrupts masked; the link's buffer between transactions |
//! | program | whole | 256 bytes |
//! | stack | whole | 256 words |
//! | clocks | one window of 250 ms | counters read in every tick |
//! | supply | one conversion | detector in every tick, a conversion a round |
//! | stored rig | once | whole, once a round |
//! | settings of pins, clocks, watchdogs, laser timer | once | whole, once a round; the laser's timer in every tick |
//! | watchdogs, random numbers | once a power-up, once a start | |
//!
//! A round is about 1,500 ticks, 7.5 s, of which 2.2 s are the program; 10 s are allowed.

use crate::bare_metal::memory::{Words, region, stack, test_block};
use crate::bare_metal::{program, registers, start_up};
use crate::host_link;
use crate::laser::Laser;
use crate::low_speed_clock::LowSpeedClock;
use crate::settings;
use crate::supply::Supply;
use embassy_time::{Duration, Instant, Timer};
use nearfield_firmware::selftest::clock::{ClockCheck, WINDOW};
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
    clock: ClockCheck,
    low_speed: LowSpeedClock,
    supply: Supply,
    program: ProgramCheck,
    stack: StackCheck,
    /// RAM before and after the link's buffer, which DMA writes to, and the stack's.
    regions: [Region; 3],
    next_block: usize,
    /// The compact form of the rig that the controller was started with.
    stored_rig: [u8; COMPACT_LENGTH],
}

fn now() -> Micros {
    Micros::new(Instant::now().as_micros())
}

/// The stack's memory as it is.
fn stack_words() -> Words {
    // SAFETY: it is only read.
    unsafe { Words::new(stack()) }
}

impl SelfTests {
    /// Makes the tests at start that need no other part of the program; some 0.3 s. `watchdogs`: what their provoked
    /// bites have shown; `random`: whether the random number generator has given a secret.
    pub(crate) async fn start(watchdogs: Outcome, random: bool) -> Self {
        let buffer = host_link::buffer_region();
        let buffer_end = buffer.address + buffer.words * size_of::<u32>();
        let mut tests = Self {
            schedule: Schedule::new(),
            clock: ClockCheck::new(),
            low_speed: LowSpeedClock::start(),
            supply: Supply::start(),
            program: program::check(),
            stack: StackCheck::new(),
            regions: [
                region((&raw const _ram_start) as usize, buffer.address),
                region(buffer_end, (&raw const _ram_end) as usize),
                stack(),
            ],
            next_block: 0,
            stored_rig: [0; COMPACT_LENGTH],
        };
        tests.record_start(SelfTestKind::Watchdog, watchdogs);
        tests.record_start(SelfTestKind::Random, Outcome::passed_if(random));
        tests.record_start(SelfTestKind::Memory, start_up::march_outcome());
        tests.record_start(SelfTestKind::Processor, registers::check_processor());
        tests.record_start(SelfTestKind::FloatingPoint, registers::check_floating_point());
        tests.record_start(SelfTestKind::Program, program::check_whole());
        tests.record_start(SelfTestKind::Registers, settings::check(false));
        let supply = tests.supply.check_now();
        tests.record_start(SelfTestKind::Supply, supply);
        let clock = tests.check_clock().await;
        tests.record_start(SelfTestKind::Clock, clock);
        tests
    }

    /// The rest of the tests at start, when the controller has taken its rig: the clock of the first round begins.
    pub(crate) fn finish_start(&mut self, stored_rig: &[u8; COMPACT_LENGTH], in_use: Option<CalibrationId>) {
        self.stored_rig = *stored_rig;
        self.record_start(SelfTestKind::Configuration, configuration::check(&self.stored_rig, in_use));
        let stack = self.whole_stack();
        self.record_start(SelfTestKind::Stack, stack);
        // Filling the maps took longer than a window may.
        self.clock = ClockCheck::new();
    }

    fn record_start(&mut self, kind: SelfTestKind, outcome: Outcome) {
        if outcome != Outcome::Passed {
            defmt::error!("self-test at start: {=str}", kind.words());
        }
        self.schedule.record_start(kind, outcome, now());
    }

    async fn check_clock(&mut self) -> Outcome {
        self.clock.step(now(), self.low_speed.count());
        Timer::after(Duration::from_micros(WINDOW.get())).await;
        self.clock.step(now(), self.low_speed.count());
        self.clock.outcome(now())
    }

    fn whole_stack(&mut self) -> Outcome {
        loop {
            match self.stack.step(&stack_words()) {
                Outcome::Pending => {}
                outcome => return outcome,
            }
        }
    }

    /// A tick's part of the tests.
    pub(crate) fn step(&mut self, laser: &Laser, in_use: Option<CalibrationId>) -> SelfTestReport {
        self.clock.step(now(), self.low_speed.count());
        let kind = self.schedule.next();
        let outcome = match kind {
            SelfTestKind::Processor => registers::check_processor(),
            SelfTestKind::FloatingPoint => registers::check_floating_point(),
            SelfTestKind::Registers => settings::check(true),
            SelfTestKind::Supply => self.supply.step(),
            SelfTestKind::Clock => self.clock.outcome(now()),
            SelfTestKind::Configuration => configuration::check(&self.stored_rig, in_use),
            SelfTestKind::Stack => self.stack.step(&stack_words()),
            SelfTestKind::Program => program::step(&mut self.program),
            SelfTestKind::Memory => self.memory_step(),
            // Only at start, or never next.
            SelfTestKind::Watchdog | SelfTestKind::Random | SelfTestKind::Schedule => Outcome::Failed,
        };
        self.schedule.record(kind, outcome, now());
        self.every_tick(laser);
        let report = self.schedule.report();
        if let (Some(kind), Outcome::Failed) = (report.failed, outcome) {
            defmt::error!("self-test while running: {=str}", kind.words());
        }
        report
    }

    /// What cannot wait for its turn.
    fn every_tick(&mut self, laser: &Laser) {
        let checks = [
            (SelfTestKind::Clock, self.clock.outcome(now()) != Outcome::Failed),
            (SelfTestKind::Supply, self.supply.is_above_detector()),
            (SelfTestKind::Registers, laser.check() == Outcome::Passed),
        ];
        for (kind, passed) in checks {
            if !passed {
                self.schedule.fail(kind);
            }
        }
    }

    fn memory_step(&mut self) -> Outcome {
        let Some(block) = block_of(&self.regions, self.next_block) else {
            self.next_block = 0;
            return host_link::buffer_outcome(now());
        };
        self.next_block += 1;
        // SAFETY: RAM outside the buffer that DMA writes to; the other stack is outside the stack's memory.
        match unsafe { test_block(block) } {
            Outcome::Passed => Outcome::Pending,
            outcome => outcome,
        }
    }
}
