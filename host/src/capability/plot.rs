//! The capability map as a drawing (SVG, by the crate `plotters`).

use std::path::{Path, PathBuf};

use plotters::prelude::*;

use super::{Capability, PlaceCapability};

/// Size of the drawing, pixels.
const SIZE: (u32, u32) = (960, 480);

/// The drawing cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot write the drawing: {problem}", path.display())]
pub struct DrawingError {
    /// The file.
    path: PathBuf,
    /// What went wrong.
    problem: String,
}

/// Draws the smallest width and height along the stripe, and the size that is asked for.
///
/// # Errors
/// [`DrawingError`].
pub fn draw(capability: &Capability, object_mm: f64, path: &Path) -> Result<(), DrawingError> {
    drawn(capability, object_mm, path)
        .map_err(|error| DrawingError { path: path.to_path_buf(), problem: error.to_string() })
}

fn drawn(capability: &Capability, object_mm: f64, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let places = &capability.places;
    let start = places.first().map_or(0.0, |place| place.place_mm);
    let end = places.last().map_or(1.0, |place| place.place_mm);
    let limits =
        places.iter().flat_map(|place| [place.smallest_width_mm, place.smallest_height_mm]).flatten();
    let most = limits.fold(object_mm, f64::max) * 1.25;
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption("Smallest object that is detected", ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(start..end.max(start + 1.0), 0.0..most)?;
    chart.configure_mesh().x_desc("along the stripe, mm").y_desc("mm").draw()?;
    let blind = places.windows(2).filter(|pair| !pair.iter().all(|place| place.detects(object_mm)));
    chart.draw_series(blind.map(|pair| {
        Rectangle::new([(pair[0].place_mm, 0.0), (pair[1].place_mm, most)], RED.mix(0.12).filled())
    }))?;
    let mut curve = |name: &str, color: RGBColor, limit: fn(&PlaceCapability) -> Option<f64>| {
        let line = places.iter().filter_map(|place| Some((place.place_mm, limit(place)?)));
        chart
            .draw_series(LineSeries::new(line, color.stroke_width(2)))
            .map(|drawn| {
                drawn
                    .label(name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
            })
            .map_err(|error| error.to_string())
    };
    curve("width along the stripe", BLUE, |place| place.smallest_width_mm)?;
    curve("height", MAGENTA, |place| place.smallest_height_mm)?;
    chart
        .draw_series(LineSeries::new([(start, object_mm), (end, object_mm)], BLACK.stroke_width(1)))?
        .label("asked for")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BLACK));
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw()?;
    area.present()?;
    Ok(())
}
