//! Embassy's clock on the board's two timers: timer 0 runs freely and counts the time, timer 1 is the alarm.

use crate::board::{CLOCK_HZ, Register};
use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Waker;
use critical_section::Mutex;
use embassy_time_driver::{Driver, TICK_HZ, time_driver_impl};
use embassy_time_queue_utils::Queue;

/// Timer cycles in one of embassy's ticks.
const CYCLES_PER_TICK: u64 = CLOCK_HZ as u64 / TICK_HZ;
const ENABLED_WITH_INTERRUPT: u32 = 0b1001;

struct Timer {
    control: Register,
    value: Register,
    reload: Register,
    interrupt: Register,
}

impl Timer {
    const fn at(base: usize) -> Self {
        Self {
            control: Register::new(base),
            value: Register::new(base + 0x4),
            reload: Register::new(base + 0x8),
            interrupt: Register::new(base + 0xC),
        }
    }
}

const FREE_RUNNING: Timer = Timer::at(0x4000_0000);
const ALARM: Timer = Timer::at(0x4000_1000);

struct Clock {
    wraps: AtomicU32,
    queue: Mutex<RefCell<Queue>>,
}

time_driver_impl!(static CLOCK: Clock = Clock {
    wraps: AtomicU32::new(0),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts counting; call once, before any task.
pub(crate) fn start() {
    FREE_RUNNING.reload.write(u32::MAX);
    FREE_RUNNING.value.write(u32::MAX);
    FREE_RUNNING.control.write(ENABLED_WITH_INTERRUPT);
    ALARM.reload.write(u32::MAX);
}

/// Timer 0 has run down once more.
pub(crate) unsafe extern "C" fn on_timer0() {
    FREE_RUNNING.interrupt.write(1);
    CLOCK.wraps.fetch_add(1, Ordering::Relaxed);
}

/// The alarm.
pub(crate) unsafe extern "C" fn on_timer1() {
    ALARM.control.write(0);
    ALARM.interrupt.write(1);
    critical_section::with(|token| CLOCK.arm_next(&mut CLOCK.queue.borrow_ref_mut(token)));
}

impl Clock {
    fn cycles(&self) -> u64 {
        critical_section::with(|_| {
            let mut wraps = self.wraps.load(Ordering::Relaxed);
            let mut left = FREE_RUNNING.value.read();
            if FREE_RUNNING.interrupt.read() & 1 != 0 {
                // It has wrapped, and its interrupt waits for this critical section to end.
                wraps = wraps.wrapping_add(1);
                left = FREE_RUNNING.value.read();
            }
            (u64::from(wraps) << 32) | u64::from(u32::MAX - left)
        })
    }

    fn arm_next(&self, queue: &mut Queue) {
        loop {
            let next = queue.next_expiration(self.now());
            if self.arm(next) {
                return;
            }
        }
    }

    /// Sets the alarm; `false` if its time has passed already.
    fn arm(&self, at: u64) -> bool {
        ALARM.control.write(0);
        ALARM.interrupt.write(1);
        if at == u64::MAX {
            return true;
        }
        let Some(ticks) = at.checked_sub(self.now()).filter(|ticks| *ticks > 0) else {
            return false;
        };
        let cycles = u32::try_from(ticks.saturating_mul(CYCLES_PER_TICK)).unwrap_or(u32::MAX);
        ALARM.value.write(cycles);
        ALARM.control.write(ENABLED_WITH_INTERRUPT);
        true
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        self.cycles() / CYCLES_PER_TICK
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|token| {
            let mut queue = self.queue.borrow_ref_mut(token);
            if queue.schedule_wake(at, waker) {
                self.arm_next(&mut queue);
            }
        });
    }
}
