//! `nearfield twin`: pictures from the digital twin.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use nearfield_shared::rig::Rig;
use serde::Serialize;

use crate::rig_file;
use crate::twin::gallery::{self, CENTRE, GALLERY, Mounting, SIDE, Theme, WIDE};
use crate::twin::{ExpectedCutoff, Picture, Scene, Truth, Twin, View};

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
    /// List the ready-made scenes and rigs.
    Scenes,
}

/// Render pictures of a scene, each with its truth.
///
/// Writes into DIR: `frame_0000.png`, `frame_0001.png` ..., beside each a `.json` with the truth (gaps in millimetres
/// along the stripe, heights of the objects on it, the profile per millimetre), the rig as `rig.toml` and the scene
/// as `scene.toml`. Objects with a velocity move from frame to frame.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield twin scenes                                    what is ready-made
  nearfield twin render --scene box_45 --out box           one picture of a box, the built-in rig
  nearfield twin render --rig robot.toml --scene hand --out hand --frames 20
  nearfield twin render --scene random:7 --out seven       a random scene; the same number gives the same scene
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
        if !(0.1..=100_000.0).contains(&self.fps) {
            bail!("--fps {}: must be 0.1 to 100000", self.fps);
        }
        if !(0.0..=1.0).contains(&self.laser) {
            bail!("--laser {}: must be 0 to 1", self.laser);
        }
        let rig = load_rig(&self.rig)?;
        let scene = load_scene(&self.scene, &rig)?;
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make it", self.out.display()))?;
        write(&self.out.join("rig.toml"), rig_file::to_toml(&rig).as_bytes())?;
        write(&self.out.join("scene.toml"), toml::to_string(&scene).context("scene as TOML")?.as_bytes())?;
        let mut twin = Twin::new(Arc::new(View::new(&rig)), &scene, self.seed)?;
        let mut picture = Picture::black(0, 0);
        for frame in 0..self.frames {
            if frame > 0 {
                twin.place(&scene.after(f64::from(frame) / self.fps).objects)?;
            }
            twin.render_into(u64::from(frame), self.laser, &mut picture);
            self.save(frame, &picture, &twin.truth(self.laser))?;
        }
        Ok(())
    }

    fn save(&self, frame: u32, picture: &Picture, truth: &Truth) -> anyhow::Result<()> {
        let stem = self.out.join(format!("frame_{frame:04}"));
        let (png, json) = (stem.with_extension("png"), stem.with_extension("json"));
        let (width, height) = (u32::try_from(picture.width)?, u32::try_from(picture.height)?);
        image::save_buffer(&png, &picture.rgb, width, height, image::ExtendedColorType::Rgb8)
            .with_context(|| format!("{}: cannot write the picture", png.display()))?;
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
    let text = std::fs::read_to_string(name).with_context(|| {
        format!("{name}: neither a ready-made scene (`nearfield twin scenes` lists them) nor a readable file")
    })?;
    Scene::from_toml(&text).with_context(|| name.to_owned())
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
