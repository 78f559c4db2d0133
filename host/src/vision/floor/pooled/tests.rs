//! A stripe too faint for single columns, drawn into noise.

use crate::twin::gallery::CENTRE;
use crate::vision::tests::Drawing;

/// A picture with noise of four levels in red, and a stripe of this strength and width (standard deviation, rows) where
/// `lit` of the place along it.
fn drawing(strength: f32, rows: f32, lit: impl Fn(f32) -> bool) -> Drawing {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.add_noise(4.0);
    for column in drawing.geometry.watched() {
        let map = drawing.geometry.map(column).unwrap();
        let (row, place) = (map.floor_row, map.floor_place);
        if lit(place) {
            drawing.light_of_width(column, row, strength, rows);
        }
    }
    drawing
}

/// Share of the watched columns that have a reading.
fn seen(drawing: &Drawing) -> f32 {
    let analyser = drawing.judged();
    let readings = &analyser.extractor().readings()[drawing.geometry.watched()];
    readings.iter().filter(|reading| !reading.row.is_nan()).count() as f32 / readings.len() as f32
}

/// Twelve levels are seven standard deviations of a column's running mean above what chance gives; one and a half are
/// lost in it.
#[test]
fn a_faint_stripe_is_seen_together_and_what_chance_gives_is_not() {
    let faint = seen(&drawing(12.0, 1.6, |_| true));
    assert!(faint > 0.99, "{faint}");
    let lost = seen(&drawing(1.5, 1.6, |_| true));
    assert!(lost < 0.2, "{lost}");
}

#[test]
fn a_hole_in_a_faint_stripe_is_found_where_it_is() {
    let analyser = drawing(12.0, 1.6, |place| (place - 50.0).abs() > 4.0).judged();
    let [gap] = analyser.gaps() else { panic!("{:?}", analyser.gaps()) };
    let middle = f32::midpoint(gap.start.get(), gap.end.get());
    assert!((5.0..11.0).contains(&gap.length().get()) && (middle - 50.0).abs() < 2.0, "{gap:?}");
}

/// Light that is spread wider than the stripe can be is not the stripe.
#[test]
fn a_faint_glow_is_no_stripe() {
    let glow = seen(&drawing(12.0, 12.0, |_| true));
    assert!(glow < 0.2, "{glow}");
}

/// Share of the columns with a reading within 50 mm of the middle, of a bright stripe that is dim there: as dim as what a
/// thing throws on the floor, on a ground that is so many levels darker.
fn seen_of_a_dim_stretch(darker: i16) -> f32 {
    let mut drawing = Drawing::new(CENTRE.rig().unwrap());
    drawing.add_noise(2.0);
    for column in drawing.geometry.watched() {
        let map = drawing.geometry.map(column).unwrap();
        let (row, place) = (map.floor_row, map.floor_place);
        let is_dim = place.abs() < 60.0;
        if is_dim {
            drawing.brighten(column, -darker);
        }
        drawing.light_of_width(column, row, if is_dim { 8.0 } else { 150.0 }, 1.6);
    }
    let analyser = drawing.judged();
    let inside = |column: &usize| drawing.geometry.map(*column).unwrap().floor_place.abs() < 50.0;
    let readings =
        drawing.geometry.watched().filter(inside).map(|column| analyser.extractor().readings()[column]);
    let (mut lit, mut count) = (0.0, 0.0);
    for reading in readings {
        lit += f32::from(u8::from(!reading.row.is_nan()));
        count += 1.0;
    }
    lit / count
}

/// On the ground of the bright stripe it is a thing's glow; on another ground the stripe itself may be that dim.
#[test]
fn a_dim_stretch_is_a_glow_on_the_same_ground_and_a_stripe_on_another() {
    for darker in [0, 8] {
        let share = seen_of_a_dim_stretch(darker);
        assert!(share < 0.1, "{darker} levels darker: {share}");
    }
    let share = seen_of_a_dim_stretch(40);
    assert!(share > 0.9, "{share}");
}
