//! `nearfield twin`: pictures from the digital twin.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use indicatif::ProgressBar;
use nearfield_shared::rig::Rig;
use serde::Serialize;

use crate::capture::{Frame, Pixels, RawFormat};
use crate::rig_file;
use crate::twin::gallery::{self, CENTRE, GALLERY, Mounting, SIDE, Theme, WIDE};
use crate::twin::{ExpectedCutoff, Picture, Scene, SceneError, Sequence, Truth};

/// Pictures from the digital twin, with the exact truth about them.
#[derive(Debug, Args)]
pub struct TwinArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(Render),
    Calibration(super::twin_calibration::Calibration),
    Study(super::study::Study),
    Speed(super::twin_speed::Speed),
    Compare(super::twin_compare::Compare),
    /// List the ready-made scenes and rigs.
    Scenes,
}

/// Render pictures of a scene, each with its truth.
///
/// Writes into DIR: `frame_0000.png`, `frame_0001.png` ..., beside each a `.json` with the truth (gaps in millimetres
/// along the stripe, heights of the objects on it, the profile per millimetre), the rig as `rig.toml` and the scene
/// as `scene.toml`. Objects with a velocity move from frame to frame.
///
/// In a scene file also:
///
/// `[robot]` velocity_mm_per_s, vibration_mm, vibration_hz: camera and laser move; the truth's `moment` says where they are.
///
/// `[look]` exposure_ms (what moves is smeared by its way in that time; the truth's `blur` tells it), row_time_us (rolling
/// shutter), vignetting (share of light lost in the farthest corner), bounce (1: lit bodies throw light on what is around
/// them), led_band_mm (a red LED's wide, dim band instead of the laser).
///
/// `[floor]` wave_mm, wave_length_mm (a floor that is not level: so high, so far apart; the truth's `profile` tells the
/// height), image = { file = "floor.png", width_mm = 600.0 } (a picture of a floor, laid side by side over the whole floor).
///
/// `[dirt]` smudges, dust (how many; the seed says where), strength (0 to 1), and `[[dirt.spots]]` kind ("smudge" or
/// "dust"), at (shares of width and height), radius (share of the width), strength: dirt on the lens. The truth's `dirt`
/// and `profile.clear` tell what it takes away.
///
/// A material of an object may be one's own: { albedo = [0.7, 0.7, 0.6], laser_albedo = 0.7, translucency = 0.85,
/// scatter_mm = 4.0 } (gloss, tightness too); translucent ones by name are wax_white, plastic_milky, plastic_clear.
///
/// `host/SCENES.md` in the repository shows a scene file with all of it, and each one's rule; `nearfield_host::twin::truth`
/// documents every field of the truth.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield twin scenes                                    what is ready-made
  nearfield twin render --scene box_45 --out box           one picture of a box, the built-in rig
  nearfield twin render --rig robot.toml --scene hand --out hand --frames 20
  nearfield twin render --scene random:7 --out seven       a random scene; the same number gives the same scene
  nearfield twin render --scene hand --format srggb10p --out raw      raw Bayer, as libcamera's SRGGB10_CSI2P
  nearfield twin render --scene mine.toml --out mine       a scene of your own; start from the scene.toml of another
  nearfield inspect --rig box/rig.toml box/frame_0000.png  what the sensor makes of it")]
struct Render {
    /// Rig file, or a built-in rig: centre, side, wide.
    #[arg(long, default_value = "centre", value_name = "RIG")]
    rig: String,
    /// Scene file, a ready-made scene (see `nearfield twin scenes`), or random:SEED, random-clean:SEED, random-thin:SEED.
    #[arg(long, value_name = "SCENE")]
    scene: String,
    /// Directory to write into; it is made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Chooses the floor's pattern, the speckle and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How many pictures.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Pictures per second of the scene's time.
    #[arg(long, default_value_t = 50.0)]
    fps: f64,
    /// Brightness command of the laser, 0 (off) to 1.
    #[arg(long, default_value_t = 1.0)]
    laser: f32,
    /// Kind of picture: png, pgm (brightness only), yuv, nv12, or raw Bayer: srggb10p, srggb12p (packed), srggb10, srggb12,
    /// srggb16 (16-bit words).
    #[arg(long, default_value = "png", value_parser = ["png", "pgm", "yuv", "nv12", "srggb10p", "srggb12p", "srggb10", "srggb12", "srggb16"])]
    format: String,
    /// Threads; left out: one for each core. The pictures are the same.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// One JSON object a picture on standard output.
    #[arg(long)]
    json: bool,
}

/// One line of `--json`.
#[derive(Serialize)]
struct Line<'a> {
    picture: &'a Path,
    truth: &'a Path,
    cutoff: ExpectedCutoff,
    longest_gap_mm: f64,
}

impl TwinArguments {
    /// Does what was asked.
    ///
    /// # Errors
    /// A rig or scene that cannot be used, or a file that cannot be written; the message says which.
    pub fn run(&self) -> anyhow::Result<u8> {
        match &self.command {
            Command::Render(render) => render.run()?,
            Command::Calibration(calibration) => calibration.run()?,
            Command::Study(study) => return study.run(),
            Command::Speed(speed) => speed.run()?,
            Command::Compare(compare) => compare.run()?,
            Command::Scenes => list()?,
        }
        Ok(0)
    }
}

fn list() -> anyhow::Result<()> {
    say!("Ready-made scenes (--scene):");
    for (name, note, _) in GALLERY {
        say!("  {name:<16} {note}");
    }
    say!("  random:SEED      one object of any kind on any floor in any light");
    say!("  random-thin:SEED a cable; random-clean:SEED nothing on the stripe");
    say!("Built-in rigs (--rig):");
    for (name, _, note) in RIGS {
        say!("  {name:<16} {note}");
    }
    Ok(())
}

/// Built-in rigs by name.
const RIGS: [(&str, Mounting, &str); 3] = [
    ("centre", CENTRE, "camera 400 mm and laser 200 mm over the floor, stripe 500 mm away, 1152x648"),
    ("side", SIDE, "both at one end of the stripe, which runs diagonally through the picture"),
    ("wide", WIDE, "as centre, with a 97 degree lens"),
];

impl Render {
    fn run(&self) -> anyhow::Result<()> {
        super::twin_speed::threads(self.threads)?.install(|| self.render())
    }

    fn render(&self) -> anyhow::Result<()> {
        if !(0.1..=100_000.0).contains(&self.fps) {
            bail!("--fps {}: must be 0.1 to 100000", self.fps);
        }
        if !(0.0..=1.0).contains(&self.laser) {
            bail!("--laser {}: must be 0 to 1", self.laser);
        }
        let rig = load_rig(&self.rig)?;
        let mut scene = load_scene(&self.scene, &rig)?;
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make it", self.out.display()))?;
        write(&self.out.join("rig.toml"), rig_file::to_toml(&rig).as_bytes())?;
        self.save_scene(&scene)?;
        let raw = RawFormat::from_extension(&self.format);
        scene.look.demosaiced &= raw.is_none();
        if scene.needs_sequence() && raw.is_some() {
            bail!(
                "--format {}: a moving robot, a rolling shutter and blur by motion are rendered as png, pgm, yuv or nv12",
                self.format
            );
        }
        let mut sequence = Sequence::new(&rig, &scene, self.seed)?;
        let bar = progress(self.frames);
        for frame in 0..self.frames {
            let seconds = f64::from(frame) / self.fps;
            let number = u64::from(frame);
            let (bytes, truth) = if let Some(raw) = raw {
                let (mosaic, truth) = sequence.mosaic(number, seconds, self.laser)?;
                (raw.write(usize::from(rig.image().width), &mosaic), truth)
            } else {
                let (picture, truth) = sequence.picture(number, seconds, self.laser)?;
                (encode(&picture, &self.format)?, truth)
            };
            self.save(frame, &bytes, &truth)?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// The scene as a file, with a copy of its floor's picture, so that the folder can be moved.
    fn save_scene(&self, scene: &Scene) -> anyhow::Result<()> {
        let mut scene = scene.clone();
        if let Some(image) = &mut scene.floor.image {
            let extension = image.file.extension().and_then(|extension| extension.to_str()).unwrap_or("png");
            let name = format!("floor.{extension}");
            let bytes = std::fs::read(&image.file)
                .with_context(|| format!("{}: cannot read it again", image.file.display()))?;
            write(&self.out.join(&name), &bytes)?;
            image.file = name.into();
        }
        write(&self.out.join("scene.toml"), toml::to_string(&scene).context("scene as TOML")?.as_bytes())
    }

    fn save(&self, frame: u32, bytes: &[u8], truth: &Truth) -> anyhow::Result<()> {
        let stem = self.out.join(format!("frame_{frame:04}"));
        let (png, json) = (stem.with_extension(&self.format), stem.with_extension("json"));
        write(&png, bytes)?;
        write(&json, &serde_json::to_vec(truth)?)?;
        if self.json {
            let line = Line {
                picture: &png,
                truth: &json,
                cutoff: truth.cutoff,
                longest_gap_mm: truth.longest_gap_mm.any,
            };
            say!("{}", serde_json::to_string(&line)?);
        } else {
            say!("{}  {:?}, longest gap {:.1} mm", png.display(), truth.cutoff, truth.longest_gap_mm.any);
        }
        Ok(())
    }
}

/// A picture as a file of this kind.
fn encode(picture: &Picture, format: &str) -> anyhow::Result<Vec<u8>> {
    let frame = picture.to_rgb_frame()?;
    let (width, height) = (u32::try_from(picture.width)?, u32::try_from(picture.height)?);
    let bytes = |frame: Frame| match frame.pixels() {
        Pixels::Rgb(bytes) | Pixels::Grey(bytes) | Pixels::Yuv420(bytes) | Pixels::Nv12(bytes) => {
            bytes.clone()
        }
    };
    Ok(match format {
        "yuv" => bytes(picture.to_yuv420_frame()?),
        "nv12" => bytes(frame.to_nv12()),
        "pgm" => {
            // A monochrome camera behind the laser's band-pass sees what a colour camera's red pixels see.
            let red = picture.rgb.chunks_exact(3).map(|pixel| pixel[0]);
            format!("P5\n{width} {height}\n255\n").into_bytes().into_iter().chain(red).collect()
        }
        _ => {
            let mut png = std::io::Cursor::new(Vec::new());
            image::write_buffer_with_format(
                &mut png,
                &picture.rgb,
                width,
                height,
                image::ExtendedColorType::Rgb8,
                image::ImageFormat::Png,
            )
            .context("cannot encode the picture")?;
            png.into_inner()
        }
    })
}

fn progress(frames: u32) -> ProgressBar {
    let bar = if frames > 1 { ProgressBar::new(u64::from(frames)) } else { ProgressBar::hidden() };
    bar.set_message("rendering");
    bar
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("{}: cannot write", path.display()))
}

pub(super) fn load_rig(name: &str) -> anyhow::Result<Rig> {
    match RIGS.iter().find(|(known, ..)| *known == name) {
        Some((_, mounting, _)) => Ok(mounting.rig()?),
        None => Ok(rig_file::load(Path::new(name))?),
    }
}

pub(super) fn load_scene(name: &str, rig: &Rig) -> anyhow::Result<Scene> {
    if let Some(scene) = gallery::scene(name) {
        return Ok(scene);
    }
    for (prefix, theme) in
        [("random:", Theme::Object), ("random-clean:", Theme::Clean), ("random-thin:", Theme::Thin)]
    {
        if let Some(seed) = name.strip_prefix(prefix) {
            let seed =
                seed.parse().with_context(|| format!("--scene {name}: `{seed}` is no whole number"))?;
            return Ok(gallery::random_scene(seed, theme, rig.stripe()));
        }
    }
    match Scene::load(Path::new(name)) {
        Err(error @ SceneError::Read { .. }) => Err(error).with_context(|| {
            format!(
                "{name}: neither a ready-made scene (`nearfield twin scenes` lists them) nor a readable file"
            )
        }),
        other => other.with_context(|| name.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_found_by_name_by_seed_and_by_file_and_mistakes_are_explained() {
        let rig = load_rig("side").unwrap();
        assert_eq!(load_scene("box_45", &rig).unwrap().objects[0].name, "box");
        assert_eq!(load_scene("random:7", &rig).unwrap(), load_scene("random:7", &rig).unwrap());
        let message = |name: &str| format!("{:#}", load_scene(name, &rig).unwrap_err());
        assert!(message("random:x").contains("`x` is no whole number"));
        assert!(message("bx_45").contains("nearfield twin scenes"));
        assert!(format!("{:#}", load_rig("no.toml").unwrap_err()).contains("no.toml"));
    }
}
