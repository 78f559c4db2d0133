//! Where the stripe is gone from the floor: does it appear elsewhere, and where on what object?
//!
//! Each ray of the laser hits one thing, the first in its way (`rays`). So a stripe off the floor is believed only for
//! rays whose place on the floor is dark, and of several candidates for one ray (a reflection in a wet floor, a glare on
//! a glossy side, texture) only one, that of the longer and stronger line. Candidates must be light (`light`) and form
//! a line over several columns; a single bright spot is none. The laser's line ends where the rays reach the floor again:
//! what goes on there at both ends is a thing that is red itself. And what looks lit between two dark parts of one line
//! is not the floor's stripe, for that ray ends on the line.

mod light;
mod line;
mod rays;
mod seeds;

use super::floor::{FloorFinder, pitch};
use super::grid::{Grid, PictureGeometry};
use super::peak;
use super::signal::{RowSearch, SEGMENT_BITS, SEGMENT_ROWS, Signal};
use crate::simd;
use light::believed;
use line::{Candidate, Line, is_by_chance, without_ends};
use rays::Rays;
use seeds::{Collect, sight};

/// Contrast that a candidate needs, in standard deviations of the background.
const CANDIDATE_CONTRAST: f32 = 5.0;
/// A line may move by this many samples from column to column ...
const LINE_STEP: f32 = 4.0;
/// ... and miss this many columns.
const LINE_HOLES: usize = 3;
/// Two seeds of one column that lead within this many samples of each other have found the same stripe.
const SAME_CREST: f32 = 3.0;
/// A stripe that is not clipped is at most so many times as wide as the floor's usually is: things that are red
/// themselves are mostly wider.
const WIDEST_SHARE: f32 = 2.0;
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
    /// The floor looks lit where its ray would end.
    beside: bool,
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
    /// The points' contrasts, in order.
    contrasts: Vec<f32>,
    /// Samples that were searched for candidates: those of the segments whose strongest one was looked at.
    searched: usize,
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
            contrasts: Vec::with_capacity(MOST_CANDIDATES),
            searched: 0,
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

    /// Row of the strongest sample of a segment, if it stands out from one of the neighbouring segments at least (by
    /// `least` steps of strength, if it falls behind the other).
    fn seed(&self, segment: usize, index: usize, width: usize, least: u16) -> Option<usize> {
        let key_of = |segment: Option<usize>| self.keys.get(segment? * width + index).copied();
        let key = key_of(Some(segment))?;
        let strength = key >> SEGMENT_BITS;
        let neighbours = [segment.checked_sub(1), Some(segment + 1)];
        let [above, below] = neighbours.map(|neighbour| key_of(neighbour).unwrap_or(0) >> SEGMENT_BITS);
        let row = usize::from(key & ((1 << SEGMENT_BITS) - 1));
        let stands_out = strength >= above.max(below) && strength > above.min(below);
        // What lies inside its segment is a crest, even if something redder lies in the next one.
        let inside = 0 < row && row + 1 < SEGMENT_ROWS;
        let is_crest = inside && strength >= above.min(below) + least;
        (stands_out || is_crest).then_some(segment * SEGMENT_ROWS + row)
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
        self.searched = 0;
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
            let mut is_kept = false;
            let mut last_row = f32::NEG_INFINITY;
            let pitch = pitch(grid, index);
            let least = CANDIDATE_CONTRAST * floor.noise;
            // A step of strength is two levels.
            let steps = (least / 2.0).min(f32::from(u8::MAX)) as u16;
            for segment in segments {
                let Some(row) = self.seed(segment, index, width, steps) else { continue };
                let ray = geometry.ray_place(map, grid.to_pixels(row as f32));
                if !self.rays.is_of_interest(ray) && !self.is_continued_by(index, row as f32) {
                    continue;
                }
                self.searched += SEGMENT_ROWS;
                if !is_kept {
                    self.column.fill(signal, column, rows.clone());
                    is_kept = true;
                }
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
                if (peak_row - place.floor_row).abs() <= place.tolerance || !self.rays.is_watched(ray) {
                    continue;
                }
                last_row = peak_row;
                if self.points.len() < MOST_CANDIDATES {
                    let seen = Candidate { column: index, row: peak_row, contrast, significance };
                    let beside = !self.rays.is_dark(ray);
                    let line = if beside { self.join_beside(&seen, pitch) } else { self.join(&seen) };
                    self.points.push(RaisedPoint {
                        beside,
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
    fn line_of(&mut self, seen: &Candidate) -> u32 {
        let mut nearest: Option<(f32, u32)> = None;
        for number in &self.open {
            let line = &self.lines[*number as usize];
            if line.last_column == seen.column {
                continue;
            }
            let distance = (line.last_row - seen.row).abs();
            let columns = (seen.column - line.last_column) as f32;
            if distance <= LINE_STEP * columns && nearest.is_none_or(|(least, _)| distance < least) {
                nearest = Some((distance, *number));
            }
        }
        let number = nearest.map_or(self.lines.len() as u32, |(_, number)| number);
        match self.lines.get_mut(number as usize) {
            Some(line) => (line.last_column, line.last_row) = (seen.column, seen.row),
            None => {
                self.lines.push(Line::starting_at(number, seen));
                if self.open.len() < OPEN_LINES {
                    self.open.push(number);
                }
            }
        }
        number
    }

    /// Joins a candidate on a dark ray.
    fn join(&mut self, seen: &Candidate) -> u32 {
        let number = self.line_of(seen);
        let line = &mut self.lines[number as usize];
        line.columns += 1;
        line.contrast += seen.contrast;
        line.significance += seen.significance;
        // What lies between two dark stretches is no end.
        line.beside[1] = 0.0;
        number
    }

    /// May a seed continue a line that was seen on dark rays before?
    fn is_continued_by(&self, column: usize, row: f32) -> bool {
        self.open.iter().map(|number| &self.lines[*number as usize]).any(|line| {
            let columns = (column - line.last_column) as f32;
            line.columns > 0 && (line.last_row - row).abs() <= LINE_STEP * columns
        })
    }

    /// Joins a candidate on a ray that reaches the floor, beside the dark ones.
    fn join_beside(&mut self, seen: &Candidate, pitch: f32) -> u32 {
        let number = self.line_of(seen);
        let line = &mut self.lines[number as usize];
        line.beside[usize::from(line.columns > 0)] += pitch;
        number
    }

    /// Gives each ray to the strongest line that claims it; lines whose rays are mostly taken are reflections.
    fn choose(&mut self) {
        let lines = &mut self.lines;
        self.contrasts.clear();
        self.contrasts.extend(self.points.iter().map(|point| point.contrast));
        self.contrasts.sort_unstable_by(f32::total_cmp);
        let (contrasts, searched) = (&self.contrasts, self.searched as f32);
        let by_chance = |line: &Line| {
            let mean = line.contrast / line.columns as f32;
            let as_strong = contrasts.len() - contrasts.partition_point(|contrast| *contrast < mean);
            is_by_chance(line.columns, as_strong, searched)
        };
        self.order.clear();
        let believed = lines.iter().filter(|line| line.is_believable() && !by_chance(line));
        self.order.extend(believed.map(|line| line.number));
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
            let points = without_ends(&self.points[from..to]);
            let taken = points.iter().filter(|point| self.rays.is_taken(point.place)).count();
            if 2 * taken < points.len() && self.rays.is_explained_by(points) {
                lines[*number as usize].columns = 1;
                for pair in points.windows(2) {
                    self.rays.take(pair[0].place, pair[1].place);
                }
                self.rays.claim(points);
                // What remains of the line ends with its last dark ray.
                let ends = [points.first(), points.last()].map(|point| point.map_or(0, |point| point.column));
                lines[*number as usize].ends = ends;
            }
        }
        self.points.retain(|point| {
            let line = &lines[point.line as usize];
            line.columns == 1 && (line.ends[0]..=line.ends[1]).contains(&point.column)
        });
    }

    /// Does a line off the floor hold the ray that would end at this place, although the floor looks lit there? A ray ends
    /// once: what looks lit between two dark parts of one line is a reflection, or the edge of a paint.
    #[must_use]
    pub fn is_claimed(&self, place: f32) -> bool {
        self.rays.is_claimed(place)
    }
}
