//! Vision and controller on made-up scenes: any floor, light, paint and object, with the twin's truth.
//!
//! What must never happen is a missed object; a false stop costs time, and only paint that the camera cannot see the
//! laser on, or a stripe at the end of its strength, may cause one.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::sync::Arc;

use nearfield_host::capture::{Frame, Pixels};
use nearfield_host::cli::mcu::{Examiner, McuChoice};
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::twin::gallery::{CENTRE, Mounting, SIDE, Theme, WIDE, random_scene};
use nearfield_host::twin::{ExpectedCutoff, Twin, View};
use nearfield_host::vision::Analyser;
use rayon::prelude::*;

/// Scenes of each kind for each rig; the seed of a failing one is printed.
const SEEDS: u64 = 8;
/// Share of clean scenes that may stop.
const FALSE_STOPS: f64 = 0.15;

/// One scene's outcome.
struct Verdict {
    name: String,
    truth: ExpectedCutoff,
    host_cut: bool,
    controller_open: bool,
    height_errors: Vec<f64>,
}

fn judge(mounting: Mounting, theme: Theme) -> Vec<Verdict> {
    let rig = mounting.rig().unwrap();
    let view = Arc::new(View::new(&rig));
    let mut analyser = Analyser::new(&rig).unwrap();
    let mut encoder = LineScanEncoder::new(&rig).unwrap();
    let mut examiner = Examiner::new(McuChoice::InProcess, &rig).unwrap();
    (0..SEEDS)
        .map(|seed| {
            let scene = random_scene(seed, theme, rig.stripe());
            let twin = Twin::new(Arc::clone(&view), &scene, seed).unwrap();
            let frame = Frame::new(rig.image(), Pixels::Rgb(twin.render(0, 1.0).rgb)).unwrap();
            let truth = twin.truth(1.0);
            analyser.judge(&frame.view()).unwrap();
            let extractor = analyser.extractor();
            let columns = encoder.encode(extractor.readings(), extractor.geometry());
            let verdict = examiner.judge(columns).unwrap();
            let height_errors = truth.objects.iter().filter_map(|object| {
                let heights = object.heights.as_ref()?;
                let found = analyser.objects().iter().find(|found| {
                    f64::from(found.start.get()) < heights.end_mm
                        && f64::from(found.end.get()) > heights.start_mm
                        && found.height.is_some()
                })?;
                Some(f64::from(found.height?.get()) - heights.p95_mm)
            });
            Verdict {
                name: format!(
                    "{theme:?}, seed {seed}, {:?} floor, stripe {:?}",
                    scene.floor.kind,
                    rig.stripe()
                ),
                truth: truth.cutoff,
                host_cut: analyser.report().is_cut(),
                controller_open: !verdict.is_closed(),
                height_errors: height_errors.collect(),
            }
        })
        .collect()
}

fn judge_all(theme: Theme) -> Vec<Verdict> {
    [CENTRE, SIDE, WIDE].into_par_iter().flat_map(|mounting| judge(mounting, theme)).collect()
}

#[test]
fn no_object_on_the_stripe_is_missed_by_host_or_controller() {
    let mut errors = Vec::new();
    let mut trips = 0;
    for verdict in [Theme::Object, Theme::Thin].into_iter().flat_map(judge_all) {
        if verdict.truth == ExpectedCutoff::Trip {
            trips += 1;
            assert!(verdict.host_cut, "the host missed: {}", verdict.name);
            assert!(verdict.controller_open, "the controller missed: {}", verdict.name);
        }
        errors.extend(verdict.height_errors.into_iter().map(f64::abs));
    }
    errors.sort_by(f64::total_cmp);
    let (median, high) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
    println!("{trips} trips; {} heights, error: median {median:.2} mm, 90 % {high:.2} mm", errors.len());
    assert!(trips >= 20 && errors.len() >= 20, "too few scenes to prove anything");
    assert!(median <= 0.5 && high <= 2.0, "height error: median {median:.2} mm, 90 % {high:.2} mm");
}

#[test]
fn clean_floors_seldom_stop_the_robot() {
    let verdicts = judge_all(Theme::Clean);
    let stopped: Vec<&Verdict> =
        verdicts.iter().filter(|verdict| verdict.host_cut || verdict.controller_open).collect();
    for verdict in &stopped {
        println!("stopped: {}", verdict.name);
    }
    assert!(verdicts.iter().all(|verdict| verdict.truth == ExpectedCutoff::NoTrip));
    let share = stopped.len() as f64 / verdicts.len() as f64;
    assert!(share <= FALSE_STOPS, "{} of {} clean scenes stopped", stopped.len(), verdicts.len());
}
