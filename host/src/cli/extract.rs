//! `nearfield extract`: the stripe in any picture, in pixels, without a rig.

use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use image::{Rgb, RgbImage};
use nearfield_shared::rig::ImageSize;
use serde::Serialize;

use crate::capture::{Frame, read_picture};
use crate::vision::unrigged::{Course, PictureStripe, find_stripe};

/// Find the laser's stripe in any pictures, in pixels; no rig is needed.
///
/// For each picture: is there a stripe, and if so its points (column, row; the centre of the top left pixel is 0, 0),
/// each with the probability that it is right within a pixel. A stripe from side to side has at most one point in every
/// column, one that runs down the picture at most one in every row. Exit code 2 if a picture cannot be used; the others
/// are still reported.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield extract photo.jpg
  nearfield extract --json *.png | jq '[.image, .stripe_found]'
  nearfield extract --annotate seen/ photo.jpg             the points in green on the picture
  nearfield extract --size 2304x1296 frame.nv12            raw frames do not tell their size")]
pub struct Extract {
    /// One JSON object a picture on standard output: image, stripe_found, columns, rows, confidence.
    #[arg(long)]
    json: bool,
    /// Write the pictures with the stripe's points drawn on them into this directory.
    #[arg(long, value_name = "DIR")]
    annotate: Option<PathBuf>,
    /// Size of raw frames; all pictures must then have it.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<ImageSize>,
    /// Pictures: PNG, JPEG, PGM, or raw frames: .yuv (YUV420 planar), .nv12, raw Bayer as V4L2 names it (.srggb10p and
    /// .srggb12p packed, .srggb10, .srggb12, .srggb16 in words; also sbggr, sgrbg, sgbrg).
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

fn parse_size(text: &str) -> Result<ImageSize, String> {
    let parts =
        text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    match parts {
        Some((width, height)) if width > 0 && height > 0 => Ok(ImageSize { width, height }),
        _ => Err("give columns and rows, as in 2304x1296".to_owned()),
    }
}

/// One picture's stripe as programs read it; the three lists have the same length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExtractReport {
    /// The picture's file name as given.
    pub image: String,
    /// Is there a stripe?
    pub stripe_found: bool,
    /// Image columns of its points, pixels.
    pub columns: Vec<f32>,
    /// Image rows of its points, pixels.
    pub rows: Vec<f32>,
    /// Probability that each row (or column, of a stripe that runs down the picture) is right within a pixel.
    pub confidence: Vec<f32>,
}

impl ExtractReport {
    /// Gathers what was found.
    #[must_use]
    pub fn new(image: String, stripe: Option<&PictureStripe>) -> Self {
        let points = stripe.map_or(&[][..], |stripe| &stripe.points);
        Self {
            image,
            stripe_found: stripe.is_some(),
            columns: points.iter().map(|point| thousandths(point.column)).collect(),
            rows: points.iter().map(|point| thousandths(point.row)).collect(),
            confidence: points.iter().map(|point| thousandths(point.confidence)).collect(),
        }
    }

    fn sentence(&self, stripe: Option<&PictureStripe>) -> String {
        let Some(stripe) = stripe else { return format!("{}: no stripe", self.image) };
        let mean = self.confidence.iter().sum::<f32>() / self.confidence.len().max(1) as f32;
        let range = |values: &[f32]| {
            let (low, high) = values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| {
                (low.min(*value), high.max(*value))
            });
            format!("{low:.1} to {high:.1}")
        };
        format!(
            "{}: stripe {}, {} points, columns {}, rows {}, mean confidence {mean:.2}",
            self.image,
            match stripe.course {
                Course::Across => "from side to side",
                Course::Down => "from top to bottom",
            },
            self.columns.len(),
            range(&self.columns),
            range(&self.rows),
        )
    }
}

/// More digits than the measurement has only make the output longer.
fn thousandths(value: f32) -> f32 {
    (value * 1000.0).round() / 1000.0
}

impl Extract {
    /// Runs the command; the exit code is 2 if a picture cannot be used.
    ///
    /// # Errors
    /// A drawing cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        if let Some(directory) = &self.annotate {
            std::fs::create_dir_all(directory)
                .with_context(|| format!("{}: cannot make the directory", directory.display()))?;
        }
        let mut used = HashSet::new();
        let mut code = 0;
        for image in &self.images {
            let frame = match read_picture(image, self.size) {
                Ok(frame) => frame,
                Err(error) => {
                    eprintln!("error: {error}");
                    code = 2;
                    continue;
                }
            };
            let stripe = find_stripe(&frame.view());
            let report = ExtractReport::new(image.display().to_string(), stripe.as_ref());
            if self.json {
                say!("{}", serde_json::to_string(&report)?);
            } else {
                say!("{}", report.sentence(stripe.as_ref()));
            }
            if let Some(directory) = &self.annotate {
                let path = directory.join(drawing_name(image, &mut used));
                draw(&frame, &report)
                    .save(&path)
                    .with_context(|| format!("{}: cannot write the drawing", path.display()))?;
            }
        }
        Ok(code)
    }
}

/// Pictures of the same name from different directories must not overwrite each other.
fn drawing_name(image: &Path, used: &mut HashSet<OsString>) -> OsString {
    let stem = image.file_stem().unwrap_or(image.as_os_str());
    let numbered = (2..).map(|number| {
        let mut name = stem.to_os_string();
        name.push(format!("-{number}.png"));
        name
    });
    let mut plain = stem.to_os_string();
    plain.push(".png");
    let mut names = std::iter::once(plain.clone()).chain(numbered);
    names.find(|name| used.insert(name.clone())).unwrap_or(plain)
}

/// From this confidence on a point is drawn as sure.
const SURE: f32 = 0.9;

/// Sure points are green, doubtful ones orange.
fn draw(frame: &Frame, report: &ExtractReport) -> RgbImage {
    let (width, height) = (u32::from(frame.size().width), u32::from(frame.size().height));
    let mut picture =
        RgbImage::from_raw(width, height, frame.to_rgb()).unwrap_or_else(|| RgbImage::new(width, height));
    let points = report.columns.iter().zip(&report.rows).zip(&report.confidence);
    for ((column, row), confidence) in points {
        let colour = if *confidence >= SURE { Rgb([0, 255, 80]) } else { Rgb([255, 160, 0]) };
        // `as` saturates: a row above the picture is drawn in its first.
        if let Some(pixel) = picture.get_pixel_mut_checked(column.round() as u32, row.round() as u32) {
            *pixel = colour;
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_positive_numbers_with_an_x_between() {
        assert_eq!(parse_size("2304x1296"), Ok(ImageSize { width: 2304, height: 1296 }));
        for wrong in ["", "2304", "x", "0x5", "5x0", "70000x5", "5x5x5", "-5x5", "5 x 5"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn drawings_of_pictures_with_one_name_get_different_names() {
        let mut used = HashSet::new();
        let names = ["a/frame.png", "b/frame.jpg", "c/frame.png"]
            .map(|path| drawing_name(Path::new(path), &mut used));
        assert_eq!(names, ["frame.png", "frame-2.png", "frame-3.png"].map(OsString::from));
    }
}
