//! The renderer: sphere tracing of models over a floor, with soft light from a surround, lamps with soft shadows, glossy
//! reflections, and the laser's sheet. Linear colours out, and which object every pixel shows.

use glam::{Vec2, Vec3};

use crate::camera::Camera;
use crate::floor::{Floor, FloorPoint};
use crate::laser::Laser;
use crate::light::Light;
use crate::noise;
use crate::placed::Placed;
use crate::visible::{Tally, Visible, frame_of};

/// Everything that a picture shows.
#[derive(Debug)]
pub struct Stage {
    /// The camera.
    pub camera: Camera,
    /// The light.
    pub light: Light,
    /// The floor.
    pub floor: Floor,
    /// The things on it.
    pub objects: Vec<Placed>,
    /// The laser, if it is on.
    pub laser: Option<Laser>,
}

/// A rendered picture: linear light, the laser's light apart (it blooms), and what is visible of every object.
#[derive(Debug)]
pub struct Rendering {
    /// Linear colour, row by row.
    pub colour: Vec<Vec3>,
    /// Light of the laser in every pixel; empty when the laser is off.
    pub laser: Vec<f32>,
    /// One entry an object, in the order of [`Stage::objects`].
    pub visible: Vec<Visible>,
    /// For every pixel the object that it shows, from 1, or 0.
    pub owner: Vec<u8>,
}

/// Where the samples of an edge pixel lie: a rotated grid.
const SAMPLES: [(f32, f32); 4] = [(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)];
/// Every how many pixels the soft light on the floor is worked out.
const LATTICE: usize = 3;
/// How many lamps a light has at most.
const LAMPS: usize = 6;
/// A lamp that fills more, rad, has shadows so soft that neighbouring pixels may share them.
const SOFT_LAMP: f32 = 0.1;
/// Points whose normals differ less (cosine) share their soft light with a neighbour.
const ALIKE: f32 = 0.965;
/// Tangent of half the angle of the cones that gather soft light.
const CONE: f32 = 0.62;

/// Light that reaches a point: what neighbours may share.
#[derive(Debug, Clone, Copy)]
struct Shade {
    /// From the surround, the floor and other things.
    around: Vec3,
    /// How much of every lamp.
    lamps: [f32; LAMPS],
}

impl Shade {
    fn lerp(&self, other: &Self, t: f32) -> Self {
        let mut lamps = self.lamps;
        for (mine, theirs) in lamps.iter_mut().zip(other.lamps) {
            *mine += (theirs - *mine) * t;
        }
        Self { around: self.around.lerp(other.around, t), lamps }
    }
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    colour: Vec3,
    laser: f32,
    owner: u8,
    distance: f32,
    normal: Vec3,
    shade: Shade,
    /// Whether `shade` was worked out: bare metal needs none.
    matt: bool,
    /// Bits of the objects on this line of sight, hidden or not.
    along: u32,
    /// Something thin passes close by: more samples are needed.
    close: bool,
}

struct Renderer<'a> {
    stage: &'a Stage,
    /// Rectangle of every object in the picture: nothing of it lies outside.
    frames: Vec<[f32; 4]>,
    lattice: Vec<Shade>,
    lattice_width: usize,
    open_sky: Vec3,
    ground: Vec3,
}

/// Renders a stage.
#[must_use]
pub fn render(stage: &Stage) -> Rendering {
    let mut renderer = Renderer::new(stage);
    renderer.prepare_floor();
    renderer.run()
}

/// The hemisphere around a normal in six cones: direction and share.
fn cones(normal: Vec3) -> [(Vec3, f32); 6] {
    let (u, v) = normal.any_orthonormal_pair();
    let slanted = |turn: f32| {
        let side = u * (turn * 1.2566).cos() + v * (turn * 1.2566).sin();
        ((normal * 0.55 + side * 0.835).normalize(), 0.15)
    };
    [(normal, 0.25), slanted(0.0), slanted(1.0), slanted(2.0), slanted(3.0), slanted(4.0)]
}

/// The share of light that a glossy surface reflects (Karis 2014, an approximation of GGX's integral).
fn gloss(f0: Vec3, roughness: f32, facing: f32) -> Vec3 {
    let r =
        glam::Vec4::new(-1.0, -0.0275, -0.572, 0.022) * roughness + glam::Vec4::new(1.0, 0.0425, 1.04, -0.04);
    let a = (r.x * r.x).min((-9.28 * facing).exp2()) * r.x + r.y;
    f0 * (-1.04 * a + r.z) + Vec3::splat(1.04 * a + r.w)
}

impl<'a> Renderer<'a> {
    fn new(stage: &'a Stage) -> Self {
        let frames = stage.objects.iter().map(|object| frame_of(&stage.camera, object)).collect();
        let mut renderer = Self {
            stage,
            frames,
            lattice: Vec::new(),
            lattice_width: 0,
            open_sky: Vec3::ZERO,
            ground: Vec3::ZERO,
        };
        renderer.open_sky = cones(Vec3::Z).iter().map(|(d, w)| stage.light.surround(*d) * *w).sum();
        let lamps: Vec3 =
            stage.light.lamps.iter().map(|lamp| lamp.strength * lamp.direction.z.max(0.0)).sum();
        let middle = stage.floor.at(Vec2::ZERO, 50.0).colour;
        renderer.ground = middle * (renderer.open_sky + lamps * 0.8);
        renderer
    }

    /// Objects near enough to a point to shade it.
    fn neighbours(&self, p: Vec3) -> u32 {
        let mut bits = 0;
        for (index, object) in self.stage.objects.iter().enumerate() {
            let reach = object.radius + (1.3 * object.radius).clamp(12.0, 260.0);
            bits |= u32::from(p.distance_squared(object.centre) < reach * reach) << index;
        }
        bits
    }

    fn chosen(&self, bits: u32) -> impl Iterator<Item = &Placed> {
        self.stage
            .objects
            .iter()
            .enumerate()
            .filter(move |(index, _)| bits >> index & 1 == 1)
            .map(|(_, object)| object)
    }

    /// Soft light that reaches a point with a normal, from the surround, the floor and other things.
    fn soft_light(&self, p: Vec3, normal: Vec3, bits: u32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (toward, share) in cones(normal) {
            let mut open = 1.0_f32;
            let mut bounce = Vec3::ZERO;
            for object in self.chosen(bits) {
                let one = object.open(p, toward, CONE);
                open *= one;
                bounce += object.colour * (1.0 - one);
            }
            let far = if toward.z < 0.0 {
                // Under things the floor is darker.
                let shade = if bits == 0 { 1.0 } else { 0.35 + 0.65 * (p.z / 25.0).clamp(0.0, 1.0) };
                self.ground * shade
            } else {
                self.stage.light.surround(toward)
            };
            sum += (far * open + bounce * self.open_sky * 0.35 * (1.0 - open)) * share;
        }
        sum
    }

    /// How much of every lamp reaches a point; `wanted` chooses which lamps are worked out.
    fn lamps_open(&self, p: Vec3, normal: Vec3, open: &mut [f32; LAMPS], wanted: impl Fn(f32) -> bool) {
        for (lamp, open) in self.stage.light.lamps.iter().zip(open) {
            let width = lamp.radius().max(0.012);
            if !wanted(width) {
                continue;
            }
            *open = 0.0;
            if normal.dot(lamp.direction) > -0.3 {
                *open = 1.0;
                let start = p + normal * 0.3;
                for object in &self.stage.objects {
                    *open *= object.open(start, lamp.direction, width);
                    if *open < 0.01 {
                        break;
                    }
                }
            }
        }
    }

    /// Light of the lamps on a matt surface.
    fn lamp_light(&self, normal: Vec3, soft: f32, open: &[f32; LAMPS]) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (lamp, open) in self.stage.light.lamps.iter().zip(open) {
            let facing = (normal.dot(lamp.direction) + soft * 0.5) / (1.0 + soft * 0.5);
            sum += lamp.strength * (facing.max(0.0) * open);
        }
        sum
    }

    /// What a glossy surface reflects: surround, lamps, the floor, or other things.
    fn reflection(&self, p: Vec3, toward: Vec3, roughness: f32, bits: u32) -> Vec3 {
        let mut open = 1.0_f32;
        let mut bounce = Vec3::ZERO;
        for object in self.chosen(bits) {
            let one = object.open(p, toward, 0.08 + 0.7 * roughness * roughness);
            open *= one;
            bounce += object.colour * (1.0 - one);
        }
        let far = if toward.z < -0.02 {
            let run = p.z / -toward.z;
            let place = (p + toward * run).truncate();
            let footprint = 0.5 + run * (0.02 + roughness);
            let shade = if bits == 0 { 1.0 } else { 0.3 + 0.7 * (run / 40.0).clamp(0.0, 1.0) };
            let colour =
                if footprint < 60.0 { self.stage.floor.at(place, footprint).colour } else { Vec3::ZERO };
            let lit = if footprint < 60.0 {
                colour / self.stage.floor.at(Vec2::ZERO, 50.0).colour.max(Vec3::splat(0.01))
            } else {
                Vec3::ONE
            };
            self.ground * lit.min(Vec3::splat(3.0)) * shade
        } else {
            self.stage.light.reflected(toward, roughness)
        };
        far * open + bounce * self.open_sky * 0.4 * (1.0 - open)
    }

    fn prepare_floor(&mut self) {
        let (width, height) = self.stage.camera.size;
        self.lattice_width = width / LATTICE + 2;
        let rows = height / LATTICE + 2;
        let mut lattice = Vec::with_capacity(self.lattice_width * rows);
        for row in 0..rows {
            for column in 0..self.lattice_width {
                let ray = self.stage.camera.ray((column * LATTICE) as f32, (row * LATTICE) as f32);
                let mut shade = Shade { around: self.open_sky, lamps: [1.0; LAMPS] };
                if ray.z < -0.01 {
                    let p = self.stage.camera.position - ray * (self.stage.camera.position.z / ray.z);
                    let bits = self.neighbours(p);
                    if bits != 0 {
                        shade.around = self.soft_light(p, Vec3::Z, bits);
                    }
                    self.lamps_open(p, Vec3::Z, &mut shade.lamps, |width| width > SOFT_LAMP);
                }
                lattice.push(shade);
            }
        }
        self.lattice = lattice;
    }

    fn lattice_shade(&self, x: f32, y: f32) -> Shade {
        let (u, v) = ((x / LATTICE as f32).max(0.0), (y / LATTICE as f32).max(0.0));
        let (column, row) = (u as usize, v as usize);
        let (s, t) = (u - column as f32, v - row as f32);
        let at = |c: usize, r: usize| &self.lattice[(r * self.lattice_width + c).min(self.lattice.len() - 1)];
        let upper = at(column, row).lerp(at(column + 1, row), s);
        upper.lerp(&at(column, row + 1).lerp(at(column + 1, row + 1), s), t)
    }

    fn floor_colour(&self, p: Vec3, ray: Vec3, x: f32, y: f32) -> Vec3 {
        let distance = p.distance(self.stage.camera.position);
        let footprint = distance * self.stage.camera.spread() / (-ray.z).max(0.15).sqrt();
        let FloorPoint { colour, roughness, metal, slope } = self.stage.floor.at(p.truncate(), footprint);
        let normal = Vec3::new(-slope.x, -slope.y, 1.0).normalize();
        let mut shade = self.lattice_shade(x, y);
        self.lamps_open(p, Vec3::Z, &mut shade.lamps, |width| width <= SOFT_LAMP);
        let light = shade.around + self.lamp_light(normal, 0.0, &shade.lamps);
        let facing = normal.dot(-ray).max(0.02);
        let f0 = if metal { colour } else { Vec3::splat(0.04) };
        let toward = ray - normal * (2.0 * ray.dot(normal));
        let toward = Vec3::new(toward.x, toward.y, toward.z.abs().max(0.02)).normalize();
        let bits = if roughness < 0.5 { self.neighbours(p) } else { 0 };
        let shine =
            gloss(f0, roughness, facing) * self.reflection(p + Vec3::Z * 0.2, toward, roughness, bits);
        let shaded = (shade.around / self.open_sky.max(Vec3::splat(1e-3))).min(Vec3::ONE);
        (if metal { Vec3::ZERO } else { colour * light }) + shine * (0.4 + 0.6 * shaded)
    }

    /// Colours a sample that shows an object. `alike` is a sample near by with soft light to share.
    fn colour_object(
        &self,
        sample: &mut Sample,
        object: &Placed,
        p: Vec3,
        ray: Vec3,
        alike: Option<&Sample>,
    ) {
        let local = object.local(p);
        let step = (0.6 * sample.distance * self.stage.camera.spread()).clamp(0.03, 2.0);
        let flat = object.turned(object.model.normal(local, step));
        sample.normal = flat;
        let Some(material) = object.model.material(local) else { return };
        let surface = material.at(local);
        let mut normal = (flat + object.turned(surface.tilt)).normalize_or(flat);
        if normal.dot(ray) > -0.05 {
            // Bumps must not turn a surface away from who looks at it.
            normal = (normal - ray * (normal.dot(ray) + 0.05)).normalize_or(flat);
        }
        let above = p + flat * (0.4 + step * 0.5);
        let bits = self.neighbours(p);
        let facing = (-normal.dot(ray)).max(0.02);
        let toward = ray - normal * (2.0 * ray.dot(normal));
        let f0 = if surface.metal { surface.colour } else { Vec3::splat(0.04) };
        sample.colour =
            gloss(f0, surface.roughness, facing) * self.reflection(above, toward, surface.roughness, bits);
        if surface.metal {
            return;
        }
        match alike
            .filter(|other| other.owner == sample.owner && other.normal.dot(flat) > ALIKE && other.matt)
        {
            Some(other) => {
                sample.shade = other.shade;
                self.lamps_open(above, flat, &mut sample.shade.lamps, |width| width <= SOFT_LAMP);
            }
            None => {
                sample.shade.around = self.soft_light(above, flat, bits);
                self.lamps_open(above, flat, &mut sample.shade.lamps, |_| true);
            }
        }
        sample.matt = true;
        let light = sample.shade.around + self.lamp_light(normal, surface.soft, &sample.shade.lamps);
        sample.colour += surface.colour * light;
    }

    /// Light of the laser on a point, if its sheet hits it and nothing stands between.
    fn laser_light(&self, p: Vec3, normal: Vec3, footprint: f32) -> f32 {
        let Some(laser) = &self.stage.laser else { return 0.0 };
        let light = laser.at(p, normal, footprint);
        if light < 1e-3 {
            return 0.0;
        }
        let toward = laser.origin - p;
        let far = toward.length();
        let start = p + normal * 0.8;
        let free =
            self.stage.objects.iter().all(|o| o.trace(start, toward / far, 0.0005).0.is_none_or(|t| t > far));
        if free { light } else { 0.0 }
    }

    fn sample(&self, x: f32, y: f32, alike: Option<&Sample>) -> Sample {
        let camera = &self.stage.camera;
        let ray = camera.ray(x, y);
        let (mut nearest, mut owner, mut along, mut close) = (f32::MAX, 0, 0_u32, false);
        for (index, object) in self.stage.objects.iter().enumerate() {
            let [left, top, right, bottom] = self.frames[index];
            if x < left || x > right || y < top || y > bottom {
                continue;
            }
            let (hit, miss) = object.trace(camera.position, ray, camera.spread());
            match hit {
                Some(t) => {
                    along |= 1 << index;
                    if t < nearest {
                        (nearest, owner) = (t, index + 1);
                    }
                }
                None => close |= miss < 0.6 * camera.spread(),
            }
        }
        let floor = if ray.z < -0.004 { -camera.position.z / ray.z } else { f32::MAX };
        let mut sample = Sample {
            colour: Vec3::ZERO,
            laser: 0.0,
            owner: owner as u8,
            distance: nearest,
            normal: Vec3::Z,
            shade: Shade { around: Vec3::ZERO, lamps: [1.0; LAMPS] },
            matt: false,
            along,
            close,
        };
        if owner > 0 && nearest < floor {
            let p = camera.position + ray * nearest;
            self.colour_object(&mut sample, &self.stage.objects[owner - 1], p, ray, alike);
            sample.laser = self.laser_light(p, sample.normal, nearest * camera.spread());
        } else if floor < 40_000.0 {
            sample.owner = 0;
            sample.distance = floor;
            let p = camera.position + ray * floor;
            sample.colour = self.floor_colour(p, ray, x, y);
            sample.laser = self.laser_light(p, Vec3::Z, floor * camera.spread());
        } else {
            sample.owner = 0;
            sample.colour = self.backdrop(ray);
        }
        sample
    }

    /// What is beyond the floor: walls and shelves, out of focus.
    fn backdrop(&self, ray: Vec3) -> Vec3 {
        let azimuth = ray.y.atan2(ray.x);
        let columns = noise::plane(Vec2::new(azimuth * 9.0, ray.z * 14.0), 77);
        let walls = noise::plane(Vec2::new(azimuth * 2.0, ray.z * 2.0), 78);
        self.stage.light.surround(ray) * (0.25 + 0.5 * columns + 0.4 * walls)
    }

    fn run(&self) -> Rendering {
        let (width, height) = self.stage.camera.size;
        let mut samples: Vec<Sample> = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                // Squares of two by two pixels share the soft light of their first one.
                let alike = match (x % 2, y % 2) {
                    (1, _) => Some(samples[y * width + x - 1]),
                    (0, 1) => Some(samples[(y - 1) * width + x]),
                    _ => None,
                };
                samples.push(self.sample(x as f32 + 0.5, y as f32 + 0.5, alike.as_ref()));
            }
        }
        let mut tally = Tally::new(self.stage.objects.len());
        let mut colour = Vec::with_capacity(samples.len());
        let mut laser = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let centre = &samples[y * width + x];
                if self.is_edge(&samples, x, y) {
                    let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
                    let extra = SAMPLES.map(|(dx, dy)| self.sample(u + dx, v + dy, Some(centre)));
                    // Bright points are tamed, or the edge of a lamp's reflection would stay jagged.
                    let tame = |c: Vec3| c.min(Vec3::splat(4.0));
                    let sum = extra.iter().map(|s| tame(s.colour)).sum::<Vec3>() + tame(centre.colour);
                    colour.push(sum / 5.0);
                    laser.push((extra.iter().map(|s| s.laser).sum::<f32>() + centre.laser) / 5.0);
                    let all = [&extra[0], &extra[1], &extra[2], &extra[3], centre];
                    tally.add(x, y, &all.map(|s| (s.owner, s.along)));
                } else {
                    colour.push(centre.colour);
                    laser.push(centre.laser);
                    tally.add(x, y, &[(centre.owner, centre.along)]);
                }
            }
        }
        if self.stage.laser.is_none() {
            laser.clear();
        }
        Rendering { colour, laser, visible: tally.finish(), owner: samples.iter().map(|s| s.owner).collect() }
    }

    /// Does the pixel differ from a neighbour so much that one sample is not enough?
    fn is_edge(&self, samples: &[Sample], x: usize, y: usize) -> bool {
        let (width, height) = self.stage.camera.size;
        let here = &samples[y * width + x];
        if here.close {
            return true;
        }
        let differs = |other: &Sample| {
            other.owner != here.owner
                || (here.owner > 0
                    && ((other.distance - here.distance).abs() > 0.02 * here.distance
                        || other.normal.dot(here.normal) < 0.75
                        || (other.colour - here.colour).abs().max_element() > 0.35))
        };
        (x > 0 && differs(&samples[y * width + x - 1]))
            || (x + 1 < width && differs(&samples[y * width + x + 1]))
            || (y > 0 && differs(&samples[(y - 1) * width + x]))
            || (y + 1 < height && differs(&samples[(y + 1) * width + x]))
    }
}
