//! A picture of a floor that is laid over the whole floor like tiles.

use std::io::Cursor;
use std::path::Path;

use image::ImageReader;

use super::material::LinearColour;
use super::scene::SceneError;

/// No side of a picture may be longer, pixels.
const LONGEST_SIDE: u32 = 4096;
/// No floor returns more or less than this of any colour, whatever its picture says.
const REFLECTANCE: (f32, f32) = (0.01, 0.95);

/// A picture as linear light, at full size and scaled down by two again and again.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTexture {
    levels: Vec<Level>,
}

#[derive(Debug, Clone, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    /// Linear sRGB, 65535 = 1; row by row.
    texels: Vec<[u16; 3]>,
}

impl ImageTexture {
    /// Reads a picture (PNG or JPEG, sRGB). Its colours are taken as the share of light that the floor returns.
    ///
    /// # Errors
    /// The file cannot be read, is no picture, or is too large.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let refuse = |reason: String| SceneError::Image { file: path.display().to_string(), reason };
        let bytes = std::fs::read(path).map_err(|error| refuse(error.to_string()))?;
        let open = || ImageReader::new(Cursor::new(&bytes)).with_guessed_format();
        // The size first: a small file may claim to be a picture that fills the memory.
        let (width, height) = open()
            .map_err(|error| refuse(error.to_string()))?
            .into_dimensions()
            .map_err(|error| refuse(error.to_string()))?;
        if width.max(height) > LONGEST_SIDE || width.min(height) == 0 {
            return Err(refuse(format!("{width} x {height} pixels; 1 to {LONGEST_SIDE} are allowed")));
        }
        let picture = open()
            .map_err(|error| refuse(error.to_string()))?
            .decode()
            .map_err(|error| refuse(error.to_string()))?;
        let texels = picture.to_rgb8().pixels().map(|pixel| pixel.0.map(linear)).collect();
        Ok(Self::new(width as usize, height as usize, texels))
    }

    fn new(width: usize, height: usize, texels: Vec<[u16; 3]>) -> Self {
        let mut levels = vec![Level { width, height, texels }];
        while let Some(last) = levels.last().filter(|last| last.width.max(last.height) > 1) {
            levels.push(last.halved());
        }
        Self { levels }
    }

    /// Height over width.
    #[must_use]
    pub fn aspect(&self) -> f64 {
        self.levels.first().map_or(1.0, |level| level.height as f64 / level.width as f64)
    }

    /// Mean colour.
    #[must_use]
    pub fn mean(&self) -> LinearColour {
        self.levels.last().map_or([0.0; 3], |level| level.at(0, 0)).map(within_reflectance)
    }

    /// Colour at a place, in widths of the picture to the right and downwards from its upper left corner; the picture goes
    /// on in all directions. Details finer than `footprint` (in widths) are averaged.
    #[must_use]
    pub fn colour(&self, x: f64, y: f64, footprint: f64) -> LinearColour {
        let width = self.levels.first().map_or(1, |level| level.width) as f64;
        let fine = (footprint * width).max(1.0).log2().min((self.levels.len() - 1) as f64);
        let (lower, share) = (fine.floor() as usize, fine.fract() as f32);
        let at =
            |level: usize| self.levels.get(level).map_or([0.0; 3], |level| level.sample(x, y, self.aspect()));
        let (fine, coarse) = (at(lower), if share > 0.0 { at(lower + 1) } else { at(lower) });
        std::array::from_fn(|c| within_reflectance(fine[c] + share * (coarse[c] - fine[c])))
    }
}

fn within_reflectance(share: f32) -> f32 {
    share.clamp(REFLECTANCE.0, REFLECTANCE.1)
}

impl Level {
    fn at(&self, column: i64, row: i64) -> LinearColour {
        let column = column.rem_euclid(self.width as i64) as usize;
        let row = row.rem_euclid(self.height as i64) as usize;
        self.texels[row * self.width + column].map(|value| f32::from(value) / f32::from(u16::MAX))
    }

    /// Between the four nearest pixels.
    fn sample(&self, x: f64, y: f64, aspect: f64) -> LinearColour {
        let (u, v) = (x * self.width as f64 - 0.5, y / aspect * self.height as f64 - 0.5);
        let (column, row) = (u.floor(), v.floor());
        let (s, t) = ((u - column) as f32, (v - row) as f32);
        let (column, row) = (column as i64, row as i64);
        let [a, b] = [self.at(column, row), self.at(column + 1, row)];
        let [c, d] = [self.at(column, row + 1), self.at(column + 1, row + 1)];
        std::array::from_fn(|i| {
            let (upper, lower) = (a[i] + s * (b[i] - a[i]), c[i] + s * (d[i] - c[i]));
            upper + t * (lower - upper)
        })
    }

    /// Half as wide and high, rounded up; each pixel the mean of four.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let texel = |index: usize| {
            let (column, row) = ((index % width) * 2, (index / width) * 2);
            let mut sums = [0_u32; 3];
            for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (column, row) = ((column + i).min(self.width - 1), (row + j).min(self.height - 1));
                let texel = self.texels[row * self.width + column];
                (0..3).for_each(|c| sums[c] += u32::from(texel[c]));
            }
            // A mean of four 16-bit numbers is one.
            sums.map(|sum| ((sum + 2) / 4) as u16)
        };
        Self { width, height, texels: (0..width * height).map(texel).collect() }
    }
}

/// An sRGB byte (IEC 61966-2-1) as linear light.
fn linear(byte: u8) -> u16 {
    let toned = f32::from(byte) / 255.0;
    let light = if toned <= 0.040_45 { toned / 12.92 } else { ((toned + 0.055) / 1.055).powf(2.4) };
    (light * f32::from(u16::MAX) + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Left half dark, right half bright.
    fn halves() -> ImageTexture {
        let texels = (0..64 * 32).map(|i| [if i % 64 < 32 { 6_554 } else { 52_428 }; 3]).collect();
        ImageTexture::new(64, 32, texels)
    }

    #[test]
    fn the_picture_lies_where_it_should_goes_on_for_ever_and_fades_to_its_mean() {
        let texture = halves();
        for tile in [-3.0, 0.0, 7.0] {
            assert!((texture.colour(0.25 + tile, 0.1, 0.001)[0] - 0.1).abs() < 1e-3);
            assert!((texture.colour(0.75 + tile, 0.4 + tile, 0.001)[0] - 0.8).abs() < 1e-3);
        }
        assert!((texture.mean()[1] - 0.45).abs() < 1e-3, "{:?}", texture.mean());
        assert!((texture.colour(0.25, 0.1, 1.0)[2] - 0.45).abs() < 1e-3, "far away only the mean is left");
    }

    #[test]
    fn colours_are_those_of_the_file_and_mistakes_name_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("floor.png");
        image::RgbImage::from_pixel(5, 3, image::Rgb([188, 124, 89])).save(&file).unwrap();
        let texture = ImageTexture::read(&file).unwrap();
        for (found, expected) in texture.mean().into_iter().zip([0.503, 0.202, 0.100]) {
            assert!((found - expected).abs() < 2e-3, "{found} {expected}");
        }
        assert!((texture.aspect() - 0.6).abs() < 1e-12);
        std::fs::write(&file, "no picture").unwrap();
        let message = ImageTexture::read(&file).unwrap_err().to_string();
        assert!(message.contains("floor.png"), "{message}");
    }
}
