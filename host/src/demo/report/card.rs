//! One act's card in the report.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::super::engine::Snapshot;
use super::super::record::{ActRecord, CheckRecord, DemoRecord, FrameRecord};
use super::super::script::{Act, Check};
use super::{CROSS, TICK, escape, plot};

/// Appends the card.
pub fn write(
    html: &mut String,
    record: &DemoRecord,
    index: usize,
    act: &ActRecord,
    script: &Act,
    snapshot: Option<&Snapshot>,
) {
    let (class, word) = if act.met() { ("badge", "kept") } else { ("badge no", "broken") };
    let _ = write!(
        html,
        "<article class='act' id='act-{}'><header><span class='number'>{}</span><div><h3>{}</h3>\
         <p class='promise'>{}</p></div><span class='{class}'>{word}</span></header>",
        act.name,
        index + 1,
        escape(act.title),
        escape(act.promise),
    );
    let frames = frames_of(record, act);
    html.push_str("<div class='body'><div>");
    if let Some(snapshot) = snapshot {
        picture(html, act, snapshot);
        profile(html, record, snapshot);
        html.push_str("</div><div>");
        reactions(html, act, script);
    } else {
        reactions(html, act, script);
        strip(html, record, act, script, frames);
        html.push_str("</div><div>");
    }
    checks(html, act);
    findings(html, act, frames, snapshot);
    if snapshot.is_some() {
        strip(html, record, act, script, frames);
    }
    html.push_str("</div></div></article>");
}

fn profile(html: &mut String, record: &DemoRecord, snapshot: &Snapshot) {
    let _ = write!(
        html,
        "<figure class='strip'>{}<figcaption class='legend'><span><i style='background:var(--truth)'></i>really there \
         and visible</span><span><i style='background:var(--floor)'></i>floor, as the host sees it</span><span><i \
         style='background:var(--raised)'></i>off the floor; height in mm</span></figcaption></figure>",
        plot::profile(snapshot, record.stripe_mm)
    );
}

fn strip(html: &mut String, record: &DemoRecord, act: &ActRecord, script: &Act, frames: &[FrameRecord]) {
    let plot = plot::strip(script, act.start_ms, frames, &record.relay_changes);
    let _ = write!(html, "<div class='strip'>{plot}</div>");
}

fn reactions(html: &mut String, act: &ActRecord, script: &Act) {
    for (check, wanted) in act.checks.iter().zip(&script.checks) {
        reaction(html, check, *wanted);
    }
}

fn checks(html: &mut String, act: &ActRecord) {
    html.push_str("<ul class='checks'>");
    for check in &act.checks {
        let (class, mark) = if check.met { ("", TICK) } else { (" class='no'", CROSS) };
        let _ = write!(
            html,
            "<li{class}>{mark}{}<em>{}</em></li>",
            escape(&sentence(&check.expected)),
            escape(&sentence(&check.happened))
        );
    }
    html.push_str("</ul>");
}

fn frames_of<'a>(record: &'a DemoRecord, act: &ActRecord) -> &'a [FrameRecord] {
    let first = record.frames.partition_point(|frame| frame.t_ms < act.start_ms);
    let last = record.frames.partition_point(|frame| frame.t_ms < act.end_ms);
    record.frames.get(first..last).unwrap_or(&[])
}

fn picture(html: &mut String, act: &ActRecord, snapshot: &Snapshot) {
    let _ = write!(
        html,
        "<figure><img loading='lazy' alt='Camera picture during: {}' src='data:image/jpeg;base64,{}'>\
         <figcaption>The camera&#39;s picture {:.1} s into the act.</figcaption></figure>",
        escape(act.title),
        STANDARD.encode(&snapshot.jpeg),
        (snapshot.t_ms - act.start_ms) / 1000.0,
    );
}

fn reaction(html: &mut String, check: &CheckRecord, wanted: Check) {
    let (Check::Opens(_, bound, _), Some(reaction)) = (wanted, check.reaction_ms) else { return };
    let from = if check.from_light {
        "from the first interrupted light to the open command"
    } else {
        "to the open command"
    };
    let text = if reaction < 0.5 { "at once".to_owned() } else { format!("{reaction:.0} ms") };
    let contacts =
        check.contacts_open_ms.map_or(String::new(), |ms| format!("; contacts open after {ms:.0} ms"));
    let share = (reaction / bound * 100.0).clamp(1.0, 100.0);
    let class = if check.met { "" } else { " class='no'" };
    let _ = write!(
        html,
        "<div class='reaction'><b>{text}</b><span>{from}, promised {bound:.0} ms{contacts}</span>\
         <div class='bar'><i{class} style='width:{share:.0}%'></i></div></div>"
    );
}

/// What the controller found, in words.
fn findings(html: &mut String, act: &ActRecord, frames: &[FrameRecord], snapshot: Option<&Snapshot>) {
    let causes: Vec<String> = act
        .causes
        .iter()
        .filter(|cause| **cause != "interlock")
        .map(|cause| cause.replace('_', " "))
        .collect();
    let mut rows = String::new();
    let mut row = |name: &str, value: String| {
        let _ = write!(rows, "<tr><th>{name}</th><td>{}</td></tr>", escape(&value));
    };
    if !causes.is_empty() && act.checks.iter().any(|check| check.reaction_ms.is_some()) {
        row("causes", causes.join(", "));
    }
    let here = snapshot.and_then(|snapshot| frames.iter().find(|frame| frame.t_ms >= snapshot.t_ms));
    if let Some(frame) = here {
        let gap = frame.longest_gap_mm.map_or("none".to_owned(), |gap| format!("{gap:.1} mm"));
        row("longest gap in the picture", format!("{gap} (really {:.1} mm)", frame.true_gap_mm));
        if let (Some(measured), Some(real)) = (frame.highest_mm, frame.true_highest_mm) {
            row("highest point in the picture", format!("{measured:.1} mm (really {real:.1} mm)"));
        }
    }
    if !rows.is_empty() {
        let _ = write!(html, "<table>{rows}</table>");
    }
}

/// With a capital letter and a full stop; a number and its unit stay on one line.
fn sentence(text: &str) -> String {
    let mut text = format!("{text}.");
    for unit in ["ms", "mm", "s"] {
        for end in [' ', '.', ',', ';'] {
            text = text.replace(&format!(" {unit}{end}"), &format!("\u{a0}{unit}{end}"));
        }
    }
    let mut letters = text.chars();
    let first: String = letters.next().map(|letter| letter.to_uppercase().collect()).unwrap_or_default();
    format!("{first}{}", letters.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_begin_and_end_well_and_keep_numbers_with_their_units() {
        assert_eq!(
            sentence("stays open from 1.20 s to 3.10 s"),
            "Stays open from 1.20\u{a0}s to 3.10\u{a0}s."
        );
        assert_eq!(sentence("relays stay closed"), "Relays stay closed.");
        assert_eq!(sentence(""), ".");
    }
}
