//! The fleet as a table: a line for a robot, the worst first.

use std::time::Instant;

use serde::Serialize;

use crate::report::Verdict;
use crate::roster::{Entry, Roster};

/// Which robots are shown.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Filter {
    /// With one of these verdicts; none = with any.
    pub verdicts: Vec<Verdict>,
    /// With this in the robot's name, in the name of a module that matters, or in a cause; empty = any.
    pub text: String,
}

impl Filter {
    fn lets_pass(&self, row: &Row) -> bool {
        let text_is_found = || {
            let Row { robot, modules, because, .. } = row;
            [robot].into_iter().chain(modules).chain(because).any(|one| one.contains(&self.text))
        };
        (self.verdicts.is_empty() || self.verdicts.contains(&row.verdict)) && text_is_found()
    }
}

/// A robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub robot: String,
    /// The worst of its modules'.
    pub verdict: Verdict,
    /// Modules that let it drive.
    pub sound: usize,
    /// All of its modules.
    pub of: usize,
    /// The modules with that worst verdict.
    pub modules: Vec<String>,
    /// Their causes and warnings.
    pub because: Vec<String>,
    /// Since the newest sign of life of the most silent module, seconds.
    pub silent_s: f64,
}

/// The whole table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct View {
    /// Robots by verdict, in the order of [`Verdict::ALL`], whatever the filter.
    pub robots: [usize; 5],
    /// Modules likewise.
    pub modules: [usize; 5],
    /// Robots that the filter lets pass.
    pub matching: usize,
    /// One page of them.
    pub rows: Vec<Row>,
}

impl View {
    /// Of a roster, at a time; page `page` (from 0) of `length` rows.
    #[must_use]
    pub fn of(roster: &Roster, filter: &Filter, now: Instant, page: usize, length: usize) -> Self {
        let mut view = Self { robots: [0; 5], modules: [0; 5], matching: 0, rows: Vec::new() };
        let mut rows = Vec::new();
        let mut modules = roster.modules().peekable();
        while let Some(&(robot, ..)) = modules.peek() {
            let mut of_robot = Vec::with_capacity(8);
            while let Some((_, name, entry)) = modules.next_if(|(next, ..)| *next == robot) {
                view.modules[entry.verdict(now) as usize] += 1;
                of_robot.push((name, entry));
            }
            let row = row(robot, &of_robot, now);
            view.robots[row.verdict as usize] += 1;
            if filter.lets_pass(&row) {
                rows.push(row);
            }
        }
        // The roster is in the order of names, and stays so among equals.
        rows.sort_by_key(|row| std::cmp::Reverse(row.verdict));
        view.matching = rows.len();
        view.rows = rows.into_iter().skip(page.saturating_mul(length)).take(length).collect();
        view
    }

    /// For people.
    #[must_use]
    pub fn text(&self) -> String {
        let counted = |counts: &[usize; 5]| {
            let named = Verdict::ALL.iter().zip(counts).rev();
            named.map(|(verdict, count)| format!("{count} {}", verdict.name())).collect::<Vec<_>>().join(", ")
        };
        let mut text = format!(
            "{} robots: {}\n{} modules: {}\n\n{:<18} {:<8} {:>7}  {:>8}  modules, causes and warnings\n",
            self.robots.iter().sum::<usize>(),
            counted(&self.robots),
            self.modules.iter().sum::<usize>(),
            counted(&self.modules),
            "robot",
            "verdict",
            "sound",
            "silent s"
        );
        for row in &self.rows {
            let what = [row.modules.join(" "), row.because.join(", ")].join("  ");
            let sound = format!("{} of {}", row.sound, row.of);
            text += &format!(
                "{:<18} {:<8} {sound:>7}  {:>8.1}  {}\n",
                row.robot,
                row.verdict.name(),
                row.silent_s,
                what.trim()
            );
        }
        if self.matching > self.rows.len() {
            text += &format!("{} of {} robots that the filter lets pass\n", self.rows.len(), self.matching);
        }
        text
    }
}

fn row(robot: &str, modules: &[(&str, &Entry)], now: Instant) -> Row {
    let verdict = modules.iter().map(|(_, entry)| entry.verdict(now)).max().unwrap_or(Verdict::Lost);
    let worst =
        || modules.iter().filter(|(_, entry)| entry.verdict(now) == verdict && verdict != Verdict::Go);
    let mut because: Vec<String> = worst()
        // What a lost module said last is no reason any more.
        .filter(|_| verdict != Verdict::Lost)
        .flat_map(|(_, entry)| {
            entry.report.iter().flat_map(|report| report.causes.iter().chain(&report.warnings))
        })
        .cloned()
        .collect();
    because.sort_unstable();
    because.dedup();
    let silent = modules.iter().map(|(_, entry)| now.duration_since(entry.since)).max().unwrap_or_default();
    Row {
        robot: robot.to_owned(),
        verdict,
        sound: modules.iter().filter(|(_, entry)| entry.verdict(now).lets_drive()).count(),
        of: modules.len(),
        modules: worst().map(|(name, _)| (*name).to_owned()).collect(),
        because,
        silent_s: (silent.as_secs_f64() * 10.0).round() / 10.0,
    }
}
