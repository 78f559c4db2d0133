//! Cores of stripes that are at the end of the camera's scale: the brighter, the whiter, so that their colour is hollow.

/// The rim of a hollow reaches this far beyond the clipped samples.
const RIM: usize = 2;

/// Gives the clipped core of a stripe the strength of its weaker rim, and the stronger rim too: the middle of what lies
/// between them is the stripe's, however unlike they are.
pub fn fill_hollows(samples: &mut [i16], is_clipped: impl Fn(usize) -> bool) {
    let mut position = 0;
    while position < samples.len() {
        if !is_clipped(position) {
            position += 1;
            continue;
        }
        let start = position;
        while position < samples.len() && is_clipped(position) {
            position += 1;
        }
        let end = (position + RIM).min(samples.len());
        let run = &mut samples[start.saturating_sub(RIM)..end];
        let Some(lowest) = (0..run.len()).min_by_key(|index| run[*index]) else { continue };
        let (above, below) = run.split_at(lowest);
        let rim = |side: &[i16]| side.iter().copied().max().unwrap_or(i16::MIN);
        let level = rim(above).min(rim(below));
        if level <= run[lowest] {
            continue;
        }
        let is_rim = |sample: &i16| *sample >= level;
        let (first, last) = (run.iter().position(is_rim), run.iter().rposition(is_rim));
        if let (Some(first), Some(last)) = (first, last) {
            run[first..=last].fill(level);
        }
    }
}
