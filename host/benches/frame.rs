//! One frame of 2304 x 1296 through the host, against the sum of the bytes of the planes that it reads.
//!
//! `cargo xtask bench` runs this and makes one table of it. Scenes: a clean floor, a crowded one (a glossy box), a weak
//! stripe (bright light on wood).
#![allow(missing_docs, reason = "criterion makes a public function without")]
#![allow(clippy::unwrap_used, reason = "a benchmark that cannot be set up has nothing to measure")]

mod scenes;

use scenes::{WIDTH, render, scenes};
use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use nearfield_host::capture::{FrameView, Plane};
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::twin::View;
use nearfield_host::twin::gallery::CENTRE;
use nearfield_host::vision::{Analyser, Extractor};

/// The bytes of a plane, added up: what merely reading it costs.
fn sum(plane: &Plane<'_>) -> u64 {
    (0..plane.height()).map(|row| plane.row(row).iter().map(|byte| u64::from(*byte)).sum::<u64>()).sum()
}

fn frame_path(criterion: &mut Criterion) {
    let rig = CENTRE.with_width(WIDTH).rig().unwrap();
    let view = Arc::new(View::new(&rig));
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(30);
    for (name, scene) in scenes() {
        let rgb = render(&rig, &view, &scene);
        for (layout, frame) in [("yuv420", rgb.to_yuv420()), ("rgb", rgb)] {
            if name == "clean" {
                group.bench_function(format!("{layout}/byte-sum"), |bencher| {
                    bencher.iter(|| match black_box(frame.view()) {
                        FrameView::Rgb(plane) | FrameView::Grey(plane) => sum(&plane),
                        FrameView::Yuv420 { red, .. } => sum(&red),
                        FrameView::Nv12 { chroma, .. } => sum(&chroma),
                    });
                });
            }
            let mut extractor = Extractor::new(&rig).unwrap();
            group.bench_function(format!("{layout}/{name}/extract"), |bencher| {
                bencher.iter(|| extractor.extract(black_box(&frame.view())).unwrap());
            });
            let mut analyser = Analyser::new(&rig).unwrap();
            let mut encoder = LineScanEncoder::new(&rig).unwrap();
            group.bench_function(format!("{layout}/{name}/whole-path"), |bencher| {
                bencher.iter(|| {
                    analyser.update(black_box(&frame.view())).unwrap();
                    let extractor = analyser.extractor();
                    encoder.encode(extractor.readings(), extractor.geometry()).len()
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, frame_path);
criterion_main!(benches);
