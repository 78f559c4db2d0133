//! The whole rig from one board on the floor, the clean stripe and blocks of known height.

use nearfield_shared::camera::{Camera, Pixel};
use nearfield_shared::rig::{ImageSize, Rig};

use super::CalibrationError;
use super::board::{Board, BoardView};
use super::fit::{Fit, fit};
use super::lens::LensKnowledge;
use super::model::{Level, Model, Observations, Sheet, StripePoint};
use super::picture::{CalibrationPicture, common_size};
use super::pose::first_pose;
use super::refusal::{crooked, no_block, no_stripe, unfixed};
use super::shadow::{Apex, ShadowRay, find_apex, shadow_rays};
use super::sheet::{
    FloorLine, Placed, find_floor_line, find_top, loose_tolerance, on_line, placed, stripe_points,
};
use super::stripe::{Candidate, candidates};
use super::world::{Placement, WorldTie, rig_of};

/// Points kept of each level: neighbours share their speckle, so that more of them tell nothing new.
const MOST_POINTS: usize = 300;
/// Rounds of choosing points and fitting; the choice stands still after two.
const ROUNDS: usize = 3;
/// Once the lens is known, the stripe lies within this many sigmas of its line.
const TIGHT_SIGMAS: f64 = 6.0;
/// A stripe on a flat floor under a known lens lies on its line to this, pixels at 2304 columns.
const LARGEST_STRIPE_NOISE: f64 = 2.0;
/// Sizes of squares tried on either side of the stated one, up to its half and its double.
const SQUARE_STEPS: i32 = 12;
/// The stripe's end is where this many of its points ...
const END_POINTS: usize = 24;
/// ... cover this share of their columns.
const DENSE_END: f64 = 0.8;
/// The watched stretch ends this much before the stripe does, millimetres.
const END_MARGIN_MM: f64 = 3.0;
/// Blocks and their pictures contradict each other if the sheets that they give differ by more than this, as a ratio.
const LARGEST_SLANT_RATIO: f64 = 1.1;
/// The fit reproduces a block's height to this, millimetres, or something that was stated is wrong.
const LARGEST_BLOCK_ERROR_MM: f64 = 0.5;

/// A picture of the stripe over a block.
#[derive(Debug, Clone)]
pub struct BlockPicture {
    /// The block's height, millimetres.
    pub height_mm: f64,
    /// The picture.
    pub picture: CalibrationPicture,
}

/// Everything that goes into a calibration.
#[derive(Debug, Clone)]
pub struct Inputs {
    /// The board.
    pub board: Board,
    /// Thickness of the board: its print lies this much over the floor, millimetres.
    pub board_thickness_mm: f64,
    /// The board flat on the floor, laser on or off.
    pub floor: CalibrationPicture,
    /// Further views of the same board, for the lens; may be empty.
    pub lens_views: Vec<CalibrationPicture>,
    /// The stripe on the clean floor.
    pub stripe: CalibrationPicture,
    /// The stripe over blocks of known height.
    pub blocks: Vec<BlockPicture>,
    /// How well a block's height is known, one sigma, millimetres.
    pub block_sigma_mm: f64,
    /// What is known of the lens.
    pub lens: LensKnowledge,
    /// What ties the floor to the robot.
    pub tie: WorldTie,
    /// Watched stretch in the rig's coordinate, millimetres; where `None`, all that is seen of the stripe.
    pub watched: Option<[f64; 2]>,
}

/// What a block's picture gave.
#[derive(Debug, Clone)]
pub struct BlockFinding {
    /// Stated height, millimetres.
    pub stated_mm: f64,
    /// Height of the stripe on it by the finished calibration, millimetres; `None` where its top was not found.
    pub measured_mm: Option<f64>,
    /// Columns in which the stripe on its top was used.
    pub columns: usize,
    /// Why it was not used.
    pub problem: Option<String>,
}

/// A finished calibration.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The rig.
    pub rig: Rig,
    /// The fit behind it.
    pub fit: Fit,
    /// The pixels that it was fitted to.
    pub observations: Observations,
    /// Root of the mean squared error of the floor board's corners, pixels.
    pub board_error: f64,
    /// Corners found of those expected.
    pub corners: [usize; 2],
    /// What the blocks gave, in the order of the inputs.
    pub blocks: Vec<BlockFinding>,
    /// The laser's apex.
    pub apex: Apex,
    /// Places along the sheet of the watched stretch.
    pub extent: [f64; 2],
    /// What to add to a place along the sheet for the rig's stripe coordinate.
    pub place_shift: f64,
    /// The lens was known to what extent?
    pub lens: LensKnowledge,
}

/// Stages, for progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// A picture of the board was searched.
    Board,
    /// A picture of the stripe was searched.
    Stripe,
    /// A round of fitting is done.
    Fit,
}

impl Inputs {
    /// How often [`calibrate`] will call its progress function.
    #[must_use]
    pub fn steps(&self) -> usize {
        1 + self.lens_views.len() + 1 + self.blocks.len() + ROUNDS
    }

    /// The size that all pictures have.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn size(&self) -> Result<ImageSize, CalibrationError> {
        let pictures = [&self.floor, &self.stripe].into_iter().chain(&self.lens_views);
        let all = pictures.chain(self.blocks.iter().map(|block| &block.picture));
        let size = common_size(all)?;
        size.ok_or_else(|| {
            CalibrationError::Degenerate("no pictures; give a board, a stripe and a block".to_owned())
        })
    }
}

/// Calibrates a rig; `progress` is called after each step.
///
/// # Errors
/// [`CalibrationError`] says which picture or statement is at fault and what to do.
pub fn calibrate(inputs: &Inputs, mut progress: impl FnMut(Stage)) -> Result<Calibration, CalibrationError> {
    let image = inputs.size()?;
    let mut views = Vec::new();
    for picture in std::iter::once(&inputs.floor).chain(&inputs.lens_views) {
        views.push(inputs.board.find(picture)?);
        progress(Stage::Board);
    }
    let mut seen = Seen::new(inputs, &mut progress);
    let (estimate, observations, problems) = match joint_fit(inputs, &views, &mut seen, &mut progress) {
        Err(CalibrationError::Contradiction(told)) => {
            let hint = fitting_square(inputs, &views, &mut seen).map_or(String::new(), |square| {
                format!("; the pictures agree with each other if the squares are {square:.1} mm")
            });
            return Err(CalibrationError::Contradiction(told + &hint));
        }
        result => result?,
    };
    finish(inputs, image, &views[0], estimate, observations, &seen, problems)
}

/// Chooses stripe points and fits, in turn.
fn joint_fit(
    inputs: &Inputs,
    views: &[BoardView],
    seen: &mut Seen,
    progress: &mut impl FnMut(Stage),
) -> Result<(Fit, Observations, Vec<Option<String>>), CalibrationError> {
    let image = inputs.size()?;
    let mut estimate = board_fit(inputs, views)?;
    let mut observations = Observations::default();
    let mut problems = Vec::new();
    let mut loose = loose_tolerance(f64::from(image.width));
    for round in 0..ROUNDS {
        let (model, blocks) = seen.choose(&estimate.model, inputs, loose)?;
        observations = Observations {
            boards: views.iter().map(|view| view.corners.clone()).collect(),
            board_height: inputs.board_thickness_mm,
            levels: seen.levels(inputs),
        };
        problems = blocks;
        estimate = fit(&model, &observations, &inputs.lens).ok_or_else(unfixed)?;
        loose = loose.min((TIGHT_SIGMAS * estimate.stripe_noise).max(1.5));
        if round == 0 {
            check_slants(&seen.tops)?;
        } else if round + 1 == ROUNDS {
            check_blocks(inputs, &estimate, seen)?;
        }
        if estimate.stripe_noise > LARGEST_STRIPE_NOISE * (f64::from(image.width) / 2304.0).max(0.5) {
            return Err(crooked(inputs, estimate.stripe_noise));
        }
        progress(Stage::Fit);
    }
    Ok((estimate, observations, problems))
}

/// The size of the board's squares for which two blocks agree about the laser's sheet, if there is one between half
/// and double the stated size.
fn fitting_square(inputs: &Inputs, views: &[BoardView], seen: &mut Seen) -> Option<f64> {
    let tolerance = loose_tolerance(f64::from(inputs.size().ok()?.width)) / 2.0;
    let mut disagreement = |factor: f64| {
        let scaled: Vec<BoardView> = views.iter().map(|view| view.scaled(factor)).collect();
        let estimate = board_fit(inputs, &scaled).ok()?;
        seen.choose(&estimate.model, inputs, tolerance).ok()?;
        match seen.tops.as_slice() {
            [(_, _, one), .., (_, _, other)] => Some((one / other).ln()),
            _ => None,
        }
    };
    let mut last: Option<(f64, f64)> = None;
    for step in -SQUARE_STEPS..=SQUARE_STEPS {
        let factor = (f64::from(step) / f64::from(SQUARE_STEPS) * std::f64::consts::LN_2).exp();
        let Some(here) = disagreement(factor) else { continue };
        if let Some((before, there)) = last
            && there * here <= 0.0
        {
            let crossing = before + (factor - before) * there / (there - here);
            return Some(crossing * inputs.board.square_mm);
        }
        last = Some((factor, here));
    }
    None
}

/// Lens and poses from the boards alone.
fn board_fit(inputs: &Inputs, views: &[BoardView]) -> Result<Fit, CalibrationError> {
    let lens = inputs.lens.expected();
    let poses = views.iter().map(|view| {
        first_pose(&lens, &view.corners).ok_or_else(|| {
            CalibrationError::Degenerate(format!("{}: the board's pose cannot be told from it", view.name))
        })
    });
    let start = Model { lens, poses: poses.collect::<Result<_, _>>()?, sheet: None, heights: Vec::new() };
    let observations = Observations {
        boards: views.iter().map(|view| view.corners.clone()).collect(),
        board_height: inputs.board_thickness_mm,
        levels: Vec::new(),
    };
    fit(&start, &observations, &inputs.lens).ok_or_else(unfixed)
}

/// The stripe's candidates in all pictures, and what was chosen of them last.
struct Seen {
    stripe: Vec<Candidate>,
    blocks: Vec<Vec<Candidate>>,
    floor: Vec<Placed>,
    /// Index of the block, stripe on its top, slant that it alone gives.
    tops: Vec<(usize, Vec<Placed>, f64)>,
    line: FloorLine,
}

impl Seen {
    fn new(inputs: &Inputs, progress: &mut impl FnMut(Stage)) -> Self {
        let mut look = |picture: &CalibrationPicture| {
            let found = candidates(picture);
            progress(Stage::Stripe);
            found
        };
        let stripe = look(&inputs.stripe);
        let blocks = inputs.blocks.iter().map(|block| look(&block.picture)).collect();
        let line = FloorLine { heading: 0.0, distance: 0.0 };
        Self { stripe, blocks, floor: Vec::new(), tops: Vec::new(), line }
    }

    /// Chooses stripe points by a camera that is known so far; returns the model to start the next fit from and, for
    /// each block, why it cannot be used.
    fn choose(
        &mut self,
        known: &Model,
        inputs: &Inputs,
        tolerance: f64,
    ) -> Result<(Model, Vec<Option<String>>), CalibrationError> {
        let camera = known.camera().ok_or_else(unfixed)?;
        let width = f64::from(inputs.size()?.width);
        let on_floor = placed(&camera, &self.stripe, 0.0);
        self.line = find_floor_line(&camera, &on_floor, width).ok_or_else(|| no_stripe(inputs))?;
        self.floor = on_line(&on_floor, &self.line, tolerance);
        self.tops.clear();
        let mut problems = Vec::new();
        for (index, (block, found)) in inputs.blocks.iter().zip(&self.blocks).enumerate() {
            let off_floor = off_line(&camera, found, &self.line, 2.0 * tolerance);
            match find_top(&placed(&camera, &off_floor, block.height_mm), &self.line, tolerance) {
                Ok(top) => {
                    let slant = (self.line.distance - top.line.distance) / block.height_mm;
                    self.tops.push((index, top.points, slant));
                    problems.push(None);
                }
                Err(problem) => problems.push(Some(problem)),
            }
        }
        if self.tops.is_empty() {
            return Err(no_block(inputs, &problems));
        }
        let slant = self.tops.iter().map(|(_, _, slant)| slant).sum::<f64>() / self.tops.len() as f64;
        let sheet = Sheet { heading: self.line.heading, distance: self.line.distance, slant };
        let mut heights = vec![0.0];
        heights.extend(self.tops.iter().map(|(index, _, _)| inputs.blocks[*index].height_mm));
        Ok((Model { sheet: Some(sheet), heights, ..known.clone() }, problems))
    }

    /// The chosen points for the fit: the floor first, then the tops.
    fn levels(&self, inputs: &Inputs) -> Vec<Level> {
        let floor = Level { height: 0.0, height_sigma: 0.0, points: thinned(&self.floor, &self.line) };
        let tops = self.tops.iter().map(|(index, points, _)| Level {
            height: inputs.blocks[*index].height_mm,
            height_sigma: inputs.block_sigma_mm,
            points: thinned(points, &self.line),
        });
        std::iter::once(floor).chain(tops).collect()
    }
}

fn thinned(points: &[Placed], line: &FloorLine) -> Vec<StripePoint> {
    let stride = points.len().div_ceil(MOST_POINTS).max(1);
    stripe_points(points, line).into_iter().step_by(stride).collect()
}

/// Candidates that are not on the floor's stripe.
fn off_line(camera: &Camera, found: &[Candidate], line: &FloorLine, tolerance: f64) -> Vec<Candidate> {
    let floor = placed(camera, found, 0.0);
    let on_floor: Vec<Pixel> = on_line(&floor, line, tolerance).iter().map(|placed| placed.pixel).collect();
    found.iter().copied().filter(|candidate| !on_floor.contains(&candidate.pixel)).collect()
}

/// Do the blocks agree about the sheet?
fn check_slants(tops: &[(usize, Vec<Placed>, f64)]) -> Result<(), CalibrationError> {
    let slants = tops.iter().map(|(_, _, slant)| *slant);
    let (least, most) =
        slants.fold((f64::INFINITY, 0.0_f64), |(least, most), slant| (least.min(slant), most.max(slant)));
    if most > LARGEST_SLANT_RATIO * least {
        return Err(CalibrationError::Contradiction(format!(
            "the blocks contradict each other: the laser's sheet would shift by {least:.2} mm per millimetre of \
             height by one and by {most:.2} by another; check each block's height (--block HEIGHT=PICTURE), whether \
             they are mixed up, and the board's square size (--square)"
        )));
    }
    Ok(())
}

/// Does the fit reproduce the stated heights? With two blocks it cannot if the board's squares are not as stated.
fn check_blocks(inputs: &Inputs, estimate: &Fit, seen: &Seen) -> Result<(), CalibrationError> {
    let told: Vec<String> = seen
        .tops
        .iter()
        .filter_map(|(index, points, _)| {
            let stated = inputs.blocks[*index].height_mm;
            let measured = median_height(&estimate.model, points)?;
            let allowed = LARGEST_BLOCK_ERROR_MM.max(5.0 * inputs.block_sigma_mm);
            ((measured - stated).abs() > allowed)
                .then(|| format!("the block of {stated} mm comes out as {measured:.2} mm"))
        })
        .collect();
    if told.is_empty() {
        return Ok(());
    }
    Err(CalibrationError::Contradiction(format!(
        "board and blocks contradict each other: {}; measure the board's squares (--square {}) and the blocks again",
        told.join(", "),
        inputs.board.square_mm
    )))
}

/// Height of the stripe on a block by a model, millimetres.
fn median_height(model: &Model, points: &[Placed]) -> Option<f64> {
    let mut heights: Vec<f64> =
        points.iter().filter_map(|point| super::uncertainty::measured_height(model, point.pixel)).collect();
    heights.sort_by(f64::total_cmp);
    heights.get(heights.len() / 2).copied()
}

fn finish(
    inputs: &Inputs,
    image: ImageSize,
    board: &BoardView,
    estimate: Fit,
    observations: Observations,
    seen: &Seen,
    problems: Vec<Option<String>>,
) -> Result<Calibration, CalibrationError> {
    let (camera, sheet) = estimate.model.camera().zip(estimate.model.sheet).ok_or_else(unfixed)?;
    let rays = all_rays(inputs, &camera, &sheet, seen);
    let centre = camera.pose.centre();
    let foot = nalgebra::Point3::new(centre.x, centre.y, 0.0);
    let camera_across = sheet.miss(foot) + sheet.distance;
    let apex = find_apex(&sheet, &rays, sheet.place(foot), camera_across);
    let seen_extent = seen_extent(&camera, &sheet, &seen.floor);
    let spread = |axis: usize| {
        let places = board.corners.iter().map(|corner| corner.place[axis]);
        places.fold(0.0_f64, |most, place| most.max(place.abs()))
    };
    let long_side_is_y = spread(1) > spread(0);
    let mut placement = Placement { tie: inputs.tie, long_side_is_y, apex, extent: seen_extent };
    let mut rig = rig_of(image, &estimate.model, &placement).ok_or_else(unfixed)??;
    let place_shift = rig.stripe().start - seen_extent[0];
    if let Some(watched) = inputs.watched {
        placement.extent = watched.map(|place| place - place_shift);
        rig = rig_of(image, &estimate.model, &placement).ok_or_else(unfixed)??;
    }
    let blocks = findings(inputs, &estimate, seen, problems);
    Ok(Calibration {
        rig,
        board_error: super::lens::view_error(&estimate.model, 0, &board.corners, inputs.board_thickness_mm),
        corners: [board.corners.len(), board.expected],
        fit: estimate,
        observations,
        blocks,
        apex,
        extent: placement.extent,
        place_shift,
        lens: inputs.lens,
    })
}

/// The shadows of all blocks.
fn all_rays(inputs: &Inputs, camera: &Camera, sheet: &Sheet, seen: &Seen) -> Vec<ShadowRay> {
    let line = FloorLine { heading: sheet.heading, distance: sheet.distance };
    let mut rays = Vec::new();
    for (index, points, _) in &seen.tops {
        let found = &seen.blocks[*index];
        let floor = on_line(&placed(camera, found, 0.0), &line, 3.0);
        let top: Vec<Pixel> = points.iter().map(|point| point.pixel).collect();
        let mut others = off_line(camera, found, &line, 3.0);
        others.retain(|candidate| !top.contains(&candidate.pixel));
        rays.extend(shadow_rays(sheet, inputs.blocks[*index].height_mm, points, &floor, &others));
    }
    rays
}

/// The stretch of floor on which the stripe is seen in most columns, a little pulled in: noise beyond its ends makes
/// stray points, and a fan of light ends softly.
fn seen_extent(camera: &Camera, sheet: &Sheet, floor: &[Placed]) -> [f64; 2] {
    let mut places: Vec<(f64, f64)> = floor
        .iter()
        .filter_map(|point| {
            Some((sheet.place(super::model::on_level(camera, point.pixel, 0.0)?), point.pixel.u))
        })
        .collect();
    places.sort_by(|one, other| one.0.total_cmp(&other.0));
    let dense = |window: &&[(f64, f64)]| {
        let [first, .., last] = window else { return false };
        (last.1 - first.1).abs() <= END_POINTS as f64 / DENSE_END
    };
    let first = places.windows(END_POINTS).find(dense).and_then(<[_]>::first);
    let last = places.windows(END_POINTS).rev().find(dense).and_then(<[_]>::last);
    let ends =
        [first.or(places.first()), last.or(places.last())].map(|end| end.map_or(0.0, |(place, _)| *place));
    [ends[0] + END_MARGIN_MM, ends[1] - END_MARGIN_MM]
}

fn findings(
    inputs: &Inputs,
    estimate: &Fit,
    seen: &Seen,
    problems: Vec<Option<String>>,
) -> Vec<BlockFinding> {
    let measured = |block: usize| {
        let (_, points, _) = seen.tops.iter().find(|(index, _, _)| *index == block)?;
        Some((median_height(&estimate.model, points)?, points.len()))
    };
    inputs
        .blocks
        .iter()
        .zip(problems)
        .enumerate()
        .map(|(index, (block, problem))| {
            let found = measured(index);
            BlockFinding {
                stated_mm: block.height_mm,
                measured_mm: found.map(|(height, _)| height),
                columns: found.map_or(0, |(_, columns)| columns),
                problem,
            }
        })
        .collect()
}
