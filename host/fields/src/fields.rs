//! Which field each zone is at the moment, and whether it is infringed.

use nearfield_configuration::{Configuration, Field, SpeedCase, Zone};
use nearfield_shared::limits::LONGEST_ALLOWED_GAP;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::Stripe;

/// Zones of a whole robot: A to H.
pub const ZONES: usize = 8;

/// A gap longer than this share of the longest that the controller allows is worth a warning.
const SUSPECT_SHARE: f64 = 0.5;

/// What a zone is in the case in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Role {
    /// It has a name, no more.
    #[default]
    Named,
    /// It warns.
    Warning,
    /// It asks for a stop.
    Protective,
}

impl Role {
    /// For programs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::Warning => "warning",
            Self::Protective => "protective",
        }
    }
}

/// What is in a zone, whatever its role.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Finding {
    /// Nothing.
    #[default]
    Free,
    /// A gap that is shorter than a cut, but more than half as long.
    Suspect,
    /// A cut, or something ahead that tier 3 sees.
    Infringed,
}

impl Finding {
    /// For programs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Suspect => "suspect",
            Self::Infringed => "infringed",
        }
    }
}

/// A zone at the moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ZoneState {
    /// What it is in the case in force.
    pub role: Role,
    /// What is in it.
    pub finding: Finding,
}

impl ZoneState {
    /// What it asks of the controller. A stricter role, or more in it, never asks for less.
    #[must_use]
    pub const fn verdict(self) -> HostVerdict {
        match (self.role, self.finding) {
            (Role::Named, _) | (_, Finding::Free) => HostVerdict::Clear,
            (Role::Protective, Finding::Infringed) => HostVerdict::Stop,
            (Role::Warning, Finding::Suspect | Finding::Infringed) | (Role::Protective, Finding::Suspect) => {
                HostVerdict::Warn
            }
        }
    }
}

/// All zones at the moment: a value of fixed size.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Report {
    /// The robot's speed, mm/s; `None` = it is not known.
    pub speed_mm_s: Option<f32>,
    /// The case in force, from 1; `None` = there are none, or all are in force together.
    pub case: Option<u8>,
    /// Zone A first; `None` = this module has no such zone.
    pub zones: [Option<ZoneState>; ZONES],
}

impl Report {
    /// Of a picture that was not seen: nothing is known of any zone.
    pub const NOTHING_SEEN: Self = Self { speed_mm_s: None, case: None, zones: [None; ZONES] };

    /// The zones of this module with their letters.
    pub fn named(&self) -> impl Iterator<Item = (char, ZoneState)> + '_ {
        ('A'..='H').zip(self.zones).filter_map(|(letter, state)| Some((letter, state?)))
    }

    /// What the host has to ask of the controller at least.
    #[must_use]
    pub fn verdict(&self) -> HostVerdict {
        self.zones
            .iter()
            .flatten()
            .fold(HostVerdict::Clear, |asked, zone| more_careful(asked, zone.verdict()))
    }
}

/// The more careful of two verdicts.
#[must_use]
pub const fn more_careful(one: HostVerdict, other: HostVerdict) -> HostVerdict {
    match (one, other) {
        (HostVerdict::Stop, _) | (_, HostVerdict::Stop) => HostVerdict::Stop,
        (HostVerdict::Warn, _) | (_, HostVerdict::Warn) => HostVerdict::Warn,
        (HostVerdict::Clear, HostVerdict::Clear) => HostVerdict::Clear,
    }
}

/// What was found in a stretch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evidence {
    /// The stripe is not on the floor here.
    Gap,
    /// Tier 3 sees something that begins so far behind the stripe, whole millimetres; below 0 it lies on it or before it.
    Ahead(i32),
}

/// A stretch of the stripe in which something was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Smaller stripe coordinate, millimetres.
    pub start_mm: f64,
    /// Larger stripe coordinate.
    pub end_mm: f64,
    /// What.
    pub evidence: Evidence,
}

impl Stretch {
    /// What it is for a zone that it touches and that looks so far ahead.
    fn finding(&self, ahead_mm: f64) -> Finding {
        let longest = f64::from(LONGEST_ALLOWED_GAP.get());
        match self.evidence {
            Evidence::Gap if self.end_mm - self.start_mm > longest => Finding::Infringed,
            Evidence::Gap if self.end_mm - self.start_mm > longest * SUSPECT_SHARE => Finding::Suspect,
            Evidence::Ahead(behind) if f64::from(behind) <= ahead_mm => Finding::Infringed,
            Evidence::Gap | Evidence::Ahead(_) => Finding::Free,
        }
    }
}

/// Why zones cannot be used with a rig.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "zone {name} reaches from {start_mm} to {end_mm} mm, the rig watches {watched_start_mm:.0} to {watched_end_mm:.0} mm only; \
     nothing is seen beyond that: change the zone"
)]
pub struct ZonesError {
    /// The zone.
    pub name: String,
    /// Where it begins.
    pub start_mm: f64,
    /// Where it ends.
    pub end_mm: f64,
    /// Where the watched stripe begins.
    pub watched_start_mm: f64,
    /// Where it ends.
    pub watched_end_mm: f64,
}

/// A zone as it is judged.
#[derive(Debug, Clone, Copy)]
struct Judged {
    index: usize,
    start_mm: f64,
    end_mm: f64,
    ahead_mm: f64,
    /// Without cases.
    always: Role,
}

/// A case: what each zone is up to a speed.
#[derive(Debug, Clone, Copy)]
struct Case {
    up_to_mm_s: f64,
    roles: [Role; ZONES],
}

/// See the module's documentation of the crate.
#[derive(Debug, Clone, Default)]
pub struct Fields {
    zones: Vec<Judged>,
    cases: Vec<Case>,
    strictest: [Role; ZONES],
}

fn index_of(name: &str) -> Option<usize> {
    let [letter @ b'A'..=b'H'] = name.as_bytes() else { return None };
    Some(usize::from(letter - b'A'))
}

impl Fields {
    /// Of a configuration, whose reader has made sure that names are letters and that cases rise.
    #[must_use]
    pub fn new(configuration: &Configuration) -> Self {
        let cases: Vec<Case> = configuration.cases.iter().map(case).collect();
        let mut strictest = [Role::Named; ZONES];
        for case in &cases {
            for (strict, role) in strictest.iter_mut().zip(case.roles) {
                *strict = (*strict).max(role);
            }
        }
        Self { zones: configuration.zones.iter().filter_map(judged).collect(), cases, strictest }
    }

    /// Do all zones lie where this rig sees something?
    ///
    /// # Errors
    /// One does not.
    pub fn check(configuration: &Configuration, stripe: &Stripe) -> Result<(), ZonesError> {
        let outside =
            configuration.zones.iter().find(|zone| zone.start_mm < stripe.start || zone.end_mm > stripe.end);
        outside.map_or(Ok(()), |zone| {
            Err(ZonesError {
                name: zone.name.clone(),
                start_mm: zone.start_mm,
                end_mm: zone.end_mm,
                watched_start_mm: stripe.start,
                watched_end_mm: stripe.end,
            })
        })
    }

    /// Are there any?
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.zones.is_empty()
    }

    /// The case for a speed (sign does not matter), from 1; `None` = there are none, or all are in force together.
    #[must_use]
    pub fn case_for(&self, speed_mm_s: Option<f32>) -> Option<u8> {
        let speed = f64::from(speed_mm_s?).abs();
        let index = self.cases.iter().position(|case| speed <= case.up_to_mm_s)?;
        u8::try_from(index + 1).ok()
    }

    /// What a zone is at this moment.
    fn role(&self, zone: &Judged, case: Option<u8>) -> Role {
        if self.cases.is_empty() {
            return zone.always;
        }
        let chosen = case.and_then(|case| self.cases.get(usize::from(case) - 1));
        chosen.map_or(&self.strictest, |case| &case.roles)[zone.index]
    }

    /// Judges what was found in a picture. Allocates nothing.
    pub fn judge(&self, speed_mm_s: Option<f32>, found: impl Iterator<Item = Stretch>) -> Report {
        let case = self.case_for(speed_mm_s);
        let mut report = Report { speed_mm_s, case, zones: [None; ZONES] };
        for zone in &self.zones {
            report.zones[zone.index] =
                Some(ZoneState { role: self.role(zone, case), finding: Finding::Free });
        }
        for stretch in found {
            for zone in &self.zones {
                let touches = stretch.start_mm <= zone.end_mm && stretch.end_mm >= zone.start_mm;
                if let Some(state) = report.zones[zone.index].as_mut().filter(|_| touches) {
                    state.finding = state.finding.max(stretch.finding(zone.ahead_mm));
                }
            }
        }
        report
    }
}

fn judged(zone: &Zone) -> Option<Judged> {
    let always = match zone.field {
        Field::Protective => Role::Protective,
        Field::Warning => Role::Warning,
    };
    let Zone { start_mm, end_mm, ahead_mm, .. } = *zone;
    Some(Judged { index: index_of(&zone.name)?, start_mm, end_mm, ahead_mm, always })
}

fn case(case: &SpeedCase) -> Case {
    let mut roles = [Role::Named; ZONES];
    for (names, role) in [(&case.warning, Role::Warning), (&case.protective, Role::Protective)] {
        for index in names.iter().filter_map(|name| index_of(name)) {
            roles[index] = roles[index].max(role);
        }
    }
    Case { up_to_mm_s: case.up_to_mm_s, roles }
}

#[cfg(test)]
mod tests;
