//! Parts of people: hands, legs, lying people. Proportions after DIN 33402-2 (5th to 95th percentile).

use glam::{Quat, Vec3};

use super::foot::{foot_of, trousers};
use super::{cuboid, frustum, stick, v3};
use crate::material::{Material, Pattern, hsv, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::Shape;

/// How the fingers are held: bend of thumb, index, middle, ring and little finger per joint, rad.
fn finger_bends(pose: &mut Draw) -> [f32; 5] {
    let relaxed = pose.between(0.15, 0.5);
    match pose.weighted(&[3.5, 3.0, 1.3, 1.2, 1.2, 0.6]) {
        0 => [0.1, 0.05, 0.05, 0.06, 0.08].map(|b| b + 0.10 * pose.unit()),
        1 => [0.2, relaxed, relaxed * 1.1, relaxed * 1.2, relaxed * 1.3],
        2 => [0.8, 1.35, 1.4, 1.4, 1.35],
        3 => [0.7, 0.08, 1.3, 1.4, 1.4],
        4 => [0.5, 0.75, 0.8, 0.85, 0.9],
        _ => [0.2, 0.1, 0.12, 1.3, 1.3],
    }
}

/// What a hand is dressed in: its material, how much thicker it makes it, and whether nails show.
fn hand_dress(model: &mut Model, item: &mut Draw) -> (u8, u8, f32, bool) {
    let skin = model.paint(Material::skin(item));
    if !item.chance(0.28) {
        return (skin, skin, 0.0, true);
    }
    // Work gloves: knitted, leather, nitrile, rubber; often with a coated palm.
    let colour = match item.weighted(&[2.0, 1.2, 1.2, 2.0]) {
        0 => Vec3::splat(item.between(0.02, 0.7)),
        1 => srgb(170, 130, 80),
        2 => hsv(item.between(0.55, 0.62), 0.6, 0.7),
        _ => tool_colour(item),
    };
    let glove = if item.chance(0.6) { Material::cloth(item, colour) } else { Material::rubber(item, colour) };
    let glove = model.paint(glove);
    (glove, skin, item.between(0.8, 2.6), false)
}

/// One finger or thumb: sticks from knuckle to tip. Returns the tip and the direction that its nail faces.
struct Finger {
    base: Vec3,
    yaw: f32,
    lengths: [f32; 3],
    radius: f32,
    bend: f32,
}

impl Finger {
    fn add(&self, solid: Solid, paint: u8, fillet: f32, down: Vec3) -> (Solid, Vec3, Quat) {
        let mut turn = Quat::from_rotation_z(self.yaw);
        let axis = turn * Vec3::X.cross(down);
        let (mut at, mut radius, mut solid) = (self.base, self.radius, solid);
        for (joint, length) in self.lengths.iter().enumerate() {
            turn = Quat::from_axis_angle(axis.normalize_or(Vec3::Y), self.bend) * turn;
            let to = at + turn * Vec3::X * *length;
            let end = radius * 0.93;
            let fillet = if joint == 0 { fillet } else { fillet * 0.35 };
            solid = solid.blend(Part::new(stick(at, to, radius, end), paint), fillet);
            (at, radius) = (to, end);
        }
        (solid, at, turn)
    }
}

/// A hand along x with the palm down, wrist at the origin; `side` = +1 has its thumb at +y. `scale` 1 = 187 mm long.
fn hand_body(
    model: &mut Model,
    item: &mut Draw,
    pose: &mut Draw,
    dress: (u8, f32, bool),
    scale: f32,
    side: f32,
) {
    let (paint, thicker, nails) = dress;
    let s = scale;
    let stout = item.between(0.88, 1.18);
    let smooth = item.between(0.7, 1.6);
    let bends = finger_bends(pose);
    let palm = cuboid(44.0 * s, 38.0 * s * stout, 12.5 * s + thicker, 11.0 * s);
    let mut solid = Solid::new(Part::new(palm, paint).at(52.0 * s, 0.0, 0.0))
        .blend(
            Part::new(Shape::Ellipsoid(v3(30.0, 22.0, 17.0) * s), paint).at(
                30.0 * s,
                side * 20.0 * s,
                -4.0 * s,
            ),
            14.0 * s,
        )
        .blend(Part::new(Shape::Ellipsoid(v3(32.0, 27.0, 16.5) * s), paint).at(2.0 * s, 0.0, 0.0), 18.0 * s);
    let spread = pose.between(-0.02, 0.11);
    let fingers = [(30.0, 70.0, 1.0), (10.0, 79.0, 1.05), (-11.0, 73.0, 0.98), (-30.0, 57.0, 0.86)];
    let mut tips = Vec::new();
    for (place, (y, length, thick)) in fingers.into_iter().enumerate() {
        let finger = Finger {
            base: v3((92.0 - (y - 8.0_f32).abs() * 0.22) * s, side * y * s * stout, 0.0),
            yaw: side * spread * (1.5 - place as f32) + 0.03 * pose.normal(),
            lengths: [0.48, 0.29, 0.23].map(|share| share * length * s),
            radius: (8.6 * thick * stout) * s + thicker,
            bend: bends[place + 1] * pose.between(0.85, 1.15),
        };
        let (grown, tip, turn) = finger.add(solid, paint, 6.0 * s * smooth, -Vec3::Z);
        solid = grown;
        tips.push((tip, turn, finger.radius));
    }
    let thumb = Finger {
        base: v3(24.0 * s, side * 28.0 * s * stout, -5.0 * s),
        yaw: side * pose.between(0.45, 0.95),
        lengths: [0.42, 0.33, 0.25].map(|share| share * 92.0 * s),
        radius: 11.5 * s * stout + thicker,
        bend: bends[0] * 0.35,
    };
    let (grown, tip, turn) = thumb.add(solid, paint, 14.0 * s * smooth, v3(0.0, -side, -0.4));
    tips.push((tip, turn, thumb.radius));
    model.add(grown);
    if nails {
        let colour = model.materials[usize::from(paint)].colour;
        let mut nail = Material::plastic(item, (colour * 1.15 + srgb(60, 30, 28)).min(Vec3::splat(0.9)));
        nail.wear = 0.0;
        nail.roughness = 0.25;
        let nail = model.paint(nail);
        for (tip, turn, radius) in tips {
            let at = tip + turn * v3(radius * 0.12, 0.0, radius * 0.55);
            let shape = Shape::Ellipsoid(v3(radius * 0.75, radius * 0.58, radius * 0.36));
            model.add_part(Part::new(shape, nail).turned(turn).at(at.x, at.y, at.z));
        }
    }
}

/// A forearm from the wrist at the origin towards -x, bare or in a sleeve.
fn forearm(model: &mut Model, item: &mut Draw, skin: u8, length: f32, scale: f32) {
    let end = v3(-length, 0.0, 4.0);
    let thick = (27.0 + 0.075 * length.min(240.0)) * scale;
    let arm = Solid::new(Part::new(stick(v3(4.0, 0.0, 0.0), end, 25.0 * scale, thick), skin))
        .blend(Part::new(Shape::Ellipsoid(v3(24.0, 30.0, 20.0) * scale), skin).at(0.0, 0.0, 0.0), 16.0);
    model.add(arm);
    if item.chance(0.55) && length > 60.0 {
        let from = -length * item.between(0.08, 0.75);
        let loose = thick + item.between(5.0, 12.0);
        sleeve(model, item, v3(from, 0.0, 0.0), end + v3(-6.0, 0.0, 0.0), 33.0 * scale, loose);
    }
}

fn sleeve(model: &mut Model, item: &mut Draw, from: Vec3, to: Vec3, start: f32, end: f32) {
    let colour = cloth_colour(item);
    let paint = model.paint(Material::cloth(item, colour));
    let axis = (to - from).normalize_or(Vec3::X);
    let turn = Quat::from_rotation_arc(Vec3::Z, axis);
    let middle = (from + to) / 2.0;
    let half = from.distance(to) / 2.0;
    let tube = Part::new(frustum(start, end, half, 2.0), paint).turned(turn).at(middle.x, middle.y, middle.z);
    model.add(Solid::new(tube).wrinkled(item.between(1.0, 4.0), item.between(14.0, 40.0), item.seed()));
}

/// Colours of work clothes: blues, greys, khaki, black, high-visibility.
pub fn cloth_colour(item: &mut Draw) -> Vec3 {
    match item.weighted(&[3.0, 2.0, 2.0, 1.0, 1.0, 1.0]) {
        0 => hsv(item.between(0.58, 0.64), item.between(0.3, 0.7), item.between(0.12, 0.5)),
        1 => Vec3::splat(item.between(0.008, 0.05)),
        2 => Vec3::splat(item.between(0.05, 0.4)),
        3 => hsv(item.between(0.07, 0.12), item.between(0.2, 0.5), item.between(0.3, 0.7)),
        4 => item.pick(&[srgb(250, 110, 20), srgb(200, 230, 30), srgb(190, 40, 40)]),
        _ => hsv(item.unit(), item.between(0.1, 0.8), item.between(0.15, 0.8)),
    }
}

/// A hand, with more or less of its forearm.
pub fn hand(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let scale = item.between(0.82, 1.1);
    let side = item.sign();
    let (paint, skin, thicker, nails) = hand_dress(&mut model, item);
    hand_body(&mut model, item, pose, (paint, thicker, nails), scale, side);
    let length = match item.weighted(&[1.0, 2.0, 2.0]) {
        0 => 0.0,
        1 => item.between(20.0, 90.0),
        _ => item.between(90.0, 260.0),
    };
    if thicker > 0.0 {
        let cuff = Part::new(frustum(33.0 * scale, 29.0 * scale + thicker, 20.0, 2.0), paint)
            .along_x()
            .at(-12.0, 0.0, 0.0);
        model.add(Solid::new(cuff));
    }
    if length > 0.0 {
        forearm(&mut model, item, skin, length, scale);
    }
    let about_x = match pose.weighted(&[5.0, 2.0, 1.5]) {
        0 => 0.0,
        1 => std::f32::consts::PI,
        _ => side * std::f32::consts::FRAC_PI_2,
    };
    let pitch = if pose.chance(0.25) { pose.between(-0.5, 0.9) } else { pose.between(-0.05, 0.15) };
    model.rest = Quat::from_rotation_y(pitch) * Quat::from_rotation_x(about_x + 0.15 * pose.normal());
    if pose.chance(0.15) {
        model.lift = pose.between(5.0, 90.0);
    }
    model
}

/// A leg: standing, kneeling, lying; in trousers or bare.
pub fn leg(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let bare = item.chance(0.25);
    let colour = cloth_colour(item);
    let paint =
        if bare { model.paint(Material::skin(item)) } else { model.paint(Material::cloth(item, colour)) };
    let thick = item.between(0.85, 1.2);
    let (knee, ankle, thigh) = (62.0 * thick, if bare { 40.0 } else { 56.0 } * thick, 84.0 * thick);
    let fold = if bare { 0.6 } else { item.between(2.0, 7.0) };
    let width = item.between(18.0, 55.0);
    let seed = item.seed();
    match item.weighted(&[2.2, 2.2, 2.2, 1.6]) {
        0 => {
            // Standing, cut off by the top of what can be seen.
            let high = item.between(260.0, 480.0);
            let shoe = foot_of(item, pose, 0);
            model.attach(shoe, Quat::IDENTITY, Vec3::ZERO);
            let from = v3(-62.0, 0.0, 70.0);
            let to = v3(-62.0 + pose.between(-60.0, 60.0), pose.between(-40.0, 40.0), high);
            let solid = Solid::new(Part::new(stick(from, to, ankle, knee), paint));
            model.add(solid.wrinkled(fold, width, seed));
        }
        1 => {
            // Kneeling: knee at the origin, shank back along the floor, thigh up.
            let lean = pose.between(-0.5, 0.35);
            let up = v3(lean * 300.0, pose.between(-40.0, 40.0), item.between(180.0, 380.0));
            let back = v3(-item.between(260.0, 400.0), pose.between(-40.0, 40.0), ankle);
            let joint = v3(0.0, 0.0, knee);
            let solid = Solid::new(Part::new(stick(joint, back, knee, ankle), paint))
                .blend(Part::new(stick(joint, joint + up, knee * 1.05, thigh), paint), 40.0);
            model.add(solid.wrinkled(fold, width, seed));
            let shoe = foot_of(item, pose, 0);
            let turn = Quat::from_rotation_y(1.3);
            model.attach(shoe, turn, back + v3(-70.0, 0.0, ankle * 0.6));
        }
        2 => {
            // Only a knee with what is above it: a rounded column.
            let high = item.between(160.0, 420.0);
            let tilt = v3(pose.between(-0.5, 0.5) * high, pose.between(-0.4, 0.4) * high, high);
            let foot = v3(0.0, 0.0, knee);
            let solid = Solid::new(Part::new(stick(foot, foot + tilt, knee, thigh * 0.95), paint)).blend(
                Part::new(Shape::Ellipsoid(v3(knee * 0.8, knee * 0.8, knee * 0.9)), paint).at(
                    0.2 * knee,
                    0.0,
                    knee,
                ),
                30.0,
            );
            model.add(solid.wrinkled(fold, width, seed));
        }
        _ => {
            // Lying, bent at the knee.
            let bend = pose.between(0.0, 1.4) * pose.sign();
            let shin = v3(bend.cos(), bend.sin(), 0.0) * 380.0;
            let joint = v3(0.0, 0.0, knee);
            let solid = Solid::new(Part::new(stick(v3(-330.0, 0.0, thigh), joint, thigh, knee), paint))
                .blend(Part::new(stick(joint, joint + shin, knee, ankle), paint), 35.0);
            model.add(solid.wrinkled(fold, width, seed));
            let shoe = foot_of(item, pose, 0);
            let turn =
                Quat::from_rotation_z(bend) * Quat::from_rotation_x(1.2) * Quat::from_rotation_y(-1.45);
            model.attach(shoe, turn, joint + shin * 1.15);
        }
    }
    model
}

/// A head with hair and face, its crown towards +x, face up.
fn head(item: &mut Draw, skin: Material) -> Model {
    let mut model = Model::default();
    let skin = model.paint(skin);
    let dark = item.pick(&[
        srgb(20, 15, 12),
        srgb(50, 32, 20),
        srgb(110, 75, 40),
        srgb(190, 160, 110),
        srgb(150, 150, 150),
    ]);
    let mut hair = Material::cloth(item, dark);
    hair.pattern = Pattern::Grain;
    let hair = model.paint(hair);
    let skull = Solid::new(Part::new(Shape::Ellipsoid(v3(112.0, 78.0, 98.0)), skin))
        .blend(Part::new(Shape::Ellipsoid(v3(50.0, 52.0, 60.0)), skin).at(-62.0, 0.0, 42.0), 30.0)
        .blend(Part::new(stick(v3(-10.0, 0.0, 96.0), v3(-38.0, 0.0, 108.0), 9.0, 14.0), skin), 14.0)
        .blend(Part::new(stick(v3(-80.0, 0.0, -10.0), v3(-150.0, 0.0, -20.0), 52.0, 56.0), skin), 24.0)
        .join(Part::new(Shape::Ellipsoid(v3(30.0, 8.0, 18.0)), skin).at(-20.0, 80.0, 0.0))
        .join(Part::new(Shape::Ellipsoid(v3(30.0, 8.0, 18.0)), skin).at(-20.0, -80.0, 0.0));
    model.add(skull);
    let cap = Solid::new(Part::new(Shape::Ellipsoid(v3(118.0, 84.0, 103.0)), hair).at(8.0, 0.0, -10.0))
        .cut(Part::new(cuboid(90.0, 90.0, 80.0, 20.0), hair).at(-70.0, 0.0, 80.0));
    model.add(cap.wrinkled(5.0, 22.0, item.seed()));
    model
}

/// A lying person, whole or in part, or an arm that lies on the floor.
pub fn person(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let skin = Material::skin(item);
    let family = item.weighted(&[3.0, 2.0, 1.6, 1.4]);
    let colour = cloth_colour(item);
    let shirt = model.paint(Material::cloth(item, colour));
    if family == 0 {
        // An arm: hand, forearm, bent elbow, upper arm in a sleeve.
        arm(&mut model, item, pose, skin, shirt);
        return model;
    }
    let (fold, width, seed) = (item.between(3.0, 8.0), item.between(25.0, 70.0), item.seed());
    let stout = item.between(0.85, 1.2);
    if family != 1 {
        let torso = Solid::new(
            Part::new(Shape::Ellipsoid(v3(260.0, 185.0 * stout, 115.0 * stout)), shirt).at(0.0, 0.0, 100.0),
        )
        .blend(
            Part::new(Shape::Ellipsoid(v3(160.0, 165.0 * stout, 105.0 * stout)), shirt).at(-250.0, 0.0, 95.0),
            80.0,
        )
        .blend(Part::new(stick(v3(170.0, -150.0, 90.0), v3(170.0, 150.0, 90.0), 62.0, 62.0), shirt), 60.0);
        model.add(torso.wrinkled(fold, width, seed));
        for side in [-1.0, 1.0] {
            let mut limb = Model::default();
            let sleeve = limb.paint(Material::cloth(item, colour));
            arm(&mut limb, item, pose, skin, sleeve);
            let turn = Quat::from_rotation_z(side * pose.between(0.9, 2.6));
            // The arm's frame has its shoulder at -x: bring it to the shoulder.
            model.attach(limb, turn, v3(170.0, side * 190.0, 0.0) + turn * v3(320.0, 0.0, 0.0));
        }
    }
    let skull = head(item, skin);
    let look = Quat::from_rotation_x(pose.between(-1.2, 1.2));
    model.attach(skull, look, v3(430.0, 0.0, 100.0));
    if family == 3 {
        let trouser_colour = cloth_colour(item);
        let paint = model.paint(Material::cloth(item, trouser_colour));
        for side in [-1.0, 1.0] {
            let hip = v3(-330.0, side * 85.0, 85.0);
            let knee = v3(-720.0, side * pose.between(90.0, 220.0), pose.between(65.0, 180.0));
            let ankle = v3(-1080.0, side * pose.between(60.0, 240.0), 60.0);
            let solid = trousers(paint, &[(hip, 90.0), (knee, 66.0), (ankle, 54.0)]);
            model.add(solid.wrinkled(fold, width, seed));
            let shoe = foot_of(item, pose, 0);
            model.attach(shoe, Quat::from_rotation_y(-1.4), ankle + v3(-90.0, 0.0, 0.0));
        }
    }
    model
}

/// An arm on the floor along x, shoulder at about -320, wrist towards +x.
fn arm(model: &mut Model, item: &mut Draw, pose: &mut Draw, skin: Material, shirt: u8) {
    let paint = model.paint(skin);
    let bend = pose.between(-0.9, 0.9);
    let elbow = v3(0.0, 0.0, 44.0);
    let shoulder = v3(-300.0, 0.0, 62.0);
    let along = v3(bend.cos(), bend.sin(), 0.0);
    let wrist = elbow + along * 240.0 - v3(0.0, 0.0, 14.0);
    model.add_part(Part::new(stick(elbow, wrist, 40.0, 26.0), paint));
    let mut sleeve = Solid::new(Part::new(stick(shoulder, elbow, 66.0, 48.0), shirt));
    if item.chance(0.6) {
        sleeve = sleeve.blend(
            Part::new(stick(elbow, elbow + along * item.between(120.0, 215.0), 48.0, 38.0), shirt),
            20.0,
        );
    }
    model.add(sleeve.wrinkled(item.between(2.0, 6.0), item.between(20.0, 50.0), item.seed()));
    let mut hand = Model::default();
    let hand_paint = hand.paint(skin);
    let side = item.sign();
    let scale = item.between(0.88, 1.08);
    hand_body(&mut hand, item, pose, (hand_paint, 0.0, true), scale, side);
    model.attach(hand, Quat::from_rotation_z(bend), wrist);
}
