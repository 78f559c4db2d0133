//! A stage for the safety controller: a rig, line-scans of floors and things on them, and sessions that are armed.

use nearfield_host::link::{FrameFacts, InProcess, LinkError, McuLink, McuSession};
use nearfield_host::rig_file;
use nearfield_shared::columns::{Decimation, StripeGeometry};
use nearfield_shared::limits::LARGEST_COLUMN_COUNT;
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::{SignalQuality, SubpixelRow};
use std::path::Path;

/// Frames of clean floor after which a fresh controller waits for its reset button.
pub const READY_FRAMES: u32 = 25;
/// Frames from the press of the button until the relays are certainly closed: press, dark test, light again.
pub const ARMING_FRAMES: u32 = 35;

/// A rig and its column maps.
pub struct Stage {
    /// The rig.
    pub rig: Rig,
    geometry: Box<StripeGeometry<LARGEST_COLUMN_COUNT>>,
}

impl Stage {
    /// The rig file of this name among the test pictures.
    ///
    /// # Panics
    /// The test's own rig is missing or wrong.
    #[must_use]
    pub fn with_rig(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("pictures/rigs").join(name);
        let rig = rig_file::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let mut geometry = Box::new(StripeGeometry::empty());
        if let Err(error) = geometry.fill(&rig, Decimation::for_line_scan(rig.image().width)) {
            panic!("{name}: {error}");
        }
        Self { rig, geometry }
    }

    /// The rig for heights: camera over laser, both in the middle.
    #[must_use]
    pub fn new() -> Self {
        Self::with_rig("t2_std.toml")
    }

    /// A line-scan of this height profile: millimetres over the floor at stripe coordinate s, or no stripe.
    pub fn profile(&self, height_at: impl Fn(f32) -> Option<f32>) -> Vec<LineScanColumn> {
        (0..self.geometry.column_count())
            .map(|column| {
                let map = self.geometry.map(column)?;
                let row = SubpixelRow::from_pixels(map.row(height_at(map.floor_place)?))?;
                Some(LineScanColumn { row, quality: SignalQuality::new(200) })
            })
            .map(|column| column.unwrap_or(LineScanColumn::MISSING))
            .collect()
    }

    /// Clean floor.
    #[must_use]
    pub fn floor(&self) -> Vec<LineScanColumn> {
        self.profile(|_| Some(0.0))
    }

    /// Floor with something of this height (`None` = it hides the stripe) between two stripe coordinates.
    #[must_use]
    pub fn with_object(&self, from: f32, to: f32, height: Option<f32>) -> Vec<LineScanColumn> {
        self.profile(|s| if (from..to).contains(&s) { height } else { Some(0.0) })
    }

    /// A session with this controller, powered up, that has seen `frames` frames of clean floor.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn session(&self, link: Box<dyn McuLink>, frames: u32) -> Result<McuSession, LinkError> {
        let mut session = McuSession::start(link, &self.rig)?;
        run_clean(&mut session, self, frames)?;
        Ok(session)
    }

    /// As [`Self::session`], reset and running.
    ///
    /// # Errors
    /// The controller cannot be reached.
    ///
    /// # Panics
    /// The relays do not close.
    pub fn armed_with(&self, link: Box<dyn McuLink>) -> Result<McuSession, LinkError> {
        let mut session = self.session(link, READY_FRAMES)?;
        session.press_reset();
        run_clean(&mut session, self, ARMING_FRAMES)?;
        assert!(session.relay_closed(), "not armed: {:?}", session.status());
        Ok(session)
    }

    /// An armed in-process session.
    ///
    /// # Panics
    /// The relays do not close.
    #[must_use]
    pub fn armed(&self) -> McuSession {
        self.armed_with(Box::new(InProcess::new())).unwrap_or_else(|error| panic!("{error}"))
    }
}

impl Default for Stage {
    fn default() -> Self {
        Self::new()
    }
}

/// Runs frames of clean floor.
///
/// # Errors
/// The controller cannot be reached.
pub fn run_clean(session: &mut McuSession, stage: &Stage, frames: u32) -> Result<(), LinkError> {
    let floor = stage.floor();
    (0..frames).try_for_each(|_| session.run_columns(&floor, FrameFacts::default()))
}
