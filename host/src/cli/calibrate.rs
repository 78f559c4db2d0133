//! `nearfield calibrate`: from pictures to a rig file, and whether a rig is still true.

mod folder;
mod report;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use nearfield_shared::rig::ImageSize;

use crate::calibrate::board::{Board, Pattern};
use crate::calibrate::drift::measure_drift;
use crate::calibrate::lens::{LensKnowledge, calibrate_lens};
use crate::calibrate::picture::{CalibrationPicture, common_size};
use crate::calibrate::session::{BlockPicture, Inputs, calibrate};
use crate::calibrate::verdict::{Grade, judge};
use crate::calibrate::world::WorldTie;
use crate::calibrate::{output, plot};
use crate::rig_file;

/// The result is there, but it is not good enough: a rig that drifted, a calibration that is not fit for use.
const NOT_GOOD: u8 = 1;

/// Calibrate camera and laser from pictures; check that a rig is still true.
///
/// One board (chessboard or ChArUco, printed, flat) and one or two blocks of known height are enough, and a few
/// minutes: put the board on the floor where the stripe runs and take a picture, take the board away and take one of
/// the stripe on the clean floor, then one of the stripe over each block.
#[derive(Debug, Args)]
pub struct CalibrateArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Lens(Lens),
    Rig(Box<RigFromPictures>),
    Check(Check),
}

/// Which board.
#[derive(Debug, Args)]
struct BoardArguments {
    /// The board: inner corners as 11x7, or charuco:COLUMNSxROWS:MARKER_SHARE:DICTIONARY (squares).
    #[arg(long, default_value = "11x7", value_name = "BOARD")]
    board: Pattern,
    /// Side of one square in millimetres; measure the print.
    #[arg(long, value_name = "MM", value_parser = positive)]
    square: f64,
}

impl BoardArguments {
    fn board(&self) -> Board {
        Board { pattern: self.board.clone(), square_mm: self.square }
    }
}

/// What is known of the lens.
#[derive(Debug, Args)]
struct LensArguments {
    /// A calibrated lens: a file of `calibrate lens`, or a rig file with this camera.
    #[arg(long, value_name = "LENS.toml")]
    lens: Option<PathBuf>,
    /// Without --lens: the lens's horizontal field of view in degrees, from its data sheet.
    #[arg(long, default_value_t = 66.0, value_name = "DEGREES", conflicts_with = "lens", value_parser = view_angle)]
    view: f64,
}

impl LensArguments {
    fn knowledge(&self, image: ImageSize) -> anyhow::Result<LensKnowledge> {
        Ok(match &self.lens {
            Some(path) => output::read_lens(path, image)?,
            None => LensKnowledge::nominal(image, self.view),
        })
    }
}

/// Calibrate the lens from many views of a board.
///
/// Ten to twenty views: near and far, in the middle and in the corners of the picture, tilted by 20 to 40 degrees to
/// all sides. Views in which the board is not found are left out and told. Once per camera and picture size.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Example:
  nearfield calibrate lens --square 25 --out lens.toml views/*.png")]
struct Lens {
    #[command(flatten)]
    board: BoardArguments,
    /// The lens's horizontal field of view in degrees, from its data sheet; a start for the fit.
    #[arg(long, default_value_t = 66.0, value_name = "DEGREES", value_parser = view_angle)]
    view: f64,
    /// Write the lens file here.
    #[arg(long, value_name = "LENS.toml")]
    out: Option<PathBuf>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
    /// Pictures of the board: PNG or JPEG.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

/// Calibrate a whole rig: floor, laser and, as far as it is not known, the lens.
///
/// Heights follow from the pictures alone. Where on the floor the robot stands does not: unless told otherwise (--camera-at,
/// --board-at) the world's origin is the floor below the camera and x runs along the stripe.
/// Exit code 0 if the rig is good or usable, 1 if it is not fit for use, 2 if the pictures cannot be used.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield calibrate rig --square 50 --lens lens.toml --floor board.png --stripe stripe.png \\
      --block 60=low.png --block 120=high.png --out robot.toml
  nearfield calibrate rig --square 50 --view 66 --folder pictures/ --out robot.toml --plots pictures/plots
In a folder the names tell what is what: board*, stripe*, block60* or step60* (a block of 60 mm), lens* (more views).")]
struct RigFromPictures {
    #[command(flatten)]
    board: BoardArguments,
    #[command(flatten)]
    lens: LensArguments,
    /// How far the board's print lies over the floor, millimetres.
    #[arg(long, default_value_t = 0.2, value_name = "MM", value_parser = not_negative)]
    board_thickness: f64,
    /// Take the pictures from this directory by their names.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["floor", "stripe", "block"])]
    folder: Option<PathBuf>,
    /// In the folder, only pictures with this in their name.
    #[arg(long, value_name = "TEXT", requires = "folder")]
    only: Option<String>,
    /// The board flat on the floor.
    #[arg(long, value_name = "IMAGE", required_unless_present = "folder")]
    floor: Option<PathBuf>,
    /// The stripe on the clean floor.
    #[arg(long, value_name = "IMAGE", required_unless_present = "folder")]
    stripe: Option<PathBuf>,
    /// The stripe over a block of this height; may be given several times.
    #[arg(long, value_name = "MM=IMAGE", value_parser = block)]
    block: Vec<(f64, PathBuf)>,
    /// How well the blocks' heights are known, one sigma, millimetres.
    #[arg(long, default_value_t = 0.1, value_name = "MM", value_parser = positive)]
    block_sigma: f64,
    /// Further views of the board, for the lens; may be given several times.
    #[arg(long, value_name = "IMAGE")]
    lens_view: Vec<PathBuf>,
    /// World place of the floor below the camera, millimetres.
    #[arg(long, value_name = "X,Y", value_parser = numbers::<2>, allow_hyphen_values = true)]
    camera_at: Option<[f64; 2]>,
    /// World place of the middle of the board's pattern, millimetres, and direction of its long side, degrees from x.
    #[arg(long, value_name = "X,Y,DEGREES", value_parser = numbers::<3>, allow_hyphen_values = true, conflicts_with = "camera_at")]
    board_at: Option<[f64; 3]>,
    /// Watch only this stretch of the stripe, millimetres in the rig's coordinate; otherwise all that is seen.
    #[arg(long, value_name = "START,END", value_parser = numbers::<2>, allow_hyphen_values = true)]
    watch: Option<[f64; 2]>,
    /// Write the rig file here.
    #[arg(long, value_name = "RIG.toml")]
    out: Option<PathBuf>,
    /// Write the compact form for the safety controller here (160 bytes).
    #[arg(long, value_name = "RIG.bin")]
    compact: Option<PathBuf>,
    /// Write drawings of residuals and uncertainty into this directory.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

/// Check that a rig is still true: the stripe on a clean floor must lie where the rig puts it.
///
/// Exit code 0 if it does, 1 if the rig has drifted, 2 if a picture cannot be used.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Example:
  nearfield calibrate check --rig robot.toml clean.png")]
struct Check {
    /// The rig.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// One JSON object a picture on standard output.
    #[arg(long)]
    json: bool,
    /// Pictures of the clean floor with the stripe.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
}

fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|value: &f64| value.is_finite() && *value > 0.0)
        .ok_or("must be greater than 0".to_owned())
}

fn not_negative(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|value: &f64| value.is_finite() && *value >= 0.0)
        .ok_or("must be 0 or more".to_owned())
}

fn view_angle(text: &str) -> Result<f64, String> {
    let angle = text.parse().ok().filter(|angle: &f64| (10.0..=150.0).contains(angle));
    angle.ok_or("must be 10 to 150 degrees".to_owned())
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|value: &f64| value.is_finite()))
        .collect();
    parsed
        .and_then(|values| values.try_into().ok())
        .ok_or(format!("must be {N} numbers with commas between them"))
}

fn block(text: &str) -> Result<(f64, PathBuf), String> {
    let (height, picture) = text.split_once('=').ok_or("must be HEIGHT=PICTURE, for instance 60=low.png")?;
    let height = positive(height).map_err(|problem| format!("the height `{height}` {problem}"))?;
    Ok((height, PathBuf::from(picture)))
}

impl CalibrateArguments {
    /// Does what was asked.
    ///
    /// # Errors
    /// Pictures or files that cannot be used; the message says which and what to do.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Lens(lens) => lens.run(),
            Command::Rig(rig) => rig.run(),
            Command::Check(check) => check.run(),
        }
    }
}

/// A bar on standard error; silent where that is no terminal.
fn progress_bar(steps: usize, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {elapsed}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps as u64).with_style(style).with_message(what)
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("{}: cannot write it", path.display()))
}

impl Lens {
    fn run(&self) -> anyhow::Result<u8> {
        let board = self.board.board();
        let bar = progress_bar(self.images.len(), "searching the board");
        let (mut views, mut size, mut left_out) = (Vec::new(), None, Vec::new());
        for path in &self.images {
            let picture = CalibrationPicture::read(path)?;
            let here = picture.size()?;
            if *size.get_or_insert(here) != here {
                bail!(
                    "{}: not of the same size as the first picture; use one camera setting",
                    path.display()
                );
            }
            match board.find(&picture) {
                Ok(view) => views.push(view),
                Err(problem) => left_out.push(problem.to_string()),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        for problem in &left_out {
            eprintln!("left out: {problem}");
        }
        let Some(image) = size else { bail!("no pictures; give views of the board") };
        let calibration = calibrate_lens(image, &views, &LensKnowledge::nominal(image, self.view))?;
        if let Some(path) = &self.out {
            write(path, output::lens_toml(image, &calibration).as_bytes())?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&report::LensReport::new(image, &calibration, left_out.len()))?);
        } else {
            say!("{}", report::lens_text(&calibration, left_out.len()).trim_end());
        }
        Ok(0)
    }
}

impl RigFromPictures {
    fn run(&self) -> anyhow::Result<u8> {
        let inputs = self.inputs()?;
        let bar = progress_bar(inputs.steps(), "calibrating");
        let result = calibrate(&inputs, |_| bar.inc(1));
        bar.finish_and_clear();
        let calibration = result?;
        let verdict = judge(&calibration);
        if let Some(path) = &self.out {
            write(path, output::rig_toml(&calibration, &verdict).as_bytes())?;
        }
        if let Some(path) = &self.compact {
            write(path, &calibration.rig.to_bytes())?;
        }
        if let Some(directory) = &self.plots {
            std::fs::create_dir_all(directory)
                .with_context(|| format!("{}: cannot make the directory", directory.display()))?;
            plot::draw_residuals(&calibration, &directory.join("residuals.svg"))?;
            plot::draw_uncertainty(&verdict, &directory.join("uncertainty.svg"))?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&report::RigReport::new(&calibration, &verdict))?);
        } else {
            say!("{}", report::rig_text(&calibration, &verdict).trim_end());
        }
        Ok(if verdict.grade == Grade::Unfit { NOT_GOOD } else { 0 })
    }

    fn inputs(&self) -> anyhow::Result<Inputs> {
        let files = match (&self.folder, &self.floor, &self.stripe) {
            (Some(folder), ..) => folder::Files::in_folder(folder, self.only.as_deref())?,
            (None, Some(floor), Some(stripe)) => folder::Files {
                floor: floor.clone(),
                stripe: stripe.clone(),
                blocks: self.block.clone(),
                lens_views: Vec::new(),
            },
            _ => bail!("give --floor and --stripe, or --folder"),
        };
        let read = |path: &PathBuf| CalibrationPicture::read(path);
        let (floor, stripe) = (read(&files.floor)?, read(&files.stripe)?);
        let blocks = files
            .blocks
            .iter()
            .map(|(height_mm, path)| Ok(BlockPicture { height_mm: *height_mm, picture: read(path)? }));
        let blocks = blocks.collect::<anyhow::Result<Vec<_>>>()?;
        let lens_views =
            files.lens_views.iter().chain(&self.lens_view).map(read).collect::<Result<Vec<_>, _>>()?;
        let image = common_size([&floor, &stripe])?.context("no pictures")?;
        let degrees = f64::to_radians;
        let tie = match (self.camera_at, self.board_at) {
            (Some(foot), _) => WorldTie::Camera { foot, stripe: 0.0 },
            (None, Some([x, y, angle])) => WorldTie::Board { middle: [x, y], long_side: degrees(angle) },
            (None, None) => WorldTie::default(),
        };
        Ok(Inputs {
            board: self.board.board(),
            board_thickness_mm: self.board_thickness,
            lens: self.lens.knowledge(image)?,
            floor,
            lens_views,
            stripe,
            blocks,
            block_sigma_mm: self.block_sigma,
            tie,
            watched: self.watch,
        })
    }
}

impl Check {
    fn run(&self) -> anyhow::Result<u8> {
        let rig = rig_file::load(&self.rig)?;
        let mut code = 0;
        for path in &self.images {
            let drift = CalibrationPicture::read(path).and_then(|picture| measure_drift(&rig, &picture));
            match drift {
                Ok(drift) => {
                    if self.json {
                        say!("{}", serde_json::to_string(&report::DriftReport::new(path, &drift))?);
                    } else {
                        say!("{}", report::drift_text(path, &drift).trim_end());
                    }
                    if drift.has_drifted() {
                        code = code.max(NOT_GOOD);
                    }
                }
                Err(error) => {
                    eprintln!("error: {error}");
                    code = super::BAD_INPUT;
                }
            }
        }
        Ok(code)
    }
}
