//! `nearfield twin speed`: how many pictures a second the digital twin renders on this machine.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail};
use clap::Args;
use serde::Serialize;

use super::twin::{load_rig, load_scene};
use crate::twin::gallery::CENTRE;
use crate::twin::{Picture, Scene, Twin, View};

/// Columns of the camera's full picture.
const FULL_WIDTH: u16 = 2304;

/// Measure how many pictures a second are rendered on this machine.
///
/// Two sequences are rendered into memory: a scene in which nothing moves, and the same with every object moving
/// 2 mm a picture. Told are the median time of a picture, pictures a second, and a number made from all bytes of the
/// sequence: it is the same on any number of threads.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield twin speed                                     the built-in rig at 2304x1296, all cores
  nearfield twin speed --threads 1                         one thread; the same pictures
  nearfield twin speed --rig robot.toml --scene hand --json")]
pub struct Speed {
    /// Rig file, or a built-in rig (side, wide); left out: the built-in centre rig at 2304x1296.
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Scene file, or a ready-made scene (`nearfield twin scenes`).
    #[arg(long, default_value = "box_45", value_name = "SCENE")]
    scene: String,
    /// Pictures in each sequence.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    /// Threads; left out: one for each core.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// Chooses the floor's pattern, the speckle and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object a sequence on standard output.
    #[arg(long)]
    json: bool,
}

/// What one sequence took.
#[derive(Debug, Serialize)]
struct Measured {
    sequence: &'static str,
    width: usize,
    height: usize,
    threads: usize,
    frames: u32,
    median_ms: f64,
    frames_per_second: f64,
    /// FNV-1a over all bytes of all pictures, hexadecimal.
    digest: String,
}

impl Speed {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let rig = match &self.rig {
            Some(name) => load_rig(name)?,
            None => CENTRE.with_width(FULL_WIDTH).rig()?,
        };
        let scene = load_scene(&self.scene, &rig)?;
        if scene.objects.is_empty() {
            bail!("--scene {}: nothing in it can move; choose one with an object", self.scene);
        }
        let pool = threads(self.threads)?;
        let measured = pool.install(|| -> anyhow::Result<[Measured; 2]> {
            let mut twin = Twin::new(Arc::new(View::new(&rig)), &scene, self.seed)?;
            Ok([self.measure(&mut twin, &scene, "still")?, self.measure(&mut twin, &scene, "moving")?])
        })?;
        for sequence in measured {
            if self.json {
                say!("{}", serde_json::to_string(&sequence)?);
            } else {
                say!(
                    "{:<6}  {}x{}, {} threads: {:.1} pictures/s (median {:.1} ms of {}), digest {}",
                    sequence.sequence,
                    sequence.width,
                    sequence.height,
                    sequence.threads,
                    sequence.frames_per_second,
                    sequence.median_ms,
                    sequence.frames,
                    sequence.digest,
                );
            }
        }
        Ok(())
    }

    fn measure(&self, twin: &mut Twin, scene: &Scene, sequence: &'static str) -> anyhow::Result<Measured> {
        let mut picture = Picture::black(0, 0);
        let mut times = Vec::new();
        let mut digest = 0xCBF2_9CE4_8422_2325;
        let mut objects = scene.objects.clone();
        for frame in 0..self.frames {
            let started = Instant::now();
            if sequence == "moving" {
                objects.iter_mut().for_each(|object| object.along_mm += 2.0);
                twin.place(&objects)?;
            }
            twin.render_into(u64::from(frame), 1.0, &mut picture);
            times.push(started.elapsed().as_secs_f64() * 1e3);
            digest = fold(digest, &picture.rgb);
        }
        times.sort_by(f64::total_cmp);
        let median_ms = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
        Ok(Measured {
            sequence,
            width: picture.width,
            height: picture.height,
            threads: rayon::current_num_threads(),
            frames: self.frames,
            median_ms,
            frames_per_second: 1e3 / median_ms,
            digest: format!("{digest:016x}"),
        })
    }
}

/// FNV-1a, eight bytes at a time.
fn fold(digest: u64, bytes: &[u8]) -> u64 {
    bytes.chunks(8).fold(digest, |digest, chunk| {
        let word = chunk.iter().fold(0, |word, byte| word << 8 | u64::from(*byte));
        (digest ^ word).wrapping_mul(0x0100_0000_01B3)
    })
}

/// A pool of so many threads, or one for each core.
pub(super) fn threads(count: Option<u16>) -> anyhow::Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(count.map_or(0, usize::from))
        .build()
        .context("cannot start the threads for rendering")
}
