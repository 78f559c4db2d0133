//! Pictures with known truth, and what becomes of full-resolution columns on the way to the safety controller.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use nearfield_host::cli::evaluate_scenes::{Layout, evaluate, play, sequences};
use nearfield_host::cli::mcu::McuChoice;
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::rig_file;
use nearfield_host::scene_file::Scene;
use nearfield_host::vision::grid::{MOST_COLUMNS, picture_geometry};
use nearfield_shared::columns::Decimation;
use nearfield_shared::cutoff::is_floor;
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::monitor::{ColumnReading, StripeMonitor};
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::units::SignalQuality;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

fn pictures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures")
}

#[test]
fn host_and_controller_judge_every_picture_right_in_every_layout() {
    let scenes = Scene::load_all(&pictures()).unwrap();
    assert!(scenes.len() >= 17, "only {} pictures", scenes.len());
    for layout in [Layout::AsRead, Layout::Yuv420, Layout::Nv12] {
        let mut errors = Vec::new();
        for scene in &scenes {
            let result = evaluate(scene, layout).unwrap();
            assert!(result.right, "{layout:?} {}: host cut {}, {:?}", result.name, result.cutoff, result.mcu);
            errors.extend(
                result.heights.iter().filter_map(|height| Some(height.measured_mm? - height.expected_mm)),
            );
        }
        assert!(errors.len() >= 8, "heights of only {} objects", errors.len());
        let square: f32 = errors.iter().map(|error| error * error).sum::<f32>() / errors.len() as f32;
        println!(
            "{layout:?}: {} pictures, height RMSE {:.2} mm over {}",
            scenes.len(),
            square.sqrt(),
            errors.len()
        );
        assert!(square.sqrt() <= 1.0, "{layout:?}: height RMSE {} mm", square.sqrt());
    }
}

#[test]
fn a_box_that_slides_in_trips_within_three_frames_and_not_before() {
    let scenes = Scene::load_all(&pictures().join("sequence")).unwrap();
    let all = sequences(&scenes);
    assert_eq!(all.len(), 1);
    let result = play(&all[0], McuChoice::InProcess).unwrap();
    println!("{result:?}");
    assert!(result.right, "{result:?}");
    let (opened, interrupted, must) =
        (result.relay_opened.unwrap(), result.first_interruption.unwrap(), result.first_trip.unwrap());
    assert!(opened >= interrupted && opened < must + 3, "{result:?}");
}

/// A rig of the test pictures with its camera's full resolution of 2304 columns: two of them are one of the line-scan.
fn full_rig(name: &str) -> Rig {
    let rig = rig_file::load(&pictures().join("rigs").join(name)).unwrap();
    let factor = 2304 / rig.image().width;
    let scale = f64::from(factor);
    let mut camera = *rig.camera();
    let lens = &mut camera.intrinsics;
    (lens.fx, lens.fy) = (lens.fx * scale, lens.fy * scale);
    (lens.cx, lens.cy) = ((lens.cx + 0.5) * scale - 0.5, (lens.cy + 0.5) * scale - 0.5);
    let image = ImageSize { width: rig.image().width * factor, height: rig.image().height * factor };
    let rig = Rig::new(image, camera, *rig.laser(), *rig.stripe()).unwrap();
    assert_eq!(Decimation::for_line_scan(rig.image().width).image_columns(), 2);
    rig
}

/// Full-resolution readings of a floor with a gap or a raised stretch, and columns without a stripe.
fn readings(rig: &Rig, centre: f32, length: f32, height: Option<f32>, lost: &[usize]) -> Vec<ColumnReading> {
    let geometry = picture_geometry(rig).unwrap();
    (0..usize::from(rig.image().width))
        .map(|column| match geometry.map(column) {
            Some(map) if !lost.contains(&column) => {
                let inside = (map.floor_place - centre).abs() < length / 2.0;
                let height = if inside { height } else { Some(0.0) };
                height.map_or(ColumnReading::MISSING, |height| ColumnReading {
                    row: map.row(height),
                    quality: SignalQuality::BEST,
                })
            }
            _ => ColumnReading::MISSING,
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    /// Downsampling never hides what the full resolution shows.
    #[test]
    fn a_cut_at_full_resolution_is_a_cut_in_the_line_scan(
        side in any::<bool>(), place in 0.02..0.98_f32, length in 0.0..15.0_f32,
        height in proptest::option::of(-20.0..120.0_f32),
        lost in proptest::collection::vec(0..2304_usize, 0..120),
    ) {
        let rig = full_rig(if side { "t1_side_std.toml" } else { "t2_std.toml" });
        let (start, end) = (rig.stripe().start as f32, rig.stripe().end as f32);
        let full_readings = readings(&rig, start + place * (end - start), length, height, &lost);
        let mut full = Box::new(StripeMonitor::<MOST_COLUMNS>::new());
        full.configure(&rig, Decimation::none(rig.image().width)).unwrap();
        let mut scanned = Box::new(StripeMonitor::<LARGEST_COLUMN_COUNT>::new());
        scanned.configure(&rig, Decimation::for_line_scan(rig.image().width)).unwrap();
        let mut encoder = LineScanEncoder::new(&rig).unwrap();
        let columns = encoder.encode(&full_readings, &picture_geometry(&rig).unwrap()).to_vec();
        for _ in 0..3 {
            let full_report = full.update(full_readings.iter().copied());
            let scan_report = scanned.update(columns.iter().map(|column| ColumnReading {
                row: column.row.to_pixels().unwrap_or(f32::NAN),
                quality: column.quality,
            }));
            prop_assert!(
                scan_report.is_cut() || !full_report.is_cut(),
                "full {:?}, line-scan {:?}", full_report.cutoff, scan_report.cutoff
            );
        }
        // Column by column: nothing that is not floor at full resolution becomes floor.
        let picture = picture_geometry(&rig).unwrap();
        for (index, pair) in full_readings.chunks_exact(2).enumerate() {
            let Some(map) = scanned.geometry().map(index) else { continue };
            let shown = columns[index].row.to_pixels().map_or(f32::NAN, |row| map.height(row));
            let hidden = pair.iter().enumerate().any(|(offset, reading)| {
                picture.map(2 * index + offset).is_some_and(|own| {
                    let height = own.height(reading.row);
                    // The line-scan's sixteenth of a row may carry a height across the tolerance by itself.
                    height.is_nan() || height.abs() > 1.8 + 0.05
                })
            });
            prop_assert!(!(hidden && is_floor(shown)), "column {index} shows {shown} mm");
        }
    }
}
