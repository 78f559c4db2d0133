//! Adds outcomes up by family.

use std::collections::BTreeMap;

use serde::Serialize;

use super::statistics::{interval, magnitude_quantile, root_mean_square};
use super::{Outcome, RELIABILITY_BINS};
use crate::scene_file::ExpectedCutoff;

/// Materials of the "glossy and metal" goal; the others are matt.
const SHINY: [&str; 6] = ["plastic", "aluminium", "steel", "chrome", "leather", "cable"];

/// A share that was counted, with its 95 % interval (Wilson).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// How often.
    pub hits: usize,
    /// Of how many.
    pub trials: usize,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Share {
    fn of(hits: usize, trials: usize) -> Self {
        let (low, high) = interval(hits, trials);
        Self { hits, trials, low, high }
    }

    fn text(&self) -> String {
        if self.trials == 0 {
            return "-".to_owned();
        }
        format!("{}/{} ({:.1}-{:.1} %)", self.hits, self.trials, 100.0 * self.low, 100.0 * self.high)
    }
}

/// Heights of a group of objects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeightTable {
    /// Which objects.
    pub group: &'static str,
    /// Objects with the stripe on them.
    pub objects: usize,
    /// Objects without a height found.
    pub unseen: usize,
    /// Root mean square of the error, millimetres.
    pub rmse_mm: Option<f64>,
    /// Median of its magnitude, millimetres.
    pub median_mm: Option<f64>,
    /// 95 % of the magnitudes are not larger, millimetres.
    pub high_mm: Option<f64>,
    /// Size classes that are wrong outside 50 +- 3 mm.
    pub wrong_class: usize,
}

/// Gaps of some length: a shorter one than tier 1 stops for is told all the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapTable {
    /// Which lengths, of the true gap; `clean floors` for those without any.
    pub group: &'static str,
    /// A gap of [`LEAST_TOLD_MM`] and more was told.
    pub told: Share,
    /// Host and controller stopped.
    pub stopped: Share,
}

/// On a clean floor, single columns without a reading make gaps shorter than this, millimetres.
pub const LEAST_TOLD_MM: f32 = 3.0;
/// Lengths of true gaps that are counted together, millimetres: first included, second not.
const GAP_GROUPS: [(&str, f64, f64); 3] =
    [("3 to 5 mm", 3.0, 5.0), ("5 to 7 mm", 5.0, 7.0), ("7 mm and more", 7.0, f64::INFINITY)];

/// One family's verdicts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FamilyTable {
    /// Its name; `all` for all.
    pub family: String,
    /// Stops on clean floors.
    pub false_stops: Share,
    /// Missed objects.
    pub misses: Share,
}

/// Everything that a campaign found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Scenes judged.
    pub scenes: usize,
    /// By family.
    pub families: Vec<FamilyTable>,
    /// By length of the true gap, and on clean floors.
    pub gaps: Vec<GapTable>,
    /// By group of materials.
    pub heights: Vec<HeightTable>,
    /// For each eighth of the quality scale: how many readings were right.
    pub reliability: Vec<Share>,
    /// Median and worst time for a frame, microseconds.
    pub time_us: [u64; 2],
    /// The slowest frame's scene.
    pub slowest: Option<u64>,
    /// Clean floors on which the stripe cannot be seen everywhere ([`Outcome::is_measurable`]), and how many of them
    /// stopped. They are in no other figure of false stops.
    pub not_measurable: [usize; 2],
    /// Scenes that stopped without a reason.
    pub false_stops: Vec<u64>,
    /// Scenes that did not stop although they must.
    pub misses: Vec<u64>,
    /// Scenes with a height that is off by more than [`GROSS_MM`].
    pub gross_heights: Vec<u64>,
}

/// A height error to look at, millimetres.
pub const GROSS_MM: f64 = 3.0;

impl Summary {
    /// Adds up.
    #[must_use]
    pub fn of(outcomes: &[Outcome]) -> Self {
        let mut names: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
        for outcome in outcomes {
            names.entry("all").or_default().push(outcome);
            for family in &outcome.families {
                names.entry(family).or_default().push(outcome);
            }
        }
        let mut times: Vec<(u64, u64)> =
            outcomes.iter().map(|outcome| (outcome.time_us, outcome.scene)).collect();
        times.sort_unstable();
        let time_at = |index: usize| times.get(index).map_or(0, |(time, _)| *time);
        let numbers = |wanted: &dyn Fn(&Outcome) -> bool| {
            outcomes.iter().filter(|outcome| wanted(outcome)).map(|outcome| outcome.scene).collect()
        };
        let gross = |outcome: &Outcome| {
            let errors = outcome.objects.iter().filter_map(|object| object.error_mm());
            errors.into_iter().any(|error| error.abs() > GROSS_MM)
        };
        Self {
            scenes: outcomes.len(),
            families: names.into_iter().map(|(name, outcomes)| family(name, &outcomes)).collect(),
            gaps: gaps(outcomes),
            heights: vec![
                heights("matt", outcomes, |material| !is_shiny(material)),
                heights("glossy and metal", outcomes, is_shiny),
            ],
            reliability: reliability(outcomes),
            time_us: [time_at(times.len() / 2), time_at(times.len().saturating_sub(1))],
            slowest: times.last().map(|(_, scene)| *scene),
            not_measurable: [
                numbers(&is_dark),
                numbers(&|outcome| is_dark(outcome) && outcome.is_false_stop()),
            ]
            .map(|scenes: Vec<u64>| scenes.len()),
            false_stops: numbers(&is_false_stop),
            misses: numbers(&Outcome::is_miss),
            gross_heights: numbers(&gross),
        }
    }

    /// Tables for people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text =
            format!("{} scenes\n{:<22} {:>26} {:>26}\n", self.scenes, "family", "false stops", "misses");
        for row in &self.families {
            text += &format!("{:<22} {:>26} {:>26}\n", row.family, row.false_stops.text(), row.misses.text());
        }
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
        let [dark, stopped] = self.not_measurable;
        text += &format!("clean floors that are not measurable: {dark}, of which stopped: {stopped}\n");
        text += "true gap                                     told                    stopped\n";
        for row in &self.gaps {
            text += &format!("{:<22} {:>26} {:>26}\n", row.group, row.told.text(), row.stopped.text());
        }
        text += "heights                objects  unseen   RMSE mm  median mm    95 % mm  class wrong\n";
        for row in &self.heights {
            text += &format!(
                "{:<22} {:>7} {:>7} {:>9} {:>10} {:>10} {:>12}\n",
                row.group,
                row.objects,
                row.unseen,
                number(row.rmse_mm),
                number(row.median_mm),
                number(row.high_mm),
                row.wrong_class
            );
        }
        text += "quality                readings that are right\n";
        for (bin, share) in self.reliability.iter().enumerate() {
            let step = 256 / RELIABILITY_BINS;
            let label = format!("{} to {}", bin * step, (bin + 1) * step - 1);
            let right = 100.0 * share.hits as f64 / share.trials.max(1) as f64;
            text += &format!("{label:<22} {right:>7.2} % of {}\n", share.trials);
        }
        text += &format!(
            "time: median {} us, worst {} us (scene {})\n",
            self.time_us[0],
            self.time_us[1],
            self.slowest.map_or("-".to_owned(), |scene| scene.to_string())
        );
        for (what, scenes) in [
            ("false stops", &self.false_stops),
            ("misses", &self.misses),
            ("heights off by more than 3 mm", &self.gross_heights),
        ] {
            let numbers: Vec<String> = scenes.iter().map(u64::to_string).collect();
            text += &format!(
                "{what}: {}\n",
                if numbers.is_empty() { "none".to_owned() } else { numbers.join(" ") }
            );
        }
        text
    }
}

/// Is it a clean floor whose stripe cannot be seen everywhere?
fn is_dark(outcome: &Outcome) -> bool {
    outcome.expected == ExpectedCutoff::NoTrip && !outcome.is_measurable()
}

/// Did a clean floor stop whose stripe can be seen everywhere?
fn is_false_stop(outcome: &Outcome) -> bool {
    outcome.is_false_stop() && outcome.is_measurable()
}

fn is_shiny(material: &str) -> bool {
    SHINY.iter().any(|name| material.starts_with(name))
}

fn family(name: &str, outcomes: &[&Outcome]) -> FamilyTable {
    let count = |wanted: &dyn Fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| wanted(outcome)).count();
    let clean = count(&|outcome| outcome.expected == ExpectedCutoff::NoTrip && outcome.is_measurable());
    let cut =
        count(&|outcome| matches!(outcome.expected, ExpectedCutoff::Trip | ExpectedCutoff::StripeMissing));
    FamilyTable {
        family: name.to_owned(),
        false_stops: Share::of(count(&is_false_stop), clean),
        misses: Share::of(count(&Outcome::is_miss), cut),
    }
}

fn gaps(outcomes: &[Outcome]) -> Vec<GapTable> {
    let table = |group, wanted: &dyn Fn(&Outcome) -> bool| {
        let of: Vec<&Outcome> = outcomes.iter().filter(|outcome| wanted(outcome)).collect();
        let share = |is_hit: &dyn Fn(&Outcome) -> bool| {
            Share::of(of.iter().filter(|outcome| is_hit(outcome)).count(), of.len())
        };
        GapTable {
            group,
            told: share(&|outcome| outcome.gap_mm >= LEAST_TOLD_MM),
            stopped: share(&|outcome| outcome.host_cut && outcome.controller_cut),
        }
    };
    let is_clean = |outcome: &Outcome| outcome.expected == ExpectedCutoff::NoTrip && outcome.is_measurable();
    let groups = GAP_GROUPS.iter().map(|(group, least, most)| {
        table(*group, &|outcome| !is_clean(outcome) && (*least..*most).contains(&outcome.true_gap_mm))
    });
    groups.chain([table("clean floors", &is_clean)]).collect()
}

fn heights(group: &'static str, outcomes: &[Outcome], wanted: impl Fn(&str) -> bool) -> HeightTable {
    let objects: Vec<_> = outcomes
        .iter()
        .flat_map(|outcome| &outcome.objects)
        .filter(|object| wanted(&object.material))
        .collect();
    let errors: Vec<f64> = objects.iter().filter_map(|object| object.error_mm()).collect();
    HeightTable {
        group,
        objects: objects.len(),
        unseen: objects.len() - errors.len(),
        rmse_mm: root_mean_square(&errors),
        median_mm: magnitude_quantile(&errors, 0.5),
        high_mm: magnitude_quantile(&errors, 0.95),
        wrong_class: objects.iter().filter(|object| object.is_class_wrong()).count(),
    }
}

fn reliability(outcomes: &[Outcome]) -> Vec<Share> {
    (0..RELIABILITY_BINS)
        .map(|bin| {
            let bins = outcomes.iter().map(|outcome| outcome.reliability[bin]);
            let (readings, right) = bins.fold((0_usize, 0_usize), |(readings, right), [all, good]| {
                (readings + all as usize, right + good as usize)
            });
            Share::of(right, readings)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(expected: ExpectedCutoff, true_gap_mm: f64, gap_mm: f32, stopped: bool) -> Outcome {
        Outcome {
            scene: 0,
            families: Vec::new(),
            expected,
            true_gap_mm,
            faintest: 100.0,
            host_cut: stopped,
            controller_cut: stopped,
            gap_mm,
            objects: Vec::new(),
            reliability: [[0; 2]; RELIABILITY_BINS],
            time_us: 1,
        }
    }

    /// A gap that is too short to stop for is told, and a clean floor counts by itself.
    #[test]
    fn gaps_are_counted_by_their_true_length_told_or_stopped() {
        let outcomes = [
            outcome(ExpectedCutoff::Borderline, 3.0, 4.9, false),
            outcome(ExpectedCutoff::Borderline, 4.9, 5.2, true),
            outcome(ExpectedCutoff::Borderline, 4.0, 2.9, false),
            outcome(ExpectedCutoff::Borderline, 5.0, 5.5, true),
            outcome(ExpectedCutoff::Trip, 7.0, 0.0, false),
            outcome(ExpectedCutoff::NoTrip, 0.0, 3.0, false),
            outcome(ExpectedCutoff::NoTrip, 0.0, 0.0, false),
        ];
        let counted: Vec<_> = gaps(&outcomes)
            .iter()
            .map(|row| (row.group, row.told.hits, row.told.trials, row.stopped.hits, row.stopped.trials))
            .collect();
        let expected = [
            ("3 to 5 mm", 2, 3, 1, 3),
            ("5 to 7 mm", 1, 1, 1, 1),
            ("7 mm and more", 0, 1, 0, 1),
            ("clean floors", 1, 2, 0, 2),
        ];
        assert_eq!(counted, expected);
    }
}
