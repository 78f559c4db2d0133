//! Between RGB and YUV420 (JPEG's full-range BT.601), for recordings, overlays and tests; not on the per-frame path.

use super::frame::{Frame, FrameView, Pixels};

impl Frame {
    /// The frame as interleaved RGB bytes, `width * height * 3`.
    #[must_use]
    pub fn to_rgb(&self) -> Vec<u8> {
        match self.view() {
            FrameView::Rgb(plane) => plane.bytes().to_vec(),
            FrameView::Grey(plane) => plane.bytes().iter().flat_map(|grey| [*grey; 3]).collect(),
            FrameView::Yuv420 { luma, blue, red } => self.rgb_from(|column, row| {
                let (u, v) = (blue.row(row / 2)[column / 2], red.row(row / 2)[column / 2]);
                [luma.row(row)[column], u, v]
            }),
            FrameView::Nv12 { luma, chroma } => self.rgb_from(|column, row| {
                let pair = column / 2 * 2;
                let chroma = chroma.row(row / 2);
                [luma.row(row)[column], chroma[pair], chroma[pair + 1]]
            }),
        }
    }

    fn rgb_from(&self, yuv_at: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
        let (width, height) = (usize::from(self.size().width), usize::from(self.size().height));
        let mut rgb = Vec::with_capacity(width * height * 3);
        for row in 0..height {
            for column in 0..width {
                rgb.extend_from_slice(&rgb_of(yuv_at(column, row)));
            }
        }
        rgb
    }

    /// The frame as YUV420 planar, chroma averaged over 2 x 2 pixels as a camera's image processor does. An odd last
    /// row or column is left out.
    #[must_use]
    pub fn to_yuv420(&self) -> Self {
        let rgb = self.to_rgb();
        let stride = usize::from(self.size().width) * 3;
        let (width, height) = (self.size().width & !1, self.size().height & !1);
        let size = nearfield_shared::rig::ImageSize { width, height };
        let (width, height) = (usize::from(width), usize::from(height));
        let (mut luma, mut blue, mut red) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..height {
            for column in 0..width {
                let at = row * stride + column * 3;
                let [r, g, b] = [rgb[at], rgb[at + 1], rgb[at + 2]].map(f32::from);
                luma.push(quantised(0.299 * r + 0.587 * g + 0.114 * b));
            }
        }
        for row in (0..height).step_by(2) {
            for column in (0..width).step_by(2) {
                let mut sum = [0.0; 3];
                for (y, x) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let at = (row + y) * stride + (column + x) * 3;
                    for (channel, sum) in sum.iter_mut().enumerate() {
                        *sum += f32::from(rgb[at + channel]) / 4.0;
                    }
                }
                let [r, g, b] = sum;
                blue.push(quantised(128.0 - 0.168_736 * r - 0.331_264 * g + 0.5 * b));
                red.push(quantised(128.0 + 0.5 * r - 0.418_688 * g - 0.081_312 * b));
            }
        }
        luma.extend(blue);
        luma.extend(red);
        Self::whole(size, Pixels::Yuv420(luma))
    }

    /// A YUV420 frame with its chroma interleaved; other frames are converted first.
    #[must_use]
    pub fn to_nv12(&self) -> Self {
        let planar = if matches!(self.pixels(), Pixels::Yuv420(_)) { self.clone() } else { self.to_yuv420() };
        let Pixels::Yuv420(bytes) = planar.pixels() else { return planar };
        let area = bytes.len() / 3 * 2;
        let (luma, chroma) = bytes.split_at(area);
        let (blue, red) = chroma.split_at(area / 4);
        let pairs = blue.iter().zip(red).flat_map(|(blue, red)| [*blue, *red]);
        let bytes = luma.iter().copied().chain(pairs).collect();
        Self::whole(planar.size(), Pixels::Nv12(bytes))
    }
}

fn rgb_of([y, u, v]: [u8; 3]) -> [u8; 3] {
    let (y, u, v) = (f32::from(y), f32::from(u) - 128.0, f32::from(v) - 128.0);
    [y + 1.402 * v, y - 0.344_136 * u - 0.714_136 * v, y + 1.772 * u].map(quantised)
}

/// Rounded; `as` saturates at 0 and 255.
fn quantised(value: f32) -> u8 {
    value.round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::rig::ImageSize;

    fn striped() -> Frame {
        let size = ImageSize { width: 8, height: 6 };
        let rgb = (0..6 * 8).flat_map(|i| if i / 16 == 1 { [250, 20, 90] } else { [90, 100, 80] }).collect();
        Frame::new(size, Pixels::Rgb(rgb)).unwrap()
    }

    #[test]
    fn there_and_back_changes_no_channel_by_more_than_rounding() {
        let rgb = striped().to_rgb();
        for frame in [striped().to_yuv420(), striped().to_nv12()] {
            for (before, after) in rgb.iter().zip(frame.to_rgb()) {
                assert!(before.abs_diff(after) <= 2, "{before} became {after}");
            }
        }
    }

    #[test]
    fn a_copy_is_the_same_picture_and_uses_memory_again() {
        let mut copy = Frame::empty();
        let rgb = striped();
        let (planar, interleaved) = (rgb.to_yuv420(), rgb.to_nv12());
        let grey =
            Frame::new(rgb.size(), Pixels::Grey(rgb.to_rgb().chunks(3).map(|p| p[1]).collect())).unwrap();
        for frame in [&rgb, &planar, &interleaved, &grey, &rgb] {
            copy.copy_from(frame);
            assert_eq!(copy, *frame);
            let (Pixels::Rgb(bytes) | Pixels::Grey(bytes) | Pixels::Yuv420(bytes) | Pixels::Nv12(bytes)) =
                copy.pixels();
            assert!(bytes.capacity() >= rgb.to_rgb().len(), "the first copy's memory");
        }
    }

    #[test]
    fn planar_and_interleaved_hold_the_same_picture() {
        assert_eq!(striped().to_yuv420().to_rgb(), striped().to_nv12().to_rgb());
        assert_eq!(striped().to_yuv420().to_nv12(), striped().to_nv12());
    }
}
