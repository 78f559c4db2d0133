//! Pictures for calibration: of any size, as colour and as brightness.
//!
//! [`crate::capture`] refuses pictures of another size than the rig's. Here there is no rig yet: the first picture
//! says how large they all are.

use std::path::{Path, PathBuf};

use image::{DynamicImage, GrayImage, ImageReader, RgbImage};
use nearfield_shared::rig::ImageSize;

use super::CalibrationError;

/// A picture taken for calibration.
#[derive(Debug, Clone)]
pub struct CalibrationPicture {
    /// Its file, for messages.
    pub path: PathBuf,
    /// Colours; a monochrome picture has three equal ones.
    pub colours: RgbImage,
    /// Brightness.
    pub brightness: GrayImage,
    /// Has the camera taken no colours?
    pub is_monochrome: bool,
}

impl CalibrationPicture {
    /// Reads PNG or JPEG.
    ///
    /// # Errors
    /// [`CalibrationError::Picture`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let refused = |problem: String| CalibrationError::Picture { path: path.to_path_buf(), problem };
        let picture = ImageReader::open(path)
            .map_err(|error| refused(format!("cannot read it: {error}")))?
            .with_guessed_format()
            .map_err(|error| refused(format!("cannot read it: {error}")))?
            .decode()
            .map_err(|error| refused(format!("not a PNG or JPEG that can be read: {error}")))?;
        Ok(Self::new(path, &picture))
    }

    /// From pixels; `path` is for messages only.
    #[must_use]
    pub fn new(path: &Path, picture: &DynamicImage) -> Self {
        Self {
            path: path.to_path_buf(),
            colours: picture.to_rgb8(),
            brightness: picture.to_luma8(),
            is_monochrome: !picture.color().has_color(),
        }
    }

    /// Its size.
    ///
    /// # Errors
    /// [`CalibrationError::Picture`] for a picture that is larger than any rig may name.
    pub fn size(&self) -> Result<ImageSize, CalibrationError> {
        let (width, height) = self.colours.dimensions();
        match (u16::try_from(width), u16::try_from(height)) {
            (Ok(width), Ok(height)) => Ok(ImageSize { width, height }),
            _ => Err(CalibrationError::Picture {
                path: self.path.clone(),
                problem: format!("{width} x {height} is larger than any camera of a rig"),
            }),
        }
    }
}

/// All pictures of a calibration come from one camera: checks that their sizes agree and returns it.
///
/// # Errors
/// [`CalibrationError::Picture`] names the first picture that differs.
pub fn common_size<'a>(
    pictures: impl IntoIterator<Item = &'a CalibrationPicture>,
) -> Result<Option<ImageSize>, CalibrationError> {
    let mut common: Option<(ImageSize, &Path)> = None;
    for picture in pictures {
        let size = picture.size()?;
        match common {
            Some((first, path)) if first != size => {
                return Err(CalibrationError::Picture {
                    path: picture.path.clone(),
                    problem: format!(
                        "it is {} x {}, but {} is {} x {}; take all pictures with the same camera settings",
                        size.width,
                        size.height,
                        path.display(),
                        first.width,
                        first.height
                    ),
                });
            }
            Some(_) => {}
            None => common = Some((size, &picture.path)),
        }
    }
    Ok(common.map(|(size, _)| size))
}
