//! What makes the twin's pictures harder: blur by motion, dirt, translucent things, uneven and photographed floors, and a laser
//! that the controller's code dims. Each follows its physical rule, and the same seed gives the same bytes.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use nearfield_fusion::Motion;
use nearfield_host::capture::FrameView;
use nearfield_host::link::{FrameFacts, InProcess, McuSession};
use nearfield_host::run::StripePath;
use nearfield_host::run::source::{Source as _, TwinSource};
use nearfield_host::twin::gallery::{CENTRE, SIDE, carton};
use nearfield_host::twin::scene::{Dirt, DirtKind, DirtSpot, Floor, MaterialChoice};
use nearfield_host::twin::{ExpectedCutoff, Picture, Scene, SceneObject, Sequence, Truth, Twin, View};
use nearfield_shared::causes::StopCauses;
use nearfield_shared::rig::Rig;

fn rig() -> Rig {
    CENTRE.with_width(1152).rig().unwrap()
}

/// Linear red minus green: the laser's light on a grey ground.
fn redness(picture: &Picture, column: usize, row: usize) -> f64 {
    let linear = |byte: u8| (f64::from(byte) / 255.0).powf(2.2);
    let [red, green, _] = picture.at(column, row);
    linear(red) - linear(green)
}

/// Middle, standard deviation and height of the stripe in a column around a row.
fn stripe(picture: &Picture, column: usize, row: f64, reach: usize) -> (f64, f64, f64) {
    let middle = row.round() as usize;
    let rows: Vec<usize> = (middle - reach..=middle + reach).collect();
    let at = |row: usize| redness(picture, column, row);
    let ground = (at(rows[0]) + at(rows[1]) + at(rows[2 * reach]) + at(rows[2 * reach - 1])) / 4.0;
    let light: Vec<f64> = rows.iter().map(|row| at(*row) - ground).collect();
    let sum: f64 = light.iter().sum();
    let moment = |power: i32, from: f64| -> f64 {
        rows.iter().zip(&light).map(|(row, light)| light * (*row as f64 - from).powi(power)).sum::<f64>()
            / sum
    };
    let centre = moment(1, 0.0);
    (centre, moment(2, centre).max(0.0).sqrt(), light.iter().copied().fold(0.0, f64::max))
}

/// Columns, rows and heights of the truth's visible points of the floor (-1) or an object.
fn seen(truth: &Truth, object: i32) -> Vec<(f64, f64, f64)> {
    let profile = &truth.profile;
    (0..profile.s_mm.len())
        .filter(|i| profile.visible[*i] && profile.object[*i] == object)
        .filter_map(|i| Some((profile.column[i]?, profile.row[i]?, profile.height_mm[i])))
        .collect()
}

fn quiet(mut scene: Scene) -> Scene {
    scene.look.speckle = 0.0;
    scene.look.halo = 0.0;
    scene.look.read_noise_electrons = 0.0;
    scene.look.full_well_electrons = 1e6;
    scene.look.laser_power = 0.3;
    scene
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

/// A floor's waves move the stripe to where the sheet meets them, and the truth knows their height.
#[test]
fn on_an_uneven_floor_the_stripe_lies_where_the_truth_says_and_nowhere_else() {
    let view = Arc::new(View::new(&rig()));
    let render = |wave_mm: f64| {
        let floor = Floor { wave_mm, wave_length_mm: 150.0, ..Floor::default() };
        let scene = quiet(Scene { floor, ..Scene::default() });
        let twin = Twin::new(Arc::clone(&view), &scene, 4).unwrap();
        (twin.render(0, 1.0), twin.truth(1.0))
    };
    let (waves, truth) = render(4.0);
    let (level, flat) = render(0.0);
    let heights: Vec<f64> = seen(&truth, -1).iter().map(|point| point.2).collect();
    let (low, high) = heights.iter().fold((0.0_f64, 0.0_f64), |(a, b), h| (a.min(*h), b.max(*h)));
    assert!(high - low > 3.0 && high <= 4.0 && low >= -4.0, "{low} to {high} mm");
    assert_eq!(truth.cutoff, ExpectedCutoff::NoTrip, "waves are floor");
    let errors = |picture: &Picture, truth: &Truth| -> Vec<f64> {
        let points = seen(truth, -1);
        points[20..points.len() - 20]
            .iter()
            .step_by(5)
            .map(|(u, v, _)| (stripe(picture, u.round() as usize, *v, 12).0 - v).abs())
            .collect()
    };
    let own = errors(&waves, &truth);
    assert!(mean(own.iter().copied()) < 0.35, "{}", mean(own.iter().copied()));
    assert!(mean(errors(&level, &truth).into_iter()) > 1.0, "the level floor's stripe lies elsewhere");
    assert!(mean(errors(&level, &flat).into_iter()) < 0.35);
}

/// What stands on an uneven floor stands as high as the floor is there.
#[test]
fn things_stand_on_the_waves() {
    let floor = Floor { wave_mm: 5.0, wave_length_mm: 200.0, ..Floor::default() };
    let view = Arc::new(View::new(&rig()));
    let tops: Vec<f64> = (0..6)
        .map(|place| {
            let thing = carton("box", [40.0, 40.0, 30.0], -15.0, "grey_card");
            let thing = SceneObject { along_mm: f64::from(place) * 70.0 - 180.0, ..thing };
            let scene = Scene { floor: floor.clone(), objects: vec![thing], ..Scene::default() };
            Twin::new(Arc::clone(&view), &scene, 4).unwrap().truth(1.0).objects[0].true_height_mm
        })
        .collect();
    assert!(tops.iter().all(|top| (25.0..=35.0).contains(top)), "{tops:?}");
    let spread = tops.iter().fold(0.0_f64, |most, top| most.max((top - tops[0]).abs()));
    assert!(spread > 1.0, "{tops:?}");
}

/// Of a translucent body the stripe is wider and fainter, but lies at the same place; what enters comes out.
#[test]
fn on_wax_the_stripe_is_wider_and_fainter_than_on_card_of_the_same_colour() {
    let view = Arc::new(View::new(&rig()));
    let render = |translucency: f32, scatter_mm: f32| {
        let card = nearfield_host::twin::material::named("white_card").unwrap();
        let material = nearfield_host::twin::material::Material { translucency, scatter_mm, ..card };
        let body = SceneObject {
            yaw_degrees: 0.0,
            material: MaterialChoice::Own(material),
            ..carton("block", [200.0, 160.0, 30.0], -90.0, "white_card")
        };
        let mut scene = quiet(Scene { objects: vec![body], ..Scene::default() });
        // So faint that nothing is clipped: bytes tell light.
        scene.look.laser_power = 0.08;
        let twin = Twin::new(Arc::clone(&view), &scene, 4).unwrap();
        let (picture, truth) = (twin.render(0, 1.0), twin.truth(1.0));
        let points = seen(&truth, 0);
        let measured: Vec<(f64, f64, f64)> = points[30..points.len() - 30]
            .iter()
            .step_by(5)
            .map(|(u, v, _)| {
                let (middle, width, height) = stripe(&picture, u.round() as usize, *v, 30);
                (middle - v, width, height)
            })
            .collect();
        assert!(measured.len() > 10, "{} places", measured.len());
        [
            mean(measured.iter().map(|m| m.0.abs())),
            mean(measured.iter().map(|m| m.1)),
            mean(measured.iter().map(|m| m.2)),
        ]
    };
    let [opaque, wax] = [render(0.0, 3.0), render(0.85, 4.0)];
    assert!(opaque[0] < 0.5 && wax[0] < 2.0, "places {opaque:?} {wax:?}");
    assert!(wax[1] > 1.5 * opaque[1], "widths {opaque:?} {wax:?}");
    // 15 % stay sharp, and the rest is spread over 8 mm instead of 1.3.
    assert!((0.15..0.6).contains(&(wax[2] / opaque[2])), "heights {opaque:?} {wax:?}");
    let farther = render(0.85, 8.0);
    assert!(farther[1] > wax[1] && farther[2] < wax[2], "{wax:?} {farther:?}");
}

/// A smear before the stripe takes contrast from it just there, and the truth says where and how much.
#[test]
fn dirt_takes_from_the_stripe_what_the_truth_says() {
    let view = Arc::new(View::new(&rig()));
    let clean = quiet(Scene::default());
    let truth = Twin::new(Arc::clone(&view), &clean, 4).unwrap().truth(1.0);
    assert!(truth.profile.clear.is_empty() && truth.dirt.is_empty());
    let points = seen(&truth, -1);
    let (column, row, _) = points[points.len() / 2];
    let at = [column / 1152.0, row / 648.0];
    let spot = DirtSpot { kind: DirtKind::Smudge, at, radius: 0.06, strength: 0.8 };
    let scene = Scene { dirt: Dirt { spots: vec![spot], ..Dirt::default() }, ..clean.clone() };
    let [bare, dirty] = [clean, scene].map(|scene| Twin::new(Arc::clone(&view), &scene, 4).unwrap());
    let [picture, smeared] = [&bare, &dirty].map(|twin| twin.render(0, 1.0));
    let told = dirty.truth(1.0);
    assert_eq!(told.dirt.len(), 1);
    let least = told.profile.clear.iter().copied().fold(1.0, f64::min);
    assert!((least - 0.2).abs() < 0.01, "{least}");
    let height =
        |picture: &Picture, (u, v, _): &(f64, f64, f64)| stripe(picture, u.round() as usize, *v, 14).2;
    let behind = height(&smeared, &points[points.len() / 2]) / height(&picture, &points[points.len() / 2]);
    let beside = height(&smeared, &points[40]) / height(&picture, &points[40]);
    // A fifth comes straight; of the blurred light (0.8 x 0.55) about two fifths fall where they would have.
    assert!((0.2..0.6).contains(&behind) && (0.95..1.05).contains(&beside), "{behind} {beside}");
}

/// A floor's picture lies on the floor where it says, goes on beyond its edges, and its scene file is understood.
#[test]
fn a_photographed_floor_is_seen_where_it_lies() {
    let folder = tempfile::tempdir().unwrap();
    // Quarters: bright and dark alternate along the stripe every 50 mm.
    let picture = image::RgbImage::from_fn(64, 32, |x, _| image::Rgb([if x < 32 { 60 } else { 200 }; 3]));
    picture.save(folder.path().join("stripes.png")).unwrap();
    let file = folder.path().join("scene.toml");
    let write = |text: &str| std::fs::write(&file, text).unwrap();
    write("[floor]\nimage = { file = \"stripes.png\", width_mm = 100.0 }\n");
    let scene = Scene::load(&file).unwrap();
    let view = Arc::new(View::new(&rig()));
    let shown = Twin::new(Arc::clone(&view), &scene, 1).unwrap().render(0, 0.0);
    let stripe = view.rig().stripe();
    let level = |along: f64| {
        let place = stripe.at(along);
        let outward = nearfield_shared::camera::Vector::new(place.x, place.y + 30.0, 0.0);
        let pixel = view.rig().camera().project(outward).unwrap();
        f64::from(shown.at(pixel.u.round() as usize, pixel.v.round() as usize)[1])
    };
    for tile in -2..2 {
        let start = f64::from(tile) * 100.0;
        assert!(level(start + 75.0) > 1.5 * level(start + 25.0), "tile {tile}");
    }
    let refused = |text: &str, words: &str| {
        write(text);
        let message = Scene::load(&file).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    refused("[floor]\nimage = { file = \"no.png\", width_mm = 100.0 }\n", "no.png");
    refused("[floor]\nimage = { file = \"stripes.png\", width_mm = 0.0 }\n", "floor.image.width_mm");
    refused("[floor]\nwave_mm = 9.0\nwave_length_mm = 100.0\n", "thirtieth");
    refused("[dirt]\nstrength = 1.5\n", "dirt.strength");
    refused("[dirt]\nsmudge = 3\n", "smudge");
    refused("[look]\nexposure_ms = -1.0\n", "look.exposure_ms");
}

/// All of it together: the same bytes on any number of threads, and other bytes with another seed.
#[test]
fn the_same_seed_gives_the_same_hard_picture_on_any_number_of_threads() {
    let rig = SIDE.with_width(576).rig().unwrap();
    let mut scene =
        Scene { objects: vec![carton("box", [80.0, 60.0, 40.0], -30.0, "wax_white")], ..Scene::default() };
    scene.floor.wave_mm = 3.0;
    scene.dirt = Dirt { smudges: 3, dust: 20, ..Dirt::default() };
    scene.look.exposure_ms = 8.0;
    scene.look.bounce = 1.0;
    scene.objects[0].velocity_mm_per_s = [0.0, -800.0];
    scene.robot.velocity_mm_per_s = [50.0, 300.0];
    let render = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Sequence::new(&rig, &scene, seed).unwrap().picture(2, 0.04, 1.0).unwrap())
    };
    let (one, truth) = render(1, 3);
    for threads in [2, 5] {
        let again = render(threads, 3);
        assert!(one == again.0 && truth == again.1, "{threads} threads changed the picture");
    }
    assert!(one != render(2, 4).0, "the seed did not change the picture");
}

/// Arms a controller before a clean floor, beyond which a box passes (so that pictures are means over an exposure), for 160
/// pictures: was the relay closed at the end, what causes were latched, and the laser's drive with the stripe's redness, picture
/// by picture.
fn armed(follows_the_code: bool) -> (bool, StopCauses, Vec<(f64, f64)>) {
    let rig = CENTRE.with_width(576).rig().unwrap();
    let passing = SceneObject {
        velocity_mm_per_s: [400.0, 0.0],
        along_mm: -500.0,
        ..carton("box", [60.0, 60.0, 40.0], 250.0, "cardboard")
    };
    let mut scene = Scene { objects: vec![passing], ..Scene::default() };
    scene.look.exposure_ms = 4.0;
    let points = seen(&Twin::new(Arc::new(View::new(&rig)), &scene, 7).unwrap().truth(1.0), -1);
    let session = McuSession::start(Box::new(InProcess::new()), &rig).unwrap();
    let mut path = StripePath::new(&rig, session, None).unwrap();
    let mut source = TwinSource::new(&rig, &scene, 7).unwrap().moving(&scene, 7, 50.0).unwrap();
    let facts = FrameFacts::default();
    let (mut light, mut closed) = (Vec::new(), false);
    for frame in 0..160 {
        if frame == 30 {
            path.controller().press_reset();
        }
        let exposed = path.controller().now().since(facts.capture_age);
        let drive = path.controller().mean_laser_drive(exposed, facts.exposure);
        source.advance(if follows_the_code { drive } else { 1.0 }).unwrap();
        let FrameView::Yuv420 { red, .. } = source.frame().view() else { panic!("not YUV420") };
        let at = |(u, v, _): &(f64, f64, f64)| f64::from(red.row(*v as usize / 2)[*u as usize / 2]);
        light.push((f64::from(drive), mean(points[50..points.len() - 50].iter().map(at))));
        closed = path.step(source.frame(), exposed, &Motion::default()).unwrap().relay_closed;
    }
    (closed, path.controller().status().latched_causes, light)
}

/// The loop from the controller's laser to the picture: the stripe's light follows the code, and pictures that do not
/// follow it do not move the robot.
#[test]
fn the_stripe_is_as_bright_as_the_controllers_code_says_and_one_that_is_not_stops_the_robot() {
    let (closed, causes, light) = armed(true);
    assert!(closed, "{causes:?}");
    let (drives, shown): (Vec<f64>, Vec<f64>) = light.into_iter().unzip();
    let centred = |values: &[f64]| {
        let middle = mean(values.iter().copied());
        values.iter().map(|value| value - middle).collect::<Vec<_>>()
    };
    let (a, b) = (centred(&drives), centred(&shown));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let correlation = product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt();
    assert!(product(&a, &a) > 1.0, "the code dims the laser");
    assert!(correlation > 0.95, "{correlation}");
    let (closed, causes, _) = armed(false);
    assert!(!closed, "a stripe that does not follow the code was believed: {causes:?}");
}

/// The rule: who copies an example from the scene files' document gets a scene.
#[test]
fn every_example_of_the_document_is_a_scene() {
    let document = concat!(env!("CARGO_MANIFEST_DIR"), "/../host/SCENES.md");
    let text = std::fs::read_to_string(document).unwrap();
    let examples: Vec<&str> =
        text.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert!(examples.len() >= 2);
    for example in examples {
        let scene = Scene::from_toml(example).unwrap_or_else(|error| panic!("{error}:\n{example}"));
        assert_ne!(scene, Scene::default());
    }
}
