//! Pinhole camera with Brown-Conrady distortion (OpenCV's `k1, k2, p1, p2, k3`) and its pose in the world.
//!
//! Everything is f64: it runs once at start (the MCU emulates f64 in software, bit for bit like the host) and in
//! calibration. The per-frame path uses [`crate::columns`] instead.

/// A point or a direction: x, y, z. World or camera frame as the function says; millimetres for points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vector {
    /// Along the robot's edge (world) or right (camera).
    pub x: f64,
    /// Outward from the robot (world) or down (camera).
    pub y: f64,
    /// Up (world) or along the line of sight (camera).
    pub z: f64,
}

impl Vector {
    /// From its three coordinates.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z }
    }

    /// Scalar product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Vector product.
    #[must_use]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    /// `self + other`.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }

    /// `self - other`.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }

    /// `self * factor`.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }

    /// True if no coordinate is NaN or infinite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

/// A place in the image in pixels: u to the right, v down, (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel {
    /// Column.
    pub u: f64,
    /// Row.
    pub v: f64,
}

/// Lens: focal lengths and principal point in pixels, distortion without unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length across, pixels.
    pub fx: f64,
    /// Focal length down, pixels.
    pub fy: f64,
    /// Principal point's column.
    pub cx: f64,
    /// Principal point's row.
    pub cy: f64,
    /// `[k1, k2, p1, p2, k3]`, OpenCV's order.
    pub distortion: [f64; 5],
}

/// Steps of the fixed-point inverse of the distortion; it gains a digit or more a step for lenses within
/// [`crate::limits::DISTORTION_LIMIT`].
const UNDISTORT_STEPS: u32 = 24;
/// The inverse is good when it reproduces the given point to this (in units of the focal length: 2e-9 px at f = 2000).
const UNDISTORT_TOLERANCE: f64 = 1e-12;

impl Intrinsics {
    /// Where a direction `(x, y, 1)` of the camera frame falls. `None` where the distortion polynomial has folded
    /// over: beyond that radius several directions share one pixel, and the model is no longer a lens.
    #[must_use]
    pub fn distort(&self, x: f64, y: f64) -> Option<Pixel> {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        if 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) <= 0.0 {
            return None;
        }
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let distorted_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let distorted_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        let pixel = Pixel { u: self.fx * distorted_x + self.cx, v: self.fy * distorted_y + self.cy };
        (pixel.u.is_finite() && pixel.v.is_finite()).then_some(pixel)
    }

    /// The direction `(x, y, 1)` of the camera frame that falls on `pixel`: the inverse of [`Self::distort`].
    /// `None` where there is none or the iteration does not settle.
    #[must_use]
    pub fn undistort(&self, pixel: Pixel) -> Option<Vector> {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let target_x = (pixel.u - self.cx) / self.fx;
        let target_y = (pixel.v - self.cy) / self.fy;
        let (mut x, mut y) = (target_x, target_y);
        for _ in 0..UNDISTORT_STEPS {
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let next_x = (target_x - 2.0 * p1 * x * y - p2 * (r2 + 2.0 * x * x)) / radial;
            let next_y = (target_y - p1 * (r2 + 2.0 * y * y) - 2.0 * p2 * x * y) / radial;
            let moved = (next_x - x).abs() + (next_y - y).abs();
            (x, y) = (next_x, next_y);
            if moved <= UNDISTORT_TOLERANCE {
                return self.distort(x, y).map(|_| Vector::new(x, y, 1.0));
            }
        }
        None
    }
}

/// Where the camera stands: `x_cam = rotation * x_world + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rows of the rotation matrix, world to camera.
    pub rotation: [Vector; 3],
    /// Millimetres, camera frame.
    pub translation: Vector,
}

impl Pose {
    /// World point to camera frame.
    #[must_use]
    pub fn to_camera(&self, world: Vector) -> Vector {
        let [right, down, forward] = self.rotation;
        Vector::new(right.dot(world), down.dot(world), forward.dot(world)).plus(self.translation)
    }

    /// Direction of the camera frame to world frame.
    #[must_use]
    pub fn direction_to_world(&self, direction: Vector) -> Vector {
        let [right, down, forward] = self.rotation;
        right.scaled(direction.x).plus(down.scaled(direction.y)).plus(forward.scaled(direction.z))
    }

    /// The camera's centre in the world, millimetres.
    #[must_use]
    pub fn centre(&self) -> Vector {
        self.direction_to_world(self.translation).scaled(-1.0)
    }
}

/// Lens and pose together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The lens.
    pub intrinsics: Intrinsics,
    /// The pose.
    pub pose: Pose,
}

/// Nothing nearer to the camera than this is imaged, millimetres (a lens's housing is larger).
const NEAREST_DEPTH_MM: f64 = 1.0;

impl Camera {
    /// Where a world point appears; `None` behind the camera or beyond the lens model.
    #[must_use]
    pub fn project(&self, world: Vector) -> Option<Pixel> {
        let point = self.pose.to_camera(world);
        if point.z < NEAREST_DEPTH_MM || !point.is_finite() {
            return None;
        }
        self.intrinsics.distort(point.x / point.z, point.y / point.z)
    }

    /// The line of sight through a pixel as a direction in the world (not normalised); it starts at
    /// [`Pose::centre`]. `None` beyond the lens model.
    #[must_use]
    pub fn line_of_sight(&self, pixel: Pixel) -> Option<Vector> {
        self.intrinsics.undistort(pixel).map(|direction| self.pose.direction_to_world(direction))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn tilted_camera() -> Camera {
        let (sine, cosine) = 40.0_f64.to_radians().sin_cos();
        Camera {
            intrinsics: Intrinsics {
                fx: 1792.0,
                fy: 1790.0,
                cx: 1157.8,
                cy: 643.4,
                distortion: [-0.031, 0.011, 0.0003, -0.0002, 0.001],
            },
            pose: Pose {
                rotation: [
                    Vector::new(1.0, 0.0, 0.0),
                    Vector::new(0.0, -cosine, -sine),
                    Vector::new(0.0, sine, -cosine),
                ],
                translation: Vector::new(0.0, 400.0 * sine, 400.0 * cosine),
            },
        }
    }

    #[test]
    fn the_camera_stands_where_its_pose_says() {
        let centre = tilted_camera().pose.centre();
        assert!(
            (centre.z - 400.0).abs() < 1e-9 && centre.x.abs() < 1e-9 && centre.y.abs() < 1e-9,
            "{centre:?}"
        );
    }

    #[test]
    fn a_point_behind_the_camera_or_beyond_the_fold_is_not_imaged() {
        let camera = tilted_camera();
        assert_eq!(camera.project(Vector::new(0.0, -900.0, 400.0)), None);
        let folding = Intrinsics { distortion: [-0.4, 0.0, 0.0, 0.0, 0.0], ..camera.intrinsics };
        assert!(folding.distort(0.9, 0.0).is_some());
        assert_eq!(folding.distort(0.92, 0.0), None);
    }

    proptest! {
        #[test]
        fn undistort_inverts_distort(u in 0.0..2304.0_f64, v in 0.0..1296.0_f64) {
            let camera = tilted_camera();
            let direction = camera.intrinsics.undistort(Pixel { u, v }).unwrap();
            let again = camera.intrinsics.distort(direction.x, direction.y).unwrap();
            prop_assert!((again.u - u).abs() < 1e-7 && (again.v - v).abs() < 1e-7);
        }

        #[test]
        fn a_projected_point_lies_on_its_line_of_sight(x in -400.0..400.0_f64, y in 300.0..600.0_f64, z in -20.0..150.0_f64) {
            let camera = tilted_camera();
            let world = Vector::new(x, y, z);
            let sight = camera.line_of_sight(camera.project(world).unwrap()).unwrap();
            let away = world.minus(camera.pose.centre()).cross(sight);
            prop_assert!(away.dot(away) < 1e-9 * sight.dot(sight));
        }
    }

    /// A lens model has no inverse far outside the picture: that is told, not guessed.
    #[test]
    fn what_no_ray_explains_has_no_direction() {
        let wild = Intrinsics { distortion: [8.0, 0.0, 0.0, 0.0, 0.0], ..tilted_camera().intrinsics };
        assert_eq!(wild.undistort(Pixel { u: 9_000.0, v: 9_000.0 }), None);
    }

    /// A lens without anything else: what one term of the distortion does is seen alone.
    fn plain(distortion: [f64; 5]) -> Intrinsics {
        Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, distortion }
    }

    /// Each radial term folds the picture over where the distorted radius stops growing: `d/dr (r + k r^n) = 0`.
    #[test]
    fn each_radial_term_folds_where_its_derivative_says() {
        let (k1, k2, k3): (f64, f64, f64) = (-0.4, -0.3, -0.2);
        let folds = [
            ([k1, 0.0, 0.0, 0.0, 0.0], (-1.0 / (3.0 * k1)).sqrt()),
            ([0.0, k2, 0.0, 0.0, 0.0], (-1.0 / (5.0 * k2)).powf(0.25)),
            ([0.0, 0.0, 0.0, 0.0, k3], (-1.0 / (7.0 * k3)).powf(1.0 / 6.0)),
        ];
        for (distortion, radius) in folds {
            for (across, down) in [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)] {
                let at =
                    |share: f64| plain(distortion).distort(share * radius * across, share * radius * down);
                assert!(at(0.999).is_some(), "{distortion:?} within {radius}");
                assert_eq!(at(1.001), None, "{distortion:?} beyond {radius}");
            }
        }
    }

    /// The terms of Brown's model, each worked out by hand at (0.5, -0.25): r^2 = 0.3125.
    #[test]
    fn each_term_of_the_distortion_does_what_the_model_says() {
        for (distortion, u, v) in [
            ([0.0; 5], 0.5, -0.25),
            ([0.1, 0.0, 0.0, 0.0, 0.0], 0.5 * 1.03125, -0.25 * 1.03125),
            ([0.0, 0.1, 0.0, 0.0, 0.0], 0.5 * 1.009_765_625, -0.25 * 1.009_765_625),
            ([0.0, 0.0, 0.1, 0.0, 0.0], 0.5 - 0.025, -0.25 + 0.043_75),
            ([0.0, 0.0, 0.0, 0.1, 0.0], 0.5 + 0.081_25, -0.25 - 0.025),
            ([0.0, 0.0, 0.0, 0.0, 0.1], 0.5 * 1.003_051_757_812_5, -0.25 * 1.003_051_757_812_5),
        ] {
            let pixel = plain(distortion).distort(0.5, -0.25).unwrap();
            assert!((pixel.u - u).abs() < 1e-12 && (pixel.v - v).abs() < 1e-12, "{distortion:?}: {pixel:?}");
        }
    }

    #[test]
    fn a_place_beyond_all_numbers_is_not_imaged() {
        for (fx, fy) in [(f64::MAX, 1.0), (1.0, f64::MAX)] {
            let lens = Intrinsics { fx, fy, ..plain([0.0; 5]) };
            assert_eq!(lens.distort(2.0, 2.0), None);
            assert!(lens.distort(0.5, 0.5).is_some());
        }
    }

    #[test]
    fn the_nearest_depth_is_imaged_and_nothing_nearer() {
        let [right, down, forward] =
            [Vector::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0), Vector::new(0.0, 0.0, 1.0)];
        let pose = Pose { rotation: [right, down, forward], translation: Vector::default() };
        let camera = Camera { intrinsics: plain([0.0; 5]), pose };
        assert!(camera.project(Vector::new(0.0, 0.0, NEAREST_DEPTH_MM)).is_some());
        assert_eq!(camera.project(Vector::new(0.0, 0.0, NEAREST_DEPTH_MM.next_down())), None);
    }
}
