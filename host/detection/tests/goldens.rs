//! The shipped network through every step here, against onnxruntime, Pillow and numpy on the same pictures.
//!
//! `goldens.json` was made by `python -m nearfield_training goldens` (see `host/training/README.md`), which shares no code
//! with this crate. With the feature `ort`, and a library named in `ORT_DYLIB_PATH`, ONNX Runtime is held against it too.
#![allow(clippy::unwrap_used, missing_docs)]

use std::path::{Path, PathBuf};

use nearfield_detection::backend::rten::RtenNetwork;
use nearfield_detection::boxes::BoundingBox;
use nearfield_detection::card::{Card, Step};
use nearfield_detection::class::is_human;
use nearfield_detection::classifier::{Classifier, ClassifierCard};
use nearfield_detection::detector::{Detection, Detector, Picture};
use nearfield_detection::letterbox::{Letterbox, Window};
use nearfield_detection::model::{Backend, Choice};
use nearfield_detection::network::{Rows, Settings};
use nearfield_detection::tiles::Tiling;
use serde::Deserialize;

/// Input values may differ by one level of 255: the two resizers round apart.
const LEVEL: f32 = 1.01 / 255.0;
/// Rows from the same input: only the order of sums differs. Pixels for the geometry, shares for the scores.
const ROW_PIXELS: f32 = 0.05;
const ROW_SHARE: f32 = 0.002;
/// Boxes at the end of everything.
const BOX_PIXELS: f32 = 1.0;
const BOX_SCORE: f32 = 0.02;
/// The same for boxes that hang on a level of the input.
const LOOSE_PIXELS: f32 = 8.0;
const LOOSE_SCORE: f32 = 0.1;
/// A classifier's shares: its input may differ by a level here and there.
const SHARE: f32 = 0.05;
/// As in the script.
const LEAST_SCORE: f32 = 0.05;

#[derive(Deserialize)]
struct Golden {
    picture: String,
    input: Vec<(usize, f32)>,
    rows: Vec<GoldenRow>,
    boxes: Vec<GoldenBox>,
    named: Vec<GoldenPlace>,
}

/// What the classifier makes of a place.
#[derive(Deserialize)]
struct GoldenPlace {
    place: [f32; 4],
    shares: Vec<f32>,
}

#[derive(Deserialize)]
struct GoldenRow {
    row: usize,
    numbers: Vec<f32>,
}

#[derive(Deserialize)]
struct GoldenBox {
    class: usize,
    score: f32,
    place: [f32; 4],
    /// It comes back from inputs that differ by a level; what does not is held to the loose limits.
    steady: bool,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens")
}

fn goldens() -> Vec<(Golden, image::RgbImage)> {
    let text = std::fs::read_to_string(folder().join("goldens.json")).unwrap();
    let list: Vec<Golden> = serde_json::from_str(&text).unwrap();
    let steady = list.iter().flat_map(|golden| &golden.boxes).filter(|wanted| wanted.steady).count();
    assert!(list.len() >= 3 && steady >= 5);
    list.into_iter()
        .map(|golden| {
            let picture = image::open(folder().join(&golden.picture)).unwrap().to_rgb8();
            (golden, picture)
        })
        .collect()
}

fn shipped() -> (Vec<u8>, Card) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("model");
    let card = Card::beside(&folder.join("detector.onnx")).unwrap();
    (std::fs::read(folder.join("detector.onnx")).unwrap(), card)
}

#[test]
fn the_input_is_pillows() {
    let (_, card) = shipped();
    let mut letterbox = Letterbox::new(card.input_side);
    for (golden, picture) in goldens() {
        let window = Window { left: 0, top: 0, width: picture.width(), height: picture.height() };
        let (input, _) = letterbox.fit(Picture::try_from(&picture).unwrap(), window).unwrap();
        for (place, wanted) in &golden.input {
            let got = input[*place];
            assert!((got - wanted).abs() <= LEVEL, "{}: {got} at {place}, not {wanted}", golden.picture);
        }
    }
}

#[test]
fn rten_computes_what_onnxruntime_computes() {
    let (onnx, card) = shipped();
    let mut network =
        RtenNetwork::new(onnx, card.input_side, &card.steps, 1, Path::new("detector.onnx")).unwrap();
    let mut letterbox = Letterbox::new(card.input_side);
    let mut rows = Vec::new();
    let length = 5 + card.classes.len();
    for (golden, picture) in goldens() {
        let window = Window { left: 0, top: 0, width: picture.width(), height: picture.height() };
        // Only pictures of the input's own size: there the two inputs are equal, and so must be the answers.
        if (picture.width(), picture.height()) != (card.input_side, card.input_side) {
            continue;
        }
        let (input, _) = letterbox.fit(Picture::try_from(&picture).unwrap(), window).unwrap();
        network.infer(input, &mut rows).unwrap();
        for GoldenRow { row, numbers } in &golden.rows {
            for (index, (got, wanted)) in rows[row * length..][..length].iter().zip(numbers).enumerate() {
                let most = if index < 4 { ROW_PIXELS } else { ROW_SHARE };
                assert!((got - wanted).abs() <= most, "{}: row {row}: {got}, not {wanted}", golden.picture);
            }
        }
    }
}

/// The rule: cut at its convolutions of single channels, a network answers as in one piece.
#[test]
fn a_network_in_pieces_answers_as_in_one() {
    let (onnx, card) = shipped();
    let whole = Card { steps: Vec::new(), ..card.clone() };
    let mut letterbox = Letterbox::new(card.input_side);
    for (golden, picture) in goldens() {
        let window = Window { left: 0, top: 0, width: picture.width(), height: picture.height() };
        let (input, _) = letterbox.fit(Picture::try_from(&picture).unwrap(), window).unwrap();
        let [one, other] = [&card, &whole].map(|card| {
            let mut network =
                RtenNetwork::new(onnx.clone(), card.input_side, &card.steps, 1, Path::new("detector.onnx"))
                    .unwrap();
            let mut rows = Vec::new();
            network.infer(input, &mut rows).unwrap();
            rows
        });
        assert_eq!(one.len(), other.len());
        let worst = one.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 2e-2, "{}: {worst} pixels or shares apart", golden.picture);
    }
}

/// A card of another network must be found when it is loaded, not when it is used.
#[test]
fn steps_that_do_not_fit_are_refused_by_name() {
    let (onnx, card) = shipped();
    let step = Step { takes: vec!["no such tensor".to_owned()], gives: Vec::new(), depthwise: None };
    let card = Card { steps: vec![step], ..card };
    let error = RtenNetwork::new(onnx, card.input_side, &card.steps, 1, Path::new("mine.onnx"))
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("mine.onnx") && error.contains("no such tensor"), "{error}");
}

fn agrees(golden: &Golden, found: &[Detection]) {
    // Boxes whose score lies at the threshold may be on either side of it.
    let most_apart = |wanted: &GoldenBox| {
        if wanted.steady { (BOX_PIXELS, BOX_SCORE) } else { (LOOSE_PIXELS, LOOSE_SCORE) }
    };
    let clear = golden.boxes.iter().filter(|wanted| wanted.score > LEAST_SCORE + most_apart(wanted).1);
    for wanted in clear.clone() {
        let (pixels, score) = most_apart(wanted);
        let near = |detection: &&Detection| {
            let place = detection.place;
            let got = [place.left, place.top, place.right, place.bottom];
            detection.class == wanted.class
                && (detection.score - wanted.score).abs() <= score
                && got.iter().zip(wanted.place).all(|(got, wanted)| (got - wanted).abs() <= pixels)
        };
        assert!(
            found.iter().any(|detection| near(&detection)),
            "{}: class {} with {} at {:?} is missing in {found:?}",
            golden.picture,
            wanted.class,
            wanted.score,
            wanted.place
        );
    }
    let most = golden.boxes.len() + 2;
    let least = clear.count();
    assert!((least..=most).contains(&found.len()), "{}: {} boxes, not {most}", golden.picture, found.len());
}

fn boxes_agree(backend: Backend) {
    let settings = Settings { tiling: Tiling::Off, least_score: Some(LEAST_SCORE) };
    let mut detector =
        Choice { model: None, backend, settings, second_look: false, threads: 1 }.load().unwrap();
    for (golden, picture) in goldens() {
        agrees(&golden, detector.detect(Picture::try_from(&picture).unwrap()).unwrap());
    }
}

#[test]
fn rten_finds_the_same_boxes() {
    boxes_agree(Backend::Rten);
}

fn box_of([left, top, right, bottom]: &[f32; 4]) -> BoundingBox {
    BoundingBox { left: *left, top: *top, right: *right, bottom: *bottom }
}

/// The rule: a place is named the same alone and among others, and as by another program.
#[test]
fn the_classifier_tells_what_onnxruntime_tells() {
    let (_, card) = shipped();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("model").join(card.classifier.as_ref().unwrap());
    let own = ClassifierCard::beside(&path, &card.classes).unwrap();
    let mut classifier = Classifier::load(std::fs::read(&path).unwrap(), own, 1, &path).unwrap();
    let mut judged = 0;
    for (golden, picture) in goldens() {
        let view = Picture::try_from(&picture).unwrap();
        let places: Vec<BoundingBox> = golden.named.iter().map(|named| box_of(&named.place)).collect();
        let together = classifier.look(view, &places).unwrap().to_vec();
        for (place, together) in places.iter().zip(together.chunks_exact(card.classes.len() + 1)) {
            let alone = classifier.look(view, &[*place]).unwrap();
            assert!(alone.iter().zip(together).all(|(one, other)| (one - other).abs() < 1e-4), "{place:?}");
        }
        for GoldenPlace { place, shares } in &golden.named {
            let found = classifier.look(view, &[box_of(place)]).unwrap();
            assert_eq!(found.len(), shares.len());
            let worst = found.iter().zip(shares).map(|(one, other)| (one - other).abs()).fold(0.0, f32::max);
            assert!(worst < SHARE, "{}: {place:?}: {found:?}, not {shares:?}", golden.picture);
            judged += 1;
        }
    }
    assert!(judged >= 5);
}

/// The rule: the second look finds nothing new and hides nobody.
#[test]
fn the_second_look_keeps_every_person() {
    let found = |second_look: bool, picture: &image::RgbImage| {
        let settings = Settings { tiling: Tiling::Off, least_score: Some(LEAST_SCORE) };
        let choice = Choice { model: None, backend: Backend::Rten, settings, second_look, threads: 1 };
        let mut detector = choice.load().unwrap();
        let people: Vec<bool> = detector.classes().iter().map(|name| is_human(name)).collect();
        (detector.detect(Picture::try_from(picture).unwrap()).unwrap().to_vec(), people)
    };
    for (golden, picture) in goldens() {
        let ((before, people), (after, _)) = (found(false, &picture), found(true, &picture));
        for person in before.iter().filter(|one| people[one.class]) {
            let kept = after.iter().any(|one| {
                one.class == person.class
                    && one.score >= person.score
                    && one.place.overlap(&person.place) >= 0.5
            });
            assert!(kept, "{}: {person:?} is gone", golden.picture);
        }
        for one in &after {
            assert!(before.iter().any(|other| other.place == one.place), "{}: {one:?}", golden.picture);
        }
    }
}

#[cfg(feature = "ort")]
#[test]
fn onnxruntime_finds_the_same_boxes() {
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        eprintln!("left out: ORT_DYLIB_PATH names no libonnxruntime.so");
        return;
    }
    boxes_agree(Backend::Ort);
}
