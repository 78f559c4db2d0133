//! A frame costs the host no allocation: an allocator that counts says so.
//!
//! Alone in its binary: the allocator counts for the whole process, and no other test may run beside it.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]
#![allow(
    unsafe_code,
    reason = "an allocator that counts and hands on to the system's cannot be written without"
)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use nearfield_host::capture::{Frame, Pixels};
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::twin::gallery::{self, CENTRE};
use nearfield_host::twin::{Twin, View};
use nearfield_host::vision::Analyser;

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `dealloc`'s contract, and the pointer came from the system's allocator.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as for `dealloc`.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Extraction, both tiers and the line-scan, from the very first frame on: memory is taken when the rig is known.
#[test]
fn a_frame_costs_no_allocation_whatever_it_shows_in_any_layout() {
    let rig = CENTRE.rig().unwrap();
    let view = Arc::new(View::new(&rig));
    let mut frames = Vec::new();
    for name in ["clean", "tiles", "cable_6", "box_75_glossy", "hand", "drop", "black_hole"] {
        let twin = Twin::new(Arc::clone(&view), &gallery::scene(name).unwrap(), 1).unwrap();
        let rgb = Frame::new(rig.image(), Pixels::Rgb(twin.render(0, 1.0).rgb)).unwrap();
        let grey = rgb.to_rgb().chunks_exact(3).map(|pixel| pixel[0]).collect();
        let grey = Frame::new(rig.image(), Pixels::Grey(grey)).unwrap();
        frames.extend([(name, rgb.to_yuv420()), (name, rgb.to_nv12()), (name, rgb), (name, grey)]);
    }
    let mut analyser = Analyser::new(&rig).unwrap();
    let mut encoder = LineScanEncoder::new(&rig).unwrap();
    let mut seen = 0;
    for (name, frame) in &frames {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        analyser.update(&frame.view()).unwrap();
        let extractor = analyser.extractor();
        seen += encoder.encode(extractor.readings(), extractor.geometry()).len();
        let after = ALLOCATIONS.load(Ordering::Relaxed);
        assert_eq!(after - before, 0, "{name}: allocations in one frame");
    }
    assert!(seen > 0 && ALLOCATIONS.load(Ordering::Relaxed) > frames.len(), "the counter does count");
}
