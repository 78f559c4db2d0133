//! The laser's light behind the lens: on the floor where no body keeps it off, on bodies, and smeared by the lens.

use nearfield_shared::camera::Vector;
use rayon::prelude::*;

use super::Twin;
use crate::twin::patch::{Patch, gaussian};
use crate::twin::view::PixelRectangle;

/// The halo's reach, pixels.
const HALO_REACH: f64 = 10.0;

impl Twin {
    /// Fills the laser's plane anew: the lit floor, the light on objects, then the lens.
    pub(super) fn relight(&mut self, areas: &[PixelRectangle], light: Vec<Patch>) {
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
        let rows = floor.iter().map(|(index, _)| index / width).chain(light.iter().flat_map(rows_with_light));
        let (first, last) = rows.fold((usize::MAX, 0), |(first, last), row| (first.min(row), last.max(row)));
        let first = first.min(last);
        let reach = HALO_REACH * self.scale();
        let stripe = PixelRectangle { left: 0, top: first, right: width, bottom: (last + 1).min(height) };
        let band =
            PixelRectangle { left: 0, right: width, ..stripe.grown((5.0 * reach) as usize, width, height) };
        let mut plane = Patch::dark(band);
        for (index, value) in floor {
            plane.values[index - band.top * width] = value;
        }
        for patch in light {
            let lines = patch.values.chunks_exact(patch.width()).zip(patch.area.top..);
            for (line, row) in lines.filter(|(_, row)| (band.top..band.bottom).contains(row)) {
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
            let width = plane.width();
            let lines = plane.values.par_chunks_mut(width).zip(wide.values.par_chunks(width));
            lines.for_each(|(line, wide)| {
                for (value, spread) in line.iter_mut().zip(wide) {
                    *value += halo * (spread - *value);
                }
            });
        }
    }
}

/// Rows of the picture in which a patch is not dark.
fn rows_with_light(patch: &Patch) -> impl Iterator<Item = usize> + '_ {
    let lines = patch.values.chunks_exact(patch.width()).zip(patch.area.top..);
    lines.filter(|(line, _)| line.iter().any(|value| *value != 0.0)).map(|(_, row)| row)
}
