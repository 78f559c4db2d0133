//! The dataset's card and the file for YOLO trainers.

use std::fmt::Write as _;

use super::truth::PictureTruth;
use super::{Recipe, Split, UNSEEN_ITEMS};
use crate::floor::{SEEN, UNSEEN};
use crate::items::{CLASSES, TRAINED};

/// `data.yaml`: where the pictures are and what the classes are called.
pub fn data_yaml(recipe: &Recipe) -> String {
    let mut text = format!("# {}, seed {}\npath: .\n", recipe.generator, recipe.seed);
    text += "train: train/images\nval: val/images\ntest: test_picture/images\n";
    let _ = writeln!(text, "nc: {TRAINED}\nnames:");
    for (place, class) in CLASSES[..TRAINED].iter().enumerate() {
        let _ = writeln!(text, "  {place}: {}", class.name);
    }
    text
}

/// `README.md` of a dataset: what is in it and how it was made.
pub fn card(recipe: &Recipe, splits: &[(Split, Vec<PictureTruth>)]) -> String {
    let mut text = format!(
        "# A dataset of things on factory floors\n\n\
         Made by `{}` with seed {}. All pictures are rendered from procedural models; no photograph and no texture of \
         others is in them. Licence: MIT or Apache-2.0, as the generator.\n\n\
         * {} trained classes, {} items of each in train, val and test_picture; {} others of each in test_item only.\n\
         * {} kinds of floors with {} floors each; test_floor shows other floors, half of them of kinds that training \
         never sees ({}).\n\
         * Boxes are tight on what can be seen; what is less than a quarter visible is left out. Classes of the \
         family \"other\" are in the COCO files, not in the YOLO labels.\n\
         * Longest side {} to {} pixels.\n\n",
        recipe.generator,
        recipe.seed,
        TRAINED,
        recipe.items,
        UNSEEN_ITEMS.1,
        SEEN.len(),
        recipe.floors,
        UNSEEN.map(|kind| format!("{kind:?}").to_lowercase()).join(", "),
        recipe.side.0,
        recipe.side.1,
    );
    text += "| split | pictures | without a trained object | with the laser |\n|---|---|---|---|\n";
    for (split, pictures) in splits {
        let empty = pictures.iter().filter(|p| p.yolo().is_empty()).count();
        let laser = pictures.iter().filter(|p| p.laser).count();
        let _ = writeln!(text, "| {} | {} | {empty} | {laser} |", split.name(), pictures.len());
    }
    text += "\nObjects by class:\n\n| class |";
    for (split, _) in splits {
        let _ = write!(text, " {} |", split.name());
    }
    text += "\n|---|";
    text += &"---|".repeat(splits.len());
    text.push('\n');
    for class in &CLASSES {
        let _ = write!(text, "| {} |", class.name);
        for (_, pictures) in splits {
            let count = pictures.iter().flat_map(|p| &p.objects).filter(|o| o.class == class.name).count();
            let _ = write!(text, " {count} |");
        }
        text.push('\n');
    }
    text
}
