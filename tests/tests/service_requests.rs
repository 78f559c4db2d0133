//! Service over the link to a controller in process: what is asked for is answered, what is not allowed is refused, and
//! none of it moves a relay.
#![allow(clippy::unwrap_used)]

use nearfield_host::black_box::simulated::SessionLink;
use nearfield_host::black_box::simulated_flash::SimulatedFlash;
use nearfield_host::black_box::{Replay, ServiceClient, ServiceError};
use nearfield_host::cli::mcu::{arm, clean_floor};
use nearfield_host::link::{FrameFacts, InProcess, McuSession};
use nearfield_host::twin::gallery::{CENTRE, SIDE};
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::rig::Rig;
use nearfield_shared::service::{Demand, FaultEvent, ResultCode};

/// A controller with this flash that has this rig stored.
fn power_up(flash: &SimulatedFlash, rig: &Rig) -> McuSession {
    McuSession::start(Box::new(InProcess::with_flash(flash.clone())), rig).unwrap()
}

/// The floor with the stripe missing in these columns.
fn with_gap(floor: &[LineScanColumn], columns: std::ops::Range<usize>) -> Vec<LineScanColumn> {
    let mut columns_of_scene = floor.to_vec();
    columns_of_scene[columns].fill(LineScanColumn::MISSING);
    columns_of_scene
}

#[test]
fn a_stop_is_fetched_and_replayed_and_the_limit_is_named() {
    let rig = CENTRE.rig().unwrap();
    let floor = clean_floor(&rig).unwrap();
    let mut session = power_up(&SimulatedFlash::new(), &rig);
    assert!(arm(&mut session, &floor).unwrap());
    let cut = with_gap(&floor, 500..600);
    for _ in 0..25 {
        session.run_columns(&cut, FrameFacts::default()).unwrap();
    }
    assert!(!session.relay_closed());
    let mut link = SessionLink::new(&mut session);
    let mut client = ServiceClient::new(&mut link, InProcess::SOURCE, 1);
    let recording = client.fetch(|_, _| ()).unwrap().unwrap();
    assert_eq!((recording.index.scans, recording.index.scans_before, recording.index.complete), (4, 3, true));
    let events: Vec<_> = recording.faults.iter().map(|entry| entry.event).collect();
    assert_eq!(events, [FaultEvent::Started, FaultEvent::Stopped]);
    let replay = Replay::of(&recording).unwrap();
    assert!(replay.reproduced, "{:?} {:?}", replay.mismatches, replay.deciders);
    assert_eq!(replay.deciders[0].limit, Some("IMMEDIATE_GAP"));
}

#[test]
fn reading_while_running_opens_nothing() {
    let rig = CENTRE.rig().unwrap();
    let floor = clean_floor(&rig).unwrap();
    let mut session = power_up(&SimulatedFlash::new(), &rig);
    assert!(arm(&mut session, &floor).unwrap());
    for number in 0..20 {
        let mut link = SessionLink::new(&mut session);
        // One transaction carries the request; the host's next line-scan must not wait for the answer.
        let mut message = Box::new([0; nearfield_shared::linescan::LINE_SCAN_LENGTH]);
        nearfield_shared::service::encode_request(
            &mut message,
            InProcess::SOURCE,
            number,
            &Demand::ReadFaultLog { page: 0 },
        );
        nearfield_host::black_box::ServiceLink::transact(&mut link, Some(&message)).unwrap();
        session.run_columns(&floor, FrameFacts::default()).unwrap();
        assert!(session.relay_commanded_closed(), "request {number}");
    }
}

#[test]
fn a_rig_is_changed_only_with_the_key_and_is_in_force_after_a_restart() {
    let (old, new) = (CENTRE.rig().unwrap(), SIDE.rig().unwrap());
    let flash = SimulatedFlash::new();
    let mut session = power_up(&flash, &old);
    session.run_frame(None).unwrap();
    let refused = {
        let mut link = SessionLink::new(&mut session);
        ServiceClient::new(&mut link, InProcess::SOURCE, 1).store_rig(&new.to_bytes()).unwrap_err()
    };
    assert!(matches!(refused, ServiceError::Refused { result: ResultCode::ServiceKeyOpen, .. }), "{refused}");
    session.service_key = true;
    session.run_frame(None).unwrap();
    {
        let mut link = SessionLink::new(&mut session);
        let mut client = ServiceClient::new(&mut link, InProcess::SOURCE, 100);
        assert_eq!(client.store_rig(&new.to_bytes()).unwrap(), new.calibration_id());
        assert_eq!(client.read_rig().unwrap(), Some(new.to_bytes()));
    }
    assert_eq!(session.status().calibration, Some(old.calibration_id()), "until its next start");
    drop(session);
    let session = power_up(&flash, &new);
    assert_eq!(session.status().calibration, Some(new.calibration_id()));
    let mut session = session;
    let mut link = SessionLink::new(&mut session);
    let log = ServiceClient::new(&mut link, InProcess::SOURCE, 200).read_fault_log().unwrap();
    let events: Vec<_> = log.iter().map(|entry| (entry.event, entry.power_cycle.get())).collect();
    assert_eq!(
        events,
        [(FaultEvent::Started, 1), (FaultEvent::RigChanged, 1), (FaultEvent::Started, 2)],
        "the log goes on over the power cycle"
    );
}
