//! The Hailo backend against a mock of HailoRT's library: what it makes of good answers, of bad ones and of none.
//!
//! The mock is compiled here, once for each test: its state belongs to one library.
#![cfg(feature = "hailo")]
#![allow(clippy::unwrap_used, missing_docs)]
#![allow(unsafe_code, reason = "the mock is opened once more, to count its handles")]

use std::path::{Path, PathBuf};
use std::process::Command;

use nearfield_detection::backend::hailo::HailoNetwork;
use nearfield_detection::calibration::Calibration;
use nearfield_detection::card::{Card, ModelError, SCHEMA};
use nearfield_detection::detector::{Detection, Detector, Picture, Unknown};
use nearfield_detection::network::{NetworkDetector, Settings};
use nearfield_detection::tiles::Tiling;

const SIDE: u32 = 64;

fn card() -> Card {
    Card {
        schema: SCHEMA.to_owned(),
        name: "mock".to_owned(),
        input_side: SIDE,
        classes: ["bolt", "hand", "nut"].map(str::to_owned).to_vec(),
        largest_overlap: 0.5,
        operating_scores: vec![0.1; 3],
        calibration: Calibration::default(),
        steps: Vec::new(),
        classifier: None,
        about: serde_json::Value::Null,
    }
}

/// A mock library of its own in a directory of its own, with a HEF that tells it how to behave.
struct Mock {
    directory: tempfile::TempDir,
    library: PathBuf,
    /// Held open, so that its count of handles outlives the session.
    held: libloading::Library,
}

impl Mock {
    fn new(hef: &str, version: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let library = directory.path().join("libhailort.so");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mock_hailort/library.rs");
        let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
        let status = Command::new(compiler)
            .args(["--edition", "2024", "--crate-type", "cdylib", "--crate-name", "hailort", "-o"])
            .arg(&library)
            .arg(source)
            .env("MOCK_VERSION", version)
            .status()
            .unwrap();
        assert!(status.success());
        std::fs::write(directory.path().join("network.hef"), hef).unwrap();
        // SAFETY: the mock has no initialisers.
        let held = unsafe { libloading::Library::new(&library) }.unwrap();
        Self { directory, library, held }
    }

    fn open(&self) -> Result<HailoNetwork, ModelError> {
        HailoNetwork::open_with(&self.library, &self.directory.path().join("network.hef"), &card(), 20)
    }

    fn detector(&self) -> NetworkDetector<HailoNetwork> {
        let settings = Settings { tiling: Tiling::Off, least_score: None };
        NetworkDetector::new(self.open().unwrap(), card(), settings).unwrap()
    }

    /// Handles that the mock gave out and did not get back.
    fn open_handles(&self) -> i32 {
        // SAFETY: the mock's own function of this type; the library is that of this test.
        unsafe {
            let count: libloading::Symbol<'_, extern "C" fn() -> i32> =
                self.held.get(b"mock_open_handles").unwrap();
            count()
        }
    }
}

fn look(detector: &mut dyn Detector, level: u8) -> Result<Vec<Detection>, Unknown> {
    let rgb = vec![level; (SIDE * SIDE * 3) as usize];
    detector.detect(Picture::new(SIDE, SIDE, &rgb).unwrap()).map(<[Detection]>::to_vec)
}

#[test]
fn a_good_answer_is_boxes_in_pixels_of_this_very_picture() {
    let mock = Mock::new("good 64 3", "4");
    let mut detector = mock.detector();
    for level in [255, 128, 60] {
        let found = look(&mut detector, level).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].class, 1);
        assert!(
            (found[0].score - f32::from(level) / 255.0).abs() < 1e-3,
            "the score tells which picture it was"
        );
        let place = found[0].place;
        assert_eq!([place.left, place.top, place.right, place.bottom], [16.0, 16.0, 48.0, 32.0]);
    }
    assert_eq!(look(&mut detector, 10).unwrap(), vec![], "below the operating point");
}

#[test]
fn bad_answers_are_unknown_and_never_an_empty_floor() {
    type Expectation = fn(&Unknown) -> bool;
    let stalled: Expectation = |unknown| matches!(unknown, Unknown::Stalled { deadline_ms: 20 });
    let failed: Expectation = |unknown| matches!(unknown, Unknown::Failed { what } if what.contains("62"));
    let nonsense: Expectation = |unknown| matches!(unknown, Unknown::Nonsense { .. });
    let cases = [
        ("bad_count", nonsense),
        ("nan", nonsense),
        ("timeout", stalled),
        ("lost", failed),
        // It reports success and writes nothing: the last picture's answer must not be taken for this one's.
        ("silent", nonsense),
    ];
    for (behaviour, expected) in cases {
        let mock = Mock::new(&format!("{behaviour} 64 3"), "4");
        let mut detector = mock.detector();
        for _ in 0..3 {
            let unknown = look(&mut detector, 200).unwrap_err();
            assert!(expected(&unknown), "{behaviour}: {unknown:?}");
        }
    }
}

#[test]
fn an_answer_that_is_too_short_for_its_boxes_is_refused_at_once() {
    let mock = Mock::new("short 64 3", "4");
    let settings = Settings { tiling: Tiling::Off, least_score: None };
    let error = NetworkDetector::new(mock.open().unwrap(), card(), settings).err().unwrap().to_string();
    assert!(error.contains("the answer ends"), "{error}");
}

#[test]
fn after_a_time_out_everything_is_opened_anew_and_works_again() {
    let mock = Mock::new("timeout_once 64 3", "4");
    let mut detector = mock.detector();
    assert!(matches!(look(&mut detector, 200), Err(Unknown::Stalled { .. })));
    for level in [100, 150] {
        let found = look(&mut detector, level).unwrap();
        assert!((found[0].score - f32::from(level) / 255.0).abs() < 1e-3);
    }
    assert_eq!(mock.open_handles(), 4, "device, HEF and two streams, once");
    drop(detector);
    assert_eq!(mock.open_handles(), 0);
}

#[test]
fn what_does_not_fit_is_refused_and_everything_is_given_back() {
    for (hef, expected) in [
        ("good 32 3", "3072 bytes"),
        ("good 64 4", "4 classes"),
        ("raw_order 64 3", "order 1"),
        ("two_groups 64 3", "2 network groups"),
        ("no_stream 64 3", "hailo_create_input_vstreams"),
        ("no HEF", "status 26"),
    ] {
        let mock = Mock::new(hef, "4");
        let error = mock.open().err().unwrap().to_string();
        assert!(error.contains(expected), "{hef}: {error}");
        assert_eq!(mock.open_handles(), 0, "{hef}");
    }
}

#[test]
fn another_version_and_no_library_are_named() {
    let mock = Mock::new("good 64 3", "5");
    let error = mock.open().err().unwrap().to_string();
    assert!(error.contains("HailoRT 5.23.0") && error.contains("version 4"), "{error}");
    let missing = Path::new("/nowhere/libhailort.so");
    let error = HailoNetwork::open_with(missing, Path::new("x.hef"), &card(), 20).err().unwrap();
    assert!(matches!(error, ModelError::NoBackend { .. }));
    assert!(error.to_string().contains("/nowhere/libhailort.so"), "{error}");
}
