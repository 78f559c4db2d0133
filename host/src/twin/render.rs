//! The twin itself: a rig's view of a scene, ready to take pictures.
//!
//! What does not change between frames is computed once: the lines of sight ([`View`], shared by all scenes of a
//! rig), the floor under daylight, and the pixels of the floor that the laser can light. Moving objects
//! ([`Twin::place`]) redraws only the rectangles around their old and new places; a frame of a still scene costs
//! only the sensor.

mod visibility;

use std::sync::Arc;

use nearfield_shared::camera::Vector;
use rayon::prelude::*;

use super::body::{FloorAxes, Surface, World};
use super::bounce::Bounce;
use super::floor::FloorTexture;
use super::light::{self, Daylight, SHADOW_REACH_MM};
use super::material::Material;
use super::patch::{Patch, gaussian};
use super::picture::Picture;
use super::random::{lattice, unit};
use super::scene::{Look, Scene, SceneError, SceneObject};
use super::sensor::{RawPlanes, Sensor, Shot};
use super::shape::{length, normalised};
use super::sheet::Sheet;
use super::truth::Truth;
use super::view::{PixelRectangle, View, disjoint};

/// A highlight of full gloss is this much brighter than a white matt surface.
const HIGHLIGHT: f64 = 4.0;
/// Mean grey that the automatic exposure aims at, linear.
const MID_GREY: f64 = 0.18;
/// It keeps paint below this, linear.
const BRIGHTEST_PAINT: f64 = 0.60;
/// Reconstructing colours from a Bayer mosaic blurs by this much, standard deviation in pixels: red is sampled in
/// every other row and column only.
const DEMOSAIC_BLUR: f64 = 1.1;
/// Side of a speckle grain, pixels.
const GRAIN: f64 = 2.0;
/// The halo's reach, pixels.
const HALO_REACH: f64 = 10.0;
/// The camera's own width, for which the lengths in pixels above hold; narrower pictures are its scaled down.
const CAMERA_WIDTH: f64 = 2304.0;
/// Beyond the floor there is a dim hall.
const HALL_GREY: f32 = 0.12;

/// A pixel of the floor that the laser lights when nothing is in the way.
#[derive(Debug, Clone, Copy)]
struct LitPixel {
    index: u32,
    light: f32,
    point: [f32; 3],
}

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
        let pixels = view.width() * view.height();
        let mut twin = Self {
            axes,
            sheet: Sheet::new(view.rig(), &scene.look),
            bounce: Bounce::default(),
            world: World::default(),
            look: scene.look.clone(),
            daylight: Daylight::new(axes, &scene.light),
            texture: FloorTexture::new(&scene.floor, seed),
            sensor: Sensor::new(seed),
            exposure,
            seed,
            floor_sharp: RawPlanes::default(),
            floor_soft: RawPlanes::default(),
            floor_lit: Vec::new(),
            day: RawPlanes::default(),
            laser: vec![0.0; pixels],
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
        self.world = World::new(&self.axes, objects)?;
        if self.look.bounce > 0.0 {
            self.bounce = Bounce::of(self.view.rig(), &self.sheet, &self.world);
        }
        let (width, height) = (self.view.width(), self.view.height());
        let margin = gaussian(self.blur()).len();
        let areas =
            self.world.bodies.iter().map(|body| {
                self.view.rectangle_of(&body.bounds, SHADOW_REACH_MM).grown(margin, width, height)
            });
        let areas = disjoint(areas.collect());
        for area in std::mem::take(&mut self.drawn) {
            copy_area(&self.floor_soft, &mut self.day, area, width);
        }
        let light = self.draw(&areas);
        self.relight(&areas, light);
        self.drawn = areas;
        Ok(())
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
        self.sensor.expose(&self.day, &self.laser, &self.shot(frame, drive), picture);
    }

    /// Takes a picture as the sensor's Bayer mosaic, red first: one value a pixel, row by row, black at 4096 of 65536. The
    /// look should say that nothing was demosaiced ([`Look::demosaiced`]).
    #[must_use]
    pub fn render_mosaic(&self, frame: u64, drive: f32) -> Vec<u16> {
        let mut mosaic = vec![0; self.view.width() * self.view.height()];
        let (shot, columns) = (self.shot(frame, drive), self.view.width());
        self.sensor.expose_mosaic(&self.day, &self.laser, &shot, columns, &mut mosaic);
        mosaic
    }

    fn shot(&self, frame: u64, drive: f32) -> Shot<'_> {
        let drive = if drive.is_finite() { drive.clamp(0.0, 1.0) } else { 0.0 };
        Shot { look: &self.look, exposure: self.exposure, drive, frame, scale: self.scale() as f32 }
    }

    /// What is really there, while the laser is driven at `drive`.
    #[must_use]
    pub fn truth(&self, drive: f32) -> Truth {
        Truth::of(&self.view, &self.axes, &self.world, drive > 0.0 && self.look.laser_power > 0.0)
    }

    /// What would really be there with these objects in these places; nothing is drawn.
    ///
    /// # Errors
    /// An object's mistake.
    pub fn truth_of(&self, objects: &[SceneObject], drive: f32) -> Result<Truth, SceneError> {
        let world = World::new(&self.axes, objects)?;
        Ok(Truth::of(&self.view, &self.axes, &world, drive > 0.0 && self.look.laser_power > 0.0))
    }

    /// The floor under daylight, and the pixels of it that the laser can reach.
    fn paint_floor(&mut self) {
        let (width, height) = (self.view.width(), self.view.height());
        let mut values = vec![0.0_f32; 3 * width * height];
        let bare = World::default();
        let lit: Vec<Vec<LitPixel>> = values
            .par_chunks_mut(3 * width)
            .enumerate()
            .map(|(row, line)| {
                let mut lit = Vec::new();
                for column in 0..width {
                    let surface =
                        bare.trace(&self.view.ray(column, row)).filter(|surface| surface.normal.z > 0.0);
                    let colour = match &surface {
                        Some(surface) => self.floor_colour(surface, column, row, &mut lit),
                        None => [HALL_GREY; 3],
                    };
                    for (channel, value) in self.sensor.to_raw(colour).into_iter().enumerate() {
                        line[channel * width + column] = value;
                    }
                }
                lit
            })
            .collect();
        self.floor_lit = lit.concat();
        self.floor_sharp = RawPlanes { values };
        self.floor_soft = self.floor_sharp.clone();
        let whole = PixelRectangle { left: 0, top: 0, right: width, bottom: height };
        let kernel = gaussian(self.blur());
        for channel in 0..3 {
            let mut patch = cut(&self.floor_sharp, channel, whole, width);
            patch.blur(&kernel);
            paste(&mut self.floor_soft, channel, &patch, whole, width);
        }
        self.day = self.floor_soft.clone();
    }

    fn floor_colour(&self, floor: &Surface, column: usize, row: usize, lit: &mut Vec<LitPixel>) -> [f32; 3] {
        let steps = self.view.steps(column, row, floor.point, floor.normal);
        let footprint = length(steps[0]).max(length(steps[1]));
        let [along, across] = self.axes.coordinates(floor.point);
        let albedo = self.texture.albedo(along, across, footprint);
        if self.sheet.is_near(floor.point) {
            let light = self.sheet.irradiance(floor.point, floor.normal, steps) as f32;
            if light > 0.0 {
                let index = row * self.view.width() + column;
                let light = light * albedo[0] * self.speckle(column, row);
                let point = [floor.point.x as f32, floor.point.y as f32, floor.point.z as f32];
                lit.push(LitPixel { index: index as u32, light, point });
            }
        }
        let level = self.daylight.on_floor(floor.point) as f32;
        albedo.map(|share| share * level)
    }

    /// Redraws the areas around objects under daylight; returns the laser's light in them.
    fn draw(&mut self, areas: &[PixelRectangle]) -> Vec<Patch> {
        let width = self.view.width();
        let kernel = gaussian(self.blur());
        let mut lights = Vec::with_capacity(areas.len());
        for area in areas {
            let mut planes = [0, 1, 2].map(|channel| cut(&self.floor_sharp, channel, *area, width));
            let mut light = Patch::dark(*area);
            self.trace_area(*area, &mut planes, &mut light);
            for (channel, mut patch) in planes.into_iter().enumerate() {
                patch.blur(&kernel);
                paste(&mut self.day, channel, &patch, *area, width);
            }
            lights.push(light);
        }
        lights
    }

    fn trace_area(&self, area: PixelRectangle, planes: &mut [Patch; 3], light: &mut Patch) {
        let columns = area.right - area.left;
        let [red, green, blue] = planes;
        let rows = (
            red.values.par_chunks_mut(columns),
            green.values.par_chunks_mut(columns),
            blue.values.par_chunks_mut(columns),
            light.values.par_chunks_mut(columns),
        );
        rows.into_par_iter().enumerate().for_each(|(line, (red, green, blue, light))| {
            for index in 0..columns {
                let (column, row) = (area.left + index, area.top + line);
                let under = [red[index], green[index], blue[index]];
                let (colour, laser) = self.trace_pixel(column, row, under);
                [red[index], green[index], blue[index]] = colour;
                light[index] = laser;
            }
        });
    }

    /// Daylight (raw) and laser light of one pixel near objects; `under` is the bare floor's daylight.
    fn trace_pixel(&self, column: usize, row: usize, under: [f32; 3]) -> ([f32; 3], f32) {
        let ray = self.view.ray(column, row);
        let Some(surface) = self.world.trace(&ray).filter(|_| ray.direction.is_finite()) else {
            return (under, 0.0);
        };
        let open = light::openness(&self.world, surface.point, surface.normal) as f32;
        let towards_eye = normalised(ray.direction.scaled(-1.0));
        let colour = match surface.body.and_then(|index| self.world.bodies.get(index)) {
            None => under,
            Some(body) => self.sensor.to_raw(self.daylight.on_body(
                surface.point,
                surface.normal,
                towards_eye,
                &body.material,
            )),
        };
        let laser =
            self.laser_light(&surface, column, row, towards_eye) + self.bounced_light(&surface, column, row);
        (colour.map(|value| value * open), laser)
    }

    /// Laser light that comes by way of a body, scattered to the eye.
    fn bounced_light(&self, surface: &Surface, column: usize, row: usize) -> f32 {
        if self.look.bounce <= 0.0 {
            return 0.0;
        }
        let light = self.look.bounce * self.bounce.irradiance(surface.point, surface.normal);
        if light <= 0.0 {
            return 0.0;
        }
        let albedo = match surface.body.and_then(|index| self.world.bodies.get(index)) {
            Some(body) => body.material.laser_albedo,
            None => self.floor_albedo(surface, column, row)[0],
        };
        light as f32 * albedo
    }

    fn floor_albedo(&self, floor: &Surface, column: usize, row: usize) -> [f32; 3] {
        let steps = self.view.steps(column, row, floor.point, floor.normal);
        let [along, across] = self.axes.coordinates(floor.point);
        self.texture.albedo(along, across, length(steps[0]).max(length(steps[1])))
    }

    fn laser_light(&self, surface: &Surface, column: usize, row: usize, towards_eye: Vector) -> f32 {
        if !self.sheet.is_near(surface.point) {
            return 0.0;
        }
        let steps = self.view.steps(column, row, surface.point, surface.normal);
        let irradiance = self.sheet.irradiance(surface.point, surface.normal, steps);
        if irradiance <= 0.0 || self.world.blocked(self.sheet.origin(), surface.point) {
            return 0.0;
        }
        let returned = match surface.body.and_then(|index| self.world.bodies.get(index)) {
            Some(body) => self.returned(&body.material, surface, towards_eye),
            None => {
                let [along, across] = self.axes.coordinates(surface.point);
                let footprint = length(steps[0]).max(length(steps[1]));
                f64::from(self.texture.albedo(along, across, footprint)[0])
            }
        };
        (irradiance * returned) as f32 * self.speckle(column, row)
    }

    /// Share of the laser's light that a body returns to the eye: scattered and mirrored.
    fn returned(&self, material: &Material, surface: &Surface, towards_eye: Vector) -> f64 {
        let towards_laser = normalised(self.sheet.origin().minus(surface.point));
        let half = normalised(towards_laser.plus(towards_eye));
        let sharpness = surface.normal.dot(half).max(0.0).powf(f64::from(material.tightness));
        f64::from(material.laser_albedo) + f64::from(material.gloss) * HIGHLIGHT * sharpness
    }

    /// Fills the laser's plane anew: the lit floor, the light on objects, then the lens.
    fn relight(&mut self, areas: &[PixelRectangle], light: Vec<Patch>) {
        let (width, height) = (self.view.width(), self.view.height());
        let floor: Vec<(usize, f32)> = self
            .floor_lit
            .par_iter()
            .filter_map(|pixel| {
                let index = pixel.index as usize;
                let (column, row) = (index % width, index / width);
                let [x, y, z] = pixel.point.map(f64::from);
                let hidden = areas.iter().any(|area| area.contains(column, row))
                    || (!areas.is_empty() && self.world.blocked(self.sheet.origin(), Vector::new(x, y, z)));
                (!hidden).then_some((index, pixel.light))
            })
            .collect();
        let rows = floor.iter().map(|(index, _)| index / width);
        let tops = areas.iter().map(|area| area.top);
        let bottoms = areas.iter().map(|area| area.bottom.saturating_sub(1));
        let first = rows.clone().chain(tops).min().unwrap_or(0);
        let last = rows.chain(bottoms).max().unwrap_or(0);
        let reach = HALO_REACH * self.scale();
        let stripe = PixelRectangle { left: 0, top: first, right: width, bottom: (last + 1).min(height) };
        let band =
            PixelRectangle { left: 0, right: width, ..stripe.grown((5.0 * reach) as usize, width, height) };
        let mut plane = Patch::dark(band);
        for (index, value) in floor {
            plane.values[index - band.top * width] = value;
        }
        for patch in light {
            for (line, row) in patch.values.chunks_exact(patch.width()).zip(patch.area.top..) {
                let start = (row - band.top) * width + patch.area.left;
                plane.values[start..start + line.len()].copy_from_slice(line);
            }
        }
        self.smear(&mut plane, reach);
        self.laser[self.lit_rows.start * width..self.lit_rows.end * width].fill(0.0);
        self.laser[band.top * width..band.bottom * width].copy_from_slice(&plane.values);
        self.lit_rows = band.top..band.bottom;
    }

    /// The lens: a sharp core and a wide halo.
    fn smear(&self, plane: &mut Patch, reach: f64) {
        plane.blur(&gaussian(self.blur()));
        let halo = self.look.halo as f32;
        if halo > 0.0 {
            let mut wide = plane.clone();
            wide.spread(reach);
            for (value, spread) in plane.values.iter_mut().zip(&wide.values) {
                *value += halo * (spread - *value);
            }
        }
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
    let floor = MID_GREY / brightest(FloorTexture::mean_albedo(scene.floor.kind));
    let paint = scene.floor.paint.iter().map(|line| BRIGHTEST_PAINT / brightest(line.colour));
    paint.fold(floor, f64::min) * 400.0 / scene.light.lux.max(20.0)
}

fn cut(planes: &RawPlanes, channel: usize, area: PixelRectangle, width: usize) -> Patch {
    let mut patch =
        Patch { area, values: Vec::with_capacity((area.right - area.left) * (area.bottom - area.top)) };
    for row in area.top..area.bottom {
        let start = (3 * row + channel) * width;
        patch.values.extend_from_slice(&planes.values[start + area.left..start + area.right]);
    }
    patch
}

fn paste(planes: &mut RawPlanes, channel: usize, patch: &Patch, area: PixelRectangle, width: usize) {
    for (line, row) in patch.values.chunks_exact(patch.width()).zip(area.top..) {
        let start = (3 * row + channel) * width;
        planes.values[start + area.left..start + area.right].copy_from_slice(line);
    }
}

fn copy_area(from: &RawPlanes, to: &mut RawPlanes, area: PixelRectangle, width: usize) {
    for row in area.top..area.bottom {
        for channel in 0..3 {
            let start = (3 * row + channel) * width;
            let span = start + area.left..start + area.right;
            to.values[span.clone()].copy_from_slice(&from.values[span]);
        }
    }
}
