#![allow(clippy::unwrap_used)]

use super::*;

struct Silent;

impl Progress for Silent {
    fn picture(&self, _: Split) {}
}

fn tiny() -> Recipe {
    Recipe::new(5, [3, 1, 1], 1, (96, 128)).unwrap()
}

/// Every file under a folder with its bytes, in order of name.
fn files(folder: &std::path::Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                found.push((path.strip_prefix(folder).unwrap().to_path_buf(), bytes));
            }
        }
    }
    found.sort();
    found
}

fn made_with(threads: usize, folder: &std::path::Path) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| make(folder, &tiny(), &Silent)).unwrap();
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_one_and_on_two_threads() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    made_with(1, one.path());
    made_with(2, two.path());
    let (one, two) = (files(one.path()), files(two.path()));
    assert!(one.len() > 20, "pictures, labels and truth of six pictures");
    assert_eq!(one, two);
}

#[test]
fn an_interrupted_dataset_is_finished_to_the_same_bytes() {
    let (whole, cut) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    made_with(2, whole.path());
    made_with(2, cut.path());
    for gone in ["train/truth/000001.json", "train/images/000001.jpg", "val/annotations.json", "README.md"] {
        std::fs::remove_file(cut.path().join(gone)).unwrap();
    }
    made_with(1, cut.path());
    assert_eq!(files(whole.path()), files(cut.path()));
}

#[test]
fn a_folder_of_another_recipe_is_refused_by_name_of_what_differs() {
    let folder = tempfile::tempdir().unwrap();
    make(folder.path(), &tiny(), &Silent).unwrap();
    let other = Recipe { seed: 6, ..tiny() };
    let error = make(folder.path(), &other, &Silent).unwrap_err();
    assert!(matches!(error, DatasetError::OtherRecipe { what: "the seed", .. }), "{error}");
}

#[test]
fn another_seed_gives_other_pictures() {
    let other = Recipe { seed: 6, ..tiny() };
    assert_ne!(picture(&tiny(), Split::Train, 0).0, picture(&other, Split::Train, 0).0);
}

#[test]
fn boxes_lie_in_the_picture_and_hold_what_they_claim() {
    let recipe = Recipe::new(11, [24, 0, 0], 0, (128, 160)).unwrap();
    let mut objects = 0;
    for number in 0..24 {
        let (image, _, truth) = picture(&recipe, Split::Train, number);
        assert_eq!((image.width() as usize, image.height() as usize), (truth.width, truth.height));
        for object in &truth.objects {
            let [x, y, w, h] = object.bbox;
            assert!(w > 0 && h > 0 && x + w <= truth.width && y + h <= truth.height, "{object:?}");
            assert!(
                object.area > 0.0 && object.area <= (w * h) as f32 + 0.5 * (w + h) as f32 + 8.0,
                "{object:?}"
            );
            assert!((truth::LEAST_VISIBLE_HUMAN..=1.0).contains(&object.visible), "{object:?}");
            objects += 1;
        }
    }
    assert!(objects > 20, "only {objects} objects in 24 pictures");
}

#[test]
fn test_item_shows_no_item_that_training_sees() {
    let recipe = tiny();
    let seen = Split::Train.pool(&recipe).items;
    let unseen = Split::TestItem.pool(&recipe).items;
    assert!(seen.0 + seen.1 <= unseen.0 || unseen.0 + unseen.1 <= seen.0, "{seen:?} and {unseen:?}");
}

#[test]
fn sizes_and_counts_that_make_no_sense_are_refused() {
    assert!(Recipe::new(1, [1, 0, 0], 0, (500, 300)).is_err());
    assert!(Recipe::new(1, [1, 0, 0], 0, (10, 300)).is_err());
    assert!(Recipe::new(1, [0, 0, 0], 0, (320, 320)).is_err());
}
