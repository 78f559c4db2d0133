//! Pictures of a world that moves: objects with their velocities, the robot with its own, a mast that vibrates, and a
//! sensor that exposes its rows one after the other.
//!
//! A rolling shutter is rendered in bands of rows, each at its own time; within a band all rows see the same moment.
//! Blur by motion is the mean of the light of several moments of the exposure, so many that nothing moves by more than
//! `STEP_PIXELS` between two. The truth is that of the middle of the exposure of the row of the stripe's middle.

use std::f64::consts::TAU;
use std::sync::Arc;

use nearfield_shared::camera::Vector;
use nearfield_shared::rig::{Rig, RigError};

use super::body::{FloorAxes, World};
use super::picture::Picture;
use super::random::{scramble, unit};
use super::render::Twin;
use super::scene::{Scene, SceneError, SceneObject};
use super::sensor::Incident;
use super::truth::{Blur, Moment, Truth};
use super::view::View;

/// Bands of rows of a rolling shutter where only objects move ...
const BANDS: usize = 32;
/// ... and where the robot does, which costs a whole floor for each.
const BANDS_OF_FLOORS: usize = 8;
/// Blur by motion: nothing moves farther than this from one moment of an exposure to the next, pixels ...
const STEP_PIXELS: f64 = 0.75;
/// ... as long as that needs no more moments than this.
const MOST_MOMENTS: usize = 64;
/// What moves less than this in an exposure is not smeared, pixels.
const STILL_PIXELS: f64 = 0.1;

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
    /// Light of an exposure's moments.
    collected: Incident,
    /// Where the objects stand; none if that is not known.
    placed: Option<Vec<SceneObject>>,
}

impl Sequence {
    /// Prepares a scene.
    ///
    /// # Errors
    /// The scene's first mistake.
    pub fn new(rig: &Rig, scene: &Scene, seed: u64) -> Result<Self, SceneError> {
        let twin = Twin::new(Arc::new(View::new(rig)), scene, seed)?;
        Ok(Self {
            rig: *rig,
            scene: scene.clone(),
            seed,
            twin,
            picture: Picture::black(0, 0),
            collected: Incident::default(),
            placed: None,
        })
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
            let blur = self.expose(frame, moment, drive)?;
            let bytes = 3 * width * rows.start..3 * width * rows.end;
            whole.rgb[bytes.clone()].copy_from_slice(&self.picture.rgb[bytes]);
            if rows.contains(&stripe_row) || truth.is_none() {
                let robot = self.scene.robot.at(moment, self.phase());
                let moment = Moment { seconds: moment, ..robot };
                truth = Some(Truth { moment, blur, ..self.twin.truth(drive) });
            }
        }
        let truth = truth.unwrap_or_else(|| self.twin.truth(drive));
        Ok((whole, truth))
    }

    /// Takes the picture of one moment into [`Self::picture`]; the twin then stands at that moment. Tells the blur, if anything
    /// moves while the sensor is exposed.
    fn expose(&mut self, frame: u64, middle: f64, drive: f32) -> Result<Option<Blur>, SequenceError> {
        let blur = self.blur(middle);
        let Some(blur) = blur.filter(|blur| blur.pixels > STILL_PIXELS) else {
            self.set_time(middle)?;
            self.twin.render_into(frame, drive, &mut self.picture);
            return Ok(None);
        };
        let moments = ((blur.pixels / STEP_PIXELS).ceil() as usize).clamp(2, MOST_MOMENTS);
        let exposure = blur.exposure_ms * 1e-3;
        let mut collected = std::mem::take(&mut self.collected);
        collected.clear();
        for index in 0..moments {
            let share = (index as f64 + 0.5) / moments as f64 - 0.5;
            self.set_time(middle + share * exposure)?;
            self.twin.collect_into(&mut collected, 1.0 / moments as f32);
        }
        self.twin.render_collected(&collected, frame, drive, &mut self.picture);
        self.collected = collected;
        self.set_time(middle)?;
        Ok(Some(blur))
    }

    /// How far everything moves in an exposure around this time; `None` if the exposure is an instant.
    fn blur(&self, middle: f64) -> Option<Blur> {
        let exposure_ms = self.scene.look.exposure_ms;
        if exposure_ms <= 0.0 {
            return None;
        }
        let (start, end) = (middle - exposure_ms * 0.5e-3, middle + exposure_ms * 0.5e-3);
        let [from, to] = [start, end].map(|time| self.scene.robot.at(time, self.phase()));
        let floor_mm = [from.robot_along_mm - to.robot_along_mm, from.robot_across_mm - to.robot_across_mm];
        let seconds = end - start;
        let way = |object: &SceneObject| {
            let [along, across] = object.velocity_mm_per_s;
            [floor_mm[0] + along * seconds, floor_mm[1] + across * seconds]
        };
        let objects_mm: Vec<[f64; 2]> = self.scene.objects.iter().map(way).collect();
        // The mast's swing turns within its period: never farther than at its fastest, never farther than from end to end.
        let robot = &self.scene.robot;
        let swing = (TAU * robot.vibration_hz * seconds).min(2.0) * robot.vibration_mm;
        let pixels = self.farthest_way(middle, floor_mm, &objects_mm, swing);
        Some(Blur { exposure_ms, floor_mm, objects_mm, pixels })
    }

    /// The farthest way of anything in the picture, pixels, if the floor and the objects move like this and the rig rises by
    /// `swing`.
    fn farthest_way(&self, middle: f64, floor_mm: [f64; 2], objects_mm: &[[f64; 2]], swing: f64) -> f64 {
        /// Places of the floor that are asked, in each direction.
        const PLACES: usize = 5;
        let axes = FloorAxes::new(&self.rig);
        let camera = self.rig.camera();
        let way = |point: Vector, [along, across]: [f64; 2], up: f64| {
            let there = point.plus(axes.along.scaled(along)).plus(axes.across.scaled(across));
            let pixels = camera.project(point).zip(camera.project(there.minus(Vector::new(0.0, 0.0, up))));
            pixels.map_or(0.0, |(from, to)| (from.u - to.u).hypot(from.v - to.v))
        };
        let view = self.twin.view();
        let places = (0..PLACES * PLACES).filter_map(|index| {
            let at = |index: usize, length: usize| index * (length - 1) / (PLACES - 1);
            let ray = view.ray(at(index % PLACES, view.width()), at(index / PLACES, view.height()));
            (ray.direction.z < 0.0).then(|| ray.at(-ray.start.z / ray.direction.z))
        });
        let floor = places.map(|point| way(point, floor_mm, swing)).fold(0.0, f64::max);
        let world = World::new(&axes, &self.scene.after(middle).objects).unwrap_or_default();
        let objects = world
            .bodies
            .iter()
            .zip(objects_mm)
            .flat_map(|(body, moved)| body.bounds.corners(0.0).map(|corner| way(corner, *moved, swing)));
        objects.fold(floor, f64::max)
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
            if self.placed.as_ref() != Some(&scene.objects) {
                self.twin.place(&scene.objects)?;
                self.placed = Some(scene.objects);
            }
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
    use crate::twin::scene::{Look, Robot};

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

    /// A post that moves sideways is smeared over its way: the picture's redness along a row of its stripe rises over
    /// speed times exposure times pixels per millimetre, as a ramp of even slope does.
    #[test]
    fn what_moves_is_smeared_by_speed_times_exposure() {
        let rig = CENTRE.rig().unwrap();
        let picture = |exposure_ms: f64| {
            let mut scene = gallery::scene("box_45").unwrap();
            scene.look =
                Look { exposure_ms, speckle: 0.0, halo: 0.0, read_noise_electrons: 0.0, ..scene.look };
            scene.look.full_well_electrons = 1e6;
            // Faint enough that nothing is clipped: bytes tell light.
            scene.look.laser_power = 0.15;
            scene.objects[0] = SceneObject {
                yaw_degrees: 0.0,
                velocity_mm_per_s: [3000.0, 0.0],
                ..gallery::carton("box", [120.0, 90.0, 45.0], -60.0, "grey_card")
            };
            Sequence::new(&rig, &scene, 5).unwrap().picture(0, 0.0, 1.0).unwrap()
        };
        let ((sharp, none), (smeared, truth)) = (picture(0.0), picture(10.0));
        let blur = truth.blur.unwrap();
        assert!(none.blur.is_none() && (blur.objects_mm[0][0] - 30.0).abs() < 1e-9, "{blur:?}");
        // A row through the lit front of the box: its stripe ends where the box ends.
        let lit = (0..truth.profile.s_mm.len())
            .find(|i| truth.profile.object[*i] == 0 && truth.profile.visible[*i])
            .unwrap();
        let row = truth.profile.row[lit].unwrap().round() as usize;
        let height = truth.profile.height_mm[lit];
        let edge = truth.profile.column[lit].unwrap();
        let place = rig.laser().origin.plus(
            rig.stripe()
                .at(truth.profile.s_mm[lit])
                .minus(rig.laser().origin)
                .scaled(1.0 - height / rig.laser().origin.z),
        );
        let moved = rig.camera().project(place.plus(Vector::new(30.0, 0.0, 0.0))).unwrap();
        let expected = (moved.u - edge).abs();
        let redness = |picture: &Picture, column: usize| {
            let [red, green, _] = picture.at(column, row).map(|byte| (f64::from(byte) / 255.0).powf(2.2));
            red - green
        };
        // Width of an edge: the whole step over its steepest part, which of a ramp is its length.
        let ramp = |picture: &Picture| {
            let reach = 40;
            let from = edge.round() as usize - reach;
            let values: Vec<f64> = (from..from + 2 * reach).map(|column| redness(picture, column)).collect();
            let level = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
            let (low, high) = (level(&values[..10]), level(&values[2 * reach - 10..]));
            let area: f64 =
                values.iter().map(|value| (value - low) / (high - low)).map(|v| v * (1.0 - v)).sum();
            // Of a straight ramp the integral of v (1 - v) is a sixth of its length.
            6.0 * area
        };
        let (before, after) = (ramp(&sharp), ramp(&smeared));
        assert!(expected > 25.0, "{expected}");
        assert!(
            (after / expected - 1.0).abs() < 0.12 && before < 0.3 * expected,
            "{before} {after} {expected}"
        );
    }

    /// The mean of an exposure has all of its light, whatever moves, and a still scene has no blur at all.
    #[test]
    fn an_exposure_changes_nothing_where_nothing_moves_and_is_the_same_every_time() {
        let taken = |exposure_ms: f64, speed: f64| {
            sequence(|scene| {
                scene.look.exposure_ms = exposure_ms;
                scene.robot.velocity_mm_per_s = [0.0, speed];
            })
            .picture(3, 0.1, 1.0)
            .unwrap()
        };
        assert_eq!(taken(0.0, 0.0).0, taken(8.0, 0.0).0);
        let (one, truth) = taken(8.0, 1500.0);
        assert_eq!(one, taken(8.0, 1500.0).0);
        assert_eq!(truth.blur.unwrap().floor_mm, [0.0, -12.0]);
        let mean = |picture: &Picture| {
            picture.rgb.iter().map(|byte| f64::from(*byte)).sum::<f64>() / picture.rgb.len() as f64
        };
        let sharp = taken(0.0, 1500.0).0;
        assert!(sharp != one && (mean(&sharp) - mean(&one)).abs() < 0.5, "{} {}", mean(&sharp), mean(&one));
    }
}
