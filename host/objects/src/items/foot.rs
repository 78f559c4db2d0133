//! Feet: sneakers, boots, dress shoes, clogs, bare feet; lengths 230 to 310 mm.

use glam::{Quat, Vec2, Vec3};

use super::human::cloth_colour;
use super::{cuboid, cylinder, frustum, stick, v2, v3};
use crate::material::{Material, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::Shape;

/// The outline of a sole: heel at -x, toes at +x, the ball of the foot widest.
fn sole_outline(length: f32, width: f32, side: f32) -> Vec<Vec2> {
    const OUTER: [(f32, f32); 11] = [
        (-0.5, 0.0),
        (-0.47, 0.2),
        (-0.38, 0.31),
        (-0.2, 0.31),
        (0.0, 0.33),
        (0.18, 0.43),
        (0.3, 0.45),
        (0.4, 0.38),
        (0.47, 0.22),
        (0.5, 0.05),
        (0.49, -0.08),
    ];
    const INNER: [(f32, f32); 9] = [
        (0.46, -0.25),
        (0.38, -0.4),
        (0.24, -0.5),
        (0.12, -0.48),
        (-0.02, -0.36),
        (-0.18, -0.28),
        (-0.36, -0.3),
        (-0.46, -0.2),
        (-0.49, -0.1),
    ];
    OUTER.iter().chain(&INNER).map(|(x, y)| v2(x * length, side * y * width)).collect()
}

/// Trousers along a chain of points with radii.
pub fn trousers(paint: u8, chain: &[(Vec3, f32)]) -> Solid {
    let link = |pair: &[(Vec3, f32)]| Part::new(stick(pair[0].0, pair[1].0, pair[0].1, pair[1].1), paint);
    let mut solid = Solid::new(link(&chain[..2]));
    for pair in chain[1..].windows(2) {
        solid = solid.blend(link(pair), 35.0);
    }
    solid
}

/// A foot with what is above its ankle: nothing, a sock, bare skin or a trouser leg.
pub fn foot(item: &mut Draw, pose: &mut Draw) -> Model {
    let stub = item.whole(0, 2);
    let mut model = foot_of(item, pose, stub);
    if pose.chance(0.06) {
        model.rest = Quat::from_rotation_x(pose.sign() * std::f32::consts::FRAC_PI_2);
    }
    model
}

/// A foot along x, its sole on z = 0. `stub`: 0 = nothing above the ankle, 1 = some, 2 = a trouser leg.
pub fn foot_of(item: &mut Draw, pose: &mut Draw, stub: usize) -> Model {
    let mut model = Model::default();
    let length = item.between(235.0, 310.0);
    let width = length * item.between(0.34, 0.41);
    let side = item.sign();
    let family = item.weighted(&[3.0, 2.4, 1.6, 1.6, 1.0, 1.4]);
    let high = match family {
        0 | 3 => shoe(&mut model, item, length, width, side, family == 3),
        1 => {
            let low = shoe(&mut model, item, length, width, side, false);
            boot_shaft(&mut model, item, length, low)
        }
        2 => bare_foot(&mut model, item, length, width, side),
        4 => clog(&mut model, item, length, width, side),
        _ => lumps(&mut model, item, length, width),
    };
    let ankle = v3(-0.27 * length, 0.0, high);
    if stub > 0 {
        let above = if stub == 1 { item.between(30.0, 90.0) } else { item.between(60.0, 190.0) };
        let to = ankle + v3(pose.between(-0.25, 0.35) * above, pose.between(-0.2, 0.2) * above, above);
        if family == 2 || stub == 1 {
            let material = if family == 2 {
                model.materials[0]
            } else if item.chance(0.5) {
                let c = tool_colour(item);
                Material::cloth(item, c)
            } else {
                Material::skin(item)
            };
            let paint = model.paint(material);
            model.add_part(Part::new(stick(ankle - v3(0.0, 0.0, 25.0), to, 36.0, 41.0), paint));
        } else {
            let colour = cloth_colour(item);
            let paint = model.paint(Material::cloth(item, colour));
            let from = ankle + v3(0.0, 0.0, -item.between(5.0, 40.0));
            let axis = (to - from).normalize_or(Vec3::Z);
            let middle = (from + to) / 2.0;
            let tube = Part::new(
                frustum(item.between(52.0, 72.0), item.between(55.0, 72.0), from.distance(to) / 2.0, 4.0),
                paint,
            )
            .turned(Quat::from_rotation_arc(Vec3::Z, axis))
            .at(middle.x, middle.y, middle.z);
            model.add(Solid::new(tube).wrinkled(
                item.between(2.0, 6.0),
                item.between(18.0, 45.0),
                item.seed(),
            ));
        }
    }
    model
}

/// A laced shoe or a plain one. Returns the height of its collar, mm.
fn shoe(model: &mut Model, item: &mut Draw, length: f32, width: f32, side: f32, dress: bool) -> f32 {
    let upper_colour = if dress {
        item.pick(&[srgb(18, 16, 16), srgb(70, 40, 24), srgb(110, 66, 38)])
    } else {
        tool_colour(item)
    };
    let mut upper =
        if dress { Material::plastic(item, upper_colour) } else { Material::cloth(item, upper_colour) };
    if dress {
        upper.roughness = item.between(0.15, 0.45);
    }
    let upper = model.paint(upper);
    let sole_colour = if dress || item.chance(0.4) {
        Vec3::splat(item.between(0.01, 0.05))
    } else if item.chance(0.7) {
        Vec3::splat(item.between(0.55, 0.85))
    } else {
        tool_colour(item)
    };
    let sole = model.paint(Material::rubber(item, sole_colour));
    let accent_colour = tool_colour(item);
    let accent = model.paint(Material::plastic(item, accent_colour));
    let thick = if dress { item.between(4.0, 6.0) } else { item.between(8.0, 16.0) };
    let outline = sole_outline(length, width, side);
    model.add_part(
        Part::new(Shape::Extrusion { outline: outline.clone(), half: thick, round: thick * 0.5 }, sole)
            .at(0.0, 0.0, thick),
    );
    let (l, w) = (length, width);
    let collar = item.between(68.0, 92.0);
    let base = 1.6 * thick;
    let inner: Vec<Vec2> = outline.iter().map(|c| *c * 0.95).collect();
    let body = Solid::new(Part::new(Shape::Ellipsoid(v3(0.22 * l, 0.44 * w, 34.0)), upper).at(
        0.26 * l,
        -side * 0.02 * w,
        base + 8.0,
    ))
    .blend(
        Part::new(
            stick(v3(0.16 * l, 0.0, base + 16.0), v3(-0.18 * l, 0.0, base + 42.0), 0.36 * w, 0.33 * w),
            upper,
        ),
        40.0,
    )
    .blend(
        Part::new(Shape::Ellipsoid(v3(0.17 * l, 0.31 * w, collar * 0.78)), upper).at(
            -0.31 * l,
            0.0,
            base + 22.0,
        ),
        30.0,
    )
    .meet(Part::new(Shape::Extrusion { outline: inner, half: 120.0, round: 14.0 }, upper).at(
        0.0,
        0.0,
        base + 100.0,
    ))
    .meet(Part::new(cuboid(l, w, 60.0, 0.0), upper).at(0.0, 0.0, base + 40.0))
    .cut(Part::new(Shape::Ellipsoid(v3(0.14 * l, 0.25 * w, 46.0)), accent).at(
        -0.27 * l,
        0.0,
        base + collar,
    ));
    model.add(body);
    if !dress || item.chance(0.5) {
        laces(model, item, l, w, base);
    }
    if item.chance(0.55) && !dress {
        // A cap over the toes or a stripe along the side.
        if item.chance(0.5) {
            let cap = Solid::new(Part::new(Shape::Ellipsoid(v3(0.23 * l, 0.46 * w, 36.0)), sole).at(
                0.265 * l,
                -side * 0.02 * w,
                base + 7.0,
            ));
            model.add(cap.meet(Part::new(cuboid(0.2 * l, w, 36.0, 0.0), sole).at(
                0.52 * l,
                0.0,
                base + 30.0,
            )));
        } else {
            for s in [-1.0, 1.0] {
                let stripe = stick(
                    v3(-0.12 * l, s * 0.33 * w, base + 12.0),
                    v3(0.06 * l, s * 0.34 * w, base + 32.0),
                    7.0,
                    3.0,
                );
                model.add_part(Part::new(stripe, accent));
            }
        }
    }
    base + collar * 0.75
}

fn laces(model: &mut Model, item: &mut Draw, l: f32, w: f32, base: f32) {
    let colour = if item.chance(0.5) { Vec3::splat(item.between(0.5, 0.85)) } else { tool_colour(item) };
    let paint = model.paint(Material::cloth(item, colour));
    for row in 0..4 {
        let t = row as f32 / 3.0;
        let (x, z) = ((0.12 - 0.24 * t) * l, base + 47.0 + 30.0 * t);
        let lace = stick(v3(x, -0.15 * w, z), v3(x - 0.02 * l, 0.15 * w, z + 2.0), 3.0, 3.0);
        model.add_part(Part::new(lace, paint));
    }
}

fn boot_shaft(model: &mut Model, item: &mut Draw, length: f32, low: f32) -> f32 {
    let upper = model.materials[0];
    let paint = model.paint(upper);
    let high = item.between(110.0, 200.0);
    let at = -0.27 * length;
    let shaft =
        Part::new(frustum(46.0, 52.0, (high - 30.0) / 2.0, 6.0), paint).at(at, 0.0, (high + 30.0) / 2.0);
    let solid = Solid::new(shaft).cut(Part::new(cylinder(42.0, 30.0, 0.0), paint).at(at, 0.0, high));
    model.add(solid.wrinkled(1.5, 26.0, item.seed()));
    high.max(low) - 12.0
}

fn bare_foot(model: &mut Model, item: &mut Draw, length: f32, width: f32, side: f32) -> f32 {
    let skin = Material::skin(item);
    let paint = model.paint(skin);
    let (l, w) = (length * 0.92, width * 0.92);
    let mut solid =
        Solid::new(Part::new(Shape::Ellipsoid(v3(0.19 * l, 0.40 * w, 24.0)), paint).at(0.16 * l, 0.0, 20.0))
            .blend(
                Part::new(stick(v3(0.12 * l, -side * 4.0, 26.0), v3(-0.2 * l, 0.0, 44.0), 24.0, 33.0), paint),
                40.0,
            )
            .blend(
                Part::new(Shape::Ellipsoid(v3(0.13 * l, 0.28 * w, 32.0)), paint).at(-0.33 * l, 0.0, 29.0),
                26.0,
            )
            .blend(
                Part::new(stick(v3(-0.24 * l, 0.0, 50.0), v3(-0.27 * l, 0.0, 95.0), 34.0, 34.0), paint),
                26.0,
            );
    let mut nail_material =
        Material::plastic(item, (skin.colour * 1.1 + srgb(50, 28, 26)).min(Vec3::splat(0.9)));
    nail_material.wear = 0.0;
    let nail = model.paint(nail_material);
    for toe in 0..5 {
        let t = toe as f32 / 4.0;
        let r = if toe == 0 { 12.0 } else { 8.5 - 1.5 * t };
        let y = -side * (0.36 - 0.72 * t) * w;
        let x = (0.47 - 0.14 * t * t - 0.02 * t) * l;
        solid = solid.blend(
            Part::new(stick(v3(x - 26.0, y * 0.95, 14.0), v3(x, y, r + 1.0), r * 0.95, r), paint),
            6.0,
        );
        model.add_part(Part::new(Shape::Ellipsoid(v3(r * 0.6, r * 0.6, r * 0.35)), nail).at(
            x + r * 0.2,
            y,
            1.75 * r,
        ));
    }
    model.add(solid.meet(Part::new(cuboid(l, w, 200.0, 0.0), paint).at(0.0, 0.0, 200.0)));
    88.0
}

fn clog(model: &mut Model, item: &mut Draw, length: f32, width: f32, side: f32) -> f32 {
    let colour = tool_colour(item);
    let paint = model.paint(Material::rubber(item, colour));
    let dark = model.paint(Material::rubber(item, Vec3::splat(0.01)));
    let outline = sole_outline(length, width * 1.05, side);
    model.add_part(Part::new(Shape::Extrusion { outline, half: 13.0, round: 6.0 }, paint).at(0.0, 0.0, 13.0));
    let mut dome = Solid::new(Part::new(Shape::Ellipsoid(v3(0.34 * length, 0.48 * width, 58.0)), paint).at(
        0.18 * length,
        0.0,
        20.0,
    ))
    .meet(Part::new(cuboid(0.31 * length, width, 100.0, 2.0), paint).at(0.22 * length, 0.0, 115.0))
    .cut(Part::new(Shape::Ellipsoid(v3(0.31 * length, 0.43 * width, 50.0)), dark).at(
        0.14 * length,
        0.0,
        18.0,
    ));
    for hole in 0..6 {
        let (x, y) = (0.2 + 0.09 * (hole / 2) as f32, if hole % 2 == 0 { -0.16 } else { 0.16 });
        dome = dome.cut(Part::new(cylinder(5.0, 100.0, 0.0), dark).at(x * length, y * width, 60.0));
    }
    model.add(dome);
    for s in [-1.0, 1.0] {
        let from = v3(-0.05 * length, s * 0.4 * width, 45.0);
        let to = v3(-0.47 * length, s * 0.1 * width, 58.0);
        model.add_part(Part::new(stick(from, to, 6.0, 6.0), paint));
    }
    60.0
}

/// The crudest shoe: a few round lumps in a row.
fn lumps(model: &mut Model, item: &mut Draw, length: f32, width: f32) -> f32 {
    let colour = tool_colour(item);
    let paint = model.paint(Material::plastic(item, colour));
    let r = width * 0.46;
    let low = item.between(0.75, 1.0);
    let mut solid = Solid::new(Part::new(Shape::Ellipsoid(v3(r * 1.2, r, r * 0.8 * low)), paint).at(
        length * 0.5 - r * 1.2,
        0.0,
        r * 0.6,
    ));
    for (x, size, z) in [(0.08, 0.92, 0.75), (-0.12, 0.85, 0.95), (-0.30, 0.86, 0.8)] {
        let lump = Shape::Ellipsoid(v3(r * size * 1.15, r * size, r * size));
        solid = solid.blend(Part::new(lump, paint).at(x * length, 0.0, z * r), item.between(6.0, 40.0));
    }
    let shaft = stick(
        v3(-0.3 * length, 0.0, r),
        v3(-0.32 * length, 0.0, r * item.between(1.6, 2.6)),
        r * 0.8,
        r * 0.75,
    );
    solid = solid.blend(Part::new(shaft, paint), 16.0);
    model.add(solid.meet(Part::new(cuboid(length, width, 300.0, 0.0), paint).at(0.0, 0.0, 300.0)));
    if item.chance(0.5) {
        let sole = model.paint(Material::rubber(item, Vec3::splat(0.02)));
        let outline = sole_outline(length, width * 0.95, 1.0);
        model
            .add_part(Part::new(Shape::Extrusion { outline, half: 6.0, round: 2.0 }, sole).at(0.0, 0.0, 6.0));
    }
    r * 1.6
}
