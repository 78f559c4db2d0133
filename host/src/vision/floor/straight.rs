//! A stripe that a straight edge between two grounds crosses, with the edge taken away.
//!
//! Where the edge of a paint runs through the stripe's own rows, a single column cannot tell a stripe from the edge's
//! own blur. But an edge is straight for longer than the stripe is wide: where it is, and how the picture blurs it
//! (lens, chroma samples, the camera's tone curve, colour fringes), is seen in the rows above and below the stripe. What
//! the picture would be without a stripe is then known in the stripe's rows too, and what it is more than that is light.
//! If anything else than that edge is seen around, nothing is said.

mod line;
#[cfg(test)]
mod tests;

use line::line_through;

use super::strip::Strip;
use crate::vision::grid::Grid;
use crate::vision::ridge::Kernel;

/// Rows above and below the stripe in which the edge is looked for.
const MOST_ROWS: isize = 20;
/// Columns beside the ones in question in which it is.
pub const COLUMNS_ASIDE: usize = 48;
/// Most places at which the edge is looked at.
const MOST_POINTS: usize = 192;
/// The section of the edge is kept in steps of so many samples, up to so many steps from its middle.
const STEP: f32 = 0.25;
const STEPS_ASIDE: usize = 14;
const STEPS: usize = 2 * STEPS_ASIDE + 1;
/// Edges that are looked for in one picture; one with more shows texture.
const MOST_EDGES: usize = 24;
/// Columns that share an edge that was not found.
const NONE_COLUMNS: usize = 3;
/// Farther than so many samples from the edge nothing is said, and there may be another one.
const FARTHEST: f32 = 6.0;
/// Up to this distance the edge's own fraying is what makes the picture unsure, beyond it noise, samples.
const EDGE_ZONE: f32 = 1.6;
/// The two grounds must differ by so many levels for there to be an edge.
const LEAST_STEP: f32 = 12.0;
/// Beside the stripe the picture may differ from the edge's by this share of its step, and so much noise.
const MISFIT_SHARE: f32 = 0.08;
const MISFIT_NOISE: f32 = 2.0;
/// A stripe must be so many standard deviations high.
const SURE_HEIGHT: f32 = 4.5;
/// It is tried elsewhere at so many half rows to both sides.
const SHIFTS: i16 = 7;
/// ... and as coarse as that, its place is told, rows.
pub const LEAST_FARTHEST: f32 = 0.75;

/// A straight edge and its section.
#[derive(Debug, Clone, Copy)]
pub struct StraightEdge {
    /// Unit vector across the edge: columns, rows.
    across: [f32; 2],
    offset: f32,
    section: [f32; STEPS],
    /// Standard deviation of samples beside the stripe: near the edge, and away from it.
    noise: [f32; 2],
    step: f32,
}

/// The edge that was looked for last in a picture.
#[derive(Debug, Clone)]
pub struct LastEdge {
    edge: Option<StraightEdge>,
    column: usize,
    left: usize,
}

impl LastEdge {
    /// For a new picture.
    pub const NONE: Self = Self { edge: None, column: usize::MAX, left: MOST_EDGES };

    /// Need none be looked for again in this column?
    pub fn covers(&self, column: usize, row: f32) -> bool {
        match &self.edge {
            Some(edge) => edge.is_near(column, row) && column.abs_diff(self.column) <= COLUMNS_ASIDE / 2,
            None => column.abs_diff(self.column) < NONE_COLUMNS,
        }
    }

    /// Looks for the edge in or near a column; not more often than a picture without texture needs.
    pub fn look(&mut self, strip: &Strip, grid: &Grid, column: usize, width: f32) {
        self.edge = self.left.checked_sub(1).and_then(|left| {
            self.left = left;
            StraightEdge::at(strip, grid, column, width)
        });
        self.column = column;
    }

    pub fn edge(&self) -> Option<&StraightEdge> {
        self.edge.as_ref()
    }
}

/// A stripe's height and place in one column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncoveredRidge {
    /// Levels over the grounds.
    pub height: f32,
    /// Rows from where it was expected.
    pub offset: f32,
}

/// Samples of a strip by column and row of the picture.
struct Window<'a> {
    strip: &'a Strip,
    grid: &'a Grid,
    columns: std::ops::Range<usize>,
    near: isize,
}

impl Window<'_> {
    fn base(&self, column: usize) -> isize {
        self.grid.columns()[column].nearest_row
    }

    /// The sample at a row of the picture, if it lies beside the stripe.
    fn beside(&self, column: usize, row: isize) -> Option<f32> {
        if !self.columns.contains(&column) {
            return None;
        }
        let aside = row - self.base(column);
        (self.near..=MOST_ROWS).contains(&aside.abs()).then(|| self.strip.value(column, aside))
    }

    /// All samples beside the stripe: column, row, value.
    fn each(&self) -> impl Iterator<Item = (usize, isize, f32)> + '_ {
        self.columns.clone().flat_map(move |column| {
            let base = self.base(column);
            (-MOST_ROWS..=MOST_ROWS)
                .filter(|aside| aside.abs() >= self.near)
                .map(move |aside| (column, base + aside, self.strip.value(column, aside)))
        })
    }
}

impl StraightEdge {
    /// The edge that crosses the stripe in or near a column; `None` if there is not one, or anything else. `width`: the
    /// stripe's, at half of its height.
    pub fn at(strip: &Strip, grid: &Grid, column: usize, width: f32) -> Option<Self> {
        let columns = column.saturating_sub(COLUMNS_ASIDE)..(column + COLUMNS_ASIDE + 1).min(strip.columns());
        let near = Kernel::for_width(width).near as isize + 1;
        let window = Window { strip, grid, columns, near };
        let (low, high) = grounds(&window)?;
        if high - low < LEAST_STEP {
            return None;
        }
        let mut points = [[0.0_f32; 2]; MOST_POINTS];
        let count = crossings(&window, f32::midpoint(low, high), column, &mut points);
        let here = [column as f32, grid.columns().get(column)?.floor_row];
        let (across, offset) = line_through(&points[..count], here)?;
        let mut edge = Self { across, offset, section: [0.0; STEPS], noise: [0.0; 2], step: high - low };
        edge.measure_section(&window)?;
        edge.measure_noise(&window, column)?;
        Some(edge)
    }

    /// Does it cross the stripe in or near this column?
    pub fn is_near(&self, column: usize, row: f32) -> bool {
        self.distance(column as f32, row).abs() <= FARTHEST
    }

    /// Samples from the edge, positive on one side.
    fn distance(&self, column: f32, row: f32) -> f32 {
        self.across[0] * column + self.across[1] * row - self.offset
    }

    /// The grounds' level at a distance from the edge.
    fn ground(&self, distance: f32) -> f32 {
        let at = (distance / STEP + STEPS_ASIDE as f32).clamp(0.0, (STEPS - 1) as f32);
        let lower = (at as usize).min(STEPS - 2);
        let share = at - lower as f32;
        self.section[lower] + share * (self.section[lower + 1] - self.section[lower])
    }

    /// Means of the samples at each distance; where the window has none, those of its neighbours.
    fn measure_section(&mut self, window: &Window<'_>) -> Option<()> {
        let mut sums = [[0.0_f32; 2]; STEPS];
        for (column, row, value) in window.each() {
            let distance = self.distance(column as f32, row as f32);
            if distance.abs() > FARTHEST {
                continue;
            }
            let at = distance / STEP + STEPS_ASIDE as f32;
            let sum = &mut sums[at.round().clamp(0.0, (STEPS - 1) as f32) as usize];
            *sum = [sum[0] + value, sum[1] + 1.0];
        }
        let mut known = sums.iter().enumerate().filter(|(_, sum)| sum[1] > 0.0).map(|(index, _)| index);
        let mut before = known.next()?;
        let mut last = before;
        self.section = [sums[before][0] / sums[before][1]; STEPS];
        for index in known {
            let (from, to) = (self.section[before], sums[index][0] / sums[index][1]);
            for between in before + 1..=index {
                let share = (between - before) as f32 / (index - before) as f32;
                self.section[between] = from + share * (to - from);
            }
            (before, last) = (index, index);
        }
        let end = self.section[last];
        self.section[last..].fill(end);
        Some(())
    }

    /// How much samples beside the stripe differ from the edge's section; `None` if anything else is there around a column.
    fn measure_noise(&mut self, window: &Window<'_>, middle: usize) -> Option<()> {
        let mut squares = [[0.0_f32; 2]; 2];
        let mut here = [0.0_f32; 2];
        for (column, row, value) in window.each() {
            let distance = self.distance(column as f32, row as f32);
            if distance.abs() > FARTHEST {
                continue;
            }
            let rest = value - self.ground(distance);
            let zone = usize::from(distance.abs() > EDGE_ZONE);
            squares[zone] = [squares[zone][0] + rest * rest, squares[zone][1] + 1.0];
            let is_here = column.abs_diff(middle) <= 2
                && row.abs_diff(window.base(column)) <= 2 * window.near.unsigned_abs();
            if is_here {
                here = [here[0] + rest * rest, here[1] + 1.0];
            }
        }
        let [frayed, plain] = squares.map(|[sum, count]| (sum / count.max(1.0)).sqrt());
        self.noise = [frayed.max(plain).max(1.0), plain.max(1.0)];
        let misfit = (here[0] / here[1].max(1.0)).sqrt();
        (here[1] > 0.0 && misfit <= MISFIT_SHARE * self.step + MISFIT_NOISE).then_some(())
    }

    /// The stripe in one column, expected `offset` rows from the floor's row and `width` rows wide, if it is sure.
    pub fn uncover(
        &self,
        strip: &Strip,
        grid: &Grid,
        column: usize,
        (offset, width): (f32, f32),
    ) -> Option<UncoveredRidge> {
        let floor_row = grid.columns().get(column)?.floor_row;
        let (base, fraction) = (floor_row.round() as isize, floor_row - floor_row.round());
        let near = Kernel::for_width(width).near as isize;
        let deviation = width / 2.355;
        let fit = |shift: f32| {
            let (mut product, mut square) = (0.0, 0.0);
            for aside in -near - 3..=near + 3 {
                let from_middle = (aside as f32 - fraction - offset - shift) / deviation;
                let bell = (-0.5 * from_middle * from_middle).exp();
                let distance = self.distance(column as f32, (base + aside) as f32);
                let noise = self.noise[usize::from(distance.abs() > EDGE_ZONE)];
                // What the edge's own fraying makes unsure counts for less.
                let weight = 1.0 / (noise * noise);
                let rest = strip.value(column, aside) - self.ground(distance);
                product += weight * bell * rest;
                square += weight * bell * bell;
            }
            let height = product / square.max(f32::MIN_POSITIVE);
            (height, height * square.sqrt())
        };
        let (height, significance) = fit(0.0);
        let best = (-SHIFTS..=SHIFTS).map(|half| f32::from(half) / 2.0).map(|shift| (shift, fit(shift).1));
        let (best_shift, _) = best.max_by(|one, other| one.1.total_cmp(&other.1))?;
        (significance >= SURE_HEIGHT).then_some(UncoveredRidge { height, offset: best_shift })
    }
}

/// The darker and the brighter ground.
fn grounds(window: &Window<'_>) -> Option<(f32, f32)> {
    // Levels from -255 to 255, counted in steps of four.
    let mut counts = [0_u32; 128];
    let mut all = 0;
    for (_, _, value) in window.each() {
        counts[((value + 256.0) / 4.0).clamp(0.0, 127.0) as usize] += 1;
        all += 1;
    }
    let level_at = |share: f32| {
        let wanted = share * all as f32;
        let mut sum = 0;
        let index = counts.iter().position(|count| {
            sum += count;
            sum as f32 >= wanted
        })?;
        Some(index as f32 * 4.0 - 254.0)
    };
    Some((level_at(0.1)?, level_at(0.9)?))
}

/// Where samples beside the stripe pass from one ground to the other, along columns and along rows.
fn crossings(window: &Window<'_>, middle: f32, centre: usize, points: &mut [[f32; 2]; MOST_POINTS]) -> usize {
    let mut count = 0;
    // From the column in question outwards: a second edge is farther away.
    for step in 0..=2 * COLUMNS_ASIDE {
        let column =
            if step % 2 == 0 { centre.checked_sub(step / 2) } else { Some(centre + step.div_ceil(2)) };
        let Some(column) = column.filter(|column| window.columns.contains(column)) else { continue };
        let base = window.base(column);
        for row in base - MOST_ROWS..base + MOST_ROWS {
            let Some(here) = window.beside(column, row) else { continue };
            let at = |next: Option<f32>| {
                next.filter(|next| (here - middle) * (next - middle) < 0.0)
                    .map(|next| (middle - here) / (next - here))
            };
            let down = at(window.beside(column, row + 1)).map(|share| [column as f32, row as f32 + share]);
            let right = at(window.beside(column + 1, row)).map(|share| [column as f32 + share, row as f32]);
            for point in [down, right].into_iter().flatten() {
                if count < MOST_POINTS {
                    points[count] = point;
                    count += 1;
                }
            }
        }
    }
    count
}
