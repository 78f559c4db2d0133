//! The lens: what is known of it before, and its calibration from many views of a board.

use nearfield_shared::camera::{Intrinsics, Vector};
use nearfield_shared::rig::ImageSize;

use super::CalibrationError;
use super::board::{BoardCorner, BoardView};
use super::fit::{Fit, Prior, fit};
use super::model::{Model, Observations, lens_values};
use super::pose::first_pose;

/// Fewest views from which a lens is calibrated.
pub const FEWEST_VIEWS: usize = 4;
/// The lens is not known if its focal length is less sure than this share.
const LARGEST_FOCAL_SIGMA: f64 = 0.01;
/// Views whose boards are all this nearly parallel (cosine) tell focal length and distance apart badly.
const PARALLEL: f64 = 0.985;
/// The picture is divided into this many cells across and down to say how much of it the corners cover.
const CELLS: [usize; 2] = [8, 5];
/// Coverage below this share is told: the distortion is then a guess in the rest.
const GOOD_COVERAGE: f64 = 0.6;

/// What is known of a lens before the pictures are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensKnowledge {
    /// Value and sigma of each parameter, in the order of [`super::model::LENS_NAMES`].
    pub priors: [Prior; 9],
    /// Sigma of `fy / fx - 1`; infinite if nothing is known of it.
    pub aspect_sigma: f64,
}

impl LensKnowledge {
    /// A lens of which only the horizontal field of view is known, as from a data sheet: 5 % for the focal length,
    /// square pixels to 0.1 %, the optical axis within 1 % of the width, and mild to strong distortion.
    #[must_use]
    pub fn nominal(image: ImageSize, horizontal_view_degrees: f64) -> Self {
        let (width, height) = (f64::from(image.width), f64::from(image.height));
        let focal = width / 2.0 / (horizontal_view_degrees.to_radians() / 2.0).tan();
        let prior = |value, sigma| Prior { value, sigma };
        let axis = 0.01 * width;
        Self {
            priors: [
                prior(focal, 0.05 * focal),
                prior(focal, 0.05 * focal),
                prior((width - 1.0) / 2.0, axis),
                prior((height - 1.0) / 2.0, axis),
                prior(0.0, 0.1),
                prior(0.0, 0.05),
                prior(0.0, 0.001),
                prior(0.0, 0.001),
                prior(0.0, 0.0),
            ],
            aspect_sigma: 0.001,
        }
    }

    /// A lens that was calibrated before: values with their sigmas (zero holds a value fixed).
    #[must_use]
    pub fn measured(lens: &Intrinsics, sigmas: [f64; 9]) -> Self {
        let values = lens_values(lens);
        Self {
            priors: std::array::from_fn(|index| Prior { value: values[index], sigma: sigmas[index] }),
            aspect_sigma: f64::INFINITY,
        }
    }

    /// The expected lens.
    #[must_use]
    pub fn expected(&self) -> Intrinsics {
        super::model::lens_of(self.priors.map(|prior| prior.value))
    }

    /// Is every parameter held fixed?
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.priors.iter().all(|prior| prior.sigma <= 0.0)
    }

    /// Is little more known than a data sheet tells? A calibration from many views knows the focal length far better than
    /// to one percent.
    #[must_use]
    pub fn is_nominal(&self) -> bool {
        self.priors[0].sigma > 0.01 * self.priors[0].value
    }
}

/// A calibrated lens.
#[derive(Debug, Clone)]
pub struct LensCalibration {
    /// The fit with all poses.
    pub fit: Fit,
    /// Root of the mean squared distance of a corner from where the model puts it, pixels, for each view.
    pub view_errors: Vec<f64>,
    /// Share of the picture's cells in which a corner was seen.
    pub coverage: f64,
    /// What should be known about the result, for people.
    pub notes: Vec<String>,
}

impl LensCalibration {
    /// The same over all views.
    #[must_use]
    pub fn reprojection_error(&self) -> f64 {
        let sum: f64 = self.view_errors.iter().map(|error| error * error).sum();
        (sum / self.view_errors.len().max(1) as f64).sqrt()
    }
}

/// Calibrates a lens from many views of one board.
///
/// # Errors
/// [`CalibrationError::Degenerate`] for too few views, or views that are too alike to fix the focal length.
pub fn calibrate_lens(
    image: ImageSize,
    views: &[BoardView],
    knowledge: &LensKnowledge,
) -> Result<LensCalibration, CalibrationError> {
    if views.len() < FEWEST_VIEWS {
        return Err(CalibrationError::Degenerate(format!(
            "{} usable view(s) of the board, at least {FEWEST_VIEWS} are needed (10 to 20 are good): hold the board \
             near and far, in the middle and in the corners, tilted by 20 to 40 degrees to all sides",
            views.len()
        )));
    }
    let lens = knowledge.expected();
    let poses = views.iter().map(|view| {
        first_pose(&lens, &view.corners).ok_or_else(|| {
            CalibrationError::Degenerate(format!(
                "{}: the board's pose cannot be told; take it again",
                view.name
            ))
        })
    });
    let poses = poses.collect::<Result<Vec<_>, _>>()?;
    let observations = Observations {
        boards: views.iter().map(|view| view.corners.clone()).collect(),
        ..Observations::default()
    };
    let start = Model { lens, poses, sheet: None, heights: Vec::new() };
    let fit = fit(&start, &observations, &free_lens(knowledge)).ok_or_else(too_alike)?;
    let notes = judge(image, views, &fit)?;
    Ok(LensCalibration {
        view_errors: (0..views.len())
            .map(|view| view_error(&fit.model, view, &views[view].corners, 0.0))
            .collect(),
        coverage: coverage(image, views.iter().flat_map(|view| &view.corners)),
        fit,
        notes,
    })
}

/// Many views tell more than a data sheet: its values are only the start.
fn free_lens(knowledge: &LensKnowledge) -> LensKnowledge {
    let priors = knowledge.priors.map(|prior| Prior { value: prior.value, sigma: prior.sigma * 10.0 });
    LensKnowledge { priors, aspect_sigma: f64::INFINITY }
}

fn too_alike() -> CalibrationError {
    CalibrationError::Degenerate(
        "the views are too alike to fix the lens: tilt the board by 20 to 40 degrees to different sides, near and far"
            .to_owned(),
    )
}

fn judge(image: ImageSize, views: &[BoardView], fit: &Fit) -> Result<Vec<String>, CalibrationError> {
    let normals: Vec<Vector> = fit
        .model
        .poses
        .iter()
        .map(|pose| pose.rotation * nalgebra::Vector3::z())
        .map(|normal| Vector::new(normal.x, normal.y, normal.z))
        .collect();
    let all_parallel = normals.iter().all(|one| normals.iter().all(|other| one.dot(*other).abs() > PARALLEL));
    let [focal_sigma, ..] = fit.lens_sigmas();
    if all_parallel || focal_sigma > LARGEST_FOCAL_SIGMA * fit.model.lens.fx {
        return Err(too_alike());
    }
    let mut notes = Vec::new();
    let covered = coverage(image, views.iter().flat_map(|view| &view.corners));
    if covered < GOOD_COVERAGE {
        notes.push(format!(
            "the corners cover {:.0} % of the picture; beyond them the distortion is a guess: take views with the \
             board in the corners",
            covered * 100.0
        ));
    }
    for (view, shown) in views.iter().enumerate() {
        let error = view_error(&fit.model, view, &shown.corners, 0.0);
        if error > 4.0 * fit.corner_noise.max(0.1) {
            notes.push(format!(
                "{}: {error:.2} px off, more than the other views: blurred, or the board is bent",
                shown.name
            ));
        }
    }
    Ok(notes)
}

/// Root of the mean squared distance of the corners of a view from where the model puts them, pixels.
#[must_use]
pub fn view_error(model: &Model, view: usize, corners: &[BoardCorner], board_height: f64) -> f64 {
    let sum: f64 = corners
        .iter()
        .map(|corner| model.corner_miss(view, corner, board_height))
        .map(|[across, down]| across * across + down * down)
        .sum();
    (sum / corners.len().max(1) as f64).sqrt()
}

/// Share of the picture's cells in which a corner was seen.
fn coverage<'a>(image: ImageSize, corners: impl Iterator<Item = &'a BoardCorner>) -> f64 {
    let [across, down] = CELLS;
    let mut seen = vec![false; across * down];
    for corner in corners {
        let cell = |value: f64, size: u16, count: usize| {
            ((value / f64::from(size) * count as f64).max(0.0) as usize).min(count - 1)
        };
        let column = cell(corner.pixel.u, image.width, across);
        let row = cell(corner.pixel.v, image.height, down);
        seen[row * across + column] = true;
    }
    seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64
}
