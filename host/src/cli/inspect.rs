//! `nearfield inspect`: what host and safety controller make of single pictures.

use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use nearfield_shared::rig::Rig;

use super::mcu::{Examiner, McuChoice};
use super::picture_report::{PictureReport, Timing};
use crate::annotate;
use crate::capture::read_frame;
use crate::line_scan::LineScanEncoder;
use crate::paper;
use crate::rig_file;
use crate::vision::Analyser;
use crate::vision::grid::LASER_SHEET_MM;

/// Say what host and safety controller make of pictures, each by itself.
///
/// Every picture is shown as if the scene stood still: until the vote over three frames is full. The safety controller
/// is armed on a clean floor before each, and its verdict is its own. Exit code 2 if a picture cannot be used; the
/// others are still reported.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield inspect --rig robot.toml picture.png
  nearfield inspect --rig robot.toml --json *.png | jq .longest_gap_mm
  nearfield inspect --rig robot.toml --annotate seen/ frame.nv12 frame.srggb10p
  nearfield inspect --rig robot.toml --sheet-mm 7 led.png  a red LED's band instead of a laser")]
pub struct Inspect {
    /// The rig that took the pictures.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// One JSON object a picture on standard output.
    #[arg(long)]
    json: bool,
    /// Write the pictures with what was found drawn on them into this directory.
    #[arg(long, value_name = "DIR")]
    annotate: Option<PathBuf>,
    /// Which safety controller to ask.
    #[arg(long, value_enum, default_value_t)]
    mcu: McuChoice,
    /// Whose tier 1 tells stripe, gaps and cut-off; the safety controller always gets this project's.
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Whose heights the objects have; `paper` is its closed form, and its own objects.
    #[arg(long, value_enum, default_value_t)]
    height: Method,
    /// Thickness of the sheet of light at half of its brightness, millimetres: 1 is a line laser in focus; a red LED
    /// behind a slit gives 5 to 10.
    #[arg(long, default_value_t = LASER_SHEET_MM, value_name = "MM", value_parser = parse_sheet)]
    sheet_mm: f64,
    /// Pictures: PNG, JPEG, PGM, or raw frames of the rig's size: .yuv (YUV420 planar), .nv12, raw Bayer as V4L2 names it
    /// (.srggb10p and .srggb12p packed, .srggb10, .srggb12, .srggb16 in words; also sbggr, sgrbg, sgbrg).
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

fn parse_sheet(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(sheet) if (0.2..=40.0).contains(&sheet) => Ok(sheet),
        _ => Err("give 0.2 to 40 millimetres".to_owned()),
    }
}

/// This project's method, or the source paper's own for comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum Method {
    /// This project's.
    #[default]
    Ours,
    /// The source paper's: colour thresholds, Hough, top-down view, closed-form heights.
    Paper,
}

impl Inspect {
    /// Runs the command; the exit code is 2 if a picture cannot be used.
    ///
    /// # Errors
    /// The rig cannot be used, a drawing cannot be written, or the safety controller cannot be reached.
    pub fn run(&self) -> anyhow::Result<u8> {
        let rig = rig_file::load(&self.rig)?;
        let mut inspector = Inspector::new(&rig, self.sheet_mm, self.mcu, &self.rig)?;
        let mut drawings = self.annotate.as_deref().map(Drawings::new).transpose()?;
        let mut code = 0;
        for image in &self.images {
            let inspected = inspector.inspect(image)?.and_then(|report| self.compared(report, &rig, image));
            match inspected {
                Ok(report) => {
                    if self.json {
                        say!("{}", serde_json::to_string(&report)?);
                    } else {
                        say!("{}", table(&report).trim_end());
                    }
                    if let Some(drawings) = &mut drawings {
                        drawings.write(image, &inspector, &report)?;
                    }
                }
                Err(error) => {
                    eprintln!("error: {error:#}");
                    code = 2;
                }
            }
        }
        Ok(code)
    }
}

impl Inspect {
    /// The report with what the paper's method makes of the picture in place of ours, as far as that was asked for.
    fn compared(&self, mut report: PictureReport, rig: &Rig, image: &Path) -> anyhow::Result<PictureReport> {
        if self.method == Method::Ours && self.height == Method::Ours {
            return Ok(report);
        }
        let finding = paper::analyse(&read_frame(image, rig.image())?, rig)
            .with_context(|| image.display().to_string())?;
        if self.method == Method::Paper {
            report.replace_cutoff(&finding);
        }
        if self.height == Method::Paper {
            report.replace_heights(&finding);
        }
        Ok(report)
    }
}

/// Everything that looks at pictures of one rig.
struct Inspector {
    rig: Rig,
    analyser: Analyser,
    encoder: LineScanEncoder,
    examiner: Examiner,
    rgb: Vec<u8>,
}

impl Inspector {
    fn new(rig: &Rig, sheet_mm: f64, mcu: McuChoice, path: &Path) -> anyhow::Result<Self> {
        let name = || path.display().to_string();
        Ok(Self {
            rig: *rig,
            analyser: Analyser::with_sheet(rig, sheet_mm)
                .with_context(name)?
                .with_rig_deviation(rig_file::load_deviation(path)?.unwrap_or_default()),
            encoder: LineScanEncoder::new(rig).with_context(name)?,
            examiner: Examiner::new(mcu, rig)?,
            rgb: Vec::new(),
        })
    }

    /// The outer error ends the command, the inner one only this picture.
    fn inspect(&mut self, image: &Path) -> anyhow::Result<anyhow::Result<PictureReport>> {
        let mut timing = Timing::default();
        let mut started = Instant::now();
        let mut lap = || {
            let micros = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
            started = Instant::now();
            micros
        };
        let frame = match read_frame(image, self.rig.image()) {
            Ok(frame) => frame,
            Err(error) => return Ok(Err(error.into())),
        };
        timing.read = lap();
        if let Err(error) = self.analyser.judge(&frame.view()) {
            return Ok(Err(anyhow::Error::from(error).context(image.display().to_string())));
        }
        timing.vision = lap();
        let extractor = self.analyser.extractor();
        let columns = self.encoder.encode(extractor.readings(), extractor.geometry());
        timing.line_scan = lap();
        let verdict = self.examiner.judge(columns)?;
        timing.mcu = lap();
        self.rgb = frame.to_rgb();
        Ok(Ok(PictureReport::new(image.display().to_string(), &self.analyser, verdict, timing)))
    }
}

/// Where the drawings go.
struct Drawings {
    directory: PathBuf,
    /// Names used so far: pictures of the same name from different directories must not overwrite each other.
    used: HashSet<OsString>,
}

impl Drawings {
    fn new(directory: &Path) -> anyhow::Result<Self> {
        std::fs::create_dir_all(directory)
            .with_context(|| format!("{}: cannot make the directory", directory.display()))?;
        Ok(Self { directory: directory.to_path_buf(), used: HashSet::new() })
    }

    fn write(&mut self, image: &Path, inspector: &Inspector, report: &PictureReport) -> anyhow::Result<()> {
        let stem = image.file_stem().unwrap_or(image.as_os_str()).to_os_string();
        let mut name = stem.clone();
        let mut number = 2;
        while !self.used.insert(name.clone()) {
            name = stem.clone();
            name.push(format!("-{number}"));
            number += 1;
        }
        name.push(".png");
        let size = inspector.rig.image();
        let drawn = annotate::draw(&inspector.rgb, size, &inspector.analyser, report.mcu.is_closed());
        let path = self.directory.join(name);
        drawn.save(&path).with_context(|| format!("{}: cannot write the drawing", path.display()))
    }
}

/// A picture's findings for people.
fn table(report: &PictureReport) -> String {
    let mut text = format!(
        "{}\n  stripe    {}\n",
        report.image,
        match (report.stripe_found, report.cutoff) {
            (false, _) => "not found".to_owned(),
            (true, true) => format!("cut, longest gap {:.1} mm", report.longest_gap_mm),
            (true, false) if report.longest_gap_mm > 0.0 =>
                format!("whole (longest gap {:.1} mm, within the limit)", report.longest_gap_mm),
            (true, false) => "whole".to_owned(),
        }
    );
    for gap in &report.gaps {
        text += &format!(
            "  gap       {:8.1} to {:8.1} mm  {:6.1} mm long\n",
            gap.start_mm, gap.end_mm, gap.length_mm
        );
    }
    for object in &report.objects {
        let deviation =
            object.height_deviation_mm.map_or(String::new(), |deviation| format!(" +- {deviation:.1}"));
        let height = object
            .height_mm
            .map_or("height unknown".to_owned(), |height| format!("{height:.1}{deviation} mm high"));
        text += &format!(
            "  object    {:8.1} to {:8.1} mm  {height}, {}\n",
            object.start_mm, object.end_mm, object.size
        );
    }
    let causes = if report.mcu.causes.is_empty() {
        String::new()
    } else {
        format!(": {}", report.mcu.causes.join(", "))
    };
    text += &format!("  relay     {}{causes}\n", report.mcu.relay);
    text
}
