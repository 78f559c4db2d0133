//! Writing a dataset: in parallel, resumable, the same bytes for any number of threads.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::card::{card, data_yaml};
use super::coco::coco;
use super::truth::{PictureTruth, picture};
use super::{DatasetError, Recipe, Split};

/// Told about every finished picture; called from several threads.
pub trait Progress: Sync {
    /// One more picture is there.
    fn picture(&self, split: Split);
}

fn file_error(path: &Path) -> impl FnOnce(std::io::Error) -> DatasetError {
    let path = path.to_path_buf();
    move |source| DatasetError::File { path, source }
}

/// Writes a file under another name and renames it: whoever finds it finds it whole.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let mut draft = path.as_os_str().to_owned();
    draft.push(".part");
    let draft = PathBuf::from(draft);
    let mut file = fs::File::create(&draft).map_err(file_error(&draft))?;
    file.write_all(bytes).map_err(file_error(&draft))?;
    fs::rename(&draft, path).map_err(file_error(path))
}

fn to_json<T: serde::Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, DatasetError> {
    serde_json::to_vec_pretty(value).map_err(|source| DatasetError::Json { path: path.to_path_buf(), source })
}

/// The recipe of a folder: kept if it is the same, refused if it is another, written if there is none.
fn keep_recipe(folder: &Path, recipe: &Recipe) -> Result<(), DatasetError> {
    let path = folder.join("recipe.json");
    if !path.exists() {
        return write_whole(&path, &to_json(&path, recipe)?);
    }
    let text = fs::read(&path).map_err(file_error(&path))?;
    let found: Recipe =
        serde_json::from_slice(&text).map_err(|source| DatasetError::Json { path: path.clone(), source })?;
    let checks = [
        ("the generator's version", found.generator != recipe.generator),
        ("the seed", found.seed != recipe.seed),
        ("the split", found.split != recipe.split || found.unseen != recipe.unseen),
        ("the size", found.side != recipe.side),
        ("the number of items or floors", found.items != recipe.items || found.floors != recipe.floors),
    ];
    match checks.iter().find(|(_, differs)| *differs) {
        Some((what, _)) => Err(DatasetError::OtherRecipe { path, what }),
        None => Ok(()),
    }
}

/// Makes a dataset, or finishes one that was interrupted. Returns the truth of every split.
///
/// # Errors
/// [`DatasetError`] where a file cannot be written, or the folder holds a dataset of another recipe.
pub fn make(
    folder: &Path,
    recipe: &Recipe,
    progress: &dyn Progress,
) -> Result<Vec<(Split, Vec<PictureTruth>)>, DatasetError> {
    recipe.check()?;
    fs::create_dir_all(folder).map_err(file_error(folder))?;
    keep_recipe(folder, recipe)?;
    let mut splits = Vec::new();
    for (split, count) in recipe.splits() {
        if count == 0 {
            continue;
        }
        let home = folder.join(split.name());
        for part in ["images", "labels", "truth"] {
            let path = home.join(part);
            fs::create_dir_all(&path).map_err(file_error(&path))?;
        }
        let pictures = (0..count)
            .into_par_iter()
            .map(|number| {
                let truth = one(&home, recipe, split, number)?;
                progress.picture(split);
                Ok(truth)
            })
            .collect::<Result<Vec<_>, DatasetError>>()?;
        let path = home.join("annotations.json");
        write_whole(&path, &to_json(&path, &coco(split.name(), &recipe.generator, recipe.seed, &pictures))?)?;
        splits.push((split, pictures));
    }
    write_whole(&folder.join("data.yaml"), data_yaml(recipe).as_bytes())?;
    write_whole(&folder.join("README.md"), card(recipe, &splits).as_bytes())?;
    Ok(splits)
}

/// Makes one picture, unless it is there. The truth is written last: where it is, the rest is, too.
fn one(home: &Path, recipe: &Recipe, split: Split, number: usize) -> Result<PictureTruth, DatasetError> {
    let name = |part: &str, end: &str| home.join(part).join(format!("{number:06}.{end}"));
    let truth_path = name("truth", "json");
    if let Ok(text) = fs::read(&truth_path) {
        return serde_json::from_slice(&text)
            .map_err(|source| DatasetError::Json { path: truth_path, source });
    }
    let (image, quality, truth) = picture(recipe, split, number);
    let path = name("images", "jpg");
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(&image)
        .map_err(|source| DatasetError::Picture { path: path.clone(), source })?;
    write_whole(&path, &bytes)?;
    write_whole(&name("labels", "txt"), truth.yolo().as_bytes())?;
    write_whole(&truth_path, &to_json(&truth_path, &truth)?)?;
    Ok(truth)
}
