//! Run-over through the whole controller: what the relays do for every combination of claim and thing on the stripe.

use crate::testing::{Bench, rig};
use nearfield_shared::action::Category;
use nearfield_shared::causes::StopCause;
use nearfield_shared::limits::{
    LONGEST_RUN_OVER, REDUCED_SPEED_PERCENT, RUN_OVER_AGREEMENT, RUN_OVER_HEIGHT,
};
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::run_over::{Claim, Claims, NO_CLAIMS, Stretch};
use nearfield_shared::status::{Channels, ResetCause, StateCode, Status, Warnings};
use nearfield_shared::units::Micros;

fn status(bench: &Bench) -> Status {
    Status::parse(&bench.controller.status(bench.now)).unwrap()
}

fn claims(category: Category) -> Claims {
    let stretch = Stretch::new(-30, 40).unwrap();
    [Some(Claim { stretch, category, confidence: 250, age: Micros::from_millis(60) }), None, None, None]
}

/// A thing between -20 and 30 mm, of this height; `None` = no stripe there.
fn thing(height: Option<f32>) -> impl Fn(f32) -> Option<f32> {
    move |s| if (-20.0..30.0).contains(&s) { height } else { Some(0.0) }
}

fn armed(allowed: bool) -> Bench {
    let mut bench = Bench::with_rig(ResetCause::PowerOn, rig().with_run_over(allowed));
    bench.arm();
    bench
}

/// Claims for long enough, then shows the thing for some frames. Are the relays closed all the time?
fn stays_closed(bench: &mut Bench, height: Option<f32>, verdict: HostVerdict, frames: usize) -> bool {
    for _ in 0..RUN_OVER_AGREEMENT {
        bench.clean_frame();
    }
    (0..frames).all(|_| {
        let scan = bench.profile(thing(height), verdict);
        bench.frame(Some(&scan)).outputs.relays == Channels::CLOSED
    })
}

#[test]
fn only_a_low_thing_that_is_claimed_as_debris_passes() {
    let (below, at) = (RUN_OVER_HEIGHT.get() - 0.5, RUN_OVER_HEIGHT.get() + 0.5);
    let heights = [Some(0.0), Some(6.0), Some(below), Some(at), Some(60.0), Some(-12.0), None];
    let verdicts = [HostVerdict::Clear, HostVerdict::Warn, HostVerdict::Stop];
    let claimed = Category::ALL.into_iter().map(Some).chain([None]);
    let mut passed = 0;
    for category in claimed {
        for allowed in [false, true] {
            let mut bench = armed(allowed);
            for height in heights {
                for verdict in verdicts {
                    if status(&bench).state != StateCode::Running {
                        bench = armed(allowed);
                    }
                    bench.claims = category.map_or(NO_CLAIMS, claims);
                    let closed = stays_closed(&mut bench, height, verdict, 5);
                    let debris = matches!(category, Some(Category::Tool | Category::Material));
                    let low = height.is_some_and(|height| height > 0.0 && height < RUN_OVER_HEIGHT.get());
                    let passes = allowed && debris && low;
                    let free = height == Some(0.0);
                    let expected = (free || passes) && verdict != HostVerdict::Stop;
                    assert_eq!(closed, expected, "{category:?} {allowed} {height:?} {verdict:?}");
                    passed += u32::from(closed && passes);
                }
            }
        }
    }
    assert_eq!(passed, 8, "two categories, two heights, two verdicts");
}

#[test]
fn a_permit_is_told_slows_down_and_ends() {
    let mut bench = armed(true);
    bench.claims = claims(Category::Tool);
    assert!(stays_closed(&mut bench, Some(20.0), HostVerdict::Clear, 2));
    let told = status(&bench);
    let permit = told.run_over.unwrap();
    assert!(permit.stretch.start.get() >= -20.0 && permit.stretch.end.get() <= 30.0, "{permit:?}");
    assert!(permit.stretch.length().get() > 40.0 && permit.time_left < LONGEST_RUN_OVER);
    assert!(told.warnings.has_any(Warnings::RUN_OVER) && bench.controller.outputs().warning);
    assert!(told.health.permitted_speed_percent <= REDUCED_SPEED_PERCENT);
    assert!(told.highest.unwrap().height.get() > 19.0, "tier 2 sees it as it is");
    let frames = usize::try_from(LONGEST_RUN_OVER.get() / 20_000).unwrap();
    assert!(!stays_closed(&mut bench, Some(20.0), HostVerdict::Clear, frames + 3), "it has run out");
    assert!(status(&bench).latched_causes.contains(StopCause::StripeCut));
    let after = status(&bench);
    assert!(after.run_over.is_none() && !after.warnings.has_any(Warnings::RUN_OVER));
}

#[test]
fn the_permit_ends_with_the_claim() {
    let mut bench = armed(true);
    bench.claims = claims(Category::Material);
    assert!(stays_closed(&mut bench, Some(20.0), HostVerdict::Clear, 3));
    bench.claims = NO_CLAIMS;
    let scan = bench.profile(thing(Some(20.0)), HostVerdict::Clear);
    bench.frame(Some(&scan));
    assert_eq!(bench.controller.outputs().relays, Channels::OPEN, "longer than the immediate gap: at once");
}

#[test]
fn no_claim_helps_over_the_restart_interlock() {
    let mut bench = armed(true);
    assert!(!stays_closed(&mut bench, Some(20.0), HostVerdict::Clear, 5), "nothing is claimed");
    bench.claims = claims(Category::Tool);
    for _ in 0..20 {
        let scan = bench.profile(thing(Some(20.0)), HostVerdict::Clear);
        bench.frame(Some(&scan));
        assert_eq!(status(&bench).state, StateCode::Stopped, "a stopped robot is not let over anything");
    }
}

#[test]
fn one_line_scan_without_the_claim_breaks_the_agreement() {
    for broken in [false, true] {
        let mut bench = armed(true);
        for frame in 0..RUN_OVER_AGREEMENT {
            bench.claims = if broken && frame == 1 { NO_CLAIMS } else { claims(Category::Tool) };
            bench.clean_frame();
        }
        bench.claims = claims(Category::Tool);
        let scan = bench.profile(thing(Some(20.0)), HostVerdict::Clear);
        let relays = bench.frame(Some(&scan)).outputs.relays;
        assert_eq!(relays, if broken { Channels::OPEN } else { Channels::CLOSED });
    }
}

/// What has passed counts as floor for tier 1, but it is no floor: the floor's own watch does not learn from it.
#[test]
fn the_floor_is_not_learnt_from_what_passes() {
    let start = rig().stripe().start as i16;
    let mut bench = armed(true);
    let stretch = Stretch::new(start, start + 80).unwrap();
    let claim = Claim { stretch, category: Category::Tool, confidence: 250, age: Micros::from_millis(60) };
    bench.claims = [Some(claim), None, None, None];
    for _ in 0..RUN_OVER_AGREEMENT {
        bench.clean_frame();
    }
    let before = status(&bench).health;
    for _ in 0..16 {
        // A floor that lies a little higher everywhere, and debris at the stripe's beginning.
        let height = |s: f32| if s < f32::from(start) + 60.0 { 20.0 } else { 0.4 };
        let scan = bench.profile(|s| Some(height(s)), HostVerdict::Clear);
        assert_eq!(bench.frame(Some(&scan)).outputs.relays, Channels::CLOSED);
    }
    let after = status(&bench).health;
    assert!(status(&bench).run_over.is_some());
    assert_eq!((after.floor_offset, after.floor_rise), (before.floor_offset, before.floor_rise));
}
