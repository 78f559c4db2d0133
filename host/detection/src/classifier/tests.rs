use proptest::prelude::*;

use super::*;

/// Says the same about everything.
struct Parrot(Vec<f32>);

impl Rows for Parrot {
    fn infer(&mut self, input: &[f32], rows: &mut Vec<f32>) -> Result<(), Unknown> {
        rows.clear();
        for _ in 0..input.len() / (3 * 32 * 32) {
            rows.extend_from_slice(&self.0);
        }
        Ok(())
    }
}

fn card() -> ClassifierCard {
    ClassifierCard {
        schema: SCHEMA.to_owned(),
        name: "sample".to_owned(),
        input_side: 32,
        context: 1.4,
        classes: vec!["bolt".to_owned(), "hand".to_owned()],
        weight: 0.5,
        most_places: 2,
        steps: Vec::new(),
        about: serde_json::Value::Null,
    }
}

fn classifier(shares: [f32; 3]) -> Classifier {
    Classifier::new(Box::new(Parrot(shares.to_vec())), card(), Path::new("x.onnx")).unwrap()
}

fn at(class: usize, score: f32, x: f32) -> Detection {
    Detection { class, score, confidence: score, place: BoundingBox::around(x, 50.0, 20.0, 20.0) }
}

/// What becomes of detections in a picture of 200 x 100 pixels.
fn named(shares: [f32; 3], detections: &[Detection]) -> Vec<Detection> {
    let rgb = vec![0; 200 * 100 * 3];
    let mut detections = detections.to_vec();
    classifier(shares).name(Picture::new(200, 100, &rgb).unwrap(), &mut detections, 0.1).unwrap();
    detections
}

#[test]
fn opinions_are_mixed_and_a_new_name_is_added() {
    let found = named([0.9, 0.1, 0.0], &[at(0, 0.4, 50.0)]);
    assert_eq!(found.len(), 1, "a hand of 0.02 is less than asked for: {found:?}");
    assert!((found[0].score - (0.2 + 0.5 * 0.4 * 0.9)).abs() < 1e-6);
    let found = named([0.0, 1.0, 0.0], &[at(0, 0.4, 50.0)]);
    assert!((found[0].score - 0.2).abs() < 1e-6);
    assert_eq!((found[1].class, found[1].place), (1, found[0].place));
    assert!((found[1].score - 0.2).abs() < 1e-6);
}

#[test]
fn names_of_one_place_share_what_is_there() {
    let found = named([1.0, 0.0, 0.0], &[at(0, 0.5, 50.0), at(1, 0.3, 51.0)]);
    assert!((found[0].score - (0.25 + 0.5 * 0.8)).abs() < 1e-6, "{found:?}");
}

/// The rule: no opinion makes a person less sure.
#[test]
fn nobody_is_hidden() {
    for shares in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] {
        let found = named(shares, &[at(1, 0.4, 50.0)]);
        assert_eq!(found.iter().find(|one| one.class == 1).unwrap().score, 0.4, "{shares:?}");
    }
    assert!(named([0.0, 1.0, 0.0], &[at(1, 0.4, 50.0)])[0].score >= 0.4);
}

#[test]
fn places_beyond_the_budget_stay_as_they_are() {
    let all = [at(0, 0.9, 20.0), at(0, 0.8, 80.0), at(0, 0.7, 140.0)];
    let found = named([0.0, 0.0, 1.0], &all);
    assert!((found[0].score - 0.45).abs() < 1e-6 && (found[1].score - 0.4).abs() < 1e-6, "{found:?}");
    assert_eq!(found[2], all[2]);
}

#[test]
fn nonsense_is_unknown() {
    let rgb = vec![0; 12];
    let picture = Picture::new(2, 2, &rgb).unwrap();
    for shares in [vec![f32::NAN, 0.5, 0.5], vec![0.2, 0.2, 0.2], vec![2.0, -1.0, 0.0], vec![1.0], vec![]] {
        let mut classifier = classifier([0.2, 0.3, 0.5]);
        classifier.network = Box::new(Parrot(shares.clone()));
        let outcome = classifier.name(picture, &mut vec![at(0, 0.5, 1.0)], 0.1);
        assert!(matches!(outcome, Err(Unknown::Nonsense { .. })), "{shares:?}");
    }
}

#[test]
fn contradictions_are_refused_by_name() {
    let classes = card().classes;
    let parse = |card: &ClassifierCard| {
        ClassifierCard::parse(&serde_json::to_string(card).unwrap(), &classes, Path::new("x.json"))
    };
    assert_eq!(parse(&card()).unwrap(), card());
    let cases = [
        (ClassifierCard { schema: "other".to_owned(), ..card() }, "schema"),
        (ClassifierCard { input_side: 40, ..card() }, "input_side"),
        (ClassifierCard { input_side: LARGEST_INPUT + 32, ..card() }, "input_side"),
        (ClassifierCard { context: 0.9, ..card() }, "context"),
        (ClassifierCard { context: 4.1, ..card() }, "context"),
        (ClassifierCard { weight: -0.1, ..card() }, "weight"),
        (ClassifierCard { weight: 1.1, ..card() }, "weight"),
        (ClassifierCard { classes: vec!["hand".to_owned(), "bolt".to_owned()], ..card() }, "classes"),
    ];
    for (card, field) in cases {
        let error = parse(&card).unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("x.json"), "{error}");
    }
}

proptest! {
    /// A region lies in the picture, is not empty, and holds the box's middle as far as that is in the picture.
    #[test]
    fn regions_lie_in_the_picture(
        width in 1u32..3000, height in 1u32..3000, x in 0.0f32..1.0, y in 0.0f32..1.0,
        across in 0.0f32..500.0, down in 0.0f32..500.0,
    ) {
        let place = BoundingBox::around(x * width as f32, y * height as f32, across, down);
        let window = region(&place, 1.4, width, height);
        prop_assert!(window.width > 0 && window.height > 0);
        prop_assert!(window.left + window.width <= width && window.top + window.height <= height);
        let clipped = place.clipped(width as f32, height as f32);
        prop_assert!(window.left as f32 <= clipped.left && window.top as f32 <= clipped.top);
        prop_assert!((window.left + window.width) as f32 >= clipped.right.floor());
    }
}
