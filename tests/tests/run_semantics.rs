//! Tier 3 beside the stripe, from pictures to relays: what it says can let debris pass and nothing else, and a detector
//! that does not answer delays nobody.
#![allow(clippy::unwrap_used)]

use nearfield_fusion::{BoxPixels, Motion, Sighting};
use nearfield_host::link::{FrameFacts, InProcess, McuSession};
use nearfield_host::run::semantics::SemanticPicture;
use nearfield_host::run::{Eye, Semantics, StripePath};
use nearfield_host::twin::gallery::{CENTRE, carton, plain};
use nearfield_host::twin::scene::Shape;
use nearfield_host::twin::{Picture, Scene, SceneObject, Twin, View};
use nearfield_shared::action::Category;
use nearfield_shared::camera::Vector;
use nearfield_shared::causes::StopCause;
use nearfield_shared::limits::RUN_OVER_HEIGHT;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::rig::Rig;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};

/// Says what it is told to say, of every picture.
struct Told(Arc<Mutex<Result<Vec<Sighting>, String>>>);

impl Eye for Told {
    fn look(&mut self, _picture: &SemanticPicture) -> Result<Vec<Sighting>, String> {
        self.0.lock().unwrap().clone()
    }
}

/// Answers nothing until it is let go.
struct Stalled(Receiver<()>);

impl Eye for Stalled {
    fn look(&mut self, _picture: &SemanticPicture) -> Result<Vec<Sighting>, String> {
        let _ = self.0.recv();
        Err("let go".to_owned())
    }
}

/// A robot in front of a scene.
struct Stage {
    rig: Rig,
    path: StripePath<McuSession>,
    twin: Twin,
    picture: Picture,
    frame: u64,
}

impl Stage {
    fn new(semantics: Option<Semantics>) -> Self {
        let rig = CENTRE.with_width(1152).rig().unwrap().with_run_over(true);
        let session = McuSession::start(Box::new(InProcess::new()), &rig).unwrap();
        let path = StripePath::new(&rig, session, semantics).unwrap();
        let twin = Twin::new(Arc::new(View::new(&rig)), &Scene::default(), 7).unwrap();
        Self { rig, path, twin, picture: Picture::black(0, 0), frame: 0 }
    }

    fn place(&mut self, objects: &[SceneObject]) {
        self.twin.place(objects).unwrap();
    }

    /// One picture; tells whether the robot may move.
    fn step(&mut self) -> bool {
        let facts = FrameFacts::default();
        let exposed = self.path.controller().now().since(facts.capture_age);
        let drive = self.path.controller().mean_laser_drive(exposed, facts.exposure);
        self.twin.render_into(self.frame, drive, &mut self.picture);
        self.frame += 1;
        let frame = self.picture.to_yuv420_frame().unwrap();
        self.path.step(&frame, exposed, &Motion::default()).unwrap().relay_closed
    }

    fn steps(&mut self, count: usize) {
        for _ in 0..count {
            self.step();
        }
    }

    fn arm(&mut self) {
        for frame in 0..90 {
            if frame == 30 {
                self.path.controller().press_reset();
            }
            self.step();
        }
        assert!(self.step(), "not armed: {:?}", self.path.controller().status());
    }

    /// Goes on over clean floor until the controller is told of something, which takes tier 3's thread a few pictures.
    fn wait_for_claims(&mut self) {
        for _ in 0..5000 {
            self.step();
            if self.path.claims().iter().flatten().count() > 0 && self.path.are_tracks_confirmed() {
                // The controller wants three line-scans that agree.
                self.steps(3);
                return;
            }
            std::thread::yield_now();
        }
        panic!("tier 3 was never heard");
    }
}

fn debris(height_mm: f64) -> SceneObject {
    carton("debris", [60.0, 40.0, height_mm], -20.0, "cardboard")
}

/// As high as a bolt that lies there.
const LOW: f64 = 10.0;

/// What a detector says of the debris.
fn sighting(rig: &Rig, category: Category, confidence: f64) -> Sighting {
    let mut seen = BoxPixels { left: f64::MAX, top: f64::MAX, right: f64::MIN, bottom: f64::MIN };
    let foot = rig.stripe().at(0.0);
    for (x, y, z) in [(-38.0, -30.0, 0.0), (38.0, -30.0, 0.0), (-38.0, 30.0, 18.0), (38.0, 30.0, 18.0)] {
        let pixel = rig.camera().project(Vector::new(foot.x + x, foot.y + y, z)).unwrap();
        seen.left = seen.left.min(pixel.u);
        seen.right = seen.right.max(pixel.u);
        seen.top = seen.top.min(pixel.v);
        seen.bottom = seen.bottom.max(pixel.v);
    }
    Sighting { category, confidence, seen }
}

/// Arms with tier 3 saying this of the debris's place, then puts the debris there for ten pictures. Does the robot go on?
fn goes_over(category: Category, confidence: f64, height_mm: f64) -> bool {
    let words = Arc::new(Mutex::new(Ok(Vec::new())));
    let mut stage = Stage::new(Some(Semantics::start(Told(Arc::clone(&words))).unwrap()));
    stage.arm();
    *words.lock().unwrap() = Ok(vec![sighting(&stage.rig, category, confidence)]);
    stage.wait_for_claims();
    stage.place(&[debris(height_mm)]);
    (0..10).all(|_| stage.step())
}

#[test]
fn debris_passes_from_picture_to_relay_if_tier_three_knows_it() {
    assert!(goes_over(Category::Tool, 0.97, LOW));
    assert!(goes_over(Category::Material, 0.97, LOW));
}

#[test]
fn the_same_debris_stops_if_tier_three_is_unsure_or_says_otherwise() {
    assert!(!goes_over(Category::Tool, 0.8, LOW), "not sure enough for the controller");
    for category in [Category::Human, Category::Part, Category::Environment, Category::Unknown] {
        assert!(!goes_over(category, 0.97, LOW), "{category:?}");
    }
}

/// The sheet of light meets the foot of a tall thing first, low over the floor, where it looks like debris. It must not
/// come nearer than the sheet takes to climb to the limit: 40 mm over its slope.
#[test]
fn a_tall_thing_that_is_taken_for_debris_stops_once_the_sheet_has_climbed_to_the_limit() {
    let words = Arc::new(Mutex::new(Ok(Vec::new())));
    let mut stage = Stage::new(Some(Semantics::start(Told(Arc::clone(&words))).unwrap()));
    stage.arm();
    *words.lock().unwrap() = Ok(vec![sighting(&stage.rig, Category::Tool, 0.97)]);
    stage.wait_for_claims();
    let (laser, reach) = (stage.rig.laser().origin, stage.rig.stripe().point.y);
    let slope = laser.z / (reach - laser.y);
    let farthest = f64::from(RUN_OVER_HEIGHT.get()) / slope;
    let mut inside = -5.0;
    while stage.step() {
        // 5 mm a picture: 250 mm/s. Its near face is 20 mm before its middle.
        inside += 5.0;
        let shape = Shape::Box { width_mm: 60.0, depth_mm: 40.0, height_mm: 300.0 };
        stage.place(&[plain("tall", shape, 20.0 - inside, "cardboard")]);
        assert!(inside <= farthest + 15.0, "{inside} mm inside the stripe");
    }
    println!(
        "open with its foot {inside} mm inside the stripe; the sheet climbs to the limit in {farthest:.0} mm"
    );
    assert!(inside > 0.0);
}

#[test]
fn a_detector_that_does_not_answer_delays_and_permits_nothing() {
    let (let_go, permits) = channel();
    let mut stage = Stage::new(Some(Semantics::start(Stalled(permits)).unwrap()));
    stage.arm();
    // Five hundred pictures are ten seconds at 50 a second; if anything waited for the detector, this would never end.
    for _ in 0..500 {
        assert!(stage.step(), "a silent detector is no reason to stop on free floor");
    }
    let [median, p99, ..] = stage.path.latency().summary_ms();
    println!("stalled: {} pictures, median {median:.2} ms, p99 {p99:.2} ms", stage.path.latency().count());
    stage.place(&[debris(LOW)]);
    stage.steps(5);
    assert!(!stage.step(), "and no reason to let anything pass");
    let causes = stage.path.controller().status().latched_causes;
    assert!(causes.contains(StopCause::StripeCut), "{causes:?}");
    drop(let_go);
}

#[test]
fn without_tier_three_the_stripe_alone_decides() {
    let mut stage = Stage::new(None);
    stage.arm();
    assert!((0..20).all(|_| stage.step()));
    stage.place(&[debris(LOW)]);
    stage.steps(5);
    assert!(!stage.step());
}

#[test]
fn a_person_ahead_stops_before_the_stripe_is_touched() {
    let words = Arc::new(Mutex::new(Ok(Vec::new())));
    let mut stage = Stage::new(Some(Semantics::start(Told(Arc::clone(&words))).unwrap()));
    stage.arm();
    *words.lock().unwrap() = Ok(vec![sighting(&stage.rig, Category::Human, 0.3)]);
    let mut closed = true;
    for _ in 0..5000 {
        closed = stage.step();
        if !closed {
            break;
        }
        std::thread::yield_now();
    }
    assert!(!closed && stage.path.controller().status().latched_causes.contains(StopCause::HostRequest));
    assert_eq!(stage.path.last_verdict(), HostVerdict::Stop);
}
