//! What a floor is.

use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::twin::material::LinearColour;
use crate::twin::texture::ImageTexture;

/// The floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Floor {
    /// What it is made of.
    pub kind: FloorKind,
    /// Lines painted on it; later ones cover earlier ones.
    pub paint: Vec<PaintedLine>,
    /// How far its pattern and paint lie shifted, along and across the stripe: where the robot stands.
    #[serde(skip_serializing_if = "is_zero")]
    pub shift_mm: [f64; 2],
    /// Height of its waves over and under its mean level, millimetres (0: a level floor).
    #[serde(skip_serializing_if = "is_level")]
    pub wave_mm: f64,
    /// From one wave to the next, about, millimetres.
    #[serde(skip_serializing_if = "is_default_length")]
    pub wave_length_mm: f64,
    /// A picture of a floor, laid side by side over the whole floor instead of [`Self::kind`]; paint lies on it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<FloorImage>,
}

/// A picture of a floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorImage {
    /// PNG or JPEG (sRGB; its colours are the shares of light that the floor returns). In a scene file, relative to that file.
    pub file: PathBuf,
    /// Width of the picture on the floor, millimetres; its right is along the stripe, its top outward.
    pub width_mm: f64,
    /// The picture, once [`super::Scene::load_images`] has read it.
    #[serde(skip)]
    pub texture: Option<Arc<ImageTexture>>,
}

/// Waves are so long if the scene does not tell, millimetres.
const WAVE_LENGTH_MM: f64 = 400.0;

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_level(height: &f64) -> bool {
    *height == 0.0
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_default_length(length: &f64) -> bool {
    *length == WAVE_LENGTH_MM
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_zero(values: &[f64; 2]) -> bool {
    *values == [0.0; 2]
}

impl Default for Floor {
    fn default() -> Self {
        Self {
            kind: FloorKind::Concrete,
            paint: Vec::new(),
            shift_mm: [0.0; 2],
            wave_mm: 0.0,
            wave_length_mm: WAVE_LENGTH_MM,
            image: None,
        }
    }
}

/// What a floor is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorKind {
    /// Light concrete with stains and cracks.
    Concrete,
    /// Old, dark concrete.
    ConcreteDark,
    /// Ceramic tiles of 300 mm with grout.
    Tiles,
    /// Grey epoxy coating with flakes.
    EpoxyGrey,
    /// Green epoxy coating.
    EpoxyGreen,
    /// Red epoxy coating, the laser's own colour.
    EpoxyRed,
    /// Wooden planks.
    Wood,
    /// Black rubber matting.
    Rubber,
}

impl FloorKind {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Concrete,
        Self::ConcreteDark,
        Self::Tiles,
        Self::EpoxyGrey,
        Self::EpoxyGreen,
        Self::EpoxyRed,
        Self::Wood,
        Self::Rubber,
    ];
}

/// A straight painted line through a point of the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaintedLine {
    /// Linear sRGB.
    pub colour: LinearColour,
    /// Its centre line passes through this place along the stripe ...
    #[serde(default)]
    pub along_mm: f64,
    /// ... and this place across it.
    #[serde(default)]
    pub across_mm: f64,
    /// Width of the line.
    pub width_mm: f64,
    /// Direction: 0 along the stripe, 90 straight outward.
    #[serde(default)]
    pub angle_degrees: f64,
}
