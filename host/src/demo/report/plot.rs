//! The report's plots, as SVG by hand: colours come from the page's style, so that they follow light and dark.

use std::fmt::Write as _;

use super::super::engine::Snapshot;
use super::super::record::{DemoRecord, FrameRecord, MessageFate};
use super::super::script::{Act, Action};
use super::escape;

/// The timeline's size and margins, SVG units.
const WIDTH: f64 = 1200.0;
const LEFT: f64 = 128.0;
const RIGHT: f64 = 12.0;
/// Gaps and heights beyond these are cut off, millimetres.
const HIGHEST_GAP_MM: f64 = 40.0;
const HIGHEST_POINT_MM: f64 = 80.0;
/// Limits that are drawn, millimetres.
const GAP_LIMIT_MM: f64 = 5.0;
const HEIGHT_LIMIT_MM: f64 = 50.0;
/// A camera frame's period, milliseconds.
const FRAME_MS: f64 = 20.0;

/// Time to the right, one band below the other.
struct Scale {
    start_ms: f64,
    per_ms: f64,
    left: f64,
}

impl Scale {
    fn x(&self, t_ms: f64) -> f64 {
        self.left + (t_ms - self.start_ms) * self.per_ms
    }
}

/// Stretches of frames for which something holds, in milliseconds.
fn stretches(frames: &[FrameRecord], holds: impl Fn(&FrameRecord) -> bool) -> Vec<(f64, f64)> {
    let mut runs: Vec<(f64, f64)> = Vec::new();
    let mut open = false;
    for frame in frames {
        let now = holds(frame);
        if now {
            let end = frame.t_ms + FRAME_MS;
            match runs.last_mut() {
                Some(run) if open => run.1 = end,
                _ => runs.push((frame.t_ms, end)),
            }
        }
        open = now;
    }
    runs
}

fn bar(svg: &mut String, scale: &Scale, (from, to): (f64, f64), (top, height): (f64, f64), style: &str) {
    let (left, right) = (scale.x(from), scale.x(to));
    let width = (right - left).max(1.5);
    // Writing to a String cannot fail; so everywhere below.
    let _ = write!(svg, "<rect x='{left:.1}' y='{top}' width='{width:.1}' height='{height}' {style}/>");
}

fn label(svg: &mut String, x: f64, y: f64, class: &str, anchor: &str, text: &str) {
    let text = escape(text);
    let _ = write!(svg, "<text x='{x:.1}' y='{y:.1}' class='{class}' text-anchor='{anchor}'>{text}</text>");
}

const HATCH: &str = "<defs><pattern id='hatch' width='6' height='6' patternUnits='userSpaceOnUse' \
    patternTransform='rotate(45)'><rect width='6' height='6' fill='var(--stop-soft)'/>\
    <line x1='0' y1='0' x2='0' y2='6' stroke='var(--stop)' stroke-width='2'/></pattern></defs>";

/// The whole minute: acts, relays, gap, height, causes.
pub fn timeline(record: &DemoRecord) -> String {
    let end = record.acts.last().map_or(1.0, |act| act.end_ms);
    let scale = Scale { start_ms: 0.0, per_ms: (WIDTH - LEFT - RIGHT) / end, left: LEFT };
    let causes = causes(record);
    let height = 298.0 + 19.0 * causes.len() as f64 + 30.0;
    let mut svg = format!(
        "<svg viewBox='0 0 {WIDTH} {height}' role='img' aria-label='Timeline of the minute: acts, relays, longest gap, \
         highest point and causes'>{HATCH}"
    );
    for (index, act) in record.acts.iter().enumerate() {
        let fill = if index % 2 == 0 { "fill='var(--faint)'" } else { "fill='none'" };
        let _ = write!(svg, "<a href='#act-{}'><title>{}</title>", act.name, escape(act.title));
        bar(&mut svg, &scale, (act.start_ms, act.end_ms), (0.0, height - 26.0), fill);
        let class = if act.met() { "strong" } else { "strong no" };
        label(
            &mut svg,
            scale.x((act.start_ms + act.end_ms) / 2.0),
            18.0,
            class,
            "middle",
            &format!("{}", index + 1),
        );
        svg.push_str("</a>");
    }
    label(&mut svg, 0.0, 18.0, "", "start", "act");
    relay_band(&mut svg, &scale, &record.frames, &record.relay_changes, end, (30.0, 24.0));
    label(&mut svg, 0.0, 47.0, "", "start", "relays");
    let gap =
        Lane { top: 72.0, height: 90.0, full: HIGHEST_GAP_MM, limit: GAP_LIMIT_MM, colour: "var(--floor)" };
    gap.draw(&mut svg, &scale, end, &record.frames, |frame| f64::from(frame.longest_gap_mm.unwrap_or(0.0)));
    gap.names(&mut svg, "longest gap", "mm, limit 5");
    let high = Lane {
        top: 182.0,
        height: 90.0,
        full: HIGHEST_POINT_MM,
        limit: HEIGHT_LIMIT_MM,
        colour: "var(--raised)",
    };
    high.draw(&mut svg, &scale, end, &record.frames, |frame| f64::from(frame.highest_mm.unwrap_or(0.0)));
    high.names(&mut svg, "highest point", "mm, limit 50");
    for (row, cause) in causes.iter().enumerate() {
        let top = 290.0 + 19.0 * row as f64;
        label(&mut svg, 0.0, top + 11.0, "", "start", &cause.replace('_', " "));
        for run in stretches(&record.frames, |frame| frame.live_causes.contains(cause)) {
            bar(&mut svg, &scale, run, (top + 2.0, 10.0), "rx='2' fill='var(--stop)'");
        }
    }
    for second in (0..=(end / 1000.0) as u32).step_by(5) {
        let x = scale.x(f64::from(second) * 1000.0);
        label(&mut svg, x.min(WIDTH - 14.0), height - 8.0, "", "middle", &format!("{second} s"));
    }
    svg.push_str("</svg>");
    svg
}

/// Causes that held at any time, without the interlock's (which follows every stop).
fn causes(record: &DemoRecord) -> Vec<&'static str> {
    let mut seen = Vec::new();
    for cause in record.frames.iter().flat_map(|frame| &frame.live_causes) {
        if !seen.contains(cause) && *cause != "interlock" {
            seen.push(*cause);
        }
    }
    seen
}

/// Closed stretches filled, open ones hatched: not told by colour alone.
fn relay_band(
    svg: &mut String,
    scale: &Scale,
    frames: &[FrameRecord],
    changes: &[(f64, bool)],
    end: f64,
    place: (f64, f64),
) {
    let start = frames.first().map_or(0.0, |frame| frame.t_ms);
    let mut from = start;
    let mut closed =
        changes.iter().take_while(|(when, _)| *when <= start).last().is_some_and(|(_, closed)| *closed);
    let mut draw = |from: f64, to: f64, closed: bool| {
        let style = if closed { "fill='var(--run)'" } else { "fill='url(#hatch)'" };
        bar(svg, scale, (from, to), place, style);
    };
    for (when, now) in changes.iter().filter(|(when, _)| (start..end).contains(when)) {
        if *when > from {
            draw(from, *when, closed);
        }
        (from, closed) = (*when, *now);
    }
    draw(from, end, closed);
}

/// A quantity over time with its limit.
struct Lane {
    top: f64,
    height: f64,
    full: f64,
    limit: f64,
    colour: &'static str,
}

impl Lane {
    fn y(&self, value: f64) -> f64 {
        self.top + self.height * (1.0 - (value / self.full).clamp(0.0, 1.0))
    }

    fn draw(
        &self,
        svg: &mut String,
        scale: &Scale,
        end: f64,
        frames: &[FrameRecord],
        value: impl Fn(&FrameRecord) -> f64,
    ) {
        let base = self.y(0.0);
        let mut path = format!("M{:.1} {base:.1}", scale.x(0.0));
        let mut last = f64::NAN;
        for frame in frames {
            let y = (self.y(value(frame)) * 10.0).round() / 10.0;
            if y != last {
                let _ = write!(path, "H{:.1}V{y}", scale.x(frame.t_ms));
                last = y;
            }
        }
        let _ = write!(path, "H{:.1}V{base:.1}Z", scale.x(end));
        let colour = self.colour;
        let _ = write!(
            svg,
            "<path d='{path}' fill='{colour}' fill-opacity='.28' stroke='{colour}' stroke-width='1.4'/>"
        );
        let limit = self.y(self.limit);
        let _ = write!(
            svg,
            "<line x1='{LEFT}' y1='{limit:.1}' x2='{:.1}' y2='{limit:.1}' stroke='var(--stop)' stroke-dasharray='5 4'/>",
            scale.x(end)
        );
    }

    fn names(&self, svg: &mut String, name: &str, unit: &str) {
        label(svg, 0.0, self.top + 16.0, "", "start", name);
        label(svg, 0.0, self.top + 32.0, "", "start", unit);
        label(svg, LEFT - 6.0, self.top + 10.0, "", "end", &format!("{:.0}+", self.full));
        label(svg, LEFT - 6.0, self.y(0.0), "", "end", "0");
    }
}

/// One act close up: relays, messages, and what was done.
pub fn strip(act: &Act, start_ms: f64, frames: &[FrameRecord], changes: &[(f64, bool)]) -> String {
    let (width, left) = (540.0, 78.0);
    let end = start_ms + act.length_ms;
    let scale = Scale { start_ms, per_ms: (width - left - 18.0) / act.length_ms, left };
    let mut svg = format!(
        "<svg viewBox='0 0 {width} 92' role='img' aria-label='Relays and messages during this act'>{HATCH}"
    );
    relay_band(&mut svg, &scale, frames, changes, end, (18.0, 16.0));
    label(&mut svg, 0.0, 31.0, "", "start", "relays");
    label(&mut svg, 0.0, 57.0, "", "start", "messages");
    bar(&mut svg, &scale, (start_ms, end), (50.0, 4.0), "fill='var(--floor)' fill-opacity='.55'");
    for (fate, style) in [
        (MessageFate::Dropped, "fill='var(--card)' stroke='var(--stop)' stroke-dasharray='3 2'"),
        (MessageFate::Damaged, "fill='var(--stop)'"),
        (MessageFate::Repeated, "fill='var(--raised)'"),
        (MessageFate::FalseClear, "fill='var(--raised)'"),
        (MessageFate::StopRequest, "fill='var(--stop)'"),
    ] {
        for run in stretches(frames, |frame| frame.message == fate) {
            bar(&mut svg, &scale, run, (46.0, 12.0), &format!("rx='2' {style}"));
            label(&mut svg, scale.x(run.1) + 5.0, 57.0, "ink", "start", fate_words(fate));
        }
    }
    for cue in &act.cues {
        let (at, word) = match cue.action {
            Action::PressReset => (cue.at_ms, "reset pressed"),
            Action::HangController => (cue.at_ms, "program hangs"),
            _ => continue,
        };
        let x = scale.x(start_ms + at);
        let _ = write!(svg, "<path d='M{x:.1} 16l-5 -8h10z' fill='var(--ink)'/>");
        label(&mut svg, x + 8.0, 12.0, "ink", "start", word);
    }
    for tick in 0..=(act.length_ms / 500.0) as u32 {
        let t = f64::from(tick) * 500.0;
        let _ = write!(
            svg,
            "<line x1='{0:.1}' x2='{0:.1}' y1='66' y2='{1}' stroke='var(--line)'/>",
            scale.x(start_ms + t),
            if tick % 2 == 0 { 73 } else { 70 }
        );
        if tick % 2 == 0 {
            label(&mut svg, scale.x(start_ms + t), 87.0, "", "middle", &format!("{:.0} s", t / 1000.0));
        }
    }
    svg.push_str("</svg>");
    svg
}

const fn fate_words(fate: MessageFate) -> &'static str {
    match fate {
        MessageFate::Sent => "sent",
        MessageFate::Dropped => "lost",
        MessageFate::Damaged => "damaged",
        MessageFate::Repeated => "the same one again",
        MessageFate::FalseClear => "claim \"clear\"",
        MessageFate::StopRequest => "ask for a stop",
    }
}

/// Height along the stripe in one picture: what the host sees over what is really there.
pub fn profile(snapshot: &Snapshot, stripe_mm: [f64; 2]) -> String {
    let (width, height, left, bottom) = (540.0, 200.0, 40.0, 26.0);
    let seen = snapshot.profile.iter().filter(|(_, z)| z.is_finite());
    let highest =
        snapshot.true_profile.iter().map(|(_, z, _)| *z).chain(seen.clone().map(|(_, z)| f64::from(*z)));
    let top_mm = highest.fold(20.0, f64::max) * 1.15;
    let x = |s: f64| left + (s - stripe_mm[0]) / (stripe_mm[1] - stripe_mm[0]) * (width - left - 8.0);
    let y = |z: f64| (height - bottom - 8.0) * (1.0 - (z + 4.0) / (top_mm + 4.0)) + 4.0;
    let mut svg = format!(
        "<svg viewBox='0 0 {width} {height}' role='img' aria-label='Height of the light along the stripe'>"
    );
    for level in [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 75.0, 100.0] {
        if level <= top_mm {
            let (stroke, dash) = if level == 50.0 { ("var(--stop)", "5 4") } else { ("var(--line)", "none") };
            let _ = write!(
                svg,
                "<line x1='{left}' x2='{:.1}' y1='{1:.1}' y2='{1:.1}' stroke='{stroke}' stroke-dasharray='{dash}'/>",
                width - 8.0,
                y(level)
            );
            label(&mut svg, left - 6.0, y(level) + 4.0, "", "end", &format!("{level:.0}"));
        }
    }
    let mut truth = String::new();
    let mut pen = 'M';
    for (s, z, visible) in &snapshot.true_profile {
        if *visible {
            let _ = write!(truth, "{pen}{:.1} {:.1}", x(*s), y(*z));
        }
        pen = if *visible { 'L' } else { 'M' };
    }
    let _ = write!(
        svg,
        "<path d='{truth}' fill='none' stroke='var(--truth)' stroke-width='5' stroke-opacity='.55'/>"
    );
    for (s, z) in seen.step_by(2) {
        let colour = if z.abs() <= 1.8 { "var(--floor)" } else { "var(--raised)" };
        let _ = write!(
            svg,
            "<circle cx='{:.1}' cy='{:.1}' r='1.6' fill='{colour}'/>",
            x(f64::from(*s)),
            y(f64::from(*z))
        );
    }
    for s in [stripe_mm[0], (stripe_mm[0] + stripe_mm[1]) / 2.0, stripe_mm[1]] {
        let anchor = if s == stripe_mm[0] {
            "start"
        } else if s == stripe_mm[1] {
            "end"
        } else {
            "middle"
        };
        label(&mut svg, x(s), height - 6.0, "", anchor, &format!("{s:.0} mm"));
    }
    svg.push_str("</svg>");
    svg
}
