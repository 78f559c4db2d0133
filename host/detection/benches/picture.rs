//! One picture through the shipped network, by backend and by number of windows.
//!
//! `cargo bench -p nearfield-detection`; with `--features ort` and `ORT_DYLIB_PATH` ONNX Runtime too.
#![allow(missing_docs, reason = "criterion makes a public function without")]
#![allow(clippy::unwrap_used, reason = "a benchmark that cannot be set up has nothing to measure")]

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use nearfield_detection::detector::{Detector, Picture};
use nearfield_detection::letterbox::{Letterbox, Window};
use nearfield_detection::model::{Backend, Choice};
use nearfield_detection::network::Settings;
use nearfield_detection::tiles::Tiling;

/// Noise has no objects, but its weak boxes give suppression something to do.
fn picture(width: u32, height: u32) -> image::RgbImage {
    let mut state = 1u32;
    image::RgbImage::from_fn(width, height, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image::Rgb([(state >> 24) as u8; 3])
    })
}

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("picture");
    group.sample_size(20).measurement_time(Duration::from_secs(4));
    let mut backends = vec![(Backend::Rten, "rten")];
    if cfg!(feature = "ort") && std::env::var_os("ORT_DYLIB_PATH").is_some() {
        backends.push((Backend::Ort, "onnxruntime"));
    }
    for (backend, name) in backends {
        for (size, tiling, windows) in [
            ((320, 320), Tiling::Off, "whole"),
            ((1280, 720), Tiling::Off, "whole"),
            ((1280, 720), Tiling::Windows(30), "tiles"),
        ] {
            let settings = Settings { tiling, least_score: None };
            let mut detector =
                Choice { model: None, backend, settings, second_look: true, threads: 1 }.load().unwrap();
            let picture = picture(size.0, size.1);
            let view = Picture::try_from(&picture).unwrap();
            group.bench_function(format!("{name}/{}x{}/{windows}", size.0, size.1), |bencher| {
                bencher.iter(|| black_box(detector.detect(view).unwrap().len()));
            });
        }
    }
    group.finish();
}

/// The same picture of a floor with things on it, looked at once and twice.
fn looks(criterion: &mut Criterion) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/goldens/square.png");
    let picture = image::open(path).unwrap().to_rgb8();
    let view = Picture::try_from(&picture).unwrap();
    let mut group = criterion.benchmark_group("crowded floor");
    group.sample_size(20).measurement_time(Duration::from_secs(4));
    for (second_look, name) in [(false, "one look"), (true, "second look")] {
        let settings = Settings { tiling: Tiling::Off, least_score: None };
        let choice = Choice { model: None, backend: Backend::Rten, settings, second_look, threads: 1 };
        let mut detector = choice.load().unwrap();
        group.bench_function(name, |bencher| {
            bencher.iter(|| black_box(detector.detect(view).unwrap().len()));
        });
    }
    group.finish();
}

fn preparation(criterion: &mut Criterion) {
    let picture = picture(2304, 1296);
    let view = Picture::try_from(&picture).unwrap();
    let mut letterbox = Letterbox::new(320);
    let window = Window { left: 0, top: 0, width: 2304, height: 1296 };
    criterion.bench_function("letterbox/2304x1296", |bencher| {
        bencher.iter(|| black_box(letterbox.fit(view, window).unwrap().0[0]));
    });
}

criterion_group!(benches, frames, looks, preparation);
criterion_main!(benches);
