//! What the controller is told of the tracks: at most four claims, objections first.

use crate::decide::{AHEAD, believed_category};
use crate::track::Track;
use nearfield_shared::action::{Action, Category, action_for};
use nearfield_shared::height::SizeClass;
use nearfield_shared::rig::Stripe;
use nearfield_shared::run_over::{Claim, Claims, LARGEST_CLAIM_COUNT, NO_CLAIMS, Stretch};
use nearfield_shared::units::Micros;

/// A claim covers this more than the track at both ends, millimetres: a laser ray that meets the thing is named by where it
/// would meet the floor.
const CLAIM_MARGIN: f64 = 10.0;

/// The claims of the line-scan that is sent at `now`, for tracks that are on the stripe or on their way to it. Objections
/// come first. If not all of them fit, the last claim is an unknown thing along the whole stripe: it objects to everything.
#[must_use]
pub fn claims(stripe: &Stripe, tracks: &[Track], now: Micros) -> Claims {
    let mut objections = Vec::new();
    let mut debris = Vec::new();
    for track in tracks {
        let category = believed_category(track);
        let (near, _) = track.footprint.behind(stripe);
        if near > AHEAD && category != Category::Human {
            continue;
        }
        let (from, to) = track.footprint.along(stripe);
        let claim = Claim {
            stretch: stretch(from - CLAIM_MARGIN, to + CLAIM_MARGIN),
            category,
            confidence: eight_bits(track.confidence()),
            age: now.since(track.last_seen),
        };
        match action_for(category, SizeClass::Small) {
            Action::RunOver => debris.push(claim),
            Action::GoAround | Action::StopAndWarn => objections.push(claim),
        }
    }
    // People first: they object everywhere.
    objections.sort_by_key(|claim| claim.category != Category::Human);
    if objections.len() > LARGEST_CLAIM_COUNT {
        objections.truncate(LARGEST_CLAIM_COUNT - 1);
        let stretch = stretch(stripe.start, stripe.end);
        objections.push(Claim { stretch, category: Category::Unknown, confidence: 0, age: Micros::ZERO });
    }
    let mut claims = NO_CLAIMS;
    for (slot, claim) in claims.iter_mut().zip(objections.into_iter().chain(debris)) {
        *slot = Some(claim);
    }
    claims
}

/// Whole millimetres, outward; what is beyond the field is its end.
fn stretch(from: f64, to: f64) -> Stretch {
    #[allow(clippy::cast_possible_truncation, reason = "clamped; a cast of what is no number is zero")]
    let whole = |value: f64| value.clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16;
    let (start, end) = (whole(from.floor()), whole(to.ceil()));
    // `from <= to`, unless one of them is no number: then a point, which debris never is.
    Stretch::new(start.min(end), end.max(start)).unwrap_or(Stretch::POINT)
}

/// Never rounded up: confidence is what permits.
fn eight_bits(probability: f64) -> u8 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 255")]
    let bits = (probability.clamp(0.0, 1.0) * 255.0).floor() as u8;
    bits
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::track::tests::{flat, rig};
    use crate::track::{Answer, Sighting, Tracker};
    use nearfield_shared::rig::Rig;

    fn tracked(rig: &Rig, sightings: &[Sighting]) -> Vec<Track> {
        let mut tracker = Tracker::new(*rig);
        for picture in 0..3 {
            tracker.observe(Micros::from_millis(40 * picture), &Answer::Seen(sightings));
        }
        tracker.tracks().to_vec()
    }

    #[test]
    fn debris_is_claimed_where_it_lies_with_its_age() {
        let rig = rig();
        let tracks = tracked(&rig, &[flat(&rig, Category::Tool, 0.95, 100.0, 520.0)]);
        let told = claims(rig.stripe(), &tracks, Micros::from_millis(130));
        let claim = told[0].unwrap();
        assert!(claim.speaks_for_run_over() && told[1..].iter().all(Option::is_none));
        assert_eq!(
            (claim.category, claim.confidence, claim.age),
            (Category::Tool, 242, Micros::from_millis(50))
        );
        let (from, to) = (claim.stretch.start().get(), claim.stretch.end().get());
        assert!((60.0..=70.0).contains(&from) && (130.0..140.0).contains(&to), "{claim:?}");
    }

    #[test]
    fn people_come_first_and_far_things_are_left_out() {
        let rig = rig();
        let tracks = tracked(
            &rig,
            &[
                flat(&rig, Category::Tool, 0.95, -200.0, 520.0),
                flat(&rig, Category::Part, 0.9, 0.0, 520.0),
                flat(&rig, Category::Human, 0.3, 200.0, 800.0),
                flat(&rig, Category::Vehicle, 0.9, 300.0, 950.0),
            ],
        );
        let told = claims(rig.stripe(), &tracks, Micros::from_millis(100));
        let categories: Vec<_> = told.iter().flatten().map(|claim| claim.category).collect();
        assert_eq!(categories, [Category::Human, Category::Part, Category::Tool]);
    }

    #[test]
    fn objections_that_do_not_fit_object_to_everything() {
        let rig = rig();
        let parts: Vec<_> = (0..5)
            .map(|index| flat(&rig, Category::Part, 0.9, -250.0 + 120.0 * f64::from(index), 520.0))
            .collect();
        let told = claims(rig.stripe(), &tracked(&rig, &parts), Micros::from_millis(100));
        let last = told[3].unwrap();
        assert_eq!(last.category, Category::Unknown);
        let everywhere = Stretch::new(-300, 300).unwrap();
        assert_eq!(last.stretch, everywhere);
        assert!(last.objects_to(Stretch::new(280, 290).unwrap()));
    }

    #[test]
    fn an_unsure_class_is_an_objection() {
        let rig = rig();
        let tracks = tracked(&rig, &[flat(&rig, Category::Tool, 0.4, 0.0, 520.0)]);
        let claim = claims(rig.stripe(), &tracks, Micros::from_millis(100))[0].unwrap();
        assert_eq!(claim.category, Category::Unknown);
        assert!(!claim.speaks_for_run_over());
    }

    #[test]
    fn places_are_widened_and_probabilities_never_raised() {
        assert_eq!(stretch(-3.2, 4.1), Stretch::new(-4, 5).unwrap());
        assert_eq!(stretch(-1e9, 1e9), Stretch::new(i16::MIN, i16::MAX).unwrap());
        assert_eq!(
            (eight_bits(0.0), eight_bits(0.9019), eight_bits(1.0), eight_bits(f64::NAN)),
            (0, 229, 255, 0)
        );
    }
}
