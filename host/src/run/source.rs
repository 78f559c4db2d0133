//! Where pictures come from: the twin, a folder again and again, or a program that writes YUV420 into a pipe.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use nearfield_configuration::Camera;
use nearfield_operator::commission::Hands;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::units::Micros;

use super::mailbox::{Fetched, Mailbox, Reader};
use super::twin_hands::TwinHands;
use crate::capture::{Frame, Pixels, is_picture_name, read_frame};
use crate::twin::{Picture, Scene, SceneObject, Sequence, Twin, View};

/// Delivers pictures.
pub trait Source: Send {
    /// Waits for the next picture, no longer than some frame periods; `drive` is the laser's mean drive over its exposure,
    /// 0 to 1, which only the twin needs. `false` = none came in time.
    ///
    /// # Errors
    /// The source is broken; it may be opened again.
    fn advance(&mut self, drive: f32) -> anyhow::Result<bool>;

    /// The picture that [`Self::advance`] has brought last; empty before the first.
    fn frame(&self) -> &Frame;

    /// How long before [`Self::advance`] returned the stripe was exposed (the middle of it), by the camera's own stamps; `None` =
    /// it does not tell, and the usual delay counts.
    fn age(&self) -> Option<Micros> {
        None
    }
}

/// Gains of red and blue, fixed: white balance must not follow the laser. A neutral floor under warm white light, roughly.
pub const WHITE_BALANCE: [f32; 2] = [1.5, 1.5];

/// Made-up pictures, lit by the laser as the controller drives it.
pub struct TwinSource {
    twin: Twin,
    /// What moves, and from picture to picture how long; `None` = nothing does.
    moving: Option<(Scene, f64)>,
    /// The same where one moment is not enough: a moving robot, a rolling shutter, blur by motion.
    sequence: Option<(Sequence, f64)>,
    /// What lies there by itself, and who lays a test piece beside it.
    hands: Option<(Vec<SceneObject>, TwinHands)>,
    picture: Picture,
    number: u64,
    frame: Frame,
}

impl TwinSource {
    /// Of this scene before this rig.
    ///
    /// # Errors
    /// The scene cannot be used.
    pub fn new(rig: &Rig, scene: &Scene, seed: u64) -> anyhow::Result<Self> {
        let twin = Twin::new(Arc::new(View::new(rig)), scene, seed)?;
        Ok(Self {
            twin,
            moving: None,
            sequence: None,
            hands: None,
            picture: Picture::black(0, 0),
            number: 0,
            frame: Frame::empty(),
        })
    }

    /// Objects with a velocity and a robot with one move, so many pictures a second; rows are exposed one after the other and for
    /// as long as the scene says.
    ///
    /// # Errors
    /// The scene cannot be used.
    pub fn moving(self, scene: &Scene, seed: u64, frames_per_second: f64) -> anyhow::Result<Self> {
        let period = 1.0 / frames_per_second;
        if scene.needs_sequence() {
            let sequence = Sequence::new(self.twin.view().rig(), scene, seed)?;
            return Ok(Self { sequence: Some((sequence, period)), ..self });
        }
        let moves = scene.objects.iter().any(|object| object.velocity_mm_per_s != [0.0; 2]);
        Ok(Self { moving: moves.then(|| (scene.clone(), period)), ..self })
    }

    /// Who lays a test piece into this scene, if nothing in it moves.
    #[must_use]
    pub fn with_hands(self, scene: &Scene, hands: Hands) -> Self {
        let is_still = self.moving.is_none() && self.sequence.is_none();
        let hands = is_still.then(|| (scene.objects.clone(), TwinHands::new(hands)));
        Self { hands, ..self }
    }
}

impl Source for TwinSource {
    fn advance(&mut self, drive: f32) -> anyhow::Result<bool> {
        if let Some((scene, period)) = &self.moving {
            self.twin.place(&scene.after(self.number as f64 * period).objects)?;
        }
        if let Some((lying, hands)) = &mut self.hands
            && let Some(piece) = hands.change()
        {
            let all: Vec<SceneObject> = lying.iter().cloned().chain(piece).collect();
            self.twin.place(&all)?;
        }
        match &mut self.sequence {
            Some((sequence, period)) => {
                let seconds = self.number as f64 * *period;
                (self.picture, _) = sequence.picture(self.number, seconds, drive)?;
            }
            None => self.twin.render_into(self.number, drive, &mut self.picture),
        }
        self.number += 1;
        self.frame = self.picture.to_yuv420_frame()?;
        Ok(true)
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }
}

/// Steps of the laser's drive in [`TwinLoop`]: the controller's three levels (off, three fifths, full) are among them.
const DRIVE_STEPS: u8 = 20;
/// Pictures with other noise for every step.
const NOISES: u64 = 2;

/// The twin's pictures for every drive of the laser, made at the start and shown again and again: fifty a second and more, where
/// rendering takes longer than a frame period. Nothing in them moves. Clones show the same pictures.
#[derive(Clone)]
pub struct TwinLoop {
    /// All noises of the darkest step first.
    pictures: Arc<[Frame]>,
    shown: Option<usize>,
    number: u64,
}

impl TwinLoop {
    /// Of this scene before this rig. It takes seconds, and 42 pictures' memory.
    ///
    /// # Errors
    /// The scene cannot be used.
    pub fn new(rig: &Rig, scene: &Scene, seed: u64) -> anyhow::Result<Self> {
        let twin = Twin::new(Arc::new(View::new(rig)), scene, seed)?;
        let mut picture = Picture::black(0, 0);
        let mut pictures = Vec::new();
        for step in 0..=DRIVE_STEPS {
            for noise in 0..NOISES {
                let drive = f32::from(step) / f32::from(DRIVE_STEPS);
                twin.render_into(u64::from(step) * NOISES + noise, drive, &mut picture);
                pictures.push(picture.to_yuv420_frame()?);
            }
        }
        Ok(Self { pictures: pictures.into(), shown: None, number: 0 })
    }
}

impl Source for TwinLoop {
    fn advance(&mut self, drive: f32) -> anyhow::Result<bool> {
        let drive = if drive.is_finite() { drive.clamp(0.0, 1.0) } else { 0.0 };
        let step = (drive * f32::from(DRIVE_STEPS)).round() as usize;
        let noise = (self.number % NOISES) as usize;
        self.number += 1;
        self.shown = Some(step * NOISES as usize + noise);
        Ok(true)
    }

    fn frame(&self) -> &Frame {
        const NONE: &Frame = &Frame::empty();
        self.shown.and_then(|index| self.pictures.get(index)).unwrap_or(NONE)
    }
}

/// The pictures of a folder, in the order of their names, again and again.
pub struct FolderSource {
    pictures: Vec<PathBuf>,
    size: ImageSize,
    next: usize,
    frame: Frame,
}

impl FolderSource {
    /// All pictures in it.
    ///
    /// # Errors
    /// The folder cannot be read or holds no picture.
    pub fn new(folder: &Path, size: ImageSize) -> anyhow::Result<Self> {
        let failed = || format!("{}: cannot read the folder", folder.display());
        let mut pictures = Vec::new();
        for entry in std::fs::read_dir(folder).with_context(failed)? {
            let path = entry.with_context(failed)?.path();
            if path.is_file() && is_picture_name(&path) {
                pictures.push(path);
            }
        }
        pictures.sort();
        if pictures.is_empty() {
            bail!("{}: no pictures in it (PNG, JPEG, PGM or raw frames)", folder.display());
        }
        Ok(Self { pictures, size, next: 0, frame: Frame::empty() })
    }
}

impl Source for FolderSource {
    fn advance(&mut self, _drive: f32) -> anyhow::Result<bool> {
        let path = &self.pictures[self.next % self.pictures.len()];
        self.next += 1;
        self.frame = read_frame(path, self.size)?;
        Ok(true)
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }
}

/// A program that writes YUV420 pictures into its standard output, read by a thread: the newest picture wins.
pub struct PipeSource {
    child: Child,
    pictures: Reader<Frame>,
    longest: Duration,
}

impl PipeSource {
    /// `rpicam-vid` with everything fixed: exposure, gain, white balance, focus. **Built, not run on hardware.**
    ///
    /// # Errors
    /// It cannot be started.
    pub fn rpicam_vid(camera: &Camera) -> anyhow::Result<Self> {
        let mut command = Command::new("rpicam-vid");
        command.args(rpicam_arguments(camera));
        Self::start(command, camera).context(
            "cannot start rpicam-vid; `sudo apt install rpicam-apps-lite` installs it on a Raspberry Pi",
        )
    }

    /// A program by its line, split at blanks.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn command_line(line: &str, camera: &Camera) -> anyhow::Result<Self> {
        let mut words = line.split_whitespace();
        let program = words.next().context("camera.input names no program")?;
        let mut command = Command::new(program);
        command.args(words);
        Self::start(command, camera).with_context(|| format!("cannot start {program} (camera.input)"))
    }

    /// Any program.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(mut command: Command, camera: &Camera) -> anyhow::Result<Self> {
        let (width, height) = (u16::try_from(camera.width)?, u16::try_from(camera.height)?);
        let size = ImageSize { width, height };
        let length = usize::from(width) * usize::from(height) * 3 / 2;
        // The layout is checked once, here; every later picture has it.
        Frame::new(size, Pixels::Yuv420(vec![0; length]))?;
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
        let stdout = child.stdout.take().context("the program has no standard output")?;
        let (writer, pictures) = Mailbox::pair_of(Frame::empty);
        std::thread::Builder::new()
            .name("capture".to_owned())
            .spawn(move || read_pictures(stdout, size, writer))?;
        let longest = Duration::from_secs_f64(3.0 / camera.frames_per_second);
        Ok(Self { child, pictures, longest })
    }
}

/// Until the pipe ends: the writer's end then closes the mailbox.
fn read_pictures(mut pipe: ChildStdout, size: ImageSize, mut writer: super::mailbox::Writer<Frame>) {
    let length = usize::from(size.width) * usize::from(size.height) * 3 / 2;
    let mut bytes = vec![0; length];
    while pipe.read_exact(&mut bytes).is_ok() {
        writer.offer(|frame| frame.fill_yuv420(size, &bytes));
    }
}

impl Source for PipeSource {
    fn advance(&mut self, _drive: f32) -> anyhow::Result<bool> {
        match self.pictures.wait(self.longest) {
            Fetched::New(_) => Ok(true),
            Fetched::Nothing => Ok(false),
            Fetched::Closed => bail!("the camera's program has ended"),
        }
    }

    fn frame(&self) -> &Frame {
        self.pictures.last()
    }
}

impl Drop for PipeSource {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Fixed exposure, gain, white balance and focus; no preview, no end, YUV420 to standard output.
fn rpicam_arguments(camera: &Camera) -> Vec<String> {
    let exposure = camera.exposure_us.to_string();
    let pairs = [
        ("--codec", "yuv420".to_owned()),
        ("--output", "-".to_owned()),
        ("--timeout", "0".to_owned()),
        ("--width", camera.width.to_string()),
        ("--height", camera.height.to_string()),
        ("--framerate", camera.frames_per_second.to_string()),
        ("--shutter", exposure),
        ("--gain", camera.gain.to_string()),
        ("--awbgains", format!("{},{}", WHITE_BALANCE[0], WHITE_BALANCE[1])),
        ("--autofocus-mode", "manual".to_owned()),
        ("--lens-position", camera.focus.to_string()),
        ("--denoise", "off".to_owned()),
    ];
    let mut arguments: Vec<String> =
        pairs.into_iter().flat_map(|(name, value)| [name.to_owned(), value]).collect();
    arguments.extend(["--nopreview".to_owned(), "--flush".to_owned()]);
    arguments
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_configuration::Configuration;

    fn camera(text: &str) -> Camera {
        Configuration::read(&format!("[camera]\n{text}"), Path::new("x.toml")).unwrap().camera
    }

    #[test]
    fn a_pipe_delivers_whole_pictures_and_its_end_is_told() {
        let camera = camera("width = 64\nheight = 64\nframes_per_second = 5");
        let mut command = Command::new("sh");
        command.args(["-c", "head -c 6144 /dev/zero; sleep 0.3; head -c 6144 /dev/zero | tr '\\0' '\\7'; head -c 100 /dev/zero"]);
        let mut source = PipeSource::start(command, &camera).unwrap();
        let mut seen = Vec::new();
        let ended = loop {
            match source.advance(1.0) {
                Ok(true) => seen.push(source.frame().clone()),
                Ok(false) => {}
                Err(error) => break error,
            }
        };
        assert_eq!(ended.to_string(), "the camera's program has ended");
        let size = ImageSize { width: 64, height: 64 };
        let expected = Frame::new(size, Pixels::Yuv420(vec![7; 6144])).unwrap();
        assert_eq!(seen.last(), Some(&expected), "the last whole picture, not the piece after it");
    }

    #[test]
    fn a_program_that_is_not_there_is_named_with_what_to_do() {
        if Command::new("rpicam-vid").arg("--version").output().is_ok() {
            return;
        }
        let error = PipeSource::rpicam_vid(&camera("source = \"rpicam-vid\"")).err().unwrap();
        assert!(format!("{error:#}").contains("rpicam-apps"), "{error:#}");
    }

    #[test]
    fn everything_that_could_regulate_the_code_away_is_fixed() {
        let arguments = rpicam_arguments(&camera("exposure_us = 3000\ngain = 4.0\nfocus_dioptres = 2.5"));
        for pair in [
            ["--shutter", "3000"],
            ["--gain", "4"],
            ["--lens-position", "2.5"],
            ["--autofocus-mode", "manual"],
        ] {
            assert!(arguments.windows(2).any(|two| two == pair), "{pair:?}: {arguments:?}");
        }
    }

    #[test]
    fn a_folder_without_pictures_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let size = ImageSize { width: 64, height: 64 };
        let error = FolderSource::new(folder.path(), size).err().unwrap();
        assert!(error.to_string().contains("no pictures in it"), "{error}");
        assert!(FolderSource::new(Path::new("/no/such"), size).is_err());
    }
}
