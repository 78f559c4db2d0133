//! The stripe in any picture, without a rig: where light of the laser's colour runs through the picture as a thin line.
//!
//! Nothing is known of where the stripe may be, how wide it is or how it runs, so it must prove itself by what a sheet
//! of light always does: it is a ridge that is redder *and* brighter than both sides (`candidates`), one for each
//! column, and it goes on from column to column, with jumps where it climbs onto things and holes where it is hidden
//! (`path`). The picture is searched by columns and by rows, because a stripe may also run down the picture; the
//! direction in which more is found counts. All is measured in samples of the picture itself: the contrast against
//! what texture and noise reach in the same picture, lengths against its size.

mod candidates;
mod path;

use super::signal::{Brightness, RedChroma, RedMinusGreen, Signal, Transposed};
use crate::capture::FrameView;
use candidates::Candidates;
use path::Path;

/// A point of the stripe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PicturePoint {
    /// Image column, pixels (integer = centre of a pixel).
    pub column: f32,
    /// Image row, pixels.
    pub row: f32,
    /// Probability that it lies within one sample (a pixel; two where the layout has chroma at half the resolution) of the
    /// stripe, 0 to 1: see `FIGURES-VISION.md`.
    pub confidence: f32,
}

/// How the stripe runs through the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Course {
    /// From side to side: at most one point in every column.
    Across,
    /// From top to bottom: at most one point in every row.
    Down,
}

/// A stripe, point by point along its course.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureStripe {
    /// How it runs.
    pub course: Course,
    /// Its points, by column or by row.
    pub points: Vec<PicturePoint>,
}

/// Looks for the stripe in a picture of any size; `None` if there is none.
#[must_use]
pub fn find_stripe(frame: &FrameView<'_>) -> Option<PictureStripe> {
    match frame {
        FrameView::Rgb(plane) => find_either_way(RedMinusGreen(*plane)),
        FrameView::Grey(plane) => find_either_way(Brightness(*plane)),
        FrameView::Yuv420 { luma, red, .. } => find_either_way(RedChroma::<1, 0> { red: *red, luma: *luma }),
        FrameView::Nv12 { luma, chroma } => find_either_way(RedChroma::<2, 1> { red: *chroma, luma: *luma }),
    }
}

fn find_either_way<S: Signal>(signal: S) -> Option<PictureStripe> {
    let across = find(signal);
    let down = find(Transposed(signal));
    let weight = |path: &Option<Path>| path.as_ref().map_or(0.0, Path::weight);
    let pixels = |sample: f32| sample * S::STEP as f32 + (S::STEP as f32 - 1.0) / 2.0;
    if weight(&across) >= weight(&down) {
        across.map(|path| PictureStripe {
            course: Course::Across,
            points: path
                .points()
                .map(|(along, offset, confidence)| PicturePoint {
                    column: pixels(along as f32),
                    row: pixels(offset),
                    confidence,
                })
                .collect(),
        })
    } else {
        down.map(|path| PictureStripe {
            course: Course::Down,
            points: path
                .points()
                .map(|(along, offset, confidence)| PicturePoint {
                    column: pixels(offset),
                    row: pixels(along as f32),
                    confidence,
                })
                .collect(),
        })
    }
}

fn find<S: Signal>(signal: S) -> Option<Path> {
    let candidates = Candidates::of(signal);
    Path::through(signal, &candidates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Frame, Pixels};
    use nearfield_shared::rig::ImageSize;

    const SIZE: ImageSize = ImageSize { width: 160, height: 120 };

    /// A grey, finely textured ground with a line of light (bell-shaped) or of paint (even) on it, whose middle lies at
    /// `offset(along)`.
    fn picture(down: bool, strength: f32, bell: bool, offset: impl Fn(f32) -> Option<f32>) -> Frame {
        let mut rgb = Vec::new();
        for row in 0..120_u16 {
            for column in 0..160_u16 {
                let (along, across) = if down { (row, column) } else { (column, row) };
                let distance = offset(f32::from(along)).map_or(f32::INFINITY, |at| f32::from(across) - at);
                let light =
                    if bell { (-distance * distance / 8.0).exp() } else { f32::from(distance.abs() < 7.0) };
                let grain = f32::from((row * 31 + column * 17 + row * column) % 7);
                let ground = 80.0 + grain;
                rgb.extend([ground + strength * light, ground, ground].map(|value| value as u8));
            }
        }
        Frame::new(SIZE, Pixels::Rgb(rgb)).unwrap()
    }

    fn farthest(stripe: &PictureStripe, offset: impl Fn(f32) -> f32) -> f32 {
        let distance = |point: &PicturePoint| match stripe.course {
            Course::Across => (point.row - offset(point.column)).abs(),
            Course::Down => (point.column - offset(point.row)).abs(),
        };
        stripe.points.iter().map(distance).fold(0.0, f32::max)
    }

    #[test]
    fn a_line_of_light_is_found_however_it_runs_to_half_a_pixel() {
        for (down, slope) in [(false, 0.0), (false, 0.4), (false, -0.4), (true, 0.0), (true, 0.3)] {
            let offset = |along: f32| 70.0 + slope * (along - 60.0);
            let frame = picture(down, 60.0, true, |along| Some(offset(along)));
            let stripe = find_stripe(&frame.view()).unwrap();
            assert_eq!(stripe.course == Course::Down, down);
            let length = if down { 120 } else { 160 };
            assert!(stripe.points.len() >= length * 8 / 10, "{} of {length} points", stripe.points.len());
            let worst = farthest(&stripe, offset);
            assert!(worst < 0.5, "slope {slope}, down {down}: {worst} pixels");
        }
    }

    #[test]
    fn chroma_planes_give_the_same_line_in_pixels_of_the_picture() {
        let frame = picture(false, 90.0, true, |_| Some(60.3));
        for frame in [frame.to_yuv420(), frame.to_nv12()] {
            let stripe = find_stripe(&frame.view()).unwrap();
            let worst = farthest(&stripe, |_| 60.3);
            assert!(worst < 0.5, "{worst} pixels");
        }
    }

    #[test]
    fn holes_stay_empty_and_jumps_are_followed() {
        let offset = |along: f32| match along as u32 {
            0..50 => Some(40.0),
            50..70 => None,
            70..110 => Some(75.0),
            _ => Some(40.0),
        };
        let stripe = find_stripe(&picture(false, 70.0, true, offset).view()).unwrap();
        for point in &stripe.points {
            let truth = offset(point.column);
            assert!(truth.is_some_and(|row| (row - point.row).abs() < 0.5), "{point:?}, true {truth:?}");
        }
        let raised = stripe.points.iter().filter(|point| point.row > 70.0).count();
        assert!(raised >= 36, "{raised} of 40 raised points");
    }

    #[test]
    fn the_middle_of_a_bleached_stripe_is_found_between_its_flanks() {
        // A camera close by: thirty pixels wide, and where the colour's scale ends green goes on rising.
        let size = ImageSize { width: 400, height: 600 };
        let offset = |column: f32| 300.0 + 0.1 * (column - 200.0);
        let mut rgb = Vec::new();
        for row in 0..600_u16 {
            for column in 0..400_u16 {
                let distance = f32::from(row) - offset(f32::from(column));
                let light = 900.0 * (-distance * distance / 180.0).exp();
                let grain = f32::from((row * 31 + column * 17) % 7);
                let red = 60.0 + grain + light;
                let green = 60.0 + grain + (light - 300.0).max(0.0) / 8.0;
                rgb.extend([red, green, green].map(|value| value.min(255.0) as u8));
            }
        }
        let stripe = find_stripe(&Frame::new(size, Pixels::Rgb(rgb)).unwrap().view()).unwrap();
        assert!(stripe.points.len() >= 360, "{} of 400 points", stripe.points.len());
        let worst = farthest(&stripe, offset);
        assert!(worst < 1.0, "{worst} pixels");
    }

    #[test]
    fn a_red_cable_that_hangs_across_a_part_of_the_picture_is_no_stripe() {
        let hanging = |along: f32| (along < 50.0).then_some(40.0 + 0.03 * (along - 25.0) * (along - 25.0));
        assert_eq!(find_stripe(&picture(false, 90.0, true, hanging).view()), None);
        let whole = |along: f32| Some(20.0 + 0.003 * (along - 10.0) * (along - 10.0));
        assert!(find_stripe(&picture(false, 90.0, true, whole).view()).is_some());
    }

    #[test]
    fn neither_texture_nor_paint_nor_a_short_reflex_is_a_stripe() {
        let nothing = picture(false, 0.0, true, |_| None);
        assert_eq!(find_stripe(&nothing.view()), None);
        let paint = picture(false, 60.0, false, |_| Some(60.0));
        assert_eq!(find_stripe(&paint.view()), None);
        let reflex = picture(false, 60.0, true, |along| (along < 20.0).then_some(60.0));
        assert_eq!(find_stripe(&reflex.view()), None);
        // Red pigment on white takes green and blue away and adds no light.
        let mut pigment = picture(false, 60.0, true, |_| Some(60.0)).to_rgb();
        for pixel in pigment.chunks_exact_mut(3) {
            let excess = pixel[0] - pixel[1];
            (pixel[0], pixel[1], pixel[2]) = (200, 200 - excess, 200 - excess);
        }
        let pigment = Frame::new(SIZE, Pixels::Rgb(pigment)).unwrap();
        assert_eq!(find_stripe(&pigment.view()), None);
    }

    #[test]
    fn the_smallest_pictures_have_no_stripe_and_do_no_harm() {
        for (width, height) in [(1, 1), (1, 200), (200, 1), (5, 5), (8, 300)] {
            let size = ImageSize { width, height };
            let bytes = vec![9; 3 * usize::from(width) * usize::from(height)];
            let frame = Frame::new(size, Pixels::Rgb(bytes)).unwrap();
            assert_eq!(find_stripe(&frame.view()), None, "{width} x {height}");
        }
    }
}
