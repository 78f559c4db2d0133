//! The bare floor: its colour under daylight, and where the laser lights it when nothing is in the way.

use rayon::prelude::*;

use super::planes::{cut, paste};
use super::{HALL_GREY, Twin};
use crate::twin::body::{Surface, World};
use crate::twin::patch::gaussian;
use crate::twin::sensor::RawPlanes;
use crate::twin::shape::length;
use crate::twin::view::PixelRectangle;

/// A pixel of the floor that the laser lights when nothing is in the way.
#[derive(Debug, Clone, Copy)]
pub(super) struct LitPixel {
    pub(super) index: u32,
    pub(super) light: f32,
    pub(super) point: [f32; 3],
}

impl Twin {
    /// The floor under daylight, and the pixels of it that the laser can reach.
    pub(super) fn paint_floor(&mut self) {
        let (width, height) = (self.view.width(), self.view.height());
        let mut values = vec![0.0_f32; 3 * width * height];
        let bare = World::bare(self.relief.clone());
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
        let slope = if self.relief.is_some() { self.daylight.on_slope(floor.normal) } else { 1.0 };
        let level = (self.daylight.on_floor(floor.point) * slope) as f32;
        albedo.map(|share| share * level)
    }

    pub(super) fn floor_albedo(&self, floor: &Surface, column: usize, row: usize) -> [f32; 3] {
        let steps = self.view.steps(column, row, floor.point, floor.normal);
        let [along, across] = self.axes.coordinates(floor.point);
        self.texture.albedo(along, across, length(steps[0]).max(length(steps[1])))
    }
}
