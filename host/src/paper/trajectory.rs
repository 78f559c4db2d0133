//! The beam's central trajectory by a Hough transform of the mask.

use image::GrayImage;
use imageproc::hough::{LineDetectionOptions, PolarLine, detect_lines};

/// A line in the picture: `row = at_zero + slope * column`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trajectory {
    /// Row at column zero.
    pub at_zero: f32,
    /// Rows per column.
    pub slope: f32,
}

impl Trajectory {
    /// The row at a column.
    #[must_use]
    pub fn row(&self, column: f32) -> f32 {
        self.at_zero + self.slope * column
    }
}

/// A line has this many mask pixels, as a share of the picture's width.
const LEAST_VOTES: f32 = 0.05;
/// The transform has steps of one degree; mask pixels within this share of the width of its line refine it.
const REFINED_SHARE: f32 = 0.012;

/// The line with most votes, refined on the mask pixels near it. `None` where no line has enough.
#[must_use]
pub fn find(mask: &GrayImage) -> Option<Trajectory> {
    let width = mask.width() as f32;
    let thinned = column_middles(mask);
    let options =
        LineDetectionOptions { vote_threshold: (LEAST_VOTES * width) as u32, suppression_radius: 0 };
    let points: Vec<(f32, f32)> = thinned
        .enumerate_pixels()
        .filter(|(_, _, pixel)| pixel.0[0] > 0)
        .map(|(u, v, _)| (u as f32, v as f32))
        .collect();
    let reach = REFINED_SHARE * width;
    let near = |line: &Trajectory, reach: f32| -> Vec<(f32, f32)> {
        points.iter().copied().filter(|(u, v)| (line.row(*u) - v).abs() <= reach).collect()
    };
    // The crate does not tell votes: the line with most mask pixels near it is the one.
    let lines = detect_lines(&thinned, options);
    let mut best = lines.iter().filter_map(in_columns).max_by_key(|line| near(line, reach / 4.0).len())?;
    for part in [1.0, 2.0, 4.0] {
        best = least_squares(&near(&best, reach / part)).unwrap_or(best);
    }
    Some(best)
}

/// Steep lines are no stripe of a rig that is read column by column.
fn in_columns(line: &PolarLine) -> Option<Trajectory> {
    let (sine, cosine) = (line.angle_in_degrees as f32).to_radians().sin_cos();
    (sine.abs() > 0.3).then(|| Trajectory { at_zero: line.r / sine, slope: -cosine / sine })
}

/// The middle of each vertical run of the mask: a thick stripe must not vote for slanted lines through it.
fn column_middles(mask: &GrayImage) -> GrayImage {
    let (width, height) = mask.dimensions();
    let mut middles = GrayImage::new(width, height);
    for u in 0..width {
        let mut start = None;
        for v in 0..=height {
            let lit = v < height && mask.get_pixel(u, v).0[0] > 0;
            match (lit, start) {
                (true, None) => start = Some(v),
                (false, Some(first)) => {
                    middles.put_pixel(u, u32::midpoint(first, v - 1), image::Luma([255]));
                    start = None;
                }
                _ => {}
            }
        }
    }
    middles
}

fn least_squares(points: &[(f32, f32)]) -> Option<Trajectory> {
    let count = points.len() as f64;
    if count < 2.0 {
        return None;
    }
    let sum = points.iter().fold([0.0; 2], |sum, (u, v)| [sum[0] + f64::from(*u), sum[1] + f64::from(*v)]);
    let middle = sum.map(|sum| sum / count);
    let (mixed, square) = points.iter().fold((0.0, 0.0), |(mixed, square), (u, v)| {
        let away = f64::from(*u) - middle[0];
        (mixed + away * (f64::from(*v) - middle[1]), square + away * away)
    });
    let slope = mixed / square;
    slope
        .is_finite()
        .then(|| Trajectory { at_zero: (middle[1] - slope * middle[0]) as f32, slope: slope as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn the_longest_line_is_found_and_refined_beyond_one_degree() {
        let mask = GrayImage::from_fn(800, 400, |u, v| {
            let on = |row: f32, thick: f32| (v as f32 - row).abs() <= thick;
            let long = on(120.0 + 0.2345 * u as f32, 2.0);
            let short = u < 150 && on(300.0, 2.0);
            Luma([if long || short { 255 } else { 0 }])
        });
        let line = find(&mask).unwrap();
        assert!((line.slope - 0.2345).abs() < 0.002 && (line.at_zero - 120.0).abs() < 1.0, "{line:?}");
        assert_eq!(find(&GrayImage::new(800, 400)), None);
    }
}
