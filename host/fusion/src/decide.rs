//! The action table over what lies on the stripe and ahead of it.

use crate::track::Track;
use nearfield_shared::action::{Action, Category, action_for};
use nearfield_shared::height::SizeClass;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::Stripe;

/// One stretch in which the stripe is cut, lifted or lowered, as tiers 1 and 2 of the same picture see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstruction {
    /// Smaller stripe coordinate, millimetres.
    pub start: f64,
    /// Larger stripe coordinate.
    pub end: f64,
    /// Tier 2's size.
    pub size: SizeClass,
}

/// What to do, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// What the host tells the controller.
    pub verdict: HostVerdict,
    /// What the robot's planner is advised to do; `None` = drive on.
    pub action: Option<Action>,
    /// The reasons, most restrictive first.
    pub reasons: Vec<Reason>,
}

/// One reason of an advice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reason {
    /// What is there.
    pub category: Category,
    /// How large it is.
    pub size: SizeClass,
    /// What the action table says.
    pub action: Action,
    /// From which to which stripe coordinate, millimetres.
    pub along: (f64, f64),
    /// Is it on the stripe (or ahead of it)?
    pub on_stripe: bool,
}

/// A class counts from this calibrated probability on; below it is unknown. A person counts at any confidence.
pub const LEAST_CONFIDENCE: f64 = 0.5;
/// A track and an obstruction are one thing if they overlap when the track is widened by this, millimetres: a laser ray
/// is named by where it would meet the floor, and a thing shifts that by its own height.
const AGREEMENT_MARGIN: f64 = 30.0;
/// What begins no farther behind the stripe than this is on its way to it, millimetres.
pub const AHEAD: f64 = 400.0;

/// What a track may be taken for.
#[must_use]
pub fn believed_category(track: &Track) -> Category {
    match track.category() {
        Category::Human => Category::Human,
        category if track.is_confirmed() && track.confidence() >= LEAST_CONFIDENCE => category,
        _ => Category::Unknown,
    }
}

/// Does the track cover a part of this stretch of the stripe, across it, too?
fn covers(track: &Track, stripe: &Stripe, start: f64, end: f64) -> bool {
    let (from, to) = track.footprint.along(stripe);
    let (near, far) = track.footprint.behind(stripe);
    let margin = AGREEMENT_MARGIN;
    from - margin <= end && start <= to + margin && near <= margin && far >= -margin
}

/// Categories of one obstruction, joined: the one whose action is the most restrictive for this size.
fn joined(categories: impl Iterator<Item = Category>, size: SizeClass) -> Category {
    categories.max_by_key(|category| action_for(*category, size)).unwrap_or(Category::Unknown)
}

/// The advice for one picture. `tier_three` tells whether tier 3 has answered lately: without it everything on the stripe is
/// unknown, and the robot is warned even on free floor.
#[must_use]
pub fn decide(stripe: &Stripe, obstructions: &[Obstruction], tracks: &[Track], tier_three: bool) -> Advice {
    let mut reasons: Vec<Reason> = Vec::new();
    for obstruction in obstructions {
        let there = tracks
            .iter()
            .filter(|track| covers(track, stripe, obstruction.start, obstruction.end))
            .map(believed_category);
        let category = if tier_three { joined(there, obstruction.size) } else { Category::Unknown };
        reasons.push(Reason {
            category,
            size: obstruction.size,
            action: action_for(category, obstruction.size),
            along: (obstruction.start, obstruction.end),
            on_stripe: true,
        });
    }
    for track in tracks {
        let along = track.footprint.along(stripe);
        let (near, _) = track.footprint.behind(stripe);
        let on_stripe =
            obstructions.iter().any(|obstruction| covers(track, stripe, obstruction.start, obstruction.end));
        let (category, size) = (believed_category(track), track.footprint.size());
        // A person beside the stripe counts as well as one ahead of it; so does one whom it does not show.
        if category == Category::Human || (!on_stripe && near <= AHEAD) {
            reasons.push(Reason { category, size, action: action_for(category, size), along, on_stripe });
        }
    }
    reasons.sort_by_key(|reason| core::cmp::Reverse((reason.action, reason.on_stripe)));
    let verdict = reasons
        .iter()
        .map(verdict_of)
        .fold(if tier_three { HostVerdict::Clear } else { HostVerdict::Warn }, more_careful);
    Advice { verdict, action: reasons.first().map(|reason| reason.action), reasons }
}

/// What one reason makes the host tell the controller.
fn verdict_of(reason: &Reason) -> HostVerdict {
    match (reason.category, reason.on_stripe, reason.action) {
        // People: stop wherever they are seen.
        (Category::Human, _, _) | (_, true, Action::StopAndWarn | Action::GoAround) => HostVerdict::Stop,
        (_, true, Action::RunOver) | (_, false, Action::StopAndWarn | Action::GoAround) => HostVerdict::Warn,
        (_, false, Action::RunOver) => HostVerdict::Clear,
    }
}

/// The more careful of two.
const fn more_careful(one: HostVerdict, other: HostVerdict) -> HostVerdict {
    match (one, other) {
        (HostVerdict::Stop, _) | (_, HostVerdict::Stop) => HostVerdict::Stop,
        (HostVerdict::Warn, _) | (_, HostVerdict::Warn) => HostVerdict::Warn,
        (HostVerdict::Clear, HostVerdict::Clear) => HostVerdict::Clear,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::track::tests::{flat, rig};
    use crate::track::{Answer, Tracker};
    use nearfield_shared::rig::Rig;
    use nearfield_shared::units::Micros;

    const SIZES: [SizeClass; 3] = [SizeClass::Small, SizeClass::Large, SizeClass::Unknown];

    /// A track of this category, seen three times, at this distance behind the stripe.
    fn tracks(rig: &Rig, category: Category, confidence: f64, behind: f64) -> Vec<Track> {
        let mut tracker = Tracker::new(*rig);
        for picture in 0..3 {
            let sighting = flat(rig, category, confidence, 0.0, 500.0 + behind);
            tracker.observe(Micros::from_millis(40 * picture), &Answer::Seen(&[sighting]));
        }
        tracker.tracks().to_vec()
    }

    fn on_stripe(size: SizeClass) -> [Obstruction; 1] {
        [Obstruction { start: -20.0, end: 20.0, size }]
    }

    /// Every category, size, confidence and availability of tier 3, for a thing on the stripe.
    #[test]
    fn the_truth_table_of_what_lies_on_the_stripe() {
        let rig = rig();
        for category in Category::ALL {
            for size in SIZES {
                for sure in [false, true] {
                    for tier_three in [false, true] {
                        let tracks = tracks(&rig, category, if sure { 0.9 } else { 0.3 }, -10.0);
                        let advice = decide(rig.stripe(), &on_stripe(size), &tracks, tier_three);
                        let human = category == Category::Human;
                        let known = tier_three && (sure || human);
                        let expected = action_for(if known { category } else { Category::Unknown }, size);
                        // A person is told also by the track itself.
                        let expected = if human { Action::StopAndWarn } else { expected };
                        assert_eq!(
                            advice.action,
                            Some(expected),
                            "{category:?} {size:?} {sure} {tier_three}"
                        );
                        let free = expected == Action::RunOver;
                        assert_eq!(advice.verdict == HostVerdict::Stop, !free);
                        assert!(advice.verdict != HostVerdict::Clear, "something is there");
                    }
                }
            }
        }
    }

    /// What is only ahead of the stripe warns; a person stops.
    #[test]
    fn the_truth_table_of_what_lies_ahead() {
        let rig = rig();
        for category in Category::ALL {
            for tier_three in [false, true] {
                let tracks = tracks(&rig, category, 0.9, 120.0);
                let advice = decide(rig.stripe(), &[], &tracks, tier_three);
                let small = action_for(category, SizeClass::Small);
                let expected = match (category, small) {
                    (Category::Human, _) => HostVerdict::Stop,
                    (_, Action::RunOver) if tier_three => HostVerdict::Clear,
                    _ => HostVerdict::Warn,
                };
                assert_eq!(advice.verdict, expected, "{category:?} {tier_three}");
            }
        }
    }

    #[test]
    fn nothing_anywhere_is_clear_only_while_tier_three_answers() {
        let rig = rig();
        let clear = decide(rig.stripe(), &[], &[], true);
        assert_eq!((clear.verdict, clear.action, clear.reasons.len()), (HostVerdict::Clear, None, 0));
        assert_eq!(decide(rig.stripe(), &[], &[], false).verdict, HostVerdict::Warn);
    }

    #[test]
    fn a_thing_that_tier_three_does_not_see_is_unknown() {
        let rig = rig();
        for size in SIZES {
            let advice = decide(rig.stripe(), &on_stripe(size), &[], true);
            assert_eq!((advice.verdict, advice.action), (HostVerdict::Stop, Some(Action::StopAndWarn)));
        }
        // A tool elsewhere on the stripe is not what is seen here.
        let elsewhere = [Obstruction { start: 150.0, end: 170.0, size: SizeClass::Small }];
        let advice = decide(rig.stripe(), &elsewhere, &tracks(&rig, Category::Tool, 0.9, -10.0), true);
        assert_eq!(advice.verdict, HostVerdict::Stop);
    }

    #[test]
    fn a_tool_with_a_hand_on_it_is_a_person() {
        let rig = rig();
        let mut both = tracks(&rig, Category::Tool, 0.99, -10.0);
        both.extend(tracks(&rig, Category::Human, 0.2, -5.0));
        let advice = decide(rig.stripe(), &on_stripe(SizeClass::Small), &both, true);
        assert_eq!((advice.verdict, advice.action), (HostVerdict::Stop, Some(Action::StopAndWarn)));
        assert_eq!(advice.reasons[0].category, Category::Human);
    }

    #[test]
    fn one_sighting_is_not_yet_a_class() {
        let rig = rig();
        let mut tracker = Tracker::new(rig);
        tracker.observe(Micros::ZERO, &Answer::Seen(&[flat(&rig, Category::Tool, 0.99, 0.0, 490.0)]));
        let advice = decide(rig.stripe(), &on_stripe(SizeClass::Small), tracker.tracks(), true);
        assert_eq!(advice.action, Some(Action::StopAndWarn));
    }
}
