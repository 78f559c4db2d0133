//! What surfaces are made of, as far as light is concerned.

use serde::{Deserialize, Serialize};

/// Colour in linear sRGB, 0 (black) to 1 (white).
pub type LinearColour = [f32; 3];

/// How a surface returns light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Share of daylight that it scatters, linear sRGB.
    pub albedo: LinearColour,
    /// Share of the laser's light (about 650 nm, deep red) that it scatters; mostly a little more than red albedo.
    pub laser_albedo: f32,
    /// Strength of the highlight on top of the scattered light: 0 matt, 0.3 plastic, 1 polished.
    #[serde(default)]
    pub gloss: f32,
    /// How tight the highlight is (Blinn-Phong exponent).
    #[serde(default = "default_tightness")]
    pub tightness: f32,
    /// Share of the returned laser light that has wandered under the surface first: 0 opaque, 0.5 skin, 0.9 wax or milky
    /// plastic. It leaves the stripe wider, softer and without speckle.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub translucency: f32,
    /// How far that light wanders along the surface: its brightness falls to 1/e over this length, millimetres.
    #[serde(default = "default_scatter", skip_serializing_if = "is_default_scatter")]
    pub scatter_mm: f32,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_zero(share: &f32) -> bool {
    *share == 0.0
}

const fn default_scatter() -> f32 {
    3.0
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over references")]
fn is_default_scatter(length: &f32) -> bool {
    *length == default_scatter()
}

const fn default_tightness() -> f32 {
    40.0
}

const fn matt(red: f32, green: f32, blue: f32) -> Material {
    glossy(red, green, blue, 0.0, default_tightness())
}

const fn glossy(red: f32, green: f32, blue: f32, gloss: f32, tightness: f32) -> Material {
    Material {
        albedo: [red, green, blue],
        laser_albedo: red,
        gloss,
        tightness,
        translucency: 0.0,
        scatter_mm: default_scatter(),
    }
}

const fn translucent(opaque: Material, translucency: f32, scatter_mm: f32) -> Material {
    Material { translucency, scatter_mm, ..opaque }
}

/// The materials a scene may name, with their everyday reflectances (estimates from photographs, not measurements).
pub const MATERIALS: [(&str, Material); 23] = [
    ("cardboard", matt(0.36, 0.23, 0.13)),
    ("white_card", matt(0.75, 0.74, 0.72)),
    ("grey_card", matt(0.18, 0.18, 0.18)),
    ("pallet_wood", matt(0.42, 0.30, 0.18)),
    ("plastic_yellow", glossy(0.52, 0.36, 0.03, 0.25, 60.0)),
    ("plastic_blue", glossy(0.05, 0.11, 0.36, 0.25, 60.0)),
    ("plastic_red", glossy(0.50, 0.04, 0.03, 0.25, 60.0)),
    ("plastic_black", glossy(0.03, 0.03, 0.03, 0.20, 60.0)),
    ("rubber_black", matt(0.035, 0.035, 0.036)),
    ("cable_black", glossy(0.04, 0.04, 0.04, 0.10, 30.0)),
    ("cable_orange", glossy(0.60, 0.20, 0.03, 0.10, 30.0)),
    ("cable_grey", glossy(0.30, 0.30, 0.31, 0.10, 30.0)),
    ("aluminium", glossy(0.42, 0.42, 0.43, 0.80, 25.0)),
    ("steel", glossy(0.30, 0.30, 0.31, 1.00, 60.0)),
    ("skin_light", matt(0.60, 0.36, 0.26)),
    ("skin_dark", matt(0.21, 0.11, 0.07)),
    ("leather_brown", glossy(0.14, 0.08, 0.05, 0.08, 20.0)),
    ("denim", matt(0.06, 0.09, 0.18)),
    ("high_visibility", matt(0.70, 0.55, 0.02)),
    ("velvet_black", matt(0.012, 0.012, 0.012)),
    ("wax_white", translucent(matt(0.70, 0.68, 0.60), 0.85, 4.0)),
    ("plastic_milky", translucent(glossy(0.50, 0.50, 0.50, 0.20, 60.0), 0.90, 8.0)),
    ("plastic_clear", translucent(glossy(0.06, 0.06, 0.06, 0.30, 80.0), 0.95, 15.0)),
];

/// The material of this name.
#[must_use]
pub fn named(name: &str) -> Option<Material> {
    MATERIALS.iter().find(|(known, _)| *known == name).map(|(_, material)| *material)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_material_returns_more_light_than_it_gets_and_names_are_unique() {
        for (index, (name, material)) in MATERIALS.iter().enumerate() {
            let reflectances = material.albedo.iter().chain([&material.laser_albedo]);
            assert!(reflectances.into_iter().all(|share| (0.0..=1.0).contains(share)), "{name}");
            assert!((0.0..=1.0).contains(&material.translucency) && material.scatter_mm > 0.0, "{name}");
            assert!(MATERIALS[index + 1..].iter().all(|(other, _)| other != name), "{name} twice");
            assert_eq!(named(name), Some(*material));
        }
        assert_eq!(named("unobtainium"), None);
    }
}
