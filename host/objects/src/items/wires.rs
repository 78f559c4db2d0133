//! Wires and zip ties.

use glam::{Quat, Vec2, Vec3};

use super::{cuboid, cylinder, v2};
use crate::material::{Material, Pattern, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::{Rope, Section, Shape};

/// A smooth random walk in the plane: `count` points, `step` mm apart, that bends by at most about `bend` radians a
/// step and has a steady turn of `curl` radians a step.
fn walk(pose: &mut Draw, count: usize, step: f32, bend: f32, curl: f32) -> Vec<Vec2> {
    let (mut at, mut heading, mut turn) = (Vec2::ZERO, pose.angle(), 0.0_f32);
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        points.push(at);
        turn = 0.86 * turn + 0.5 * bend * pose.normal();
        heading += turn.clamp(-bend, bend) + curl;
        at += Vec2::from_angle(heading) * step;
    }
    let centre = points.iter().copied().sum::<Vec2>() / count.max(1) as f32;
    points.iter().map(|p| *p - centre).collect()
}

/// Lays a curve on the floor as a rope: where it crosses itself the later turn lies on top.
fn lay(points: &[Vec2], radius: f32, lively: f32, pose: &mut Draw) -> Vec<(Vec3, f32)> {
    let mut heights: Vec<f32> = vec![radius; points.len()];
    for later in 0..points.len() {
        for earlier in 0..later.saturating_sub(6) {
            let apart = points[later].distance(points[earlier]);
            let over = heights[earlier] + 2.0 * radius * (1.3 - apart / (3.0 * radius + 1.0)).clamp(0.0, 1.0);
            if apart < 3.0 * radius + 1.0 {
                heights[later] = heights[later].max(over);
            }
        }
    }
    // Stiff: a wire rises and falls over several of its own widths.
    for _ in 0..6 {
        let before = heights.clone();
        for place in 1..heights.len().saturating_sub(1) {
            let level = (before[place - 1] + before[place] + before[place + 1]) / 3.0;
            heights[place] = heights[place].max(level);
        }
    }
    let (phase, rise) = (pose.angle(), lively * pose.unit());
    let waves = pose.between(0.5, 2.5) * std::f32::consts::TAU / points.len().max(1) as f32;
    points
        .iter()
        .zip(heights)
        .enumerate()
        .map(|(place, (p, z))| {
            let arch = rise * (0.5 + 0.5 * (phase + waves * place as f32).sin());
            (p.extend(z + arch), radius)
        })
        .collect()
}

/// A curve beside another in the plane, at a distance to its left.
fn beside(points: &[Vec2], offset: impl Fn(usize) -> f32) -> Vec<Vec2> {
    let last = points.len() - 1;
    (0..points.len())
        .map(|place| {
            let along = points[(place + 1).min(last)] - points[place.saturating_sub(1)];
            points[place] + along.perp().normalize_or_zero() * offset(place)
        })
        .collect()
}

/// A wire, a bundle, a coil or a cable.
pub fn wire(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let colour = tool_colour(item);
    let sheath = model.paint(Material::plastic(item, colour));
    let copper_colour = if item.chance(0.7) { srgb(220, 138, 100) } else { srgb(205, 205, 200) };
    let copper = model.paint(Material::metal(item, copper_colour, 0.3));
    let radius = item.octave(0.6, 4.2);
    let length = (radius * item.octave(45.0, 190.0)).clamp(60.0, 520.0);
    let count = 64;
    let step = length / count as f32;
    let family = item.weighted(&[3.5, 2.0, 1.8, 1.4, 1.0, 1.2]);
    let bend = item.between(0.04, 0.22);
    match family {
        0 | 1 => {
            let curl = if family == 1 { pose.sign() * pose.between(0.05, 0.18) } else { 0.0 };
            let path = walk(pose, count, step, bend, curl);
            let rope = lay(&path, radius, 3.0 * radius, pose);
            strip_ends(&mut model, item, copper, &rope, radius);
            model.add_part(Part::new(Shape::Rope(Rope::new(rope)), sheath));
        }
        2 => coil(&mut model, item, pose, sheath, radius),
        3 => {
            let path = walk(pose, count, step, bend * 0.7, 0.0);
            strands(&mut model, item, pose, copper, radius, &path);
        }
        4 => {
            // Bare bent wire: a few straight stretches.
            let mut at = Vec2::ZERO;
            let mut heading = 0.0;
            let mut path = vec![at];
            for _ in 0..item.whole(2, 5) {
                at += Vec2::from_angle(heading) * item.between(20.0, 70.0);
                path.push(at);
                heading += item.between(0.3, 1.8) * item.sign();
            }
            let centre = path.iter().copied().sum::<Vec2>() / path.len() as f32;
            let thin = (radius * 0.7).max(0.7);
            let rope: Vec<_> = path.iter().map(|p| ((*p - centre).extend(thin), thin)).collect();
            model.add_part(Part::new(Shape::Rope(Rope::new(rope)), copper));
        }
        _ => {
            // A thick cable, often with a spiral sheath or a braid.
            let thick = item.between(3.0, 6.5);
            let path = walk(pose, count, (length * 1.3).min(520.0) / count as f32, bend * 0.6, 0.0);
            let rope = lay(&path, thick, 0.0, pose);
            let colour =
                if item.chance(0.6) { Vec3::splat(item.between(0.01, 0.06)) } else { tool_colour(item) };
            let mut material = Material::rubber(item, colour);
            if item.chance(0.3) {
                material.pattern = Pattern::Woven(2.2);
                material.second = material.colour * 2.5 + Vec3::splat(0.02);
            }
            let paint = model.paint(material);
            strip_ends(&mut model, item, copper, &rope, thick);
            model.add_part(Part::new(Shape::Rope(Rope::new(rope)), paint));
        }
    }
    model
}

/// Several wires along a path, side by side or twisted.
fn strands(model: &mut Model, item: &mut Draw, pose: &Draw, copper: u8, radius: f32, path: &[Vec2]) {
    let strands = item.whole(2, 4);
    let twist = if item.chance(0.5) { item.between(0.35, 0.7) } else { 0.0 };
    for strand in 0..strands {
        let colour = tool_colour(item);
        let paint = model.paint(Material::plastic(item, colour));
        let phase = strand as f32 / strands as f32 * std::f32::consts::TAU;
        let wide = (strand as f32 - (strands as f32 - 1.0) / 2.0) * 2.05 * radius;
        let offset = |place: usize| {
            if twist > 0.0 { 1.2 * radius * (phase + twist * place as f32).cos() } else { wide }
        };
        // Every strand arches alike: each gets the same draws.
        let mut rope = lay(&beside(path, offset), radius, 0.0, &mut pose.clone());
        for (place, point) in rope.iter_mut().enumerate() {
            if twist > 0.0 {
                point.0.z += radius * (1.0 + (phase + twist * place as f32).sin());
            }
        }
        strip_ends(model, item, copper, &rope, radius);
        model.add_part(Part::new(Shape::Rope(Rope::new(rope)), paint));
    }
}

/// Bare copper at the ends, sometimes frayed.
fn strip_ends(model: &mut Model, item: &mut Draw, copper: u8, rope: &[(Vec3, f32)], radius: f32) {
    if item.chance(0.25) || rope.len() < 3 {
        return;
    }
    let bare = radius * item.between(3.0, 7.0);
    for (end, before) in [(rope[0].0, rope[2].0), (rope[rope.len() - 1].0, rope[rope.len() - 3].0)] {
        let out = (end - before).normalize_or(Vec3::X);
        let strands = if item.chance(0.4) { item.whole(3, 5) } else { 1 };
        for strand in 0..strands {
            let spread = if strands > 1 { 0.22 } else { 0.0 };
            let thin = if strands > 1 { radius * 0.22 } else { radius * 0.55 };
            let side = out.cross(Vec3::Z) * (strand as f32 - strands as f32 / 2.0) * spread;
            let to = end + (out + side) * bare;
            model.add_part(Part::new(Shape::Stick { from: end, to, start: thin, end: thin }, copper));
        }
    }
}

/// A coil of several turns, lying flat, sometimes tied.
fn coil(model: &mut Model, item: &mut Draw, pose: &mut Draw, sheath: u8, radius: f32) {
    let thin = radius.min(2.6);
    let ring = thin * item.between(12.0, 26.0);
    let turns = item.between(1.6, 4.2);
    let points = (turns * 26.0) as usize;
    let wobble = item.between(0.02, 0.10);
    let (phase, oval) = (pose.angle(), item.between(0.7, 1.0));
    let path: Vec<(Vec3, f32)> = (0..points)
        .map(|place| {
            let turn = place as f32 / 26.0 * std::f32::consts::TAU;
            let spread = 1.0 + wobble * ((turn * 0.73 + phase).sin() + (turn * 1.31).cos());
            let tail = ((place as f32 - points as f32 + 8.0) / 8.0).max(0.0);
            let out = ring * spread * (1.0 + 0.5 * tail);
            let z = thin
                * (1.0
                    + 1.1 * (turn / std::f32::consts::TAU).floor().min(2.0)
                    + 0.3 * (turn * 0.5 + phase).sin().max(0.0));
            (Vec3::new(out * turn.cos(), out * oval * turn.sin(), z), thin)
        })
        .collect();
    model.add_part(Part::new(Shape::Rope(Rope::new(path)), sheath));
    if item.chance(0.4) {
        let tie = model.paint(Material::coloured_plastic(item));
        let band = Part::new(Shape::Torus { ring: thin * 3.2, tube: thin * 0.5 }, tie).along_y();
        model.add_part(band.at(ring, 0.0, thin * 2.0));
    }
}

/// A zip tie (cable tie): head with a slot, strap, pointed tail; open, bent, closed to a loop, or cut.
pub fn zip_tie(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let colour = match item.weighted(&[4.0, 4.0, 2.0]) {
        0 => Vec3::splat(item.between(0.008, 0.03)),
        1 => srgb(232, 228, 214) * item.between(0.8, 1.05),
        _ => tool_colour(item),
    };
    let mut material = Material::plastic(item, colour);
    material.soft = if colour.x > 0.4 { 0.6 } else { 0.1 };
    let nylon = model.paint(material);
    let width = item.octave(2.5, 9.0);
    let thick = (width * 0.28).clamp(1.0, 1.9);
    let length = (width * item.between(28.0, 48.0)).clamp(90.0, 320.0);
    let (head_x, head_z) = (width * item.between(0.75, 1.0), width * item.between(0.5, 0.75));
    let family = item.weighted(&[2.2, 2.4, 3.2, 1.2]);
    let flat = Section::Flat { across: width / 2.0, along: thick / 2.0 };
    let edge = Section::Flat { across: thick / 2.0, along: width / 2.0 };
    match family {
        0 => {
            // Straight on the floor, or slightly arched.
            let sag = pose.between(-0.03, 0.03);
            let path: Vec<Vec2> = (0..=12)
                .map(|place| {
                    let t = place as f32 / 12.0 - 0.5;
                    v2(t * length * 0.86, sag * length * (1.0 - 4.0 * t * t))
                })
                .collect();
            let (head, tail) = (path[0], path[12]);
            model.add_part(Part::new(Shape::Strap { path, section: flat }, nylon));
            add_head(
                &mut model,
                nylon,
                head - v2(head_x * 0.6, 0.0),
                0.0,
                (head_x, width * 0.9, head_z),
                true,
            );
            let end = vec![
                tail + v2(0.0, width / 2.0),
                tail + v2(length * 0.13, width * 0.18),
                tail + v2(length * 0.13, -width * 0.18),
                tail + v2(0.0, -width / 2.0),
            ];
            model
                .add_part(Part::new(Shape::Extrusion { outline: end, half: thick * 0.4, round: 0.1 }, nylon));
        }
        1 | 3 => {
            // On its edge, bent to a curve (1) or with a kink where it was closed before (3).
            let count = 40;
            let curl =
                pose.sign() * if family == 3 { pose.between(0.09, 0.13) } else { pose.between(0.015, 0.09) };
            let path = walk(pose, count, length / count as f32, 0.05, curl);
            let (head, next) = (path[0], path[1]);
            let heading = (next - head).to_angle();
            model.add_part(Part::new(Shape::Strap { path, section: edge }, nylon));
            add_head(&mut model, nylon, head, heading, (head_x, head_z, width * 0.75), false);
        }
        _ => {
            // Closed to a loop with a tail of any length, lying on its edge.
            let ring = length / std::f32::consts::TAU * item.between(0.35, 0.9);
            let oval = item.between(0.6, 1.0);
            let mut path: Vec<Vec2> = (0..=36)
                .map(|place| {
                    let turn = place as f32 / 36.0 * std::f32::consts::TAU;
                    v2(ring * turn.sin(), ring * oval * (1.0 - turn.cos()) - ring * oval)
                })
                .collect();
            let around = std::f32::consts::TAU * ring;
            let tail =
                if item.chance(0.4) { item.between(3.0, 12.0) } else { (length - around).clamp(8.0, 140.0) };
            let mut at = v2(0.0, -ring * oval);
            let (mut heading, curl) = (pose.between(-0.5, -0.1), pose.between(-0.05, 0.06));
            path.push(at);
            for _ in 0..12 {
                at += Vec2::from_angle(heading) * tail / 12.0;
                heading += curl;
                path.push(at);
            }
            model.add_part(Part::new(Shape::Strap { path, section: edge }, nylon));
            add_head(&mut model, nylon, v2(0.0, -ring * oval), 0.0, (head_x, head_z, width * 0.75), false);
            if item.chance(0.15) {
                // Still around a bundle of wire.
                let black = model.paint(Material::coloured_plastic(item));
                model.add_part(Part::new(cylinder(ring * 0.5, width * 2.2, 1.0), black));
            }
        }
    }
    model.rest = match family {
        0 if pose.chance(0.3) => Quat::from_rotation_x(std::f32::consts::PI),
        1 | 3 if pose.chance(0.3) => Quat::from_rotation_x(std::f32::consts::FRAC_PI_2 * 0.9),
        _ if family == 2 && pose.chance(0.25) => Quat::from_rotation_x(pose.between(0.1, 0.5)),
        _ => Quat::IDENTITY,
    };
    model
}

/// The head of a zip tie with its slot. `flat` = the strap lies flat, its slot goes through along z.
fn add_head(model: &mut Model, nylon: u8, at: Vec2, heading: f32, half: (f32, f32, f32), flat: bool) {
    let turn = Quat::from_rotation_z(heading);
    let body = Part::new(cuboid(half.0, half.1, half.2, 0.35 * half.2.min(half.1)), nylon).turned(turn);
    let slot = if flat {
        cuboid(half.0 * 0.35, half.1 * 0.6, half.2 * 2.0, 0.0)
    } else {
        cuboid(half.0 * 0.35, half.1 * 2.0, half.2 * 0.6, 0.0)
    };
    let lift = if flat { half.2 * 0.5 } else { 0.0 };
    model.add(
        Solid::new(body.at(at.x, at.y, lift)).cut(Part::new(slot, nylon).turned(turn).at(at.x, at.y, lift)),
    );
}
