//! Folders of pictures with COCO annotations: `DIR/images/*` and `DIR/annotations.json`.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use super::Truth;
use crate::class::canonical_name;

/// Why a folder cannot be judged on.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// A file cannot be read.
    #[error(
        "{path}: {source}; a dataset is a folder with images/ and annotations.json, or a folder of such folders"
    )]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The annotations are not COCO's, or contradict themselves.
    #[error("{path}: {what}")]
    BadAnnotations {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

#[derive(Deserialize)]
struct File {
    images: Vec<ImageEntry>,
    #[serde(default)]
    annotations: Vec<AnnotationEntry>,
    categories: Vec<CategoryEntry>,
}

#[derive(Deserialize)]
struct ImageEntry {
    id: i64,
    file_name: String,
}

#[derive(Deserialize)]
struct AnnotationEntry {
    image_id: i64,
    category_id: i64,
    bbox: Vec<f64>,
    area: Option<f64>,
    #[serde(default)]
    iscrowd: i64,
}

#[derive(Deserialize)]
struct CategoryEntry {
    id: i64,
    name: String,
}

/// Canonical name of a class and the folder's numbers that mean it.
pub type ClassNumbers = (String, Vec<i64>);

/// One folder, read and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// The folder's name.
    pub name: String,
    /// The pictures' numbers in the file, ascending, and where they are.
    pub pictures: Vec<(i64, PathBuf)>,
    /// Classes that both the detector and the folder know, by the folder's numbers: canonical name, the folder's numbers.
    pub classes: Vec<ClassNumbers>,
    /// All objects of those classes.
    pub truths: Vec<Truth>,
    /// The folder's names that the detector does not know, with the number of objects left out.
    pub left_out: Vec<(String, usize)>,
}

impl Dataset {
    /// Reads a folder for a detector with these classes.
    ///
    /// # Errors
    /// [`DatasetError`].
    pub fn read(folder: &Path, known: &[String]) -> Result<Self, DatasetError> {
        let path = folder.join("annotations.json");
        let text = std::fs::read_to_string(&path)
            .map_err(|source| DatasetError::Unreadable { path: path.clone(), source })?;
        let bad = |what: String| DatasetError::BadAnnotations { path: path.clone(), what };
        let file: File = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
        let known: Vec<String> = known.iter().map(|name| canonical_name(name)).collect();
        let (classes, unknown) = sort_names(&file.categories, &known);
        let mut images = file.images;
        images.sort_by_key(|image| image.id);
        let place_of: HashMap<i64, usize> =
            images.iter().enumerate().map(|(index, image)| (image.id, index)).collect();
        if place_of.len() != images.len() {
            return Err(bad("two images have the same id".to_owned()));
        }
        let class_of: HashMap<i64, usize> = classes
            .iter()
            .enumerate()
            .flat_map(|(index, (_, numbers))| numbers.iter().map(move |number| (*number, index)))
            .collect();
        let mut left_out: BTreeMap<i64, usize> = unknown.keys().map(|number| (*number, 0)).collect();
        let mut truths = Vec::with_capacity(file.annotations.len());
        for (index, entry) in file.annotations.iter().enumerate() {
            if let Some(count) = left_out.get_mut(&entry.category_id) {
                *count += 1;
                continue;
            }
            let truth = entry
                .truth(&place_of, &class_of)
                .map_err(|what| bad(format!("annotation {index}: {what}")))?;
            truths.push(truth);
        }
        let left_out =
            left_out.into_iter().map(|(number, count)| (unknown[&number].clone(), count)).collect();
        let pictures =
            images.iter().map(|image| (image.id, find_picture(folder, &image.file_name))).collect();
        let name = folder
            .file_name()
            .map_or_else(|| folder.display().to_string(), |name| name.display().to_string());
        Ok(Self { name, pictures, classes, truths, left_out })
    }

    /// For each of the detector's classes its index here, or none if the folder does not know it.
    #[must_use]
    pub fn index_of(&self, detector: &[String]) -> Vec<Option<usize>> {
        let position = |name: &String| {
            let name = canonical_name(name);
            self.classes.iter().position(|(own, _)| *own == name)
        };
        detector.iter().map(position).collect()
    }
}

impl AnnotationEntry {
    fn truth(&self, pictures: &HashMap<i64, usize>, classes: &HashMap<i64, usize>) -> Result<Truth, String> {
        let picture = *pictures.get(&self.image_id).ok_or(format!("there is no image {}", self.image_id))?;
        let class =
            *classes.get(&self.category_id).ok_or(format!("there is no category {}", self.category_id))?;
        let &[left, top, width, height] = self.bbox.as_slice() else {
            return Err(format!("bbox has {} numbers, not 4", self.bbox.len()));
        };
        let area = self.area.unwrap_or(width * height);
        if ![left, top, width, height, area].iter().all(|value| value.is_finite())
            || width < 0.0
            || height < 0.0
        {
            return Err(format!("bbox {:?} with area {area} is no box", self.bbox));
        }
        Ok(Truth { picture, class, place: [left, top, width, height], area, crowd: self.iscrowd != 0 })
    }
}

/// The folder's categories that are known, those with one meaning together, and the others.
fn sort_names(categories: &[CategoryEntry], known: &[String]) -> (Vec<ClassNumbers>, BTreeMap<i64, String>) {
    let mut sorted: Vec<&CategoryEntry> = categories.iter().collect();
    sorted.sort_by_key(|category| category.id);
    let mut classes: Vec<ClassNumbers> = Vec::new();
    let mut unknown = BTreeMap::new();
    for category in sorted {
        let name = canonical_name(&category.name);
        if !known.contains(&name) {
            unknown.insert(category.id, category.name.clone());
        } else if let Some((_, numbers)) = classes.iter_mut().find(|(own, _)| *own == name) {
            numbers.push(category.id);
        } else {
            classes.push((name, vec![category.id]));
        }
    }
    (classes, unknown)
}

/// `images/NAME`, else `NAME` as it stands, else `images/` and the last part of the name.
fn find_picture(folder: &Path, name: &str) -> PathBuf {
    let images = folder.join("images");
    let last = Path::new(name).file_name().map(|last| images.join(last));
    let places = [Some(images.join(name)), Some(folder.join(name)), last];
    places.into_iter().flatten().find(|path| path.is_file()).unwrap_or_else(|| images.join(name))
}

/// The folder itself if it has annotations, else all folders in it that have, in the order of their names.
///
/// # Errors
/// [`DatasetError::Unreadable`]: there is none.
pub fn parts(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let own = folder.join("annotations.json");
    if own.is_file() {
        return Ok(vec![folder.to_owned()]);
    }
    let unreadable = |source| DatasetError::Unreadable { path: own.clone(), source };
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut found: Vec<PathBuf> = entries
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.join("annotations.json").is_file())
        .collect();
    found.sort();
    if found.is_empty() {
        return Err(unreadable(std::io::Error::from(std::io::ErrorKind::NotFound)));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(annotations: &str) -> tempfile::TempDir {
        let directory = tempfile::tempdir().unwrap();
        std::fs::create_dir(directory.path().join("images")).unwrap();
        std::fs::write(directory.path().join("images/b.png"), "").unwrap();
        std::fs::write(directory.path().join("annotations.json"), annotations).unwrap();
        directory
    }

    fn known() -> Vec<String> {
        ["bolt", "allen_key", "foot"].map(str::to_owned).to_vec()
    }

    const GOOD: &str = r#"{
        "images": [{"id": 7, "file_name": "x/b.png"}, {"id": 3, "file_name": "a.png"}],
        "categories": [{"id": 9, "name": "Shoe"}, {"id": 2, "name": "Allen Key"}, {"id": 4, "name": "teapot"},
                       {"id": 5, "name": "boots"}],
        "annotations": [
            {"image_id": 7, "category_id": 9, "bbox": [1, 2, 30, 40]},
            {"image_id": 3, "category_id": 5, "bbox": [1, 2, 3, 4], "area": 6.5, "iscrowd": 1},
            {"image_id": 3, "category_id": 4, "bbox": [1, 2, 3, 4]}
        ]}"#;

    #[test]
    fn names_are_matched_by_meaning_and_unknown_ones_are_listed() {
        let directory = folder(GOOD);
        let dataset = Dataset::read(directory.path(), &known()).unwrap();
        let expected = [("allen_key".to_owned(), vec![2]), ("foot".to_owned(), vec![5, 9])];
        assert_eq!(dataset.classes, expected);
        assert_eq!(dataset.left_out, [("teapot".to_owned(), 1)]);
        assert_eq!(dataset.index_of(&known()), [None, Some(0), Some(1)]);
        assert_eq!(dataset.pictures[0].0, 3, "in the order of their numbers");
        assert!(dataset.pictures[1].1.ends_with("images/b.png"));
        let place = [1.0, 2.0, 30.0, 40.0];
        let expected = Truth { picture: 1, class: 1, place, area: 1200.0, crowd: false };
        assert_eq!(dataset.truths[0], expected);
        assert!(dataset.truths[1].crowd && (dataset.truths[1].area - 6.5).abs() < 1e-12);
    }

    #[test]
    fn contradictions_are_named() {
        let cases = [
            (GOOD.replace("\"image_id\": 7", "\"image_id\": 8"), "no image 8"),
            (GOOD.replace("\"category_id\": 9", "\"category_id\": 10"), "no category 10"),
            (GOOD.replace("[1, 2, 30, 40]", "[1, 2, 30]"), "3 numbers"),
            (GOOD.replace("[1, 2, 30, 40]", "[1, 2, -30, 40]"), "no box"),
            (GOOD.replace("\"id\": 7", "\"id\": 3"), "same id"),
            ("{}".to_owned(), "images"),
        ];
        for (text, expected) in cases {
            let directory = folder(&text);
            let error = Dataset::read(directory.path(), &known()).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("annotations.json"), "{error}");
        }
    }

    #[test]
    fn a_folder_of_folders_has_parts() {
        let directory = tempfile::tempdir().unwrap();
        assert!(parts(directory.path()).unwrap_err().to_string().contains("annotations.json"));
        for name in ["val", "test", "other"] {
            std::fs::create_dir(directory.path().join(name)).unwrap();
        }
        for name in ["val", "test"] {
            std::fs::write(directory.path().join(name).join("annotations.json"), "").unwrap();
        }
        let names: Vec<_> = parts(directory.path()).unwrap();
        assert_eq!(names, ["test", "val"].map(|name| directory.path().join(name)));
        assert_eq!(parts(&names[0]).unwrap(), [names[0].clone()]);
    }
}
