//! Bolts, nuts and washers: metric sizes, with their usual heads and drives (ISO 4014, 4762, 7380, 10642, 4032, 7089 ...).

use glam::{Quat, Vec3};

use super::{cuboid, cylinder, frustum, prism, v2};
use crate::material::{Material, srgb};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::Shape;

/// Nominal diameters, mm.
const SIZES: [f32; 8] = [4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0];

/// Pitch of the coarse thread of a nominal diameter, mm, to a tenth.
fn pitch(diameter: f32) -> f32 {
    0.35 + 0.115 * diameter
}

/// The shaft of a bolt from z = -length to 0, threaded over its lower part.
fn shaft(item: &mut Draw, metal: u8, diameter: f32, length: f32) -> Solid {
    let radius = diameter / 2.0;
    let plain = Part::new(cylinder(radius, length / 2.0, 0.08 * diameter), metal).at(0.0, 0.0, -length / 2.0);
    if item.chance(0.22) {
        return Solid::new(plain);
    }
    let threaded = if item.chance(0.5) { length } else { length * item.between(0.4, 0.8) };
    let depth = 0.6 * pitch(diameter);
    let thread = Shape::Thread { core: radius - depth, depth, pitch: pitch(diameter), half: threaded / 2.0 };
    let thread = Part::new(thread, metal).at(0.0, 0.0, threaded / 2.0 - length);
    if threaded > 0.98 * length {
        return Solid::new(thread);
    }
    let bare = length - threaded;
    Solid::new(thread).join(Part::new(cylinder(radius, bare / 2.0, 0.0), metal).at(0.0, 0.0, -bare / 2.0))
}

/// A cross-shaped recess for a screwdriver.
fn cross_recess(metal: u8, radius: f32, top: f32) -> [Part; 2] {
    let slot = |turn: f32| {
        Part::new(cuboid(radius * 0.55, radius * 0.12, radius * 0.5, 0.0), metal)
            .turned(Quat::from_rotation_z(turn))
            .at(0.0, 0.0, top)
    };
    [slot(0.0), slot(std::f32::consts::FRAC_PI_2)]
}

/// A part moved along z.
fn up(shape: Shape, metal: u8, z: f32) -> Part {
    Part::new(shape, metal).at(0.0, 0.0, z)
}

/// A hexagon head with chamfered corners, with or without a flange. Returns the solid and the head's radius, mm.
fn hexagon_head(
    item: &mut Draw,
    solid: Solid,
    metal: u8,
    d: f32,
    length: f32,
    flanged: bool,
) -> (Solid, f32) {
    let (inradius, height) = (d * item.between(0.78, 0.9), d * item.between(0.55, 0.72));
    let chamfer = frustum(inradius * 4.0, inradius, length + height, 0.0);
    let solid = solid.join(up(prism(6, inradius, height / 2.0, 0.0), metal, height / 2.0)).meet(up(
        chamfer,
        metal,
        height * 0.05,
    ));
    if !flanged {
        return (solid, inradius * 1.1);
    }
    (solid.join(up(frustum(d * 1.15, d * 0.85, d * 0.12, 0.04 * d), metal, d * 0.12)), d * 1.15)
}

/// A cylinder head with a hexagon socket, knurled.
fn socket_head(solid: Solid, metal: u8, d: f32) -> Solid {
    let knurled =
        Shape::Fluted { radius: d * 0.78, depth: d * 0.025, count: 36, half: d * 0.5, round: d * 0.06 };
    solid.join(up(knurled, metal, d * 0.5)).cut(up(prism(6, d * 0.41, d * 0.4, 0.0), metal, d * 0.95))
}

/// A countersunk head with a hexagon socket or a cross.
fn countersunk_head(item: &mut Draw, solid: Solid, metal: u8, d: f32) -> Solid {
    let solid = solid.join(up(frustum(d * 0.5, d * 0.98, d * 0.28, 0.03 * d), metal, d * 0.22));
    if item.chance(0.5) {
        return solid.cut(up(prism(6, d * 0.3, d * 0.3, 0.0), metal, d * 0.45));
    }
    cross_recess(metal, d, d * 0.5).into_iter().fold(solid, Solid::cut)
}

/// A bolt or machine screw, its head above z = 0.
pub fn bolt(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let metal = model.paint(Material::fastener(item));
    let d = item.pick(&SIZES);
    let length = (d * item.octave(1.6, 8.0)).min(130.0);
    let solid = shaft(item, metal, d, length);
    let family = item.weighted(&[4.0, 1.6, 2.4, 1.3, 1.3, 0.8, 0.6]);
    let dome = |wide: f32, high: f32| Part::new(Shape::Ellipsoid(Vec3::new(wide, wide, high)), metal);
    let (solid, head_radius) = match family {
        0 | 1 => hexagon_head(item, solid, metal, d, length, family == 1),
        2 => (socket_head(solid, metal, d), d * 0.78),
        3 => {
            let socket = up(prism(6, d * 0.3, d * 0.3, 0.0), metal, d * 0.55);
            (solid.join(dome(d * 0.9, d * 0.58)).cut(socket), d * 0.9)
        }
        4 => (countersunk_head(item, solid, metal, d), d * 0.98),
        5 => {
            // Pan head with a cross.
            let pan = solid.join(up(cylinder(d * 0.95, d * 0.3, d * 0.24), metal, d * 0.3));
            (cross_recess(metal, d, d * 0.6).into_iter().fold(pan, Solid::cut), d * 0.95)
        }
        _ => {
            // Carriage bolt: dome on a square neck.
            let neck = up(cuboid(d * 0.5, d * 0.5, d * 0.3, 0.2), metal, -d * 0.3);
            (solid.join(dome(d * 1.05, d * 0.5)).join(neck), d * 1.05)
        }
    };
    model.add(solid);
    if item.chance(0.1) {
        model.add(hexagon_nut(metal, d, d * 0.8, -length * item.between(0.4, 0.85)));
    }
    // It lies on its head and on the end of its shaft.
    let lean = ((head_radius - d / 2.0) / length).min(0.9).asin();
    model.rest = if pose.chance(0.1) {
        Quat::from_rotation_x(std::f32::consts::PI)
    } else {
        Quat::from_rotation_x(std::f32::consts::FRAC_PI_2 - lean) * Quat::from_rotation_z(pose.angle())
    };
    model
}

/// A hexagon nut with chamfered corners and a threaded hole, around (0, 0, z).
fn hexagon_nut(metal: u8, d: f32, height: f32, z: f32) -> Solid {
    let inradius = d * 0.82;
    let thread = Shape::Thread { core: d * 0.44, depth: d * 0.06, pitch: pitch(d), half: height };
    Solid::new(Part::new(prism(6, inradius, height / 2.0, 0.0), metal).at(0.0, 0.0, z))
        .meet(
            Part::new(Shape::Ellipsoid(Vec3::new(inradius * 1.24, inradius * 1.24, height * 0.95)), metal)
                .at(0.0, 0.0, z),
        )
        .cut(Part::new(thread, metal).at(0.0, 0.0, z))
}

/// A nut.
pub fn nut(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let metal = model.paint(Material::fastener(item));
    let d = item.pick(&[5.0_f32, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0]);
    let height = d * item.between(0.5, 0.95);
    let hole = |radius: f32| Part::new(cylinder(radius, d * 2.0, 0.0), metal);
    let family = item.weighted(&[5.0, 1.2, 1.6, 1.2, 1.0, 1.0, 0.8, 0.7]);
    match family {
        0 => model.add(hexagon_nut(metal, d, height, 0.0)),
        1 => {
            let flange = Part::new(frustum(d * 1.15, d * 0.85, d * 0.12, 0.03 * d), metal);
            model.add(hexagon_nut(metal, d, height, 0.0));
            model.add(Solid::new(flange.at(0.0, 0.0, -height * 0.5 + d * 0.1)).cut(hole(d * 0.48)));
        }
        2 => lock_nut(&mut model, item, metal, d, height),
        3 => wing_nut(&mut model, item, metal, d),
        4 => {
            let body = Part::new(cuboid(d * 0.82, d * 0.82, height * 0.4, 0.05 * d), metal);
            model.add(Solid::new(body).cut(hole(d * 0.48)));
        }
        5 => {
            // T-slot nut for aluminium profiles.
            let length = d * item.between(0.9, 1.8);
            let body = Part::new(cuboid(length, d * 0.75, d * 0.25, 0.3), metal);
            let neck = Part::new(cuboid(length, d * 0.42, d * 0.3, 0.3), metal).at(0.0, 0.0, d * 0.35);
            model.add(Solid::new(body).join(neck).cut(hole(d * 0.36)));
        }
        6 => {
            // Cap nut.
            let dome = Part::new(Shape::Sphere(d * 0.78), metal).at(0.0, 0.0, height * 0.45);
            model.add(
                hexagon_nut(metal, d, height, 0.0)
                    .join(dome)
                    .cut(Part::new(cylinder(d * 0.46, height * 0.6, 0.0), metal).at(0.0, 0.0, -height * 0.3)),
            );
        }
        _ => castle_nut(&mut model, metal, d, height),
    }
    let on_edge = pose.chance(0.12) && family == 0;
    model.rest = if on_edge {
        Quat::from_rotation_x(std::f32::consts::FRAC_PI_2)
            * Quat::from_rotation_z(std::f32::consts::FRAC_PI_6)
    } else if pose.chance(0.35) && family != 6 {
        Quat::from_rotation_x(std::f32::consts::PI)
    } else {
        Quat::IDENTITY
    };
    model
}

/// A lock nut with a nylon ring.
fn lock_nut(model: &mut Model, item: &mut Draw, metal: u8, d: f32, height: f32) {
    let hole = |radius: f32| Part::new(cylinder(radius, d * 2.0, 0.0), metal);
    let blue = if item.chance(0.6) { srgb(40, 70, 160) } else { srgb(220, 220, 214) };
    let nylon = model.paint(Material::plastic(item, blue));
    model.add(hexagon_nut(metal, d, height, 0.0));
    let top = height * 0.5 + d * 0.1;
    model.add(Solid::new(up(cylinder(d * 0.76, d * 0.16, d * 0.1), metal, top)).cut(hole(d * 0.56)));
    model.add(Solid::new(up(cylinder(d * 0.6, d * 0.1, 0.1), nylon, top)).cut(hole(d * 0.47)));
}

/// A castle nut: slots in a crown.
fn castle_nut(model: &mut Model, metal: u8, d: f32, height: f32) {
    let crown = up(cylinder(d * 0.74, d * 0.25, 0.3), metal, height * 0.5 + d * 0.15);
    let hole = Part::new(cylinder(d * 0.47, d * 2.0, 0.0), metal);
    let mut solid = hexagon_nut(metal, d, height, 0.0).join(crown).cut(hole);
    for turn in 0..3 {
        let slot = Part::new(cuboid(d, d * 0.12, d * 0.22, 0.0), metal)
            .turned(Quat::from_rotation_z(turn as f32 * std::f32::consts::FRAC_PI_3));
        solid = solid.cut(slot.at(0.0, 0.0, height * 0.5 + d * 0.25));
    }
    model.add(solid);
}

/// A wing nut.
fn wing_nut(model: &mut Model, item: &mut Draw, metal: u8, d: f32) {
    let mut solid = Solid::new(Part::new(frustum(d * 0.85, d * 0.7, d * 0.45, 0.1 * d), metal));
    let spread = item.between(1.0, 1.35);
    for side in [-1.0, 1.0] {
        let wing = Part::new(cylinder(d * 0.62, d * 0.14, d * 0.12), metal).along_y();
        solid = solid.blend(wing.at(side * d * spread, 0.0, d * 0.45), d * 0.3);
    }
    model.add(solid.cut(Part::new(cylinder(d * 0.46, d * 2.0, 0.0), metal)));
}

/// A washer.
pub fn washer(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let metal = model.paint(Material::fastener(item));
    let bore = item.octave(4.0, 22.0) / 2.0;
    let family = item.weighted(&[4.0, 2.0, 1.8, 1.2, 0.8, 0.8]);
    let (outer, half) = match family {
        1 => (bore * item.between(2.6, 3.6), bore * 0.16),
        2 => (bore * item.between(1.5, 1.75), bore * item.between(0.22, 0.34)),
        _ => (bore * item.between(1.75, 2.2), bore * item.between(0.12, 0.26)),
    };
    let half = half.max(0.45);
    let hole = Part::new(cylinder(bore, 40.0, 0.0), metal);
    let disc = Part::new(cylinder(outer, half, half * 0.25), metal);
    match family {
        0 | 1 => model.add(Solid::new(disc).cut(hole)),
        2 => {
            // Split spring washer: the ends stand apart.
            let gap = Part::new(cuboid(outer, outer * 0.06, half * 3.0, 0.0), metal);
            let gap = gap.turned(Quat::from_rotation_x(0.5)).at(outer, 0.0, 0.0);
            model.add(Solid::new(disc).cut(hole).cut(gap));
        }
        3 => {
            let count = item.whole(8, 16);
            let inside = item.chance(0.5);
            let mut solid = Solid::new(disc).cut(hole);
            for tooth in 0..count {
                let turn = tooth as f32 / count as f32 * std::f32::consts::TAU;
                let at = if inside { bore * 1.02 } else { outer * 0.98 };
                let notch = Part::new(cuboid(outer * 0.13, outer * 0.07, half * 3.0, 0.0), metal);
                solid = solid.cut(notch.turned(Quat::from_rotation_z(turn)).at(
                    at * turn.cos(),
                    at * turn.sin(),
                    0.0,
                ));
            }
            model.add(solid);
        }
        4 => {
            // Conical (Belleville).
            let rise = outer * 0.22;
            let outline =
                vec![v2(bore, rise), v2(outer, 0.0), v2(outer, half * 1.6), v2(bore, rise + half * 1.6)];
            model.add_part(Part::new(Shape::Revolution { outline, round: 0.1 }, metal));
        }
        _ => {
            let rubber = Material::rubber(item, super::pick_rubber(pose));
            let rubber = model.paint(rubber);
            let ring = Part::new(cylinder(outer, half * 1.6, half * 0.5), rubber);
            model.add(Solid::new(ring).cut(Part::new(cylinder(bore, 40.0, 0.0), rubber)));
        }
    }
    if pose.chance(0.06) {
        model.rest = Quat::from_rotation_x(pose.between(0.2, 0.5));
    }
    model
}
