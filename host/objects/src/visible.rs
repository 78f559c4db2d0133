//! What can be seen of the objects of a picture: areas, boxes, shares.

use crate::camera::Camera;
use crate::placed::Placed;

/// What can be seen of one object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visible {
    /// Pixels that show it, with the fractions at its edges.
    pub area: f32,
    /// Pixels that would show it if nothing stood before it.
    pub unhidden: f32,
    /// The box of its pixels: x, y of the upper left pixel and of the lower right one, both included; none if unseen.
    pub bounds: Option<[usize; 4]>,
}

/// A pixel of which less shows an object is not part of its box.
const LEAST_COVER: f32 = 0.25;
/// Collects what is visible of every object.
pub struct Tally {
    visible: Vec<Visible>,
}

impl Tally {
    /// For a number of objects.
    pub fn new(objects: usize) -> Self {
        Self { visible: vec![Visible { area: 0.0, unhidden: 0.0, bounds: None }; objects] }
    }

    /// What was collected.
    pub fn finish(self) -> Vec<Visible> {
        self.visible
    }

    /// Adds a pixel with its samples: the object that each shows, from 1, and the bits of all on its line of sight.
    pub fn add(&mut self, x: usize, y: usize, samples: &[(u8, u32)]) {
        let any = samples.iter().fold(0, |bits, s| bits | s.1);
        if any == 0 {
            return;
        }
        let share = 1.0 / samples.len() as f32;
        for (index, visible) in self.visible.iter_mut().enumerate() {
            if any >> index & 1 == 0 {
                continue;
            }
            let cover = share * samples.iter().filter(|s| usize::from(s.0) == index + 1).count() as f32;
            visible.unhidden += share * samples.iter().filter(|s| s.1 >> index & 1 == 1).count() as f32;
            visible.area += cover;
            if cover >= LEAST_COVER {
                let [left, top, right, bottom] = visible.bounds.unwrap_or([x, y, x, y]);
                visible.bounds = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
            }
        }
    }
}

/// The rectangle of the picture that can show an object, with room for distortion; all of it where the object reaches
/// behind the camera.
pub fn frame_of(camera: &Camera, object: &Placed) -> [f32; 4] {
    let mut frame = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
    for corner in object.corners() {
        let Some(at) = camera.project(corner) else {
            return [f32::MIN, f32::MIN, f32::MAX, f32::MAX];
        };
        frame = [frame[0].min(at.x), frame[1].min(at.y), frame[2].max(at.x), frame[3].max(at.y)];
    }
    let room = 2.0 + 0.04 * camera.size.0 as f32;
    [frame[0] - room, frame[1] - room, frame[2] + room, frame[3] + room]
}

/// The share of an object's outline that lies inside the picture, from a coarse grid of lines of sight over all that it
/// would cover.
#[must_use]
pub fn inside_share(camera: &Camera, object: &Placed) -> f32 {
    let (width, height) = (camera.size.0 as f32, camera.size.1 as f32);
    let [left, top, right, bottom] = frame_of(camera, object);
    if left >= 0.0 && top >= 0.0 && right <= width && bottom <= height {
        return 1.0;
    }
    let (left, top) = (left.max(-3.0 * width), top.max(-3.0 * height));
    let (right, bottom) = (right.min(4.0 * width), bottom.min(4.0 * height));
    const GRID: usize = 26;
    let (mut inside, mut all) = (0, 0);
    for row in 0..GRID {
        for column in 0..GRID {
            let x = left + (right - left) * (column as f32 + 0.5) / GRID as f32;
            let y = top + (bottom - top) * (row as f32 + 0.5) / GRID as f32;
            let coarse = (right - left).max(bottom - top) / GRID as f32;
            let (hit, miss) = object.trace(camera.position, camera.ray(x, y), camera.spread());
            if hit.is_some() || miss < 0.5 * coarse * camera.spread() {
                all += 1;
                inside += usize::from(x >= 0.0 && y >= 0.0 && x < width && y < height);
            }
        }
    }
    if all == 0 { 0.0 } else { inside as f32 / all as f32 }
}
