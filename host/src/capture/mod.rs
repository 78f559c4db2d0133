//! Pictures from files: PNG, JPEG, PGM, raw YUV420 and raw Bayer become a [`Frame`] of the size that the rig names.
//!
//! A file that is truncated, no picture, or of another size is refused with its name and the remedy; nothing is
//! scaled, padded or guessed, because a row that is off by one pixel is a height that is off by a millimetre.

mod bayer;
mod convert;
mod frame;

pub use bayer::RawFormat;
pub use frame::{Frame, FrameView, Pixels, Plane, SizeMismatch};

use std::path::{Path, PathBuf};

use image::{ImageDecoder as _, ImageFormat};
use nearfield_shared::rig::ImageSize;

/// Why a picture was refused.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The file could not be read.
    #[error("{}: cannot read the picture: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is empty.
    #[error("{}: the file is empty; record it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// No picture by its content, and not named as a raw frame.
    #[error(
        "{}: not a picture that can be read; give PNG, JPEG, PGM, or raw frames named {RAW_NAMES}",
        path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// A picture, but damaged or cut short.
    #[error("{}: the picture is damaged or cut short ({message}); record or copy it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        message: String,
    },
    /// A picture of another size than the rig's.
    #[error(
        "{}: the picture is {width} x {height}, but image.width and image.height of the rig say {} x {}; \
         use the rig file that belongs to this picture, or record at the rig's size",
        path.display(), expected.width, expected.height
    )]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// The picture's columns.
        width: u32,
        /// The picture's rows.
        height: u32,
        /// What the rig says.
        expected: ImageSize,
    },
    /// A raw frame whose size nobody told.
    #[error("{}: a raw frame does not tell its size; give it as --size WIDTHxHEIGHT", path.display())]
    RawWithoutSize {
        /// The file.
        path: PathBuf,
    },
    /// A raw frame whose bytes do not make a picture of the rig's size.
    #[error(
        "{}: {problem}; a raw frame has no header: image.width x image.height x 1.5 bytes as .yuv or .nv12, \
         1.25 as .srggb10p, 1.5 as .srggb12p, 2 as .srggb10, .srggb12 or .srggb16",
        path.display()
    )]
    RawSize {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        problem: SizeMismatch,
    },
}

/// The extensions that [`is_picture_name`] takes for pictures, besides those of raw Bayer frames.
const EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "pgm", "yuv", "i420", "nv12"];
/// How raw frames are named.
pub const RAW_NAMES: &str = ".yuv (YUV420 planar), .nv12, or as V4L2 and libcamera name raw Bayer: .srggb10p and .srggb12p \
                             (packed), .srggb10, .srggb12 and .srggb16 (16-bit words), also sbggr, sgrbg, sgbrg";

/// Does a file of this name hold a picture? For finding the frames of a directory.
#[must_use]
pub fn is_picture_name(path: &Path) -> bool {
    let extension = extension(path);
    EXTENSIONS.contains(&extension.as_str()) || RawFormat::from_extension(&extension).is_some()
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Reads a picture of exactly the size `expected`. PNG, JPEG and PGM are told by their content, raw frames by their
/// extension: `.yuv` or `.i420` is YUV420 planar, `.nv12` has interleaved chroma, [`RawFormat`] names raw Bayer frames.
/// A picture without colours is taken for that of a monochrome camera; of 16 bits a level the upper 8 are used.
///
/// # Errors
/// See [`CaptureError`].
pub fn read_frame(path: &Path, expected: ImageSize) -> Result<Frame, CaptureError> {
    read(path, Some(expected))
}

/// Reads a picture of any size. Raw frames do not tell theirs, so it must be given for them; other pictures must then
/// have it too.
///
/// # Errors
/// See [`CaptureError`].
pub fn read_picture(path: &Path, size: Option<ImageSize>) -> Result<Frame, CaptureError> {
    read(path, size)
}

fn read(path: &Path, expected: Option<ImageSize>) -> Result<Frame, CaptureError> {
    let bytes =
        std::fs::read(path).map_err(|source| CaptureError::Read { path: path.to_path_buf(), source })?;
    if bytes.is_empty() {
        return Err(CaptureError::Empty { path: path.to_path_buf() });
    }
    let raw = |make: &dyn Fn(ImageSize, Vec<u8>) -> Result<Frame, SizeMismatch>, bytes| {
        let size = expected.ok_or_else(|| CaptureError::RawWithoutSize { path: path.to_path_buf() })?;
        make(size, bytes).map_err(|problem| CaptureError::RawSize { path: path.to_path_buf(), problem })
    };
    let extension = extension(path);
    match (extension.as_str(), RawFormat::from_extension(&extension)) {
        ("yuv" | "i420", _) => raw(&|size, bytes| Frame::new(size, Pixels::Yuv420(bytes)), bytes),
        ("nv12", _) => raw(&|size, bytes| Frame::new(size, Pixels::Nv12(bytes)), bytes),
        (_, Some(format)) => raw(&|size, bytes| format.read(size, &bytes), bytes),
        _ => decode(&bytes, path, expected),
    }
}

fn decode(bytes: &[u8], path: &Path, expected: Option<ImageSize>) -> Result<Frame, CaptureError> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Pnm)) => format,
        _ => return Err(CaptureError::UnknownFormat { path: path.to_path_buf() }),
    };
    let damaged = |message: String| CaptureError::Damaged { path: path.to_path_buf(), message };
    if format == ImageFormat::Jpeg && !ends_as_jpeg(bytes) {
        return Err(damaged("the end of the JPEG is missing".to_owned()));
    }
    let decoder = image::ImageReader::with_format(std::io::Cursor::new(bytes), format)
        .into_decoder()
        .map_err(|error| damaged(error.to_string()))?;
    // Before anything is decoded: a wrong size must not cost the memory of a wrong picture.
    let (width, height) = decoder.dimensions();
    let actual = u16::try_from(width).ok().zip(u16::try_from(height).ok());
    let actual = actual.map(|(width, height)| ImageSize { width, height });
    let size = match (expected, actual) {
        (Some(expected), actual) if actual != Some(expected) => {
            return Err(CaptureError::WrongSize { path: path.to_path_buf(), width, height, expected });
        }
        (_, Some(size)) => size,
        (_, None) => return Err(damaged(format!("{width} x {height} is larger than any camera's picture"))),
    };
    let grey = !decoder.color_type().has_color();
    let picture = image::DynamicImage::from_decoder(decoder).map_err(|error| damaged(error.to_string()))?;
    let pixels = if grey {
        Pixels::Grey(picture.into_luma8().into_raw())
    } else {
        Pixels::Rgb(picture.into_rgb8().into_raw())
    };
    Frame::new(size, pixels).map_err(|problem| damaged(problem.to_string()))
}

/// Decoders fill the missing rows of a JPEG that was cut short with grey, without a word. The end marker cannot occur
/// within compressed data; some cameras pad with zeros after it.
fn ends_as_jpeg(bytes: &[u8]) -> bool {
    let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    bytes.get(..end).is_some_and(|content| content.ends_with(&[0xFF, 0xD9]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize { width: 64, height: 48 };

    #[test]
    fn padded_rows_make_the_same_picture_and_planes_that_are_too_short_make_none() {
        let size = ImageSize { width: 4, height: 4 };
        let packed: Vec<u8> = (1..=24).collect();
        let padded = |rows: &[u8], width: usize, stride: usize| -> Vec<u8> {
            rows.chunks(width)
                .flat_map(|row| row.iter().copied().chain(std::iter::repeat_n(0xEE, stride - width)))
                .collect()
        };
        let (luma, blue, red) =
            (padded(&packed[..16], 4, 10), padded(&packed[16..20], 2, 5), padded(&packed[20..], 2, 5));
        let mut frame = Frame::empty();
        assert!(frame.fill_yuv420_rows(size, 10, [&luma, &blue, &red]));
        assert_eq!(frame, Frame::new(size, Pixels::Yuv420(packed)).unwrap());
        for short in [[&luma[..33], &blue[..], &red[..]], [&luma, &blue, &red[..6]]] {
            assert!(!frame.fill_yuv420_rows(size, 10, short));
            assert_eq!(frame, Frame::empty());
        }
    }

    /// A directory of its own that goes when the test ends.
    struct Scratch(PathBuf);

    impl Scratch {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("nearfield-capture-{}-{name}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
            let path = self.0.join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let picture = image::RgbImage::from_fn(64, 48, |x, y| {
            image::Rgb([(x * 4) as u8, (y * 5) as u8, ((x * 7 + y * 3) % 251) as u8])
        });
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn png_gives_its_pixels_back_exactly() {
        let scratch = Scratch::new("png");
        let frame = read_frame(&scratch.file("a.png", &encoded(ImageFormat::Png)), SIZE).unwrap();
        let FrameView::Rgb(plane) = frame.view() else { panic!("a colour PNG is RGB") };
        assert_eq!(&plane.row(3)[5 * 3..6 * 3], [20, 15, 44]);
    }

    #[test]
    fn content_not_the_name_decides_between_png_and_jpeg() {
        let scratch = Scratch::new("content");
        assert!(read_frame(&scratch.file("a.png", &encoded(ImageFormat::Jpeg)), SIZE).is_ok());
    }

    #[test]
    fn every_truncation_of_a_picture_is_refused() {
        let scratch = Scratch::new("cut");
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            let bytes = encoded(format);
            // A PNG whose last chunk lost bytes still has all its pixels; a JPEG without its end marker may not.
            let least_loss = if format == ImageFormat::Png { 13 } else { 1 };
            for length in 0..=bytes.len() - least_loss {
                let result = read_frame(&scratch.file("cut", &bytes[..length]), SIZE);
                assert!(result.is_err(), "{format:?} cut to {length} of {} bytes", bytes.len());
            }
        }
    }

    #[test]
    fn refusals_name_the_file_and_the_remedy() {
        let scratch = Scratch::new("refusals");
        let refusal = |path: &Path| read_frame(path, SIZE).unwrap_err().to_string();
        let text = refusal(&scratch.file("notes.png", b"not a picture at all"));
        assert!(text.contains("notes.png") && text.contains("give PNG, JPEG, PGM"), "{text}");
        let empty = refusal(&scratch.file("empty.png", b""));
        assert!(empty.contains("empty.png") && empty.contains("empty"), "{empty}");
        let missing = refusal(&scratch.0.join("missing.png"));
        assert!(missing.contains("cannot read"), "{missing}");
        let path = scratch.file("small.png", &encoded(ImageFormat::Png));
        let other = ImageSize { width: 65, height: 48 };
        let wrong = read_frame(&path, other).unwrap_err().to_string();
        assert!(
            wrong.contains("64 x 48") && wrong.contains("65 x 48") && wrong.contains("image.width"),
            "{wrong}"
        );
    }

    #[test]
    fn raw_frames_must_have_exactly_the_rigs_size() {
        let scratch = Scratch::new("raw");
        let bytes = vec![128; 64 * 48 * 3 / 2];
        for name in ["a.yuv", "a.i420", "a.nv12"] {
            assert!(read_frame(&scratch.file(name, &bytes), SIZE).is_ok(), "{name}");
            for length in [1, bytes.len() - 1] {
                let text = read_frame(&scratch.file(name, &bytes[..length]), SIZE).unwrap_err().to_string();
                assert!(text.contains(name) && text.contains("4608 bytes"), "{text}");
            }
            let longer = [bytes.as_slice(), &[0]].concat();
            assert!(read_frame(&scratch.file(name, &longer), SIZE).is_err());
        }
        let odd = ImageSize { width: 63, height: 48 };
        let text = read_frame(&scratch.file("a.yuv", &bytes), odd).unwrap_err().to_string();
        assert!(text.contains("even"), "{text}");
    }
}
