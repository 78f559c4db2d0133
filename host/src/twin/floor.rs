//! Floors: the colour of every place of the floor as a pure function of a seed, or from a picture.

use super::material::LinearColour;
use super::random::{lattice, scramble, unit};
use super::scene::{Floor, FloorImage, FloorKind, PaintedLine};

/// A floor's colours.
#[derive(Debug, Clone)]
pub struct FloorTexture {
    kind: FloorKind,
    image: Option<FloorImage>,
    paint: Vec<PaintedLine>,
    shift: [f64; 2],
    seed: u64,
}

/// How a paint's edge is frayed, millimetres.
const FRAY_MM: f64 = 1.2;
/// Side of a tile and width of the grout between, millimetres.
const TILE_MM: f64 = 300.0;
const GROUT_MM: f64 = 4.0;
/// Width and length of a plank, millimetres.
const PLANK_MM: (f64, f64) = (118.0, 1100.0);

impl FloorTexture {
    /// The same floor and seed give the same colours for ever.
    #[must_use]
    pub fn new(floor: &Floor, seed: u64) -> Self {
        let seed = scramble(seed ^ 0x0066_6C6F_6F72);
        let (image, paint) = (floor.image.clone(), floor.paint.clone());
        Self { kind: floor.kind, image, paint, shift: floor.shift_mm, seed }
    }

    /// Mean colour of a floor without its paint, linear sRGB.
    #[must_use]
    pub fn mean_of(floor: &Floor) -> LinearColour {
        let picture = floor.image.as_ref().and_then(|image| image.texture.as_ref());
        picture.map_or_else(|| Self::mean_albedo(floor.kind), |picture| picture.mean())
    }

    /// Mean colour of a floor kind, linear sRGB.
    #[must_use]
    pub const fn mean_albedo(kind: FloorKind) -> LinearColour {
        match kind {
            FloorKind::Concrete => [0.358, 0.348, 0.323],
            FloorKind::ConcreteDark => [0.126, 0.125, 0.120],
            FloorKind::Tiles => [0.500, 0.490, 0.472],
            FloorKind::EpoxyGrey => [0.273, 0.282, 0.290],
            FloorKind::EpoxyGreen => [0.064, 0.204, 0.121],
            FloorKind::EpoxyRed => [0.290, 0.060, 0.045],
            FloorKind::Wood => [0.390, 0.272, 0.178],
            FloorKind::Rubber => [0.045, 0.045, 0.046],
        }
    }

    /// Colour of the place `along`, `across` (millimetres); details finer than `footprint` millimetres fade out,
    /// because a pixel averages over them.
    #[must_use]
    pub fn albedo(&self, along: f64, across: f64, footprint: f64) -> LinearColour {
        let (along, across) = (along - self.shift[0], across - self.shift[1]);
        let ground = self.ground(along, across, footprint);
        self.paint.iter().fold(ground, |under, line| {
            let cover = self.cover(line, along, across, footprint);
            let wear = 1.0 - 0.12 * self.noise(7, along, across, 9.0, footprint).max(0.0) as f32;
            std::array::from_fn(|c| under[c] + cover * (line.colour[c] * wear - under[c]))
        })
    }

    fn ground(&self, along: f64, across: f64, footprint: f64) -> LinearColour {
        if let Some(FloorImage { width_mm, texture: Some(texture), .. }) = &self.image {
            return texture.colour(along / width_mm, -across / width_mm, footprint / width_mm);
        }
        let mean = Self::mean_albedo(self.kind);
        match self.kind {
            FloorKind::Concrete | FloorKind::ConcreteDark => {
                shade(mean, self.concrete(along, across, footprint))
            }
            FloorKind::Tiles => self.tiles(mean, along, across, footprint),
            FloorKind::Wood => self.wood(mean, along, across, footprint),
            FloorKind::EpoxyGrey | FloorKind::EpoxyGreen | FloorKind::EpoxyRed => {
                let cloud = 0.05 * self.noise(1, along, across, 180.0, footprint);
                let flake = self.noise(2, along, across, 2.2, footprint);
                shade(mean, 1.0 + cloud + 0.10 * (flake - 0.55).max(0.0))
            }
            FloorKind::Rubber => {
                let grain = 0.20 * self.noise(1, along, across, 1.6, footprint);
                shade(mean, 1.0 + grain + 0.1 * self.noise(2, along, across, 60.0, footprint))
            }
        }
    }

    fn concrete(&self, along: f64, across: f64, footprint: f64) -> f64 {
        let cloud = 0.16 * self.noise(1, along, across, 130.0, footprint)
            + 0.10 * self.noise(2, along, across, 35.0, footprint)
            + 0.07 * self.noise(3, along, across, 9.0, footprint)
            + 0.06 * self.noise(4, along, across, 1.7, footprint);
        let blot = self.noise(5, along, across, 210.0, footprint)
            + 0.45 * self.noise(6, along, across, 50.0, footprint)
            + 0.25 * self.noise(8, along, across, 12.0, footprint);
        let stain = 1.0 - 0.42 * smooth_step(0.55, 0.68, blot);
        let bend = 22.0 * self.noise(9, along, across, 90.0, footprint)
            + 5.0 * self.noise(10, along, across, 14.0, footprint);
        let ridge = self.noise(11, along + bend, across - bend, 420.0, footprint).abs() * 420.0;
        let crack = 1.0 - 0.55 * (1.0 - smooth_step(0.4, 0.9 + 0.6 * footprint, ridge / 1.6));
        (1.0 + cloud) * stain * crack
    }

    fn tiles(&self, mean: LinearColour, along: f64, across: f64, footprint: f64) -> LinearColour {
        let (x, y) = (along / TILE_MM + 0.37, across / TILE_MM + 0.41);
        let tint = 0.06 * (unit(lattice(self.seed ^ 21, x.floor() as i64, y.floor() as i64)) - 0.5);
        let from_edge = |t: f64| (t - t.round()).abs() * TILE_MM;
        let edge = from_edge(x).min(from_edge(y));
        let grout =
            1.0 - smooth_step(GROUT_MM / 2.0 - footprint / 2.0, GROUT_MM / 2.0 + 0.4 + footprint / 2.0, edge);
        let cloud = 0.05 * self.noise(1, along, across, 60.0, footprint)
            + 0.03 * self.noise(2, along, across, 12.0, footprint);
        shade(mean, (1.0 + tint + cloud) * (1.0 - 0.72 * grout))
    }

    fn wood(&self, mean: LinearColour, along: f64, across: f64, footprint: f64) -> LinearColour {
        let plank = (across / PLANK_MM.0).floor();
        let shift = unit(lattice(self.seed ^ 31, plank as i64, 0)) * PLANK_MM.1;
        let board = ((along + shift) / PLANK_MM.1).floor();
        let tint = 0.30 * (unit(lattice(self.seed ^ 32, plank as i64, board as i64)) - 0.5);
        let grain = 0.12 * self.noise(1, along / 14.0, across, 5.0, footprint)
            + 0.08 * self.noise(2, along / 30.0, across, 1.4, footprint);
        let edge_across = (across / PLANK_MM.0 - (across / PLANK_MM.0).round()).abs() * PLANK_MM.0;
        let edge_along =
            ((along + shift) / PLANK_MM.1 - ((along + shift) / PLANK_MM.1).round()).abs() * PLANK_MM.1;
        let joint = 1.0 - smooth_step(0.6, 1.2 + footprint, edge_across.min(edge_along));
        shade(mean, (1.0 + tint + grain) * (1.0 - 0.6 * joint))
    }

    fn cover(&self, line: &PaintedLine, along: f64, across: f64, footprint: f64) -> f32 {
        let (sine, cosine) = line.angle_degrees.to_radians().sin_cos();
        let from_middle = (cosine * (across - line.across_mm) - sine * (along - line.along_mm)).abs();
        let frayed = from_middle + FRAY_MM * 0.5 * self.noise(12, along, across, 3.0, footprint);
        let soft = 0.4 + footprint / 2.0;
        (1.0 - smooth_step(line.width_mm / 2.0 - soft, line.width_mm / 2.0 + soft, frayed)) as f32
    }

    /// Smooth noise of the given grain, about -1..1, faded out where the grain is finer than the footprint.
    fn noise(&self, layer: u64, x: f64, y: f64, grain: f64, footprint: f64) -> f64 {
        let strength = (1.5 - footprint / grain).clamp(0.0, 1.0);
        if strength == 0.0 {
            return 0.0;
        }
        let (x, y) = (x / grain, y / grain);
        let (column, row) = (x.floor(), y.floor());
        let (s, t) = (ease(x - column), ease(y - row));
        let seed = self.seed.wrapping_add(layer.wrapping_mul(0x9E37_79B9));
        let corner = |i: f64, j: f64| unit(lattice(seed, (column + i) as i64, (row + j) as i64));
        let top = corner(0.0, 0.0) * (1.0 - s) + corner(1.0, 0.0) * s;
        let bottom = corner(0.0, 1.0) * (1.0 - s) + corner(1.0, 1.0) * s;
        strength * (2.0 * (top * (1.0 - t) + bottom * t) - 1.0)
    }
}

fn shade(colour: LinearColour, factor: f64) -> LinearColour {
    colour.map(|share| (share * factor.max(0.05) as f32).min(0.95))
}

fn ease(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

fn smooth_step(low: f64, high: f64, value: f64) -> f64 {
    ease(((value - low) / (high - low)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_floor_has_about_its_mean_colour() {
        for kind in FloorKind::ALL {
            let texture = FloorTexture::new(&Floor { kind, paint: Vec::new(), ..Floor::default() }, 5);
            let mut sum = [0.0_f64; 3];
            for i in 0..4000 {
                let colour = texture.albedo(f64::from(i % 80) * 13.7, f64::from(i / 80) * 17.3, 1.0);
                (0..3).for_each(|c| sum[c] += f64::from(colour[c]) / 4000.0);
            }
            for (c, mean) in FloorTexture::mean_albedo(kind).into_iter().enumerate() {
                assert!((sum[c] / f64::from(mean) - 1.0).abs() < 0.2, "{kind:?}: {sum:?}");
            }
        }
    }

    #[test]
    fn paint_covers_its_width_and_nothing_more() {
        let line = PaintedLine {
            colour: [0.6, 0.05, 0.04],
            along_mm: 30.0,
            across_mm: 0.0,
            width_mm: 75.0,
            angle_degrees: 90.0,
        };
        let painted =
            FloorTexture::new(&Floor { kind: FloorKind::Concrete, paint: vec![line], ..Floor::default() }, 5);
        let bare =
            FloorTexture::new(&Floor { kind: FloorKind::Concrete, paint: Vec::new(), ..Floor::default() }, 5);
        for across in [-400.0, 0.0, 250.0] {
            assert!(painted.albedo(30.0 + 30.0, across, 1.0)[1] < 0.06, "inside");
            assert_eq!(painted.albedo(30.0 + 42.0, across, 1.0), bare.albedo(30.0 + 42.0, across, 1.0));
        }
    }

    #[test]
    fn seeds_make_different_floors_and_the_same_seed_the_same() {
        let floor = Floor::default();
        let colour = |seed| FloorTexture::new(&floor, seed).albedo(123.0, 45.0, 1.0);
        assert_eq!(colour(1), colour(1));
        assert_ne!(colour(1), colour(2));
    }
}
