use super::*;
use crate::twin::gallery::{self, SIDE};

/// Moved objects are traced anew in parts and by several threads; nothing of that may show.
#[test]
fn a_moving_scene_gives_the_same_pictures_on_any_number_of_threads_and_in_every_run() {
    let view = Arc::new(View::new(&SIDE.rig().unwrap()));
    let run = |name: &str, bounce: f64, threads: usize| -> Vec<Vec<u8>> {
        let mut scene = gallery::scene(name).unwrap();
        scene.look.bounce = bounce;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut twin = Twin::new(Arc::clone(&view), &scene, 6).unwrap();
            let picture = |frame: u64| {
                scene.objects.iter_mut().for_each(|object| object.along_mm += 7.0);
                twin.place(&scene.objects).unwrap();
                twin.render(frame, 1.0).rgb
            };
            (0..3).map(picture).collect()
        })
    };
    for (name, bounce) in [("hand", 0.0), ("box_75_glossy", 1.0), ("cable_6", 0.0)] {
        let one = run(name, bounce, 1);
        assert!(one[0] != one[1] && one[1] != one[2], "{name}: nothing moves");
        for threads in [1, 2, 5] {
            assert!(one == run(name, bounce, threads), "{name}: {threads} threads changed a picture");
        }
    }
}

/// Pixels that are skipped because nothing can be there must be those in which really nothing is: the same picture with
/// every pixel of the redrawn areas looked at by the slow way.
#[test]
fn only_pixels_that_show_the_bare_floor_are_skipped() {
    let rig = SIDE.with_width(576).rig().unwrap();
    let view = Arc::new(View::new(&rig));
    for (name, bounce) in
        [("hand", 0.0), ("rod_12", 0.0), ("cable_6", 0.0), ("drop", 0.0), ("box_75_glossy", 1.0)]
    {
        let mut scene = gallery::scene(name).unwrap();
        scene.look.bounce = bounce;
        let twin = Twin::new(Arc::clone(&view), &scene, 3).unwrap();
        let parts: Vec<_> = twin.world.parts().map(|(part, _)| part).collect();
        let everywhere = PixelRectangle { left: 0, top: 0, right: view.width(), bottom: view.height() };
        let all: Vec<_> = parts.into_iter().map(|part| (part, everywhere)).collect();
        let all: Vec<_> = all.iter().collect();
        let mut drawn = 0;
        for area in &twin.drawn {
            let mut planes =
                [0, 1, 2].map(|channel| planes::cut(&twin.floor_sharp, channel, *area, view.width()));
            let under = planes.clone();
            let mut light = crate::twin::patch::Patch::dark(*area);
            twin.draw_sharp(*area, &mut planes, &mut light);
            for (place, laser) in light.values.iter().enumerate() {
                let (column, row) = (area.left + place % light.width(), area.top + place / light.width());
                let floor = [0, 1, 2].map(|channel| under[channel].values[place]);
                let (colour, slow) = twin.trace_pixel(column, row, &all, floor);
                let quick = [0, 1, 2].map(|channel| planes[channel].values[place]);
                assert_eq!((quick, *laser), (colour, slow), "{name}: column {column}, row {row}");
                drawn += usize::from(quick != floor);
            }
        }
        assert!(drawn > 20, "{name}: nothing was drawn");
    }
}

/// Where the redrawn area ends, nothing may show: the same light, to the last bit, as if the whole picture were redrawn.
#[test]
fn redrawing_a_part_of_the_picture_is_redrawing_all_of_it() {
    let rig = SIDE.with_width(576).rig().unwrap();
    let view = Arc::new(View::new(&rig));
    let mut only_parts = 0;
    for name in ["hand", "rod_12", "cable_6", "box_75_glossy"] {
        let mut scene = gallery::scene(name).unwrap();
        // A floor with much contrast: what is smeared wrongly shows.
        scene.floor.kind = crate::twin::scene::FloorKind::Wood;
        let mut twin = Twin::new(Arc::clone(&view), &scene, 3).unwrap();
        let (width, height) = (view.width(), view.height());
        let everywhere = PixelRectangle { left: 0, top: 0, right: width, bottom: height };
        let drawn = twin.drawn.iter().map(|area| (area.right - area.left) * (area.bottom - area.top));
        only_parts += usize::from(drawn.sum::<usize>() < width * height);
        let parts = twin.day.values.clone();
        twin.draw(&[everywhere]);
        assert!(parts == twin.day.values, "{name}");
    }
    assert!(only_parts >= 2, "nearly everything was redrawn anyway");
}
