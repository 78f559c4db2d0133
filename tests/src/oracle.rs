//! An independent oracle: exact f64 geometry of a rig that imports nothing of the project, to check the project with.
//!
//! It solves everything another way than the code under test: distortion is inverted by Newton's method in two
//! dimensions, points are found by intersecting planes with Cramer's rule, and rigs are built from angles.

/// Three coordinates, world millimetres or camera frame.
pub type Vector3 = [f64; 3];

/// A rig as plain numbers, with the meaning of the rig file's fields.
#[derive(Debug, Clone)]
pub struct OracleRig {
    /// Family name, for messages.
    pub family: &'static str,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// fx, fy, cx, cy, pixels.
    pub lens: [f64; 4],
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    /// World to camera, rows.
    pub rotation: [Vector3; 3],
    /// Camera centre, world millimetres.
    pub centre: Vector3,
    /// Laser apex, world millimetres.
    pub laser_origin: Vector3,
    /// Two floor points that the sheet goes through: the stripe's s = 0 and s = 1 mm.
    pub stripe_point: Vector3,
    /// Unit vector along the stripe.
    pub stripe_direction: Vector3,
    /// First and last watched s.
    pub stretch: (f64, f64),
}

fn dot(a: Vector3, b: Vector3) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn add(a: Vector3, b: Vector3, factor: f64) -> Vector3 {
    [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]]
}

fn norm(a: Vector3) -> f64 {
    dot(a, a).sqrt()
}

impl OracleRig {
    /// A camera at `centre` that looks outward, turned by `yaw` to the right, pitched down, rolled; degrees.
    #[must_use]
    pub fn rotation_of(yaw: f64, pitch: f64, roll: f64) -> [Vector3; 3] {
        let (sy, cy) = yaw.to_radians().sin_cos();
        let (sp, cp) = pitch.to_radians().sin_cos();
        let (sr, cr) = roll.to_radians().sin_cos();
        let forward = [sy * cp, cy * cp, -sp];
        let level_right = [cy, -sy, 0.0];
        let level_down = cross(forward, level_right);
        let right = add([cr * level_right[0], cr * level_right[1], cr * level_right[2]], level_down, sr);
        [right, cross(forward, right), forward]
    }

    /// The laser sheet's unit normal, up.
    #[must_use]
    pub fn sheet_normal(&self) -> Vector3 {
        let normal = cross(self.stripe_direction, add(self.laser_origin, self.stripe_point, -1.0));
        let length = norm(normal) * normal[2].signum();
        [normal[0] / length, normal[1] / length, normal[2] / length]
    }

    /// Distorts a direction x/z, y/z to a pixel.
    fn pixel_of(&self, x: f64, y: f64) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x.mul_add(x, y * y);
        let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
        let u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        [self.lens[0] * u + self.lens[2], self.lens[1] * v + self.lens[3]]
    }

    /// Where a world point appears.
    #[must_use]
    pub fn project(&self, world: Vector3) -> [f64; 2] {
        let from_camera = add(world, self.centre, -1.0);
        let [x, y, z] = self.rotation.map(|row| dot(row, from_camera));
        self.pixel_of(x / z, y / z)
    }

    /// The line of sight through a pixel, world frame: Newton's method with a numeric Jacobian.
    #[must_use]
    pub fn sight(&self, u: f64, v: f64) -> Vector3 {
        let mut x = (u - self.lens[2]) / self.lens[0];
        let mut y = (v - self.lens[3]) / self.lens[1];
        for _ in 0..30 {
            let h = 1e-6;
            let here = self.pixel_of(x, y);
            let (right, below) = (self.pixel_of(x + h, y), self.pixel_of(x, y + h));
            let (a, b) = ((right[0] - here[0]) / h, (below[0] - here[0]) / h);
            let (c, d) = ((right[1] - here[1]) / h, (below[1] - here[1]) / h);
            let (eu, ev) = (u - here[0], v - here[1]);
            let determinant = a * d - b * c;
            x += (d * eu - b * ev) / determinant;
            y += (a * ev - c * eu) / determinant;
            if eu.abs() + ev.abs() < 1e-10 {
                break;
            }
        }
        let [right, down, forward] = self.rotation;
        add(add(forward, right, x), down, y)
    }

    /// The lit point seen at a pixel: the line of sight cut with the sheet.
    #[must_use]
    pub fn lit_point(&self, u: f64, v: f64) -> Vector3 {
        let sight = self.sight(u, v);
        let normal = self.sheet_normal();
        let distance = dot(normal, add(self.laser_origin, self.centre, -1.0)) / dot(normal, sight);
        add(self.centre, sight, distance)
    }

    /// Stripe coordinate of the floor point that the laser ray through `point` is named by.
    #[must_use]
    pub fn ray_name(&self, point: Vector3) -> f64 {
        let ray = add(point, self.laser_origin, -1.0);
        let floor = add(self.laser_origin, ray, -self.laser_origin[2] / ray[2]);
        dot(self.stripe_direction, add(floor, self.stripe_point, -1.0))
    }

    /// The rig file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let list = |vector: &[f64]| {
            format!("[{}]", vector.iter().map(|x| format!("{x:.12}")).collect::<Vec<_>>().join(", "))
        };
        let normal = self.sheet_normal();
        let translation = self.rotation.map(|row| -dot(row, self.centre));
        let rows = self.rotation.map(|row| list(&row)).join(", ");
        let [fx, fy, cx, cy] = self.lens;
        format!(
            "[image]\nwidth = {}\nheight = {}\n\n[camera]\nfx = {fx:.9}\nfy = {fy:.9}\ncx = {cx:.9}\ncy = {cy:.9}\n\
             distortion = {}\nrotation = [{rows}]\ntranslation_mm = {}\n\n[laser]\norigin_mm = {}\nplane_normal = {}\n\
             plane_offset_mm = {:.12}\n\n[stripe]\npoint_mm = {}\ndirection = {}\nstart_mm = {:.6}\nend_mm = {:.6}\n",
            self.size.0,
            self.size.1,
            list(&self.distortion),
            list(&translation),
            list(&self.laser_origin),
            list(&normal),
            dot(normal, self.laser_origin),
            list(&self.stripe_point),
            list(&self.stripe_direction),
            self.stretch.0,
            self.stretch.1,
        )
    }
}

/// A tiny generator of repeatable random numbers (SplitMix64), so that the oracle needs no crate.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// Repeatable from `seed`.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// The families of rigs that the project is made for.
pub const FAMILIES: [&str; 5] = ["side", "central", "height", "skewed", "wide"];

/// Rigs with a laser far below the highest mapped height: what it lights ends there, and so must what the maps are fitted to.
pub const LOW: &str = "low laser";

/// A random rig of a family: the nominal one plus mounting tolerances.
#[must_use]
pub fn random_rig(family: &'static str, random: &mut Random) -> OracleRig {
    let standard = ([1792.0, 1792.0, 1157.8, 643.4], [-0.031, 0.011, 0.0003, -0.0002, 0.0]);
    let wide = ([1026.0, 1026.0, 1146.3, 655.2], [-0.09, 0.02, -0.0002, 0.0003, 0.0]);
    let (centre, angles, laser, optics, stretch) = match family {
        "side" => ([-450.0, 0.0, 500.0], [33.0, 37.0, 0.0], [-520.0, 0.0, 200.0], standard, (-495.0, 550.0)),
        "central" => ([0.0, 0.0, 500.0], [0.0, 45.0, 0.0], [0.0, 0.0, 200.0], standard, (-420.0, 415.0)),
        "height" => ([0.0, 0.0, 400.0], [0.0, 50.0, 0.0], [0.0, 0.0, 200.0], standard, (-380.0, 375.0)),
        "skewed" => ([35.0, 8.0, 403.0], [-2.5, 48.7, 1.3], [-110.0, 3.0, 198.0], standard, (-355.0, 385.0)),
        LOW => {
            let laser = [0.0, 0.0, random.within(60.0, 150.0)];
            ([0.0, 0.0, 300.0], [0.0, 25.0, 0.0], laser, wide, (-300.0, 300.0))
        }
        _ => ([0.0, 0.0, 400.0], [0.0, 46.0, 0.0], [0.0, 0.0, 200.0], wide, (-560.0, 560.0)),
    };
    let (mut lens, mut distortion) = optics;
    let half = random.bits().is_multiple_of(2);
    let size = if half { (1152, 648) } else { (2304, 1296) };
    for value in &mut lens {
        *value *= random.within(0.995, 1.005) * if half { 0.5 } else { 1.0 };
    }
    for value in &mut distortion {
        *value *= random.within(0.8, 1.2);
    }
    let mut jitter = |values: [f64; 3], by: f64| values.map(|value| value + random.within(-by, by));
    let (centre, [yaw, pitch, roll], laser_origin) =
        (jitter(centre, 5.0), jitter(angles, 1.0), jitter(laser, 4.0));
    let turn = random.within(-0.02, 0.02);
    OracleRig {
        family,
        size,
        lens,
        distortion,
        rotation: OracleRig::rotation_of(yaw, pitch, roll),
        centre,
        laser_origin,
        stripe_point: [0.0, 500.0 + random.within(-5.0, 5.0), 0.0],
        stripe_direction: [turn.cos(), turn.sin(), 0.0],
        stretch,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oracle_agrees_with_itself() {
        let mut random = Random::new(7);
        for family in FAMILIES {
            let rig = random_rig(family, &mut random);
            let normal = rig.sheet_normal();
            for s in [-300.0, 0.0, 300.0] {
                let floor = add(rig.stripe_point, rig.stripe_direction, s);
                assert!(dot(normal, add(floor, rig.laser_origin, -1.0)).abs() < 1e-9);
                let lit = add(floor, add(rig.laser_origin, floor, -1.0), 0.3);
                let [u, v] = rig.project(lit);
                assert!(norm(add(rig.lit_point(u, v), lit, -1.0)) < 1e-6, "{family}");
                assert!((rig.ray_name(lit) - s).abs() < 1e-9);
            }
        }
    }
}
