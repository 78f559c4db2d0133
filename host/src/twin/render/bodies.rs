//! What objects change in the picture: themselves, their shadows, and the laser's light on and from them.

use nearfield_shared::camera::Vector;
use rayon::prelude::*;

use super::Twin;
use super::planes::{cut, paste};
use crate::simd::{self, Kernel};
use crate::twin::body::{PartOfBody, Surface};
use crate::twin::bounce::REACH_MM;
use crate::twin::light::{self, SHADOW_REACH_MM};
use crate::twin::material::Material;
use crate::twin::open_floor::OpenFloor;
use crate::twin::patch::{Patch, gaussian};
use crate::twin::shape::{Bounds, length, normalised};
use crate::twin::view::PixelRectangle;

/// A highlight of full gloss is this much brighter than a white matt surface.
const HIGHLIGHT: f64 = 4.0;

/// A surface must not shade its own lit line, millimetres.
const LIFT_MM: f64 = 0.05;

/// Places on the floor are known to better than this in single precision, millimetres.
const SLACK_MM: f64 = 1.0;

/// A part of a body, and the pixels outside of which no ray can meet it.
pub(super) type Outline = (PartOfBody, PixelRectangle);

impl Twin {
    /// Redraws the areas around objects under daylight; returns the laser's light in them.
    pub(super) fn draw(&mut self, areas: &[PixelRectangle]) -> Vec<Patch> {
        let width = self.view.width();
        let kernel = gaussian(self.blur());
        let mut lights = Vec::with_capacity(areas.len());
        for area in areas {
            let mut planes = [0, 1, 2].map(|channel| cut(&self.floor_sharp, channel, *area, width));
            let mut light = Patch::dark(*area);
            self.draw_sharp(*area, &mut planes, &mut light);
            // The lens smears into the area what lies around it: bare floor, as far as its blur reaches.
            let around = area.grown(kernel.len(), width, self.view.height());
            for (channel, drawn) in planes.into_iter().enumerate() {
                let mut patch = cut(&self.floor_sharp, channel, around, width);
                patch.put(&drawn);
                patch.blur(&kernel);
                paste(&mut self.day, channel, &patch.part(*area), *area, width);
            }
            lights.push(light);
        }
        lights
    }

    /// One area as it is before the lens: daylight over the floor's, and the laser's light.
    pub(super) fn draw_sharp(&self, area: PixelRectangle, planes: &mut [Patch; 3], light: &mut Patch) {
        let outlines: Vec<Outline> =
            self.world.parts().map(|(part, bounds)| (part, self.view.outline_of(bounds))).collect();
        self.trace_area(area, &outlines, planes, light);
    }

    fn trace_area(
        &self,
        area: PixelRectangle,
        outlines: &[Outline],
        planes: &mut [Patch; 3],
        light: &mut Patch,
    ) {
        let columns = area.right - area.left;
        let [red, green, blue] = planes;
        let rows = (
            red.values.par_chunks_mut(columns),
            green.values.par_chunks_mut(columns),
            blue.values.par_chunks_mut(columns),
            light.values.par_chunks_mut(columns),
        );
        rows.into_par_iter().enumerate().for_each_init(
            || Work::new(columns),
            |work, (line, (red, green, blue, light))| {
                let row = area.top + line;
                let in_row =
                    outlines.iter().filter(|(_, outline)| (outline.top..outline.bottom).contains(&row));
                let in_row: Vec<&Outline> = in_row.collect();
                self.mark(area, row, &in_row, &mut work.concern);
                self.shade(area, row, work, [red, green, blue]);
                for index in (0..columns).filter(|index| work.concern[*index] == ANYTHING) {
                    let column = area.left + index;
                    let under = [red[index], green[index], blue[index]];
                    let (colour, laser) = self.trace_pixel(column, row, &in_row, under);
                    [red[index], green[index], blue[index]] = colour;
                    light[index] = laser;
                }
            },
        );
    }

    /// What the pixels of an area's row may look at: a part of a body lies around the line of sight, or the laser's
    /// sheet is near the place of the floor, or a body is.
    fn mark(&self, area: PixelRectangle, row: usize, in_row: &[&Outline], concern: &mut [u8]) {
        if !self.world.is_level() {
            // The quick way knows a level floor only.
            concern.fill(ANYTHING);
            return;
        }
        let throws_light = self.look.bounce > 0.0;
        let zones = self.world.bodies.iter().map(|body| {
            let Bounds { low, high } = body.bounds;
            let reach = SLACK_MM + if throws_light { REACH_MM } else { SHADOW_REACH_MM };
            let edges = [low.x - reach, high.x + reach, low.y - reach, high.y + reach];
            (edges.map(|edge| edge as f32), if body.is_pit() || throws_light { ANYTHING } else { SHADE })
        });
        let (normal, offset, near) = self.sheet.slab();
        let eye = self.view.centre();
        simd::run(Mark {
            sights: &self.view.sights(row)[area.left..area.right],
            concern,
            eye: [eye.x, eye.y, eye.z].map(|place| place as f32),
            zones: &zones.collect::<Vec<_>>(),
            normal: [normal.x as f32, normal.y as f32],
            offset: offset as f32,
            near: (near + SLACK_MM) as f32,
        });
        for (_, outline) in in_row {
            let (left, right) = (outline.left.max(area.left), outline.right.min(area.right));
            if left < right {
                concern[left - area.left..right - area.left].fill(ANYTHING);
            }
        }
    }

    /// Contact shadows in those pixels of an area's row that show nothing but the floor.
    fn shade(&self, area: PixelRectangle, row: usize, work: &mut Work, colours: [&mut [f32]; 3]) {
        let Work { concern, indices, places, open } = work;
        indices.clear();
        indices.extend((0..concern.len()).filter(|index| concern[*index] == SHADE));
        places.iter_mut().for_each(Vec::clear);
        for index in indices.iter() {
            let ray = self.view.ray(area.left + index, row);
            let point = ray.at(-ray.start.z / ray.direction.z);
            places[0].push(point.x);
            places[1].push(point.y);
            places[2].push(point.z);
        }
        open.resize(indices.len(), 1.0);
        let [x, y, z] = &*places;
        simd::run(OpenFloor { world: &self.world, places: [x, y, z], open });
        for plane in colours {
            for (index, open) in indices.iter().zip(&*open) {
                plane[*index] *= open;
            }
        }
    }

    /// Daylight (raw) and laser light of one pixel near objects; `under` is the bare floor's daylight.
    pub(super) fn trace_pixel(
        &self,
        column: usize,
        row: usize,
        in_row: &[&Outline],
        under: [f32; 3],
    ) -> ([f32; 3], f32) {
        let ray = self.view.ray(column, row);
        let parts = in_row.iter().filter(|(_, outline)| (outline.left..outline.right).contains(&column));
        let surface = self.world.trace_parts(&ray, parts.map(|(part, _)| *part));
        let Some(surface) = surface.filter(|_| ray.direction.is_finite()) else {
            return (under, 0.0);
        };
        let open = light::openness(&self.world, &surface) as f32;
        let towards_eye = || normalised(ray.direction.scaled(-1.0));
        let colour = match surface.body.and_then(|index| self.world.bodies.get(index)) {
            None => under,
            Some(body) => self.sensor.to_raw(self.daylight.on_body(
                surface.point,
                surface.normal,
                towards_eye(),
                &body.material,
            )),
        };
        let laser = self.laser_light(&surface, column, row, towards_eye)
            + self.bounced_light(&surface, column, row)
            + self.wandered_light(&surface);
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

    /// Laser light that comes back out of a translucent body beside where it has entered.
    fn wandered_light(&self, surface: &Surface) -> f32 {
        let (Some(part), Some(body)) =
            (surface.part, surface.body.and_then(|index| self.world.bodies.get(index)))
        else {
            return 0.0;
        };
        let Material { translucency, scatter_mm, laser_albedo, .. } = body.material;
        if translucency <= 0.0 {
            return 0.0;
        }
        let length_mm = f64::from(scatter_mm);
        let Some((entry, light)) = self.sheet.wandered(surface.point, surface.normal, length_mm) else {
            return 0.0;
        };
        // Where the body ends before the lit line, less light has entered it.
        let beside = self.world.distance_to(part, entry).max(0.0);
        let lifted = entry.plus(surface.normal.scaled(LIFT_MM));
        if beside > 8.0 * length_mm || self.world.blocked(self.sheet.origin(), lifted) {
            return 0.0;
        }
        (light * (-beside / length_mm).exp()) as f32 * laser_albedo * translucency
    }

    fn laser_light(
        &self,
        surface: &Surface,
        column: usize,
        row: usize,
        towards_eye: impl Fn() -> Vector,
    ) -> f32 {
        if !self.sheet.is_near(surface.point) {
            return 0.0;
        }
        let steps = self.view.steps(column, row, surface.point, surface.normal);
        let irradiance = self.sheet.irradiance(surface.point, surface.normal, steps);
        if irradiance <= 0.0 || self.world.blocked(self.sheet.origin(), surface.point) {
            return 0.0;
        }
        let returned = match surface.body.and_then(|index| self.world.bodies.get(index)) {
            Some(body) => self.returned(&body.material, surface, towards_eye()),
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
        let at_once = f64::from(material.laser_albedo) * (1.0 - f64::from(material.translucency));
        at_once + f64::from(material.gloss) * HIGHLIGHT * sharpness
    }
}

/// What a pixel of an area may show: the bare floor in the hall's light, ...
const BARE: u8 = 0;
/// ... the floor, perhaps with a body's shadow, ...
const SHADE: u8 = 1;
/// ... or anything.
const ANYTHING: u8 = 2;

/// Working memory for a row.
struct Work {
    concern: Vec<u8>,
    indices: Vec<usize>,
    places: [Vec<f64>; 3],
    open: Vec<f32>,
}

impl Work {
    fn new(columns: usize) -> Self {
        let [x, y, z] = [(); 3].map(|()| Vec::with_capacity(columns));
        Self {
            concern: vec![BARE; columns],
            indices: Vec::with_capacity(columns),
            places: [x, y, z],
            open: Vec::with_capacity(columns),
        }
    }
}

/// Where a row's lines of sight meet the floor: near a body, near the laser's sheet, or neither.
struct Mark<'a> {
    sights: &'a [[f32; 3]],
    concern: &'a mut [u8],
    eye: [f32; 3],
    /// Least and largest x, least and largest y of what is near a body, and what that makes of it.
    zones: &'a [([f32; 4], u8)],
    /// The sheet on the floor, x and y of its normal, and how far from it is near.
    normal: [f32; 2],
    offset: f32,
    near: f32,
}

impl Kernel for Mark<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { sights, concern, eye, zones, normal, offset, near } = self;
        for (concern, sight) in concern.iter_mut().zip(sights) {
            let along = -eye[2] / sight[2];
            let (x, y) = (eye[0] + sight[0] * along, eye[1] + sight[1] * along);
            let from_sheet = (normal[0] * x + normal[1] * y - offset).abs();
            let mut most = if from_sheet < near { ANYTHING } else { BARE };
            for ([left, right, low, high], zone) in zones {
                let inside = (x > *left) & (x < *right) & (y > *low) & (y < *high);
                most = most.max(if inside { *zone } else { BARE });
            }
            *concern = if along > 0.0 { most } else { BARE };
        }
    }
}
