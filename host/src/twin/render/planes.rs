//! Rectangles of the raw planes, out and in again.

use crate::twin::patch::Patch;
use crate::twin::sensor::RawPlanes;
use crate::twin::view::PixelRectangle;

pub(in crate::twin) fn cut(planes: &RawPlanes, channel: usize, area: PixelRectangle, width: usize) -> Patch {
    let mut patch =
        Patch { area, values: Vec::with_capacity((area.right - area.left) * (area.bottom - area.top)) };
    for row in area.top..area.bottom {
        let start = (3 * row + channel) * width;
        patch.values.extend_from_slice(&planes.values[start + area.left..start + area.right]);
    }
    patch
}

pub(in crate::twin) fn paste(
    planes: &mut RawPlanes,
    channel: usize,
    patch: &Patch,
    area: PixelRectangle,
    width: usize,
) {
    for (line, row) in patch.values.chunks_exact(patch.width()).zip(area.top..) {
        let start = (3 * row + channel) * width;
        planes.values[start + area.left..start + area.right].copy_from_slice(line);
    }
}

pub(super) fn copy_area(from: &RawPlanes, to: &mut RawPlanes, area: PixelRectangle, width: usize) {
    for row in area.top..area.bottom {
        for channel in 0..3 {
            let start = (3 * row + channel) * width;
            let span = start + area.left..start + area.right;
            to.values[span.clone()].copy_from_slice(&from.values[span]);
        }
    }
}
