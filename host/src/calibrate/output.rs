//! The files of a calibration: the rig with its uncertainties, the compact form, and lens files.

use std::fmt::Write as _;
use std::path::Path;

use nearfield_shared::camera::Intrinsics;
use nearfield_shared::rig::ImageSize;
use toml::{Table, Value};

use super::CalibrationError;
use super::lens::{LensCalibration, LensKnowledge};
use super::model::{LENS_NAMES, lens_of, lens_values};
use super::session::Calibration;
use super::verdict::Verdict;
use crate::rig_file;

/// The rig file: the rig's own sections, and `[uncertainty]` with one sigma of what was estimated.
#[must_use]
pub fn rig_toml(calibration: &Calibration, verdict: &Verdict) -> String {
    let mut text = rig_file::to_toml(&calibration.rig);
    let sigmas = calibration.fit.lens_sigmas();
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "\n[uncertainty] # one sigma of what the calibration estimated; zero was held fixed\n{}\
         plane_degrees = {}\nboard_residual_pixels = {}\nstripe_noise_pixels = {}\n",
        lens_lines(sigmas),
        number(verdict.plane_sigma_degrees),
        number(calibration.board_error),
        number(calibration.fit.stripe_noise),
    );
    text.push_str("# how sure a height is: place along the stripe, height, one sigma; all millimetres\nheights_mm = [\n");
    for sigma in verdict.height_sigmas.iter().filter(|sigma| sigma.sigma_mm.is_finite()) {
        let _ = writeln!(
            text,
            "  [{}, {}, {}],",
            number(sigma.place_mm),
            number(sigma.height_mm),
            number(sigma.sigma_mm)
        );
    }
    text.push_str("]\n");
    text
}

/// A number with no more digits than mean something.
fn number(value: f64) -> String {
    let rounded = (value * 1e4).round() / 1e4;
    format!("{:?}", if rounded.is_finite() { rounded } else { 0.0 })
}

fn lens_lines(sigmas: [f64; 9]) -> String {
    let [fx, fy, cx, cy, distortion @ ..] = sigmas;
    format!("fx = {fx:?}\nfy = {fy:?}\ncx = {cx:?}\ncy = {cy:?}\ndistortion = {distortion:?}\n")
}

/// The lens file: `[image]` and `[camera]` as in a rig file, without pose, and `[uncertainty]`.
#[must_use]
pub fn lens_toml(image: ImageSize, calibration: &LensCalibration) -> String {
    let lens = &calibration.fit.model.lens;
    format!(
        "# A calibrated lens, for `nearfield calibrate rig --lens`.\n[image]\nwidth = {}\nheight = {}\n\n\
         [camera]\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\ndistortion = {:?} # k1, k2, p1, p2, k3\n\n\
         [uncertainty] # one sigma\n{}reprojection_error_pixels = {}\n",
        image.width,
        image.height,
        lens.fx,
        lens.fy,
        lens.cx,
        lens.cy,
        lens.distortion,
        lens_lines(calibration.fit.lens_sigmas()),
        number(calibration.reprojection_error()),
    )
}

/// Reads the lens of a lens file or of a rig file, for pictures of `image`'s size. A lens of pictures twice or half as
/// large is converted.
///
/// # Errors
/// [`CalibrationError::LensFile`] names the field.
pub fn read_lens(path: &Path, image: ImageSize) -> Result<LensKnowledge, CalibrationError> {
    let refused = |problem: String| CalibrationError::LensFile { path: path.to_path_buf(), problem };
    let text = std::fs::read_to_string(path).map_err(|error| refused(format!("cannot read it: {error}")))?;
    let table: Table = text.parse().map_err(|error: toml::de::Error| {
        refused(format!("not a TOML file: {}", error.to_string().trim_end()))
    })?;
    let values = lens_numbers(&table, "camera").map_err(&refused)?;
    let sigmas = match table.get("uncertainty") {
        Some(_) => lens_numbers(&table, "uncertainty").map_err(&refused)?,
        None => [0.0; 9],
    };
    let width = whole(&table, "width").map_err(&refused)?;
    let height = whole(&table, "height").map_err(&refused)?;
    let scale = f64::from(image.width) / width;
    if (f64::from(image.height) / height - scale).abs() > 1e-9 || ![0.5, 1.0, 2.0].contains(&scale) {
        return Err(refused(format!(
            "it is for pictures of {width} x {height}, but these are {} x {}; calibrate the lens with this camera \
             setting",
            image.width, image.height
        )));
    }
    let lens = lens_of(values);
    if !(lens.fx > 0.0 && lens.fy > 0.0) {
        return Err(refused("camera.fx, camera.fy: must be greater than zero".to_owned()));
    }
    let scaled: [f64; 9] =
        std::array::from_fn(|index| sigmas[index].max(0.0) * if index < 4 { scale } else { 1.0 });
    Ok(LensKnowledge::measured(&resized(&lens, scale), scaled))
}

/// The same lens for pictures `scale` times as wide: pixel (0, 0) is the middle of the first one.
#[must_use]
pub fn resized(lens: &Intrinsics, scale: f64) -> Intrinsics {
    Intrinsics {
        fx: lens.fx * scale,
        fy: lens.fy * scale,
        cx: (lens.cx + 0.5) * scale - 0.5,
        cy: (lens.cy + 0.5) * scale - 0.5,
        distortion: lens.distortion,
    }
}

fn number_of(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
        .filter(|number| number.is_finite())
}

fn lens_numbers(table: &Table, section: &str) -> Result<[f64; 9], String> {
    let fields = table
        .get(section)
        .and_then(Value::as_table)
        .ok_or(format!("{section}: section is missing; add it"))?;
    let mut values = lens_values(&lens_of([0.0; 9]));
    for (name, value) in LENS_NAMES.iter().zip(&mut values).take(4) {
        *value = fields
            .get(*name)
            .and_then(number_of)
            .ok_or(format!("{section}.{name}: must be a number; add or correct it"))?;
    }
    let distortion: Option<Vec<f64>> = fields
        .get("distortion")
        .and_then(Value::as_array)
        .and_then(|list| list.iter().map(number_of).collect());
    match distortion.as_deref() {
        Some([_, _, _, _, _]) => {}
        _ => return Err(format!("{section}.distortion: must be a list of 5 numbers: k1, k2, p1, p2, k3")),
    }
    for (value, number) in values[4..].iter_mut().zip(distortion.unwrap_or_default()) {
        *value = number;
    }
    Ok(values)
}

fn whole(table: &Table, name: &str) -> Result<f64, String> {
    let value = table.get("image").and_then(|image| image.get(name)).and_then(Value::as_integer);
    value
        .filter(|pixels| *pixels > 0)
        .map(|pixels| pixels as f64)
        .ok_or(format!("image.{name}: must be a whole number of pixels; add or correct it"))
}
