//! Objects: form, size, material, place.

use serde::{Deserialize, Serialize};

use crate::twin::material::{self, Material};

/// One object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneObject {
    /// How the truth names it.
    pub name: String,
    /// Its form and size.
    pub shape: Shape,
    /// A name from the list of materials, or one of its own.
    pub material: MaterialChoice,
    /// Place along the stripe (of its centre; for a cable, of its path's origin).
    #[serde(default)]
    pub along_mm: f64,
    /// Place across the stripe.
    #[serde(default)]
    pub across_mm: f64,
    /// Turned about the vertical, degrees.
    #[serde(default)]
    pub yaw_degrees: f64,
    /// Height of its underside over the floor.
    #[serde(default)]
    pub bottom_mm: f64,
    /// Speed along and across the stripe, millimetres a second.
    #[serde(default)]
    pub velocity_mm_per_s: [f64; 2],
}

/// A material by name or by its figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MaterialChoice {
    /// One of [`material::MATERIALS`].
    Named(String),
    /// Any other.
    Own(Material),
}

impl MaterialChoice {
    /// By name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::Named(name.to_owned())
    }

    /// The material, or `None` for an unknown name.
    #[must_use]
    pub fn resolve(&self) -> Option<Material> {
        match self {
            Self::Named(name) => material::named(name),
            Self::Own(material) => Some(*material),
        }
    }
}

/// Form and size; width lies along the stripe and depth across it before the object is turned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A box.
    Box {
        /// Along the stripe.
        width_mm: f64,
        /// Across the stripe.
        depth_mm: f64,
        /// Upwards.
        height_mm: f64,
    },
    /// A cylinder on its end: a can, a post, a leg.
    Post {
        /// Diameter.
        diameter_mm: f64,
        /// Height.
        height_mm: f64,
    },
    /// A cylinder on its side, along the stripe before it is turned.
    Rod {
        /// Diameter.
        diameter_mm: f64,
        /// Length.
        length_mm: f64,
    },
    /// A round cable lying along a path.
    Cable {
        /// Diameter.
        diameter_mm: f64,
        /// Places along and across, relative to the object's own place; a smooth curve passes through them.
        path_mm: Vec<[f64; 2]>,
    },
    /// A forearm with a hand, lying across the stripe, the hand towards the robot.
    Hand {
        /// Height of the forearm; everything else is in proportion.
        height_mm: f64,
    },
    /// A hole with a flat bottom: a pit, a kerb, the edge of a dock.
    Pit {
        /// Along the stripe.
        width_mm: f64,
        /// Across the stripe.
        depth_mm: f64,
        /// Downwards.
        deep_mm: f64,
    },
}
