//! Pictures in every layout that cameras give: the verdict does not depend on it.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::path::Path;
use std::sync::Arc;

use nearfield_host::capture::{Frame, Pixels, RawFormat, read_frame};
use nearfield_host::twin::gallery::{self, CENTRE};
use nearfield_host::twin::scene::{Light, Look};
use nearfield_host::twin::{Scene, Twin, View};
use nearfield_host::vision::Analyser;
use nearfield_shared::rig::Rig;

/// Scenes with and without something on the stripe.
const SCENES: [&str; 9] =
    ["clean", "tiles", "near_miss", "cable_6", "rod_12", "box_45", "box_75_glossy", "hand", "drop"];
/// Heights from one layout and from another differ by less than this, millimetres.
const SAME_HEIGHT_MM: f32 = 1.5;

/// What was made of a picture: cut or not, and the greatest height.
#[derive(Debug, Clone, Copy)]
struct Finding {
    is_cut: bool,
    height: Option<f32>,
}

impl Finding {
    fn of(analyser: &mut Analyser, frame: &Frame) -> Self {
        analyser.judge(&frame.view()).unwrap();
        let heights = analyser.objects().iter().filter_map(|object| object.height);
        let height = heights.map(|height| height.get()).max_by(f32::total_cmp);
        Self { is_cut: analyser.report().is_cut(), height }
    }

    fn assert_like(&self, other: &Self, what: &str) {
        assert_eq!(self.is_cut, other.is_cut, "{what}: {self:?}, from RGB {other:?}");
        if let (Some(one), Some(other)) = (self.height, other.height) {
            assert!((one - other).abs() <= SAME_HEIGHT_MM, "{what}: {one} mm, from RGB {other} mm");
        }
        assert_eq!(self.height.is_some(), other.height.is_some(), "{what}: a height or none");
    }
}

fn of_rgb(view: &Arc<View>, analyser: &mut Analyser, scene: &Scene) -> (Finding, Vec<u8>) {
    let rgb = Twin::new(Arc::clone(view), scene, 4).unwrap().render(0, 1.0).rgb;
    let frame = Frame::new(view.rig().image(), Pixels::Rgb(rgb.clone())).unwrap();
    (Finding::of(analyser, &frame), rgb)
}

fn read(directory: &Path, name: &str, bytes: &[u8], rig: &Rig) -> Frame {
    let path = directory.join(name);
    std::fs::write(&path, bytes).unwrap();
    read_frame(&path, rig.image()).unwrap()
}

#[test]
fn raw_bayer_frames_give_the_verdicts_of_finished_pictures() {
    let rig = CENTRE.with_width(2304).rig().unwrap();
    let (view, mut analyser) = (Arc::new(View::new(&rig)), Analyser::new(&rig).unwrap());
    let directory = tempfile::tempdir().unwrap();
    for name in SCENES {
        let scene = gallery::scene(name).unwrap();
        let (expected, _) = of_rgb(&view, &mut analyser, &scene);
        let raw = Scene { look: Look { demosaiced: false, ..scene.look.clone() }, ..scene };
        let mosaic = Twin::new(Arc::clone(&view), &raw, 4).unwrap().render_mosaic(0, 1.0);
        for format in ["srggb10p", "srggb12p", "srggb10", "srggb16"] {
            let bytes = RawFormat::from_extension(format).unwrap().write(2304, &mosaic);
            let frame = read(directory.path(), &format!("frame.{format}"), &bytes, &rig);
            let finding = Finding::of(&mut analyser, &frame);
            println!("{name}, {format}: {finding:?}, from RGB {expected:?}");
            finding.assert_like(&expected, &format!("{name}, {format}"));
        }
    }
}

/// A monochrome camera behind the laser's band-pass sees little of the hall's light.
#[test]
fn monochrome_frames_give_the_verdicts_of_finished_pictures() {
    let rig = CENTRE.with_width(2304).rig().unwrap();
    let (view, mut analyser) = (Arc::new(View::new(&rig)), Analyser::new(&rig).unwrap());
    let directory = tempfile::tempdir().unwrap();
    for name in SCENES {
        let scene = gallery::scene(name).unwrap();
        let look = Look { exposure: Some(0.5), ..scene.look.clone() };
        let scene = Scene { light: Light { lux: 25.0, ..scene.light.clone() }, look, ..scene };
        let (expected, rgb) = of_rgb(&view, &mut analyser, &scene);
        let red: Vec<u8> = rgb.chunks_exact(3).map(|pixel| pixel[0]).collect();
        let eight = [b"P5\n2304 1296\n255\n".as_slice(), &red].concat();
        let words: Vec<u8> = red.iter().flat_map(|level| (u16::from(*level) * 4 + 1).to_be_bytes()).collect();
        let sixteen = [b"P5\n# ten bits\n2304 1296\n1023\n".as_slice(), &words].concat();
        for (depth, bytes) in [("8", eight), ("16", sixteen)] {
            let frame = read(directory.path(), "frame.pgm", &bytes, &rig);
            assert!(matches!(frame.pixels(), Pixels::Grey(_)), "a picture without colours");
            let finding = Finding::of(&mut analyser, &frame);
            println!("{name}, PGM of {depth} bits: {finding:?}, from RGB {expected:?}");
            finding.assert_like(&expected, &format!("{name}, PGM of {depth} bits"));
        }
    }
}

/// The source paper's other light: a red LED behind a slit, a band wide and dim. It cuts and lifts like a line.
#[test]
fn a_led_band_is_whole_on_clean_floors_and_cut_and_lifted_by_what_lies_on_them() {
    const BAND_MM: f64 = 10.0;
    /// Full width at half of a normal curve's height, by its width at 1/e^2.
    const HALF_HEIGHT: f64 = 0.589;
    let rig = CENTRE.rig().unwrap();
    let view = Arc::new(View::new(&rig));
    let mut analyser = Analyser::with_sheet(&rig, HALF_HEIGHT * BAND_MM).unwrap();
    for (name, height) in [
        ("clean", None),
        ("tiles", None),
        ("rod_12", None),
        ("box_45", Some(45.0)),
        // Of the band on a glossy side too little is left to be measured: an unknown height, which counts as large.
        ("box_75_glossy", None),
        ("drop", None),
    ] {
        let scene = gallery::scene(name).unwrap();
        // An LED of 50 mW in a dim hall: about the contrast that the paper's pictures show.
        let look = Look { led_band_mm: Some(BAND_MM), laser_power: 3.0, ..scene.look.clone() };
        let scene = Scene { light: Light { lux: 150.0, ..scene.light.clone() }, look, ..scene };
        let twin = Twin::new(Arc::clone(&view), &scene, 4).unwrap();
        let frame = Frame::new(rig.image(), Pixels::Rgb(twin.render(0, 1.0).rgb)).unwrap();
        for (frame, is_fine) in [(frame.to_yuv420(), false), (frame, true)] {
            let finding = Finding::of(&mut analyser, &frame);
            println!("{name}: {finding:?}");
            assert_eq!(finding.is_cut, !matches!(name, "clean" | "tiles"), "{name}");
            // In YUV's coarse colours less than seven tenths of the dim band may be seen on a box: an unknown height, too.
            match (finding.height, height) {
                (Some(found), Some(height)) => {
                    assert!((found - height).abs() < 3.0, "{name}: {found} mm instead of {height}");
                }
                (None, Some(_)) => assert!(!is_fine, "{name}: no height in full colours"),
                _ => {}
            }
        }
    }
}
