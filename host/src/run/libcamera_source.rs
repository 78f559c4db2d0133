//! libcamera itself, in a thread of its own: everything fixed, the newest picture wins, and every picture with the sensor's own time.
//!
//! **Built, not run on hardware.** It was linked with libcamera 0.4 and started where there is no camera.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::{Context as _, bail, ensure};
use libcamera::camera::ActiveCamera;
use libcamera::camera_manager::CameraManager;
use libcamera::control::{ControlEntry as _, ControlInfoMap, ControlList};
use libcamera::controls::{
    AeEnable, AfMode, AnalogueGain, AwbEnable, ColourGains, ExposureTime, FrameDurationLimits, LensPosition,
    SensorTimestamp,
};
use libcamera::framebuffer_allocator::{FrameBuffer, FrameBufferAllocator};
use libcamera::framebuffer_map::MemoryMappedFrameBuffer;
use libcamera::geometry::Size;
use libcamera::pixel_format::PixelFormat;
use libcamera::request::{Request, RequestStatus, ReuseFlag};
use libcamera::stream::{Stream, StreamRole};
use libcamera::utils::UniquePtr;
use nearfield_configuration::Camera;
use nearfield_recording::Listener;
use nearfield_shared::rig::{ImageSize, Rig};
use nearfield_shared::units::Micros;

use super::mailbox::{Fetched, Mailbox, Reader, Writer};
use super::row_clock::RowClock;
use super::source::{Source, WHITE_BALANCE};
use crate::capture::Frame;

/// Planar YUV 4:2:0, `YU12`.
const YUV420: PixelFormat = PixelFormat::new(u32::from_le_bytes(*b"YU12"), 0);
/// One is exposed, one is read out, one is processed, one is looked at.
const BUFFERS: u32 = 4;
/// The end of the program is looked for so often.
const PATIENCE: Duration = Duration::from_millis(100);
/// What a camera may differ from what was asked of it: sensors count exposure in rows and gain in steps.
const TOLERANCE: f64 = 0.02;
/// Controls take effect some pictures after they were set.
const SETTLING: u32 = 20;

/// A picture and its time.
struct Taken {
    frame: Frame,
    /// Nanoseconds since power-up (`CLOCK_BOOTTIME`).
    stamp: u64,
}

/// See the module's documentation.
pub struct LibcameraSource {
    pictures: Reader<Taken>,
    problem: Receiver<anyhow::Error>,
    clock: RowClock,
    age: Option<Micros>,
    longest: Duration,
    _thread: Listener,
}

impl LibcameraSource {
    /// Opens the first camera and waits until it works.
    ///
    /// # Errors
    /// There is none, it is in use, or it cannot do what is asked of it.
    pub fn open(camera: &Camera, rig: &Rig) -> anyhow::Result<Self> {
        let (mut writer, pictures) = Mailbox::pair_of(|| Taken { frame: Frame::empty(), stamp: 0 });
        let (tell, problem) = sync_channel(1);
        let (ready, started) = sync_channel(1);
        let wanted = camera.clone();
        let thread = Listener::start("capture", 0, move |ending| {
            if let Err(error) = capture(&wanted, &mut writer, &ready, ending) {
                // Nobody waits for it any more only if the source is gone.
                let _ = tell.send(error);
            }
        })?;
        if started.recv().is_err() {
            // The thread has ended, and says why, before anything worked.
            return Err(problem.recv().context("libcamera's thread has ended without a word")?);
        }
        let read_out = Micros::new(u64::from(camera.read_out_us));
        let exposure = Micros::new(u64::from(camera.exposure_us));
        Ok(Self {
            pictures,
            problem,
            clock: RowClock::new(rig, read_out, exposure),
            age: None,
            longest: Duration::from_secs_f64(3.0 / camera.frames_per_second),
            _thread: thread,
        })
    }
}

impl Source for LibcameraSource {
    fn advance(&mut self, _drive: f32) -> anyhow::Result<bool> {
        match self.pictures.wait(self.longest) {
            Fetched::New(taken) => {
                self.age = Some(self.clock.age(taken.stamp, since_power_up())?);
                Ok(true)
            }
            Fetched::Nothing => Ok(false),
            Fetched::Closed => Err(self
                .problem
                .try_recv()
                .unwrap_or_else(|_| anyhow::anyhow!("libcamera's thread has ended"))),
        }
    }

    fn frame(&self) -> &Frame {
        &self.pictures.last().frame
    }

    fn age(&self) -> Option<Micros> {
        self.age
    }
}

/// The clock of the sensor's stamps, nanoseconds.
fn since_power_up() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    let whole = |number: i64| u64::try_from(number).unwrap_or(0);
    whole(now.tv_sec).saturating_mul(1_000_000_000).saturating_add(whole(now.tv_nsec))
}

/// Until the end or a problem; `ready` is told once pictures are on their way.
fn capture(
    camera: &Camera,
    writer: &mut Writer<Taken>,
    ready: &SyncSender<()>,
    ending: &AtomicBool,
) -> anyhow::Result<()> {
    let manager = CameraManager::new().context("libcamera cannot be started")?;
    let cameras = manager.cameras();
    let found = cameras.get(0).context(
        "libcamera sees no camera; check the ribbon cable, `rpicam-hello --list-cameras`, and the rights of this user (group video)",
    )?;
    let mut active = found.acquire().context("the camera is in use; end the other program")?;
    let (stream, stride) = configure(&mut active, camera)?;
    let mut allocator = FrameBufferAllocator::new(&active);
    let buffers = allocator.alloc(&stream).context("libcamera has no memory for pictures")?;
    let completed = active.subscribe_request_completed();
    let controls = fixed(camera, active.controls())?;
    active.start(Some(&controls)).context("the camera cannot be started")?;
    for buffer in buffers {
        let mapped = MemoryMappedFrameBuffer::new(buffer).context("a picture's memory cannot be read")?;
        let mut request = active.create_request(None).context("libcamera takes no request")?;
        request.add_buffer(&stream, mapped)?;
        queue(&active, request)?;
    }
    // Who waits for it may be gone; then the end is near.
    let _ = ready.send(());
    let size = ImageSize { width: u16::try_from(camera.width)?, height: u16::try_from(camera.height)? };
    let mut taken = 0_u32;
    while !ending.load(Ordering::Relaxed) {
        let mut request = match completed.recv_timeout(PATIENCE) {
            Ok(request) => request,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => bail!("libcamera has closed the camera"),
        };
        // A cancelled request has no picture; the source's watch notices if that goes on.
        if request.status() == RequestStatus::Complete {
            taken = taken.saturating_add(1);
            if taken > SETTLING {
                keeps(camera, request.metadata())?;
            }
            hand_over(&request, &stream, size, stride, writer)?;
        }
        request.reuse(ReuseFlag::REUSE_BUFFERS);
        queue(&active, request)?;
    }
    Ok(())
}

fn queue(active: &ActiveCamera<'_>, request: Request) -> anyhow::Result<()> {
    active.queue_request(request).map_err(|(_, error)| error).context("libcamera takes no request")
}

/// Format and size, exactly as asked; the stream, and the bytes from one row of brightness to the next.
fn configure(active: &mut ActiveCamera<'_>, camera: &Camera) -> anyhow::Result<(Stream, usize)> {
    let roles = [StreamRole::VideoRecording];
    let mut configuration =
        active.generate_configuration(&roles).context("the camera has no stream for video")?;
    {
        let mut stream = configuration.get_mut(0).context("the camera has no stream for video")?;
        stream.set_pixel_format(YUV420);
        stream.set_size(Size { width: camera.width, height: camera.height });
        stream.set_buffer_count(BUFFERS);
    }
    if configuration.validate().is_invalid() {
        bail!("the camera refuses {} x {} in YUV420; change [camera]", camera.width, camera.height);
    }
    {
        let offered = configuration.get(0).context("the camera has no stream for video")?;
        let (size, format) = (offered.get_size(), offered.get_pixel_format());
        ensure!(
            (size.width, size.height) == (camera.width, camera.height) && format == YUV420,
            "the camera offers {} x {} in {format}, not {} x {} in YUV420; change [camera]",
            size.width,
            size.height,
            camera.width,
            camera.height
        );
    }
    active.configure(&mut configuration).context("the camera cannot be configured")?;
    let offered = configuration.get(0).context("the camera has no stream for video")?;
    let stream = offered.stream().context("the camera has no stream for video")?;
    Ok((stream, usize::try_from(offered.get_stride())?))
}

/// Nothing may regulate the laser's code away: exposure, gain, white balance, frame rate and focus are set once.
fn fixed(camera: &Camera, known: &ControlInfoMap) -> anyhow::Result<UniquePtr<ControlList>> {
    let mut controls = ControlList::new();
    let period = (1e6 / camera.frames_per_second).round() as i64;
    controls.set(AeEnable(false))?;
    controls.set(ExposureTime(i32::try_from(camera.exposure_us)?))?;
    controls.set(AnalogueGain(camera.gain as f32))?;
    controls.set(AwbEnable(false))?;
    controls.set(ColourGains(WHITE_BALANCE))?;
    controls.set(FrameDurationLimits([period, period]))?;
    // A lens without a motor is focused by hand.
    if known.find(LensPosition::ID).is_ok() {
        controls.set(AfMode::Manual)?;
        controls.set(LensPosition(camera.focus as f32))?;
    }
    Ok(controls)
}

/// Does the camera do what it was told? A picture says how it was taken.
fn keeps(camera: &Camera, metadata: &ControlList) -> anyhow::Result<()> {
    let told = [
        (
            "exposure, us",
            metadata.get::<ExposureTime>().ok().map(|one| f64::from(*one)),
            f64::from(camera.exposure_us),
        ),
        ("gain", metadata.get::<AnalogueGain>().ok().map(|one| f64::from(*one)), camera.gain),
    ];
    for (name, found, wanted) in told {
        if let Some(found) = found {
            ensure!(
                (found - wanted).abs() <= wanted * TOLERANCE,
                "the camera's {name}: {found}, not {wanted} as configured; choose a value that it can keep"
            );
        }
    }
    Ok(())
}

fn hand_over(
    request: &Request,
    stream: &Stream,
    size: ImageSize,
    stride: usize,
    writer: &mut Writer<Taken>,
) -> anyhow::Result<()> {
    let stamp = request.metadata().get::<SensorTimestamp>();
    let stamp = stamp.context("the camera's pictures carry no time stamp; use \"rpicam-vid\"")?;
    let stamp = u64::try_from(*stamp).context("the camera's time stamp is negative")?;
    let buffer: &MemoryMappedFrameBuffer<FrameBuffer> =
        request.buffer(stream).context("a picture came without its memory")?;
    let planes = buffer.data();
    let [luma, blue, red] = planes.as_slice() else { bail!("a picture has {} planes, not 3", planes.len()) };
    let mut fits = true;
    writer.offer(|taken| {
        fits = taken.frame.fill_yuv420_rows(size, stride, [luma, blue, red]);
        taken.stamp = stamp;
    });
    ensure!(fits, "a picture is shorter than {} rows of {stride} bytes", size.height);
    Ok(())
}
