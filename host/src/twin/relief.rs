//! A floor that is not level: gentle waves, whose height is a pure function of the place and a seed.
//!
//! The sheet of light then meets the floor nearer or farther than on a level one, so that the stripe bends as it does in a
//! real hall. Waves are so flat ([`STEEPEST`]) that none hides another from camera or laser. The robot itself stays level;
//! how its mast swings is [`super::scene::Robot`]'s business.

use nearfield_shared::camera::Vector;

use super::body::FloorAxes;
use super::random::{lattice, scramble, unit};
use super::scene::Floor;
use super::shape::{Ray, normalised};

/// No wave is steeper than this, millimetres of height per millimetre of floor; scenes with steeper ones are refused.
pub const STEEPEST: f64 = 0.1;
/// Steepest slope of a wave of height 1 and length 1.
pub const SLOPE_OF_UNIT_WAVE: f64 = 3.0;

/// The waves of a floor.
#[derive(Debug, Clone)]
pub struct Relief {
    axes: FloorAxes,
    shift: [f64; 2],
    height_mm: f64,
    length_mm: f64,
    seed: u64,
}

impl Relief {
    /// Of a checked scene's floor; `None` for a level one.
    #[must_use]
    pub fn new(axes: FloorAxes, floor: &Floor, seed: u64) -> Option<Self> {
        (floor.wave_mm > 0.0).then(|| Self {
            axes,
            shift: floor.shift_mm,
            height_mm: floor.wave_mm,
            length_mm: floor.wave_length_mm,
            seed: scramble(seed ^ 0x7265_6C69_6566),
        })
    }

    /// Height of the floor under or over a point, millimetres over its mean level.
    #[must_use]
    pub fn height(&self, point: Vector) -> f64 {
        self.height_and_slope(point).0
    }

    /// Where a ray meets the floor, in lengths of its direction, and the normal there. It begins to look where the ray meets
    /// the level floor. `None` where it grazes the waves so flatly that there is no one answer.
    #[must_use]
    pub fn meet(&self, ray: &Ray, level: f64) -> Option<(f64, Vector)> {
        /// Heights are met to this, millimetres.
        const EXACT_MM: f64 = 1e-7;
        let mut along = level;
        for _ in 0..12 {
            let point = ray.at(along);
            let (height, slope) = self.height_and_slope(point);
            let off = point.z - height;
            if off.abs() < EXACT_MM {
                return Some((along, normalised(Vector::new(-slope.x, -slope.y, 1.0))));
            }
            let steepness = ray.direction.z - slope.dot(ray.direction);
            if steepness * ray.direction.z <= 0.0 {
                return None;
            }
            along -= off / steepness;
        }
        None
    }

    /// Height, and how it grows along the world's x and y.
    fn height_and_slope(&self, point: Vector) -> (f64, Vector) {
        let [along, across] = self.axes.coordinates(point);
        let (x, y) = ((along - self.shift[0]) / self.length_mm, (across - self.shift[1]) / self.length_mm);
        let (column, row) = (x.floor(), y.floor());
        let corner =
            |i: f64, j: f64| 2.0 * unit(lattice(self.seed, (column + i) as i64, (row + j) as i64)) - 1.0;
        let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)];
        let ((s, s_slope), (t, t_slope)) = (eased(x - column), eased(y - row));
        let (near, far) = (a + (b - a) * s, c + (d - c) * s);
        let scale = self.height_mm / self.length_mm;
        let by_x = scale * s_slope * ((b - a) * (1.0 - t) + (d - c) * t);
        let by_y = scale * t_slope * (far - near);
        let slope = self.axes.along.scaled(by_x).plus(self.axes.across.scaled(by_y));
        (self.height_mm * (near + (far - near) * t), slope)
    }
}

/// The smooth step from 0 to 1, and its slope.
fn eased(t: f64) -> (f64, f64) {
    (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery;
    use crate::twin::shape::length;

    fn relief(wave_mm: f64, shift_mm: [f64; 2]) -> (FloorAxes, Relief) {
        let axes = FloorAxes::new(&gallery::default_rig());
        let floor = Floor { wave_mm, wave_length_mm: 200.0, shift_mm, ..Floor::default() };
        (axes, Relief::new(axes, &floor, 3).unwrap())
    }

    #[test]
    fn waves_are_as_high_and_no_steeper_than_they_say_and_wander_with_the_floor() {
        let (axes, still) = relief(4.0, [0.0; 2]);
        let (_, moved) = relief(4.0, [35.0, -20.0]);
        let (mut least, mut most) = (0.0_f64, 0.0_f64);
        for index in 0..4000 {
            let (x, y) = (f64::from(index % 80) * 25.0 - 1000.0, f64::from(index / 80) * 25.0 - 600.0);
            let height = still.height(axes.place(x, y, 0.0));
            (least, most) = (least.min(height), most.max(height));
            let beside = still.height(axes.place(x + 1.0, y, 0.0));
            assert!((beside - height).abs() <= 4.0 * SLOPE_OF_UNIT_WAVE / 200.0 + 1e-9);
            assert!((moved.height(axes.place(x + 35.0, y - 20.0, 0.0)) - height).abs() < 1e-9);
        }
        assert!(most <= 4.0 && least >= -4.0 && most - least > 5.0, "{least} to {most} mm");
    }

    /// Three statements that must agree: the ray ends on the surface, the normal stands on it, and it is the first place.
    #[test]
    fn a_ray_ends_on_the_waves() {
        let (axes, relief) = relief(5.0, [0.0; 2]);
        let start = axes.place(30.0, -500.0, 300.0);
        for index in 0..400 {
            let aim = axes.place(f64::from(index % 20) * 30.0 - 300.0, f64::from(index / 20) * 20.0, 0.0);
            let ray = Ray { start, direction: aim.minus(start) };
            let (along, normal) = relief.meet(&ray, 1.0).unwrap();
            let point = ray.at(along);
            assert!((point.z - relief.height(point)).abs() < 1e-6 && (length(normal) - 1.0).abs() < 1e-9);
            let step = Vector::new(0.01, 0.02, 0.0);
            let rise = relief.height(point.plus(step)) - relief.height(point);
            let tangent = Vector::new(step.x, step.y, rise);
            assert!(normal.dot(tangent).abs() < 1e-5, "{}", normal.dot(tangent));
            for share in 0..200 {
                let before = ray.at((along - 1e-6) * f64::from(share) / 200.0);
                assert!(before.z > relief.height(before) - 1e-6);
            }
        }
    }
}
