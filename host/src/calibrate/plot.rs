//! Drawings of a calibration: where the pixels miss the model, and how sure heights are. SVG by the crate `plotters`.

use std::path::Path;

use plotters::prelude::*;

use super::CalibrationError;
use super::session::Calibration;
use super::uncertainty::HEIGHTS_MM;
use super::verdict::Verdict;

/// Size of a drawing, pixels.
const SIZE: (u32, u32) = (900, 520);
/// Misses are drawn this many times as long as they are.
const ARROW_SCALE: f64 = 200.0;

/// Draws how far each board corner misses, as arrows in the picture.
///
/// # Errors
/// [`CalibrationError::Picture`] names the file that cannot be written.
pub fn draw_residuals(calibration: &Calibration, path: &Path) -> Result<(), CalibrationError> {
    residuals(calibration, path).map_err(|error| unwritten(path, &error.to_string()))
}

/// Draws one sigma of the height along the stripe.
///
/// # Errors
/// [`CalibrationError::Picture`] names the file that cannot be written.
pub fn draw_uncertainty(verdict: &Verdict, path: &Path) -> Result<(), CalibrationError> {
    uncertainty(verdict, path).map_err(|error| unwritten(path, &error.to_string()))
}

fn unwritten(path: &Path, problem: &str) -> CalibrationError {
    CalibrationError::Picture {
        path: path.to_path_buf(),
        problem: format!("cannot write the drawing: {problem}"),
    }
}

type Drawn = Result<(), Box<dyn std::error::Error>>;

fn residuals(calibration: &Calibration, path: &Path) -> Drawn {
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let (width, height) =
        (f64::from(calibration.rig.image().width), f64::from(calibration.rig.image().height));
    let caption = format!(
        "Board corners: {:.2} px (arrows {ARROW_SCALE:.0} times as long), stripe: {:.2} px",
        calibration.board_error, calibration.fit.stripe_noise
    );
    let mut chart = ChartBuilder::on(&area)
        .caption(caption, ("sans-serif", 16))
        .margin(12)
        .x_label_area_size(28)
        .y_label_area_size(44)
        .build_cartesian_2d(0.0..width, height..0.0)?;
    chart.configure_mesh().light_line_style(WHITE).draw()?;
    let model = &calibration.fit.model;
    let board_height = calibration.observations.board_height;
    for corner in calibration.observations.boards.first().into_iter().flatten() {
        let [across, down] = model.corner_miss(0, corner, board_height);
        let from = (corner.pixel.u, corner.pixel.v);
        let to = (corner.pixel.u + across * ARROW_SCALE, corner.pixel.v + down * ARROW_SCALE);
        chart.draw_series(std::iter::once(PathElement::new([from, to], BLUE)))?;
        chart.draw_series(std::iter::once(Circle::new(from, 2, BLUE.filled())))?;
    }
    for (level, color) in
        calibration.observations.levels.iter().zip([&RED, &MAGENTA, &GREEN].into_iter().cycle())
    {
        let dots =
            level.points.iter().map(|point| Circle::new((point.pixel.u, point.pixel.v), 1, color.filled()));
        chart
            .draw_series(dots)?
            .label(format!("stripe at {} mm", level.height))
            .legend(|(x, y)| Circle::new((x + 8, y), 3, color.filled()));
    }
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw()?;
    area.present()?;
    Ok(())
}

fn uncertainty(verdict: &Verdict, path: &Path) -> Drawn {
    let sigmas: Vec<_> = verdict.height_sigmas.iter().filter(|sigma| sigma.sigma_mm.is_finite()).collect();
    let range = |pick: fn(&super::uncertainty::HeightSigma) -> f64| {
        let values = sigmas.iter().map(|sigma| pick(sigma));
        values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let ((start, end), (_, most)) = (range(|sigma| sigma.place_mm), range(|sigma| sigma.sigma_mm));
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption("How sure a height is (one sigma)", ("sans-serif", 16))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(start..end.max(start + 1.0), 0.0..(most * 1.2).max(0.1))?;
    chart.configure_mesh().x_desc("along the stripe, mm").y_desc("mm").draw()?;
    for (height, color) in HEIGHTS_MM.into_iter().zip([&BLACK, &BLUE, &RED]) {
        let line = sigmas
            .iter()
            .filter(|sigma| sigma.height_mm == height)
            .map(|sigma| (sigma.place_mm, sigma.sigma_mm));
        chart
            .draw_series(LineSeries::new(line, color.stroke_width(2)))?
            .label(format!("{height} mm high"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw()?;
    area.present()?;
    Ok(())
}
