//! The capability map against the twin: objects a little larger than the limit that it states are detected, and flat
//! ones clearly smaller are not (the limit is not a mere guess on the safe side).
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use nearfield_host::capability::measure;
use nearfield_host::twin::gallery::{CENTRE, SIDE, plain};
use nearfield_host::twin::scene::{Scene, SceneObject, Shape};
use nearfield_host::twin::{Twin, View};
use nearfield_host::vision::Analyser;
use nearfield_shared::rig::Rig;

const SEED: u64 = 77;

/// A plate of this width and height on the stripe at `along`, where the sheet of light falls on its top.
fn plate(rig: &Rig, along: f64, width_mm: f64, height_mm: f64) -> SceneObject {
    let drop = rig.laser().origin.z / rig.stripe().point.y;
    let shape = Shape::Box { width_mm, depth_mm: 60.0, height_mm };
    SceneObject { along_mm: along, ..plain("plate", shape, -height_mm / drop, "grey_card") }
}

fn is_cut(rig: &Rig, view: &Arc<View>, objects: Vec<SceneObject>) -> bool {
    let scene = Scene { objects, ..Scene::default() };
    let twin = Twin::new(Arc::clone(view), &scene, SEED).unwrap();
    let frame = twin.render(0, 1.0).to_rgb_frame().unwrap();
    let mut analyser = Analyser::new(rig).unwrap();
    analyser.judge(&frame.view()).unwrap();
    analyser.report().is_cut()
}

/// The rule: at the stated limits, from a picture of the clean floor, wider and higher plates trip, and clearly
/// narrower and lower ones do not.
#[test]
fn objects_at_the_stated_limits_are_detected_and_clearly_smaller_ones_are_not() {
    println!("seed {SEED}");
    for (name, mounting, places) in
        [("centre", CENTRE, [-250.0, 40.0, 260.0]), ("side", SIDE, [-300.0, 0.0, 250.0])]
    {
        let rig = mounting.rig().unwrap();
        let view = Arc::new(View::new(&rig));
        let twin = Twin::new(Arc::clone(&view), &Scene::default(), SEED).unwrap();
        let clean = twin.render(0, 1.0).to_rgb_frame().unwrap();
        let mut analyser = Analyser::new(&rig).unwrap();
        analyser.judge(&clean.view()).unwrap();
        let capability = measure(&rig, Some(analyser.extractor().readings())).unwrap();
        assert!(!capability.floor_trips, "{name}: the clean floor trips");
        for along in places {
            let near = |one: f64| (one - along).abs();
            let place = capability
                .places
                .iter()
                .min_by(|one, other| near(one.place_mm).total_cmp(&near(other.place_mm)))
                .unwrap();
            let (width, height) = (place.smallest_width_mm.unwrap(), place.smallest_height_mm.unwrap());
            println!(
                "{name} at {along}: width {width} mm, height {height} mm, {:.2} mm a column",
                place.millimetres_per_column
            );
            let trips =
                |width: f64, height: f64| is_cut(&rig, &view, vec![plate(&rig, along, width, height)]);
            // Low plates: a high one hides floor from the camera. Far from the laser even a low one casts a long shadow
            // in the sheet of light and is found however narrow it is; the stated width is that of flat things.
            let low = height + 0.75;
            let origin = rig.laser().origin;
            let shadow = low * (along - origin.x).abs() / origin.z;
            let narrow = width - 3.5 - 2.0 * place.millimetres_per_column;
            assert!(trips(width + 0.5, low), "{name} at {along}: {width} mm wide is missed");
            assert!(trips(60.0, height + 0.3), "{name} at {along}: {height} mm high is missed");
            assert!(
                shadow > 4.0 || !trips(narrow, low),
                "{name} at {along}: {narrow} mm wide trips, the width is too cautious"
            );
            assert!(!trips(60.0, height - 1.5), "{name} at {along}: the height is too cautious");
        }
    }
}

/// The rule: a finer picture of the same rig detects narrower objects.
#[test]
fn finer_columns_detect_narrower_objects() {
    let widest = |width: u16| {
        let capability = measure(&CENTRE.with_width(width).rig().unwrap(), None).unwrap();
        capability.places.iter().filter_map(|place| place.smallest_width_mm).fold(0.0, f64::max)
    };
    let (coarse, fine) = (widest(1152), widest(2304));
    println!("1152 columns: {coarse} mm, 2304 columns: {fine} mm");
    assert!(fine < coarse);
}
