//! The twin itself: a rig's view of a scene, ready to take pictures.
//!
//! What does not change between frames is computed once: the lines of sight ([`View`], shared by all scenes of a
//! rig), the floor under daylight, and the pixels of the floor that the laser can light. Moving objects
//! ([`Twin::place`]) redraws only the rectangles around their old and new places; a frame of a still scene costs
//! only the sensor.

mod bodies;
mod ground;
mod planes;
mod stripe;
mod visibility;

use std::sync::Arc;

use nearfield_shared::camera::Vector;

use self::ground::LitPixel;
use self::planes::copy_area;
pub(in crate::twin) use self::planes::{cut, paste};
use super::body::{Body, FloorAxes, World};
use super::bounce::Bounce;
use super::dirt::DirtyGlass;
use super::floor::FloorTexture;
use super::light::{Daylight, SHADOW_REACH_MM};
use super::patch::gaussian;
use super::picture::Picture;
use super::random::{lattice, unit};
use super::relief::Relief;
use super::scene::{Look, Scene, SceneError, SceneObject};
use super::sensor::{Incident, RawPlanes, Sensor, Shot};
use super::shape::Bounds;
use super::sheet::Sheet;
use super::truth::Truth;
use super::view::{PixelRectangle, View, disjoint};

/// Mean grey that the automatic exposure aims at, linear.
const MID_GREY: f64 = 0.18;
/// It keeps paint below this, linear.
const BRIGHTEST_PAINT: f64 = 0.60;
/// Reconstructing colours from a Bayer mosaic blurs by this much, standard deviation in pixels: red is sampled in
/// every other row and column only.
const DEMOSAIC_BLUR: f64 = 1.1;
/// Side of a speckle grain, pixels.
const GRAIN: f64 = 2.0;
/// The camera's own width, for which the lengths in pixels above hold; narrower pictures are its scaled down.
const CAMERA_WIDTH: f64 = 2304.0;
/// Beyond the floor there is a dim hall.
const HALL_GREY: f32 = 0.12;

/// A rig's view of a scene; the same seed gives the same pictures, whatever the number of threads.
#[derive(Debug)]
pub struct Twin {
    view: Arc<View>,
    axes: FloorAxes,
    sheet: Sheet,
    /// Light of the stripe that the bodies throw on; none if the look asks for none.
    bounce: Bounce,
    world: World,
    look: Look,
    daylight: Daylight,
    texture: FloorTexture,
    relief: Option<Relief>,
    sensor: Sensor,
    exposure: f32,
    seed: u64,
    /// The bare floor under daylight, before the lens's blur and after it.
    floor_sharp: RawPlanes,
    floor_soft: RawPlanes,
    floor_lit: Vec<LitPixel>,
    /// With objects, after the lens.
    day: RawPlanes,
    laser: Vec<f32>,
    /// Dirt on the lens, and what comes through it; none on a clean lens.
    glass: Option<DirtyGlass>,
    dimmed: Incident,
    /// What [`Self::place`] drew last.
    drawn: Vec<PixelRectangle>,
    lit_rows: std::ops::Range<usize>,
}

impl Twin {
    /// Prepares a scene.
    ///
    /// # Errors
    /// The scene's first mistake.
    pub fn new(view: Arc<View>, scene: &Scene, seed: u64) -> Result<Self, SceneError> {
        scene.check()?;
        let axes = FloorAxes::new(view.rig());
        let exposure = scene.look.exposure.unwrap_or_else(|| automatic_exposure(scene)) as f32;
        let (width, height) = (view.width(), view.height());
        let mut twin = Self {
            axes,
            sheet: Sheet::new(view.rig(), &scene.look),
            bounce: Bounce::default(),
            world: World::default(),
            look: scene.look.clone(),
            daylight: Daylight::new(axes, &scene.light),
            texture: FloorTexture::new(&scene.floor, seed),
            relief: Relief::new(axes, &scene.floor, seed),
            sensor: Sensor::new(seed),
            exposure,
            seed,
            floor_sharp: RawPlanes::default(),
            floor_soft: RawPlanes::default(),
            floor_lit: Vec::new(),
            day: RawPlanes::default(),
            laser: vec![0.0; width * height],
            glass: DirtyGlass::new(&scene.dirt, width, height, seed),
            dimmed: Incident::default(),
            drawn: Vec::new(),
            lit_rows: 0..0,
            view,
        };
        twin.paint_floor();
        twin.place(&scene.objects)?;
        Ok(twin)
    }

    /// The rig's view.
    #[must_use]
    pub fn view(&self) -> &Arc<View> {
        &self.view
    }

    /// The objects as solids.
    #[must_use]
    pub const fn world(&self) -> &World {
        &self.world
    }

    /// Puts the objects into these places (and no others).
    ///
    /// # Errors
    /// An object's mistake; the old objects stay then.
    pub fn place(&mut self, objects: &[SceneObject]) -> Result<(), SceneError> {
        let probe = Scene { objects: objects.to_vec(), ..Scene::default() };
        probe.check()?;
        self.world = World::on(&self.axes, objects, self.relief.clone())?;
        if self.look.bounce > 0.0 {
            self.bounce = Bounce::of(self.view.rig(), &self.sheet, &self.world);
        }
        let (width, height) = (self.view.width(), self.view.height());
        let margin = gaussian(self.blur()).len();
        let areas = self.world.bodies.iter().map(|body| self.touched(body).grown(margin, width, height));
        let areas = disjoint(areas.collect());
        for area in std::mem::take(&mut self.drawn) {
            copy_area(&self.floor_soft, &mut self.day, area, width);
        }
        let light = self.draw(&areas);
        self.relight(&areas, light);
        self.drawn = areas;
        if let Some(glass) = &self.glass {
            self.dimmed.day.values.clone_from(&self.day.values);
            self.dimmed.laser.clone_from(&self.laser);
            glass.dim(&mut self.dimmed.day, &mut self.dimmed.laser);
        }
        Ok(())
    }

    /// The light behind lens and dirt.
    fn incident(&self) -> (&RawPlanes, &[f32]) {
        match self.glass {
            Some(_) => (&self.dimmed.day, &self.dimmed.laser),
            None => (&self.day, &self.laser),
        }
    }

    /// Adds a share of what the sensor sees now to what it has collected already.
    pub fn collect_into(&self, sum: &mut Incident, share: f32) {
        let (day, laser) = self.incident();
        sum.add(day, laser, share);
    }

    /// Pixels that a body may change.
    fn touched(&self, body: &Body) -> PixelRectangle {
        if self.look.bounce > 0.0 {
            // Light that it throws on may fall on anything around it.
            return self.view.rectangle_of(&body.bounds, SHADOW_REACH_MM);
        }
        // Its shadow lies on the floor.
        let (low, high) = (body.bounds.low, body.bounds.high);
        let reach = Vector::new(SHADOW_REACH_MM, SHADOW_REACH_MM, 0.0);
        let floor = |corner: Vector| Vector::new(corner.x, corner.y, 0.0);
        let shadow = Bounds { low: floor(low.minus(reach)), high: floor(high.plus(reach)) };
        self.view.outline_of(&body.bounds).hull(&self.view.outline_of(&shadow))
    }

    /// Takes a picture. `frame` chooses the noise, `drive` is the laser's brightness command (0 to 1).
    #[must_use]
    pub fn render(&self, frame: u64, drive: f32) -> Picture {
        let mut picture = Picture::black(self.view.width(), self.view.height());
        self.render_into(frame, drive, &mut picture);
        picture
    }

    /// Like [`Self::render`], into a picture that exists already; one of another size is replaced.
    pub fn render_into(&self, frame: u64, drive: f32, picture: &mut Picture) {
        if (picture.width, picture.height) != (self.view.width(), self.view.height()) {
            *picture = Picture::black(self.view.width(), self.view.height());
        }
        let (day, laser) = self.incident();
        self.sensor.expose(day, laser, &self.shot(frame, drive), picture);
    }

    /// A picture of light that was collected from moments of this view ([`Self::collect_into`]).
    pub fn render_collected(&self, light: &Incident, frame: u64, drive: f32, picture: &mut Picture) {
        if (picture.width, picture.height) != (self.view.width(), self.view.height()) {
            *picture = Picture::black(self.view.width(), self.view.height());
        }
        self.sensor.expose(&light.day, &light.laser, &self.shot(frame, drive), picture);
    }

    /// Takes a picture as the sensor's Bayer mosaic, red first: one value a pixel, row by row, black at 4096 of 65536. The
    /// look should say that nothing was demosaiced ([`Look::demosaiced`]).
    #[must_use]
    pub fn render_mosaic(&self, frame: u64, drive: f32) -> Vec<u16> {
        let mut mosaic = vec![0; self.view.width() * self.view.height()];
        let (shot, columns) = (self.shot(frame, drive), self.view.width());
        let (day, laser) = self.incident();
        self.sensor.expose_mosaic(day, laser, &shot, columns, &mut mosaic);
        mosaic
    }

    fn shot(&self, frame: u64, drive: f32) -> Shot<'_> {
        let drive = if drive.is_finite() { drive.clamp(0.0, 1.0) } else { 0.0 };
        Shot { look: &self.look, exposure: self.exposure, drive, frame, scale: self.scale() as f32 }
    }

    /// What is really there, while the laser is driven at `drive`.
    #[must_use]
    pub fn truth(&self, drive: f32) -> Truth {
        self.truth_in(&self.world, drive)
    }

    fn truth_in(&self, world: &World, drive: f32) -> Truth {
        let laser_on = drive > 0.0 && self.look.laser_power > 0.0;
        Truth::of(&self.view, &self.axes, world, laser_on).through(self.glass.as_ref())
    }

    /// What would really be there with these objects in these places; nothing is drawn.
    ///
    /// # Errors
    /// An object's mistake.
    pub fn truth_of(&self, objects: &[SceneObject], drive: f32) -> Result<Truth, SceneError> {
        Ok(self.truth_in(&World::on(&self.axes, objects, self.relief.clone())?, drive))
    }

    /// Size of this picture's pixels is `1 / scale` of the camera's.
    fn scale(&self) -> f64 {
        self.view.width() as f64 / CAMERA_WIDTH
    }

    /// Standard deviation of the whole blur, pixels of this picture.
    fn blur(&self) -> f64 {
        let demosaicing = if self.look.demosaiced { DEMOSAIC_BLUR * self.scale() } else { 0.0 };
        self.look.blur_pixels.hypot(demosaicing)
    }

    /// The laser's speckle at a pixel: log-normal with mean 1. The blur averages over grains; their contrast is
    /// raised by as much, so that the scene's contrast is left in the picture.
    fn speckle(&self, column: usize, row: usize) -> f32 {
        if self.look.led_band_mm.is_some() {
            return 1.0;
        }
        let grain = (GRAIN * self.scale()).round().max(1.0);
        let averaging = (2.0 * self.blur() * std::f64::consts::PI.sqrt() / grain).max(1.0);
        let variance = (self.look.speckle * averaging).powi(2).ln_1p();
        let place = |pixel: usize| (pixel as f64 / grain) as i64;
        let word = lattice(self.seed ^ 0x7370_6563, place(column), place(row));
        // The sum of three uniform numbers is normal enough here, and bounded.
        let share = |shift: u32| unit(word.rotate_left(shift));
        let normal = 2.0 * (share(0) + share(21) + share(42) - 1.5);
        (variance.sqrt() * normal - variance / 2.0).exp() as f32
    }
}

/// What somebody who sets up the camera would choose: the floor mid-grey, and no paint on it near saturation, on
/// which the laser could not be seen any more.
fn automatic_exposure(scene: &Scene) -> f64 {
    let brightest = |[red, green, blue]: [f32; 3]| f64::from(red.max(green).max(blue)).max(0.02);
    let floor = MID_GREY / brightest(FloorTexture::mean_of(&scene.floor));
    let paint = scene.floor.paint.iter().map(|line| BRIGHTEST_PAINT / brightest(line.colour));
    paint.fold(floor, f64::min) * 400.0 / scene.light.lux.max(20.0)
}

#[cfg(test)]
mod tests;
