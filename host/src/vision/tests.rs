//! The extraction on pictures drawn for one rule each: a grey floor, bell-shaped stripes where the rig says.

#![allow(clippy::unwrap_used)]

use nearfield_shared::columns::ColumnMap;
use nearfield_shared::rig::Rig;

use super::grid::{PictureGeometry, picture_geometry};
use super::{Analyser, Extractor};
use crate::capture::{Frame, Pixels};
use crate::twin::gallery::{CENTRE, SIDE, WIDE};

/// A picture that is drawn on.
pub struct Drawing {
    rig: Rig,
    /// The rig's columns.
    pub geometry: Box<PictureGeometry>,
    rgb: Vec<u8>,
}

impl Drawing {
    /// A grey floor with some texture.
    pub fn new(rig: Rig) -> Self {
        let size = rig.image();
        let pixels = usize::from(size.width) * usize::from(size.height);
        let rgb = (0..pixels).flat_map(|pixel| [90 + (pixel * 7 % 5) as u8; 3]).collect();
        Self { rig, geometry: picture_geometry(&rig).unwrap(), rgb }
    }

    /// Noise of this standard deviation in red.
    pub fn add_noise(&mut self, deviation: f32) {
        let mut state = 7_u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0 - 0.5
        };
        for pixel in self.rgb.chunks_exact_mut(3) {
            // Three uniform values have a standard deviation of one half.
            let noise = 2.0 * deviation * (uniform() + uniform() + uniform());
            pixel[0] = (f32::from(pixel[0]) + noise).round() as u8;
        }
    }

    /// Red light of this strength around a row of one column, with the section of a stripe.
    fn light(&mut self, column: usize, row: f32, strength: f32) {
        self.light_of_width(column, row, strength, 1.6);
    }

    /// The same with this standard deviation, rows.
    pub fn light_of_width(&mut self, column: usize, row: f32, strength: f32, deviation: f32) {
        let (width, height) = (usize::from(self.rig.image().width), usize::from(self.rig.image().height));
        let reach = (4.0 * deviation) as usize + 2;
        for at in (row as usize).saturating_sub(reach)..(row as usize + reach).min(height) {
            let bell = (-0.5 * ((at as f32 - row) / deviation).powi(2)).exp();
            let red = &mut self.rgb[3 * (at * width + column)];
            *red = (f32::from(*red) + strength * bell).round().min(255.0) as u8;
        }
    }

    /// Makes the ground of a whole column brighter by so many levels (darker, if negative), in all colours.
    pub fn brighten(&mut self, column: usize, levels: i16) {
        let width = usize::from(self.rig.image().width);
        for row in 0..usize::from(self.rig.image().height) {
            for byte in &mut self.rgb[3 * (row * width + column)..][..3] {
                *byte = (i16::from(*byte) + levels).clamp(0, 255) as u8;
            }
        }
    }

    /// Draws in every column what `rows` says of it: rows, each with its strength.
    fn stripe(&mut self, rows: impl Fn(&PictureGeometry, &ColumnMap) -> Vec<(f32, f32)>) {
        for column in self.geometry.watched() {
            for (row, strength) in rows(&self.geometry, self.geometry.map(column).unwrap()) {
                self.light(column, row, strength);
            }
        }
    }

    fn frame(&self) -> Frame {
        Frame::new(self.rig.image(), Pixels::Rgb(self.rgb.clone())).unwrap()
    }

    /// What the analyser makes of it.
    pub fn judged(&self) -> Analyser {
        let mut analyser = Analyser::new(&self.rig).unwrap();
        analyser.judge(&self.frame().view()).unwrap();
        analyser
    }
}

/// The rays from -30 to 30 mm do not reach the floor.
fn is_on_floor(map: &ColumnMap) -> bool {
    map.floor_place.abs() > 30.0
}

/// The row of the light on a thing 20 mm high, where its rays are those that do not reach the floor.
fn on_thing(geometry: &PictureGeometry, map: &ColumnMap) -> Option<f32> {
    let row = map.row(20.0);
    (geometry.ray_place(map, row).abs() <= 30.0).then_some(row)
}

/// A red paint below the stripe, its edge so many rows from it, and a stripe that is so many millimetres high where rays do
/// not reach the floor.
fn beside_a_paint(rows: f32, height: f32) -> Drawing {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    let (columns, end) = (usize::from(drawing.rig.image().width), usize::from(drawing.rig.image().height));
    drawing.stripe(|_, map| {
        let row = if is_on_floor(map) { map.floor_row } else { map.row(height) };
        vec![(row, 100.0)]
    });
    for column in drawing.geometry.watched() {
        let edge = drawing.geometry.map(column).unwrap().floor_row + rows;
        for row in edge.round() as usize..end {
            let red = &mut drawing.rgb[3 * (row * columns + column)];
            *red = red.saturating_add(60);
        }
    }
    drawing
}

/// The edge of a paint excuses much, but not that the stripe lies off the floor by more than the tolerance.
#[test]
fn beside_a_paint_the_floors_stripe_is_whole_and_one_on_a_plate_is_cut() {
    for rows in [7.0, 9.0, 12.0] {
        assert!(
            !beside_a_paint(rows, 0.0).judged().report().is_cut(),
            "edge {rows} rows from the floor's stripe"
        );
        assert!(
            beside_a_paint(rows, 2.4).judged().report().is_cut(),
            "edge {rows} rows from the floor's stripe"
        );
    }
}

#[test]
fn an_object_has_the_height_of_the_line_on_it() {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.stripe(|geometry, map| {
        let floor = is_on_floor(map).then_some((map.floor_row, 100.0));
        floor.into_iter().chain(on_thing(geometry, map).map(|row| (row, 100.0))).collect()
    });
    let analyser = drawing.judged();
    let mut copy = analyser.clone();
    copy.judge(&drawing.frame().view()).unwrap();
    assert_eq!(copy.objects(), analyser.objects(), "a copy has room for points too");
    let [object] = analyser.objects() else { panic!("{:?}", analyser.objects()) };
    let (height, deviation) = (object.height.unwrap().get(), object.uncertainty.unwrap().get());
    assert!((height - 20.0).abs() < 0.3, "{height} mm");
    assert!(deviation > 0.0 && deviation < 0.5, "{deviation} mm");
}

/// A cable in the sun is a red line too, but it does not end where the dark rays do.
#[test]
fn what_goes_on_beside_the_dark_rays_is_no_light_of_the_laser() {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.stripe(|_, map| {
        let floor = is_on_floor(map).then_some((map.floor_row, 100.0));
        floor.into_iter().chain([(map.row(20.0), 100.0)]).collect()
    });
    let analyser = drawing.judged();
    assert!(analyser.report().is_cut());
    let heights: Vec<_> = analyser.objects().iter().map(|object| object.height).collect();
    assert_eq!(heights, [None]);
}

/// A glossy side throws light on the floor before it, exactly where the stripe would be.
#[test]
fn what_looks_lit_within_a_line_off_the_floor_does_not_split_the_gap() {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.stripe(|geometry, map| {
        let thrown = map.floor_place.abs() < 8.0;
        let floor = (is_on_floor(map) || thrown).then_some((map.floor_row, 60.0));
        floor.into_iter().chain(on_thing(geometry, map).map(|row| (row, 100.0))).collect()
    });
    let analyser = drawing.judged();
    let [gap] = analyser.gaps() else { panic!("{:?}", analyser.gaps()) };
    assert!(gap.length().get() > 55.0, "{gap:?}");
}

/// The same light on the floor with nothing above it is the floor's stripe.
#[test]
fn floor_between_two_things_is_floor() {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.stripe(|geometry, map| {
        let between = map.floor_place.abs() < 12.0;
        let floor = (is_on_floor(map) || between).then_some((map.floor_row, 60.0));
        let thing = on_thing(geometry, map).filter(|row| geometry.ray_place(map, *row).abs() >= 12.0);
        floor.into_iter().chain(thing.map(|row| (row, 100.0))).collect()
    });
    let analyser = drawing.judged();
    assert_eq!(analyser.gaps().len(), 2, "{:?}", analyser.gaps());
    assert_eq!(analyser.objects().len(), 2, "{:?}", analyser.objects());
}

#[test]
fn a_thing_of_which_only_a_rim_is_seen_has_no_known_height() {
    // Seven tenths of its 60 mm must be seen.
    for (seen_mm, known) in [(10.0, false), (36.0, false), (48.0, true)] {
        let mut drawing = Drawing::new(CENTRE.rig().unwrap());
        drawing.stripe(|geometry, map| {
            let floor = is_on_floor(map).then_some((map.floor_row, 100.0));
            let rim = on_thing(geometry, map).filter(|row| geometry.ray_place(map, *row) <= -30.0 + seen_mm);
            floor.into_iter().chain(rim.map(|row| (row, 100.0))).collect()
        });
        let analyser = drawing.judged();
        let is_known = analyser.objects().iter().any(|object| object.height.is_some());
        assert_eq!(is_known, known, "{seen_mm} mm seen: {:?}", analyser.objects());
    }
}

/// Something that crosses the floor's rows makes no two gaps of one.
#[test]
fn a_scrap_of_floor_between_two_dark_stretches_is_none() {
    for (scrap_mm, gaps) in [(1.2, 1), (8.0, 2)] {
        let mut drawing = Drawing::new(WIDE.rig().unwrap());
        drawing.stripe(|_, map| {
            let lit = is_on_floor(map) || map.floor_place.abs() <= scrap_mm;
            lit.then_some((map.floor_row, 100.0)).into_iter().collect()
        });
        let mut analyser = Analyser::new(&drawing.rig).unwrap();
        for frame in [drawing.frame(), drawing.frame().to_yuv420()] {
            analyser.judge(&frame.view()).unwrap();
            assert_eq!(analyser.gaps().len(), gaps, "{scrap_mm} mm to both sides: {:?}", analyser.gaps());
        }
    }
}

/// Light above and below the floor's rows in one gap tells nothing about the height.
#[test]
fn a_thing_that_is_seen_above_the_floor_and_below_it_has_no_known_height() {
    for (drop_mm, known) in [(0.0, true), (12.0, false)] {
        let mut drawing = Drawing::new(CENTRE.rig().unwrap());
        drawing.stripe(|_, map| {
            // From 12 mm above the floor to `drop_mm` below it, along the dark rays.
            let height = if map.floor_place < 0.0 { 12.0 } else { -drop_mm };
            let floor = is_on_floor(map) || height == 0.0;
            vec![(if floor { map.floor_row } else { map.row(height) }, 100.0)]
        });
        let analyser = drawing.judged();
        let is_known = analyser.objects().iter().any(|object| object.height.is_some());
        assert_eq!(is_known, known, "{drop_mm} mm below: {:?}", analyser.objects());
    }
}

/// A black thing that is narrow gets a twentieth of the light beside it from the lens; a floor that is darker has more.
#[test]
fn what_the_lens_spreads_of_bright_columns_over_a_narrow_gap_is_no_floor() {
    for (share, is_cut) in [(0.06, true), (0.3, false)] {
        let mut drawing = Drawing::new(CENTRE.rig().unwrap());
        drawing.stripe(|_, map| {
            let strength = if map.floor_place.abs() > 4.0 { 160.0 } else { share * 160.0 };
            vec![(map.floor_row, strength)]
        });
        let analyser = drawing.judged();
        assert_eq!(analyser.report().is_cut(), is_cut, "{share} of the light: {:?}", analyser.gaps());
    }
}

/// Of a chroma sample at the stripe's end only one column of pixels may watch it.
#[test]
fn a_whole_stripe_has_a_reading_in_every_watched_column_in_every_layout() {
    for mounting in [CENTRE, SIDE, WIDE] {
        let mut drawing = Drawing::new(mounting.rig().unwrap());
        drawing.stripe(|_, map| vec![(map.floor_row, 120.0)]);
        let mut extractor = Extractor::new(&drawing.rig).unwrap();
        for frame in [drawing.frame(), drawing.frame().to_yuv420(), drawing.frame().to_nv12()] {
            extractor.extract(&frame.view()).unwrap();
            let watched = drawing.geometry.watched();
            let missing: Vec<usize> =
                watched.filter(|column| extractor.readings()[*column].row.is_nan()).collect();
            assert!(missing.is_empty(), "{missing:?} of {:?}", drawing.geometry.watched());
        }
    }
}

/// A red line lies beside the stripe, so many rows farther than usual, and the rays of `dark` reach no floor.
fn beside_a_red_line(drive: f32, rows: f32, dark: std::ops::Range<f32>) -> Drawing {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.stripe(|_, map| {
        let lit = !dark.contains(&map.floor_place);
        let line = map.floor_place.abs() < 20.0;
        let stripe = lit.then_some((map.floor_row, 100.0 * drive));
        stripe.into_iter().chain(line.then_some((map.floor_row + 5.0 + rows, 160.0))).collect()
    });
    drawing
}

/// The controller's code makes the ground known that hides the stripe, and what happens then is seen all the same.
#[test]
fn with_the_lasers_code_a_red_line_beside_the_stripe_hides_it_no_longer() {
    const NOWHERE: std::ops::Range<f32> = 0.0..0.0;
    let code = [1.0, 1.0, 0.6, 0.6, 1.0, 1.0, 0.6, 0.6, 1.0, 1.0];
    let show = |analyser: &mut Analyser, drive: f32, rows: f32, dark: std::ops::Range<f32>| {
        analyser.update(&beside_a_red_line(drive, rows, dark).frame().view()).unwrap();
        analyser.report().is_cut()
    };
    let rig = CENTRE.rig().unwrap();
    let mut plain = Analyser::new(&rig).unwrap();
    assert!(code.map(|drive| show(&mut plain, drive, 0.0, NOWHERE))[9], "one picture does not tell");
    let mut analyser = Analyser::new(&rig).unwrap().with_background_subtraction();
    let steady = [1.0; 10].map(|drive| show(&mut analyser, drive, 0.0, NOWHERE));
    assert!(steady[9], "a laser that does not change tells nothing");
    assert!(!code.map(|drive| show(&mut analyser, drive, 0.0, NOWHERE))[9]);
    // A thing lies down in the stripe; by then the ground is known.
    let mut clone = analyser.clone();
    assert!([1.0, 0.6, 0.6].map(|drive| show(&mut clone, drive, 0.0, -6.0..6.0))[2]);
    // The same, and the robot moves: what is left of the line, where it was, is no stripe.
    for rows in [-1.0, 1.0, 2.0] {
        let mut clone = analyser.clone();
        assert!([1.0, 0.6, 0.6].map(|drive| show(&mut clone, drive, rows, -6.0..6.0))[2], "{rows} rows");
    }
    analyser.reset();
    assert!([1.0, 1.0, 1.0].map(|drive| show(&mut analyser, drive, 0.0, NOWHERE))[2], "forgotten");
}
