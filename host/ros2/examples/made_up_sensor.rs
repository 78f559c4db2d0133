//! A made-up sensor: publishes fifty pictures a second, over which something cuts the stripe for a second, then nothing does.
//!
//! `cargo run --release -p nearfield-ros2 --features dds --example made_up_sensor -- DOMAIN SECONDS`, over the loopback.

#![allow(clippy::unwrap_used)]

#[path = "../tests/scene/mod.rs"]
mod scene;

use std::net::{IpAddr, Ipv4Addr};
use std::time::{Duration, Instant};

use nearfield_recording::queue;
use nearfield_ros2::{About, Outlet, Reporter, Settings, Stamp};
use nearfield_shared::units::Micros;
use scene::{decision, exchange, line_scan, rig, status};

fn main() {
    let number = |index: usize| std::env::args().nth(index).and_then(|text| text.parse::<u16>().ok());
    let (domain, seconds) = (number(1).unwrap_or(202), number(2).unwrap_or(10));
    let about = About {
        module: "front".to_owned(),
        frame_id: "nearfield_front".to_owned(),
        scan_time: 0.02,
        tells_heights: true,
    };
    let settings = Settings {
        domain,
        networks: vec![IpAddr::V4(Ipv4Addr::LOCALHOST)],
        namespace: "/nearfield/front".to_owned(),
        stamp: Stamp::Exposure,
    };
    let (tap, drain) = queue(64);
    let outlet = Outlet::start(settings, Reporter::new(&rig(), about).unwrap(), drain).unwrap();
    let free = line_scan(&rig(), |_| Some(0.0));
    let cut = line_scan(&rig(), |place| (place < 0.0).then_some(0.0));
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(u64::from(seconds)) {
        let is_cut = begun.elapsed().as_secs() % 2 == 1;
        let bytes = if is_cut { cut } else { free };
        tap.tell(Micros::from_millis(1000), exchange(Some(bytes), status().to_bytes()));
        tap.tell(Micros::from_millis(1000), decision(!is_cut));
        std::thread::sleep(Duration::from_millis(20));
    }
    println!("{} messages", outlet.published());
}
