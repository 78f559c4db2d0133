//! Raw Bayer frames, as a camera gives them before its image processor: 10, 12 or 16 bits, packed or in 16-bit words.
//!
//! Nothing is demosaiced. Each 2 x 2 block of the mosaic becomes one sample of chroma, the layout on which the extraction
//! works anyway: green is the mean of the block's two, which lie around its middle, red and blue are moved to the
//! middle from the nearest four of their kind (a stripe would else lie half a pixel off). Luma has the blocks'
//! resolution.
//!
//! Files carry the name of V4L2's and libcamera's format in lower case as their extension: `srggb10p` (libcamera's
//! SRGGB10_CSI2P: four pixels in five bytes), `srggb12p` (two in three), `srggb10`, `srggb12`, `srggb16` (little-endian
//! words), and the same with `bggr`, `grbg`, `gbrg`.

use nearfield_shared::rig::ImageSize;

use super::frame::{Frame, Pixels, SizeMismatch};

/// What the sensor gives for darkness, of 65536: libcamera's figure for the Camera Module 3 (IMX708), and within a few
/// levels that of its siblings.
const BLACK: u16 = 4096;
/// Light from black to full.
const FULL: u32 = 65535 - BLACK as u32;
/// From the sensor's own colours to the eye's; each row sums to 1 so that grey stays grey. Typical of Bayer sensors in
/// daylight; without it the laser's red would be pale.
const COLOUR_MATRIX: [[f32; 3]; 3] = [[1.7, -0.6, -0.1], [-0.35, 1.65, -0.3], [0.0, -0.5, 1.5]];
/// Grey is balanced by at most so much.
const MOST_GAIN: f32 = 4.0;
/// Steps of the tone table.
const TONES: usize = 4096;
/// Rows are padded to a multiple of at most so many bytes.
const MOST_PADDING: usize = 128;

/// How the pixels of a raw frame lie in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawFormat {
    /// Column and row of the first red pixel, 0 or 1 each.
    red: [usize; 2],
    /// Bits that carry the light: 10, 12 or 16.
    bits: u32,
    /// Packed as CSI-2 sends it, rather than in 16-bit words.
    packed: bool,
}

impl RawFormat {
    /// The format that a file's extension names (lower case).
    #[must_use]
    pub fn from_extension(extension: &str) -> Option<Self> {
        let rest = extension.strip_prefix('s')?;
        let (order, rest) = rest.split_at_checked(4)?;
        let red = match order {
            "rggb" => [0, 0],
            "grbg" => [1, 0],
            "gbrg" => [0, 1],
            "bggr" => [1, 1],
            _ => return None,
        };
        let (bits, packed) = match rest {
            "10p" => (10, true),
            "12p" => (12, true),
            "10" => (10, false),
            "12" => (12, false),
            "16" => (16, false),
            _ => return None,
        };
        Some(Self { red, bits, packed })
    }

    /// Bytes that a row of `width` pixels takes without padding.
    const fn row_bytes(self, width: usize) -> usize {
        match (self.packed, self.bits) {
            (false, _) => 2 * width,
            (true, 10) => width.div_ceil(4) * 5,
            (true, _) => width.div_ceil(2) * 3,
        }
    }

    /// Makes a YUV420 frame of a raw one. Rows may be padded.
    ///
    /// # Errors
    /// [`SizeMismatch`] if the bytes do not make a picture of `size`, or the size is odd.
    pub fn read(self, size: ImageSize, bytes: &[u8]) -> Result<Frame, SizeMismatch> {
        let ImageSize { width, height } = size;
        if width % 2 != 0 || height % 2 != 0 {
            return Err(SizeMismatch::Odd { width, height });
        }
        let (columns, rows) = (usize::from(width), usize::from(height));
        let row_bytes = self.row_bytes(columns);
        let stride = bytes.len() / rows.max(1);
        let is_whole =
            stride * rows == bytes.len() && (row_bytes..row_bytes + MOST_PADDING).contains(&stride);
        if !is_whole {
            let expected = row_bytes * rows;
            return Err(SizeMismatch::Bytes { actual: bytes.len(), expected, width, height });
        }
        let mut mosaic = vec![0_u16; columns * rows];
        let lines = bytes.chunks_exact(stride.max(1)).zip(mosaic.chunks_exact_mut(columns.max(1)));
        lines.for_each(|(line, values)| self.unpack(line, values));
        let mosaic = Mosaic { values: mosaic, columns, rows, red: self.red };
        Frame::new(size, Pixels::Yuv420(mosaic.to_yuv420()))
    }

    /// The bytes of a frame in this format, from its values of 16 bits (black at 4096), row by row without padding.
    #[must_use]
    pub fn write(self, width: usize, values: &[u16]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.row_bytes(width) * values.len() / width.max(1));
        for row in values.chunks_exact(width.max(1)) {
            match (self.packed, self.bits) {
                (false, bits) => {
                    bytes.extend(row.iter().flat_map(|value| (value >> (16 - bits)).to_le_bytes()))
                }
                (true, 10) => pack::<4>(row, 2, &mut bytes),
                (true, _) => pack::<2>(row, 4, &mut bytes),
            }
        }
        bytes
    }

    /// Is red the first pixel?
    #[must_use]
    pub fn is_red_first(self) -> bool {
        self.red == [0, 0]
    }

    /// One row's light above black, of [`FULL`].
    fn unpack(self, line: &[u8], values: &mut [u16]) {
        let light = |value: u16| (value << (16 - self.bits)).saturating_sub(BLACK);
        match (self.packed, self.bits) {
            (false, _) => {
                for (value, word) in values.iter_mut().zip(line.chunks_exact(2)) {
                    *value = light(u16::from_le_bytes([word[0], word[1]]));
                }
            }
            // CSI-2: the high bits of some pixels, then a byte with the low bits of all, the first pixel's lowest.
            (true, 10) => {
                for (values, group) in values.chunks_mut(4).zip(line.chunks_exact(5)) {
                    for (index, value) in values.iter_mut().enumerate() {
                        let low = group[4] >> (2 * index) & 3;
                        *value = light(u16::from(group[index]) << 2 | u16::from(low));
                    }
                }
            }
            (true, _) => {
                for (values, group) in values.chunks_mut(2).zip(line.chunks_exact(3)) {
                    for (index, value) in values.iter_mut().enumerate() {
                        let low = group[2] >> (4 * index) & 15;
                        *value = light(u16::from(group[index]) << 4 | u16::from(low));
                    }
                }
            }
        }
    }
}

/// CSI-2's packing: the high bytes of `GROUP` pixels, then one byte with `low` bits of each.
fn pack<const GROUP: usize>(row: &[u16], low: u32, bytes: &mut Vec<u8>) {
    for pixels in row.chunks(GROUP) {
        let mut group = [0_u8; GROUP];
        let mut rest = 0;
        for (index, value) in pixels.iter().enumerate() {
            let [high, fine] = value.to_be_bytes();
            group[index] = high;
            rest |= fine >> (8 - low) << (low * index as u32);
        }
        bytes.extend(group);
        bytes.push(rest);
    }
}

/// A raw picture, one value a pixel.
struct Mosaic {
    values: Vec<u16>,
    columns: usize,
    rows: usize,
    red: [usize; 2],
}

impl Mosaic {
    fn at(&self, column: usize, row: usize) -> u32 {
        u32::from(self.values[row * self.columns + column])
    }

    /// The colour that has its first pixel at `first`, in the middle of a block: weighted by distance from the nearest
    /// four pixels of that colour. At the picture's rim the nearest stand for those beyond it.
    fn in_middle(&self, first: [usize; 2], block: [usize; 2]) -> f32 {
        let pair = |first: usize, block: usize, count: usize| {
            let near = 2 * block + first;
            let far = if first == 0 { near + 2 } else { near.saturating_sub(2) };
            [near, if far < count && far % 2 == first { far } else { near }]
        };
        let [near_column, far_column] = pair(first[0], block[0], self.columns);
        let [near_row, far_row] = pair(first[1], block[1], self.rows);
        let sum = 9 * self.at(near_column, near_row)
            + 3 * (self.at(far_column, near_row) + self.at(near_column, far_row))
            + self.at(far_column, far_row);
        sum as f32 / 16.0
    }

    /// Red, green and blue in the middle of a block.
    fn colour(&self, column: usize, row: usize) -> [f32; 3] {
        let [red_column, red_row] = self.red;
        let greens = self.at(2 * column + 1 - red_column, 2 * row + red_row)
            + self.at(2 * column + red_column, 2 * row + 1 - red_row);
        let block = [column, row];
        let blue = [1 - red_column, 1 - red_row];
        [self.in_middle(self.red, block), greens as f32 / 2.0, self.in_middle(blue, block)]
    }

    /// Gains that make the whole picture grey on average; what is clipped does not count.
    fn balance(&self) -> [f32; 3] {
        let mut sums = [1.0_f64; 3];
        for row in (0..self.rows / 2).step_by(4) {
            for column in (0..self.columns / 2).step_by(4) {
                let colour = self.colour(column, row);
                if colour.iter().all(|light| *light < 0.95 * FULL as f32) {
                    sums.iter_mut().zip(colour).for_each(|(sum, light)| *sum += f64::from(light));
                }
            }
        }
        sums.map(|sum| ((sums[1] / sum) as f32).clamp(1.0 / MOST_GAIN, MOST_GAIN))
    }

    /// The three planes, one after the other.
    fn to_yuv420(&self) -> Vec<u8> {
        let area = self.columns * self.rows;
        let mut planes = vec![0; area / 2 * 3];
        let (luma, chroma) = planes.split_at_mut(area);
        let (blue, red) = chroma.split_at_mut(area / 4);
        let (tone, gains) = (tones(), self.balance());
        let half = self.columns / 2;
        for row in 0..self.rows / 2 {
            for column in 0..half {
                let light = self.colour(column, row);
                let light: [f32; 3] =
                    std::array::from_fn(|channel| (light[channel] * gains[channel] / FULL as f32).min(1.0));
                let [r, g, b] = COLOUR_MATRIX.map(|weights| {
                    let mixed: f32 = weights.iter().zip(light).map(|(weight, light)| weight * light).sum();
                    f32::from(tone[(mixed.clamp(0.0, 1.0) * (TONES - 1) as f32 + 0.5) as usize])
                });
                let at = row * half + column;
                // BT.601, full range, as image processors give it; `as` saturates.
                blue[at] = (128.5 - 0.168_736 * r - 0.331_264 * g + 0.5 * b) as u8;
                red[at] = (128.5 + 0.5 * r - 0.418_688 * g - 0.081_312 * b) as u8;
                let bright = (0.5 + 0.299 * r + 0.587 * g + 0.114 * b) as u8;
                for line in [2 * row, 2 * row + 1] {
                    luma[line * self.columns + 2 * column..][..2].fill(bright);
                }
            }
        }
        planes
    }
}

/// The sRGB tone curve (IEC 61966-2-1).
fn tones() -> Vec<u8> {
    let curve = |step: usize| {
        let linear = step as f32 / (TONES - 1) as f32;
        let toned =
            if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
        (toned * 255.0 + 0.5) as u8
    };
    (0..TONES).map(curve).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::FrameView;

    const SIZE: ImageSize = ImageSize { width: 8, height: 48 };

    /// Words of 16 bits of a mosaic whose light is `light(column, row, colour)`, 0 to 1.
    fn mosaic(order: &str, light: impl Fn(usize, usize, usize) -> f64) -> Vec<u16> {
        let red = RawFormat::from_extension(&format!("s{order}16")).unwrap().red;
        (0..48 * 8)
            .map(|index| {
                let (column, row) = (index % 8, index / 8);
                let colour = match (column % 2 == red[0], row % 2 == red[1]) {
                    (true, true) => 0,
                    (false, false) => 2,
                    _ => 1,
                };
                BLACK + (light(column, row, colour) * f64::from(FULL)) as u16
            })
            .collect()
    }

    fn words(values: &[u16], bits: u32) -> Vec<u8> {
        values.iter().flat_map(|value| (value >> (16 - bits)).to_le_bytes()).collect()
    }

    fn packed(values: &[u16], bits: u32) -> Vec<u8> {
        let (group, low) = if bits == 10 { (4, 2) } else { (2, 4) };
        let mut bytes = Vec::new();
        for group in values.chunks(group) {
            bytes.extend(group.iter().map(|value| (value >> 8) as u8));
            let rest = |value: &u16| (value >> (8 - low)) as u8 & ((1 << low) - 1);
            bytes.push(
                group.iter().enumerate().fold(0, |all, (index, value)| all | rest(value) << (low * index)),
            );
        }
        bytes
    }

    fn read(extension: &str, bytes: &[u8]) -> Result<Frame, SizeMismatch> {
        RawFormat::from_extension(extension).unwrap().read(SIZE, bytes)
    }

    /// A stripe whose middle is at `middle`, as red light on grey.
    fn stripe(middle: f64) -> impl Fn(usize, usize, usize) -> f64 {
        move |_, row, colour| {
            let bell = (-0.5 * ((row as f64 - middle) / 2.5).powi(2)).exp();
            0.15 + if colour == 0 { 0.3 * bell } else { 0.0 }
        }
    }

    #[test]
    fn every_packing_holds_the_same_picture() {
        let values = mosaic("rggb", stripe(23.3));
        let sixteen = read("srggb16", &words(&values, 16)).unwrap();
        let twelve = read("srggb12", &words(&values, 12)).unwrap();
        let ten = read("srggb10", &words(&values, 10)).unwrap();
        assert_eq!(read("srggb12p", &packed(&values, 12)).unwrap(), twelve);
        assert_eq!(read("srggb10p", &packed(&values, 10)).unwrap(), ten);
        for frame in [twelve, ten] {
            let pairs = frame.to_rgb().into_iter().zip(sixteen.to_rgb());
            assert!(pairs.into_iter().all(|(one, other)| one.abs_diff(other) <= 4), "bits lost are noise");
        }
    }

    /// Red is sampled in one corner of its block; not moved to the middle, the stripe would lie half a pixel off, in a
    /// direction that depends on the mosaic's order.
    #[test]
    fn the_stripe_lies_where_it_is_whatever_the_order_of_the_mosaic() {
        for order in ["rggb", "bggr", "grbg", "gbrg"] {
            for step in 0..8 {
                let middle = 22.0 + f64::from(step) / 4.0;
                let frame = read(&format!("s{order}16"), &words(&mosaic(order, stripe(middle)), 16)).unwrap();
                let FrameView::Yuv420 { red, .. } = frame.view() else { panic!("chroma planes") };
                let (mut weight, mut moment) = (0.0, 0.0);
                for row in 0..24 {
                    let excess = f64::from(red.row(row)[1]) - f64::from(red.row(0)[1]);
                    weight += excess;
                    moment += excess * (2.0 * row as f64 + 0.5);
                }
                let found = moment / weight;
                assert!((found - middle).abs() < 0.1, "{order}, stripe at {middle}: {found}");
            }
        }
    }

    /// What is written is what CSI-2 sends, checked against bytes made by hand; and it is read again.
    #[test]
    fn writing_packs_as_csi_2_does() {
        let values = [0xABC0, 0x1234, 0xFFFF, 0x8040];
        let format = |name: &str| RawFormat::from_extension(name).unwrap();
        let ten = format("srggb10p").write(4, &values);
        assert_eq!(ten, [0xAB, 0x12, 0xFF, 0x80, 0b0111_0011], "low bits: 3, 0, 3, 1");
        assert_eq!(format("srggb12p").write(4, &values), [0xAB, 0x12, 0x3C, 0xFF, 0x80, 0x4F]);
        assert_eq!(format("srggb12").write(4, &values), [0xBC, 0x0A, 0x23, 0x01, 0xFF, 0x0F, 0x04, 0x08]);
        let mosaic = mosaic("rggb", stripe(21.0));
        for (name, bits) in [("srggb10p", 10), ("srggb12p", 12)] {
            assert_eq!(format(name).write(8, &mosaic), packed(&mosaic, bits), "{name}");
        }
    }

    #[test]
    fn a_grey_picture_stays_grey_under_any_light() {
        let tinted = mosaic("bggr", |_, _, colour| [0.1, 0.2, 0.07][colour]);
        for pixel in read("sbggr16", &words(&tinted, 16)).unwrap().to_rgb().chunks_exact(3) {
            assert!(pixel[0].abs_diff(pixel[1]) <= 2 && pixel[2].abs_diff(pixel[1]) <= 2, "{pixel:?}");
        }
    }

    #[test]
    fn padded_rows_are_read_and_missing_bytes_refused() {
        let values = mosaic("rggb", stripe(20.0));
        let bytes = packed(&values, 10);
        let padded: Vec<u8> = bytes.chunks(10).flat_map(|row| [row, &[0xAA; 22]].concat()).collect();
        assert_eq!(read("srggb10p", &padded), read("srggb10p", &bytes));
        for length in [0, 1, bytes.len() - 1] {
            assert!(read("srggb10p", &bytes[..length]).is_err(), "{length} bytes");
        }
        assert!(read("srggb10p", &[bytes.as_slice(), &[0]].concat()).is_err(), "a byte too many");
        let odd = ImageSize { width: 7, height: 48 };
        assert!(RawFormat::from_extension("srggb16").unwrap().read(odd, &[0; 7 * 48 * 2]).is_err());
    }

    #[test]
    fn only_formats_that_are_read_have_names() {
        for name in ["srggb10p", "sbggr12p", "sgrbg10", "sgbrg12", "srggb16"] {
            assert!(RawFormat::from_extension(name).is_some(), "{name}");
        }
        for name in ["", "s", "srggb", "srggb8", "srggb14p", "srggb16p", "sxxxx10", "rggb10", "sé€"] {
            assert!(RawFormat::from_extension(name).is_none(), "{name}");
        }
    }
}
