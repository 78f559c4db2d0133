//! Height along the stripe, one value per millimetre of laser rays: for people, reports and recordings.

use nearfield_shared::rig::Stripe;

use super::extractor::Extractor;

/// Distance of the profile's values, millimetres.
const PITCH_MM: f32 = 1.0;
/// A value is taken from readings this near along the stripe, millimetres: the far end of a rig that looks along the
/// stripe has two millimetres to a column.
const REACH_MM: f32 = 1.5;

/// Heights over the floor along the stripe; owns its memory.
#[derive(Debug, Clone)]
pub struct Profile {
    start: f32,
    heights: Vec<f32>,
    distances: Vec<f32>,
}

impl Profile {
    fn new(stripe: Stripe) -> Self {
        let (start, end) = (stripe.start.ceil(), stripe.end.floor());
        let count = if end >= start { (end - start) as usize + 1 } else { 0 };
        Self { start: start as f32, heights: vec![f32::NAN; count], distances: vec![f32::INFINITY; count] }
    }

    /// Takes the last frame of `extractor`: for each millimetre of `stripe` the nearest laser ray that was seen to end
    /// somewhere.
    pub(super) fn of(extractor: &Extractor, stripe: Stripe) -> Self {
        let mut profile = Self::new(stripe);
        profile.fill(extractor);
        profile
    }

    fn fill(&mut self, extractor: &Extractor) {
        let geometry = extractor.geometry();
        let watched = geometry.watched();
        let readings = extractor.readings().get(watched).unwrap_or(&[]);
        for (map, reading) in geometry.maps().iter().zip(readings) {
            self.offer(geometry.ray_place(map, reading.row), map.height(reading.row));
        }
        for point in extractor.points() {
            self.offer(point.place, point.height);
        }
    }

    fn offer(&mut self, place: f32, height: f32) {
        let low = ((place - REACH_MM - self.start) / PITCH_MM).ceil().max(0.0);
        let high = (place + REACH_MM - self.start) / PITCH_MM;
        let mut bin = low;
        // NaN ends the loop at once.
        while bin <= high {
            let index = bin as usize;
            let (Some(distance), Some(value)) = (self.distances.get_mut(index), self.heights.get_mut(index))
            else {
                return;
            };
            let here = (place - self.start - bin * PITCH_MM).abs();
            if here < *distance {
                (*distance, *value) = (here, height);
            }
            bin += 1.0;
        }
    }

    /// Pairs of place along the stripe and height, both in millimetres; NaN where no ray was seen to end.
    pub fn values(&self) -> impl Iterator<Item = (f32, f32)> {
        self.heights.iter().enumerate().map(|(index, height)| (self.start + index as f32 * PITCH_MM, *height))
    }
}
