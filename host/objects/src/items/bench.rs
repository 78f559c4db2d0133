//! Markers and Allen keys.

use glam::{Quat, Vec3};

use super::{cuboid, cylinder, frustum, prism, stick, v2, v3};
use crate::material::{Material, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::{Section, Shape};

/// A felt marker or highlighter along x, its tip towards +x.
pub fn marker(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let ink = tool_colour(item);
    let body_colour = match item.weighted(&[2.0, 2.0, 1.0, 1.0]) {
        0 => Vec3::splat(item.between(0.55, 0.85)),
        1 => ink,
        2 => Vec3::splat(item.between(0.01, 0.05)),
        _ => Vec3::splat(item.between(0.3, 0.6)),
    };
    let metal = item.chance(0.12);
    let body = if metal {
        Material::metal(item, body_colour.max(Vec3::splat(0.3)), 0.3)
    } else {
        Material::plastic(item, body_colour)
    };
    let body = model.paint(body);
    let cap = model.paint(Material::plastic(item, ink));
    let label_colour =
        if item.chance(0.5) { tool_colour(item) } else { Vec3::splat(item.between(0.02, 0.9)) };
    let label = model.paint(Material::plastic(item, label_colour));
    let felt = model.paint(Material::rubber(item, ink * 0.5));
    let radius = item.between(4.2, 10.5);
    let length = item.between(95.0, 150.0);
    let capped = length * item.between(0.22, 0.4);
    let flat = item.chance(0.18);
    let rod = |r: f32, half: f32, round: f32| {
        if flat { cuboid(r * 0.6, r * 1.15, half, r * 0.4) } else { cylinder(r, half, round) }
    };
    let rear = length - capped;
    model.add_part(Part::new(rod(radius, rear / 2.0, radius * item.between(0.1, 0.5)), body).along_x().at(
        -rear / 2.0,
        0.0,
        0.0,
    ));
    if item.chance(0.6) {
        model.add_part(
            Part::new(rod(radius * 1.012, rear * item.between(0.2, 0.36), 0.1), label).along_x().at(
                -rear * item.between(0.42, 0.58),
                0.0,
                0.0,
            ),
        );
    }
    if item.chance(0.4) {
        model.add_part(Part::new(rod(radius * 1.02, item.between(2.0, 8.0), 0.3), cap).along_x().at(
            -rear + 5.0,
            0.0,
            0.0,
        ));
    }
    if pose.chance(0.7) {
        let taper = item.between(0.75, 1.0);
        let shape = if flat {
            rod(radius * 1.08, capped / 2.0, 1.0)
        } else {
            frustum(radius * 1.1, radius * 1.1 * taper, capped / 2.0, radius * 0.3)
        };
        let mut solid = Solid::new(Part::new(shape, cap).along_x().at(capped / 2.0, 0.0, 0.0));
        if item.chance(0.65) {
            let clip = Part::new(cuboid(capped * 0.45, radius * 0.22, radius * 0.12, 0.3), cap);
            solid = solid.join(clip.at(capped * 0.42, 0.0, radius * 1.4));
            solid = solid.join(Part::new(cuboid(radius * 0.3, radius * 0.22, radius * 0.3, 0.2), cap).at(
                capped * 0.85,
                0.0,
                radius * 1.15,
            ));
        }
        model.add(solid);
    } else {
        let nose = capped * 0.45;
        model.add_part(Part::new(frustum(radius * 0.85, radius * 0.45, nose / 2.0, 0.4), body).along_x().at(
            nose / 2.0,
            0.0,
            0.0,
        ));
        model.add_part(
            Part::new(frustum(radius * 0.34, radius * item.between(0.05, 0.3), nose * 0.22, 0.2), felt)
                .along_x()
                .at(nose * 1.15, 0.0, 0.0),
        );
    }
    model.rest = Quat::from_rotation_x(pose.angle());
    if pose.chance(0.03) && model.lift == 0.0 {
        model.rest = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    }
    model
}

/// An Allen key: hexagonal wire bent to an L, or with a T-handle.
pub fn allen_key(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let metal = Material::tool_steel(item);
    let steel = model.paint(metal);
    let flats = item.octave(2.0, 12.0);
    let long = (flats * item.between(11.0, 24.0)).max(40.0);
    let short = (long * item.between(0.2, 0.5)).max(flats * 3.0);
    let bend = flats * item.between(1.0, 2.2);
    let family = item.weighted(&[5.0, 2.0, 1.3, 1.2]);
    if family == 2 {
        // T-handle.
        let colour = tool_colour(item);
        let plastic = model.paint(Material::plastic(item, colour));
        model.add_part(Part::new(prism(6, flats / 2.0, long / 2.0, 0.1), steel).along_x().at(
            long / 2.0,
            0.0,
            0.0,
        ));
        let half = item.between(22.0, 45.0);
        let grip = Part::new(cuboid(item.between(6.0, 11.0), half, item.between(5.0, 9.0), 4.5), plastic);
        model.add_part(grip);
        model.rest = Quat::from_rotation_y(0.04);
        return model;
    }
    let mut path = vec![v2(-long, 0.0), v2(-bend, 0.0)];
    for step in 1..=8 {
        let angle = step as f32 / 8.0 * std::f32::consts::FRAC_PI_2;
        path.push(v2(-bend + bend * angle.sin(), bend - bend * angle.cos()));
    }
    path.push(v2(0.0, short));
    // Centred, so that its bounding sphere is tight.
    for corner in &mut path {
        *corner += v2(long / 2.0, -short / 2.0);
    }
    let mut solid =
        Solid::new(Part::new(Shape::Strap { path, section: Section::Hexagon(flats / 2.0) }, steel));
    let tip = Vec3::new(-long / 2.0, -short / 2.0, 0.0);
    if family == 1 {
        let neck = Part::new(Shape::Torus { ring: flats * 0.62, tube: flats * 0.22 }, steel).along_x();
        solid = solid.cut(neck.at(tip.x + flats * 1.1, tip.y, 0.0));
    }
    model.add(solid);
    if family == 3 {
        let sleeve = model.paint(Material::coloured_plastic(item));
        let from = v3(tip.x + long * 0.25, tip.y, 0.0);
        let to = v3(tip.x + long - bend * 1.6, tip.y, 0.0);
        model.add_part(Part::new(stick(from, to, flats * 0.75, flats * 0.75), sleeve));
    }
    if pose.chance(0.5) {
        model.rest = Quat::from_rotation_x(std::f32::consts::PI);
    }
    if pose.chance(0.12) {
        // On its long arm, the short one up in the air.
        model.rest = Quat::from_rotation_x(pose.between(0.9, 1.57));
    }
    model
}
