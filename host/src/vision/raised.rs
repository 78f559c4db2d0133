//! Where the stripe is gone from the floor: does it appear elsewhere, and where on what object?
//!
//! Each ray of the laser hits one thing, the first in its way. So a stripe off the floor is believed only for rays
//! whose place on the floor is dark, and of several candidates for one ray (a reflection in a wet floor, a glare on a
//! glossy side, texture) only one, that of the longer and stronger line. Candidates must form a line over several
//! columns; a single bright spot is none.

use super::floor::{FloorColumn, FloorFinder, is_fringe};
use super::grid::{Grid, PictureGeometry};
use super::peak::{self, Kernel, Peak};
use super::signal::{RowSearch, SEGMENT_BITS, SEGMENT_ROWS, Signal};
use crate::simd;

/// Length of the stretches in which rays are counted, millimetres.
const RAY_BIN_MM: f32 = 0.5;
/// Dark stretches are widened by this on both sides: the ray's place is known to about this, millimetres.
const RAY_MARGIN_MM: f32 = 1.5;
/// Columns that see rays end this near to a dark one are searched too, millimetres: a line may go on beside the dark
/// stretch, and what a column can see is rounded.
const SIGHT_MARGIN_MM: f32 = 16.0;
/// Fewest columns of a line.
const FEWEST_COLUMNS: u32 = 3;
/// Contrast that a candidate needs, in standard deviations of the background.
const CANDIDATE_CONTRAST: f32 = 5.0;
/// Mean contrast that a line needs, in standard deviations of the background.
const LINE_CONTRAST: f32 = 6.0;
/// A line may move by this many samples from column to column ...
const LINE_STEP: f32 = 4.0;
/// ... and miss this many columns.
const LINE_HOLES: usize = 3;
/// Two seeds of one column that lead within this many samples of each other have found the same stripe.
const SAME_CREST: f32 = 3.0;
/// A stripe that is not clipped is at most so many times as wide as the floor's usually is: things that are red
/// themselves are mostly wider.
const WIDEST_SHARE: f32 = 2.0;
/// Light rises in its own colour by at least this share of its contrast; grey on green, or red pigment on a bright
/// ground, does not.
const GLOW_SHARE: f32 = 0.03;
/// Samples on each side that it is compared with.
const GLOW_SAMPLES: usize = 3;
/// From here on the laser's colour is at the end of its scale.
const OVEREXPOSED: f32 = 244.0;
/// A line of this length along the stripe is one whatever lies around it, millimetres ...
const LONG_LINE_MM: f32 = 12.0;
/// ... a shorter one must take at least this share of the dark stretch that it lies in.
const LEAST_EXPLAINED: f32 = 0.08;
/// Lines that are followed at a time; more is texture.
const OPEN_LINES: usize = 24;
/// Candidates for which there is room; a picture with more shows texture, and the weaker ones change nothing.
const MOST_CANDIDATES: usize = 1 << 16;

/// A point of the stripe off the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RaisedPoint {
    /// Index of the grid's column.
    pub column: usize,
    /// Row of samples.
    pub row: f32,
    /// Height over the floor, millimetres (negative: below it).
    pub height: f32,
    /// Place of its ray on the floor, millimetres.
    pub place: f32,
    /// Contrast in standard deviations of the background.
    pub significance: f32,
    /// Which line it belongs to.
    pub line: u32,
    contrast: f32,
}

/// A line of candidates.
#[derive(Debug, Clone, Copy)]
struct Line {
    number: u32,
    columns: u32,
    contrast: f32,
    significance: f32,
    last_column: usize,
    last_row: f32,
}

/// Finds the stripe off the floor; owns its memory.
#[derive(Debug, Clone)]
pub struct RaisedFinder {
    keys: Vec<u16>,
    rays: Rays,
    /// Places of the rays that each column can see end, millimetres.
    sights: Vec<[f32; 2]>,
    /// Runs of columns that can see a dark ray end.
    watching: Vec<std::ops::Range<usize>>,
    points: Vec<RaisedPoint>,
    lines: Vec<Line>,
    order: Vec<u32>,
    open: Vec<u32>,
    column: peak::Column,
}

impl RaisedFinder {
    /// Room for a grid.
    #[must_use]
    pub fn new(grid: &Grid, geometry: &PictureGeometry) -> Self {
        Self {
            keys: vec![0; grid.columns().len() * grid.segments().len()],
            rays: Rays::new(grid),
            sights: (0..grid.columns().len()).map(|index| sight(grid, geometry, index)).collect(),
            watching: Vec::with_capacity(grid.columns().len()),
            points: Vec::with_capacity(MOST_CANDIDATES),
            lines: Vec::with_capacity(MOST_CANDIDATES),
            order: Vec::with_capacity(MOST_CANDIDATES),
            open: Vec::with_capacity(OPEN_LINES),
            column: peak::Column::new(grid.segments().len() * SEGMENT_ROWS),
        }
    }

    /// The points found in the last frame, by line and column.
    #[must_use]
    pub fn points(&self) -> &[RaisedPoint] {
        &self.points
    }

    /// Looks at one frame, in which `floor` is lit.
    pub fn find<S: RowSearch>(
        &mut self,
        signal: S,
        grid: &Grid,
        geometry: &PictureGeometry,
        floor: &FloorFinder,
    ) {
        self.points.clear();
        self.lines.clear();
        if !self.rays.set(floor.columns()) {
            return;
        }
        self.find_watching();
        self.collect_seeds(signal, grid);
        self.follow_lines(signal, grid, geometry, floor);
        self.choose();
    }

    /// Which columns can see a dark ray end? Only they are searched.
    fn find_watching(&mut self) {
        self.watching.clear();
        for (index, sight) in self.sights.iter().enumerate() {
            if !self.rays.any_dark(*sight) {
                continue;
            }
            match self.watching.last_mut() {
                Some(run) if run.end == index => run.end = index + 1,
                _ => self.watching.push(index..index + 1),
            }
        }
    }

    /// The strongest sample of each watching column in each segment of rows.
    fn collect_seeds<S: RowSearch>(&mut self, signal: S, grid: &Grid) {
        self.keys.fill(0);
        simd::run(Collect { signal, grid, watching: &self.watching, keys: &mut self.keys });
    }

    /// Row of the strongest sample of a segment, if it stands out from one of the neighbouring segments at least and
    /// does not fall behind any.
    fn seed(&self, segment: usize, index: usize, width: usize) -> Option<usize> {
        let key_of = |segment: Option<usize>| self.keys.get(segment? * width + index).copied();
        let key = key_of(Some(segment))?;
        let strength = key >> SEGMENT_BITS;
        let neighbours = [segment.checked_sub(1), Some(segment + 1)];
        let [above, below] = neighbours.map(|neighbour| key_of(neighbour).unwrap_or(0) >> SEGMENT_BITS);
        let stands_out = strength >= above.max(below) && strength > above.min(below);
        stands_out.then(|| segment * SEGMENT_ROWS + usize::from(key & ((1 << SEGMENT_BITS) - 1)))
    }

    /// Measures the seeds on dark rays, column by column, and joins them to lines.
    fn follow_lines<S: Signal>(
        &mut self,
        signal: S,
        grid: &Grid,
        geometry: &PictureGeometry,
        floor: &FloorFinder,
    ) {
        let widest = WIDEST_SHARE * floor.usual().width;
        let width = grid.columns().len();
        self.open.clear();
        for (index, (place, floor)) in grid.columns().iter().zip(floor.columns()).enumerate() {
            let lines = &self.lines;
            self.open.retain(|line| lines[*line as usize].last_column + LINE_HOLES + 1 >= index);
            let image_column = grid.image_column(index);
            let Some(map) = geometry.map(image_column) else { continue };
            if !self.rays.any_dark(self.sights[index]) {
                continue;
            }
            let segments = usize::from(place.first_row) / SEGMENT_ROWS
                ..usize::from(place.end_row).div_ceil(SEGMENT_ROWS);
            let rows = segments.start * SEGMENT_ROWS..segments.end * SEGMENT_ROWS;
            let column = grid.first() + index;
            self.column.fill(signal, column, rows);
            let mut last_row = f32::NEG_INFINITY;
            for segment in segments {
                let Some(row) = self.seed(segment, index, width) else { continue };
                if !self.rays.is_dark(geometry.ray_place(map, grid.to_pixels(row as f32))) {
                    continue;
                }
                let least = CANDIDATE_CONTRAST * floor.noise;
                let found = self.column.find_above(signal, column, row, 1, least);
                let Some(peak) = believed(signal, column, found, widest) else { continue };
                let (peak_row, contrast) = (peak.row, peak.contrast);
                let significance = contrast / floor.noise;
                // Neighbouring segments can lead to the same crest.
                if significance < CANDIDATE_CONTRAST || (peak_row - last_row).abs() < SAME_CREST {
                    continue;
                }
                let pixel_row = grid.to_pixels(peak_row);
                let (height, ray) = (map.height(pixel_row), geometry.ray_place(map, pixel_row));
                if (peak_row - place.floor_row).abs() <= place.tolerance || !self.rays.is_dark(ray) {
                    continue;
                }
                last_row = peak_row;
                if self.points.len() < MOST_CANDIDATES {
                    let line = self.join(index, peak_row, contrast, significance);
                    self.points.push(RaisedPoint {
                        column: index,
                        row: peak_row,
                        height,
                        place: ray,
                        significance,
                        line,
                        contrast,
                    });
                }
            }
        }
    }

    /// The line that a candidate continues, or a new one.
    fn join(&mut self, column: usize, row: f32, contrast: f32, significance: f32) -> u32 {
        let mut nearest: Option<(f32, u32)> = None;
        for number in &self.open {
            let line = &self.lines[*number as usize];
            if line.last_column == column {
                continue;
            }
            let distance = (line.last_row - row).abs();
            let columns = (column - line.last_column) as f32;
            if distance <= LINE_STEP * columns && nearest.is_none_or(|(least, _)| distance < least) {
                nearest = Some((distance, *number));
            }
        }
        let number = nearest.map_or(self.lines.len() as u32, |(_, number)| number);
        match self.lines.get_mut(number as usize) {
            Some(line) => {
                line.columns += 1;
                line.contrast += contrast;
                line.significance += significance;
                (line.last_column, line.last_row) = (column, row);
            }
            None => {
                self.lines.push(Line {
                    number,
                    columns: 1,
                    contrast,
                    significance,
                    last_column: column,
                    last_row: row,
                });
                if self.open.len() < OPEN_LINES {
                    self.open.push(number);
                }
            }
        }
        number
    }

    /// Gives each ray to the strongest line that claims it; lines whose rays are mostly taken are reflections.
    fn choose(&mut self) {
        let lines = &mut self.lines;
        self.order.clear();
        self.order.extend(lines.iter().filter(|line| line.is_believable()).map(|line| line.number));
        self.order.sort_unstable_by(|one, other| {
            let strength = |number: &u32| lines[*number as usize].contrast;
            strength(other).total_cmp(&strength(one)).then(one.cmp(other))
        });
        self.points.sort_unstable_by_key(|point| (point.line, point.column));
        for line in lines.iter_mut() {
            line.columns = 0;
        }
        for number in &self.order {
            let from = self.points.partition_point(|point| point.line < *number);
            let to = self.points.partition_point(|point| point.line <= *number);
            let points = &self.points[from..to];
            let taken = points.iter().filter(|point| self.rays.is_taken(point.place)).count();
            if 2 * taken < points.len() && self.rays.is_explained_by(points) {
                lines[*number as usize].columns = 1;
                for pair in points.windows(2) {
                    self.rays.take(pair[0].place, pair[1].place);
                }
            }
        }
        self.points.retain(|point| lines[point.line as usize].columns == 1);
    }
}

/// The search of [`RaisedFinder::collect_seeds`] as vector instructions.
struct Collect<'a, S> {
    signal: S,
    grid: &'a Grid,
    watching: &'a [std::ops::Range<usize>],
    keys: &'a mut [u16],
}

impl<S: RowSearch> simd::Kernel for Collect<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { signal, grid, watching, keys } = self;
        let width = grid.columns().len().max(1);
        for (segment, (range, keys)) in grid.segments().iter().zip(keys.chunks_exact_mut(width)).enumerate() {
            let first_row = segment * SEGMENT_ROWS;
            for row in first_row..(first_row + SEGMENT_ROWS).min(signal.rows()) {
                let tag = (row - first_row) as u16;
                for run in watching {
                    let (start, end) = (run.start.max(range.start), run.end.min(range.end));
                    if start < end {
                        signal.raise(row, grid.first() + start, tag, &mut keys[start..end]);
                    }
                }
            }
        }
    }
}

/// Places of the rays that a column can see end, from the lowest to the highest, millimetres.
fn sight(grid: &Grid, geometry: &PictureGeometry, index: usize) -> [f32; 2] {
    const EVERYWHERE: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];
    let Some((place, map)) = grid.columns().get(index).zip(geometry.map(grid.image_column(index))) else {
        return EVERYWHERE;
    };
    let first = usize::from(place.first_row) / SEGMENT_ROWS * SEGMENT_ROWS;
    let last = usize::from(place.end_row).next_multiple_of(SEGMENT_ROWS);
    let at = |row: usize| geometry.ray_place(map, grid.to_pixels(row as f32));
    let (one, middle, other) = (at(first), at(first.midpoint(last)), at(last));
    let (low, high) = (one.min(other), one.max(other));
    // The place is a ratio of two linear functions of the row: it only rises or only falls, or passes through infinity,
    // and then the middle is not between.
    let [low, high] = [low - SIGHT_MARGIN_MM, high + SIGHT_MARGIN_MM];
    if one.is_nan() || other.is_nan() || !(low..=high).contains(&middle) {
        return EVERYWHERE;
    }
    [low, high]
}

impl Line {
    fn is_believable(&self) -> bool {
        self.columns >= FEWEST_COLUMNS && self.significance >= LINE_CONTRAST * self.columns as f32
    }
}

/// A ridge, if light of the laser can have made it.
fn believed<S: Signal>(signal: S, column: usize, peak: Option<Peak>, widest: f32) -> Option<Peak> {
    peak.filter(|peak| is_light(signal, column, peak, widest) && !is_fringe(signal, column, peak))
}

/// Is it as narrow as a stripe, and brighter in the laser's colour than both sides together? A stripe at the end of the
/// camera's scale may be wide: the brighter, the wider. Beside what daylight overexposes nothing is believed: it has red
/// rims of its own, and the laser is not seen on it.
fn is_light<S: Signal>(signal: S, column: usize, peak: &Peak, widest: f32) -> bool {
    let crest = peak.row.round().max(0.0) as usize;
    let beside = (peak.width / 2.0).ceil() as usize + Kernel::for_step(S::STEP).half;
    let mean_glow = |first: usize| {
        let sum: i16 = (first..first + GLOW_SAMPLES).map(|row| signal.glow(column, row)).sum();
        f32::from(sum) / GLOW_SAMPLES as f32
    };
    let above = mean_glow(crest.saturating_sub(beside + GLOW_SAMPLES - 1));
    let below = mean_glow(crest + beside);
    if above.max(below) >= OVEREXPOSED {
        return false;
    }
    if signal.is_clipped(column, crest) {
        return true;
    }
    let rise = f32::from(signal.glow(column, crest)) - (above + below) / 2.0;
    peak.width <= widest && rise >= GLOW_SHARE * peak.contrast
}

/// Which rays of the laser reach the floor, in stretches of [`RAY_BIN_MM`].
#[derive(Debug, Clone)]
struct Rays {
    start: f32,
    bins: Vec<Ray>,
    /// How many bins before each are dark.
    dark_before: Vec<u32>,
    /// Place of each grid column's floor point, millimetres.
    places: Vec<f32>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ray {
    /// It reaches the floor.
    Lit,
    /// It does not, and nothing is known of what it hits.
    Dark,
    /// It does not; a line explains where it ends.
    Taken,
}

impl Rays {
    fn new(grid: &Grid) -> Self {
        let places: Vec<f32> = grid.columns().iter().map(|column| column.place).collect();
        let (low, high) = places.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), place| {
            (low.min(*place), high.max(*place))
        });
        let count = if low <= high { ((high - low) / RAY_BIN_MM) as usize + 1 } else { 0 };
        Self { start: low, bins: vec![Ray::Lit; count], dark_before: vec![0; count + 1], places }
    }

    /// Marks the dark stretches; true if there is one. A single dark column is not.
    fn set(&mut self, floor: &[FloorColumn]) -> bool {
        self.bins.fill(Ray::Lit);
        let mut any = false;
        for (index, columns) in floor.windows(2).enumerate() {
            if columns.iter().all(|column| !column.lit) {
                any = true;
                let (one, other) = (self.places[index], self.places[index + 1]);
                self.mark(one.min(other) - RAY_MARGIN_MM, one.max(other) + RAY_MARGIN_MM, Ray::Dark);
            }
        }
        let mut dark = 0;
        for (before, ray) in self.dark_before.iter_mut().skip(1).zip(&self.bins) {
            dark += u32::from(*ray == Ray::Dark);
            *before = dark;
        }
        any
    }

    /// Was any ray between two places dark when [`Self::set`] looked?
    fn any_dark(&self, [low, high]: [f32; 2]) -> bool {
        // `as` saturates: what lies before the stripe begins with its first bin.
        let bin = |place: f32| ((place - self.start) / RAY_BIN_MM).floor() as usize;
        let end = bin(high).saturating_add(1).min(self.bins.len());
        let first = bin(low).min(end);
        self.dark_before[end] > self.dark_before[first]
    }

    fn mark(&mut self, low: f32, high: f32, as_what: Ray) {
        let bin = |place: f32| ((place - self.start) / RAY_BIN_MM).max(0.0) as usize;
        let (from, to) = (bin(low), (bin(high) + 1).min(self.bins.len()));
        if let Some(bins) = self.bins.get_mut(from..to) {
            bins.fill(as_what);
        }
    }

    fn at(&self, place: f32) -> Option<Ray> {
        let bin = (place - self.start) / RAY_BIN_MM;
        // NaN and what lies before the stripe are no bins.
        if bin >= 0.0 { self.bins.get(bin as usize).copied() } else { None }
    }

    fn is_dark(&self, place: f32) -> bool {
        self.at(place).is_some_and(|ray| ray != Ray::Lit)
    }

    fn is_taken(&self, place: f32) -> bool {
        self.at(place) == Some(Ray::Taken)
    }

    /// Is a line long enough for the dark stretch that it lies in? Next to nothing of it explains nothing: that is a
    /// glint, or the red rim of something that daylight overexposes.
    fn is_explained_by(&self, points: &[RaisedPoint]) -> bool {
        let [first, .., last] = points else { return false };
        let length = (last.place - first.place).abs();
        if length >= LONG_LINE_MM {
            return true;
        }
        let middle = ((first.place + last.place) / 2.0 - self.start) / RAY_BIN_MM;
        let middle = (middle.max(0.0) as usize).min(self.bins.len());
        let is_dark = |ray: &&Ray| **ray != Ray::Lit;
        let dark = self.bins[..middle].iter().rev().take_while(is_dark).count()
            + self.bins[middle..].iter().take_while(is_dark).count();
        length >= LEAST_EXPLAINED * dark as f32 * RAY_BIN_MM
    }

    fn take(&mut self, one: f32, other: f32) {
        self.mark(one.min(other), one.max(other), Ray::Taken);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Plane;
    use crate::vision::signal::RedMinusGreen;

    /// One column of `ground` with a bell-shaped ridge that moves the colour by `change`.
    fn column(ground: [f32; 3], change: [f32; 3]) -> Vec<u8> {
        (0..80)
            .flat_map(|row| {
                let light = (-(row as f32 - 40.0).powi(2) / 12.0).exp();
                std::array::from_fn::<u8, 3, _>(|channel| (ground[channel] + light * change[channel]) as u8)
            })
            .collect()
    }

    fn is_believed(bytes: &[u8]) -> bool {
        let signal = RedMinusGreen(Plane::new(bytes, 3, 3, 80).unwrap());
        believed(signal, 0, peak::find_above(signal, 0, 40, 1, 4.0), 14.0).is_some()
    }

    #[test]
    fn the_laser_is_believed_on_every_ground_that_is_not_overexposed() {
        for ground in [[140.0, 140.0, 140.0], [60.0, 120.0, 80.0], [20.0, 20.0, 20.0], [190.0, 65.0, 60.0]] {
            assert!(is_believed(&column(ground, [50.0, -20.0, -10.0])), "{ground:?}");
        }
        assert!(!is_believed(&column([250.0, 230.0, 215.0], [5.0, -60.0, -60.0])), "overexposed");
    }

    /// A black cable on a green floor is redder than the floor, and no light.
    #[test]
    fn what_is_only_less_green_is_no_light() {
        assert!(!is_believed(&column([60.0, 120.0, 80.0], [-30.0, -95.0, -55.0])));
        assert!(
            !is_believed(&column([220.0, 215.0, 205.0], [-10.0, -140.0, -140.0])),
            "red pigment on white"
        );
    }
}
