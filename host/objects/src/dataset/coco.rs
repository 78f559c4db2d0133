//! COCO's format, as far as boxes need it.

use serde::Serialize;

use super::truth::PictureTruth;
use crate::items::CLASSES;

/// A file of annotations.
#[derive(Debug, Serialize)]
pub struct Coco<'a> {
    info: Info<'a>,
    licenses: [License; 1],
    images: Vec<Image<'a>>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Debug, Serialize)]
struct Info<'a> {
    description: String,
    version: &'a str,
    seed: u64,
}

#[derive(Debug, Serialize)]
struct License {
    id: u32,
    name: &'static str,
}

#[derive(Debug, Serialize)]
struct Image<'a> {
    id: usize,
    file_name: String,
    width: usize,
    height: usize,
    license: u32,
    floor: &'a str,
    millimetres_per_pixel: f32,
    laser: bool,
}

#[derive(Debug, Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    category_id: usize,
    bbox: [usize; 4],
    area: f32,
    iscrowd: u8,
    segmentation: [u8; 0],
    item: u64,
    visible: f32,
}

#[derive(Debug, Serialize)]
struct Category {
    id: usize,
    name: &'static str,
    supercategory: &'static str,
}

/// The annotations of a split: every picture with its number from 1, every class with its place from 1.
pub fn coco<'a>(split: &str, generator: &'a str, seed: u64, pictures: &'a [PictureTruth]) -> Coco<'a> {
    let mut annotations = Vec::new();
    for picture in pictures {
        for object in &picture.objects {
            let Some(class) = CLASSES.iter().position(|c| c.name == object.class) else { continue };
            annotations.push(Annotation {
                id: annotations.len() + 1,
                image_id: picture.number + 1,
                category_id: class + 1,
                bbox: object.bbox,
                area: object.area,
                iscrowd: 0,
                segmentation: [],
                item: object.item,
                visible: object.visible,
            });
        }
    }
    let images = pictures.iter().map(|p| Image {
        id: p.number + 1,
        file_name: format!("{:06}.jpg", p.number),
        width: p.width,
        height: p.height,
        license: 1,
        floor: &p.floor,
        millimetres_per_pixel: p.millimetres_per_pixel,
        laser: p.laser,
    });
    let categories = CLASSES.iter().enumerate().map(|(place, class)| Category {
        id: place + 1,
        name: class.name,
        supercategory: match (class.human, class.trained) {
            (true, _) => "human",
            (false, true) => "item",
            (false, false) => "other",
        },
    });
    Coco {
        info: Info { description: format!("nearfield objects, {split}"), version: generator, seed },
        licenses: [License { id: 1, name: "MIT OR Apache-2.0" }],
        images: images.collect(),
        categories: categories.collect(),
        annotations,
    }
}
