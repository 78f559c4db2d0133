//! Which of a picture's candidates are the stripe on the floor, and which are the stripe on a block of known height.
//!
//! One plane of light meets the floor in a straight line, and every level above the floor in a line parallel to it.
//! The longest line on the floor is the stripe; what runs parallel to it once it is put at the block's height is the
//! stripe on the block's top. The stripe on a block's side face, reflections and red paint do neither.

use nalgebra::Point2;
use nearfield_shared::camera::{Camera, Pixel};

use super::model::{StripePoint, on_level};
use super::stripe::Candidate;

/// Lines tried for the floor; a pair of candidates is on the stripe in one of ten cases or more.
const TRIALS: usize = 1500;
/// While the lens is only nominally known, the stripe is bent by no more than this, as a share of the picture's width.
const LOOSE_SHARE: f64 = 0.004;
/// Columns that the stripe on the floor must cover, as a share of the picture's width.
const LEAST_FLOOR_SHARE: f64 = 0.12;
/// Length of the stripe on a block's top that can be told from noise, millimetres.
const SHORTEST_TOP_MM: f64 = 20.0;
/// Columns that the stripe on a block's top must cover.
const FEWEST_TOP_COLUMNS: usize = 16;
/// Two points of one surface are no farther apart than this along the stripe, millimetres.
const LARGEST_HOLE_MM: f64 = 12.0;
/// The stripe on a top runs parallel to that on the floor within this slope.
const LARGEST_SLOPE: f64 = 0.03;
/// The stripe of a near-field sensor is no farther from the camera than this, millimetres; the horizon is.
const FARTHEST_MM: f64 = 3000.0;
/// The stripe is seen in this share of the columns that it crosses; texture and noise in fewer.
const DENSE: f64 = 0.7;

/// A line on a horizontal level: `x cos(heading) + y sin(heading) = distance`, normal away from the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorLine {
    /// Direction of the normal, radians from x towards y.
    pub heading: f64,
    /// Distance from the origin, millimetres.
    pub distance: f64,
}

impl FloorLine {
    fn through(one: Point2<f64>, other: Point2<f64>, centre: Point2<f64>) -> Option<Self> {
        let along = other - one;
        if along.norm() < SHORTEST_TOP_MM {
            return None;
        }
        let mut heading = along.x.atan2(-along.y);
        let side = |heading: f64| (one.x - centre.x) * heading.cos() + (one.y - centre.y) * heading.sin();
        if side(heading) < 0.0 {
            heading += std::f64::consts::PI;
        }
        Some(Self { heading, distance: one.x * heading.cos() + one.y * heading.sin() })
    }

    /// Distance of a point from the line, millimetres.
    #[must_use]
    pub fn miss(&self, point: Point2<f64>) -> f64 {
        point.x * self.heading.cos() + point.y * self.heading.sin() - self.distance
    }

    /// Place of a point along the line, millimetres.
    #[must_use]
    pub fn place(&self, point: Point2<f64>) -> f64 {
        point.x * self.heading.sin() - point.y * self.heading.cos()
    }
}

/// A candidate on a level: where it would be, and how fast that changes with the pixel.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// The pixel.
    pub pixel: Pixel,
    /// On the level, millimetres.
    pub point: Point2<f64>,
    /// How far it stands out of its surroundings, grey levels.
    pub contrast: f64,
    across: [f64; 2],
    down: [f64; 2],
}

impl Placed {
    fn of(camera: &Camera, candidate: &Candidate, height: f64) -> Option<Self> {
        let pixel = candidate.pixel;
        let at = |u: f64, v: f64| on_level(camera, Pixel { u, v }, height).map(|point| point.xy());
        let point = at(pixel.u, pixel.v)?;
        let centre = camera.pose.centre();
        if (point - Point2::new(centre.x, centre.y)).norm() > FARTHEST_MM {
            return None;
        }
        let right = at(pixel.u + 0.5, pixel.v)? - at(pixel.u - 0.5, pixel.v)?;
        let below = at(pixel.u, pixel.v + 0.5)? - at(pixel.u, pixel.v - 0.5)?;
        let contrast = candidate.contrast;
        Some(Self { pixel, point, contrast, across: right.into(), down: below.into() })
    }

    /// Pixels per millimetre across a line of this heading.
    fn scale(&self, heading: f64) -> f64 {
        let (sine, cosine) = heading.sin_cos();
        let per = |step: [f64; 2]| step[0] * cosine + step[1] * sine;
        1.0 / per(self.across).hypot(per(self.down)).max(1e-6)
    }

    fn stripe_point(&self, heading: f64) -> StripePoint {
        StripePoint { pixel: self.pixel, scale: self.scale(heading) }
    }
}

/// Puts candidates on a level; those whose lines of sight do not meet it are left out.
#[must_use]
pub fn placed(camera: &Camera, candidates: &[Candidate], height: f64) -> Vec<Placed> {
    candidates.iter().filter_map(|candidate| Placed::of(camera, candidate, height)).collect()
}

/// How far candidates may be from the line, pixels, while the lens is not known well.
#[must_use]
pub fn loose_tolerance(width: f64) -> f64 {
    (LOOSE_SHARE * width).max(2.0)
}

/// The stripe on the floor: the line that covers most columns. `None` if no line covers enough of them.
#[must_use]
pub fn find_floor_line(camera: &Camera, placed: &[Placed], width: f64) -> Option<FloorLine> {
    let centre = camera.pose.centre();
    let centre = Point2::new(centre.x, centre.y);
    let tolerance = loose_tolerance(width);
    // Every few columns are enough to choose a line.
    let stride = (placed.len() / 600).max(1);
    let sparse: Vec<&Placed> = placed.iter().step_by(stride).collect();
    let count = sparse.len();
    if count < 2 {
        return None;
    }
    let mut best: Option<(usize, FloorLine)> = None;
    for trial in 0..TRIALS {
        // Two co-prime strides walk through all pairs of places without a random generator.
        let (one, other) =
            (sparse[trial * 7919 % count], sparse[(trial * 104_729 + trial / 7 + count / 3) % count]);
        let Some(line) = FloorLine::through(one.point, other.point, centre) else { continue };
        let covered = covered_columns(sparse.iter().copied(), &line, tolerance);
        if best.is_none_or(|(most, _)| covered > most) {
            best = Some((covered, line));
        }
    }
    let (_, mut line) = best?;
    for _ in 0..3 {
        line = refined(placed, &line, tolerance, centre)?;
    }
    let covered = covered_columns(placed.iter(), &line, tolerance);
    (covered as f64 >= LEAST_FLOOR_SHARE * width && is_unbroken(&on_line(placed, &line, tolerance)))
        .then_some(line)
}

/// Is the line seen in most columns between its ends? Edges of tiles and boards that happen to lie on one line are not.
fn is_unbroken(points: &[Placed]) -> bool {
    let inner = points.len() / 20..points.len() - points.len() / 20;
    let mut columns: Vec<f64> = points.iter().map(|point| point.pixel.u).collect();
    columns.sort_by(f64::total_cmp);
    let Some([first, .., last]) = columns.get(inner.clone()) else { return false };
    inner.len() as f64 >= DENSE * (last - first)
}

fn covered_columns<'a>(placed: impl Iterator<Item = &'a Placed>, line: &FloorLine, tolerance: f64) -> usize {
    let mut last = f64::NAN;
    let mut covered = 0;
    for candidate in placed {
        let away = line.miss(candidate.point).abs() * candidate.scale(line.heading);
        if away <= tolerance && candidate.pixel.u != last {
            covered += 1;
            last = candidate.pixel.u;
        }
    }
    covered
}

/// The line through the candidates near `line`, by the main axis of their spread.
fn refined(placed: &[Placed], line: &FloorLine, tolerance: f64, centre: Point2<f64>) -> Option<FloorLine> {
    let near: Vec<Point2<f64>> = placed
        .iter()
        .filter(|candidate| line.miss(candidate.point).abs() * candidate.scale(line.heading) <= tolerance)
        .map(|candidate| candidate.point)
        .collect();
    let count = near.len() as f64;
    let middle = near.iter().fold(Point2::origin(), |sum, point| sum + point.coords / count);
    let mut spread = nalgebra::Matrix2::zeros();
    for point in &near {
        let away = point - middle;
        spread += away * away.transpose();
    }
    let eigen = spread.symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax()) * 1000.0;
    FloorLine::through(middle, middle + axis, centre)
}

/// One stripe point per column: the candidate nearest to the line, within `tolerance` pixels.
#[must_use]
pub fn on_line(placed: &[Placed], line: &FloorLine, tolerance: f64) -> Vec<Placed> {
    let mut chosen: Vec<(f64, Placed)> = Vec::new();
    for candidate in placed {
        let away = line.miss(candidate.point).abs() * candidate.scale(line.heading);
        if away > tolerance {
            continue;
        }
        match chosen.last_mut() {
            Some(last) if last.1.pixel.u == candidate.pixel.u => {
                if away < last.0 {
                    *last = (away, *candidate);
                }
            }
            _ => chosen.push((away, *candidate)),
        }
    }
    chosen.into_iter().map(|(_, candidate)| candidate).collect()
}

/// For the fit.
#[must_use]
pub fn stripe_points(placed: &[Placed], line: &FloorLine) -> Vec<StripePoint> {
    placed.iter().map(|candidate| candidate.stripe_point(line.heading)).collect()
}

/// The stripe on the top of a block.
#[derive(Debug, Clone)]
pub struct Top {
    /// Its line at the block's height; parallel to the floor's.
    pub line: FloorLine,
    /// Its points, one per column.
    pub points: Vec<Placed>,
}

/// The stripe on a block's top: the longest run, parallel to the floor line at the block's height and nearer to the
/// laser. `placed` are candidates at the block's height, without those on the floor line.
///
/// # Errors
/// The reason, in words for the user.
pub fn find_top(placed: &[Placed], floor: &FloorLine, tolerance: f64) -> Result<Top, String> {
    let mut offsets: Vec<(f64, usize)> = placed
        .iter()
        .enumerate()
        .map(|(index, candidate)| (floor.miss(candidate.point), index))
        .filter(|(offset, _)| *offset < 0.0)
        .collect();
    offsets.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut best: Option<Top> = None;
    // Every offset in turn as the middle of a band; dense bands only are looked at closely.
    for (offset, index) in offsets.iter().step_by((offsets.len() / 400).max(1)) {
        let line = FloorLine { distance: floor.distance + offset, ..*floor };
        let reach = tolerance / placed[*index].scale(floor.heading);
        let low = offsets.partition_point(|other| other.0 < offset - 2.0 * reach);
        let high = offsets.partition_point(|other| other.0 <= offset + 2.0 * reach);
        if high - low < FEWEST_TOP_COLUMNS.max(best.as_ref().map_or(0, |best| best.points.len())) {
            continue;
        }
        let points = longest_run(&on_line(placed, &line, tolerance), &line);
        if is_dense(&points) && best.as_ref().is_none_or(|best| points.len() > best.points.len()) {
            best = Some(Top { line, points });
        }
    }
    let best =
        best.ok_or("nothing beside the floor's stripe is long enough to be the stripe on a block's top")?;
    check_top(centred(best))
}

fn is_dense(points: &[Placed]) -> bool {
    let columns =
        |pick: fn(f64, f64) -> f64, start: f64| points.iter().map(|point| point.pixel.u).fold(start, pick);
    let crossed = columns(f64::max, f64::NEG_INFINITY) - columns(f64::min, f64::INFINITY) + 1.0;
    points.len() as f64 >= DENSE * crossed
}

/// The line moved into the middle of its points.
fn centred(top: Top) -> Top {
    let mut misses: Vec<f64> = top.points.iter().map(|point| top.line.miss(point.point)).collect();
    misses.sort_by(f64::total_cmp);
    let median = misses.get(misses.len() / 2).copied().unwrap_or(0.0);
    Top { line: FloorLine { distance: top.line.distance + median, ..top.line }, ..top }
}

/// The longest stretch of points without a hole.
fn longest_run(points: &[Placed], line: &FloorLine) -> Vec<Placed> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|one, other| line.place(one.point).total_cmp(&line.place(other.point)));
    sorted
        .chunk_by(|one, other| line.place(other.point) - line.place(one.point) <= LARGEST_HOLE_MM)
        .max_by_key(|run| run.len())
        .map(<[Placed]>::to_vec)
        .unwrap_or_default()
}

fn check_top(top: Top) -> Result<Top, String> {
    let (Some(first), Some(last)) = (top.points.first(), top.points.last()) else {
        return Err("no stripe on a block is found".to_owned());
    };
    let length = top.line.place(last.point) - top.line.place(first.point);
    if top.points.len() < FEWEST_TOP_COLUMNS || length < SHORTEST_TOP_MM {
        return Err(format!(
            "the stripe crosses only {length:.0} mm of the block's top ({} columns); put the block so that the stripe \
             runs over its top for {SHORTEST_TOP_MM:.0} mm at least",
            top.points.len()
        ));
    }
    let slope = slope_along(&top);
    if slope.abs() > LARGEST_SLOPE {
        return Err(format!(
            "the stripe on the block is not parallel to that on the floor (it drifts {:.0} mm per metre): it runs over \
             a side face, or the block's top is not level",
            slope * 1000.0
        ));
    }
    Ok(top)
}

/// Drift of the points across the line per length along it, by least squares.
fn slope_along(top: &Top) -> f64 {
    let count = top.points.len() as f64;
    let pairs = || top.points.iter().map(|point| (top.line.place(point.point), top.line.miss(point.point)));
    let (place, miss) =
        pairs().fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0 / count, sum.1 + pair.1 / count));
    let (mixed, square) = pairs().fold((0.0, 0.0), |sum, pair| {
        (sum.0 + (pair.0 - place) * (pair.1 - miss), sum.1 + (pair.0 - place).powi(2))
    });
    mixed / square.max(1e-9)
}
