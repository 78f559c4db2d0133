//! Where a ray meets each kind of solid.

use nearfield_shared::camera::Vector;

use super::{Frame, Hit, NEAREST_HIT, Ray, nearest_on_segment, normalised};

/// The nearer root ahead of the start, of `a t^2 + 2 b t + c = 0`.
fn first_root(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || a == 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    Some([(-b - root) / a, (-b + root) / a])
}

pub(super) fn meet_box(frame: &Frame, half: Vector, ray: &Ray) -> Option<Hit> {
    let start = frame.localise(ray.start);
    let direction = frame.localise_direction(ray.direction);
    let mut enter = (f64::NEG_INFINITY, Vector::default());
    let mut leave = (f64::INFINITY, Vector::default());
    for (s, d, h, axis) in [
        (start.x, direction.x, half.x, Vector::new(1.0, 0.0, 0.0)),
        (start.y, direction.y, half.y, Vector::new(0.0, 1.0, 0.0)),
        (start.z, direction.z, half.z, Vector::new(0.0, 0.0, 1.0)),
    ] {
        if d == 0.0 {
            if s.abs() > h {
                return None;
            }
            continue;
        }
        let sign = d.signum();
        let (near, far) = ((-sign * h - s) / d, (sign * h - s) / d);
        if near > enter.0 {
            enter = (near, axis.scaled(-sign));
        }
        if far < leave.0 {
            leave = (far, axis.scaled(sign));
        }
    }
    let (along, normal) = if enter.0 > NEAREST_HIT { enter } else { leave };
    (enter.0 <= leave.0 && along > NEAREST_HIT && along.is_finite())
        .then(|| Hit { along, normal: frame.globalise(normal) })
}

pub(super) fn meet_cylinder(frame: &Frame, radius: f64, tall: f64, ray: &Ray) -> Option<Hit> {
    let start = frame.localise(ray.start);
    let direction = frame.localise_direction(ray.direction);
    let mut best: Option<(f64, Vector)> = None;
    let mut consider = |along: f64, normal: Vector| {
        if along > NEAREST_HIT && best.is_none_or(|(nearest, _)| along < nearest) {
            best = Some((along, normal));
        }
    };
    let a = direction.x * direction.x + direction.y * direction.y;
    let b = start.x * direction.x + start.y * direction.y;
    let c = start.x * start.x + start.y * start.y - radius * radius;
    for along in first_root(a, b, c).into_iter().flatten() {
        let z = start.z + along * direction.z;
        if (0.0..=tall).contains(&z) {
            let p = start.plus(direction.scaled(along));
            consider(along, Vector::new(p.x / radius, p.y / radius, 0.0));
        }
    }
    if direction.z != 0.0 {
        for (level, up) in [(0.0, -1.0), (tall, 1.0)] {
            let along = (level - start.z) / direction.z;
            let (x, y) = (start.x + along * direction.x, start.y + along * direction.y);
            if x * x + y * y <= radius * radius {
                consider(along, Vector::new(0.0, 0.0, up));
            }
        }
    }
    best.map(|(along, normal)| Hit { along, normal: frame.globalise(normal) })
}

pub(super) fn meet_capsule(a: Vector, b: Vector, radius: f64, ray: &Ray) -> Option<Hit> {
    let axis = b.minus(a);
    let from_a = ray.start.minus(a);
    let square = axis.dot(axis);
    let along_axis = axis.dot(ray.direction);
    let offset_axis = axis.dot(from_a);
    let mut best: Option<f64> = None;
    let mut consider = |along: f64| {
        if along > NEAREST_HIT && best.is_none_or(|nearest| along < nearest) {
            best = Some(along);
        }
    };
    if square > 0.0 {
        let qa = square * ray.direction.dot(ray.direction) - along_axis * along_axis;
        let qb = square * from_a.dot(ray.direction) - offset_axis * along_axis;
        let qc = square * (from_a.dot(from_a) - radius * radius) - offset_axis * offset_axis;
        for along in first_root(qa, qb, qc).into_iter().flatten() {
            if (0.0..=square).contains(&(offset_axis + along * along_axis)) {
                consider(along);
            }
        }
    }
    for (end, inner) in [(a, 1.0), (b, -1.0)] {
        let from_end = ray.start.minus(end);
        let roots = first_root(
            ray.direction.dot(ray.direction),
            from_end.dot(ray.direction),
            from_end.dot(from_end) - radius * radius,
        );
        for along in roots.into_iter().flatten() {
            // Only the half of the ball beyond the segment's end is surface.
            if axis.dot(ray.at(along).minus(end)) * inner <= 0.0 {
                consider(along);
            }
        }
    }
    best.map(|along| {
        let point = ray.at(along);
        Hit { along, normal: normalised(point.minus(nearest_on_segment(a, b, point))) }
    })
}

pub(super) fn meet_ellipsoid(frame: &Frame, half: Vector, ray: &Ray) -> Option<Hit> {
    let shrink = |v: Vector| Vector::new(v.x / half.x, v.y / half.y, v.z / half.z);
    let start = shrink(frame.localise(ray.start));
    let direction = shrink(frame.localise_direction(ray.direction));
    let roots = first_root(direction.dot(direction), start.dot(direction), start.dot(start) - 1.0)?;
    let along = roots.into_iter().find(|along| *along > NEAREST_HIT)?;
    let normal = normalised(shrink(start.plus(direction.scaled(along))));
    Some(Hit { along, normal: frame.globalise(normal) })
}
