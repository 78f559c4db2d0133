//! The audit believes an honest host on real pictures: raw pixels bear out what the vision reports, on every floor and
//! object of the test pictures, in RGB and in YUV420.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of tests may fail them")]

use nearfield_host::capture::{Frame, read_frame};
use nearfield_host::light::LightReport;
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::scene_file::Scene;
use nearfield_host::vision::Analyser;
use nearfield_shared::audit::{AuditVerdict, judge};
use nearfield_shared::linescan::{LARGEST_AUDIT_COUNT, LineScanColumn};
use nearfield_shared::status::Challenge;
use std::path::Path;

/// Contradicted windows that an honest host may have. Reason: at one in 41 the audit's doubt rests.
const MOST_CONTRADICTED: f64 = 0.01;

fn scenes() -> Vec<Scene> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures");
    let scenes = Scene::load_all(&directory).unwrap();
    assert!(scenes.len() >= 9, "{}", scenes.len());
    scenes
}

/// Confirmed and contradicted windows if the controller asked for every column of a picture.
fn audited(scene: &Scene, frame: &Frame) -> [u32; 2] {
    let mut analyser = Analyser::new(&scene.rig).unwrap();
    let mut encoder = LineScanEncoder::new(&scene.rig).unwrap();
    analyser.judge(&frame.view()).unwrap();
    let columns = encoder.encode(analyser.extractor().readings(), analyser.extractor().geometry()).to_vec();
    let all: Vec<u16> = (0..columns.len() as u16).collect();
    let mut counts = [0; 2];
    for asked in all.chunks(LARGEST_AUDIT_COUNT) {
        let mut challenge = Challenge { count: asked.len() as u16, ..Challenge::default() };
        challenge.columns[..asked.len()].copy_from_slice(asked);
        let light: &LightReport = encoder.measure_light(&frame.view(), &challenge);
        for window in &light.windows {
            let column: LineScanColumn = columns[usize::from(window.column)];
            match judge(window, column) {
                AuditVerdict::Confirmed => counts[0] += 1,
                AuditVerdict::Contradicted => counts[1] += 1,
                AuditVerdict::NothingClaimed => {}
            }
        }
    }
    counts
}

#[test]
fn raw_pixels_bear_an_honest_host_out() {
    let mut all = [0; 2];
    for scene in scenes() {
        let frame = read_frame(&scene.picture, scene.rig.image()).unwrap();
        for (layout, frame) in [("RGB", &frame), ("YUV420", &frame.clone().to_yuv420())] {
            let [confirmed, contradicted] = audited(&scene, frame);
            println!("{} {layout}: {confirmed} confirmed, {contradicted} contradicted", scene.name);
            all = [all[0] + confirmed, all[1] + contradicted];
        }
    }
    let share = f64::from(all[1]) / f64::from(all[0] + all[1]);
    println!("contradicted: {:.4} % of {}", 100.0 * share, all[0] + all[1]);
    assert!(all[0] > 10_000 && share <= MOST_CONTRADICTED, "{share}");
}
