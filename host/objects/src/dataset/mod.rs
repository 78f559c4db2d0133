//! Datasets: which pictures, from what, and how they are written.
//!
//! ```text
//! DIR/recipe.json                    what the dataset was made from: a second run continues, or refuses another recipe
//! DIR/data.yaml                      for YOLO trainers
//! DIR/README.md                      the card
//! DIR/<split>/images/000000.jpg      pictures
//! DIR/<split>/labels/000000.txt      YOLO: class, middle and size of every trained object, relative to the picture
//! DIR/<split>/truth/000000.json      all that is known of a picture
//! DIR/<split>/annotations.json       COCO, all classes
//! ```

mod card;
mod coco;
mod make;
#[cfg(test)]
mod tests;
mod truth;

pub use make::{Progress, make};
pub use truth::{PictureTruth, picture};

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::compose::Pool;
use crate::floor::{Kind, SEEN, UNSEEN};

/// What goes wrong while a dataset is made.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// A file or folder cannot be read or written.
    #[error("{path}: {source}; check the folder's rights and the space on the disk")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// A picture cannot be encoded.
    #[error("{path}: the picture cannot be written: {source}")]
    Picture {
        /// The file.
        path: PathBuf,
        /// What the encoder says.
        source: image::ImageError,
    },
    /// A file is not what it should be.
    #[error("{path}: {source}; remove the file and run again")]
    Json {
        /// The file.
        path: PathBuf,
        /// Where and why it cannot be understood.
        source: serde_json::Error,
    },
    /// The folder holds a dataset of another recipe.
    #[error(
        "{path} was made from another recipe ({what} differs): give an empty folder, or the arguments it was made with"
    )]
    OtherRecipe {
        /// The recipe that is there.
        path: PathBuf,
        /// What differs.
        what: &'static str,
    },
    /// The arguments contradict each other.
    #[error("{0}")]
    Recipe(String),
}

/// What a dataset is made from. The same recipe gives the same bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recipe {
    /// Version of the generator: the same recipe of another version gives other pictures.
    pub generator: String,
    /// Seed of all draws.
    pub seed: u64,
    /// Pictures in train, val and test_picture.
    pub split: [usize; 3],
    /// Pictures in test_item and in test_floor, each.
    pub unseen: usize,
    /// Items of every class that training sees.
    pub items: u64,
    /// Floors of every kind that training sees.
    pub floors: u64,
    /// Least and most of the longest side of the pictures, pixels.
    pub side: (usize, usize),
}

/// The version of everything that decides what a picture looks like. Raise it when a change moves a pixel.
pub const GENERATOR: &str = concat!("nearfield-objects ", env!("CARGO_PKG_VERSION"), " pictures 1");

/// Items of every class that only test_item shows, and from which number on.
pub const UNSEEN_ITEMS: (u64, u64) = (1_000_000, 64);
/// Floors of the seen kinds that only test_floor shows.
const UNSEEN_FLOORS: (u64, u64) = (1_000_000, 200);

impl Recipe {
    /// A recipe with everything checked.
    ///
    /// # Errors
    /// [`DatasetError::Recipe`] where a number makes no sense.
    pub fn new(
        seed: u64,
        split: [usize; 3],
        unseen: usize,
        side: (usize, usize),
    ) -> Result<Self, DatasetError> {
        let recipe =
            Self { generator: GENERATOR.to_owned(), seed, split, unseen, items: 400, floors: 300, side };
        recipe.check()?;
        Ok(recipe)
    }

    fn check(&self) -> Result<(), DatasetError> {
        let (least, most) = self.side;
        if least < 96 || most > 4096 || least > most {
            let hint = format!("--size {least}..{most}: give a range within 96..4096, as 320..512");
            return Err(DatasetError::Recipe(hint));
        }
        if self.split.iter().sum::<usize>() + self.unseen == 0 {
            return Err(DatasetError::Recipe("no pictures asked for: give --images of 1 or more".to_owned()));
        }
        Ok(())
    }

    /// The splits: name and number of pictures.
    #[must_use]
    pub fn splits(&self) -> [(Split, usize); 5] {
        [
            (Split::Train, self.split[0]),
            (Split::Val, self.split[1]),
            (Split::TestPicture, self.split[2]),
            (Split::TestItem, self.unseen),
            (Split::TestFloor, self.unseen),
        ]
    }
}

/// A part of a dataset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Split {
    /// To train on.
    Train,
    /// To choose by, while training.
    Val,
    /// New pictures of seen items on seen floors: the paper's test.
    TestPicture,
    /// Items that no other split shows.
    TestItem,
    /// Floors, and kinds of floors, that no other split shows.
    TestFloor,
}

impl Split {
    /// Its folder.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::TestPicture => "test_picture",
            Self::TestItem => "test_item",
            Self::TestFloor => "test_floor",
        }
    }

    /// What its pictures are drawn from.
    #[must_use]
    pub fn pool(self, recipe: &Recipe) -> Pool<'static> {
        const HELD_OUT: [(Kind, f32); 8] = [
            (UNSEEN[0], 2.0),
            (UNSEEN[1], 2.0),
            (UNSEEN[2], 2.0),
            (Kind::Concrete, 1.0),
            (Kind::Epoxy, 1.0),
            (Kind::Tiles, 1.0),
            (Kind::Wood, 1.0),
            (Kind::Linoleum, 1.0),
        ];
        let (items, floors) = ((0, recipe.items), (0, recipe.floors));
        let (items, floors, kinds): (_, _, &'static [(Kind, f32)]) = match self {
            Self::Train | Self::Val | Self::TestPicture => (items, floors, &SEEN),
            Self::TestItem => (UNSEEN_ITEMS, floors, &SEEN),
            Self::TestFloor => (items, UNSEEN_FLOORS, &HELD_OUT),
        };
        Pool { items, floors, kinds, side: recipe.side }
    }
}
