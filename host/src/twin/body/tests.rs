use super::*;
use crate::twin::gallery;
use crate::twin::scene::MaterialChoice;

fn axes() -> FloorAxes {
    FloorAxes::new(&gallery::default_rig())
}

fn object(shape: Shape) -> SceneObject {
    SceneObject {
        name: "thing".into(),
        shape,
        material: MaterialChoice::named("grey_card"),
        along_mm: 20.0,
        across_mm: -30.0,
        yaw_degrees: 25.0,
        bottom_mm: 0.0,
        velocity_mm_per_s: [0.0; 2],
    }
}

fn straight_down(axes: &FloorAxes, along: f64, across: f64) -> Ray {
    Ray { start: axes.place(along, across, 900.0), direction: Vector::new(0.0, 0.0, -1.0) }
}

#[test]
fn every_shape_stands_on_the_floor_with_its_stated_height() {
    for (shape, height) in [
        (Shape::Box { width_mm: 80.0, depth_mm: 60.0, height_mm: 45.0 }, 45.0),
        (Shape::Post { diameter_mm: 40.0, height_mm: 160.0 }, 160.0),
        (Shape::Rod { diameter_mm: 22.0, length_mm: 150.0 }, 22.0),
        (Shape::Cable { diameter_mm: 6.0, path_mm: vec![[-50.0, 0.0], [0.0, 10.0], [50.0, 0.0]] }, 6.0),
        (Shape::Pit { width_mm: 100.0, depth_mm: 80.0, deep_mm: 40.0 }, -40.0),
    ] {
        let world = World::new(&axes(), &[object(shape.clone())]).unwrap();
        assert!((world.bodies[0].height_mm - height).abs() < 1e-9, "{shape:?}");
        let across = if matches!(shape, Shape::Cable { .. }) {
            -30.0 + 10.0 * 25.0_f64.to_radians().cos()
        } else {
            -30.0
        };
        let along = if matches!(shape, Shape::Cable { .. }) {
            20.0 - 10.0 * 25.0_f64.to_radians().sin()
        } else {
            20.0
        };
        let hit = world.trace(&straight_down(&axes(), along, across)).unwrap();
        assert!((hit.point.z - height).abs() < 1e-3, "{shape:?}: {}", hit.point.z);
        assert_eq!(hit.body, Some(0));
    }
}

#[test]
fn a_forearm_is_as_high_as_it_says_and_a_palm_lower() {
    let world = World::new(&axes(), &[object(Shape::Hand { height_mm: 52.0 })]).unwrap();
    assert!((world.bodies[0].height_mm - 52.0).abs() < 1e-9);
    assert!(world.bodies[0].bounds.low.z.abs() < 2.0);
}

#[test]
fn across_points_away_from_the_laser() {
    let axes = axes();
    let rig = gallery::default_rig();
    assert!(axes.across.dot(axes.origin.minus(rig.laser().origin)) > 0.0);
    let [along, across] = axes.coordinates(axes.place(12.0, -34.0, 56.0));
    assert!((along - 12.0).abs() < 1e-9 && (across + 34.0).abs() < 1e-9);
}

#[test]
fn light_reaches_a_pit_only_through_its_opening() {
    let pit = object(Shape::Pit { width_mm: 100.0, depth_mm: 80.0, deep_mm: 40.0 });
    let world = World::new(&axes(), &[pit]).unwrap();
    let bottom = axes().place(20.0, -30.0, -40.0);
    assert!(!world.blocked(axes().place(20.0, -30.0, 500.0), bottom));
    assert!(world.blocked(axes().place(700.0, -30.0, 100.0), bottom), "below the rim from a low side");
}

#[test]
fn a_box_blocks_what_lies_behind_it_and_not_itself() {
    let solid = object(Shape::Box { width_mm: 80.0, depth_mm: 60.0, height_mm: 45.0 });
    let world = World::new(&axes(), &[solid]).unwrap();
    let lamp = axes().place(20.0, -500.0, 200.0);
    assert!(world.blocked(lamp, axes().place(20.0, 20.0, 0.0)));
    assert!(!world.blocked(lamp, axes().place(20.0, -30.0, 45.0)), "its own top is lit");
    assert!(!world.blocked(lamp, axes().place(200.0, 20.0, 0.0)), "beside it");
}
