//! The demo in a terminal: live, with the stripe's profile and the relays, or one line an act.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, LineGauge, Paragraph, Wrap};
use ratatui::{DefaultTerminal, Frame};

use super::engine::{Audience, DemoError, Moment};
use super::record::{ActRecord, FrameRecord};

/// Colours that colour-blind people tell apart (Okabe and Ito's, nearest of the 256); words say the same.
const CLOSED: Color = Color::Indexed(36);
const OPEN: Color = Color::Indexed(166);
const FLOOR: Color = Color::Indexed(74);
const RAISED: Color = Color::Indexed(214);
const QUIET: Color = Color::Indexed(245);

/// Stripe points higher or lower than this are drawn as raised, millimetres.
const FLOOR_BAND_MM: f64 = 1.8;
/// Heights that the plot shows, millimetres.
const PLOT_HEIGHTS_MM: [f64; 2] = [-15.0, 75.0];
/// In the fast mode one frame of so many is drawn.
const FAST_STRIDE: u32 = 5;
/// In real time one frame of so many is drawn.
const REAL_TIME_STRIDE: u32 = 2;

/// One line an act, for logs and pipes.
#[derive(Debug)]
pub struct PlainLines<W: Write> {
    out: W,
}

impl<W: Write> PlainLines<W> {
    /// Writes to `out`.
    pub const fn new(out: W) -> Self {
        Self { out }
    }
}

impl<W: Write> Audience for PlainLines<W> {
    fn frame(&mut self, _: &Moment<'_>) -> Result<(), DemoError> {
        Ok(())
    }

    fn act_over(&mut self, record: &ActRecord) -> Result<(), DemoError> {
        let mark = if record.met() { "ok    " } else { "FAILED" };
        let reaction = record.checks.iter().find_map(|check| check.reaction_ms);
        let reaction = reaction.map_or(String::new(), |ms| format!("  (open after {ms:.0} ms)"));
        writeln!(self.out, "{mark} {:>5.1} s  {}{reaction}", record.start_ms / 1000.0, record.title)?;
        for check in record.checks.iter().filter(|check| !check.met) {
            writeln!(self.out, "              expected: {}; but: {}", check.expected, check.happened)?;
        }
        Ok(())
    }
}

/// Nobody looks.
#[derive(Debug, Clone, Copy)]
pub struct Nobody;

impl Audience for Nobody {
    fn frame(&mut self, _: &Moment<'_>) -> Result<(), DemoError> {
        Ok(())
    }

    fn act_over(&mut self, _: &ActRecord) -> Result<(), DemoError> {
        Ok(())
    }
}

/// The live view; takes the whole terminal until it is dropped.
pub struct Live {
    terminal: DefaultTerminal,
    begun: Instant,
    fast: bool,
}

impl Live {
    /// Takes the terminal. `fast` does not wait for the clock.
    ///
    /// # Errors
    /// The terminal does not work.
    pub fn open(fast: bool) -> io::Result<Self> {
        Ok(Self { terminal: ratatui::try_init()?, begun: Instant::now(), fast })
    }

    fn leave_wanted() -> io::Result<bool> {
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()? {
                let control_c =
                    key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                if control_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

impl Audience for Live {
    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), DemoError> {
        if Self::leave_wanted()? {
            return Err(DemoError::Interrupted);
        }
        let stride = if self.fast { FAST_STRIDE } else { REAL_TIME_STRIDE };
        if moment.record.frame.is_multiple_of(stride) {
            self.terminal.draw(|frame| draw(frame, moment))?;
        }
        if !self.fast {
            let due = self.begun + Duration::from_secs_f64(moment.record.t_ms / 1000.0);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }

    fn act_over(&mut self, _: &ActRecord) -> Result<(), DemoError> {
        Ok(())
    }
}

/// Draws one moment; the layout gives way on small terminals.
pub fn draw(frame: &mut Frame<'_>, moment: &Moment<'_>) {
    let [top, middle, bottom] =
        Layout::vertical([Constraint::Length(3), Constraint::Min(10), Constraint::Length(9)])
            .areas(frame.area());
    let [plot, side] = Layout::horizontal([Constraint::Min(40), Constraint::Length(34)]).areas(middle);
    let [relay, facts] = Layout::vertical([Constraint::Length(5), Constraint::Min(5)]).areas(side);
    draw_clock(frame, top, moment);
    draw_profile(frame, plot, moment);
    draw_relay(frame, relay, moment.record);
    draw_facts(frame, facts, moment.record);
    draw_acts(frame, bottom, moment);
}

fn draw_clock(frame: &mut Frame<'_>, area: Rect, moment: &Moment<'_>) {
    let end = moment.timeline.end_ms();
    let title = format!(" nearfield demo: a minute at the robot's edge ({} controller) ", moment.mcu.name());
    let gauge = LineGauge::default()
        .block(Block::bordered().title(title).title_bottom(Line::from(" q leaves ").right_aligned()))
        .label(format!("{:4.1} s of {:.0} s", moment.record.t_ms / 1000.0, end / 1000.0))
        .filled_style(Style::new().fg(FLOOR))
        .unfilled_style(Style::new().fg(QUIET))
        .ratio((moment.record.t_ms / end).clamp(0.0, 1.0));
    frame.render_widget(gauge, area);
}

fn draw_profile(frame: &mut Frame<'_>, area: Rect, moment: &Moment<'_>) {
    let points = moment.profile.iter().map(|(s, height)| (f64::from(*s), f64::from(*height)));
    let seen: Vec<(f64, f64)> = points.filter(|(_, height)| height.is_finite()).collect();
    let (floor, raised): (Vec<_>, Vec<_>) =
        seen.iter().partition(|(_, height)| height.abs() <= FLOOR_BAND_MM);
    let ends = moment.profile.first().zip(moment.profile.last());
    let (first, last) =
        ends.map_or((-1.0, 1.0), |((first, _), (last, _))| (f64::from(*first), f64::from(*last)));
    let limit = [(first, 50.0), (last, 50.0)];
    let dots = |name: &'static str, data, colour| {
        Dataset::default().name(name).data(data).marker(Marker::Braille).style(Style::new().fg(colour))
    };
    let datasets = vec![
        dots("50 mm", &limit, QUIET).graph_type(GraphType::Line),
        dots("floor", &floor, FLOOR),
        dots("raised", &raised, RAISED),
    ];
    let label = |value: f64| Span::raw(format!("{value:.0}"));
    let chart = Chart::new(datasets)
        .block(Block::bordered().title(" light along the stripe, as the host sees it: height in mm "))
        .x_axis(Axis::default().bounds([first, last]).labels([
            label(first),
            label((first + last) / 2.0),
            label(last),
        ]))
        .y_axis(Axis::default().bounds(PLOT_HEIGHTS_MM).labels(["-15", "15", "45", "75"]));
    frame.render_widget(chart, area);
}

fn draw_relay(frame: &mut Frame<'_>, area: Rect, record: &FrameRecord) {
    let (word, meaning, colour) = match (record.commanded_closed, record.contacts_closed) {
        (true, true) => ("R U N", "relays closed", CLOSED),
        (true, false) => ("R U N", "relays closing", CLOSED),
        (false, true) => ("S T O P", "relays opening", OPEN),
        (false, false) => ("S T O P", "relays open", OPEN),
    };
    let style = Style::new().bg(colour).fg(Color::Indexed(231)).add_modifier(Modifier::BOLD);
    let text = vec![Line::raw(""), Line::raw(word), Line::raw(meaning)];
    frame.render_widget(Paragraph::new(text).style(style).centered().block(Block::bordered()), area);
}

fn draw_facts(frame: &mut Frame<'_>, area: Rect, record: &FrameRecord) {
    let number = |value: Option<f32>, none: &str| value.map_or(none.to_owned(), |mm| format!("{mm:.1} mm"));
    let row = |name: &'static str, value: String| {
        Line::from(vec![Span::styled(format!("{name:<13}"), Style::new().fg(QUIET)), Span::raw(value)])
    };
    let mut lines = vec![
        row("state", record.state.replace('_', " ")),
        row("longest gap", number(record.longest_gap_mm, "none")),
        row("highest", number(record.highest_mm, "nothing raised")),
        row("light age", format!("{:.0} ms", record.decision_age_ms)),
    ];
    let causes = if record.live_causes.is_empty() { &record.latched_causes } else { &record.live_causes };
    for cause in causes {
        lines.push(Line::styled(format!("- {}", cause.replace('_', " ")), Style::new().fg(RAISED)));
    }
    let block = Block::bordered().title(" safety controller ");
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

fn draw_acts(frame: &mut Frame<'_>, area: Rect, moment: &Moment<'_>) {
    let acts = moment.timeline.acts();
    let current = moment.record.act;
    let room = usize::from(area.height.saturating_sub(5));
    let mut lines: Vec<Line<'_>> = Vec::new();
    let done = moment.acts.iter().enumerate().skip(moment.acts.len().saturating_sub(room));
    for (index, act) in done {
        let (mark, colour) = if act.met() { ("ok    ", CLOSED) } else { ("FAILED", OPEN) };
        let text = format!(" {:>2} {}", index + 1, act.title);
        lines.push(Line::from(vec![Span::styled(mark, Style::new().fg(colour)), Span::styled(text, QUIET)]));
    }
    if let Some(act) = acts.get(current) {
        let title = format!("now    {:>2} {}", current + 1, act.title);
        lines.push(Line::styled(title, Style::new().add_modifier(Modifier::BOLD)));
        lines.push(Line::raw(format!("          {}", act.promise)));
    }
    let title = format!(" act {} of {} ", current + 1, acts.len());
    frame.render_widget(
        Paragraph::new(lines).wrap(Wrap { trim: false }).block(Block::bordered().title(title)),
        area,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::record::{CheckRecord, MessageFate};
    use crate::demo::script::minute;
    use crate::demo::timeline::Timeline;
    use crate::link::McuKind;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn record(closed: bool, causes: &[&'static str]) -> FrameRecord {
        FrameRecord {
            frame: 700,
            t_ms: 14_000.0,
            act: 3,
            state: "stopped",
            commanded_closed: closed,
            contacts_closed: closed,
            longest_gap_mm: Some(12.34),
            true_gap_mm: 12.0,
            highest_mm: Some(9.0),
            true_highest_mm: Some(9.0),
            live_causes: causes.to_vec(),
            latched_causes: Vec::new(),
            decision_age_ms: 25.0,
            message: MessageFate::Sent,
            host_cut: true,
            laser_level: 255,
        }
    }

    fn screen(width: u16, height: u16, record: &FrameRecord) -> String {
        let timeline = Timeline::new(minute());
        let profile: Vec<(f32, f32)> =
            (-400..400).map(|s| (s as f32, if s > 0 { 30.0 } else { f32::NAN })).collect();
        let moment =
            Moment { record, timeline: &timeline, acts: &[], profile: &profile, mcu: McuKind::InProcess };
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, &moment)).unwrap();
        terminal.backend().to_string()
    }

    #[test]
    fn the_live_view_tells_relay_gap_height_causes_and_act_in_words() {
        let text = screen(110, 34, &record(false, &["stripe_cut"]));
        let act = format!("act 4 of {}", minute().len());
        for words in
            ["S T O P", "relays open", "12.3 mm", "9.0 mm", "stripe cut", "14.0 s of 60 s", act.as_str()]
        {
            assert!(text.contains(words), "{words} is missing from\n{text}");
        }
        assert!(screen(110, 34, &record(true, &[])).contains("R U N"));
    }

    #[test]
    fn small_terminals_do_not_break_it() {
        for (width, height) in [(1, 1), (20, 5), (40, 12), (80, 24)] {
            screen(width, height, &record(false, &["stripe_cut"]));
        }
    }

    #[test]
    fn plain_lines_name_what_failed() {
        let check = CheckRecord {
            expected: "relays open".into(),
            happened: "never opened".into(),
            met: false,
            reaction_ms: None,
            contacts_open_ms: None,
            from_light: false,
        };
        let act = ActRecord {
            name: "cable",
            title: "A cable",
            promise: "",
            start_ms: 1000.0,
            end_ms: 2000.0,
            checks: vec![check],
            causes: Vec::new(),
            largest_gap_mm: None,
            highest_mm: None,
        };
        let mut out = Vec::new();
        PlainLines::new(&mut out).act_over(&act).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(text.contains("FAILED") && text.contains("never opened"), "{text}");
    }
}
