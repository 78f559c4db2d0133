//! A stripe that sunlight and distance leave faint: it is followed as long as there is light to see it by, and what cuts
//! it is found all the same.
#![allow(clippy::unwrap_used, reason = "the helpers of tests may fail them")]

use std::sync::Arc;

use nearfield_host::campaign::LEAST_MEASURABLE;
use nearfield_host::capture::{Frame, Pixels};
use nearfield_host::twin::gallery::{CENTRE, SIDE, cable};
use nearfield_host::twin::scene::{Floor, FloorKind, Light, MaterialChoice, PaintedLine, Scene, SceneObject};
use nearfield_host::twin::{Twin, View};
use nearfield_host::vision::Analyser;

const SUNLIT_LUX: f64 = 1500.0;
const YELLOW: [f32; 3] = [0.72, 0.48, 0.04];
const FLOORS: [FloorKind; 3] = [FloorKind::EpoxyGreen, FloorKind::Wood, FloorKind::Concrete];

fn sunlit(kind: FloorKind, paint: Vec<PaintedLine>, objects: Vec<SceneObject>) -> Scene {
    let light = Light { lux: SUNLIT_LUX, ..Light::default() };
    Scene { floor: Floor { kind, paint, ..Floor::default() }, light, objects, ..Scene::default() }
}

/// Faintest stretch and longest gap found, millimetres, from RGB and from YUV420.
fn look(view: &Arc<View>, analyser: &mut Analyser, scene: &Scene) -> (f64, [f32; 2]) {
    let twin = Twin::new(Arc::clone(view), scene, 1).unwrap();
    let rgb = Frame::new(view.rig().image(), Pixels::Rgb(twin.render(0, 1.0).rgb)).unwrap();
    let yuv = rgb.to_yuv420();
    let gaps = [rgb, yuv].map(|frame| {
        analyser.judge(&frame.view()).unwrap();
        analyser.report().longest_gap().map_or(0.0, |gap| gap.length().get())
    });
    (twin.faintest_stretch(&twin.truth(1.0), 1.0), gaps)
}

#[test]
fn a_faint_stripe_is_whole_to_its_far_end() {
    let rig = SIDE.rig().unwrap();
    let (view, mut analyser) = (Arc::new(View::new(&rig)), Analyser::new(&rig).unwrap());
    for kind in FLOORS {
        let (faintest, gaps) = look(&view, &mut analyser, &sunlit(kind, Vec::new(), Vec::new()));
        println!("{kind:?}: faintest 5 mm {faintest:.1}, gaps {gaps:?} mm");
        assert!(faintest >= LEAST_MEASURABLE, "{kind:?}: no light to see it by, {faintest:.1}");
        // In chroma planes the far end has two columns to seven millimetres, and so may stop: only told, not judged.
        assert!(gaps[0] <= 5.0, "{kind:?}: {gaps:?} mm");
    }
}

#[test]
fn a_cable_cuts_a_faint_stripe_wherever_it_lies() {
    let rig = SIDE.rig().unwrap();
    let (view, mut analyser) = (Arc::new(View::new(&rig)), Analyser::new(&rig).unwrap());
    for kind in FLOORS {
        for along_mm in [-350.0, 0.0, 250.0, 450.0] {
            for material in ["cable_black", "cable_grey"] {
                let lying = cable("cable", 10.0, 0.0);
                let cable = SceneObject { along_mm, material: MaterialChoice::named(material), ..lying };
                let (_, gaps) = look(&view, &mut analyser, &sunlit(kind, Vec::new(), vec![cable]));
                println!("{kind:?}, {material} at {along_mm} mm: gaps {gaps:?} mm");
                assert!(
                    gaps.iter().all(|gap| *gap > 5.0),
                    "{kind:?}, {material} at {along_mm} mm: {gaps:?} mm"
                );
            }
        }
    }
}

#[test]
fn the_edge_of_a_line_that_crosses_the_stripe_is_no_gap() {
    let rig = CENTRE.rig().unwrap();
    let (view, mut analyser) = (Arc::new(View::new(&rig)), Analyser::new(&rig).unwrap());
    for kind in [FloorKind::EpoxyGreen, FloorKind::ConcreteDark] {
        for angle_degrees in [30.0, 60.0, 90.0, 120.0, 150.0] {
            let line =
                PaintedLine { colour: YELLOW, along_mm: 40.0, across_mm: 0.0, width_mm: 75.0, angle_degrees };
            let (_, gaps) = look(&view, &mut analyser, &sunlit(kind, vec![line], Vec::new()));
            println!("{kind:?}, line at {angle_degrees} degrees: gaps {gaps:?} mm");
            assert!(gaps.iter().all(|gap| *gap <= 5.0), "{kind:?} at {angle_degrees} degrees: {gaps:?} mm");
        }
    }
}
