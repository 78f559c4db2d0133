//! `nearfield twin calibration`: the pictures that a calibration asks for, rendered.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_shared::camera::{Camera, Pose, Vector};
use nearfield_shared::rig::{ImageSize, Rig};

use crate::rig_file;
use crate::twin::board::{PaintedBoard, lens_views};
use crate::twin::gallery::{carton, plain};
use crate::twin::{Picture, Scene, SceneObject, Twin, View};

/// Render the pictures that `nearfield calibrate` asks for, of a rig that is known.
///
/// Writes into DIR: `lens00.png` to `lens13.png` (views of a board), `board.png` (the board flat on the floor where the stripe runs),
/// `stripe.png` (the stripe on the clean floor), `blockH.png` for each block height, `clean.png` (another clean floor, for
/// `calibrate check` and `capability`), `rod.png` and `object.png` (a test piece and a box on the stripe, to try the calibrated
/// rig on), and the true rig as `true.toml`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Example, from nothing to a rig that stops:
  nearfield twin study --camera 300 --laser 120 --view 97 --distance 500 --zone 600 --out study
  nearfield twin calibration --rig study/recommended.toml --block 30 --block 60 --out pictures
  nearfield calibrate lens --square 25 --view 97 --out lens.toml pictures/lens*.png
  nearfield calibrate rig --square 25 --lens lens.toml --floor pictures/board.png --stripe pictures/stripe.png \\
      --block 30=pictures/block30.png --block 60=pictures/block60.png --out robot.toml
  nearfield inspect --rig robot.toml pictures/clean.png pictures/rod.png pictures/object.png")]
pub struct Calibration {
    /// The rig: a rig file, or a built-in one (centre, side, wide).
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Directory to write into; it is made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Height of a block on the stripe, millimetres; may be given several times.
    #[arg(long = "block", value_name = "MM", default_values_t = [60.0, 120.0])]
    blocks: Vec<f64>,
    /// Side of one square of the board, millimetres; the board has 11 x 7 inner corners.
    #[arg(long, value_name = "MM", default_value_t = 25.0)]
    square: f64,
    /// Chooses the floor's pattern, the speckle and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Width along the stripe and depth of a block.
const BLOCK_MM: [f64; 2] = [200.0, 110.0];
/// A block must be this far below the laser to be lit from above.
const HIGHEST_SHARE: f64 = 0.8;

impl Calibration {
    /// Renders.
    ///
    /// # Errors
    /// A rig or block that cannot be used, a file that cannot be written.
    pub fn run(&self) -> anyhow::Result<()> {
        let rig = super::twin::load_rig(&self.rig)?;
        if !(5.0..=200.0).contains(&self.square) {
            bail!("--square {}: must be 5 to 200 millimetres", self.square);
        }
        let highest = HIGHEST_SHARE * rig.laser().origin.z;
        for block in &self.blocks {
            if !(5.0..=highest).contains(block) {
                bail!(
                    "--block {block}: must be 5 to {highest:.0} mm for this rig's laser; choose other blocks with --block"
                );
            }
        }
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make it", self.out.display()))?;
        let truth = self.out.join("true.toml");
        std::fs::write(&truth, rig_file::to_toml(&rig))
            .with_context(|| format!("{}: cannot write", truth.display()))?;
        self.boards(&rig)?;
        self.stripes(&rig)
    }

    fn boards(&self, rig: &Rig) -> anyhow::Result<()> {
        let board = PaintedBoard { corners: [11, 7], square_mm: self.square };
        let views = lens_views(&rig.camera().intrinsics, rig.image(), &board);
        for (index, camera) in (0_u64..).zip(&views) {
            let picture = board.render(camera, rig.image(), self.seed ^ (index << 32));
            grey(&self.out.join(format!("lens{index:02}.png")), &picture, rig.image())?;
        }
        let middle = rig.stripe().at((rig.stripe().start + rig.stripe().end) / 2.0);
        let lying = board.render(&seen_from(rig.camera(), middle), rig.image(), self.seed);
        grey(&self.out.join("board.png"), &lying, rig.image())
    }

    fn stripes(&self, rig: &Rig) -> anyhow::Result<()> {
        let view = Arc::new(View::new(rig));
        let middle = (rig.stripe().start + rig.stripe().end) / 2.0;
        let place = |object: SceneObject| Scene {
            objects: vec![SceneObject { along_mm: middle, ..object }],
            ..Scene::default()
        };
        let mut scenes = vec![
            ("stripe".to_owned(), Scene::default(), self.seed),
            ("clean".to_owned(), Scene::default(), self.seed.wrapping_add(1)),
            ("rod".to_owned(), place(across_stripe()), self.seed.wrapping_add(2)),
            (
                "object".to_owned(),
                place(block(rig, 45.0_f64.min(0.5 * rig.laser().origin.z))),
                self.seed.wrapping_add(3),
            ),
        ];
        for height in &self.blocks {
            scenes.push((format!("block{height}"), place(block(rig, *height)), self.seed));
        }
        let mut picture = Picture::black(0, 0);
        for (name, scene, seed) in scenes {
            Twin::new(Arc::clone(&view), &scene, seed)?.render_into(0, 1.0, &mut picture);
            colour(&self.out.join(format!("{name}.png")), &picture)?;
        }
        Ok(())
    }
}

/// A block that the sheet meets on its top, around the middle of it.
fn block(rig: &Rig, height_mm: f64) -> SceneObject {
    let reach = (rig.stripe().point.y - rig.laser().origin.y) * height_mm / rig.laser().origin.z;
    let [width_mm, depth_mm] = BLOCK_MM;
    let across = -reach;
    SceneObject { yaw_degrees: 0.0, ..carton("block", [width_mm, depth_mm, height_mm], across, "grey_card") }
}

/// A dark rod of 12 mm that lies across the stripe, as for the test of an installed sensor.
fn across_stripe() -> SceneObject {
    let shape = crate::twin::scene::Shape::Box { width_mm: 12.0, depth_mm: 200.0, height_mm: 12.0 };
    plain("rod", shape, -60.0, "rubber_black")
}

/// The camera, in a world whose origin is `place`.
fn seen_from(camera: &Camera, place: Vector) -> Camera {
    let translation = camera.pose.to_camera(place);
    Camera { intrinsics: camera.intrinsics, pose: Pose { translation, ..camera.pose } }
}

fn grey(path: &Path, picture: &[u8], size: ImageSize) -> anyhow::Result<()> {
    let (width, height) = (u32::from(size.width), u32::from(size.height));
    save(path, picture, width, height, image::ExtendedColorType::L8)
}

fn colour(path: &Path, picture: &Picture) -> anyhow::Result<()> {
    let (width, height) = (u32::try_from(picture.width)?, u32::try_from(picture.height)?);
    save(path, &picture.rgb, width, height, image::ExtendedColorType::Rgb8)
}

fn save(
    path: &Path,
    bytes: &[u8],
    width: u32,
    height: u32,
    kind: image::ExtendedColorType,
) -> anyhow::Result<()> {
    image::save_buffer(path, bytes, width, height, kind)
        .with_context(|| format!("{}: cannot write the picture", path.display()))?;
    say!("{}", path.display());
    Ok(())
}
