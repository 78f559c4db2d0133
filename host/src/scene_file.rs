//! Pictures whose truth is known: the JSON file beside a rendered picture (`"schema": "scene-1"`).
//!
//! It names camera, laser and stripe (the rig), what tier 1 must say, and how high the stripe runs over each object.
//! Used to measure the vision, never by it.

use std::path::{Path, PathBuf};

use nearfield_shared::camera::{Camera, Intrinsics, Pose, Vector};
use nearfield_shared::laser::Laser;
use nearfield_shared::rig::{ImageSize, Rig, Stripe};
use serde::{Deserialize, Serialize};

/// Why a scene file was refused.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// The file or directory could not be read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not the JSON of a scene.
    #[error("{}: not a scene file: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What the parser said, with the field or the line.
        source: serde_json::Error,
    },
    /// The scene's camera, laser and stripe do not make a rig.
    #[error("{}: {source}", path.display())]
    Rig {
        /// The file.
        path: PathBuf,
        /// The field and the broken rule.
        source: nearfield_shared::rig::RigError,
    },
    /// No scene at all.
    #[error("{}: no scene files (*.json with \"schema\": \"scene-1\") in this directory or its subdirectories", path.display())]
    None {
        /// The directory.
        path: PathBuf,
    },
}

/// What a correct sensor must say about a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExpectedCutoff {
    /// The stripe is cut: stop.
    Trip,
    /// The stripe is whole: no stop.
    NoTrip,
    /// Too near to the limit to be judged.
    Borderline,
    /// The laser is off: stop.
    StripeMissing,
}

/// True height of one object under the stripe.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct ExpectedHeight {
    /// 95 % of the stripe on it is not higher than this, millimetres.
    #[serde(rename = "expected_height_p95_mm")]
    pub high: f32,
    /// First and last laser ray that it stops, millimetres.
    #[serde(rename = "s_range_mm")]
    pub range: [f32; 2],
}

/// One picture with its truth.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The scene's name.
    pub name: String,
    /// The picture.
    pub picture: PathBuf,
    /// The rig that took it.
    pub rig: Rig,
    /// What tier 1 must say.
    pub cutoff: ExpectedCutoff,
    /// Names and heights of the objects under the stripe.
    pub heights: Vec<(String, ExpectedHeight)>,
    /// Longest true gap, counting every displacement, millimetres.
    pub longest_gap: f32,
    /// Name and frame number where the picture belongs to a sequence.
    pub sequence: Option<(String, u32)>,
    /// Places at which the floor is lit and seen, and the true row there; empty where the file does not tell.
    pub lit_rows: Vec<LitPlace>,
    /// Labels, for tables by family.
    pub tags: Vec<String>,
}

/// A place of the stripe that is lit and seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LitPlace {
    /// Along the stripe, millimetres.
    pub place: f32,
    /// Image column.
    pub column: f32,
    /// Image row.
    pub row: f32,
}

#[derive(Deserialize)]
struct SceneText {
    #[serde(rename = "schema")]
    _schema: Schema,
    id: String,
    image: String,
    #[serde(default)]
    tags: Vec<String>,
    camera: CameraText,
    laser: LaserText,
    s_in_view_mm: [f64; 2],
    expected: ExpectedText,
    max_gap_mm: LongestGapText,
    sequence: Option<SequenceText>,
    profile: Option<ProfileText>,
}

#[derive(Deserialize)]
enum Schema {
    #[serde(rename = "scene-1")]
    Scene1,
}

#[derive(Deserialize)]
struct CameraText {
    width: u16,
    height: u16,
    #[serde(rename = "K")]
    matrix: [[f64; 3]; 3],
    dist: [f64; 5],
    #[serde(rename = "R_world_to_cam")]
    rotation: [[f64; 3]; 3],
    t_world_to_cam_mm: [f64; 3],
}

#[derive(Deserialize)]
struct LaserText {
    origin_mm: [f64; 3],
    plane: PlaneText,
    floor_line: FloorLineText,
}

#[derive(Deserialize)]
struct PlaneText {
    normal: [f64; 3],
    d_mm: f64,
}

#[derive(Deserialize)]
struct FloorLineText {
    p0_mm: [f64; 3],
    dir: [f64; 3],
}

#[derive(Deserialize)]
struct ExpectedText {
    cutoff: ExpectedCutoff,
    #[serde(default)]
    heights: std::collections::BTreeMap<String, ExpectedHeight>,
}

#[derive(Deserialize)]
struct LongestGapText {
    any: f32,
}

#[derive(Deserialize)]
struct SequenceText {
    name: String,
    frame: u32,
}

#[derive(Deserialize)]
struct ProfileText {
    s_mm: Vec<f32>,
    height_mm: Vec<Option<f32>>,
    visible: Vec<u8>,
    u: Vec<Option<f32>>,
    v: Vec<Option<f32>>,
}

/// The lowest height that truth calls raised, millimetres.
const FLOOR_MM: f32 = 0.05;

impl ProfileText {
    fn lit_rows(&self) -> Vec<LitPlace> {
        let seen = self.visible.iter().zip(&self.height_mm);
        let pixels = self.u.iter().zip(&self.v);
        self.s_mm
            .iter()
            .zip(seen)
            .zip(pixels)
            .filter_map(|((place, (visible, height)), (column, row))| {
                let lit = *visible == 1 && (*height)?.abs() < FLOOR_MM;
                lit.then_some(LitPlace { place: *place, column: (*column)?, row: (*row)? })
            })
            .collect()
    }
}

fn vector([x, y, z]: [f64; 3]) -> Vector {
    Vector::new(x, y, z)
}

impl Scene {
    /// Reads one scene file.
    ///
    /// # Errors
    /// See [`SceneFileError`].
    pub fn load(path: &Path) -> Result<Self, SceneFileError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| SceneFileError::Read { path: path.to_path_buf(), source })?;
        let text: SceneText = serde_json::from_str(&text)
            .map_err(|source| SceneFileError::Content { path: path.to_path_buf(), source })?;
        let rig = text.rig().map_err(|source| SceneFileError::Rig { path: path.to_path_buf(), source })?;
        Ok(Self {
            rig,
            picture: path.with_file_name(&text.image),
            name: text.id,
            cutoff: text.expected.cutoff,
            heights: text.expected.heights.into_iter().collect(),
            longest_gap: text.max_gap_mm.any,
            sequence: text.sequence.map(|sequence| (sequence.name, sequence.frame)),
            lit_rows: text.profile.as_ref().map(ProfileText::lit_rows).unwrap_or_default(),
            tags: text.tags,
        })
    }

    /// All scenes of a directory and its subdirectories, by path. JSON files of other kinds are left out; a damaged
    /// scene file is an error.
    ///
    /// # Errors
    /// See [`SceneFileError`].
    pub fn load_all(directory: &Path) -> Result<Vec<Self>, SceneFileError> {
        let mut files = Vec::new();
        collect(directory, &mut files)?;
        files.sort();
        let scenes: Result<Vec<Self>, SceneFileError> = files.iter().map(|file| Self::load(file)).collect();
        match scenes {
            Ok(scenes) if scenes.is_empty() => Err(SceneFileError::None { path: directory.to_path_buf() }),
            other => other,
        }
    }
}

/// How deep scene files may lie below the given directory.
const DEEPEST: usize = 4;

fn collect(directory: &Path, files: &mut Vec<PathBuf>) -> Result<(), SceneFileError> {
    let mut waiting = vec![(directory.to_path_buf(), 0)];
    while let Some((path, depth)) = waiting.pop() {
        let read = |source| SceneFileError::Read { path: path.clone(), source };
        for entry in std::fs::read_dir(&path).map_err(read)? {
            let entry = entry.map_err(read)?.path();
            if entry.is_dir() && depth < DEEPEST {
                waiting.push((entry, depth + 1));
            } else if entry.extension().is_some_and(|extension| extension == "json") && is_scene(&entry) {
                files.push(entry);
            }
        }
    }
    Ok(())
}

fn is_scene(path: &Path) -> bool {
    std::fs::read_to_string(path).is_ok_and(|text| text.contains("\"scene-1\""))
}

impl SceneText {
    fn rig(&self) -> Result<Rig, nearfield_shared::rig::RigError> {
        let [[fx, _, cx], [_, fy, cy], _] = self.camera.matrix;
        let camera = Camera {
            intrinsics: Intrinsics { fx, fy, cx, cy, distortion: self.camera.dist },
            pose: Pose {
                rotation: self.camera.rotation.map(vector),
                translation: vector(self.camera.t_world_to_cam_mm),
            },
        };
        let laser = Laser {
            origin: vector(self.laser.origin_mm),
            normal: vector(self.laser.plane.normal),
            offset: self.laser.plane.d_mm,
        };
        let [start, end] = self.s_in_view_mm;
        let line = &self.laser.floor_line;
        let stripe = Stripe { point: vector(line.p0_mm), direction: vector(line.dir), start, end };
        Rig::new(ImageSize { width: self.camera.width, height: self.camera.height }, camera, laser, stripe)
    }
}
