//! Pictures of a world that moves: objects with their velocities, the robot with its own, a mast that vibrates, and a
//! sensor that exposes its rows one after the other.
//!
//! A rolling shutter is rendered in bands of rows, each at its own time; within a band all rows see the same moment.
//! The truth is that of the moment at which the row of the stripe's middle is exposed. Blur by motion within the exposure is not
//! modelled.

use std::f64::consts::TAU;
use std::sync::Arc;

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::{Rig, RigError};

use super::picture::Picture;
use super::random::{scramble, unit};
use super::render::Twin;
use super::scene::{Scene, SceneError};
use super::truth::{Moment, Truth};
use super::view::View;

/// Bands of rows of a rolling shutter where only objects move ...
const BANDS: usize = 32;
/// ... and where the robot does, which costs a whole floor for each.
const BANDS_OF_FLOORS: usize = 8;

/// Why a picture of a sequence cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// The scene's mistake.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The vibration lifts the rig to where it is none.
    #[error("robot.vibration_mm: the lifted rig is none: {0}")]
    Rig(#[from] RigError),
}

/// A scene in time, before one rig.
#[derive(Debug)]
pub struct Sequence {
    rig: Rig,
    scene: Scene,
    seed: u64,
    twin: Twin,
    picture: Picture,
}

impl Sequence {
    /// Prepares a scene.
    ///
    /// # Errors
    /// The scene's first mistake.
    pub fn new(rig: &Rig, scene: &Scene, seed: u64) -> Result<Self, SceneError> {
        let twin = Twin::new(Arc::new(View::new(rig)), scene, seed)?;
        Ok(Self { rig: *rig, scene: scene.clone(), seed, twin, picture: Picture::black(0, 0) })
    }

    /// The picture that begins `seconds` after the start and its truth; `frame` chooses the noise, `drive` is the laser's
    /// brightness command.
    ///
    /// # Errors
    /// See [`SequenceError`].
    pub fn picture(
        &mut self,
        frame: u64,
        seconds: f64,
        drive: f32,
    ) -> Result<(Picture, Truth), SequenceError> {
        let (width, height) = (self.twin.view().width(), self.twin.view().height());
        let row_time = self.scene.look.row_time_us * 1e-6;
        let bands = match (row_time > 0.0, self.scene.robot.is_moving()) {
            (false, _) => 1,
            (true, false) => BANDS,
            (true, true) => BANDS_OF_FLOORS,
        };
        let mut whole = Picture::black(width, height);
        let mut truth = None;
        let stripe_row = self.stripe_row();
        for band in 0..bands {
            let rows = band * height / bands..(band + 1) * height / bands;
            let moment = seconds + row_time * (rows.start + rows.end) as f64 / 2.0;
            self.set_time(moment)?;
            self.twin.render_into(frame, drive, &mut self.picture);
            let bytes = 3 * width * rows.start..3 * width * rows.end;
            whole.rgb[bytes.clone()].copy_from_slice(&self.picture.rgb[bytes]);
            if rows.contains(&stripe_row) || truth.is_none() {
                let robot = self.scene.robot.at(moment, self.phase());
                truth = Some(Truth { moment: Moment { seconds: moment, ..robot }, ..self.twin.truth(drive) });
            }
        }
        let truth = truth.unwrap_or_else(|| self.twin.truth(drive));
        Ok((whole, truth))
    }

    /// The same as the sensor's Bayer mosaic (see [`Twin::render_mosaic`]), all rows at once and the robot at rest.
    ///
    /// # Errors
    /// See [`SequenceError`].
    pub fn mosaic(
        &mut self,
        frame: u64,
        seconds: f64,
        drive: f32,
    ) -> Result<(Vec<u16>, Truth), SequenceError> {
        self.set_time(seconds)?;
        let moment = Moment { seconds, ..Moment::default() };
        Ok((self.twin.render_mosaic(frame, drive), Truth { moment, ..self.twin.truth(drive) }))
    }

    /// Row of the floor's stripe in its middle.
    fn stripe_row(&self) -> usize {
        let stripe = self.rig.stripe();
        let middle = stripe.at((stripe.start + stripe.end) / 2.0);
        self.rig.camera().project(middle).map_or(0, |pixel| pixel.v.max(0.0) as usize)
    }

    /// Where in its period the vibration starts.
    fn phase(&self) -> f64 {
        TAU * unit(scramble(self.seed ^ 0x7669_6272))
    }

    fn set_time(&mut self, seconds: f64) -> Result<(), SequenceError> {
        let scene = self.scene.after(seconds);
        if !self.scene.robot.is_moving() {
            self.twin.place(&scene.objects)?;
            return Ok(());
        }
        let up = self.scene.robot.at(seconds, self.phase()).robot_up_mm;
        let view = if up == 0.0 {
            Arc::clone(self.twin.view())
        } else {
            Arc::new(View::new(&lifted(&self.rig, up)?))
        };
        self.twin = Twin::new(view, &scene, self.seed)?;
        Ok(())
    }
}

/// The rig, camera and laser together so much higher over the floor; the stripe is where the sheet then meets it.
fn lifted(rig: &Rig, up: f64) -> Result<Rig, RigError> {
    let lift = Vector::new(0.0, 0.0, up);
    let (mut camera, mut laser, mut stripe) = (*rig.camera(), *rig.laser(), *rig.stripe());
    let rotation = camera.pose.rotation;
    let turned = Vector::new(rotation[0].dot(lift), rotation[1].dot(lift), rotation[2].dot(lift));
    camera.pose.translation = camera.pose.translation.minus(turned);
    laser.origin = laser.origin.plus(lift);
    laser.offset += laser.normal.dot(lift);
    // The sheet meets the floor farther out, by as much as its slope says.
    let flat = Vector::new(laser.normal.x, laser.normal.y, 0.0);
    let slope = flat.dot(flat);
    if slope > 0.0 {
        stripe.point = stripe.point.plus(flat.scaled(laser.normal.z * up / slope));
    }
    Rig::new(rig.image(), camera, laser, stripe)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::gallery::{self, CENTRE};
    use crate::twin::scene::Robot;

    fn sequence(change: impl Fn(&mut Scene)) -> Sequence {
        let rig = CENTRE.with_width(576).rig().unwrap();
        let mut scene = gallery::scene("box_45").unwrap();
        change(&mut scene);
        Sequence::new(&rig, &scene, 5).unwrap()
    }

    #[test]
    fn a_lifted_rigs_stripe_lies_on_its_sheet_and_on_the_floor() {
        let rig = CENTRE.rig().unwrap();
        for up in [-2.0, 0.5, 3.0] {
            let higher = lifted(&rig, up).unwrap();
            let point = higher.stripe().at(100.0);
            assert!(
                (higher.laser().normal.dot(point) - higher.laser().offset).abs() < 1e-9 && point.z == 0.0
            );
            let centre = |rig: &Rig| rig.camera().pose.centre().z;
            assert!((centre(&higher) - centre(&rig) - up).abs() < 1e-9);
        }
    }

    #[test]
    fn the_same_seed_and_time_give_the_same_picture_and_time_moves_what_moves() {
        let moving = |scene: &mut Scene| {
            scene.robot = Robot { velocity_mm_per_s: [40.0, 300.0], vibration_mm: 0.4, vibration_hz: 25.0 };
        };
        let (one, truth) = sequence(moving).picture(1, 0.02, 1.0).unwrap();
        let (again, _) = sequence(moving).picture(1, 0.02, 1.0).unwrap();
        assert_eq!(one, again);
        assert!(
            truth.moment.robot_up_mm.abs() <= 0.4 && truth.moment.robot_across_mm == 6.0,
            "{:?}",
            truth.moment
        );
        let (later, _) = sequence(moving).picture(1, 0.04, 1.0).unwrap();
        assert_ne!(one, later);
    }

    /// A rolling shutter shears what moves sideways: its upper rows are seen earlier. A still scene must not change.
    #[test]
    fn rolling_shutter_shows_each_row_at_its_own_time() {
        let still = |row_time_us: f64| {
            sequence(|scene| scene.look.row_time_us = row_time_us).picture(0, 0.0, 1.0).unwrap().0
        };
        assert_eq!(still(0.0), still(50.0), "nothing moves");
        let moving = |row_time_us: f64| {
            sequence(|scene| {
                scene.look.row_time_us = row_time_us;
                scene.objects[0].velocity_mm_per_s = [4000.0, 0.0];
            })
        };
        let (global, at_start) = moving(0.0).picture(0, 0.0, 1.0).unwrap();
        let (rolling, truth) = moving(50.0).picture(0, 0.0, 1.0).unwrap();
        assert_ne!(global, rolling);
        let start = |truth: &Truth| truth.objects[0].heights.unwrap().start_mm;
        let moved = start(&truth) - start(&at_start);
        let expected = 4000.0 * truth.moment.seconds;
        assert!((moved - expected).abs() < 1.0 && moved > 5.0, "moved by {moved}, not {expected} mm");
    }
}
