//! Service reaches the firmware's Arm binary in QEMU as it reaches the library in this process: the same pages, a whole
//! stop fetched, a rig changed.
#![allow(clippy::unwrap_used)]

use nearfield_host::black_box::simulated::SessionLink;
use nearfield_host::black_box::{Replay, ServiceClient, ServiceError};
use nearfield_host::cli::mcu::{arm, clean_floor};
use nearfield_host::link::{Emulated, FrameFacts, InProcess, McuSession};
use nearfield_host::twin::gallery::{CENTRE, SIDE};
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::service::ResultCode;
use nearfield_tests::emulator::without_emulator;
use nearfield_tests::pair::{Pair, SharedPair};

#[test]
fn a_stop_of_the_arm_binary_is_fetched_page_by_page_as_in_process() {
    let emulated = match Emulated::new() {
        Ok(emulated) => emulated,
        Err(error) => return without_emulator(&error),
    };
    let rig = CENTRE.rig().unwrap();
    let floor = clean_floor(&rig).unwrap();
    // The pair panics at the first page or status that differs.
    let pair = SharedPair::new(Pair::new(emulated));
    let mut session = McuSession::start(Box::new(pair), &rig).unwrap();
    assert!(arm(&mut session, &floor).unwrap());
    let mut cut = floor;
    cut[500..600].fill(LineScanColumn::MISSING);
    for _ in 0..25 {
        session.run_columns(&cut, FrameFacts::default()).unwrap();
    }
    assert!(!session.relay_closed());
    let mut link = SessionLink::new(&mut session);
    let recording = ServiceClient::new(&mut link, InProcess::SOURCE, 1).fetch(|_, _| ()).unwrap().unwrap();
    assert_eq!((recording.index.scans, recording.index.complete), (4, true));
    let replay = Replay::of(&recording).unwrap();
    assert!(replay.reproduced, "{:?} {:?}", replay.mismatches, replay.deciders);
    assert_eq!(replay.deciders[0].limit, Some("IMMEDIATE_GAP"));
}

#[test]
fn a_rig_is_stored_in_the_arm_binary_with_the_key_only() {
    let emulated = match Emulated::new() {
        Ok(emulated) => emulated,
        Err(error) => return without_emulator(&error),
    };
    let rig = CENTRE.rig().unwrap();
    let new = SIDE.rig().unwrap();
    let mut session = McuSession::start(Box::new(SharedPair::new(Pair::new(emulated))), &rig).unwrap();
    session.run_frame(None).unwrap();
    let refused = {
        let mut link = SessionLink::new(&mut session);
        ServiceClient::new(&mut link, InProcess::SOURCE, 1).store_rig(&new.to_bytes()).unwrap_err()
    };
    assert!(matches!(refused, ServiceError::Refused { result: ResultCode::ServiceKeyOpen, .. }), "{refused}");
    session.service_key = true;
    session.run_frame(None).unwrap();
    let mut link = SessionLink::new(&mut session);
    let mut client = ServiceClient::new(&mut link, InProcess::SOURCE, 100);
    assert_eq!(client.read_rig().unwrap(), Some(rig.to_bytes()));
    assert_eq!(client.store_rig(&new.to_bytes()).unwrap(), new.calibration_id());
    assert_eq!(client.read_rig().unwrap(), Some(new.to_bytes()));
}
