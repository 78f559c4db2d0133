//! Running average along the stripe, mean over frames, and the gap check.

use std::collections::VecDeque;

use super::top_down::PIXELS_PER_MM;

/// Length of the running average, millimetres. Source: the paper.
const WINDOW_MM: f64 = 5.0;
/// Frames in the mean, this one and the two before. Source: the paper.
const FRAMES: usize = 3;
/// A gap longer than this trips, millimetres. Source: the paper.
pub const LONGEST_GAP_MM: f32 = 5.0;
/// The averaged signal is line from here on.
const LINE: f32 = 0.5;

/// A stretch of the stripe that is not line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperGap {
    /// Its beginning, millimetres along the stripe.
    pub start_mm: f32,
    /// Its end.
    pub end_mm: f32,
}

impl PaperGap {
    /// Does it trip?
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.end_mm - self.start_mm > LONGEST_GAP_MM
    }
}

/// Keeps the smoothed signals of the last frames.
#[derive(Debug, Clone)]
pub struct Continuity {
    start_mm: f64,
    places: usize,
    frames: VecDeque<Vec<f32>>,
}

impl Continuity {
    /// For a signal of so many places that begins at `start_mm`.
    #[must_use]
    pub fn new(start_mm: f64, places: usize) -> Self {
        Self { start_mm, places, frames: VecDeque::with_capacity(FRAMES + 1) }
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.frames.clear();
    }

    /// Takes a frame's signal; a signal of another length counts as none.
    pub fn push(&mut self, signal: &[f32]) {
        let smooth =
            if signal.len() == self.places { running_average(signal) } else { vec![0.0; self.places] };
        self.frames.push_back(smooth);
        if self.frames.len() > FRAMES {
            self.frames.pop_front();
        }
    }

    /// The gaps of the mean of the frames.
    #[must_use]
    pub fn gaps(&self) -> Vec<PaperGap> {
        let count = self.frames.len().max(1) as f32;
        let place = |index: usize| (self.start_mm + index as f64 / PIXELS_PER_MM) as f32;
        let mut gaps = Vec::new();
        let mut start = None;
        for index in 0..=self.places {
            let mean = self.frames.iter().filter_map(|frame| frame.get(index)).sum::<f32>() / count;
            let is_line = index == self.places || mean >= LINE;
            match (is_line, start) {
                (false, None) => start = Some(index),
                (true, Some(first)) => {
                    gaps.push(PaperGap { start_mm: place(first), end_mm: place(index) });
                    start = None;
                }
                _ => {}
            }
        }
        gaps
    }
}

fn running_average(signal: &[f32]) -> Vec<f32> {
    let half = (WINDOW_MM * PIXELS_PER_MM / 2.0) as usize;
    (0..signal.len())
        .map(|index| {
            let window = &signal[index.saturating_sub(half)..(index + half + 1).min(signal.len())];
            window.iter().sum::<f32>() / window.len() as f32
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(gap_mm: f64) -> Continuity {
        let mut continuity = Continuity::new(-100.0, 400);
        let hole = 200..200 + (gap_mm * PIXELS_PER_MM) as usize;
        let signal: Vec<f32> = (0..400).map(|index| if hole.contains(&index) { 0.0 } else { 1.0 }).collect();
        continuity.push(&signal);
        continuity
    }

    /// Below half the window the running average closes a hole, beyond it the hole keeps its length.
    #[test]
    fn a_gap_trips_beyond_five_millimetres() {
        for (gap, cut) in [(2.0, false), (4.5, false), (5.0, false), (6.0, true), (30.0, true)] {
            let gaps = after(gap).gaps();
            assert_eq!(gaps.iter().any(PaperGap::is_cut), cut, "{gap} mm: {gaps:?}");
        }
        let gap = after(30.0).gaps()[0];
        assert!((gap.start_mm - 0.0).abs() < 1.0 && (gap.end_mm - 30.0).abs() < 1.0, "{gap:?}");
    }

    #[test]
    fn one_dark_frame_of_three_does_not_trip_and_two_do() {
        let mut continuity = Continuity::new(0.0, 100);
        for (frame, cut) in [(1.0, false), (1.0, false), (0.0, false), (0.0, true)] {
            continuity.push(&[frame; 100]);
            assert_eq!(continuity.gaps().iter().any(PaperGap::is_cut), cut);
        }
        continuity.push(&[]);
        assert!(continuity.gaps()[0].is_cut(), "a frame without a line is dark");
    }
}
