//! Floors: procedural, seeded, with what factory floors collect (stains, cracks, paint, dust).
//!
//! A floor is a function of the place on it, so every picture cuts its own crop; `number` names the floor, and no two
//! floors share their parameters.

mod colour;
mod line;

use glam::{Vec2, Vec3};

use colour::{epoxy, tile_colour, wood_colour};
use line::PaintedLine;

use crate::material::{hsv, srgb};
use crate::noise::{cell, cells, octaves, plane};
use crate::random::Draw;

/// The seed of the catalogue of floors.
const CATALOGUE: u64 = 0x4E46_464C_4F4F_5231;

/// Kinds of floors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
pub enum Kind {
    /// Concrete: clouds, pores, cracks.
    Concrete,
    /// Epoxy resin, sometimes with flakes strewn in.
    Epoxy,
    /// Square tiles with grout.
    Tiles,
    /// Wooden boards.
    Wood,
    /// Steel plate with raised lenses.
    ChequerPlate,
    /// Rubber with round studs.
    RubberStuds,
    /// Asphalt: grains in bitumen.
    Asphalt,
    /// Stone chips, ground and polished.
    Terrazzo,
    /// Mottled sheet.
    Linoleum,
    /// Brushed steel.
    SteelSheet,
    /// One even colour.
    Plain,
    /// Squares of two colours.
    Checker,
    /// Carpet.
    Carpet,
    /// Paving stones in a running bond.
    Pavers,
    /// Pressed chips of wood.
    Chipboard,
}

/// Kinds that training may see, with how common they are.
pub const SEEN: [(Kind, f32); 12] = [
    (Kind::Concrete, 4.0),
    (Kind::Epoxy, 2.6),
    (Kind::Tiles, 1.8),
    (Kind::Wood, 1.8),
    (Kind::ChequerPlate, 0.8),
    (Kind::RubberStuds, 0.6),
    (Kind::Asphalt, 1.0),
    (Kind::Terrazzo, 0.8),
    (Kind::Linoleum, 1.0),
    (Kind::SteelSheet, 0.6),
    (Kind::Plain, 1.6),
    (Kind::Checker, 0.4),
];

/// Kinds that only the test by unseen floor shows.
pub const UNSEEN: [Kind; 3] = [Kind::Carpet, Kind::Pavers, Kind::Chipboard];

/// A floor at one point.
#[derive(Debug, Clone, Copy)]
pub struct FloorPoint {
    /// Linear colour.
    pub colour: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Metal or not.
    pub metal: bool,
    /// Slope of the surface.
    pub slope: Vec2,
}

/// A floor.
#[derive(Debug, Clone)]
pub struct Floor {
    /// What it is made of.
    pub kind: Kind,
    seed: u32,
    first: Vec3,
    second: Vec3,
    /// Size of its pattern, mm.
    size: f32,
    gap: f32,
    contrast: f32,
    roughness: f32,
    stains: f32,
    cracks: f32,
    dirt: f32,
    crumbs: f32,
    turn: Vec2,
    line: Option<PaintedLine>,
}

impl Floor {
    /// A floor of the catalogue, of a given kind.
    #[must_use]
    pub fn new(kind: Kind, number: u64) -> Self {
        let mut d = Draw::new(CATALOGUE, &[kind as u64, number]);
        let d = &mut d;
        let grey = |d: &mut Draw, low, high| {
            Vec3::splat(d.octave(low, high)) * Vec3::new(d.between(0.94, 1.08), 1.0, d.between(0.9, 1.06))
        };
        let (first, second, size, roughness) = match kind {
            Kind::Concrete => {
                (grey(d, 0.12, 0.5), grey(d, 0.06, 0.3), d.between(150.0, 600.0), d.between(0.35, 0.9))
            }
            Kind::Epoxy => (epoxy(d), grey(d, 0.1, 0.8), d.between(4.0, 16.0), d.between(0.08, 0.4)),
            Kind::Tiles => (tile_colour(d), grey(d, 0.04, 0.5), d.between(90.0, 600.0), d.between(0.1, 0.55)),
            Kind::Wood => (
                wood_colour(d),
                srgb(70, 42, 24) * d.between(0.5, 1.5),
                d.between(60.0, 190.0),
                d.between(0.25, 0.7),
            ),
            Kind::ChequerPlate => {
                (grey(d, 0.25, 0.6), grey(d, 0.4, 0.7), d.between(20.0, 36.0), d.between(0.25, 0.5))
            }
            Kind::RubberStuds => {
                (grey(d, 0.012, 0.09), grey(d, 0.02, 0.1), d.between(20.0, 40.0), d.between(0.5, 0.9))
            }
            Kind::Asphalt => (grey(d, 0.03, 0.12), grey(d, 0.12, 0.4), d.between(4.0, 9.0), 0.9),
            Kind::Terrazzo => (grey(d, 0.3, 0.65), tile_colour(d), d.between(8.0, 30.0), d.between(0.1, 0.4)),
            Kind::Linoleum => (tile_colour(d), tile_colour(d), d.between(10.0, 80.0), d.between(0.25, 0.6)),
            Kind::SteelSheet => {
                (grey(d, 0.3, 0.6), grey(d, 0.2, 0.4), d.between(300.0, 900.0), d.between(0.25, 0.55))
            }
            Kind::Plain | Kind::Checker => {
                let colour = if d.chance(0.7) {
                    grey(d, 0.03, 0.8)
                } else {
                    hsv(d.unit(), d.between(0.1, 0.6), d.between(0.2, 0.9))
                };
                (colour, grey(d, 0.05, 0.8), d.between(25.0, 300.0), d.between(0.15, 1.0))
            }
            Kind::Carpet => (
                hsv(d.unit(), d.between(0.0, 0.5), d.between(0.15, 0.6)),
                grey(d, 0.05, 0.3),
                d.between(2.5, 6.0),
                1.0,
            ),
            Kind::Pavers => (tile_colour(d), grey(d, 0.1, 0.3), d.between(60.0, 120.0), 0.85),
            Kind::Chipboard => (wood_colour(d), wood_colour(d), d.between(8.0, 25.0), 0.7),
        };
        let clean = d.chance(0.3);
        let worn = |d: &mut Draw, high: f32| if clean { 0.0 } else { d.between(0.0, high) };
        Self {
            kind,
            seed: d.seed(),
            first,
            second,
            size,
            gap: d.between(1.0, 6.0),
            contrast: d.between(0.3, 1.2),
            roughness,
            stains: worn(d, 1.0),
            cracks: if matches!(kind, Kind::Concrete | Kind::Asphalt | Kind::Epoxy) && d.chance(0.5) {
                worn(d, 1.0)
            } else {
                0.0
            },
            dirt: worn(d, 0.6),
            crumbs: if d.chance(0.3) { worn(d, 1.0) } else { 0.0 },
            turn: Vec2::from_angle(d.angle()),
            line: d.chance(0.16).then(|| PaintedLine::draw(d)),
        }
    }

    /// The floor at a place, mm. `footprint` is the size of a pixel there, mm: finer detail is left out.
    #[must_use]
    pub fn at(&self, place: Vec2, footprint: f32) -> FloorPoint {
        let p = self.turn.rotate(place);
        let mut point =
            FloorPoint { colour: self.first, roughness: self.roughness, metal: false, slope: Vec2::ZERO };
        match self.kind {
            Kind::Concrete => self.concrete(p, footprint, &mut point),
            Kind::Epoxy => self.epoxy(p, footprint, &mut point),
            Kind::Tiles => self.tiles(p, footprint, &mut point),
            Kind::Wood => self.wood(p, footprint, &mut point),
            Kind::ChequerPlate => self.chequer_plate(p, &mut point),
            Kind::RubberStuds => self.studs(p, &mut point),
            Kind::Asphalt | Kind::Terrazzo | Kind::Chipboard => self.grains(p, footprint, &mut point),
            Kind::Linoleum => {
                let mottle = octaves(p / self.size, 4, footprint / self.size, self.seed);
                point.colour =
                    self.first.lerp(self.second, ((mottle - 0.5) * self.contrast + 0.3).clamp(0.0, 0.6));
            }
            Kind::SteelSheet => {
                let lines = plane(Vec2::new(p.x * 0.01, p.y * 0.9), self.seed);
                point.colour *= 0.85 + 0.3 * lines;
                point.metal = true;
                point.roughness *= 0.8 + 0.4 * lines;
            }
            Kind::Plain => {}
            Kind::Checker => {
                let square = (p / self.size).floor();
                if (square.x + square.y).rem_euclid(2.0) > 0.5 {
                    point.colour = self.second;
                }
            }
            Kind::Carpet => {
                let tuft = plane(p / self.size, self.seed);
                point.colour = self.first * (0.6 + 0.7 * tuft);
                point.slope = self.bumps(p / self.size, 0.5);
            }
            Kind::Pavers => self.pavers(p, &mut point),
        }
        self.age(place, p, footprint, &mut point);
        point
    }

    fn bumps(&self, q: Vec2, height: f32) -> Vec2 {
        Vec2::new(plane(q, self.seed ^ 0x71) - 0.5, plane(q, self.seed ^ 0x72) - 0.5) * height
    }

    fn concrete(&self, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        let clouds = octaves(p / self.size, 5, footprint / self.size, self.seed);
        let grain = octaves(p / 5.0, 3, footprint / 5.0, self.seed ^ 1);
        let light = 1.0 + self.contrast * (1.1 * (clouds - 0.5) + 0.45 * (grain - 0.5));
        point.colour = self.first * light.max(0.2);
        if footprint < 4.0 {
            // Pores, on some of these floors, each of its own size.
            if self.gap > 4.0 && footprint < 2.0 {
                let (near, _, name) = cells(p / (9.0 + 6.0 * self.contrast), self.seed ^ 2);
                if name > 0.6 && near < 0.3 * (name - 0.55) {
                    point.colour *= 0.5 + 0.3 * self.contrast.min(1.0);
                }
            }
            point.slope = self.bumps(p / 3.0, 0.10 * self.contrast);
        }
        point.roughness = (self.roughness + 0.3 * (clouds - 0.5)).clamp(0.1, 1.0);
    }

    fn epoxy(&self, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        let clouds = octaves(p / 220.0, 3, footprint / 220.0, self.seed);
        point.colour *= 1.0 + 0.25 * (clouds - 0.5);
        // Flakes strewn into the resin, on half of these floors.
        if self.contrast > 0.75 && footprint < 0.6 * self.size {
            let (near, _, name) = cells(p / self.size, self.seed ^ 3);
            if near < 0.12 + 0.2 * name && name > 0.3 {
                point.colour = if name > 0.65 { self.second } else { self.first * 0.5 };
            }
        }
        point.slope = self.bumps(p / 60.0, 0.012);
    }

    fn tiles(&self, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        let q = p / self.size;
        let tile = q.floor();
        let inside = (q - tile) * self.size;
        let edge = inside.min(Vec2::splat(self.size) - inside).min_element();
        let name = cell(tile.x as i32, tile.y as i32, self.seed);
        let veins = octaves(p / 70.0 + name * 40.0, 4, footprint / 70.0, self.seed);
        point.colour = self.first * (1.0 + 0.18 * (name - 0.5) + 0.35 * self.contrast * (veins - 0.5));
        let grout = (1.0 - (edge - self.gap * 0.5) / footprint.max(0.4)).clamp(0.0, 1.0);
        point.colour = point.colour.lerp(self.second, grout);
        point.roughness += (0.9 - point.roughness) * grout;
    }

    fn wood(&self, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        let row = (p.y / self.size).floor();
        let shift = cell(row as i32, 5, self.seed) * 900.0;
        let board = ((p.x + shift) / 900.0).floor();
        let name = cell(row as i32, board as i32, self.seed ^ 4);
        let q = Vec2::new(p.x / 160.0 + 31.0 * name, p.y / 9.0 + 17.0 * name);
        let grain = octaves(q, 4, footprint / 30.0, self.seed);
        let rings =
            (0.5 + 0.5 * ((p.y * 0.05 + 3.0 * octaves(q * 0.25, 2, 0.0, self.seed ^ 6)) * 9.0).sin()) * 0.2;
        point.colour =
            self.first.lerp(self.second, (0.9 * (grain - 0.35) * self.contrast + rings).clamp(0.0, 0.85));
        point.colour *= 0.8 + 0.4 * name;
        let y = p.y - row * self.size;
        let x = p.x + shift - board * 900.0;
        let edge = y.min(self.size - y).min(x.min(900.0 - x));
        let seam = (1.0 - (edge - 0.5) / footprint.max(0.5)).clamp(0.0, 1.0);
        point.colour *= 1.0 - 0.75 * seam;
    }

    fn chequer_plate(&self, p: Vec2, point: &mut FloorPoint) {
        point.metal = true;
        let q = p / self.size;
        let tile = q.floor();
        let odd = (tile.x + tile.y).rem_euclid(2.0) > 0.5;
        let mut r = q - tile - 0.5;
        r = Vec2::from_angle(if odd { 0.785 } else { -0.785 }).rotate(r);
        // A lens-shaped bump: long along x.
        let d = (r.x / 0.52).powi(2) + (r.y / 0.15).powi(2);
        if d < 1.0 {
            let slope = Vec2::new(r.x / 0.27, r.y / 0.0225) * 0.11;
            point.slope =
                Vec2::from_angle(if odd { -0.785 } else { 0.785 }).rotate(slope.clamp_length_max(0.8));
            point.colour = self.second;
            point.roughness *= 0.8;
        }
        point.colour *= 0.8 + 0.4 * plane(p / 30.0, self.seed);
    }

    fn studs(&self, p: Vec2, point: &mut FloorPoint) {
        let q = p / self.size;
        let r = (q - q.floor() - 0.5) * 2.0;
        let d = r.length();
        if d < 0.62 {
            point.colour = self.second;
            let rim = ((d - 0.5) / 0.12).max(0.0);
            point.slope = r * rim * 0.9;
        }
        point.colour *= 0.8 + 0.4 * plane(p / 12.0, self.seed);
    }

    fn grains(&self, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        let fade = (1.3 - footprint / self.size).clamp(0.0, 1.0);
        if fade <= 0.0 {
            return;
        }
        let (near, second, name) = cells(p / self.size, self.seed);
        let chip = match self.kind {
            Kind::Asphalt => self.first.lerp(self.second, name * name) * (1.1 - 0.6 * near),
            Kind::Chipboard => self.first.lerp(self.second, name) * (0.7 + 0.6 * name),
            _ if second - near > 0.12 && near < 0.55 && name > 0.35 => {
                let tints = [self.second, Vec3::splat(0.05), Vec3::splat(0.7), self.first * 0.6];
                tints[(name * 97.0) as usize % 4]
            }
            _ => self.first,
        };
        point.colour = self.first.lerp(chip, fade);
        if self.kind == Kind::Asphalt {
            point.slope = self.bumps(p / self.size, 0.7 * fade);
        }
    }

    fn pavers(&self, p: Vec2, point: &mut FloorPoint) {
        let row = (p.y / self.size).floor();
        let x = p.x / (2.0 * self.size) + if row.rem_euclid(2.0) > 0.5 { 0.5 } else { 0.0 };
        let name = cell(row as i32, x.floor() as i32, self.seed);
        let (u, v) = ((x - x.floor()) * 2.0 * self.size, p.y - row * self.size);
        let edge = u.min(2.0 * self.size - u).min(v.min(self.size - v));
        point.colour = self.first * (0.65 + 0.7 * name) * (0.75 + 0.5 * plane(p / 4.0, self.seed));
        if edge < self.gap {
            point.colour = self.second * 0.5;
        }
        point.slope = self.bumps(p / 5.0, 0.3);
    }

    /// Stains, cracks, dust, crumbs and painted lines.
    fn age(&self, place: Vec2, p: Vec2, footprint: f32, point: &mut FloorPoint) {
        if let Some(line) = &self.line {
            line.paint(place, footprint, self.seed, point);
        }
        if self.stains > 0.0 {
            let blot = octaves(p / 130.0, 4, footprint / 130.0, self.seed ^ 0x31);
            let stain = ((blot - 0.72 + 0.16 * self.stains) * 12.0).clamp(0.0, 1.0);
            point.colour *= 1.0 - 0.5 * stain * self.stains;
            point.roughness += (0.25 - point.roughness) * stain * 0.4;
        }
        if self.cracks > 0.0 {
            let ridge = (octaves(p / 260.0, 4, footprint / 260.0, self.seed ^ 0x32) - 0.5).abs();
            let mask = plane(p / 500.0, self.seed ^ 0x33);
            if mask > 0.75 - 0.4 * self.cracks {
                let line = (1.0 - ridge * 260.0 / (1.1 + footprint)).clamp(0.0, 1.0);
                point.colour *= 1.0 - 0.7 * line;
            }
        }
        if self.dirt > 0.0 {
            let dust = octaves(p / 60.0, 4, footprint / 60.0, self.seed ^ 0x34);
            let film = (self.dirt * (dust - 0.2)).clamp(0.0, 0.6);
            point.colour = point.colour.lerp(Vec3::new(0.23, 0.21, 0.18), film * 0.6);
            point.roughness += (0.9 - point.roughness) * film;
            let scratch = plane(Vec2::new(p.x * 0.012 + p.y * 0.004, p.y * 1.1), self.seed ^ 0x35);
            if scratch > 0.93 && footprint < 1.5 {
                point.colour *= 1.25;
            }
        }
        if self.crumbs > 0.0 && footprint < 2.0 {
            let (near, _, name) = cells(p / 26.0, self.seed ^ 0x36);
            if near < 0.055 && name < self.crumbs * 0.6 {
                point.colour = if name < 0.2 { Vec3::splat(0.03) } else { srgb(150, 130, 105) };
            }
        }
        point.colour = point.colour.clamp(Vec3::splat(0.003), Vec3::splat(0.92));
        point.roughness = point.roughness.clamp(0.05, 1.0);
    }
}
