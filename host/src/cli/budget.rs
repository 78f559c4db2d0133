//! `nearfield budget`: response time, stopping distance, permitted speed.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Args;
use nearfield_configuration::Configuration;
use nearfield_configuration::budget::{HostTimes, ResponseTime, permitted_speed, stopping_distance};
use plotters::prelude::*;
use serde::Serialize;

use crate::run::rig;

/// The distance is too short for the robot's speed.
const TOO_FAST: u8 = 1;

/// Say how long the sensor takes, how far the robot then still goes, and how fast it may drive.
///
/// The response time is a sum of named parts, from the first interrupted light to the open circuit. The stopping distance
/// follows ISO 13855's S = K T + C with the robot's own motion and braking: S = (v + K)(T + brake delay) + v^2 / 2a + K v / a + C.
/// Exit code 1 if the robot's speed needs more room than there is between stripe and robot.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield budget
  nearfield budget --config nearfield.toml --svg budget.svg
  nearfield budget --distance 450 --json | jq .permitted_speed_mm_s")]
pub struct Budget {
    /// The configuration; the defaults without it.
    #[arg(long, value_name = "NEARFIELD.toml")]
    config: Option<PathBuf>,
    /// Distance from the stripe to the robot's front, millimetres; else the configuration's, else the rig's, else 500.
    #[arg(long, value_name = "MM")]
    distance: Option<f64>,
    /// Draw the parts and the permitted speed over the distance into this file.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Report {
    parts: Vec<PartReport>,
    vote_ms: f64,
    at_once_ms: Times,
    by_vote_ms: Times,
    distance_mm: f64,
    speed_mm_s: f64,
    stopping_distance_mm: f64,
    permitted_speed_mm_s: f64,
    sufficient: bool,
}

#[derive(Debug, Serialize)]
struct PartReport {
    name: &'static str,
    typical_ms: f64,
    worst_ms: f64,
    source: &'static str,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Times {
    typical: f64,
    worst: f64,
}

impl From<(f64, f64)> for Times {
    fn from((typical, worst): (f64, f64)) -> Self {
        Self { typical, worst }
    }
}

/// Without a rig: as in the source paper.
const USUAL_DISTANCE_MM: f64 = 500.0;

impl Budget {
    /// Runs the command; exit code 1 if the robot is too fast for the distance.
    ///
    /// # Errors
    /// The configuration or its rig cannot be used, or the drawing cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        let (configuration, response, distance_mm) = self.figures()?;
        let robot = &configuration.robot;
        let (_, worst) = response.by_vote();
        let needed = stopping_distance(robot, robot.speed_mm_s, worst);
        let report = Report {
            parts: response
                .parts
                .iter()
                .map(|part| PartReport {
                    name: part.name,
                    typical_ms: part.typical_ms,
                    worst_ms: part.worst_ms,
                    source: part.source,
                })
                .collect(),
            vote_ms: response.vote_ms,
            at_once_ms: response.at_once().into(),
            by_vote_ms: response.by_vote().into(),
            distance_mm,
            speed_mm_s: robot.speed_mm_s,
            stopping_distance_mm: needed,
            permitted_speed_mm_s: permitted_speed(robot, distance_mm, worst),
            sufficient: needed <= distance_mm,
        };
        if let Some(path) = &self.svg {
            draw(path, &configuration, &response, &report)?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&report)?);
        } else {
            say!("{}", table(&report).trim_end());
        }
        Ok(if report.sufficient { 0 } else { TOO_FAST })
    }

    fn figures(&self) -> anyhow::Result<(Configuration, ResponseTime, f64)> {
        let configuration = match &self.config {
            Some(path) => Configuration::load(path)?,
            None => Configuration::read("", Path::new("the defaults"))?,
        };
        let response = ResponseTime::of(&configuration, &HostTimes::ASSUMED);
        let distance = match (self.distance, configuration.robot.distance_mm, &self.config) {
            (Some(distance), ..) | (None, Some(distance), _) => distance,
            (None, None, Some(_)) => rig::of(&configuration)?.stripe().point.y,
            (None, None, None) => USUAL_DISTANCE_MM,
        };
        if !(1.0..=100_000.0).contains(&distance) {
            return Err(anyhow!("the distance of {distance} mm must be 1 to 100000 millimetres"));
        }
        Ok((configuration, response, distance))
    }
}

fn table(report: &Report) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{:<30} {:>8} {:>8}  from", "part, ms", "typical", "worst");
    for part in &report.parts {
        let _ = writeln!(
            text,
            "{:<30} {:>8.1} {:>8.1}  {}",
            part.name, part.typical_ms, part.worst_ms, part.source
        );
    }
    let sums =
        [("gap over 20 mm, no stripe", report.at_once_ms), ("gap of 5 mm, by vote", report.by_vote_ms)];
    for (name, times) in sums {
        let _ = writeln!(text, "{name:<30} {:>8.1} {:>8.1}", times.typical, times.worst);
    }
    let _ = writeln!(
        text,
        "\nAt {:.0} mm/s the robot needs {:.0} mm; there are {:.0} mm. Permitted speed: {:.0} mm/s.",
        report.speed_mm_s, report.stopping_distance_mm, report.distance_mm, report.permitted_speed_mm_s
    );
    if !report.sufficient {
        text.push_str("Too fast: slow down, brake harder, or move the stripe outward.\n");
    }
    text
}

/// Two pictures: the parts as a bar of time, and the permitted speed over the distance.
fn draw(
    path: &Path,
    configuration: &Configuration,
    response: &ResponseTime,
    report: &Report,
) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, (1000, 620)).into_drawing_area();
    let drawn = draw_on(&root, configuration, response, report)
        .and_then(|()| root.present().map_err(|error| anyhow!("{error}")));
    drawn.with_context(|| format!("{}: cannot draw the budget", path.display()))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw_on(
    root: &Area<'_>,
    configuration: &Configuration,
    response: &ResponseTime,
    report: &Report,
) -> anyhow::Result<()> {
    let fault = |error: DrawingAreaErrorKind<_>| anyhow!("{error}");
    root.fill(&WHITE).map_err(fault)?;
    let (upper, lower) = root.split_vertically(330);
    bars(&upper, response)?;
    let farthest = (2.0 * report.distance_mm).max(report.stopping_distance_mm * 1.3);
    let speed = |distance: f64, worst: f64| permitted_speed(&configuration.robot, distance, worst) / 1000.0;
    let (voted, at_once) = (report.by_vote_ms.worst, report.at_once_ms.worst);
    let mut chart = ChartBuilder::on(&lower)
        .margin(12)
        .caption("Permitted speed over the stripe's distance", ("sans-serif", 17))
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(0.0..farthest, 0.0..(1.1 * speed(farthest, at_once)).max(0.1))
        .map_err(fault)?;
    chart.configure_mesh().x_desc("mm").y_desc("m/s").draw().map_err(fault)?;
    for (worst, colour, name) in
        [(voted, BLUE, "gap of 5 mm, by vote"), (at_once, RGBColor(200, 110, 0), "gap over 20 mm")]
    {
        let points = (0..=200).map(|step| farthest * f64::from(step) / 200.0);
        chart
            .draw_series(LineSeries::new(points.map(|mm| (mm, speed(mm, worst))), colour.stroke_width(2)))
            .map_err(fault)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    let here = (report.distance_mm, report.speed_mm_s / 1000.0);
    let mark = if report.sufficient { GREEN } else { RED };
    chart
        .draw_series([Circle::new(here, 5, mark.filled())])
        .map_err(fault)?
        .label("this robot")
        .legend(move |(x, y)| Circle::new((x + 9, y), 5, mark.filled()));
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw().map_err(fault)?;
    Ok(())
}

/// The worst case as one bar a part, each beginning where the one before ends.
fn bars(area: &Area<'_>, response: &ResponseTime) -> anyhow::Result<()> {
    let fault = |error: DrawingAreaErrorKind<_>| anyhow!("{error}");
    let (_, total) = response.by_vote();
    let mut parts: Vec<(&str, f64)> = response.parts.iter().map(|part| (part.name, part.worst_ms)).collect();
    // The controller votes with the third picture's line-scan.
    let voted = parts.iter().position(|(name, _)| *name == "controller").unwrap_or(parts.len());
    parts.insert(voted, ("vote over three pictures (5 to 20 mm)", response.vote_ms));
    let rows = i32::try_from(parts.len()).unwrap_or(i32::MAX);
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .caption(format!("Worst response time: {total:.0} ms"), ("sans-serif", 17))
        .x_label_area_size(36)
        .build_cartesian_2d(0.0..total * 1.3, 0..rows)
        .map_err(fault)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .x_desc("ms from the first interrupted light")
        .draw()
        .map_err(fault)?;
    let mut begin = 0.0;
    for (row, (name, length)) in (0..).zip(parts) {
        let (bottom, end) = (rows - row - 1, begin + length);
        let bar = Rectangle::new([(begin, bottom), (end, bottom + 1)], RGBColor(90, 130, 200).filled());
        chart.draw_series([bar]).map_err(fault)?;
        let label = format!(" {name}: {length:.1}");
        let text = Text::new(label, (end, bottom + 1), ("sans-serif", 14).into_font());
        chart.draw_series([text]).map_err(fault)?;
        begin = end;
    }
    Ok(())
}
