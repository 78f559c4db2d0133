//! The robust fit: lens, board poses, sheet and block heights together, so that they agree with every pixel at once.
//!
//! Levenberg-Marquardt (crate `levenberg-marquardt`) inside iteratively reweighted least squares with Huber's weights:
//! a corner under a reflection or a speckle on the stripe pulls no more than its neighbours. The noise of corners and
//! of the stripe is measured from the fit's own residuals, so the covariance is that of these pictures.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn, Rotation3, Vector3};

use super::lens::LensKnowledge;
use super::model::{Model, Observations, Sheet, lens_of, lens_values};

/// Huber's constant: 95 % as efficient as least squares on normal noise.
const HUBER: f64 = 1.345;
/// Rounds of reweighting; weights stand still after three or four.
const ROUNDS: usize = 6;
/// Median of the magnitude of normal noise of unit variance.
const NORMAL_MEDIAN: f64 = 0.6745;
/// Noise is never taken to be less than this, pixels: corner finders and peaks have systematic errors of that size.
const LEAST_NOISE: f64 = 0.02;

/// How well a parameter is known before the pictures: value and one sigma. A sigma of zero holds it fixed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Expected value.
    pub value: f64,
    /// One sigma.
    pub sigma: f64,
}

/// The result of a fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The estimate.
    pub model: Model,
    /// Covariance of the free parameters, in the order of [`Fit::apply`].
    pub covariance: DMatrix<f64>,
    /// One sigma of a board corner's coordinate, pixels.
    pub corner_noise: f64,
    /// One sigma of a stripe pixel across the stripe, pixels.
    pub stripe_noise: f64,
    layout: Layout,
}

impl Fit {
    /// The model with the free parameters moved by `change`.
    #[must_use]
    pub fn apply(&self, change: &DVector<f64>) -> Model {
        self.layout.model(&self.model, change)
    }

    /// One sigma of each lens parameter, in the order of [`super::model::LENS_NAMES`]; zero for those held fixed.
    #[must_use]
    pub fn lens_sigmas(&self) -> [f64; 9] {
        let mut sigmas = [0.0; 9];
        for (index, parameter) in self.layout.free.iter().enumerate() {
            if let Parameter::Lens(number) = parameter {
                sigmas[*number] = self.covariance[(index, index)].max(0.0).sqrt();
            }
        }
        sigmas
    }

    /// One sigma of a quantity that depends on the model.
    pub fn sigma_of(&self, quantity: impl Fn(&Model) -> Option<f64>) -> Option<f64> {
        let count = self.layout.free.len();
        let mut gradient = DVector::zeros(count);
        for index in 0..count {
            let step = (self.covariance[(index, index)].max(0.0).sqrt() * 0.1).max(1e-12);
            let at = |signed: f64| {
                let mut change = DVector::zeros(count);
                change[index] = signed;
                quantity(&self.apply(&change))
            };
            gradient[index] = (at(step)? - at(-step)?) / (2.0 * step);
        }
        Some((gradient.transpose() * &self.covariance * &gradient)[(0, 0)].max(0.0).sqrt())
    }
}

/// One free parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parameter {
    Lens(usize),
    Turn(usize, usize),
    Shift(usize, usize),
    Heading,
    Distance,
    Slant,
    Height(usize),
}

/// Which parameters are free.
#[derive(Debug, Clone)]
struct Layout {
    free: Vec<Parameter>,
}

impl Layout {
    fn new(model: &Model, observations: &Observations, lens: &LensKnowledge) -> Self {
        let mut free: Vec<Parameter> =
            (0..9).filter(|number| lens.priors[*number].sigma > 0.0).map(Parameter::Lens).collect();
        for view in 0..model.poses.len() {
            free.extend((0..3).map(|axis| Parameter::Turn(view, axis)));
            free.extend((0..3).map(|axis| Parameter::Shift(view, axis)));
        }
        if model.sheet.is_some() {
            free.extend([Parameter::Heading, Parameter::Distance, Parameter::Slant]);
        }
        for (number, level) in observations.levels.iter().enumerate() {
            if level.height_sigma > 0.0 {
                free.push(Parameter::Height(number));
            }
        }
        Self { free }
    }

    /// `base` moved by `change`.
    fn model(&self, base: &Model, change: &DVector<f64>) -> Model {
        let mut model = base.clone();
        let mut lens = lens_values(&base.lens);
        let mut turns = vec![Vector3::zeros(); base.poses.len()];
        let sheet = model.sheet.get_or_insert(Sheet { heading: 0.0, distance: 0.0, slant: 0.0 });
        for (parameter, value) in self.free.iter().zip(change.iter()) {
            match *parameter {
                Parameter::Lens(number) => lens[number] += value,
                Parameter::Turn(view, axis) => turns[view][axis] += value,
                Parameter::Shift(view, axis) => model.poses[view].translation[axis] += value,
                Parameter::Heading => sheet.heading += value,
                Parameter::Distance => sheet.distance += value,
                Parameter::Slant => sheet.slant += value,
                Parameter::Height(level) => model.heights[level] += value,
            }
        }
        model.lens = lens_of(lens);
        for (pose, turn) in model.poses.iter_mut().zip(turns) {
            pose.rotation = Rotation3::new(turn) * pose.rotation;
        }
        if base.sheet.is_none() {
            model.sheet = None;
        }
        model
    }

    /// Natural size of a parameter, for numeric differentiation.
    fn step(parameter: Parameter) -> f64 {
        match parameter {
            Parameter::Lens(0..=3) => 1e-3,
            Parameter::Lens(_) | Parameter::Turn(..) | Parameter::Heading => 1e-6,
            Parameter::Shift(..) | Parameter::Distance | Parameter::Height(_) => 1e-3,
            Parameter::Slant => 1e-5,
        }
    }
}

/// Rows of the residual vector that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Group {
    Board(usize),
    Level(usize),
    Prior,
}

impl Group {
    /// Can this parameter change these residuals?
    fn depends_on(self, parameter: Parameter) -> bool {
        match (self, parameter) {
            (Self::Prior, _) => false,
            (_, Parameter::Lens(_)) => true,
            (Self::Board(view), Parameter::Turn(of, _) | Parameter::Shift(of, _)) => view == of,
            (Self::Level(_), Parameter::Turn(of, _) | Parameter::Shift(of, _)) => of == 0,
            (Self::Level(_), Parameter::Heading | Parameter::Distance | Parameter::Slant) => true,
            (Self::Level(level), Parameter::Height(of)) => level == of,
            (Self::Board(_), _) => false,
        }
    }
}

/// The least-squares problem at fixed weights; parameters are changes from `base`.
struct Problem<'a> {
    base: &'a Model,
    observations: &'a Observations,
    layout: &'a Layout,
    groups: Vec<(Group, std::ops::Range<usize>)>,
    /// Row weights: square root of Huber's weight, over the noise.
    weights: DVector<f64>,
    /// Expected change and sigma of each free parameter; no prior where sigma is infinite.
    priors: Vec<Prior>,
    aspect_sigma: f64,
    change: DVector<f64>,
}

impl<'a> Problem<'a> {
    fn new(
        base: &'a Model,
        observations: &'a Observations,
        layout: &'a Layout,
        lens: &LensKnowledge,
    ) -> Self {
        let mut groups = Vec::new();
        let mut rows = 0;
        let mut push = |group, count: usize| {
            groups.push((group, rows..rows + count));
            rows += count;
        };
        for (view, corners) in observations.boards.iter().enumerate() {
            push(Group::Board(view), 2 * corners.len());
        }
        for (number, level) in observations.levels.iter().enumerate() {
            push(Group::Level(number), level.points.len());
        }
        // One row for each parameter and one for the pixels' aspect.
        push(Group::Prior, layout.free.len() + 1);
        let base_lens = lens_values(&base.lens);
        let priors = layout.free.iter().map(|parameter| match *parameter {
            Parameter::Lens(number) => Prior {
                value: lens.priors[number].value - base_lens[number],
                sigma: lens.priors[number].sigma,
            },
            Parameter::Height(level) => {
                let stated = &observations.levels[level];
                Prior { value: stated.height - base.heights[level], sigma: stated.height_sigma }
            }
            _ => Prior { value: 0.0, sigma: f64::INFINITY },
        });
        Self {
            priors: priors.collect(),
            aspect_sigma: lens.aspect_sigma,
            weights: DVector::from_element(rows, 1.0),
            change: DVector::zeros(layout.free.len()),
            base,
            observations,
            layout,
            groups,
        }
    }

    /// Misses in pixels of one group, unweighted.
    fn fill(&self, model: &Model, group: Group, rows: &mut [f64]) {
        match group {
            Group::Board(view) => {
                let height = self.observations.board_height;
                for (corner, row) in self.observations.boards[view].iter().zip(rows.chunks_exact_mut(2)) {
                    row.copy_from_slice(&model.corner_miss(view, corner, height));
                }
            }
            Group::Level(number) => {
                let Some(camera) = model.camera() else { return };
                for (point, row) in self.observations.levels[number].points.iter().zip(rows) {
                    *row = model.stripe_miss(&camera, number, point);
                }
            }
            Group::Prior => {}
        }
    }

    fn misses(&self, change: &DVector<f64>) -> DVector<f64> {
        let model = self.layout.model(self.base, change);
        let mut misses = DVector::zeros(self.weights.len());
        for (group, rows) in &self.groups {
            self.fill(&model, *group, &mut misses.as_mut_slice()[rows.clone()]);
        }
        let prior_rows = self.prior_rows();
        for (index, (prior, row)) in self.priors.iter().zip(prior_rows).enumerate() {
            misses[row] = (change[index] - prior.value) / prior.sigma;
        }
        if let Some(last) = misses.iter_mut().last() {
            *last = (model.lens.fy / model.lens.fx - 1.0) / self.aspect_sigma;
        }
        misses
    }

    fn prior_rows(&self) -> std::ops::Range<usize> {
        let last = self.weights.len() - 1;
        last - self.layout.free.len()..last
    }

    /// Derivatives of the unweighted misses.
    fn slopes(&self) -> DMatrix<f64> {
        let columns = self.layout.free.len();
        let mut slopes = DMatrix::zeros(self.weights.len(), columns);
        let mut both = [DVector::zeros(self.weights.len()), DVector::zeros(self.weights.len())];
        for (column, parameter) in self.layout.free.iter().enumerate() {
            let step = Layout::step(*parameter);
            for (misses, signed) in both.iter_mut().zip([step, -step]) {
                let mut change = self.change.clone();
                change[column] += signed;
                let model = self.layout.model(self.base, &change);
                for (group, rows) in self.groups.iter().filter(|(group, _)| group.depends_on(*parameter)) {
                    self.fill(&model, *group, &mut misses.as_mut_slice()[rows.clone()]);
                }
            }
            for (_, rows) in self.groups.iter().filter(|(group, _)| group.depends_on(*parameter)) {
                for row in rows.clone() {
                    slopes[(row, column)] = (both[0][row] - both[1][row]) / (2.0 * step);
                }
            }
        }
        for (index, (prior, row)) in self.priors.iter().zip(self.prior_rows()).enumerate() {
            slopes[(row, index)] = 1.0 / prior.sigma;
        }
        let last = self.weights.len() - 1;
        for (column, parameter) in self.layout.free.iter().enumerate() {
            let (fx, fy) = (self.base.lens.fx, self.base.lens.fy);
            slopes[(last, column)] = match parameter {
                Parameter::Lens(0) => -fy / (fx * fx) / self.aspect_sigma,
                Parameter::Lens(1) => 1.0 / fx / self.aspect_sigma,
                _ => 0.0,
            };
        }
        slopes
    }

    /// Measures the noise of corners and stripe from the misses and sets all weights.
    fn reweight(&mut self) -> [f64; 2] {
        let misses = self.misses(&self.change);
        let noise = [true, false].map(|boards| {
            let mut magnitudes: Vec<f64> = self
                .groups
                .iter()
                .filter(|(group, _)| {
                    matches!((group, boards), (Group::Board(_), true) | (Group::Level(_), false))
                })
                .flat_map(|(_, rows)| rows.clone().map(|row| misses[row].abs()))
                .collect();
            if magnitudes.is_empty() {
                return LEAST_NOISE;
            }
            let middle = magnitudes.len() / 2;
            let (_, median, _) = magnitudes.select_nth_unstable_by(middle, f64::total_cmp);
            (*median / NORMAL_MEDIAN).max(LEAST_NOISE)
        });
        for (group, rows) in &self.groups {
            let sigma = match group {
                Group::Board(_) => noise[0],
                Group::Level(_) => noise[1],
                Group::Prior => continue,
            };
            for row in rows.clone() {
                let share = (HUBER * sigma / misses[row].abs().max(1e-12)).min(1.0);
                self.weights[row] = share.sqrt() / sigma;
            }
        }
        noise
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, change: &DVector<f64>) {
        self.change.copy_from(change);
    }

    fn params(&self) -> DVector<f64> {
        self.change.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.misses(&self.change).component_mul(&self.weights))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let mut slopes = self.slopes();
        for (mut row, weight) in slopes.row_iter_mut().zip(self.weights.iter()) {
            row *= *weight;
        }
        Some(slopes)
    }
}

/// Fits the model to the observations, from `start`. Lens parameters follow their priors; a prior's sigma of zero
/// holds the parameter at its start.
///
/// `None` if the observations do not fix the parameters (degenerate views).
#[must_use]
pub fn fit(start: &Model, observations: &Observations, lens: &LensKnowledge) -> Option<Fit> {
    let layout = Layout::new(start, observations, lens);
    let mut problem = Problem::new(start, observations, &layout, lens);
    let mut noise = [1.0; 2];
    for round in 0..ROUNDS {
        if round > 0 {
            noise = problem.reweight();
        }
        let (solved, report) = LevenbergMarquardt::new().with_patience(30).minimize(problem);
        problem = solved;
        if !report.objective_function.is_finite() {
            return None;
        }
    }
    let weighted = problem.jacobian()?;
    let covariance = covariance_of(weighted)?;
    let model = layout.model(start, &problem.change);
    let [corner_noise, stripe_noise] = noise;
    Some(Fit { model, covariance, corner_noise, stripe_noise, layout })
}

/// The covariance from weighted slopes. Their columns are scaled to length one first: a focal length and an angle
/// differ by seven powers of ten.
fn covariance_of(mut slopes: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let lengths: Vec<f64> = slopes.column_iter().map(|column| column.norm()).collect();
    if lengths.iter().any(|length| !(length.is_finite() && *length > 0.0)) {
        return None;
    }
    for (mut column, length) in slopes.column_iter_mut().zip(&lengths) {
        column /= *length;
    }
    let mut covariance = (slopes.transpose() * slopes).try_inverse()?;
    for (row, one) in lengths.iter().enumerate() {
        for (column, other) in lengths.iter().enumerate() {
            covariance[(row, column)] /= one * other;
        }
    }
    covariance
        .diagonal()
        .iter()
        .all(|variance| variance.is_finite() && *variance >= 0.0)
        .then_some(covariance)
}
