//! One picture and its truth.

use image::RgbImage;
use serde::{Deserialize, Serialize};

use super::{Recipe, Split};
use crate::compose::compose;
use crate::items::{CLASSES, TRAINED};
use crate::random::Draw;
use crate::render::render;
use crate::visible::inside_share;

/// An object of which less can be seen is not in the truth.
pub const LEAST_VISIBLE: f32 = 0.25;
/// The same for parts of people: a leg at the border must not be taught to be floor.
pub const LEAST_VISIBLE_HUMAN: f32 = 0.015;
/// A box whose longer side is shorter, pixels, is not in the truth: nobody could tell what it is.
const LEAST_SIDE: usize = 6;

/// One object of a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectTruth {
    /// Name of its class.
    pub class: String,
    /// Number of the item within its class.
    pub item: u64,
    /// Left, top, width and height of the box around what can be seen of it, pixels.
    pub bbox: [usize; 4],
    /// Pixels that show it.
    pub area: f32,
    /// Share of its outline that is neither hidden nor outside the picture.
    pub visible: f32,
}

/// What is known of a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PictureTruth {
    /// Number of the picture within its split.
    pub number: usize,
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Kind and number of the floor.
    pub floor: String,
    /// Millimetres per pixel where the camera looks.
    pub millimetres_per_pixel: f32,
    /// Whether the laser is on.
    pub laser: bool,
    /// What can be seen.
    pub objects: Vec<ObjectTruth>,
}

impl PictureTruth {
    /// Its lines in YOLO's format: trained classes only.
    #[must_use]
    pub fn yolo(&self) -> String {
        let mut lines = String::new();
        let (width, height) = (self.width as f64, self.height as f64);
        for object in &self.objects {
            let Some(class) = CLASSES[..TRAINED].iter().position(|c| c.name == object.class) else {
                continue;
            };
            let [x, y, w, h] = object.bbox.map(|v| v as f64);
            let (u, v) = ((x + w / 2.0) / width, (y + h / 2.0) / height);
            lines += &format!("{class} {u:.6} {v:.6} {:.6} {:.6}\n", w / width, h / height);
        }
        lines
    }
}

/// Makes a picture of a split: pixels, quality of its JPEG, truth. It depends on the recipe and the number alone.
#[must_use]
pub fn picture(recipe: &Recipe, split: Split, number: usize) -> (RgbImage, u8, PictureTruth) {
    let mut draw = Draw::new(recipe.seed, &[split as u64, number as u64]);
    let scene = compose(&mut draw, &split.pool(recipe));
    let rendering = render(&scene.stage);
    let (width, height) = scene.stage.camera.size;
    let image = scene.look.expose(&rendering, (width, height), &mut draw);
    let mut objects = Vec::new();
    for ((item, visible), placed) in scene.items.iter().zip(&rendering.visible).zip(&scene.stage.objects) {
        let Some([left, top, right, bottom]) = visible.bounds else { continue };
        let inside = inside_share(&scene.stage.camera, placed);
        let share = (visible.area / visible.unhidden.max(1e-3) * inside).min(1.0);
        let bbox = [left, top, right + 1 - left, bottom + 1 - top];
        let least = if CLASSES[item.class].human && visible.area > 250.0 {
            LEAST_VISIBLE_HUMAN
        } else {
            LEAST_VISIBLE
        };
        if share < least || bbox[2].max(bbox[3]) < LEAST_SIDE {
            continue;
        }
        let class = CLASSES[item.class].name.to_owned();
        objects.push(ObjectTruth { class, item: item.number, bbox, area: visible.area, visible: share });
    }
    let truth = PictureTruth {
        number,
        width,
        height,
        floor: format!("{:?} {}", scene.stage.floor.kind, scene.floor),
        millimetres_per_pixel: scene.scale,
        laser: scene.stage.laser.is_some(),
        objects,
    };
    (image, scene.look.quality, truth)
}
