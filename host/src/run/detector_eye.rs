//! The detector of tier 3 as the eye beside the stripe path.

use nearfield_detection::detector::{Detector, Picture};
use nearfield_fusion::classes::category_of;
use nearfield_fusion::{BoxPixels, Sighting};

use nearfield_shared::action::Category;

use super::semantics::{Eye, SemanticPicture};

/// Corners of pixels (the detector's 0, 0) to centres of pixels (the cameras').
const CORNER_TO_CENTRE: f64 = -0.5;

/// Any detector of [`nearfield_detection`], asked for categories of the action table.
pub struct DetectorEye<D> {
    detector: D,
    /// By class of the detector.
    categories: Vec<Category>,
}

impl<D: Detector> DetectorEye<D> {
    /// Looks its classes' categories up; a class that the action table does not know is unknown, which stops.
    #[must_use]
    pub fn new(detector: D) -> Self {
        let categories = detector.classes().iter().map(|class| category_of(class)).collect();
        Self { detector, categories }
    }
}

impl<D: Detector> Eye for DetectorEye<D> {
    fn look(&mut self, picture: &SemanticPicture) -> Result<Vec<Sighting>, String> {
        let size = picture.frame.size();
        let rgb = picture.frame.to_rgb();
        let view =
            Picture::new(size.width.into(), size.height.into(), &rgb).map_err(|error| error.to_string())?;
        let found = self.detector.detect(view).map_err(|unknown| unknown.to_string())?;
        let sighting = |one: &nearfield_detection::detector::Detection| {
            let category = self.categories.get(one.class).copied().unwrap_or(Category::Unknown);
            let edge = |value: f32| f64::from(value) + CORNER_TO_CENTRE;
            let place = one.place;
            let seen = BoxPixels {
                left: edge(place.left),
                top: edge(place.top),
                right: edge(place.right),
                bottom: edge(place.bottom),
            };
            Sighting { category, confidence: one.confidence.into(), seen }
        };
        Ok(found.iter().map(sighting).collect())
    }
}

#[cfg(test)]
mod tests {
    use nearfield_detection::backend::recorded::{RecordedDetector, RecordedFrame};
    use nearfield_detection::boxes::BoundingBox;
    use nearfield_detection::detector::{Detection, Unknown};
    use nearfield_shared::rig::ImageSize;
    use nearfield_shared::units::Micros;

    use super::*;
    use crate::capture::{Frame, Pixels};

    fn picture() -> SemanticPicture {
        let size = ImageSize { width: 8, height: 4 };
        SemanticPicture { frame: Frame::new(size, Pixels::Rgb(vec![0; 96])).unwrap(), exposed: Micros::ZERO }
    }

    fn eye(frames: Vec<RecordedFrame>) -> DetectorEye<RecordedDetector> {
        let classes = ["hand", "teapot"].map(str::to_owned).to_vec();
        DetectorEye::new(RecordedDetector::new(classes, frames))
    }

    #[test]
    fn classes_become_categories_and_corners_become_centres() {
        let place = BoundingBox { left: 1.0, top: 0.5, right: 4.0, bottom: 3.0 };
        let one = |class| Detection { class, score: 0.9, confidence: 0.75, place };
        let mut eye = eye(vec![RecordedFrame::Seen(vec![one(0), one(1)])]);
        let seen = eye.look(&picture()).unwrap();
        assert_eq!(seen[0].category, Category::Human);
        assert_eq!(seen[1].category, Category::Unknown, "what the action table does not know");
        assert_eq!(seen[0].seen, BoxPixels { left: 0.5, top: 0.0, right: 3.5, bottom: 2.5 });
        assert!((seen[0].confidence - 0.75).abs() < 1e-9);
    }

    #[test]
    fn unknown_stays_unknown_with_its_reason_and_no_objects_is_an_answer() {
        let stalled = RecordedFrame::Unknown { unknown: Unknown::Stalled { deadline_ms: 100 } };
        let mut eye = eye(vec![stalled, RecordedFrame::Seen(Vec::new())]);
        assert!(eye.look(&picture()).unwrap_err().contains("100 ms"));
        assert_eq!(eye.look(&picture()), Ok(Vec::new()));
        assert!(eye.look(&picture()).is_err(), "the recording is over");
        let empty = SemanticPicture::default();
        assert!(eye.look(&empty).unwrap_err().contains("cannot be used"), "no picture yet");
    }
}
