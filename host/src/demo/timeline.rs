//! The script laid out in time: which act is on, where the objects are, what is wrong.

use super::script::{Act, Action, Cue};
use crate::twin::SceneObject;

/// What is wrong with the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFault {
    /// See [`Action::LensCovered`].
    Covered,
    /// See [`Action::CameraFrozen`].
    Frozen,
    /// See [`Action::ReplayPictures`].
    Replayed,
}

/// The acts one after the other.
#[derive(Debug, Clone)]
pub struct Timeline {
    acts: Vec<Act>,
    /// Beginning of each act, milliseconds; one more for the end.
    starts: Vec<f64>,
}

/// What is wrong (or done) at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// See [`Action::DropMessages`].
    Drop,
    /// See [`Action::DamageMessages`].
    Damage,
    /// See [`Action::RepeatMessages`].
    Repeat,
    /// See [`Action::ClaimClear`].
    ClaimClear,
    /// See [`Action::RequestStop`].
    RequestStop,
}

impl Timeline {
    /// Of a script.
    #[must_use]
    pub fn new(acts: Vec<Act>) -> Self {
        let mut starts = vec![0.0];
        let mut end = 0.0;
        for act in &acts {
            end += act.length_ms;
            starts.push(end);
        }
        Self { acts, starts }
    }

    /// The acts.
    #[must_use]
    pub fn acts(&self) -> &[Act] {
        &self.acts
    }

    /// First and last moment of an act, milliseconds.
    #[must_use]
    pub fn span(&self, act: usize) -> (f64, f64) {
        let last = self.end_ms();
        (self.starts.get(act).copied().unwrap_or(last), self.starts.get(act + 1).copied().unwrap_or(last))
    }

    /// The end of the last act.
    #[must_use]
    pub fn end_ms(&self) -> f64 {
        self.starts.last().copied().unwrap_or(0.0)
    }

    /// Index of the act that is on; the last one after the end.
    #[must_use]
    pub fn act_at(&self, t_ms: f64) -> usize {
        let begun = self.starts.iter().take_while(|start| **start <= t_ms).count();
        begun.saturating_sub(1).min(self.acts.len().saturating_sub(1))
    }

    /// Where the visitors are.
    #[must_use]
    pub fn objects_at(&self, t_ms: f64) -> Vec<SceneObject> {
        self.cues_at(t_ms)
            .filter_map(|(start, cue)| match &cue.action {
                Action::Visit(visit) => {
                    Some(visit.object_at(t_ms - start - cue.at_ms, cue.until_ms - cue.at_ms))
                }
                _ => None,
            })
            .collect()
    }

    /// Is the laser dead?
    #[must_use]
    pub fn laser_dead(&self, t_ms: f64) -> bool {
        self.cues_at(t_ms).any(|(_, cue)| matches!(cue.action, Action::LaserDead))
    }

    /// What is wrong with the pictures.
    #[must_use]
    pub fn camera_fault_at(&self, t_ms: f64) -> Option<CameraFault> {
        self.cues_at(t_ms).find_map(|(_, cue)| match cue.action {
            Action::LensCovered => Some(CameraFault::Covered),
            Action::CameraFrozen => Some(CameraFault::Frozen),
            Action::ReplayPictures => Some(CameraFault::Replayed),
            _ => None,
        })
    }

    /// What is wrong with the host or the link.
    #[must_use]
    pub fn disturbance_at(&self, t_ms: f64) -> Option<Disturbance> {
        self.cues_at(t_ms).find_map(|(_, cue)| match cue.action {
            Action::DropMessages => Some(Disturbance::Drop),
            Action::DamageMessages => Some(Disturbance::Damage),
            Action::RepeatMessages => Some(Disturbance::Repeat),
            Action::ClaimClear => Some(Disturbance::ClaimClear),
            Action::RequestStop => Some(Disturbance::RequestStop),
            Action::Visit(_)
            | Action::LaserDead
            | Action::LensCovered
            | Action::CameraFrozen
            | Action::ReplayPictures
            | Action::HangController
            | Action::PressReset => None,
        })
    }

    /// Things that are done in a moment from `from_ms` up to, but not at, `to_ms`.
    pub fn moments(&self, from_ms: f64, to_ms: f64) -> impl Iterator<Item = &Action> {
        self.acts
            .iter()
            .zip(&self.starts)
            .flat_map(move |(act, start)| {
                act.cues.iter().filter(move |cue| {
                    cue.at_ms == cue.until_ms && (from_ms..to_ms).contains(&(start + cue.at_ms))
                })
            })
            .map(|cue| &cue.action)
    }

    fn cues_at(&self, t_ms: f64) -> impl Iterator<Item = (f64, &Cue)> {
        self.acts.iter().zip(&self.starts).flat_map(move |(act, start)| {
            act.cues
                .iter()
                .filter(move |cue| (start + cue.at_ms..start + cue.until_ms).contains(&t_ms))
                .map(move |cue| (*start, cue))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::script::minute;

    #[test]
    fn acts_follow_each_other_without_gap() {
        let timeline = Timeline::new(minute());
        for act in 0..timeline.acts().len() {
            let (start, end) = timeline.span(act);
            assert_eq!(timeline.act_at(start), act);
            assert_eq!(timeline.act_at(end - 0.5), act);
        }
        assert_eq!(timeline.act_at(1e9), timeline.acts().len() - 1);
    }

    #[test]
    fn every_moment_happens_in_exactly_one_frame() {
        let timeline = Timeline::new(minute());
        let frames = (timeline.end_ms() / 20.0) as u32;
        let happened: usize = (0..frames)
            .map(|frame| timeline.moments(f64::from(frame) * 20.0, f64::from(frame + 1) * 20.0).count())
            .sum();
        let written =
            timeline.acts().iter().flat_map(|act| &act.cues).filter(|cue| cue.at_ms == cue.until_ms).count();
        assert_eq!(happened, written);
    }

    #[test]
    fn objects_are_there_only_while_their_cue_lasts() {
        let timeline = Timeline::new(minute());
        let cable = timeline.acts().iter().position(|act| act.name == "cable").unwrap();
        let (start, _) = timeline.span(cable);
        assert!(timeline.objects_at(start + 499.0).is_empty());
        assert_eq!(timeline.objects_at(start + 500.0).len(), 1);
        assert!(timeline.objects_at(start + 2500.0).is_empty());
    }
}
