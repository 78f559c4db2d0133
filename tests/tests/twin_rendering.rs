//! The twin's pictures show what its truth says, and nothing but seed, scene and laser decides them.

use std::sync::Arc;

use nearfield_host::twin::gallery::{self, CENTRE, Mounting, SIDE, Theme, WIDE};
use nearfield_host::twin::{ExpectedCutoff, Picture, Scene, SceneObject, Truth, Twin, View};
use nearfield_shared::camera::Pixel;

#[expect(clippy::unwrap_used, reason = "a test helper")]
fn view(mounting: Mounting) -> Arc<View> {
    Arc::new(View::new(&mounting.with_width(1152).rig().unwrap()))
}

#[expect(clippy::unwrap_used, reason = "a test helper")]
fn twin(view: &Arc<View>, name: &str) -> Twin {
    Twin::new(Arc::clone(view), &gallery::scene(name).unwrap(), 11).unwrap()
}

/// How much redder than its other colours a pixel is; the laser, whatever the floor.
fn redness(picture: &Picture, column: usize, row: usize) -> f64 {
    let [red, green, blue] = picture.at(column, row).map(f64::from);
    red - green.max(blue)
}

/// Row of the brightest red in a column near `row`, as the centre of gravity around it.
fn stripe_row(picture: &Picture, column: usize, row: f64) -> Option<f64> {
    const REACH: usize = 12;
    let middle = row.round() as usize;
    let rows = middle.saturating_sub(REACH)..(middle + REACH + 1).min(picture.height);
    let outside = redness(picture, column, rows.start).max(redness(picture, column, rows.end - 1)).max(0.0);
    let (mut sum, mut moment) = (0.0, 0.0);
    for row in rows {
        let weight = (redness(picture, column, row) - outside).max(0.0);
        sum += weight;
        moment += weight * row as f64;
    }
    (sum > 60.0).then(|| moment / sum)
}

/// Visible points of the truth on the floor (`object` -1) or on an object, with the column and row they appear at.
fn seen(truth: &Truth, object: i32) -> Vec<(f64, f64, f64)> {
    let profile = &truth.profile;
    (0..profile.s_mm.len())
        .filter(|i| profile.visible[*i] && profile.object[*i] == object)
        .filter_map(|i| Some((profile.column[i]?, profile.row[i]?, profile.height_mm[i])))
        .collect()
}

#[test]
fn the_stripe_lies_where_the_camera_and_laser_model_puts_it() {
    for mounting in [CENTRE, SIDE, WIDE] {
        let view = view(mounting);
        let twin = twin(&view, "clean");
        let picture = twin.render(0, 1.0);
        let points = seen(&twin.truth(1.0), -1);
        assert!(points.len() > 700, "{} points", points.len());
        let mut errors = Vec::new();
        for (column, row, _) in points.iter().skip(10).step_by(3).take(250) {
            // The truth's column is not whole; the stripe is followed along the picture's rows by its local slope.
            let whole = column.round();
            let floor =
                view.rig().laser().triangulate(view.rig().camera(), Pixel { u: whole, v: *row }).unwrap();
            assert!(floor.z.abs() < 1.0, "the slope within half a pixel is small");
            if let Some(found) = stripe_row(&picture, whole as usize, *row) {
                let lit = view
                    .rig()
                    .laser()
                    .triangulate(view.rig().camera(), Pixel { u: whole, v: found })
                    .unwrap();
                errors.push(lit.z);
            }
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let spread = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
        assert!(errors.len() > 200, "{mounting:?}: seen in {} columns", errors.len());
        assert!(
            mean.abs() < 0.15 && spread < 0.8,
            "{mounting:?}: height of the floor {mean:.3} +- {spread:.3} mm"
        );
    }
}

#[test]
fn light_on_a_box_appears_at_the_boxs_height() {
    let view = view(CENTRE);
    let twin = twin(&view, "box_45");
    let picture = twin.render(0, 1.0);
    let points = seen(&twin.truth(1.0), 0);
    let mut heights = Vec::new();
    for (column, row, height) in &points[10..points.len() - 10] {
        let found = stripe_row(&picture, column.round() as usize, *row).expect("stripe on the box");
        let pixel = Pixel { u: column.round(), v: found };
        heights.push(view.rig().laser().triangulate(view.rig().camera(), pixel).unwrap().z - height);
    }
    let worst = heights.iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
    let mean = heights.iter().sum::<f64>() / heights.len() as f64;
    assert!(heights.len() > 100 && mean.abs() < 0.5 && worst < 3.0, "mean {mean:.2}, worst {worst:.2} mm");
}

#[test]
fn the_same_seed_gives_the_same_picture_on_any_number_of_threads() {
    let view = view(CENTRE);
    let render = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            Twin::new(Arc::clone(&view), &gallery::scene("hand").unwrap(), seed).unwrap().render(5, 1.0)
        })
    };
    let one = render(1, 3);
    assert!(one == render(3, 3), "threads changed the picture");
    assert!(one != render(3, 4), "the seed did not change the picture");
}

#[test]
fn a_scene_reached_by_moving_objects_equals_the_same_scene_made_afresh() {
    let view = view(SIDE);
    let start = gallery::scene("box_75_glossy").unwrap();
    let mut moved = Twin::new(Arc::clone(&view), &start, 2).unwrap();
    let place = |along: f64, across: f64| {
        let mut scene = gallery::scene("hand").unwrap();
        scene.objects[0].along_mm = along;
        scene.objects[0].across_mm = across;
        scene
    };
    for (along, across) in [(-200.0, 100.0), (0.0, -60.0), (150.0, -150.0)] {
        moved.place(&place(along, across).objects).unwrap();
    }
    let afresh = Twin::new(Arc::clone(&view), &place(150.0, -150.0), 2).unwrap();
    assert!(moved.render(1, 1.0) == afresh.render(1, 1.0));
    assert_eq!(moved.truth(1.0), afresh.truth(1.0));
    moved.place(&[]).unwrap();
    let empty = Twin::new(view, &Scene::default(), 2).unwrap();
    assert!(moved.render(2, 1.0) == empty.render(2, 1.0), "nothing of an object stays behind");
}

#[test]
fn without_laser_light_there_is_no_stripe_and_half_the_drive_is_half_the_light() {
    let view = view(CENTRE);
    let twin = twin(&view, "clean");
    let [dark, half, full] = [0.0, 0.5, 1.0].map(|drive| twin.render(0, drive));
    let points = seen(&twin.truth(1.0), -1);
    let mean = |picture: &Picture| {
        let values = points.iter().map(|(u, v, _)| redness(picture, u.round() as usize, v.round() as usize));
        values.sum::<f64>() / points.len() as f64
    };
    assert!(mean(&dark).abs() < 8.0, "{}", mean(&dark));
    assert!(mean(&half) > mean(&dark) + 40.0 && mean(&full) > mean(&half) + 20.0);
    assert_eq!(twin.truth(0.0).cutoff, ExpectedCutoff::StripeMissing);
    assert!(twin.render(0, f32::NAN) == dark, "a drive that is no number is no light");
}

#[test]
fn the_truth_about_a_box_follows_from_similar_triangles() {
    // A box whose front stands 60 mm before the stripe: the sheet (200 mm high, 500 mm away) meets it 24 mm up.
    let view = view(CENTRE);
    let flat =
        SceneObject { yaw_degrees: 0.0, ..gallery::carton("box", [100.0, 80.0, 70.0], -20.0, "grey_card") };
    let scene = Scene { objects: vec![flat], ..Scene::default() };
    let truth = Twin::new(view, &scene, 1).unwrap().truth(1.0);
    let heights = truth.objects[0].heights.expect("lit");
    assert!((heights.max_mm - 24.0).abs() < 0.01 && (heights.min_mm - 24.0).abs() < 0.01, "{heights:?}");
    // Its rays cover a longer stretch of the floor than the box is wide: 100 mm * 500 / 440.
    let [gap] = truth.gaps[..] else { panic!("{:?}", truth.gaps) };
    assert!((gap.length_mm - 100.0 * 500.0 / 440.0).abs() < 1.5, "{gap:?}");
    assert_eq!(truth.cutoff, ExpectedCutoff::Trip);
}

#[test]
fn what_stands_beyond_the_stripe_or_is_only_painted_cuts_nothing() {
    let view = view(CENTRE);
    for name in ["clean", "near_miss", "red_line", "tiles"] {
        let truth = twin(&view, name).truth(1.0);
        assert_eq!((truth.cutoff, truth.longest_gap_mm.any), (ExpectedCutoff::NoTrip, 0.0), "{name}");
    }
    for seed in 0..12 {
        let scene = gallery::random_scene(seed, Theme::Clean, view.rig().stripe());
        let truth = Twin::new(Arc::clone(&view), &scene, seed).unwrap().truth(1.0);
        assert_eq!(truth.cutoff, ExpectedCutoff::NoTrip, "seed {seed}");
    }
}

#[test]
fn a_pit_lies_below_the_floor_and_swallows_the_far_stripe() {
    let truth = twin(&view(CENTRE), "drop").truth(1.0);
    let pit = truth.objects[0].heights.expect("the camera sees light in the pit");
    assert!(truth.objects[0].true_height_mm == -40.0 && pit.min_mm < -5.0, "{:?}", truth.objects[0]);
    assert_eq!(truth.cutoff, ExpectedCutoff::Trip);
}

#[test]
fn black_velvet_is_a_dark_gap() {
    let truth = twin(&view(CENTRE), "black_hole").truth(1.0);
    assert_eq!(truth.cutoff, ExpectedCutoff::Trip);
    assert!(truth.objects[0].heights.is_none() || truth.objects[0].heights.is_some_and(|h| h.max_mm < 40.0));
    let json = serde_json::to_value(&truth).unwrap();
    assert_eq!(json["schema"], "nearfield-truth-1");
    assert_eq!(json["cutoff"], "trip");
    assert!(json["longest_gap_mm"]["tol5"].as_f64().unwrap() > 40.0);
    assert_eq!(
        json["profile"]["s_mm"].as_array().unwrap().len(),
        json["profile"]["row"].as_array().unwrap().len()
    );
}
