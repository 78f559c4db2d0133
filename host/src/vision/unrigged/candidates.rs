//! Ridges in every column of a picture: places that are redder than both sides, at any of several widths.

use crate::vision::signal::Signal;

/// Half widths that are tried, samples: thin lines of small photographs up to wide bands of light.
const HALF_WIDTHS: [usize; 5] = [1, 2, 4, 8, 16];
/// Candidates that are kept in each column.
const MOST_IN_COLUMN: usize = 6;
/// Contrast that a candidate needs, in standard deviations of what the picture has everywhere.
const LEAST_SIGNIFICANCE: f32 = 3.0;
/// Contrasts vary at least by this much, levels: quantisation and compression hide less.
const LEAST_NOISE: f32 = 0.8;
/// The laser adds light: its colour rises by at least this share of the contrast where it is not at the end of its
/// scale. (Not by much: in bright light the camera's colour matrix and tone curve make green fall more than red rises.)
/// Red pigment on a bright ground rises by nothing.
const GLOW_SHARE: f32 = 0.03;
/// The colour's scale ends about here.
const CLIPPED: f32 = 244.0;
/// Colour that lens and demosaicing give to an edge between bright and dark, as a share of the step.
const FRINGE_SHARE: f32 = 0.15;
/// The noise is measured in every so manieth column.
const NOISE_STRIDE: usize = 7;

/// A ridge of one column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Row of its crest.
    pub row: usize,
    /// Half the width at which it stands out most, samples.
    pub half: usize,
    /// Contrast in standard deviations of the picture's.
    pub significance: f32,
    /// How much higher the inner half is than the whole, as a share of the contrast: a line of light is brightest in
    /// its middle, a painted one is even.
    pub peakedness: f32,
    /// The laser's colour is at the end of its scale here, which takes the peak off.
    pub clipped: bool,
}

impl Candidate {
    /// Is the core so bright that it looks whiter than its flanks?
    pub fn is_bleached(&self) -> bool {
        self.clipped && self.peakedness < 0.0
    }
}

/// The candidates of all columns, each column's strongest first.
#[derive(Debug, Clone)]
pub struct Candidates {
    columns: Vec<Vec<Candidate>>,
}

impl Candidates {
    /// Searches a picture.
    pub fn of<S: Signal>(signal: S) -> Self {
        let mut column = Column::new(signal.rows());
        let noise = noise_of(signal, &mut column);
        let columns = (0..signal.columns())
            .map(|index| {
                column.take(signal, index);
                column.candidates(signal, index, &noise)
            })
            .collect();
        Self { columns }
    }

    /// Column by column.
    pub fn columns(&self) -> &[Vec<Candidate>] {
        &self.columns
    }
}

/// The contrasts' spread for each half width, from a sample of columns: as the standard deviation that normal noise
/// would have, by the 60 % quantile of the magnitude, so that the stripe itself counts for little.
fn noise_of<S: Signal>(signal: S, column: &mut Column) -> [f32; HALF_WIDTHS.len()] {
    const QUANTILE_60: f32 = 0.842;
    let mut magnitudes: [Vec<f32>; HALF_WIDTHS.len()] = Default::default();
    for index in (0..signal.columns()).step_by(NOISE_STRIDE) {
        column.take(signal, index);
        for (half, magnitudes) in HALF_WIDTHS.into_iter().zip(&mut magnitudes) {
            let rows = (0..signal.rows()).step_by(half + 1);
            magnitudes.extend(rows.filter_map(|row| Some(column.sides(row, half)?.middle().abs())));
        }
    }
    magnitudes.map(|mut magnitudes| {
        let rank = magnitudes.len() * 3 / 5;
        if rank >= magnitudes.len() {
            return f32::INFINITY;
        }
        let (_, value, _) = magnitudes.select_nth_unstable_by(rank, f32::total_cmp);
        (*value / QUANTILE_60).max(LEAST_NOISE)
    })
}

/// One column's running sums.
struct Column {
    sums: Vec<i64>,
}

/// Mean of a ridge and of what lies beside it.
#[derive(Clone, Copy)]
struct Sides {
    core: f32,
    above: f32,
    below: f32,
}

impl Sides {
    /// Over the higher side: an edge is no ridge.
    fn contrast(self) -> f32 {
        self.core - self.above.max(self.below)
    }

    /// Over both sides' mean.
    fn middle(self) -> f32 {
        self.core - (self.above + self.below) / 2.0
    }
}

impl Column {
    fn new(rows: usize) -> Self {
        Self { sums: vec![0; rows + 1] }
    }

    fn take<S: Signal>(&mut self, signal: S, column: usize) {
        let mut sum = 0;
        for (row, total) in self.sums.iter_mut().skip(1).enumerate() {
            sum += i64::from(signal.value(column, row));
            *total = sum;
        }
    }

    fn rows(&self) -> usize {
        self.sums.len() - 1
    }

    fn mean(&self, from: usize, to: usize) -> f32 {
        (self.sums[to] - self.sums[from]) as f32 / (to - from).max(1) as f32
    }

    /// The ridge's core and equally wide sides, a little apart from it; `None` where the picture ends before.
    fn sides(&self, row: usize, half: usize) -> Option<Sides> {
        let near = 2 * half + 1;
        let far = near + 2 * half + 1;
        if row < far || row + far >= self.rows() {
            return None;
        }
        Some(Sides {
            core: self.mean(row - half, row + half + 1),
            above: self.mean(row - far, row - near),
            below: self.mean(row + near + 1, row + far + 1),
        })
    }

    /// The strongest ridges that do not overlap.
    fn candidates<S: Signal>(
        &self,
        signal: S,
        column: usize,
        noise: &[f32; HALF_WIDTHS.len()],
    ) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::new();
        for (half, noise) in HALF_WIDTHS.into_iter().zip(noise) {
            let contrast = |row: usize| self.sides(row, half).map_or(f32::MIN, Sides::contrast);
            let mut before = f32::MIN;
            let mut here = contrast(0);
            for row in 0..self.rows() {
                let after = contrast(row + 1);
                let significance = here / noise;
                if here >= before && here > after && significance >= LEAST_SIGNIFICANCE {
                    let inner = self.mean(row - half / 2, row + half / 2 + 1);
                    let core = self.mean(row - half, row + half + 1);
                    let clipped = f32::from(signal.glow(column, row)) >= CLIPPED;
                    let peakedness = (inner - core) / here;
                    found.push(Candidate { row, half, significance, peakedness, clipped });
                }
                (before, here) = (here, after);
            }
        }
        found.sort_unstable_by(|one, other| other.significance.total_cmp(&one.significance));
        let mut kept: Vec<Candidate> = Vec::with_capacity(MOST_IN_COLUMN);
        for candidate in found {
            let apart =
                |other: &Candidate| candidate.row.abs_diff(other.row) > candidate.half.max(other.half) + 2;
            if kept.iter().all(apart) && self.is_light(signal, column, &candidate) {
                kept.push(candidate);
                if kept.len() == MOST_IN_COLUMN {
                    break;
                }
            }
        }
        kept
    }

    /// Has light been added here? Neither pigment nor the colour fringe of an edge is light; and beside what is
    /// overexposed, the last thing that is not looks red.
    fn is_light<S: Signal>(&self, signal: S, column: usize, candidate: &Candidate) -> bool {
        let Candidate { row, half, .. } = *candidate;
        let Some(sides) = self.sides(row, half) else { return false };
        let reach = 4 * half + 2;
        let mean = |from: usize, to: usize| {
            let sum: i64 = (from..to).map(|row| i64::from(signal.glow(column, row))).sum();
            sum as f32 / (to - from).max(1) as f32
        };
        let core = mean(row - half, row + half + 1);
        let sides_glow = [mean(row - reach, row - 2 * half - 1), mean(row + 2 * half + 2, row + reach + 1)];
        let beside = (sides_glow[0] + sides_glow[1]) / 2.0;
        let overexposed = sides_glow.into_iter().any(|glow| glow >= CLIPPED);
        let tones = (row - reach..row + reach + 1).map(|row| signal.tone(column, row));
        let (low, high) =
            tones.fold((i16::MAX, i16::MIN), |(low, high), tone| (low.min(tone), high.max(tone)));
        let fringe = FRINGE_SHARE * f32::from(high.saturating_sub(low));
        let contrast = sides.contrast();
        contrast > fringe && !overexposed && (core >= CLIPPED || core - beside >= GLOW_SHARE * contrast)
    }
}
