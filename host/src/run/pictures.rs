//! Pictures for people: some a second, made small and packed as JPEG by a thread of its own, for recorder and page.

use std::io::Cursor;
use std::sync::Arc;
use std::time::Duration;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, RgbImage};
use nearfield_machine::real_time::step_back;
use nearfield_recording::{Event, Picture, Taps};
use nearfield_shared::units::Micros;

use super::mailbox::{Fetched, Mailbox, Reader, Writer};
use super::semantics::SemanticPicture;
use crate::capture::Frame;

/// From one picture for people to the next.
const INTERVAL: Micros = Micros::from_millis(200);
/// Columns of the small picture at most.
const WIDEST: u32 = 960;
const JPEG_QUALITY: u8 = 75;

/// The stripe path's end: offers a picture now and then, and never waits.
pub struct PictureTap {
    pictures: Writer<SemanticPicture>,
    next: Micros,
}

impl PictureTap {
    /// Starts the thread.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn start(taps: Taps) -> std::io::Result<Self> {
        let (pictures, incoming) = Mailbox::pair::<SemanticPicture>();
        std::thread::Builder::new().name("pictures".to_owned()).spawn(move || {
            step_back();
            pack(incoming, &taps);
        })?;
        Ok(Self { pictures, next: Micros::ZERO })
    }

    /// Shows a picture; most are not taken.
    pub fn show(&mut self, frame: &Frame, exposed: Micros) {
        if exposed < self.next {
            return;
        }
        self.next = exposed.plus(INTERVAL);
        self.pictures.offer(|picture| {
            picture.frame.copy_from(frame);
            picture.exposed = exposed;
        });
    }
}

fn pack(mut incoming: Reader<SemanticPicture>, taps: &Taps) {
    loop {
        match incoming.wait(Duration::from_secs(1)) {
            Fetched::New(picture) => {
                if let Some(jpeg) = jpeg(&picture.frame) {
                    let size = picture.frame.size();
                    let full_size = (size.width, size.height);
                    let picture = Picture { exposed: picture.exposed, jpeg, full_size };
                    taps.tell(picture.exposed, Event::Picture(Arc::new(picture)));
                }
            }
            Fetched::Nothing => {}
            Fetched::Closed => return,
        }
    }
}

/// `None` = the picture is empty.
fn jpeg(frame: &Frame) -> Option<Vec<u8>> {
    let size = frame.size();
    let (width, height) = (u32::from(size.width), u32::from(size.height));
    let full = RgbImage::from_raw(width, height, frame.to_rgb()).filter(|_| width > 0 && height > 0)?;
    let small = if width > WIDEST {
        image::imageops::thumbnail(&full, WIDEST, (height * WIDEST / width).max(1))
    } else {
        full
    };
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode(&small, small.width(), small.height(), ExtendedColorType::Rgb8)
        .ok()?;
    Some(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Pixels;
    use nearfield_recording::queue::Next;
    use nearfield_recording::{Stamped, queue};
    use nearfield_shared::rig::ImageSize;

    #[test]
    fn some_pictures_a_second_are_packed_small_with_their_full_size() {
        let (tap, drain) = queue(8);
        let mut taps = Taps::default();
        taps.add(tap);
        let mut pictures = PictureTap::start(taps).unwrap();
        let size = ImageSize { width: 1920, height: 1080 };
        let frame = Frame::new(size, Pixels::Rgb(vec![90; 1920 * 1080 * 3])).unwrap();
        // The second one comes too early to be taken.
        pictures.show(&frame, Micros::from_millis(1000));
        pictures.show(&frame, Micros::from_millis(1199));
        drop(pictures);
        let mut packed = Vec::new();
        loop {
            match drain.next() {
                Next::Event(Stamped { event: Event::Picture(picture), .. }) => packed.push(picture),
                Next::Event(other) => panic!("{other:?}"),
                Next::Empty => std::thread::sleep(Duration::from_millis(5)),
                Next::Ended => break,
            }
        }
        assert_eq!(packed.len(), 1);
        assert_eq!((packed[0].exposed, packed[0].full_size), (Micros::from_millis(1000), (1920, 1080)));
        let decoded = image::load_from_memory(&packed[0].jpeg).unwrap();
        assert_eq!((decoded.width(), decoded.height()), (960, 540));
    }

    #[test]
    fn an_empty_picture_is_none() {
        assert_eq!(jpeg(&Frame::empty()), None);
    }
}
