//! A model: solids of parts joined, blended and cut, each part with its material. Millimetres, in the item's own frame.

use glam::{Mat3, Quat, Vec3};

use crate::material::Material;
use crate::noise;
use crate::shape::Shape;

/// How a part changes the solid that the parts before it make.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Operation {
    Join,
    /// Join with a fillet of about this radius, mm.
    Blend(f32),
    Cut,
    Meet,
}

/// A shape at its place.
#[derive(Debug, Clone)]
pub struct Part {
    shape: Shape,
    origin: Vec3,
    to_local: Mat3,
    material: u8,
    operation: Operation,
    /// A sphere that holds it; set when it joins a solid.
    centre: Vec3,
    radius: f32,
}

impl Part {
    /// A shape of a material, at the origin.
    #[must_use]
    pub fn new(shape: Shape, material: u8) -> Self {
        Self {
            shape,
            origin: Vec3::ZERO,
            to_local: Mat3::IDENTITY,
            material,
            operation: Operation::Join,
            centre: Vec3::ZERO,
            radius: f32::MAX,
        }
    }

    /// Moved to a place, mm.
    #[must_use]
    pub fn at(mut self, x: f32, y: f32, z: f32) -> Self {
        self.origin = Vec3::new(x, y, z);
        self
    }

    /// Turned around its own centre.
    #[must_use]
    pub fn turned(mut self, turn: Quat) -> Self {
        self.to_local = Mat3::from_quat(turn.inverse());
        self
    }

    /// With its axis along x instead of z.
    #[must_use]
    pub fn along_x(self) -> Self {
        self.turned(Quat::from_rotation_y(std::f32::consts::FRAC_PI_2))
    }

    /// With its axis along y instead of z.
    #[must_use]
    pub fn along_y(self) -> Self {
        self.turned(Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2))
    }

    fn distance(&self, p: Vec3) -> f32 {
        self.shape.distance(self.to_local * (p - self.origin))
    }

    fn bound(&self) -> (Vec3, f32) {
        let (centre, radius) = self.shape.bound();
        (self.origin + self.to_local.transpose() * centre, radius)
    }

    /// With its bounding sphere worked out.
    fn bounded(mut self) -> Self {
        (self.centre, self.radius) = self.bound();
        self
    }
}

/// Wrinkles of a surface: height and width in mm.
#[derive(Debug, Clone, Copy)]
struct Wrinkles {
    height: f32,
    width: f32,
    seed: u32,
}

/// Parts that make one body.
#[derive(Debug, Clone)]
pub struct Solid {
    parts: Vec<Part>,
    wrinkles: Option<Wrinkles>,
    centre: Vec3,
    radius: f32,
}

impl Solid {
    /// A solid that starts with one part.
    #[must_use]
    pub fn new(part: Part) -> Self {
        let part = part.bounded();
        let (centre, radius) = (part.centre, part.radius);
        Self { parts: vec![part], wrinkles: None, centre, radius }
    }

    fn grow(&mut self, part: &Part, fillet: f32) {
        let (centre, radius) = part.bound();
        let (radius, apart) = (radius + fillet * 0.25, centre.distance(self.centre));
        if apart + radius <= self.radius {
            return;
        }
        if apart + self.radius <= radius {
            (self.centre, self.radius) = (centre, radius);
            return;
        }
        let grown = (apart + radius + self.radius) / 2.0;
        self.centre += (centre - self.centre) * ((grown - self.radius) / apart);
        self.radius = grown;
    }

    /// Adds a part.
    #[must_use]
    pub fn join(mut self, part: Part) -> Self {
        self.grow(&part, 0.0);
        self.parts.push(part.bounded());
        self
    }

    /// Adds a part with a fillet, mm.
    #[must_use]
    pub fn blend(mut self, mut part: Part, fillet: f32) -> Self {
        self.grow(&part, fillet);
        part.operation = Operation::Blend(fillet.max(1e-3));
        self.parts.push(part.bounded());
        self
    }

    /// Takes a part away.
    #[must_use]
    pub fn cut(mut self, mut part: Part) -> Self {
        part.operation = Operation::Cut;
        self.parts.push(part.bounded());
        self
    }

    /// Keeps only what lies in this part, too.
    #[must_use]
    pub fn meet(mut self, mut part: Part) -> Self {
        part.operation = Operation::Meet;
        self.parts.push(part.bounded());
        self
    }

    /// Wrinkles of a height and a width, mm, as of cloth.
    #[must_use]
    pub fn wrinkled(mut self, height: f32, width: f32, seed: u32) -> Self {
        self.wrinkles = Some(Wrinkles { height, width, seed });
        self.radius += height;
        self
    }

    fn distance(&self, p: Vec3) -> f32 {
        let mut sum = f32::MAX;
        for part in &self.parts {
            // A part that is too far away to change the sum is not asked.
            let least = p.distance(part.centre) - part.radius;
            let idle = match part.operation {
                Operation::Join => least >= sum,
                Operation::Blend(fillet) => least >= sum + fillet,
                Operation::Cut => -least <= sum,
                Operation::Meet => false,
            };
            if idle {
                continue;
            }
            let d = part.distance(p);
            sum = match part.operation {
                Operation::Join => sum.min(d),
                Operation::Blend(fillet) => {
                    let overlap = (1.0 - (sum - d).abs() / fillet).max(0.0);
                    sum.min(d) - overlap * overlap * fillet * 0.25
                }
                Operation::Cut => sum.max(-d),
                Operation::Meet => sum.max(d),
            };
        }
        match self.wrinkles {
            // Far away the wrinkles do not matter; near by they make the distance field steeper.
            Some(w) if sum < 2.0 * w.height + 1.0 => {
                let bumps = noise::octaves_in_space(p / w.width, 2, w.seed) - 0.5;
                (sum + 2.0 * bumps * w.height) * 0.7
            }
            _ => sum,
        }
    }

    /// The material at a point on the surface: that of the part whose wall is nearest.
    fn material(&self, p: Vec3) -> u8 {
        let (mut best, mut material) = (f32::MAX, 0);
        for part in &self.parts {
            let d = part.distance(p);
            // A cut's wall wins a tie: it is what made the surface there.
            let d = if part.operation == Operation::Cut { d.abs() - 1e-3 } else { d };
            if d < best {
                (best, material) = (d, part.material);
            }
        }
        material
    }
}

/// A whole item in its own frame.
#[derive(Debug, Clone)]
pub struct Model {
    solids: Vec<Solid>,
    /// The materials that the parts name.
    pub materials: Vec<Material>,
    /// How it lies: the turn from the item's frame to one with z up, before it is let down on the floor.
    pub rest: Quat,
    /// How far it hangs above the floor, mm; 0 = it lies.
    pub lift: f32,
}

impl Default for Model {
    fn default() -> Self {
        Self { solids: Vec::new(), materials: Vec::new(), rest: Quat::IDENTITY, lift: 0.0 }
    }
}

impl Model {
    /// Adds a material and names it.
    pub fn paint(&mut self, material: Material) -> u8 {
        self.materials.push(material);
        (self.materials.len() - 1) as u8
    }

    /// Adds a body.
    pub fn add(&mut self, solid: Solid) {
        self.solids.push(solid);
    }

    /// Adds a body of one part.
    pub fn add_part(&mut self, part: Part) {
        self.add(Solid::new(part));
    }

    /// Adds all bodies of another model, turned and then moved.
    pub fn attach(&mut self, other: Self, turn: Quat, offset: Vec3) {
        let first = self.materials.len() as u8;
        let back = Mat3::from_quat(turn.inverse());
        self.materials.extend(other.materials);
        for mut solid in other.solids {
            for part in &mut solid.parts {
                part.origin = turn * part.origin + offset;
                part.to_local *= back;
                part.centre = turn * part.centre + offset;
                part.material += first;
            }
            solid.centre = turn * solid.centre + offset;
            self.solids.push(solid);
        }
    }

    /// Signed distance from a point, mm.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> f32 {
        let mut best = f32::MAX;
        for solid in &self.solids {
            if p.distance(solid.centre) - solid.radius < best {
                best = best.min(solid.distance(p));
            }
        }
        best
    }

    /// The material at a point on the surface.
    #[must_use]
    pub fn material(&self, p: Vec3) -> Option<&Material> {
        let mut nearest = (f32::MAX, None);
        for solid in &self.solids {
            if p.distance(solid.centre) - solid.radius < nearest.0 {
                let d = solid.distance(p);
                if d < nearest.0 {
                    nearest = (d, Some(solid));
                }
            }
        }
        self.materials.get(usize::from(nearest.1?.material(p)))
    }

    /// The outward normal at a point on the surface, from differences over `step` mm on a tetrahedron.
    #[must_use]
    pub fn normal(&self, p: Vec3, step: f32) -> Vec3 {
        const CORNERS: [Vec3; 4] = [
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::new(1.0, 1.0, 1.0),
        ];
        CORNERS
            .iter()
            .map(|&corner| corner * self.distance(p + corner * step))
            .sum::<Vec3>()
            .normalize_or(Vec3::Z)
    }

    /// A box that holds the model: lowest and highest corner, mm.
    #[must_use]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let mut low = Vec3::splat(f32::MAX);
        let mut high = Vec3::splat(f32::MIN);
        for part in self.solids.iter().flat_map(|s| &s.parts) {
            if matches!(part.operation, Operation::Join | Operation::Blend(_)) {
                let (centre, radius) = part.bound();
                low = low.min(centre - radius);
                high = high.max(centre + radius);
            }
        }
        (low - 1.0, high + 1.0)
    }
}
