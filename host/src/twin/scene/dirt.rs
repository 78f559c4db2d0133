//! Dirt on the lens.

use serde::{Deserialize, Serialize};

/// Dirt on the lens's front glass. Left out: a clean glass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Dirt {
    /// So many strokes of a greasy finger; where they lie follows from the seed.
    pub smudges: u32,
    /// So many grains of dust.
    pub dust: u32,
    /// The share of the light that meets the dirt in the middle of the worst of them (0 to 1).
    pub strength: f64,
    /// Dirt at places of one's own choice.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub spots: Vec<DirtSpot>,
}

impl Default for Dirt {
    fn default() -> Self {
        Self { smudges: 0, dust: 0, strength: 0.7, spots: Vec::new() }
    }
}

impl Dirt {
    /// Nothing on the glass?
    #[must_use]
    pub const fn is_clean(&self) -> bool {
        self.smudges == 0 && self.dust == 0 && self.spots.is_empty()
    }
}

/// One spot of dirt; soft, because the glass is out of focus.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirtSpot {
    /// What it does with the light.
    pub kind: DirtKind,
    /// Its middle, in shares of the picture's width and height.
    pub at: [f64; 2],
    /// Its radius, in shares of the picture's width.
    pub radius: f64,
    /// The share of the light that meets it in its middle (0 to 1).
    pub strength: f64,
}

/// What dirt does with the light that meets it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DirtKind {
    /// Grease: scatters most of it a little (blur), some of it far (a veil); a tenth is lost.
    Smudge,
    /// Dust: most is lost, some scattered far.
    Dust,
}
