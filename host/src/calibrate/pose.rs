//! A first guess of a board's pose from its corners, close enough for [`super::fit`] to start from.

use nalgebra::{DMatrix, Matrix3, Point2, Rotation3, Vector3};
use nearfield_shared::camera::Intrinsics;

use super::board::BoardCorner;
use super::model::BoardPose;

/// The pose from which `lens` sees the corners, by the homography between board and undistorted picture. `None` where
/// the corners lie on one line, or outside the lens model.
#[must_use]
pub fn first_pose(lens: &Intrinsics, corners: &[BoardCorner]) -> Option<BoardPose> {
    let pairs: Vec<(Point2<f64>, Point2<f64>)> = corners
        .iter()
        .filter_map(|corner| {
            let sight = lens.undistort(corner.pixel)?;
            Some((corner.place, Point2::new(sight.x, sight.y)))
        })
        .collect();
    let homography = homography(&pairs)?;
    // Columns are r1, r2 and t up to one scale; the board is before the camera.
    let scale = 2.0 / (homography.column(0).norm() + homography.column(1).norm());
    let sign = if homography[(2, 2)] < 0.0 { -1.0 } else { 1.0 };
    let scaled = homography * (scale * sign);
    let (first, second) = (scaled.column(0).into_owned(), scaled.column(1).into_owned());
    let rough = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    let decomposed = rough.svd(true, true);
    let rotation = decomposed.u? * decomposed.v_t?;
    (rotation.determinant() > 0.0).then(|| BoardPose {
        rotation: Rotation3::from_matrix_unchecked(rotation),
        translation: Vector3::from(scaled.column(2)),
    })
}

/// The projective map that takes the first points to the second ones best, in the sense of the direct linear
/// transformation.
fn homography(pairs: &[(Point2<f64>, Point2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let normal = |points: &mut dyn Iterator<Item = Point2<f64>>| -> Option<Matrix3<f64>> {
        let points: Vec<Point2<f64>> = points.collect();
        let count = points.len() as f64;
        let middle = points.iter().fold(Point2::origin(), |sum, point| sum + point.coords / count);
        let spread = points.iter().map(|point| (point - middle).norm()).sum::<f64>() / count;
        (spread > 0.0).then(|| {
            let scale = std::f64::consts::SQRT_2 / spread;
            Matrix3::new(scale, 0.0, -scale * middle.x, 0.0, scale, -scale * middle.y, 0.0, 0.0, 1.0)
        })
    };
    let from = normal(&mut pairs.iter().map(|pair| pair.0))?;
    let to = normal(&mut pairs.iter().map(|pair| pair.1))?;
    let mut rows = DMatrix::zeros(2 * pairs.len(), 9);
    for (index, (one, other)) in pairs.iter().enumerate() {
        let (one, other) = (from.transform_point(one), to.transform_point(other));
        let above = [-one.x, -one.y, -1.0, 0.0, 0.0, 0.0, other.x * one.x, other.x * one.y, other.x];
        let below = [0.0, 0.0, 0.0, -one.x, -one.y, -1.0, other.y * one.x, other.y * one.y, other.y];
        for (column, (above, below)) in above.into_iter().zip(below).enumerate() {
            rows[(2 * index, column)] = above;
            rows[(2 * index + 1, column)] = below;
        }
    }
    let eigen = (rows.transpose() * rows).symmetric_eigen();
    let smallest = eigen.eigenvalues.imin();
    let values = eigen.eigenvectors.column(smallest);
    let normalised = Matrix3::from_row_iterator(values.iter().copied());
    Some(to.try_inverse()? * normalised * from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::camera::{Pixel, Vector};

    fn lens() -> Intrinsics {
        Intrinsics { fx: 1800.0, fy: 1790.0, cx: 1150.0, cy: 640.0, distortion: [-0.05, 0.01, 0.0, 0.0, 0.0] }
    }

    fn seen_from(pose: &BoardPose) -> Vec<BoardCorner> {
        let camera = pose.camera(lens());
        (0..77)
            .map(|index| {
                let place = Point2::new(f64::from(index % 11 - 5) * 50.0, f64::from(index / 11 - 3) * 50.0);
                let pixel = camera.project(Vector::new(place.x, place.y, 0.0)).unwrap();
                BoardCorner { pixel, place }
            })
            .collect()
    }

    #[test]
    fn the_pose_of_a_tilted_board_is_found() {
        let rotation = Rotation3::from_euler_angles(2.4, 0.2, 0.4);
        let pose = BoardPose { rotation, translation: Vector3::new(20.0, -30.0, 700.0) };
        let found = first_pose(&lens(), &seen_from(&pose)).unwrap();
        assert!(found.rotation.angle_to(&pose.rotation) < 1e-6);
        assert!((found.translation - pose.translation).norm() < 1e-3);
    }

    #[test]
    fn corners_on_one_pixel_give_no_pose() {
        let corners = vec![BoardCorner { pixel: Pixel { u: 5.0, v: 5.0 }, place: Point2::origin() }; 9];
        assert_eq!(first_pose(&lens(), &corners), None);
    }
}
