use super::*;
use crate::calibration::Calibration;
use crate::card::SCHEMA;
use crate::evaluate::Truth;

const HERE: [f64; 4] = [10.0, 10.0, 20.0, 20.0];
const THERE: [f64; 4] = [60.0, 10.0, 20.0, 20.0];

fn card() -> Card {
    Card {
        schema: SCHEMA.to_owned(),
        name: "sample".to_owned(),
        input_side: 64,
        classes: ["bolt", "hand", "nut"].map(str::to_owned).to_vec(),
        largest_overlap: 0.5,
        operating_scores: vec![0.5, 0.3, 0.7],
        calibration: Calibration::default(),
        steps: Vec::new(),
        classifier: None,
        about: serde_json::Value::Null,
    }
}

/// Classes in another order than the card's, and without nuts.
fn dataset() -> Dataset {
    let truth = |picture, class, place| Truth { picture, class, place, area: 400.0, crowd: false };
    Dataset {
        name: "part".to_owned(),
        pictures: (0..4).map(|index| (index * 10, PathBuf::from(format!("{index}.png")))).collect(),
        classes: vec![("hand".to_owned(), vec![7, 8]), ("bolt".to_owned(), vec![3])],
        truths: vec![truth(0, 0, HERE), truth(0, 1, THERE), truth(1, 0, HERE), truth(2, 1, HERE)],
        left_out: Vec::new(),
    }
}

fn found(picture: usize, class: usize, score: f64, place: [f64; 4]) -> Judged {
    Judged { picture, class, score, place }
}

#[test]
fn every_class_is_judged_at_its_own_operating_score() {
    let part = Part::new(dataset(), vec![found(0, 0, 0.4, HERE), found(0, 1, 0.4, THERE)], &card());
    assert_eq!(part.scores, [f64::from(0.3f32), 0.5], "by name, not by place in the list");
    let report = part.report(&card(), Vec::new());
    assert_eq!((report.classes[0].recall.hits, report.classes[1].recall.hits), (1, 0));
    assert_eq!((report.people.as_that_class.hits, report.people.as_that_class.of), (1, 2));
    assert_eq!(report.not_in_folder, ["nut"]);
    assert_eq!(report.confusion.len(), 3);
}

#[test]
fn missed_people_make_a_picture_worse_than_missed_things_and_inventions() {
    let detections = vec![found(0, 0, 0.9, HERE), found(0, 1, 0.9, THERE), found(3, 1, 0.9, HERE)];
    let part = Part::new(dataset(), detections, &card());
    let order: Vec<usize> = part.worst().into_iter().map(|(picture, _)| picture).collect();
    assert_eq!(order, [1, 2, 3], "a missed hand, a missed bolt, an invented bolt; picture 0 has no mistake");
    assert_eq!(part.objects_of(1), [(0, HERE, false)]);
    assert!(part.objects_of(0).iter().all(|(_, _, found)| *found));
}

#[test]
fn a_fitted_card_keeps_what_the_part_says_nothing_about() {
    let detections = vec![
        found(0, 1, 0.9, THERE),
        found(2, 1, 0.8126, HERE),
        found(3, 1, 0.6, HERE),
        found(0, 0, 0.2, HERE),
        found(1, 0, 0.1, HERE),
    ];
    let fitted = Part::new(dataset(), detections, &card()).fitted(&card());
    assert_eq!(fitted.operating_scores, [0.812, 0.1, 0.7], "bolt, hand; nut is not in the part");
    assert_eq!(fitted.calibration, Calibration::default(), "five detections are too few to calibrate by");
    assert_eq!(fitted.classes, card().classes);
}

#[test]
fn detections_survive_the_way_through_a_file() {
    let detections = vec![found(1, 0, 0.123_456_789, HERE), found(2, 1, 0.5, THERE)];
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("found.json");
    let list = to_coco(&dataset(), &detections);
    assert_eq!((list[0].image_id, list[0].category_id), (10, 7));
    std::fs::write(&path, serde_json::to_string(&list).unwrap()).unwrap();
    assert_eq!(from_coco(&dataset(), &path).unwrap(), detections);
}

#[test]
fn foreign_detections_are_left_out_and_broken_files_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("found.json");
    let one = |image: i64, category: i64| {
        format!(r#"{{"image_id": {image}, "category_id": {category}, "bbox": [1, 2, 3, 4], "score": 0.5}}"#)
    };
    std::fs::write(&path, format!("[{}, {}, {}]", one(10, 8), one(11, 8), one(10, 9))).unwrap();
    assert_eq!(from_coco(&dataset(), &path).unwrap().len(), 1);
    std::fs::write(&path, "[{}]").unwrap();
    assert!(from_coco(&dataset(), &path).unwrap_err().to_string().contains("found.json"));
}

#[test]
fn a_picture_without_an_answer_is_told_and_its_objects_count_as_missed() {
    let directory = tempfile::tempdir().unwrap();
    let mut dataset = dataset();
    for (number, path) in &mut dataset.pictures {
        *path = directory.path().join(format!("{number}.png"));
    }
    image::RgbImage::new(8, 8).save(&dataset.pictures[0].1).unwrap();
    let frames = vec![crate::backend::recorded::RecordedFrame::Seen(vec![Detection {
        class: 1,
        score: 0.9,
        confidence: 0.9,
        place: crate::boxes::BoundingBox { left: 10.0, top: 10.0, right: 30.0, bottom: 30.0 },
    }])];
    let mut detector = crate::backend::recorded::RecordedDetector::new(card().classes, frames);
    let mut ticks = 0;
    let (detections, unanswered) = detect_all(&dataset, &mut detector, || ticks += 1);
    assert_eq!((detections.len(), unanswered.len(), ticks), (1, 3, 4));
    assert_eq!(detections[0].class, 0, "the detector's hand is the folder's first class");
    let report = Part::new(dataset, detections, &card()).report(&card(), unanswered);
    assert_eq!((report.people.as_that_class.hits, report.people.as_that_class.of), (1, 2));
}
