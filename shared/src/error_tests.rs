//! What errors tell people: each says in its own words what is wrong, and an empty start is the same by either name.

use crate::columns::GeometryError;
use crate::cutoff::CutoffDetector;
use crate::linescan::LineScanError;
use crate::monitor::StripeMonitor;
use crate::rig::{CompactRigError, RigError};
use crate::service::PageError;
use crate::status::StatusError;
use core::fmt::{Debug, Display};
use std::collections::BTreeSet;

fn each_has_its_own_words<E: Display + Debug>(errors: &[E]) {
    let words: BTreeSet<String> = errors.iter().map(ToString::to_string).collect();
    assert_eq!(words.len(), errors.len(), "{words:?}");
    for word in words {
        assert!(word.len() > 8 && !word.contains("Error"), "{word:?} is no sentence for people");
    }
}

#[test]
fn every_error_has_its_own_words() {
    use LineScanError as Scan;
    each_has_its_own_words(&[Scan::Length, Scan::Corrupted, Scan::Magic, Scan::Version, Scan::Field]);
    use StatusError as Answer;
    each_has_its_own_words(&[
        Answer::Length,
        Answer::Corrupted,
        Answer::Magic,
        Answer::Version,
        Answer::Field,
    ]);
    use PageError as Page;
    each_has_its_own_words(&[Page::Length, Page::Corrupted, Page::Magic, Page::Version, Page::Field]);
    use GeometryError as Geometry;
    each_has_its_own_words(&[
        Geometry::StripeAlongColumns,
        Geometry::TooManyColumns,
        Geometry::TooFewColumns,
        Geometry::NoParallax,
    ]);
}

#[test]
fn a_refused_rig_names_its_version_its_field_and_the_rule() {
    let broken = RigError { field: "camera.fx", rule: "is not positive" };
    assert_eq!(broken.to_string(), "camera.fx: is not positive");
    let errors = [
        CompactRigError::NotARig,
        CompactRigError::Version(9),
        CompactRigError::Damaged,
        CompactRigError::Invalid(broken),
    ];
    each_has_its_own_words(&errors);
    assert!(errors[1].to_string().contains('9') && errors[3].to_string().contains("camera.fx"));
}

#[test]
fn an_empty_start_is_the_same_by_either_name() {
    let same = |one: &dyn Debug, other: &dyn Debug| assert_eq!(format!("{one:?}"), format!("{other:?}"));
    same(&CutoffDetector::<4>::default(), &CutoffDetector::<4>::new());
    same(&StripeMonitor::<4>::default(), &StripeMonitor::<4>::new());
}
