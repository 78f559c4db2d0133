//! What a frame of 2304 x 1296 costs on one thread, against reading its bytes and against the source paper's pipeline.
//!
//! `cargo xtask bench` runs this. All stages take turns, one after the other in every round, and what is told are medians
//! over the rounds: of times, and of ratios of times within one round. So a machine that is busy with other things
//! slows both sides of a ratio alike. Arguments after `--`: the Python with OpenCV and its script, if there are any;
//! without, that row says so.
#![allow(missing_docs, reason = "a program")]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a benchmark that cannot be set up has nothing to measure"
)]

mod scenes;

use scenes::{WIDTH, render, scenes};
use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use nearfield_host::capture::{Frame, FrameView, Plane};
use nearfield_host::line_scan::LineScanEncoder;
use nearfield_host::paper::PaperMethod;
use nearfield_host::paper::heights::PaperHeights;
use nearfield_host::rig_file;
use nearfield_host::twin::View;
use nearfield_host::twin::gallery::{self, CENTRE};
use nearfield_host::vision::{Analyser, Extractor};
use nearfield_shared::rig::Rig;
use pulp::{Arch, Simd, WithSimd};

/// Rounds of which the medians are told.
const ROUNDS: usize = 41;
/// The slow stages run in every so manieth round.
const SLOW_STRIDE: usize = 8;
/// Goals: extraction in byte sums of the plane that it reads, the whole path in milliseconds, extraction from YUV420
/// against the paper's pipeline in OpenCV.
const GOALS: [(&str, f64); 2] = [("yuv420", 3.0), ("rgb8", 2.0)];
const WHOLE_PATH_GOAL_MS: f64 = 1.0;
const OPENCV_GOAL: f64 = 100.0;

/// What is measured.
struct Stage {
    layout: &'static str,
    scene: &'static str,
    name: &'static str,
    /// Runs it once; milliseconds if it measures itself.
    run: Box<dyn FnMut() -> Option<f64>>,
    is_slow: bool,
    /// Milliseconds by round.
    times: Vec<f64>,
}

impl Stage {
    fn new(
        layout: &'static str,
        scene: &'static str,
        name: &'static str,
        mut run: impl FnMut() + 'static,
    ) -> Self {
        let run = Box::new(move || {
            run();
            None
        });
        Self { layout, scene, name, run, is_slow: false, times: Vec::new() }
    }

    fn measure(&mut self) {
        // Once unmeasured: the stage before has left its own data in the caches.
        let _ = (self.run)();
        let started = Instant::now();
        let own = (self.run)();
        self.times.push(own.unwrap_or(started.elapsed().as_secs_f64() * 1e3));
    }

    fn is(&self, layout: &str, scene: &str, name: &str) -> bool {
        (self.layout, self.scene, self.name) == (layout, scene, name)
    }
}

/// The bytes of a plane, added up in the processor's best instructions: what merely reading it costs.
struct Sum<'a>(Plane<'a>);

impl WithSimd for Sum<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> u64 {
        let mut sum = 0;
        for row in 0..self.0.height() {
            // A row of the largest picture stays below 2^32.
            let mut of_row = 0_u32;
            for byte in self.0.row(row) {
                of_row += u32::from(*byte);
            }
            sum += u64::from(of_row);
        }
        sum
    }
}

fn sum(plane: Plane<'_>) -> u64 {
    Arch::new().dispatch(Sum(plane))
}

fn byte_sum(frame: Frame) -> impl FnMut() {
    move || {
        black_box(match black_box(frame.view()) {
            FrameView::Rgb(plane) | FrameView::Grey(plane) => sum(plane),
            FrameView::Yuv420 { red, .. } => sum(red),
            FrameView::Nv12 { chroma, .. } => sum(chroma),
        });
    }
}

fn stages(rig: &Rig) -> Vec<Stage> {
    let view = Arc::new(View::new(rig));
    let mut stages = Vec::new();
    for (scene, content) in scenes() {
        let rgb = render(rig, &view, &content);
        for (layout, frame) in [("yuv420", rgb.to_yuv420()), ("rgb8", rgb.clone())] {
            if scene == "clean" {
                stages.push(Stage::new(layout, "", "byte sum", byte_sum(frame.clone())));
            }
            let (mut extractor, seen) = (Extractor::new(rig).unwrap(), frame.clone());
            stages.push(Stage::new(layout, scene, "extraction", move || {
                extractor.extract(black_box(&seen.view())).unwrap();
            }));
            let (mut analyser, mut encoder) =
                (Analyser::new(rig).unwrap(), LineScanEncoder::new(rig).unwrap());
            stages.push(Stage::new(layout, scene, "whole path", move || {
                analyser.update(black_box(&frame.view())).unwrap();
                let extractor = analyser.extractor();
                black_box(encoder.encode(extractor.readings(), extractor.geometry()).len());
            }));
        }
        if scene == "clean" {
            let mut method = PaperMethod::new(rig, PaperHeights::of(rig, 0.0)).unwrap();
            let run = move || {
                black_box(method.update(black_box(&rgb)).unwrap());
            };
            stages.push(Stage { is_slow: true, ..Stage::new("rgb8", scene, "paper, this program", run) });
        }
    }
    stages
}

/// The paper's pipeline in OpenCV, in a process of its own that waits for a line before each run.
struct OpenCv {
    child: Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
}

impl OpenCv {
    /// Starts it with the clean picture; what is in the way as an error's text.
    fn start(python: &str, script: &str, rig: &Rig) -> Result<(Self, String), String> {
        let directory = tempfile::tempdir().map_err(|error| error.to_string())?;
        let (picture, rig_path) = (directory.path().join("clean.png"), directory.path().join("rig.toml"));
        let frame = render(rig, &Arc::new(View::new(rig)), &gallery::scene("clean").unwrap());
        let (width, height) = (u32::from(rig.image().width), u32::from(rig.image().height));
        image::save_buffer(&picture, &frame.to_rgb(), width, height, image::ExtendedColorType::Rgb8)
            .map_err(|error| error.to_string())?;
        std::fs::write(&rig_path, rig_file::to_toml(rig)).map_err(|error| error.to_string())?;
        let mut child = Command::new(python)
            .arg(script)
            .args([&picture, &rig_path])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{python}: {error}"))?;
        let mut lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
        match lines.next() {
            Some(Ok(line)) if line.starts_with("ready ") => {
                Ok((Self { child, lines }, line["ready ".len()..].to_owned()))
            }
            _ => Err(format!("{script} did not start")),
        }
    }

    fn run(&mut self) -> Option<f64> {
        writeln!(self.child.stdin.as_mut()?).ok()?;
        self.lines.next()?.ok()?.parse().ok()
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The median over the rounds in which both ran of one's time in the other's.
fn ratio(one: &Stage, other: &Stage) -> f64 {
    let stride = |stage: &Stage| if stage.is_slow { SLOW_STRIDE } else { 1 };
    let common = stride(one).max(stride(other));
    let of =
        |stage: &Stage| -> Vec<f64> { stage.times.iter().step_by(common / stride(stage)).copied().collect() };
    median(&of(one).iter().zip(of(other)).map(|(one, other)| one / other).collect::<Vec<_>>())
}

fn verdict(met: bool) -> &'static str {
    if met { "met" } else { "missed" }
}

fn report(stages: &[Stage]) {
    println!("one frame of {WIDTH} x 1296, one thread, medians of {ROUNDS} rounds");
    println!("| layout | scene | stage | ms | byte sums | goal |\n|---|---|---|---|---|---|");
    for stage in stages {
        let floor = stages.iter().find(|other| other.is(stage.layout, "", "byte sum"));
        let sums = floor.map(|floor| ratio(stage, floor));
        let time = median(&stage.times);
        let limit = GOALS.iter().find(|(layout, _)| *layout == stage.layout).map(|(_, limit)| *limit);
        let goal = match (stage.name, sums, limit) {
            ("extraction", Some(sums), Some(limit)) if stage.scene == "clean" => {
                format!("<= {limit:.0} byte sums: {}", verdict(sums <= limit))
            }
            ("whole path", ..) if stage.scene == "clean" => {
                format!("<= {WHOLE_PATH_GOAL_MS:.0} ms: {}", verdict(time <= WHOLE_PATH_GOAL_MS))
            }
            _ => String::new(),
        };
        let sums = sums.map_or(String::new(), |sums| format!("{sums:.1}"));
        println!("| {} | {} | {} | {time:.3} | {sums} | {goal} |", stage.layout, stage.scene, stage.name);
    }
    let find = |layout: &str, name: &str| stages.iter().find(|stage| stage.is(layout, "clean", name));
    if let (Some(opencv), Some(ours)) = (find("bgr8", "paper, OpenCV"), find("yuv420", "extraction")) {
        let times = ratio(opencv, ours);
        println!(
            "The paper's pipeline in OpenCV takes {times:.0} times as long as this program's extraction from YUV420 (goal: {OPENCV_GOAL:.0}): {}",
            verdict(times >= OPENCV_GOAL)
        );
    }
}

fn main() {
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let rig = CENTRE.with_width(WIDTH).rig().unwrap();
    let mut stages = stages(&rig);
    let mut note =
        "The paper's pipeline in OpenCV: not measured, no Python with OpenCV was given.".to_owned();
    if let [python, script] = &arguments[..] {
        match OpenCv::start(python, script, &rig) {
            Ok((mut opencv, version)) => {
                note = format!("OpenCV {version}, one thread.");
                stages.push(Stage {
                    run: Box::new(move || opencv.run()),
                    is_slow: true,
                    ..Stage::new("bgr8", "clean", "paper, OpenCV", || ())
                });
            }
            Err(error) => note = format!("The paper's pipeline in OpenCV: not measured: {error}."),
        }
    }
    for round in 0..ROUNDS {
        for stage in stages.iter_mut().filter(|stage| !stage.is_slow || round % SLOW_STRIDE == 0) {
            stage.measure();
        }
    }
    report(&stages);
    println!("{note}");
}
