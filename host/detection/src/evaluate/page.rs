//! An evaluation as one page: tables, diagrams, and pictures of the worst cases.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use image::Rgb;
use plotters::prelude::*;

use super::paper;
use super::reliability::Reliability;
use super::run::{Part, PartReport, read_picture};
use crate::boxes::BoundingBox;
use crate::draw::labelled_box;

/// Pictures shown for each part.
const WORST: usize = 16;
/// Longest side of a picture on the page, pixels.
const LONGEST: u32 = 640;

const STYLE: &str = "body{font:15px/1.5 sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}\
td:first-child,th:first-child{text-align:left}.human{color:#b00020;font-weight:bold}.weak{color:#888}\
figure{display:inline-block;margin:.4em;width:330px;vertical-align:top}figure img{width:100%}\
figcaption{font-size:13px}";

/// Writes `index.html` and the pictures into a directory.
///
/// # Errors
/// A file cannot be written; a picture cannot be read again.
pub fn write(directory: &Path, title: &str, parts: &[(Part, PartReport)]) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory)
        .with_context(|| format!("{}: cannot make the directory", directory.display()))?;
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{0}</title><style>{STYLE}</style><h1>{0}</h1>\n",
        escaped(title)
    );
    overview(&mut page, parts)?;
    for (part, report) in parts {
        section(&mut page, directory, part, report)?;
    }
    let path = directory.join("index.html");
    std::fs::write(&path, page).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Names come from files: what is not text must not become a tag.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn overview(page: &mut String, parts: &[(Part, PartReport)]) -> std::fmt::Result {
    page.push_str(
        "<table><tr><th>part<th>pictures<th>objects<th>mAP50<th>mAP50:95<th>people found (as any human class)<th>alarms with a person there<th>calibration error</tr>\n",
    );
    for (_, report) in parts {
        writeln!(
            page,
            "<tr><td><a href=\"#{0}\">{0}</a><td>{1}<td>{2}<td>{3:.3}<td>{4:.3}<td class=\"human\">{5}<td>{6}<td>{7:.3}</tr>",
            escaped(&report.part),
            report.pictures,
            report.objects,
            report.coco.ap50,
            report.coco.ap,
            report.people.as_a_person,
            report.people.alarms_right,
            report.reliability.error,
        )?;
    }
    page.push_str("</table>\n");
    Ok(())
}

fn section(page: &mut String, directory: &Path, part: &Part, report: &PartReport) -> anyhow::Result<()> {
    let name = escaped(&report.part);
    writeln!(page, "<h2 id=\"{name}\">{name}</h2>")?;
    for (left_out, count) in &report.left_out {
        writeln!(
            page,
            "<p>Not judged, since the detector does not know it: {} ({count} objects).</p>",
            escaped(left_out)
        )?;
    }
    if !report.unanswered.is_empty() {
        writeln!(page, "<p class=\"human\">{} pictures without an answer.</p>", report.unanswered.len())?;
    }
    class_table(page, report)?;
    confusion_table(page, report)?;
    writeln!(page, "<h3>Reliability</h3>{}", reliability_diagram(&report.reliability)?)?;
    writeln!(
        page,
        "<p>Calibration error {:.3}; {:.3} with scores as they are.</p>",
        report.reliability.error, report.reliability_of_scores.error
    )?;
    worst_pictures(page, directory, part, report)
}

fn class_table(page: &mut String, report: &PartReport) -> std::fmt::Result {
    page.push_str(
        "<table><tr><th>class<th>objects<th>AP50<th>AP50:95<th>score<th>precision<th>recall (95 %)<th>F1\
         <th class=\"weak\">paper: P<th class=\"weak\">R<th class=\"weak\">F1</tr>\n",
    );
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
    for (figures, precision) in report.classes.iter().zip(&report.average_precision) {
        let paper = paper::figures(&figures.class);
        writeln!(
            page,
            "<tr><td class=\"{}\">{}<td>{}<td>{}<td>{}<td>{:.3}<td>{}<td>{}<td>{}\
             <td class=\"weak\">{}<td class=\"weak\">{}<td class=\"weak\">{}</tr>",
            if figures.human { "human" } else { "" },
            escaped(&figures.class),
            figures.objects,
            number(precision.ap50),
            number(precision.ap),
            figures.operating_score,
            number(figures.precision.share),
            figures.recall,
            number(figures.f1),
            number(paper.map(|row| row.precision)),
            number(paper.map(|row| row.recall)),
            number(paper.map(|row| row.f1)),
        )?;
    }
    page.push_str("</table>\n");
    Ok(())
}

fn confusion_table(page: &mut String, report: &PartReport) -> std::fmt::Result {
    page.push_str("<h3>Confusion</h3><p>Row: what it is; column: what it was called.</p><table><tr><th>");
    for figures in &report.classes {
        write!(page, "<th>{}", escaped(&figures.class))?;
    }
    page.push_str("<th>not found</tr>\n");
    for (row, counts) in report.confusion.iter().enumerate() {
        let name = report.classes.get(row).map_or("nothing there", |figures| &figures.class);
        write!(page, "<tr><td>{}", escaped(name))?;
        for count in counts {
            if *count == 0 { page.push_str("<td>") } else { write!(page, "<td>{count}")? }
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</table>\n");
    Ok(())
}

/// Confidence to the right, the part that is right upwards; the area of a point is the number of its detections.
fn reliability_diagram(reliability: &Reliability) -> anyhow::Result<String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (420, 360)).into_drawing_area();
        let mut chart = ChartBuilder::on(&root)
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(44)
            .build_cartesian_2d(0.0..1.0, 0.0..1.0)
            .map_err(|error| anyhow::anyhow!("diagram: {error}"))?;
        let failed = |error: DrawingAreaErrorKind<std::io::Error>| anyhow::anyhow!("diagram: {error}");
        chart.configure_mesh().x_desc("confidence").y_desc("right").draw().map_err(failed)?;
        chart.draw_series(LineSeries::new([(0.0, 0.0), (1.0, 1.0)], BLACK.mix(0.4))).map_err(failed)?;
        let most = reliability.bins.iter().map(|bin| bin.detections).max().unwrap_or(1).max(1) as f64;
        let points = reliability.bins.iter().filter(|bin| bin.detections > 0).map(|bin| {
            let size = 3 + (12.0 * (bin.detections as f64 / most).sqrt()) as i32;
            Circle::new((bin.confidence, bin.right), size, BLUE.mix(0.6).filled())
        });
        chart.draw_series(points).map_err(failed)?;
        root.present().map_err(failed)?;
    }
    Ok(svg)
}

/// Blue: an object that was found; red: missed; yellow: a detection that is wrong.
fn worst_pictures(
    page: &mut String,
    directory: &Path,
    part: &Part,
    report: &PartReport,
) -> anyhow::Result<()> {
    let worst = part.worst();
    writeln!(
        page,
        "<h3>Worst cases</h3><p>{} of {} pictures have a mistake at the operating point. Blue: found. Red: missed. \
         Yellow: called so, wrongly.</p>",
        worst.len(),
        report.pictures
    )?;
    for (rank, (picture, _)) in worst.iter().take(WORST).enumerate() {
        let path = &part.dataset.pictures[*picture].1;
        let Ok(pixels) = read_picture(path) else { continue };
        let longer = pixels.width().max(pixels.height());
        let scale = f64::from(LONGEST.min(longer)) / f64::from(longer.max(1));
        let size =
            [pixels.width(), pixels.height()].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        let mut drawing =
            image::imageops::resize(&pixels, size[0], size[1], image::imageops::FilterType::Triangle);
        let to_box = |place: [f64; 4]| {
            let [left, top, width, height] = place.map(|value| (value * scale) as f32);
            BoundingBox { left, top, right: left + width, bottom: top + height }
        };
        let class_name = |class: usize| part.dataset.classes[class].0.as_str();
        for (class, place, found) in part.objects_of(*picture) {
            let colour = if found { Rgb([60, 110, 230]) } else { Rgb([230, 30, 30]) };
            labelled_box(&mut drawing, &to_box(place), if found { "" } else { class_name(class) }, colour);
        }
        for verdict in part.used().filter(|verdict| verdict.detection.picture == *picture) {
            if verdict.truth.is_none() && !verdict.ignored {
                let label = format!("{} {:.2}", class_name(verdict.detection.class), verdict.detection.score);
                labelled_box(&mut drawing, &to_box(verdict.detection.place), &label, Rgb([240, 210, 0]));
            }
        }
        let name =
            format!("{}-{rank:02}.jpg", report.part.replace(|letter: char| !letter.is_alphanumeric(), "_"));
        let target = directory.join(&name);
        drawing.save(&target).with_context(|| format!("{}: cannot be written", target.display()))?;
        let caption = escaped(&path.file_name().unwrap_or_default().display().to_string());
        writeln!(page, "<figure><img src=\"{name}\" alt=\"\"><figcaption>{caption}</figcaption></figure>")?;
    }
    Ok(())
}
