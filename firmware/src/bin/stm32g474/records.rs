//! Carries work between the recorder, which the safety task holds, and the flash, which is slow.

use crate::storage::{self, Done, Wanted};
use crate::target::Controller;
use nearfield_shared::status::Channels;
use nearfield_shared::units::Micros;

/// What is on its way.
pub(crate) struct Records {
    at_work: bool,
    /// The flash did not take an entry of the fault log: no more attempts until the next start.
    log_is_full: bool,
}

impl Records {
    pub(crate) const fn new() -> Self {
        Self { at_work: false, log_is_full: false }
    }

    /// Takes what has come of the last piece of work and hands over the next one. `true` if there is a new page for the
    /// host. Entries of the fault log wait for open relays: nothing is erased while the robot runs.
    pub(crate) fn step(&mut self, now: Micros, controller: &mut Controller) -> bool {
        let counter = storage::counter();
        let mut new_page = false;
        match counter.done.try_receive() {
            Ok(Done::Job(outcome)) => {
                controller.finish_job(now, &outcome);
                (self.at_work, new_page) = (false, true);
            }
            Ok(Done::Entry(saved)) => {
                self.at_work = false;
                match saved {
                    Some(entry) => controller.fault_saved(&entry),
                    None => self.log_is_full = true,
                }
            }
            Err(_) => {}
        }
        if !self.at_work
            && let Some(wanted) = self.next(controller)
        {
            self.at_work = counter.wanted.try_send(wanted).is_ok();
        }
        new_page
    }

    fn next(&self, controller: &mut Controller) -> Option<Wanted> {
        if let Some(job) = controller.take_job() {
            return Some(Wanted::Job(job));
        }
        let may_save = !self.log_is_full && controller.outputs().relays == Channels::OPEN;
        controller.unsaved_fault().filter(|_| may_save).map(Wanted::Entry)
    }
}
