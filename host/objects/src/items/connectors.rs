//! Electrical connectors: plugs, sockets, terminals.

use glam::{Quat, Vec3};

use super::{cuboid, cylinder, frustum, stick, v2, v3};
use crate::material::{Material, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::{Rope, Shape};

/// Materials that most connectors share.
struct Paints {
    body: u8,
    metal: u8,
    gold: u8,
    dark: u8,
}

/// A stub of cable that leaves at `x` towards -x.
fn tail(model: &mut Model, item: &mut Draw, pose: &mut Draw, x: f32, z: f32, radius: f32) {
    if item.chance(0.45) {
        return;
    }
    let colour = if item.chance(0.6) { Vec3::splat(item.between(0.01, 0.2)) } else { tool_colour(item) };
    let paint = model.paint(Material::rubber(item, colour));
    let length = radius * item.between(5.0, 16.0);
    let curl = pose.between(-0.09, 0.09);
    let (mut at, mut heading) = (v3(x, 0.0, z), std::f32::consts::PI);
    let mut points = vec![(at, radius)];
    for _ in 0..14 {
        at += Vec3::new(heading.cos(), heading.sin(), 0.0) * length / 14.0;
        at.z += (radius - at.z) * 0.15;
        heading += curl;
        points.push((at, radius));
    }
    model.add_part(Part::new(Shape::Rope(Rope::new(points)), paint));
}

/// A grid of square pins along x, around y = 0.
struct Pins {
    rows: usize,
    columns: usize,
    /// Distance from pin to pin, mm.
    pitch: f32,
    /// Where they begin, mm.
    from: f32,
    /// How long they are, mm.
    length: f32,
}

impl Pins {
    fn add(&self, model: &mut Model, paint: u8) {
        let half = self.pitch * 0.14;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let y = (column as f32 - (self.columns as f32 - 1.0) / 2.0) * self.pitch;
                let z = (row as f32 - (self.rows as f32 - 1.0) / 2.0) * self.pitch;
                let pin = Part::new(cuboid(self.length / 2.0, half, half, 0.05), paint);
                model.add_part(pin.at(self.from + self.length / 2.0, y, z));
            }
        }
    }
}

/// A connector.
pub fn connector(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let colour = match item.weighted(&[3.0, 2.0, 2.0]) {
        0 => Vec3::splat(item.between(0.01, 0.06)),
        1 => Vec3::splat(item.between(0.45, 0.8)),
        _ => tool_colour(item),
    };
    let paints = Paints {
        body: model.paint(Material::plastic(item, colour)),
        metal: model.paint(Material::metal(item, Vec3::splat(0.6), 0.3)),
        gold: model.paint(Material::metal(item, srgb(226, 184, 92), 0.25)),
        dark: model.paint(Material::plastic(item, Vec3::splat(0.015))),
    };
    match item.weighted(&[1.3, 1.2, 1.4, 1.3, 1.2, 1.0, 1.0, 1.1, 1.2, 0.9, 1.0, 1.3]) {
        0 => d_sub(&mut model, item, pose, &paints),
        1 => modular_plug(&mut model, item, pose, &paints),
        2 => screw_terminal(&mut model, item, &paints),
        3 => wire_housing(&mut model, item, pose, &paints),
        4 => round_metal(&mut model, item, pose, &paints),
        5 => battery_plug(&mut model, item, pose, &paints),
        6 => banana(&mut model, item, pose, &paints),
        7 => usb(&mut model, item, pose, &paints),
        8 => pin_header(&mut model, item, &paints),
        9 => crimp(&mut model, item, pose, &paints),
        10 => lever_terminal(&mut model, item, &paints),
        _ => industrial(&mut model, item, pose, &paints),
    }
    model.rest = match pose.weighted(&[6.0, 1.5, 1.0]) {
        0 => Quat::IDENTITY,
        1 => Quat::from_rotation_x(std::f32::consts::PI),
        _ => Quat::from_rotation_x(std::f32::consts::FRAC_PI_2),
    };
    model
}

fn d_sub(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    let wide = item.pick(&[15.5, 19.5, 26.5]);
    let hood_paint = if item.chance(0.5) { p.metal } else { p.body };
    let outline =
        vec![v2(-wide * 0.55, -4.2), v2(-wide * 0.5, 4.2), v2(wide * 0.5, 4.2), v2(wide * 0.55, -4.2)];
    let shell = Part::new(Shape::Extrusion { outline: outline.clone(), half: 4.0, round: 0.8 }, p.metal);
    let inner = outline.iter().map(|c| *c * 0.9).collect();
    let hollow = Part::new(Shape::Extrusion { outline: inner, half: 4.0, round: 0.5 }, p.metal);
    let turn = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2)
        * Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    model.add(Solid::new(shell.turned(turn).at(6.0, 0.0, 0.0)).cut(hollow.turned(turn).at(7.5, 0.0, 0.0)));
    let columns = (wide / 2.4) as usize;
    Pins { rows: 2, columns, pitch: 2.6, from: 3.0, length: 6.0 }.add(model, p.gold);
    model.add_part(Part::new(cuboid(0.8, wide + 4.0, 6.2, 0.3), p.metal).at(2.0, 0.0, 0.0));
    let hood = Part::new(cuboid(16.0, wide + 1.0, 7.5, 2.0), hood_paint).at(-15.0, 0.0, 0.0);
    let neck = Part::new(cylinder(6.0, 6.0, 1.0), hood_paint).along_x().at(-34.0, 0.0, 0.0);
    model.add(Solid::new(hood).blend(neck, 6.0));
    for side in [-1.0, 1.0] {
        let screw = Shape::Fluted { radius: 3.2, depth: 0.5, count: 18, half: 9.0, round: 0.4 };
        model.add_part(Part::new(screw, p.metal).along_x().at(-20.0, side * (wide + 1.0), 0.0));
        model.add_part(Part::new(cylinder(1.5, 8.0, 0.2), p.metal).along_x().at(
            0.0,
            side * (wide + 1.0),
            0.0,
        ));
    }
    tail(model, item, pose, -38.0, 0.0, 3.6);
}

fn modular_plug(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    let clear = model.paint(Material::plastic(item, Vec3::splat(item.clone().between(0.35, 0.7))));
    model.add(
        Solid::new(Part::new(cuboid(10.5, 5.8, 4.0, 0.4), clear))
            .cut(Part::new(cuboid(3.0, 4.6, 1.0, 0.0), clear).at(8.0, 0.0, 4.0)),
    );
    for contact in 0..8 {
        let y = (contact as f32 - 3.5) * 1.05;
        model.add_part(Part::new(cuboid(3.0, 0.28, 0.8, 0.0), p.gold).at(7.4, y, 3.3));
    }
    model.add_part(
        Part::new(cuboid(8.0, 3.0, 0.5, 0.2), clear).turned(Quat::from_rotation_y(0.22)).at(0.5, 0.0, -5.4),
    );
    if item.chance(0.6) {
        model.add_part(Part::new(cuboid(9.0, 6.8, 5.0, 1.6), p.body).at(-16.0, 0.0, 0.0));
    }
    tail(model, item, pose, -20.0, 0.0, 2.8);
}

fn screw_terminal(model: &mut Model, item: &mut Draw, p: &Paints) {
    let poles = item.whole(2, 8);
    let pitch = item.pick(&[3.5, 5.08, 5.08, 7.6]);
    let colour = item.pick(&[
        srgb(30, 140, 70),
        srgb(30, 140, 70),
        srgb(40, 90, 170),
        srgb(40, 40, 42),
        srgb(200, 200, 190),
    ]);
    let green = model.paint(Material::plastic(item, colour));
    let half = poles as f32 * pitch / 2.0;
    let mut solid = Solid::new(Part::new(cuboid(pitch * 0.85, half, pitch * 0.95, 0.3), green)).cut(
        Part::new(cuboid(pitch * 0.6, half + 1.0, pitch * 0.6, 0.0), green)
            .turned(Quat::from_rotation_y(0.6))
            .at(pitch * 1.05, 0.0, pitch * 1.0),
    );
    for pole in 0..poles {
        let y = (pole as f32 - (poles as f32 - 1.0) / 2.0) * pitch;
        solid = solid
            .cut(Part::new(cuboid(pitch * 0.3, pitch * 0.34, pitch * 0.3, 0.0), p.dark).at(
                pitch * 0.8,
                y,
                -pitch * 0.35,
            ))
            .cut(Part::new(cylinder(pitch * 0.36, pitch * 0.3, 0.0), p.dark).at(
                -pitch * 0.25,
                y,
                pitch * 0.95,
            ));
        let screw = Solid::new(Part::new(cylinder(pitch * 0.33, pitch * 0.1, 0.1), p.metal).at(
            -pitch * 0.25,
            y,
            pitch * 0.72,
        ));
        model.add(screw.cut(Part::new(cuboid(pitch * 0.4, pitch * 0.06, pitch * 0.1, 0.0), p.dark).at(
            -pitch * 0.25,
            y,
            pitch * 0.82,
        )));
        model.add_part(Part::new(cylinder(0.5, pitch * 0.5, 0.1), p.metal).at(0.0, y, -pitch * 1.3));
    }
    model.add(solid);
}

fn wire_housing(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    // A white or black housing with wires (JST, Molex, automotive).
    let poles = item.whole(2, 6);
    let rows = if item.chance(0.35) { 2 } else { 1 };
    let pitch = item.between(2.0, 5.0);
    let (half, high) = (poles as f32 * pitch / 2.0 + 0.8, rows as f32 * pitch / 2.0 + 0.9);
    let mut solid = Solid::new(Part::new(cuboid(pitch * 1.6, half, high, 0.3), p.body))
        .join(Part::new(cuboid(pitch * 0.8, half * 0.4, 0.6, 0.2), p.body).at(0.2 * pitch, 0.0, high + 0.4));
    for row in 0..rows {
        for pole in 0..poles {
            let y = (pole as f32 - (poles as f32 - 1.0) / 2.0) * pitch;
            let z = (row as f32 - (rows as f32 - 1.0) / 2.0) * pitch;
            solid = solid.cut(Part::new(cuboid(pitch, pitch * 0.28, pitch * 0.28, 0.0), p.dark).at(
                pitch * 1.6,
                y,
                z,
            ));
            let colour = tool_colour(item);
            let paint = model.paint(Material::plastic(item, colour));
            let length = pitch * item.between(3.0, 8.0);
            let spread = pose.between(-0.15, 0.15);
            let from = v3(-pitch * 1.4, y, z);
            let mid = from + v3(-length * 0.5, spread * length * 0.3, 0.0);
            let to = from + v3(-length, y * 0.4 + spread * length, -z * 0.5);
            let r = pitch * 0.24;
            model.add_part(Part::new(Shape::Rope(Rope::new(vec![(from, r), (mid, r), (to, r)])), paint));
        }
    }
    model.add(solid);
}

fn round_metal(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    // M12, M8 and the like: knurled ring, collar, pins in a sleeve.
    let r = item.between(5.0, 11.0);
    let ring_paint = if item.chance(0.75) { p.metal } else { p.body };
    let ring = Shape::Fluted { radius: r, depth: r * 0.07, count: 24, half: r * 0.8, round: 0.6 };
    let bore = Part::new(cylinder(r * 0.72, r * 0.8, 0.0), p.dark).along_x().at(r * 0.9, 0.0, 0.0);
    model.add(Solid::new(Part::new(ring, ring_paint).along_x()).cut(bore));
    model.add_part(Part::new(cylinder(r * 0.62, r * 0.3, 0.2), p.dark).along_x().at(r * 0.2, 0.0, 0.0));
    for pin in 0..item.whole(3, 5) {
        let turn = pin as f32 * 1.3;
        let at = v3(r * 0.7, r * 0.35 * turn.cos(), r * 0.35 * turn.sin());
        model.add_part(Part::new(cylinder(r * 0.09, r * 0.4, 0.1), p.gold).along_x().at(at.x, at.y, at.z));
    }
    let back = Part::new(frustum(r * 0.55, r * 0.85, r * 1.2, 0.5), p.body).along_x().at(-r * 1.9, 0.0, 0.0);
    model.add(Solid::new(back).join(Part::new(cylinder(r * 0.6, r * 0.7, 0.8), p.dark).along_x().at(
        -r * 3.2,
        0.0,
        0.0,
    )));
    tail(model, item, pose, -r * 3.6, 0.0, r * 0.42);
}

fn battery_plug(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    let colour = item.pick(&[
        srgb(235, 190, 30),
        srgb(235, 190, 30),
        srgb(200, 40, 35),
        srgb(40, 60, 150),
        srgb(60, 60, 62),
    ]);
    let yellow = model.paint(Material::plastic(item, colour));
    let outline = [v2(-8.0, -4.0), v2(-8.0, 4.0), v2(5.5, 4.0), v2(8.0, 1.5), v2(8.0, -1.5), v2(5.5, -4.0)];
    let turn = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2)
        * Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let size = item.between(0.8, 1.8);
    let outline: Vec<_> = outline.iter().map(|c| *c * size).collect();
    let mut solid = Solid::new(
        Part::new(Shape::Extrusion { outline, half: 8.0 * size, round: 0.5 }, yellow).turned(turn),
    );
    for side in [-1.0, 1.0] {
        let y = side * 3.7 * size;
        solid = solid.cut(Part::new(cylinder(2.6 * size, 5.0 * size, 0.0), p.dark).along_x().at(
            7.0 * size,
            y,
            0.0,
        ));
        model.add_part(Part::new(cylinder(1.7 * size, 6.0 * size, 0.3), p.gold).along_x().at(
            4.0 * size,
            y,
            0.0,
        ));
        let colour = if side > 0.0 { srgb(200, 25, 25) } else { srgb(20, 20, 22) };
        let paint = model.paint(Material::plastic(item, colour));
        if item.chance(0.7) {
            let spread = pose.between(-4.0, 4.0) * size;
            let points = vec![
                (v3(-7.0 * size, y, 0.0), 2.0 * size),
                (v3(-16.0 * size, y * 0.9 + spread * 0.3, 0.0), 2.0 * size),
                (v3(-26.0 * size, y * 0.7 + spread, -1.0), 2.0 * size),
            ];
            model.add_part(Part::new(Shape::Rope(Rope::new(points)), paint));
        }
    }
    model.add(solid);
}

fn banana(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    let r = item.between(4.5, 6.5);
    model.add_part(Part::new(frustum(r * 0.6, r, 14.0, 1.0), p.body).along_x().at(-14.0, 0.0, 0.0));
    model.add_part(Part::new(cylinder(r * 0.75, 2.0, 0.3), p.metal).along_x().at(1.0, 0.0, 0.0));
    model.add_part(Part::new(Shape::Ellipsoid(v3(11.0, 2.2, 2.2)), p.gold).at(11.0, 0.0, 0.0));
    tail(model, item, pose, -27.0, 0.0, 1.9);
}

fn usb(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    let small = item.chance(0.4);
    let (half_y, half_z) = if small { (4.2, 1.3) } else { (6.0, 2.3) };
    let reach = if small { 3.6 } else { 6.0 };
    let shell =
        Part::new(cuboid(reach, half_y, half_z, if small { 1.2 } else { 0.3 }), p.metal).at(reach, 0.0, 0.0);
    model.add(Solid::new(shell).cut(Part::new(cuboid(reach, half_y * 0.88, half_z * 0.72, 0.2), p.dark).at(
        reach + 1.0,
        0.0,
        0.0,
    )));
    model.add_part(Part::new(cuboid(reach * 0.9, half_y * 0.8, half_z * 0.25, 0.1), p.body).at(
        reach,
        0.0,
        -half_z * 0.3,
    ));
    let long = item.between(8.0, 14.0);
    let body = Part::new(cuboid(long, half_y + 1.8, half_z + 2.0, 1.8), p.body).at(-long, 0.0, 0.0);
    let boot = Part::new(frustum(2.4, 3.4, 6.0, 0.6), p.dark).along_x().at(-2.0 * long - 5.0, 0.0, 0.0);
    model.add(Solid::new(body).join(boot));
    tail(model, item, pose, -2.0 * long - 9.0, 0.0, 1.9);
}

fn pin_header(model: &mut Model, item: &mut Draw, p: &Paints) {
    let (columns, rows) = (item.whole(3, 16), item.whole(1, 2));
    let pitch = 2.54;
    let body = cuboid(1.3, columns as f32 * pitch / 2.0, rows as f32 * pitch / 2.0, 0.2);
    model.add_part(Part::new(body, p.dark));
    let paint = if item.chance(0.6) { p.gold } else { p.metal };
    Pins { rows, columns, pitch, from: -4.0, length: 12.0 }.add(model, paint);
}

fn crimp(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    // Ring, fork or flat terminal with a coloured sleeve.
    let sleeve_colour =
        item.pick(&[srgb(190, 30, 30), srgb(30, 70, 180), srgb(230, 200, 40), srgb(20, 20, 20)]);
    let sleeve = model.paint(Material::plastic(item, sleeve_colour));
    let r = item.between(3.5, 8.0);
    let mut ring = Solid::new(Part::new(cylinder(r, 0.6, 0.15), p.metal).at(r * 1.8, 0.0, 0.0))
        .blend(Part::new(cuboid(r, r * 0.45, 0.6, 0.1), p.metal).at(r * 0.5, 0.0, 0.0), r * 0.4)
        .cut(Part::new(cylinder(r * 0.55, 5.0, 0.0), p.metal).at(r * 1.8, 0.0, 0.0));
    if item.chance(0.35) {
        ring = ring.cut(Part::new(cuboid(r, r * 0.5, 5.0, 0.0), p.metal).at(r * 2.6, 0.0, 0.0));
    }
    model.add(ring);
    let tube = Part::new(frustum(r * 0.55, r * 0.42, r * 1.1, 0.3), sleeve).along_x().at(-r * 1.3, 0.0, 0.0);
    model.add_part(tube);
    tail(model, item, pose, -r * 2.2, 0.0, r * 0.35);
}

fn lever_terminal(model: &mut Model, item: &mut Draw, p: &Paints) {
    let poles = item.whole(2, 5);
    let pitch = 5.6;
    let half = poles as f32 * pitch / 2.0;
    let grey = model.paint(Material::plastic(item, Vec3::splat(item.clone().between(0.25, 0.6))));
    let colour = item.pick(&[srgb(240, 130, 20), srgb(240, 130, 20), srgb(40, 150, 60)]);
    let orange = model.paint(Material::plastic(item, colour));
    let mut solid = Solid::new(Part::new(cuboid(9.0, half, 4.0, 0.6), grey));
    for pole in 0..poles {
        let y = (pole as f32 - (poles as f32 - 1.0) / 2.0) * pitch;
        solid = solid.cut(Part::new(cylinder(1.6, 4.0, 0.0), p.dark).along_x().at(9.0, y, -1.2));
        let lift = if item.chance(0.25) { 0.9 } else { 0.0 };
        let lever =
            Part::new(cuboid(6.0, pitch * 0.42, 0.9, 0.3), orange).turned(Quat::from_rotation_y(-lift));
        model.add_part(lever.at(-2.0 * (1.0 - lift), y, 4.2 + 4.0 * lift));
    }
    model.add(solid);
}

fn industrial(model: &mut Model, item: &mut Draw, pose: &mut Draw, p: &Paints) {
    // A box with pins or sockets in its face, a collar and a latch: automotive and power connectors.
    let (half_y, half_z) = (item.between(7.0, 20.0), item.between(5.0, 11.0));
    let long = item.between(8.0, 18.0);
    let mut solid = Solid::new(Part::new(cuboid(long, half_y, half_z, item.between(0.3, 2.0)), p.body));
    if item.chance(0.6) {
        solid = solid.cut(Part::new(cuboid(long * 0.5, half_y * 0.85, half_z * 0.78, 0.4), p.dark).at(
            long * 0.75,
            0.0,
            0.0,
        ));
    }
    if item.chance(0.6) {
        let latch = Part::new(cuboid(long * 0.5, half_y * 0.3, 1.2, 0.4), p.body).at(0.0, 0.0, half_z + 1.8);
        solid = solid.join(latch).join(Part::new(cuboid(1.0, half_y * 0.3, 2.0, 0.2), p.body).at(
            -long * 0.4,
            0.0,
            half_z,
        ));
    }
    model.add(solid);
    let (rows, columns) = (item.whole(1, 3), item.whole(2, 5));
    let pitch = (2.0 * half_y * 0.75 / columns as f32).min(2.0 * half_z * 0.75 / rows as f32);
    let paint = if item.chance(0.5) { p.gold } else { p.metal };
    let length = long * item.between(0.5, 1.3);
    Pins { rows, columns, pitch, from: long * 0.2, length }.add(model, paint);
    if item.chance(0.5) {
        let flange =
            Part::new(cuboid(1.2, half_y * 1.25, half_z * 1.1, 0.8), p.body).at(-long * 0.3, 0.0, 0.0);
        model.add_part(flange);
    }
    let from = v3(-long, 0.0, 0.0);
    model.add_part(Part::new(stick(from, from + v3(-5.0, 0.0, 0.0), half_z * 0.6, half_z * 0.4), p.dark));
    tail(model, item, pose, -long - 4.0, 0.0, half_z * 0.38);
}
