//! The catalogue: every class, and the items that belong to it.
//!
//! An item is a set of parameters, drawn from the catalogue's seed, the class and the item's number: sizes, proportions,
//! shape family, materials, wear. The same item can be posed in many ways (bent wires, curled fingers, jaws), which is
//! drawn apart. Items are in millimetres and have true sizes.

mod bench;
mod connectors;
mod fasteners;
mod foot;
mod human;
mod other;
mod tools;
mod wires;

use glam::{Vec2, Vec3};

use crate::model::Model;
use crate::random::Draw;
use crate::shape::Shape;

/// The seed of the catalogue: it belongs to the catalogue, not to a dataset, so that item 17 is the same item in all.
const CATALOGUE: u64 = 0x4E46_4F42_4A31;

/// What makes a class's items from the draws of the item and of its pose.
type Maker = fn(&mut Draw, &mut Draw) -> Model;

/// A class of objects.
#[derive(Debug, Clone, Copy)]
pub struct Class {
    /// Its name in the truth files.
    pub name: &'static str,
    /// Whether the detector is trained to name it; the others teach it what to leave alone.
    pub trained: bool,
    /// Part of a person: never dropped, never outvoted.
    pub human: bool,
    maker: Maker,
}

const fn trained(name: &'static str, maker: Maker) -> Class {
    Class { name, trained: true, human: false, maker }
}

const fn human(name: &'static str, maker: Maker) -> Class {
    Class { name, trained: true, human: true, maker }
}

const fn other(name: &'static str, maker: Maker) -> Class {
    Class { name, trained: false, human: false, maker }
}

/// All classes, the trained ones first: the paper's ten, then the human ones; their place is their number in the labels.
pub const CLASSES: [Class; 32] = [
    trained("bolt", fasteners::bolt),
    trained("nut", fasteners::nut),
    trained("washer", fasteners::washer),
    trained("connector", connectors::connector),
    trained("wire", wires::wire),
    trained("screwdriver", tools::screwdriver),
    trained("wrench", tools::wrench),
    trained("marker", bench::marker),
    trained("zip_tie", wires::zip_tie),
    trained("allen_key", bench::allen_key),
    human("hand", human::hand),
    human("foot", foot::foot),
    human("leg", human::leg),
    human("person", human::person),
    other("box", other::carton),
    other("pallet", other::pallet),
    other("extrusion", other::extrusion),
    other("bracket", other::bracket),
    other("cone", other::cone),
    other("safety_glasses", other::safety_glasses),
    other("forklift_tine", other::forklift_tine),
    other("cart_wheel", other::cart_wheel),
    other("pliers", other::pliers),
    other("hammer", other::hammer),
    other("tape_roll", other::tape_roll),
    other("bottle", other::bottle),
    other("spring", other::spring),
    other("pipe", other::pipe),
    other("plank", other::plank),
    other("rag", other::rag),
    other("hose_clamp", other::hose_clamp),
    other("power_drill", other::power_drill),
];

/// How many classes are trained: the first ones of [`CLASSES`].
pub const TRAINED: usize = 14;

/// One item of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Item {
    /// Place of its class in [`CLASSES`].
    pub class: usize,
    /// Its number within the class, from 0.
    pub number: u64,
}

impl Item {
    /// The item in a pose. The same item and the same pose give the same model.
    ///
    /// # Panics
    /// If `class` is not a place in [`CLASSES`].
    #[must_use]
    pub fn model(self, pose: &mut Draw) -> Model {
        let mut item = Draw::new(CATALOGUE, &[self.class as u64, self.number]);
        (CLASSES[self.class].maker)(&mut item, pose)
    }
}

fn v2(x: f32, y: f32) -> Vec2 {
    Vec2::new(x, y)
}

fn v3(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

fn cuboid(x: f32, y: f32, z: f32, round: f32) -> Shape {
    let half = v3(x, y, z);
    Shape::Cuboid { half, round: round.min(half.min_element() * 0.99) }
}

fn cylinder(radius: f32, half: f32, round: f32) -> Shape {
    Shape::Cylinder { radius, half, round: round.min(radius.min(half) * 0.99) }
}

fn frustum(low: f32, high: f32, half: f32, round: f32) -> Shape {
    Shape::Frustum { low, high, half, round: round.min(low.min(high).min(half) * 0.9) }
}

fn prism(sides: u32, inradius: f32, half: f32, round: f32) -> Shape {
    Shape::Prism { sides, inradius, half, round }
}

fn stick(from: Vec3, to: Vec3, start: f32, end: f32) -> Shape {
    Shape::Stick { from, to, start, end }
}

/// A colour of rubber: mostly black, sometimes red or grey.
fn pick_rubber(draw: &mut Draw) -> Vec3 {
    let dark = draw.between(0.008, 0.04);
    draw.pick(&[Vec3::splat(dark), Vec3::splat(dark), Vec3::splat(0.15), Vec3::new(0.35, 0.03, 0.02)])
}
