//! Screwdrivers and wrenches.

use glam::{Quat, Vec2, Vec3};

use super::{cuboid, cylinder, frustum, prism, stick, v2, v3};
use crate::material::{Material, Pattern, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::Shape;

/// A screwdriver along x: handle at x < 0, blade at x > 0.
pub fn screwdriver(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let steel = model.paint(Material::tool_steel(item));
    let first = model.paint(Material::coloured_plastic(item));
    let colour = tool_colour(item);
    let second = model.paint(Material::rubber(item, colour));
    let family = item.weighted(&[3.0, 3.0, 1.2, 1.4, 1.0, 1.4]);
    let (handle, radius, blade, thick) = match family {
        // Stubby, precision, and the usual sizes.
        2 => (item.between(35.0, 55.0), item.between(13.0, 18.0), item.between(18.0, 40.0), 3.0),
        3 => (
            item.between(60.0, 90.0),
            item.between(4.5, 7.5),
            item.between(35.0, 70.0),
            item.between(1.0, 1.8),
        ),
        _ => (
            item.between(75.0, 120.0),
            item.between(11.0, 18.0),
            item.between(55.0, 180.0),
            item.between(2.0, 4.4),
        ),
    };
    handle_parts(&mut model, item, family, (first, second, steel), handle, radius);
    let shaft =
        Part::new(cylinder(thick, blade / 2.0 + 4.0, 0.2), steel).along_x().at(blade / 2.0 - 4.0, 0.0, 0.0);
    model.add(Solid::new(shaft));
    if family == 5 || item.chance(0.1) {
        // Insulated shaft.
        let sleeve = Part::new(cylinder(thick + 1.1, blade * 0.43, 0.4), first).along_x();
        model.add_part(sleeve.at(blade * 0.42, 0.0, 0.0));
    }
    if item.chance(0.5) {
        let width = thick * item.between(1.2, 1.9);
        let outline = vec![
            v2(-thick * 3.0, thick * 0.9),
            v2(-thick * 1.6, width),
            v2(thick * 0.2, width * 0.85),
            v2(thick * 0.2, -width * 0.85),
            v2(-thick * 1.6, -width),
            v2(-thick * 3.0, -thick * 0.9),
        ];
        let tip = Part::new(Shape::Extrusion { outline, half: (thick * 0.35).max(0.5), round: 0.1 }, steel);
        model.add_part(tip.turned(Quat::from_rotation_x(item.angle())).at(blade, 0.0, 0.0));
    } else {
        let mut tip =
            Solid::new(Part::new(frustum(thick, thick * 0.25, thick * 1.4, 0.0), steel).along_x().at(
                blade + thick,
                0.0,
                0.0,
            ));
        for turn in 0..4 {
            let around = Quat::from_rotation_x(turn as f32 * std::f32::consts::FRAC_PI_2 + 0.785);
            let at = around * Vec3::new(blade + thick * 1.2, 0.0, thick * 0.95);
            let flute = Part::new(cuboid(thick * 2.0, thick * 0.5, thick * 0.5, 0.0), steel);
            tip = tip.cut(flute.turned(around * Quat::from_rotation_x(0.785)).at(at.x, at.y, at.z));
        }
        model.add(tip);
    }
    // It lies on the handle and the tip.
    let lean = ((radius - thick) / (blade + handle * 0.5)).asin();
    model.rest = Quat::from_rotation_y(lean) * Quat::from_rotation_x(pose.angle());
    model
}

/// The materials of a screwdriver: two of the handle, steel.
type Paints = (u8, u8, u8);

fn handle_parts(model: &mut Model, item: &mut Draw, family: usize, paints: Paints, length: f32, radius: f32) {
    let at = -length / 2.0;
    match family {
        0 | 5 => fluted_handle(model, item, paints, length, radius),
        1 | 2 => waisted_handle(model, item, paints, length, radius),
        3 => precision_handle(model, item, paints, length, radius),
        _ => {
            // A plain rod with rounded ends, sometimes of wood.
            let mut material = Material::coloured_plastic(item);
            if item.chance(0.4) {
                material.colour = srgb(176, 122, 70);
                material.second = srgb(120, 76, 40);
                material.pattern = Pattern::Grain;
            }
            let paint = model.paint(material);
            let rod = Part::new(cylinder(radius, length / 2.0, radius * item.between(0.1, 0.8)), paint);
            model.add_part(rod.along_x().at(at, 0.0, 0.0));
            model.add_part(Part::new(cylinder(radius * 0.6, 5.0, 1.0), paints.2).along_x());
        }
    }
}

/// A handle with flutes, a neck and often a coloured band.
fn fluted_handle(model: &mut Model, item: &mut Draw, (first, second, _): Paints, length: f32, radius: f32) {
    let fluted = Shape::Fluted {
        radius,
        depth: radius * item.between(0.08, 0.22),
        count: item.pick(&[6, 6, 8, 10]),
        half: length / 2.0,
        round: radius * 0.45,
    };
    let neck = Part::new(frustum(radius * 0.9, radius * 0.55, length * 0.08, 1.0), second).along_x();
    model.add(Solid::new(Part::new(fluted, first).along_x().at(-length / 2.0, 0.0, 0.0)));
    model.add_part(neck.at(-length * 0.02, 0.0, 0.0));
    if item.chance(0.5) {
        let band = Part::new(cylinder(radius * 1.01, length * 0.07, 1.0), second).along_x();
        model.add_part(band.at(-length * 0.82, 0.0, 0.0));
    }
}

/// An ergonomic handle: a waist near the blade, a belly, a round end, soft ribs.
fn waisted_handle(model: &mut Model, item: &mut Draw, (first, second, _): Paints, length: f32, radius: f32) {
    let waist = item.between(0.55, 0.8);
    let outline = vec![
        v2(0.0, -length),
        v2(radius * 0.75, -length),
        v2(radius, -length * 0.88),
        v2(radius * 1.02, -length * 0.55),
        v2(radius * waist, -length * 0.2),
        v2(radius * (waist + 0.12), -length * 0.07),
        v2(radius * 0.5, 0.0),
        v2(0.0, 0.0),
    ];
    let body = Shape::Revolution { outline, round: radius * 0.06 };
    model.add_part(Part::new(body, first).along_x());
    let ribs = item.whole(3, 6);
    for rib in 0..ribs {
        let turn = rib as f32 / ribs as f32 * std::f32::consts::TAU;
        let (y, z) = (turn.cos() * radius * 0.8, turn.sin() * radius * 0.8);
        let (from, to) = (v3(-length * 0.9, y, z), v3(-length * 0.42, y, z));
        model.add_part(Part::new(stick(from, to, radius * 0.28, radius * 0.26), second));
    }
}

/// A precision driver's handle: thin, knurled metal or plastic, with a turning cap.
fn precision_handle(
    model: &mut Model,
    item: &mut Draw,
    (first, second, steel): Paints,
    length: f32,
    radius: f32,
) {
    let body = if item.chance(0.5) { steel } else { first };
    let knurl = Shape::Fluted { radius, depth: radius * 0.08, count: 20, half: length * 0.4, round: 0.5 };
    let cap = Part::new(cylinder(radius * 1.1, length * 0.06, 1.0), second).along_x();
    let nose = Part::new(frustum(radius, radius * 0.4, length * 0.06, 0.3), body).along_x();
    model.add_part(Part::new(knurl, body).along_x().at(-length / 2.0, 0.0, 0.0));
    model.add_part(cap.at(-length * 0.95, 0.0, 0.0));
    model.add_part(nose.at(-length * 0.05, 0.0, 0.0));
}

/// An open jaw of a wrench: a head with a slot for a nut of the given width across flats.
fn jaw(steel: u8, flats: f32, half: f32, x: f32, turn: f32, head: Part, solid: Solid) -> Solid {
    let out = Vec2::from_angle(turn) * flats * 0.75;
    let slot = Part::new(cuboid(flats * 0.95, flats * 0.5, half * 3.0, flats * 0.1), steel);
    solid.blend(head, flats * 0.35).cut(slot.turned(Quat::from_rotation_z(turn)).at(x + out.x, out.y, 0.0))
}

/// A ring of a wrench.
fn ring(steel: u8, flats: f32, half: f32, x: f32, solid: Solid, points: u32) -> Solid {
    let head = Part::new(cylinder(flats * 0.78, half, half * 0.3), steel).at(x, 0.0, 0.0);
    let hole = |turn: f32| {
        Part::new(prism(6, flats * 0.5, half * 3.0, 0.0), steel)
            .turned(Quat::from_rotation_z(turn))
            .at(x, 0.0, 0.0)
    };
    let solid = solid.blend(head, flats * 0.3).cut(hole(0.0));
    if points == 12 { solid.cut(hole(std::f32::consts::FRAC_PI_6)) } else { solid }
}

/// A wrench, flat on the floor, along x.
pub fn wrench(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let steel = model.paint(Material::tool_steel(item));
    let flats = item.octave(8.0, 30.0);
    let length = flats * item.between(7.5, 12.0) + 30.0;
    let half = (flats * item.between(0.15, 0.24)).max(2.0);
    let reach = length / 2.0 - flats;
    let width = flats * item.between(0.32, 0.5);
    let bar = Part::new(cuboid(reach, width, half * 0.75, half * 0.5), steel);
    let mut solid = Solid::new(bar);
    let slant = item.pick(&[0.0, 0.26, 0.26, 0.26]) * item.sign();
    let head = |x: f32, size: f32| {
        Part::new(Shape::Ellipsoid(Vec3::new(size * 1.05, size * 1.12, half * 3.0)), steel).at(x, 0.0, 0.0)
    };
    let small = flats * item.between(0.75, 0.95);
    match item.weighted(&[3.0, 3.2, 1.8, 1.8, 1.0]) {
        0 => {
            solid = jaw(steel, flats, half, reach, slant, head(reach, flats), solid);
            solid = jaw(steel, small, half, -reach, std::f32::consts::PI + slant, head(-reach, small), solid);
        }
        1 => {
            solid = jaw(steel, flats, half, reach, slant, head(reach, flats), solid);
            solid = ring(steel, flats, half * 1.1, -reach, solid, item.pick(&[6, 12, 12]));
        }
        2 => {
            solid = ring(steel, flats, half * 1.1, reach, solid, 12);
            solid = ring(steel, small, half * 1.1, -reach, solid, 12);
        }
        3 => {
            adjustable(&mut model, item, steel, flats, length);
            model.rest = Quat::from_rotation_x(if pose.chance(0.5) { std::f32::consts::PI } else { 0.0 });
            return model;
        }
        _ => {
            // The crudest wrench: a bar with a disc at either end, one of them slotted.
            let disc = |x: f32| Part::new(cylinder(flats * 0.85, half * 1.2, 0.6), steel).at(x, 0.0, 0.0);
            solid = solid.join(disc(reach)).join(disc(-reach));
            if item.chance(0.6) {
                solid = solid.cut(Part::new(cuboid(flats, flats * 0.42, half * 3.0, 0.0), steel).at(
                    reach + flats * 0.7,
                    0.0,
                    0.0,
                ));
                solid =
                    solid.cut(Part::new(cylinder(flats * 0.4, half * 3.0, 0.0), steel).at(-reach, 0.0, 0.0));
            }
        }
    }
    // Heads no thicker than forged ones are, and a recessed panel in the shank.
    solid = solid.meet(Part::new(cuboid(length, length, half * 1.1, 0.0), steel));
    if item.chance(0.45) {
        let panel = |z: f32| {
            Part::new(cuboid(reach * 0.62, width * 0.6, half * 0.3, half * 0.2), steel).at(0.0, 0.0, z)
        };
        solid = solid.cut(panel(half * 0.8)).cut(panel(-half * 0.8));
    }
    model.add(solid);
    model.rest = Quat::from_rotation_x(if pose.chance(0.5) { std::f32::consts::PI } else { 0.0 });
    model
}

fn adjustable(model: &mut Model, item: &mut Draw, steel: u8, flats: f32, length: f32) {
    let half = (flats * 0.22).max(2.5);
    let reach = length / 2.0;
    let open = flats * item.between(0.25, 0.95);
    let outline = vec![
        v2(-reach, -flats * 0.35),
        v2(reach * 0.5, -flats * 0.32),
        v2(reach * 0.72, -flats * 0.75),
        v2(reach, -flats * 0.72),
        v2(reach, -flats * 0.18),
        v2(reach * 0.78, -flats * 0.1),
        v2(reach * 0.66, flats * 0.75),
        v2(reach * 0.5, flats * 0.7),
        v2(reach * 0.4, flats * 0.36),
        v2(-reach, flats * 0.42),
    ];
    let handle = if item.chance(0.4) { model.paint(Material::coloured_plastic(item)) } else { steel };
    let body = Part::new(Shape::Extrusion { outline, half, round: half * 0.4 }, steel);
    let hole = Part::new(cylinder(flats * 0.2, half * 3.0, 0.0), steel).at(-reach * 0.88, 0.0, 0.0);
    model.add(Solid::new(body).cut(hole));
    if handle != steel {
        let grip = Part::new(cuboid(reach * 0.6, flats * 0.45, half * 1.15, half), handle).at(
            -reach * 0.3,
            0.0,
            0.0,
        );
        model.add_part(grip);
    }
    let movable = vec![
        v2(reach * 0.62, open - flats * 0.1),
        v2(reach * 0.97, open - flats * 0.1),
        v2(reach * 0.92, open + flats * 0.35),
        v2(reach * 0.66, open + flats * 0.42),
    ];
    model.add_part(Part::new(
        Shape::Extrusion { outline: movable, half: half * 0.85, round: half * 0.3 },
        steel,
    ));
    let worm =
        Shape::Fluted { radius: flats * 0.2, depth: flats * 0.04, count: 14, half: flats * 0.28, round: 0.3 };
    model.add_part(Part::new(worm, steel).along_y().at(reach * 0.58, 0.0, half * 0.3));
}
