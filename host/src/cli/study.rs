//! `nearfield twin study`: where to put camera and laser.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Args;
use nearfield_configuration::Configuration;
use nearfield_study::mount::Mount;
use nearfield_study::recommend::{Demand, Recommendation, recommend};
use nearfield_study::sweep::{Quantity, Sweep, sweep};
use plotters::prelude::{IntoDrawingArea as _, SVGBackend};
use serde::Serialize;

use crate::rig_file;

/// Study where to put camera and laser, and recommend a rig for a robot.
///
/// Sweeps height, place, tilt and lens around a mount and says what it resolves: rows that the stripe moves for a millimetre of
/// height, the uncertainty of a height, the narrowest object, the tallest height in the picture, shadows. Then tries all mounts that
/// the robot has room for and recommends the one that resolves heights best and still sees the whole zone, the smallest object
/// and the tallest height asked for. Writes into DIR: `study.json`, `study.md`, `placement.svg` and `recommended.toml`, a rig file to begin
/// with: calibrate the real one. Exit code 1 if no mount meets the demand.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield twin study --out study
  nearfield twin study --available 350 --zone 600 --speed 500 --object 8 --out study
  nearfield twin study --camera 300 --laser 120 --view 97 --distance 500 --zone 600 --out study")]
pub struct Study {
    /// Nothing can be mounted higher than this, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 500.0)]
    available: f64,
    /// Width of the zone before the robot, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 600.0)]
    zone: f64,
    /// Distance of the stripe from the robot's edge, millimetres; else what the speed needs.
    #[arg(long, value_name = "MM")]
    distance: Option<f64>,
    /// Greatest speed of the robot, mm/s; else the configuration's.
    #[arg(long, value_name = "MM/S")]
    speed: Option<f64>,
    /// Narrowest object that must stop the robot, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 7.0)]
    object: f64,
    /// Heights up to this must be measured, not only stopped at, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 60.0)]
    tallest: f64,
    /// Lenses to choose from, horizontal field of view in degrees; may be given several times.
    #[arg(long = "view", value_name = "DEGREES", default_values_t = [66.0, 102.0])]
    views: Vec<f64>,
    /// The camera's height, if it is fixed, millimetres.
    #[arg(long, value_name = "MM")]
    camera: Option<f64>,
    /// The laser's height, if it is fixed, millimetres.
    #[arg(long, value_name = "MM")]
    laser: Option<f64>,
    /// Columns of the camera's picture, which is 16:9.
    #[arg(long, value_name = "PIXELS", default_value_t = 2304, value_parser = clap::value_parser!(u16).range(256..=4608))]
    width: u16,
    /// The configuration: speed, braking, exposure, frame rate; the defaults without it.
    #[arg(long, value_name = "NEARFIELD.toml")]
    config: Option<PathBuf>,
    /// Directory to write into; it is made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// One JSON object on standard output instead of the table.
    #[arg(long)]
    json: bool,
}

/// No mount meets the demand.
const NONE_MEETS: u8 = 1;

#[derive(Serialize)]
struct Report<'a> {
    demand: &'a Demand,
    recommendation: Option<&'a Recommendation>,
    refused: Option<String>,
    reference: Mount,
    sweeps: &'a [Sweep],
}

impl Study {
    /// Runs the study; exit code 1 if nothing can be recommended.
    ///
    /// # Errors
    /// The configuration or an option cannot be used, a file cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        let configuration = match &self.config {
            Some(path) => Configuration::load(path)?,
            None => Configuration::read("", Path::new("the defaults"))?,
        };
        let demand = Demand {
            available_mm: self.available,
            zone_mm: self.zone,
            distance_mm: self.distance,
            speed_mm_s: self.speed,
            object_mm: self.object,
            tallest_mm: self.tallest,
            views_degrees: self.views.clone(),
            camera_height_mm: self.camera,
            laser_height_mm: self.laser,
            image: [self.width, self.width / 16 * 9],
        };
        let recommended = recommend(&demand, &configuration);
        if let Err(nearfield_study::recommend::NoMount::Demand { .. }) = &recommended {
            return Err(recommended.err().map_or_else(|| anyhow!("no recommendation"), Into::into));
        }
        let reference = Mount::PAPER;
        let sweeps: Vec<Sweep> =
            Quantity::ALL.into_iter().map(|quantity| sweep(&reference, quantity)).collect();
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make it", self.out.display()))?;
        let report = Report {
            demand: &demand,
            recommendation: recommended.as_ref().ok(),
            refused: recommended.as_ref().err().map(ToString::to_string),
            reference,
            sweeps: &sweeps,
        };
        let json = serde_json::to_string_pretty(&report)?;
        let words = words(&report);
        self.write("study.json", &json)?;
        self.write("study.md", &words)?;
        self.draw(&sweeps)?;
        if let Ok(found) = &recommended {
            self.write("recommended.toml", &rig_file::to_toml(&found.mount.rig()?))?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&report)?);
        } else {
            say!("{}", words.trim_end());
            say!(
                "\nWritten to {}: study.md, study.json, placement.svg{}",
                self.out.display(),
                if recommended.is_ok() { ", recommended.toml" } else { "" }
            );
        }
        Ok(if recommended.is_ok() { 0 } else { NONE_MEETS })
    }

    fn write(&self, name: &str, text: &str) -> anyhow::Result<()> {
        let path = self.out.join(name);
        std::fs::write(&path, text).with_context(|| format!("{}: cannot write", path.display()))
    }

    fn draw(&self, sweeps: &[Sweep]) -> anyhow::Result<()> {
        let path = self.out.join("placement.svg");
        let area = SVGBackend::new(&path, (1000, 1120)).into_drawing_area();
        nearfield_study::plot::draw(&area, sweeps)
            .and_then(|()| area.present())
            .map_err(|error| anyhow!("{}: cannot draw: {error}", path.display()))
    }
}

/// The study for people, in Markdown.
fn words(report: &Report<'_>) -> String {
    let mut text = String::from("# Placement study\n\n");
    // Writing to a String cannot fail.
    match (report.recommendation, &report.refused) {
        (Some(found), _) => recommendation(&mut text, found),
        (None, Some(refused)) => {
            let _ = writeln!(text, "**No mount can be recommended:** {refused}.");
        }
        (None, None) => {}
    }
    let mount = &report.reference;
    let _ = writeln!(
        text,
        "\n## What matters\n\nOne quantity varied around the source paper's mount (camera {:.0} mm, laser {:.0} mm, stripe {:.0} mm, {:.0} degrees), \
         the camera aimed at the stripe's middle; `placement.svg` draws them.\n\n\
         | quantity | from | to | rows per mm of height, middle | greatest over least |\n|---|---|---|---|---|",
        mount.camera_mm[2], mount.laser_mm[2], mount.distance_mm, mount.view_degrees
    );
    for sweep in report.sweeps {
        let (Some(first), Some(last)) = (sweep.points.first(), sweep.points.last()) else { continue };
        let _ = writeln!(
            text,
            "| {} | {:.0} | {:.0} | {:.2} to {:.2} | {:.1} |",
            sweep.quantity.label(),
            first.value,
            last.value,
            first.measures.middle_rows_per_mm,
            last.measures.middle_rows_per_mm,
            sweep.influence()
        );
    }
    text
}

fn recommendation(text: &mut String, found: &Recommendation) {
    let (mount, measures) = (&found.mount, &found.measures);
    let _ = writeln!(
        text,
        "{} of {} mounts meet the demand; the one that resolves heights best:\n\n\
         | what | value |\n|---|---|\n\
         | camera | {:.0} mm high, axis {:+.0} degrees from the stripe's middle, lens of {:.0} degrees |\n\
         | laser | {:.0} mm high |\n\
         | stripe | {:.0} mm from the robot, {:.0} mm long |\n\
         | rows per millimetre of height | {:.2} in the middle, {:.2} where least |\n\
         | uncertainty of a column's height, one sigma | {:.2} mm |\n\
         | narrowest flat object | {:.1} mm ({:.2} mm a column) |\n\
         | heights that stay in the picture | up to {:.0} mm |\n\
         | shadow of something 50 mm high | {:.0} mm |\n\
         | response time, worst, by vote | {:.0} ms |\n\
         | the speed needs | {:.0} mm |\n\
         | the distance permits | {:.0} mm/s |",
        found.sufficient,
        found.tried,
        mount.camera_mm[2],
        mount.tilt_degrees,
        mount.view_degrees,
        mount.laser_mm[2],
        mount.distance_mm,
        mount.zone_mm,
        measures.middle_rows_per_mm,
        measures.least_rows_per_mm,
        measures.height_sigma_mm,
        measures.narrowest_mm,
        measures.column_mm,
        measures.tallest_mm,
        measures.shadow_mm,
        found.response_ms,
        found.stopping_distance_mm,
        found.permitted_speed_mm_s
    );
    if found.permitted_speed_mm_s < 1.0 {
        text.push_str("\n**The distance is too short for any speed**: move the stripe outward, or see `nearfield budget`.\n");
    }
}
