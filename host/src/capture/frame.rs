//! One camera frame, owned or borrowed, in the layouts that cameras and files give.

use nearfield_shared::rig::ImageSize;

/// Pixels that do not fill the picture they are said to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SizeMismatch {
    /// Wrong number of bytes.
    #[error("{actual} bytes instead of {expected} bytes for {width} x {height}")]
    Bytes {
        /// Bytes given.
        actual: usize,
        /// Bytes needed.
        expected: usize,
        /// Columns.
        width: u16,
        /// Rows.
        height: u16,
    },
    /// Chroma is stored for 2 x 2 pixels, which an odd size cannot hold.
    #[error("YUV420 needs an even width and height, not {width} x {height}")]
    Odd {
        /// Columns.
        width: u16,
        /// Rows.
        height: u16,
    },
    /// A plane of a borrowed frame ends before its last row.
    #[error("a plane holds {actual} bytes, but its rows need {expected}")]
    Plane {
        /// Bytes given.
        actual: usize,
        /// Bytes needed.
        expected: usize,
    },
}

/// The pixels of a [`Frame`], rows without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pixels {
    /// Red, green, blue; 8 bits each, interleaved.
    Rgb(Vec<u8>),
    /// Brightness only, 8 bits: a monochrome camera (behind the laser's band-pass filter).
    Grey(Vec<u8>),
    /// Y, then U, then V; U and V for 2 x 2 pixels each (I420).
    Yuv420(Vec<u8>),
    /// Y, then U and V interleaved for 2 x 2 pixels.
    Nv12(Vec<u8>),
}

/// One camera frame with its pixels; checked to be whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    size: ImageSize,
    pixels: Pixels,
}

impl Frame {
    /// Takes pixels that fill a picture of `size` exactly.
    ///
    /// # Errors
    /// [`SizeMismatch`] says what does not fit.
    pub fn new(size: ImageSize, pixels: Pixels) -> Result<Self, SizeMismatch> {
        let ImageSize { width, height } = size;
        let area = usize::from(width) * usize::from(height);
        let (actual, expected) = match &pixels {
            Pixels::Rgb(bytes) => (bytes.len(), area * 3),
            Pixels::Grey(bytes) => (bytes.len(), area),
            Pixels::Yuv420(bytes) | Pixels::Nv12(bytes) => {
                if width % 2 != 0 || height % 2 != 0 {
                    return Err(SizeMismatch::Odd { width, height });
                }
                (bytes.len(), area / 2 * 3)
            }
        };
        if actual == expected {
            Ok(Self { size, pixels })
        } else {
            Err(SizeMismatch::Bytes { actual, expected, width, height })
        }
    }

    /// A picture without pixels, to copy others into.
    #[must_use]
    pub const fn empty() -> Self {
        Self { size: ImageSize { width: 0, height: 0 }, pixels: Pixels::Grey(Vec::new()) }
    }

    /// The pixels' memory, emptied.
    fn take_memory(&mut self) -> Vec<u8> {
        let mut bytes = match std::mem::replace(&mut self.pixels, Pixels::Grey(Vec::new())) {
            Pixels::Rgb(bytes) | Pixels::Grey(bytes) | Pixels::Yuv420(bytes) | Pixels::Nv12(bytes) => bytes,
        };
        bytes.clear();
        bytes
    }

    /// Becomes a copy of another frame; memory that is large enough is used again.
    pub fn copy_from(&mut self, other: &Self) {
        self.size = other.size;
        let mut bytes = self.take_memory();
        let mut copy = |source: &[u8]| {
            bytes.extend_from_slice(source);
            std::mem::take(&mut bytes)
        };
        self.pixels = match &other.pixels {
            Pixels::Rgb(source) => Pixels::Rgb(copy(source)),
            Pixels::Grey(source) => Pixels::Grey(copy(source)),
            Pixels::Yuv420(source) => Pixels::Yuv420(copy(source)),
            Pixels::Nv12(source) => Pixels::Nv12(copy(source)),
        };
    }

    /// Becomes this YUV420 picture; memory that is large enough is used again. Bytes that do not fill it make it empty.
    pub fn fill_yuv420(&mut self, size: ImageSize, source: &[u8]) {
        let mut bytes = self.take_memory();
        bytes.extend_from_slice(source);
        *self = Self::new(size, Pixels::Yuv420(bytes)).unwrap_or_else(|_| Self::empty());
    }

    /// The same from planes whose rows are padded: `stride` bytes from one row of brightness to the next, half as many from one row
    /// of colour to the next. Returns if they were long enough; else it is empty.
    pub fn fill_yuv420_rows(&mut self, size: ImageSize, stride: usize, planes: [&[u8]; 3]) -> bool {
        let mut bytes = self.take_memory();
        let (width, height) = (usize::from(size.width), usize::from(size.height));
        let [luma, blue, red] = planes;
        let parts = [
            (luma, width, height, stride),
            (blue, width / 2, height / 2, stride / 2),
            (red, width / 2, height / 2, stride / 2),
        ];
        for (plane, width, height, stride) in parts {
            for row in 0..height {
                let begin = row * stride;
                bytes.extend_from_slice(plane.get(begin..begin + width).unwrap_or_default());
            }
        }
        let made = Self::new(size, Pixels::Yuv420(bytes));
        let fits = made.is_ok();
        *self = made.unwrap_or_else(|_| Self::empty());
        fits
    }

    /// For pixels that were made to fill `size`.
    pub(super) const fn whole(size: ImageSize, pixels: Pixels) -> Self {
        Self { size, pixels }
    }

    /// The size in pixels.
    #[must_use]
    pub const fn size(&self) -> ImageSize {
        self.size
    }

    /// The pixels.
    #[must_use]
    pub const fn pixels(&self) -> &Pixels {
        &self.pixels
    }

    /// The frame's planes, borrowed.
    #[must_use]
    pub fn view(&self) -> FrameView<'_> {
        let (width, height) = (usize::from(self.size.width), usize::from(self.size.height));
        let area = width * height;
        match &self.pixels {
            Pixels::Rgb(bytes) => {
                FrameView::Rgb(Plane { bytes, stride: width * 3, width: width * 3, height })
            }
            Pixels::Grey(bytes) => FrameView::Grey(Plane { bytes, stride: width, width, height }),
            Pixels::Yuv420(bytes) => {
                let (luma, chroma) = bytes.split_at(area);
                let (blue, red) = chroma.split_at(area / 4);
                let half = |bytes| Plane { bytes, stride: width / 2, width: width / 2, height: height / 2 };
                FrameView::Yuv420 {
                    luma: Plane { bytes: luma, stride: width, width, height },
                    blue: half(blue),
                    red: half(red),
                }
            }
            Pixels::Nv12(bytes) => {
                let (luma, chroma) = bytes.split_at(area);
                FrameView::Nv12 {
                    luma: Plane { bytes: luma, stride: width, width, height },
                    chroma: Plane { bytes: chroma, stride: width, width, height: height / 2 },
                }
            }
        }
    }
}

/// One plane of a frame as it lies in memory: rows of `width` bytes, `stride` bytes apart.
#[derive(Debug, Clone, Copy)]
pub struct Plane<'a> {
    bytes: &'a [u8],
    stride: usize,
    width: usize,
    height: usize,
}

impl<'a> Plane<'a> {
    /// A plane of `height` rows of `width` bytes that begin `stride` bytes apart (camera buffers pad their rows).
    ///
    /// # Errors
    /// [`SizeMismatch::Plane`] if the bytes do not hold the last row, or rows overlap.
    pub fn new(bytes: &'a [u8], stride: usize, width: usize, height: usize) -> Result<Self, SizeMismatch> {
        let expected = match height {
            0 => 0,
            rows => (rows - 1).saturating_mul(stride).saturating_add(width),
        };
        if bytes.len() < expected || stride < width {
            return Err(SizeMismatch::Plane { actual: bytes.len(), expected });
        }
        Ok(Self { bytes, stride, width, height })
    }

    /// One row; empty beyond the last.
    #[must_use]
    #[inline]
    pub fn row(&self, row: usize) -> &'a [u8] {
        if row >= self.height {
            return &[];
        }
        let start = row * self.stride;
        self.bytes.get(start..start + self.width).unwrap_or(&[])
    }

    /// Bytes in a row.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// All bytes, rows `stride` apart.
    #[must_use]
    pub(crate) const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Bytes from one row's beginning to the next one's.
    #[must_use]
    pub const fn stride(&self) -> usize {
        self.stride
    }
}

/// The planes of a frame, borrowed from a [`Frame`] or from a camera's buffer. The layouts are those of [`Pixels`].
#[derive(Debug, Clone, Copy)]
pub enum FrameView<'a> {
    /// Interleaved red, green, blue.
    Rgb(Plane<'a>),
    /// Brightness only.
    Grey(Plane<'a>),
    /// Three planes; chroma at half resolution, sited in the middle of its 2 x 2 pixels.
    Yuv420 {
        /// Y.
        luma: Plane<'a>,
        /// U (Cb).
        blue: Plane<'a>,
        /// V (Cr).
        red: Plane<'a>,
    },
    /// Y, and U and V interleaved; chroma as in [`Self::Yuv420`].
    Nv12 {
        /// Y.
        luma: Plane<'a>,
        /// U and V in turn.
        chroma: Plane<'a>,
    },
}
