//! The demo's report: one HTML file that needs nothing else, for people who were not there.

mod card;
mod plot;

use std::fmt::Write as _;

use super::engine::{Outcome, Snapshot};
use super::record::DemoRecord;
use super::script::{Act, LIGHT_TO_COMMAND_MS};

const STYLE: &str = include_str!("style.css");
const TICK: &str = "<svg viewBox='0 0 20 20' aria-hidden='true'><path d='M4 10.5l4 4 8-9' fill='none' \
    stroke='currentColor' stroke-width='2.4' stroke-linecap='round' stroke-linejoin='round'/></svg>";
const CROSS: &str = "<svg viewBox='0 0 20 20' aria-hidden='true'><path d='M5 5l10 10M15 5L5 15' fill='none' \
    stroke='currentColor' stroke-width='2.4' stroke-linecap='round'/></svg>";

/// Text for use within HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

/// The page for a finished demo. `acts` is the script that was played.
#[must_use]
pub fn page(outcome: &Outcome, acts: &[Act]) -> String {
    let record = &outcome.record;
    let mut html = String::with_capacity(1 << 20);
    let _ = write!(
        html,
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>\
         <meta name='viewport' content='width=device-width,initial-scale=1'>\
         <meta name='color-scheme' content='light dark'><title>nearfield: a minute at the robot's edge</title>\
         <style>{STYLE}</style></head><body><main>"
    );
    head(&mut html, record);
    timeline(&mut html, record);
    html.push_str(
        "<section><h2>Act by act</h2><p>Each act states what must happen before it is played. The pictures are what \
         the camera sees; the blue line above the stripe marks lit floor as the host found it, the orange one stripe off the floor. Times count from the act&#39;s beginning.</p>",
    );
    for (index, act) in record.acts.iter().enumerate() {
        let Some(script) = acts.get(index) else { continue };
        let snapshot: Option<&Snapshot> = outcome.snapshots.iter().find(|snapshot| snapshot.act == index);
        card::write(&mut html, record, index, act, script, snapshot);
    }
    html.push_str("</section>");
    health(&mut html, record);
    closing(&mut html, record);
    html.push_str("</main></body></html>\n");
    html
}

fn head(html: &mut String, record: &DemoRecord) {
    let (met, all) = record.score();
    let (class, mark, verdict) = if record.met {
        ("verdict", TICK, format!("All {all} promises kept"))
    } else {
        ("verdict no", CROSS, format!("{} of {all} promises broken", all - met))
    };
    let controller = match record.mcu {
        "emulated" => "the firmware's own binary on an emulated Cortex-M4",
        _ => "the firmware's own code, linked into this program",
    };
    let _ = write!(
        html,
        "<header><p class='over'>nearfield demo report</p><h1>A minute at the robot&#39;s edge</h1>\
         <p class='lead'>A laser draws a stripe on the floor in front of a mobile robot, a camera watches it, and two \
         relays stop the robot when something cuts it. <b>Camera pictures become line-scans, line-scans become \
         decisions of {controller}, decisions move relays</b> &mdash; frame by frame, with nothing in between left out. \
         Things, faults and one liar try to get past it.</p>\
         <p class='{class}' role='status'>{mark}{verdict}</p>"
    );
    let reaction =
        record.light_reactions().map_or("&ndash;".to_owned(), |(_, slowest)| format!("{slowest:.0}"));
    let closed = closed_seconds(record);
    let stops = false_stops(record);
    let _ = write!(
        html,
        "<div class='figures'><div><b>{met}<small> of {all}</small></b><span>promises kept in {} acts</span></div>\
         <div><b>{reaction}<small> ms</small></b><span>slowest reaction, from the first interrupted light to the open \
         command; promised: {LIGHT_TO_COMMAND_MS:.0} ms</span></div>\
         <div><b>{stops}</b><span>false stops in {closed:.0} seconds of running</span></div>\
         <div><b>{}</b><span>camera frames of {}&times;{} rendered, read, sent and judged</span></div></div></header>",
        record.acts.len(),
        record.frames.len(),
        record.picture[0],
        record.picture[1],
    );
}

fn closed_seconds(record: &DemoRecord) -> f64 {
    record.frames.iter().filter(|frame| frame.contacts_closed).count() as f64 * 0.02
}

/// Broken promises to keep running.
fn false_stops(record: &DemoRecord) -> usize {
    let checks = record.acts.iter().flat_map(|act| &act.checks);
    checks.filter(|check| !check.met && check.expected.contains("stay closed")).count()
}

fn timeline(html: &mut String, record: &DemoRecord) {
    let _ = write!(
        html,
        "<section><h2>The minute</h2><p>Numbers are the acts below. The relays close only after somebody has pressed \
         and released the reset button; every cause opens them at once.</p>\
         <div class='panel'><div class='scroll'>{}</div><div class='legend'>\
         <span><i style='background:var(--run)'></i>relays closed, the robot may run</span>\
         <span><i style='background:repeating-linear-gradient(45deg,var(--stop) 0 2px,var(--stop-soft) 2px 5px)'></i>\
         relays open, stop</span>\
         <span><i style='background:var(--floor)'></i>longest gap in the stripe (the controller&#39;s own figure)</span>\
         <span><i style='background:var(--raised)'></i>highest point of the stripe</span>\
         <span><i style='background:var(--stop)'></i>a cause to stop holds</span></div></div></section>",
        plot::timeline(record)
    );
}

fn health(html: &mut String, record: &DemoRecord) {
    let link = &record.link;
    let mut rows = format!("<tr><th>accepted</th><td class='figure'>{}</td></tr>", link.accepted);
    for (cause, count) in &link.refused {
        let words = cause.replace('_', " ");
        let _ = write!(rows, "<tr><th>{words}</th><td class='figure'>{count}</td></tr>");
    }
    let _ = write!(
        html,
        "<section><h2>The link in figures</h2><p>Line-scans that the controller accepted and refused, each error counted \
         by its kind. Not one refused message was used.</p><div class='two'>\
         <div class='panel'><h3>Messages</h3><table>{rows}</table></div>\
         <div class='panel'><h3>Run</h3><table>\
         <tr><th>controller</th><td class='figure'>{}</td></tr>\
         <tr><th>longest light to decision</th><td class='figure'>{:.0} ms (bound {:.0} ms)</td></tr>\
         <tr><th>watchdog resets</th><td class='figure'>{}</td></tr>\
         <tr><th>calibration</th><td class='figure'>{}</td></tr>\
         <tr><th>firmware</th><td class='figure'>{}</td></tr>\
         <tr><th>seed</th><td class='figure'>{}</td></tr>\
         <tr><th>time to play it</th><td class='figure'>{:.1} s</td></tr></table></div></div></section>",
        record.mcu,
        link.longest_decision_age_ms,
        link.response_bound_ms,
        link.watchdog_resets,
        record.calibration_id,
        record.firmware_id,
        record.seed,
        record.wall_seconds,
    );
}

fn closing(html: &mut String, record: &DemoRecord) {
    let controller = match record.mcu {
        "emulated" => "the firmware ran as its Arm binary in QEMU, in lock-step with the simulated time",
        _ => "the firmware ran in this process, on simulated time",
    };
    let _ = write!(
        html,
        "<section><h2>What this is, and what it is not</h2><p></p><p class='note'>This minute was <b>run in software</b>: \
         the camera is the project&#39;s digital twin, {controller}, the relays are a model with typical times (10 ms to \
         close, 20 ms to open), the watchdog bites after 100 ms as configured. The firmware for the STM32G474 board is \
         built from the same code; <b>nobody has run it on hardware yet</b>, and nothing here is certified.</p>\
         <p class='note'>Reactions are counted from the first laser ray that no longer reaches the floor in the \
         camera&#39;s sight &mdash; known exactly, because the twin knows its objects &mdash; to the moment at which the \
         controller commands the relays open. They include the wait for the next exposure, 25 ms of exposure, read-out \
         and computing (an assumption, not a measurement), and the vote over three frames.</p></section>\
         <footer>Every frame of this run is in <a href='demo.json'>demo.json</a> beside this page. The same seed plays \
         the same minute.</footer>"
    );
}
