//! The stripe's heights around a stop, drawn: an SVG picture, and lines of characters for a terminal.

use std::fmt::Write as _;

use nearfield_shared::limits::{DEEPEST_ALLOWED_DROP, FLOOR_TOLERANCE, LARGE_HEIGHT};

use super::replay::{Replay, ReplayedScan};

const WIDTH: f64 = 960.0;
/// Height of one line-scan's band and the space between bands, SVG units.
const BAND: f64 = 130.0;
const SPACE: f64 = 34.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 44.0;
/// The drawn range at least covers these heights, millimetres.
const LEAST_RANGE: (f32, f32) = (-10.0, 20.0);

/// The range of heights that holds all line-scans, and the stretch of the stripe.
struct Frame {
    heights: (f32, f32),
    places: (f32, f32),
}

impl Frame {
    fn of(scans: &[ReplayedScan]) -> Self {
        let points = || scans.iter().flat_map(|scan| &scan.profile);
        let spread = |start: (f32, f32), value: f32| (start.0.min(value), start.1.max(value));
        let heights = points().filter_map(|(_, height)| *height).fold(LEAST_RANGE, spread);
        let places = points().map(|(place, _)| *place).fold((f32::INFINITY, f32::NEG_INFINITY), spread);
        Self { heights, places: if places.0 < places.1 { places } else { (0.0, 1.0) } }
    }

    fn x(&self, place: f32) -> f64 {
        let (from, to) = self.places;
        LEFT + f64::from((place - from) / (to - from)) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, height: f32) -> f64 {
        let (low, high) = self.heights;
        (1.0 - f64::from((height.clamp(low, high) - low) / (high - low))) * BAND
    }
}

/// The whole picture: one band for each line-scan, oldest at the top.
#[must_use]
pub fn to_svg(replay: &Replay) -> String {
    let frame = Frame::of(&replay.scans);
    let height = TOP + replay.scans.len() as f64 * (BAND + SPACE);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {height}' width='{WIDTH}' height='{height}' \
         font-family='sans-serif' font-size='13'>\n<rect width='100%' height='100%' fill='white'/>\n"
    );
    let title = replay.deciders.first().map_or("no cause", |decider| &decider.words);
    // Writing to a String cannot fail; so everywhere below.
    let _ = writeln!(
        svg,
        "<text x='{LEFT}' y='24' font-size='16'>Stop {}: {}</text>",
        replay.stop,
        escaped(title)
    );
    for (number, scan) in replay.scans.iter().enumerate() {
        let top = TOP + number as f64 * (BAND + SPACE);
        let _ = writeln!(svg, "<g transform='translate(0 {top})'>");
        band(&mut svg, &frame, scan);
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

fn band(svg: &mut String, frame: &Frame, scan: &ReplayedScan) {
    let right = WIDTH - RIGHT;
    for (limit, colour) in [(LARGE_HEIGHT, "#c33"), (FLOOR_TOLERANCE, "#888"), (DEEPEST_ALLOWED_DROP, "#c33")]
    {
        let (low, high) = frame.heights;
        if (low..=high).contains(&limit.get()) {
            let y = frame.y(limit.get());
            let _ = writeln!(
                svg,
                "<path d='M{LEFT} {y:.1}H{right}' stroke='{colour}' stroke-dasharray='4 4'/>\
                 <text x='4' y='{:.1}' fill='{colour}'>{} mm</text>",
                y + 4.0,
                limit.get()
            );
        }
    }
    // Columns without stripe are marked at the bottom; a line over them would invent heights.
    let mut path = String::new();
    let mut missing = String::new();
    let mut pen_down = false;
    for (place, height) in &scan.profile {
        let x = frame.x(*place);
        match height {
            Some(height) => {
                let _ = write!(path, "{}{x:.1} {:.1}", if pen_down { "L" } else { "M" }, frame.y(*height));
            }
            None => {
                let _ = write!(missing, "M{x:.1} {BAND}v-8");
            }
        }
        pen_down = height.is_some();
    }
    let _ = writeln!(svg, "<path d='{missing}' stroke='#e90' stroke-width='1.5'/>");
    let _ = writeln!(svg, "<path d='{path}' stroke='#06c' stroke-width='1.5' fill='none'/>");
    let _ = writeln!(svg, "<text x='{LEFT}' y='{:.1}'>{}</text>", BAND + 18.0, escaped(&heading(scan)));
}

/// One line about a line-scan.
#[must_use]
pub fn heading(scan: &ReplayedScan) -> String {
    let mm = |value: Option<f32>, none: &str| value.map_or(none.to_owned(), |value| format!("{value:.1} mm"));
    let time = scan.t_ms.map_or("time unknown".to_owned(), |t_ms| format!("{t_ms:+.1} ms"));
    let voted = if scan.vote_complete { mm(scan.voted_gap_mm, "none") } else { "not known".to_owned() };
    format!(
        "line-scan {} ({}{time}): gap {}, voted {voted}, highest {}",
        scan.sequence,
        if scan.after_stop { "after the stop, " } else { "" },
        mm(scan.single_gap_mm, "none"),
        mm(scan.highest_mm, "nothing"),
    )
}

/// Eight heights of a character cell, from the floor upwards.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// The character for floor, below the floor, and no stripe.
const FLOOR: char = '_';
const BELOW: char = 'v';
const NO_STRIPE: char = '?';

/// The stripe of one line-scan in `columns` characters: `_` floor, bars above it (full at `full_mm`), `v` below the
/// floor, `?` no stripe. A character shows what is farthest from floor in its part of the stripe; nothing is averaged
/// away.
#[must_use]
pub fn to_line(scan: &ReplayedScan, columns: usize, full_mm: f32) -> String {
    let part = scan.profile.len().div_ceil(columns.max(1)).max(1);
    scan.profile.chunks(part).map(|points| cell(points, full_mm)).collect()
}

fn cell(points: &[(f32, Option<f32>)], full_mm: f32) -> char {
    if points.iter().any(|(_, height)| height.is_none()) {
        return NO_STRIPE;
    }
    let heights = points.iter().filter_map(|(_, height)| *height);
    let farthest = heights.fold(0.0_f32, |far, height| if height.abs() > far.abs() { height } else { far });
    if farthest.abs() <= FLOOR_TOLERANCE.get() {
        FLOOR
    } else if farthest < 0.0 {
        BELOW
    } else {
        let step = (farthest / full_mm * BARS.len() as f32) as usize;
        BARS[step.min(BARS.len() - 1)]
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('\'', "&apos;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::black_box::testing::recording_of_a_box;

    fn line(heights: &[Option<f32>]) -> String {
        let replay = Replay::of(&recording_of_a_box()).unwrap();
        let profile = (0..).map(|place| place as f32).zip(heights.iter().copied()).collect();
        to_line(&ReplayedScan { profile, ..replay.scans[0].clone() }, heights.len(), 40.0)
    }

    #[test]
    fn a_line_shows_floor_heights_drops_and_what_is_not_seen() {
        let heights = [Some(0.0), Some(1.8), Some(1.9), Some(20.1), Some(500.0), Some(-1.9), None];
        assert_eq!(line(&heights), "__▁▅█v?");
    }

    #[test]
    fn a_narrow_line_hides_nothing() {
        let replay = Replay::of(&recording_of_a_box()).unwrap();
        let mut profile = vec![(0.0, Some(0.0)); 100];
        profile[37].1 = Some(30.0);
        profile[81].1 = None;
        let scan = ReplayedScan { profile, ..replay.scans[0].clone() };
        assert_eq!(to_line(&scan, 10, 40.0), "___▇____?_");
        assert_eq!(to_line(&scan, 0, 40.0), "?");
        assert_eq!(to_line(&ReplayedScan { profile: Vec::new(), ..scan }, 10, 40.0), "");
    }

    #[test]
    fn the_picture_has_a_band_for_every_line_scan_and_names_the_limit() {
        let replay = Replay::of(&recording_of_a_box()).unwrap();
        let svg = to_svg(&replay);
        assert_eq!(svg.matches("<g ").count(), replay.scans.len());
        assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
        assert!(svg.contains("IMMEDIATE_GAP") && svg.contains("&gt;") && svg.contains("after the stop"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "every coordinate is a number");
    }
}
