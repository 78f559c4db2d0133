//! What both benchmarks look at: a clean floor, a crowded one (a glossy box), a weak stripe (bright light on wood).

use std::sync::Arc;

use nearfield_host::capture::{Frame, Pixels};
use nearfield_host::twin::gallery;
use nearfield_host::twin::scene::{Floor, FloorKind, Light, Scene};
use nearfield_host::twin::{Twin, View};
use nearfield_shared::rig::Rig;

/// Columns of the camera's picture.
pub const WIDTH: u16 = 2304;
/// Lux at which the laser is hard to see.
const BRIGHT_LUX: f64 = 1800.0;

/// The scenes by their names.
pub fn scenes() -> [(&'static str, Scene); 3] {
    let floor = Floor { kind: FloorKind::Wood, paint: Vec::new(), ..Floor::default() };
    let light = Light { lux: BRIGHT_LUX, ..Light::default() };
    [
        ("clean", gallery::scene("clean").unwrap()),
        ("crowded", gallery::scene("box_75_glossy").unwrap()),
        ("weak", Scene { floor, light, ..Scene::default() }),
    ]
}

/// A picture of a scene, RGB8.
pub fn render(rig: &Rig, view: &Arc<View>, scene: &Scene) -> Frame {
    let twin = Twin::new(Arc::clone(view), scene, 1).unwrap();
    Frame::new(rig.image(), Pixels::Rgb(twin.render(0, 1.0).rgb)).unwrap()
}
