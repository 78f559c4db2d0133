//! Other things on a factory floor: they are named in the truth but not trained, so that the detector sees what it must
//! leave alone.

use glam::{Quat, Vec3};

use super::{cuboid, cylinder, frustum, prism, stick, v2, v3};
use crate::material::{Material, Pattern, hsv, srgb, tool_colour};
use crate::model::{Model, Part, Solid};
use crate::random::Draw;
use crate::shape::{Rope, Section, Shape};

/// A cardboard or plastic box, sometimes with tape.
pub fn carton(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let card = srgb(186, 146, 100) * item.between(0.7, 1.15);
    let material =
        if item.chance(0.6) { Material::cloth(item, card) } else { Material::coloured_plastic(item) };
    let paint = model.paint(material);
    let half = v3(item.octave(15.0, 160.0), item.octave(12.0, 110.0), item.octave(10.0, 90.0));
    model.add_part(Part::new(cuboid(half.x, half.y, half.z, item.between(0.3, 3.0)), paint));
    if item.chance(0.5) {
        let tape = model.paint(Material::plastic(item, srgb(200, 170, 110)));
        model.add_part(Part::new(cuboid(half.x + 0.3, half.y * 0.18, half.z + 0.3, 0.2), tape));
    }
    if pose.chance(0.2) {
        model.rest = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    }
    model
}

/// A corner of a pallet: boards on blocks.
pub fn pallet(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let mut wood = Material::rubber(item, srgb(190, 150, 100) * item.clone().between(0.5, 1.0));
    wood.pattern = Pattern::Grain;
    wood.second = wood.colour * 0.6;
    let wood = model.paint(wood);
    for board in 0..4 {
        let y = board as f32 * 130.0 - 195.0;
        model.add_part(Part::new(cuboid(260.0, 49.0, 10.0, 1.0), wood).at(0.0, y, 112.0));
    }
    for (x, y) in [(-200.0, -180.0), (-200.0, 180.0), (160.0, -180.0), (160.0, 180.0)] {
        model.add_part(Part::new(cuboid(60.0, 50.0, 46.0, 1.0), wood).at(x, y, 66.0));
    }
    model.add_part(Part::new(cuboid(260.0, 50.0, 10.0, 1.0), wood).at(0.0, -180.0, 10.0));
    model.add_part(Part::new(cuboid(260.0, 50.0, 10.0, 1.0), wood).at(0.0, 180.0, 10.0));
    model
}

/// An aluminium extrusion with T-slots.
pub fn extrusion(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = model.paint(Material::metal(item, Vec3::splat(0.7), 0.4));
    let half = item.pick(&[10.0, 15.0, 20.0]);
    let length = item.between(60.0, 350.0);
    let mut solid = Solid::new(Part::new(cuboid(length / 2.0, half, half, 0.8), paint));
    for turn in 0..4 {
        let around = Quat::from_rotation_x(turn as f32 * std::f32::consts::FRAC_PI_2);
        let neck = around * v3(0.0, 0.0, half);
        let hollow = around * v3(0.0, 0.0, half * 0.62);
        let slot = Part::new(cuboid(length, half * 0.3, half * 0.25, 0.0), paint).turned(around);
        solid = solid.cut(slot.at(neck.x, neck.y, neck.z));
        let wide = Part::new(cuboid(length, half * 0.5, half * 0.2, 0.0), paint).turned(around);
        solid = solid.cut(wide.at(hollow.x, hollow.y, hollow.z));
    }
    model.add(solid.cut(Part::new(cylinder(half * 0.2, length, 0.0), paint).along_x()));
    model
}

/// A sheet-metal angle bracket with holes.
pub fn bracket(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let metal = Material::fastener(item);
    let paint = model.paint(metal);
    let (long, wide, thick) = (item.between(14.0, 60.0), item.between(10.0, 30.0), item.between(1.0, 3.0));
    let mut solid = Solid::new(Part::new(cuboid(long, wide, thick, 0.3), paint).at(long, 0.0, 0.0))
        .blend(Part::new(cuboid(thick, wide, long * 0.8, 0.3), paint).at(0.0, 0.0, long * 0.8), thick * 2.0);
    for hole in [0.6, 1.5] {
        solid = solid.cut(Part::new(cylinder(wide * 0.25, 10.0, 0.0), paint).at(long * hole, 0.0, 0.0));
        solid = solid.cut(Part::new(cylinder(wide * 0.25, 10.0, 0.0), paint).along_x().at(
            0.0,
            0.0,
            long * hole * 0.8,
        ));
    }
    model.add(solid);
    model.rest =
        Quat::from_rotation_x(pose.pick(&[0.0, std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2]));
    model
}

/// A traffic cone.
pub fn cone(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let mut orange = Material::plastic(item, srgb(245, 90, 20));
    let high = item.between(150.0, 420.0);
    orange.pattern = Pattern::Rings(high * 0.45);
    orange.second = Vec3::splat(0.75);
    let orange = model.paint(orange);
    let base = model.paint(Material::rubber(item, srgb(230, 85, 25)));
    let wide = high * 0.22;
    model.add_part(Part::new(cuboid(wide * 1.25, wide * 1.25, 8.0, 4.0), base).at(0.0, 0.0, 8.0));
    model.add_part(Part::new(frustum(wide, wide * 0.22, high / 2.0, 2.0), orange).at(
        0.0,
        0.0,
        high / 2.0 + 10.0,
    ));
    if pose.chance(0.3) {
        model.rest = Quat::from_rotation_y(1.45);
    }
    model
}

/// Safety glasses: two lenses, bridge, temples.
pub fn safety_glasses(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let lens_colour = item.pick(&[Vec3::splat(0.35), Vec3::splat(0.03), srgb(220, 180, 60)]);
    let mut lens = Material::plastic(item, lens_colour);
    lens.roughness = 0.06;
    let lens = model.paint(lens);
    let frame = model.paint(Material::coloured_plastic(item));
    for side in [-1.0, 1.0] {
        let glass = Part::new(Shape::Ellipsoid(v3(4.0, 31.0, 22.0)), lens)
            .turned(Quat::from_rotation_z(-side * 0.25));
        model.add_part(glass.at(0.0, side * 34.0, 22.0));
        let hinge = v3(-12.0, side * 66.0, 32.0);
        let ear = v3(-115.0, side * 62.0, 24.0);
        model.add_part(Part::new(stick(hinge, ear, 3.2, 3.0), frame));
        model.add_part(Part::new(stick(ear, ear + v3(-26.0, 0.0, -16.0), 3.2, 4.0), frame));
        model.add_part(Part::new(stick(v3(2.0, side * 10.0, 40.0), hinge, 3.4, 3.4), frame));
    }
    model.add_part(Part::new(stick(v3(3.0, -10.0, 38.0), v3(3.0, 10.0, 38.0), 3.4, 3.4), frame));
    if pose.chance(0.4) {
        model.rest = Quat::from_rotation_y(std::f32::consts::PI);
    }
    model
}

/// The end of a fork of a lift truck.
pub fn forklift_tine(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let colour = item.pick(&[Vec3::splat(0.03), srgb(220, 170, 30), Vec3::splat(0.2)]);
    let paint = model.paint(Material::rubber(item, colour));
    let outline = vec![
        v2(-350.0, 0.0),
        v2(330.0, 0.0),
        v2(350.0, 6.0),
        v2(-300.0, 42.0),
        v2(-305.0, 300.0),
        v2(-350.0, 300.0),
    ];
    let tine = Part::new(Shape::Extrusion { outline, half: item.between(40.0, 75.0), round: 3.0 }, paint);
    model.add_part(tine.turned(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2)));
    model.lift = item.between(0.0, 60.0);
    model
}

/// A swivel castor of a cart.
pub fn cart_wheel(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let r = item.between(30.0, 80.0);
    let dark = item.pick(&[Vec3::splat(0.015), Vec3::splat(0.2), srgb(60, 90, 160)]);
    let tyre = model.paint(Material::rubber(item, dark));
    let hub = model.paint(Material::metal(item, Vec3::splat(0.6), 0.35));
    model.add_part(Part::new(cylinder(r, r * 0.28, r * 0.15), tyre).along_y().at(0.0, 0.0, r));
    model.add_part(Part::new(cylinder(r * 0.5, r * 0.32, 2.0), hub).along_y().at(0.0, 0.0, r));
    for side in [-1.0, 1.0] {
        let fork =
            stick(v3(0.0, side * r * 0.45, r), v3(r * 0.35, side * r * 0.4, r * 2.1), r * 0.14, r * 0.2);
        model.add_part(Part::new(fork, hub));
    }
    model.add_part(Part::new(cuboid(r * 0.8, r * 0.65, 4.0, 2.0), hub).at(r * 0.35, 0.0, r * 2.25));
    model
}

/// Pliers, half open.
pub fn pliers(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let steel = model.paint(Material::tool_steel(item));
    let grip = model.paint(Material::coloured_plastic(item));
    let open = pose.between(0.03, 0.3);
    for side in [-1.0, 1.0] {
        let turn = Quat::from_rotation_z(side * open);
        let jaw = Part::new(frustum(7.0, 2.6, 22.0, 1.0), steel)
            .turned(turn * Quat::from_rotation_y(std::f32::consts::FRAC_PI_2));
        let at = turn * v3(30.0, -side * 3.0, 0.0);
        model.add_part(jaw.at(at.x, at.y, 0.0));
        let points = [(-8.0, side * 6.0), (-35.0, side * 17.0), (-75.0, side * 20.0), (-120.0, side * 14.0)];
        let chain = points.map(|(x, y)| (turn * v3(x, y, 0.0), 6.5)).to_vec();
        model.add_part(Part::new(Shape::Rope(Rope::new(chain)), grip));
    }
    model.add_part(Part::new(cylinder(11.0, 6.0, 1.5), steel));
    model
}

/// A hammer.
pub fn hammer(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let steel = model.paint(Material::tool_steel(item));
    let mut wood = Material::rubber(item, srgb(190, 140, 84));
    wood.pattern = Pattern::Grain;
    wood.second = wood.colour * 0.6;
    let handle = if item.chance(0.5) { wood } else { Material::coloured_plastic(item) };
    let handle = model.paint(handle);
    let long = item.between(220.0, 320.0);
    model.add_part(Part::new(stick(v3(0.0, 0.0, 0.0), v3(-long, 0.0, 0.0), 10.0, 14.0), handle));
    let head = Solid::new(Part::new(cuboid(13.0, 42.0, 13.0, 3.0), steel))
        .join(Part::new(cylinder(15.0, 14.0, 2.0), steel).along_y().at(0.0, 44.0, 0.0))
        .blend(Part::new(cuboid(12.0, 26.0, 4.0, 1.0), steel).at(0.0, -50.0, 0.0), 12.0);
    model.add(head);
    model
}

/// A roll of tape.
pub fn tape_roll(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = model.paint(Material::coloured_plastic(item));
    let core = model.paint(Material::cloth(item, srgb(190, 150, 105)));
    let (r, half) = (item.between(28.0, 70.0), item.between(6.0, 26.0));
    let bore = Part::new(cylinder(r * 0.6, 100.0, 0.0), core);
    model.add(Solid::new(Part::new(cylinder(r, half, 0.8), paint)).cut(bore));
    if pose.chance(0.25) {
        model.rest = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    }
    model
}

/// A bottle or a can.
pub fn bottle(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = if item.chance(0.4) {
        Material::metal(item, Vec3::splat(0.65), 0.25)
    } else {
        Material::coloured_plastic(item)
    };
    let paint = model.paint(paint);
    let label_colour = tool_colour(item);
    let label = model.paint(Material::plastic(item, label_colour));
    let (r, high) = (item.between(18.0, 42.0), item.between(45.0, 110.0));
    model.add_part(Part::new(cylinder(r, high, r * 0.2), paint));
    model.add_part(Part::new(cylinder(r * 1.01, high * 0.45, 0.2), label));
    if item.chance(0.6) {
        model.add_part(Part::new(frustum(r * 0.9, r * 0.35, high * 0.25, 2.0), paint).at(
            0.0,
            0.0,
            high * 1.2,
        ));
        model.add_part(Part::new(cylinder(r * 0.4, high * 0.1, 1.0), label).at(0.0, 0.0, high * 1.5));
    }
    if pose.chance(0.6) {
        model.rest = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    }
    model
}

/// A steel spring.
pub fn spring(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = model.paint(Material::fastener(item));
    let (r, wire, turns) = (item.between(4.0, 16.0), item.between(0.6, 1.8), item.between(5.0, 11.0));
    let step = wire * item.between(2.4, 4.5);
    let points = (0..(turns * 14.0) as usize)
        .map(|place| {
            let turn = place as f32 / 14.0;
            let angle = turn * std::f32::consts::TAU;
            (v3((turn - turns / 2.0) * step, r * angle.cos(), r * angle.sin()), wire)
        })
        .collect();
    model.add_part(Part::new(Shape::Rope(Rope::new(points)), paint));
    model
}

/// A round tube or rod.
pub fn pipe(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = if item.chance(0.5) { Material::tool_steel(item) } else { Material::coloured_plastic(item) };
    let paint = model.paint(paint);
    let (r, half) = (item.octave(4.0, 30.0), item.between(40.0, 200.0));
    let tube = Solid::new(Part::new(cylinder(r, half, 0.4), paint).along_x());
    model.add(if item.chance(0.7) {
        tube.cut(Part::new(cylinder(r * 0.8, half * 2.0, 0.0), paint).along_x())
    } else {
        tube
    });
    model
}

/// A plank or a panel.
pub fn plank(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let mut wood = Material::rubber(item, srgb(200, 160, 110) * item.clone().between(0.4, 1.0));
    wood.pattern = Pattern::Grain;
    wood.second = wood.colour * 0.55;
    let wood = model.paint(wood);
    model.add_part(Part::new(
        cuboid(item.between(60.0, 300.0), item.between(12.0, 60.0), item.between(4.0, 20.0), 0.8),
        wood,
    ));
    model
}

/// A crumpled sheet: paper, foil, a cloth.
pub fn rag(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let colour = hsv(item.unit(), item.between(0.0, 0.5), item.between(0.3, 0.95));
    let paint = model.paint(Material::cloth(item, colour));
    let size = item.between(30.0, 110.0);
    let body = Part::new(cuboid(size, size * item.between(0.5, 1.0), 2.5, 2.0), paint);
    let heap =
        Part::new(Shape::Ellipsoid(v3(size * 0.7, size * 0.5, size * 0.22)), paint).at(size * 0.1, 0.0, 0.0);
    model.add(Solid::new(body).blend(heap, 12.0).wrinkled(size * 0.12, size * 0.35, pose.seed()));
    model
}

/// A rolled metal strip, a hose clamp.
pub fn hose_clamp(item: &mut Draw, pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let paint = model.paint(Material::fastener(item));
    let r = item.between(8.0, 35.0);
    let path = (0..=32)
        .map(|place| glam::Vec2::from_angle(place as f32 / 32.0 * std::f32::consts::TAU) * r)
        .collect();
    let half = item.between(3.5, 7.0);
    model.add_part(Part::new(
        Shape::Strap { path, section: Section::Flat { across: 0.5, along: half } },
        paint,
    ));
    model.add_part(Part::new(cuboid(6.0, 4.0, half * 0.9, 1.0), paint).at(0.0, r + 3.5, 0.0));
    model.add_part(Part::new(prism(6, 3.5, 4.0, 0.3), paint).along_x().at(9.0, r + 4.0, 0.0));
    if pose.chance(0.3) {
        model.rest = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    }
    model
}

/// A power drill.
pub fn power_drill(item: &mut Draw, _pose: &mut Draw) -> Model {
    let mut model = Model::default();
    let body = model.paint(Material::coloured_plastic(item));
    let dark = model.paint(Material::rubber(item, Vec3::splat(0.02)));
    let steel = model.paint(Material::tool_steel(item));
    let solid = Solid::new(Part::new(cylinder(30.0, 62.0, 10.0), body).along_x())
        .blend(Part::new(stick(v3(-30.0, -20.0, 0.0), v3(-50.0, -120.0, 0.0), 20.0, 19.0), body), 16.0)
        .join(Part::new(cuboid(42.0, 20.0, 34.0, 5.0), dark).at(-48.0, -148.0, 0.0));
    model.add(solid);
    model.add_part(Part::new(frustum(22.0, 13.0, 24.0, 2.0), dark).along_x().at(84.0, 0.0, 0.0));
    model.add_part(Part::new(cylinder(3.0, 34.0, 0.5), steel).along_x().at(130.0, 0.0, 0.0));
    model
}
