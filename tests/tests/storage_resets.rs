//! The fault log outlives the controller: watchdog resets and power cycles are counted and told.
#![allow(clippy::unwrap_used)]

use nearfield_host::black_box::ServiceClient;
use nearfield_host::black_box::simulated::SessionLink;
use nearfield_host::black_box::simulated_flash::SimulatedFlash;
use nearfield_host::link::{InProcess, McuSession};
use nearfield_host::twin::gallery::CENTRE;
use nearfield_shared::condition::ResetCause;
use nearfield_shared::service::{FaultEntry, FaultEvent};

fn log_after(flash: &SimulatedFlash, hang: bool) -> Vec<FaultEntry> {
    let controller = InProcess::with_flash(flash.clone());
    let mut session = McuSession::start(Box::new(controller), &CENTRE.rig().unwrap()).unwrap();
    if hang {
        session.hang().unwrap();
        for _ in 0..10 {
            session.run_frame(None).unwrap();
        }
    }
    let mut link = SessionLink::new(&mut session);
    ServiceClient::new(&mut link, InProcess::SOURCE, 1).read_fault_log().unwrap()
}

#[test]
fn every_start_is_an_entry_with_its_reason_and_its_number() {
    let flash = SimulatedFlash::new();
    log_after(&flash, false);
    let log = log_after(&flash, true);
    let told: Vec<_> =
        log.iter().map(|entry| (entry.number, entry.power_cycle.get(), entry.reset_cause)).collect();
    assert_eq!(
        told,
        [(1, 1, ResetCause::PowerOn), (2, 2, ResetCause::PowerOn), (3, 3, ResetCause::Watchdog)]
    );
    assert!(log.iter().all(|entry| entry.event == FaultEvent::Started));
}
