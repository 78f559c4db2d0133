//! The hall's light, and the settings of camera and laser.

use serde::{Deserialize, Serialize};

/// The light of the hall: even light from all sides plus one soft main direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Light {
    /// Illuminance of the floor in lux (100 dim, 400 office, 1500 bright).
    pub lux: f64,
    /// Where the main light comes from, degrees around from the stripe's direction.
    pub from_degrees: f64,
    /// How much it grows or falls over one metre of floor, share of the whole (0 even).
    pub unevenness: f64,
}

impl Default for Light {
    fn default() -> Self {
        Self { lux: 400.0, from_degrees: 60.0, unevenness: 0.15 }
    }
}

/// Camera and laser settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Look {
    /// Exposure; at 1 a white floor under 400 lux just saturates. Left out: chosen so that the floor is mid-grey.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// Amplification; more means more noise at the same brightness.
    pub gain: f64,
    /// Electrons that a pixel holds at gain 1 when it saturates.
    pub full_well_electrons: f64,
    /// Read noise, electrons.
    pub read_noise_electrons: f64,
    /// Contrast of the laser's speckle in the finished picture (standard deviation over mean).
    pub speckle: f64,
    /// Blur of the lens: standard deviation in pixels. Demosaicing adds its own.
    pub blur_pixels: f64,
    /// Share of the laser's light that the lens spreads widely.
    pub halo: f64,
    /// The laser's power relative to 5 mW at full drive.
    pub laser_power: f64,
    /// How far the fan of light reaches beyond both ends of the watched stripe.
    pub fan_overhang_mm: f64,
    /// Width (at 1/e^2) of the band of a red LED with a slit that stands in for the laser, in the focus; such a band is as
    /// much dimmer than the laser's line as it is wider, and has no speckle. Left out: the laser.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub led_band_mm: Option<f64>,
    /// Share of the light that the lens loses in the picture's farthest corner; grows with the square of the distance
    /// from the middle.
    pub vignetting: f64,
    /// Strength of the light that lit bodies throw on what is around them: 0 none, 1 as physics says.
    pub bounce: f64,
    /// Time from one row's exposure to the next one's, microseconds: a rolling shutter (13.4 for the Camera Module 3 at
    /// 2304x1296). 0: all rows at once. Seen only in sequences.
    pub row_time_us: f64,
    /// How long each row is exposed, milliseconds: what moves is smeared by its way in this time. 0: an instant. How bright the
    /// picture is, is [`Self::exposure`]'s business. Seen only in sequences.
    pub exposure_ms: f64,
    /// False: the picture is a Bayer mosaic, which no processor has blurred by reconstructing colours.
    pub demosaiced: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            exposure: None,
            gain: 1.0,
            full_well_electrons: 9000.0,
            read_noise_electrons: 4.0,
            speckle: 0.18,
            blur_pixels: 0.75,
            halo: 0.02,
            laser_power: 1.0,
            fan_overhang_mm: 8.0,
            led_band_mm: None,
            vignetting: 0.0,
            bounce: 0.0,
            row_time_us: 0.0,
            exposure_ms: 0.0,
            demosaiced: true,
        }
    }
}
