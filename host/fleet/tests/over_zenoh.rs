//! Four modules joined to one robot over zenoh, between sessions of this process; needs the feature `zenoh`.

#![cfg(feature = "zenoh")]
#![allow(clippy::unwrap_used)]

use std::time::{Duration, Instant};

use nearfield_fleet::report::Verdict;
use nearfield_fleet::simulated::Fleet;
use nearfield_fleet::zenoh_carrier::{Settings, ZenohCarrier, ZenohInbox};
use nearfield_fleet::{Carrier as _, Inbox as _, REPORT_INTERVAL, Roster};

/// Connecting takes less than a second; who waits longer waits in vain.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn four_modules_are_one_robot_and_their_silence_is_its_loss() {
    // A port that is free now; on this computer only, and without looking for neighbours.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let endpoint = vec![format!("tcp/127.0.0.1:{port}")];
    let mut inbox = ZenohInbox::new(&Settings { listen: endpoint.clone(), ..Settings::default() }).unwrap();
    let settings = Settings { listen: vec!["tcp/127.0.0.1:0".to_owned()], connect: endpoint, scout: false };
    let mut carrier = ZenohCarrier::new(&settings).unwrap();
    // With this seed all four drive.
    let (mut fleet, mut roster) = (Fleet::new(4, 1, 1), Roster::default());
    let begun = Instant::now();
    while roster.robot("amr-0000", Instant::now()) != Verdict::Go {
        assert!(begun.elapsed() < PATIENCE, "{} reports came", roster.taken());
        for report in fleet.reports(Duration::ZERO, 0, 1) {
            carrier.send(&report).unwrap();
        }
        inbox.receive(REPORT_INTERVAL / 4, &mut |bytes| roster.take(bytes, Instant::now()).unwrap()).unwrap();
    }
    drop(carrier);
    while roster.robot("amr-0000", Instant::now()) != Verdict::Lost {
        assert!(begun.elapsed() < PATIENCE, "they are not missed");
        inbox.receive(REPORT_INTERVAL, &mut |bytes| roster.take(bytes, Instant::now()).unwrap()).unwrap();
    }
}
