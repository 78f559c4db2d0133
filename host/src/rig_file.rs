//! The rig file: TOML text to a checked [`Rig`] and back.
//!
//! ```toml
//! [image]   # width, height: pixels
//! [camera]  # fx, fy, cx, cy: pixels; distortion = [k1, k2, p1, p2, k3]; rotation (3 rows), translation_mm: world to camera
//! [laser]   # origin_mm, plane_normal (unit), plane_offset_mm: the sheet is plane_normal . X = plane_offset_mm
//! [stripe]  # point_mm, direction (unit), start_mm, end_mm: the watched stretch is point_mm + s * direction
//! [run_over] # optional; allowed = true lets small debris pass that the controller itself finds low; off without it
//! ```
//!
//! A section `[uncertainty]`, which calibration writes, is allowed; [`load_deviation`] reads from it how sure heights are.
//!
//! A file is refused as a whole at the first thing that is wrong with it, with the field's full name: a rig that is
//! guessed in part is worse than none.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use toml::{Table, Value};

use crate::vision::RigDeviation;

/// Why a rig file was refused.
#[derive(Debug, thiserror::Error)]
pub enum RigFileError {
    /// The file could not be read.
    #[error("{}: cannot read the rig file: {reason}; `nearfield calibrate rig` writes one", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{}: not a TOML file: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message with line and column.
        message: String,
    },
    /// A field is missing, unknown, of the wrong kind, or breaks a rule.
    #[error("{}: {field}: {problem}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field's full name, for instance `camera.fx`.
        field: String,
        /// What is wrong and what to do.
        problem: String,
    },
}

/// Reads and checks a rig file.
///
/// # Errors
/// See [`RigFileError`]; the message names file, field and remedy.
pub fn load(path: &Path) -> Result<Rig, RigFileError> {
    let text = std::fs::read_to_string(path)
        .map_err(|reason| RigFileError::Read { path: path.to_path_buf(), reason })?;
    parse(&text, path)
}

/// Checks a rig file's text; `path` is only for the messages.
///
/// # Errors
/// See [`RigFileError`].
pub fn parse(text: &str, path: &Path) -> Result<Rig, RigFileError> {
    let table = table_of(text, path)?;
    read_rig(&table).map_err(|FieldProblem { field, problem }| RigFileError::Field {
        path: path.to_path_buf(),
        field,
        problem,
    })
}

/// How sure the rig's heights are, as its calibration wrote it into the rig file: `uncertainty.heights_mm`, a list of
/// `[place, height, one sigma]`. `None` where the file does not tell.
///
/// # Errors
/// See [`RigFileError`].
pub fn load_deviation(path: &Path) -> Result<Option<RigDeviation>, RigFileError> {
    let text = std::fs::read_to_string(path)
        .map_err(|reason| RigFileError::Read { path: path.to_path_buf(), reason })?;
    let table = table_of(&text, path)?;
    let Some(heights) = table.get(UNCERTAINTY).and_then(|section| section.get("heights_mm")) else {
        return Ok(None);
    };
    let triples: Option<Vec<[f64; 3]>> =
        heights.as_array().and_then(|list| list.iter().map(numbers_of).collect());
    let triples = triples.ok_or_else(|| RigFileError::Field {
        path: path.to_path_buf(),
        field: "uncertainty.heights_mm".to_owned(),
        problem: "must be a list of [place, height, one sigma] in millimetres; calibrate again or remove it"
            .to_owned(),
    })?;
    Ok(Some(RigDeviation::of(&triples)))
}

fn table_of(text: &str, path: &Path) -> Result<Table, RigFileError> {
    text.parse().map_err(|error: toml::de::Error| RigFileError::Syntax {
        path: path.to_path_buf(),
        message: error.to_string().trim_end().to_owned(),
    })
}

/// The rig as the text of a rig file; [`parse`] gives the same rig back, bit for bit.
#[must_use]
pub fn to_toml(rig: &Rig) -> String {
    let (lens, pose) = (&rig.camera().intrinsics, &rig.camera().pose);
    let (laser, stripe) = (rig.laser(), rig.stripe());
    let [right, down, forward] = pose.rotation.map(list);
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "[image]\nwidth = {}\nheight = {}\n\n\
         [camera] # world to camera: x_cam = rotation * x_world + translation_mm\n\
         fx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\ndistortion = {:?} # k1, k2, p1, p2, k3\n\
         rotation = [\n  {right},\n  {down},\n  {forward},\n]\ntranslation_mm = {}\n\n\
         [laser] # the sheet of light: plane_normal . X = plane_offset_mm\n\
         origin_mm = {}\nplane_normal = {}\nplane_offset_mm = {:?}\n\n\
         [stripe] # the watched stretch of the floor: point_mm + s * direction\n\
         point_mm = {}\ndirection = {}\nstart_mm = {:?}\nend_mm = {:?}\n",
        rig.image().width,
        rig.image().height,
        lens.fx,
        lens.fy,
        lens.cx,
        lens.cy,
        lens.distortion,
        list(pose.translation),
        list(laser.origin),
        list(laser.normal),
        laser.offset,
        list(stripe.point),
        list(stripe.direction),
        stripe.start,
        stripe.end,
    );
    if rig.allows_run_over() {
        text.push_str(
            "\n[run_over] # small debris may pass if the controller itself finds it low\nallowed = true\n",
        );
    }
    text
}

fn list(vector: Vector) -> String {
    format!("[{:?}, {:?}, {:?}]", vector.x, vector.y, vector.z)
}

/// What is wrong with which field; the file's name is added by [`parse`].
struct FieldProblem {
    field: String,
    problem: String,
}

type Checked<T> = Result<T, FieldProblem>;

const SECTIONS: [(&str, &[&str]); 4] = [
    ("image", &["width", "height"]),
    ("camera", &["fx", "fy", "cx", "cy", "distortion", "rotation", "translation_mm"]),
    ("laser", &["origin_mm", "plane_normal", "plane_offset_mm"]),
    ("stripe", &["point_mm", "direction", "start_mm", "end_mm"]),
];

/// May be left out: then nothing is run over.
const RUN_OVER: &str = "run_over";

/// Says how sure a calibration is of the other sections.
const UNCERTAINTY: &str = "uncertainty";

fn read_rig(table: &Table) -> Checked<Rig> {
    let sections = SECTIONS.map(|(name, _)| name);
    let is_unknown = |name: &&String| {
        !sections.contains(&name.as_str()) && ![UNCERTAINTY, RUN_OVER].contains(&name.as_str())
    };
    if let Some(name) = table.keys().find(is_unknown) {
        return Err(unknown(name.clone(), &sections));
    }
    let [image, camera, laser, stripe] = SECTIONS.map(|(name, fields)| Section::of(table, name, fields));
    let (image, camera, laser, stripe) = (image?, camera?, laser?, stripe?);
    let image = ImageSize { width: image.size("width")?, height: image.size("height")? };
    let camera = Camera {
        intrinsics: Intrinsics {
            fx: camera.number("fx")?,
            fy: camera.number("fy")?,
            cx: camera.number("cx")?,
            cy: camera.number("cy")?,
            distortion: camera.numbers("distortion")?,
        },
        pose: Pose { rotation: camera.matrix("rotation")?, translation: camera.vector("translation_mm")? },
    };
    let laser = Laser {
        origin: laser.vector("origin_mm")?,
        normal: laser.vector("plane_normal")?,
        offset: laser.number("plane_offset_mm")?,
    };
    let stripe = Stripe {
        point: stripe.vector("point_mm")?,
        direction: stripe.vector("direction")?,
        start: stripe.number("start_mm")?,
        end: stripe.number("end_mm")?,
    };
    let rig = Rig::new(image, camera, laser, stripe)
        .map_err(|error| FieldProblem { field: error.field.to_owned(), problem: error.rule.to_owned() })?;
    Ok(rig.with_run_over(read_run_over(table)?))
}

fn read_run_over(table: &Table) -> Checked<bool> {
    if !table.contains_key(RUN_OVER) {
        return Ok(false);
    }
    let section = Section::of(table, RUN_OVER, &["allowed"])?;
    let allowed = section.table.get("allowed").and_then(Value::as_bool);
    allowed.ok_or_else(|| section.problem("allowed", "must be true or false"))
}

fn unknown(field: String, known: &[&str]) -> FieldProblem {
    FieldProblem {
        field,
        problem: format!("unknown name; remove or correct it (known: {})", known.join(", ")),
    }
}

/// One table of the file.
struct Section<'a> {
    name: &'static str,
    table: &'a Table,
}

impl<'a> Section<'a> {
    fn of(table: &'a Table, name: &'static str, fields: &[&str]) -> Checked<Self> {
        let problem = |problem: &str| FieldProblem { field: name.to_owned(), problem: problem.to_owned() };
        let value = table.get(name).ok_or_else(|| problem("section is missing; add it"))?;
        let table = value.as_table().ok_or_else(|| problem("must be a section, not a value"))?;
        match table.keys().find(|key| !fields.contains(&key.as_str())) {
            Some(key) => Err(unknown(format!("{name}.{key}"), fields)),
            None => Ok(Self { name, table }),
        }
    }

    fn problem(&self, field: &str, problem: impl Into<String>) -> FieldProblem {
        FieldProblem { field: format!("{}.{field}", self.name), problem: problem.into() }
    }

    fn value(&self, field: &str) -> Checked<&'a Value> {
        self.table.get(field).ok_or_else(|| self.problem(field, "is missing; add it"))
    }

    fn size(&self, field: &str) -> Checked<u16> {
        let value = self.value(field)?;
        value
            .as_integer()
            .and_then(|pixels| u16::try_from(pixels).ok())
            .ok_or_else(|| self.problem(field, format!("must be a whole number of pixels, not {value}")))
    }

    fn number(&self, field: &str) -> Checked<f64> {
        let value = self.value(field)?;
        number_of(value).ok_or_else(|| self.problem(field, format!("must be a number, not {value}")))
    }

    fn numbers<const N: usize>(&self, field: &str) -> Checked<[f64; N]> {
        numbers_of(self.value(field)?)
            .ok_or_else(|| self.problem(field, format!("must be a list of {N} numbers")))
    }

    fn vector(&self, field: &str) -> Checked<Vector> {
        self.numbers(field).map(|[x, y, z]| Vector::new(x, y, z))
    }

    fn matrix(&self, field: &str) -> Checked<[Vector; 3]> {
        let rows = self.value(field)?.as_array().map(Vec::as_slice);
        let Some([first, second, third]) = rows else {
            return Err(self.problem(field, "must be a list of 3 rows of 3 numbers"));
        };
        let row = |value: &Value| {
            numbers_of(value)
                .map(|[x, y, z]| Vector::new(x, y, z))
                .ok_or_else(|| self.problem(field, "must be a list of 3 rows of 3 numbers"))
        };
        Ok([row(first)?, row(second)?, row(third)?])
    }
}

/// Tools write `500` as readily as `500.0`.
fn number_of(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        // Beyond 2^53 an integer loses digits, far outside every field's range.
        Value::Integer(number) => i32::try_from(*number).ok().map(f64::from),
        _ => None,
    }
}

fn numbers_of<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(number_of).collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests;
