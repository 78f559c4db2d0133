//! The line that points lie on, some of which belong to another one.

use super::FARTHEST;

/// Fewest points that make a line.
const FEWEST_POINTS: usize = 8;
/// Points that lines are tried through.
const MOST_TRIED: usize = 24;
/// A point belongs to the line within this distance, samples: paint is frayed.
const NEAR_LINE: f32 = 0.8;

/// Of the lines that pass near one place the one that most points belong to: unit vector across, and offset.
pub(super) fn line_through(points: &[[f32; 2]], here: [f32; 2]) -> Option<([f32; 2], f32)> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let stride = points.len().div_ceil(MOST_TRIED);
    let distance = |line: &([f32; 2], f32), point: &[f32; 2]| {
        (line.0[0] * point[0] + line.0[1] * point[1] - line.1).abs()
    };
    let mut best: Option<(usize, ([f32; 2], f32))> = None;
    for (index, one) in points.iter().enumerate().step_by(stride) {
        for other in points.iter().skip(index + 1).step_by(stride) {
            let along = [other[0] - one[0], other[1] - one[1]];
            let length = along[0].hypot(along[1]);
            if length < 4.0 {
                continue;
            }
            let across = [-along[1] / length, along[0] / length];
            let line = (across, across[0] * one[0] + across[1] * one[1]);
            if distance(&line, &here) > FARTHEST {
                continue;
            }
            let near = points.iter().filter(|point| distance(&line, point) <= NEAR_LINE).count();
            if best.is_none_or(|(most, _)| near > most) {
                best = Some((near, line));
            }
        }
    }
    let (near, line) = best?;
    if near < FEWEST_POINTS {
        return None;
    }
    Some(settle(points.iter().filter(|point| distance(&line, point) <= NEAR_LINE)))
}

/// The line of least squared distances from some points.
fn settle<'a>(points: impl Iterator<Item = &'a [f32; 2]> + Clone) -> ([f32; 2], f32) {
    let count = points.clone().count() as f32;
    let mean = [0, 1].map(|axis| points.clone().map(|point| point[axis]).sum::<f32>() / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let (x, y) = (point[0] - mean[0], point[1] - mean[1]);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    // The main direction of the points; across it lies the normal.
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let across = [-angle.sin(), angle.cos()];
    (across, across[0] * mean[0] + across[1] * mean[1])
}
