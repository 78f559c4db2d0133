//! The safety controller behind `inspect`, `replay` and `evaluate-scenes`: armed on a clean floor, then shown pictures.

use clap::ValueEnum;
use nearfield_shared::causes::{StopCause, StopCauses};
use nearfield_shared::columns::{Decimation, GeometryError, StripeGeometry};
use nearfield_shared::limits::{LARGEST_COLUMN_COUNT, VOTE_FRAMES};
use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::rig::Rig;
use nearfield_shared::units::{Micros, SignalQuality, SubpixelRow};
use serde::Serialize;

use crate::link::{Emulated, FrameFacts, InProcess, LinkError, McuLink, McuSession};

/// Which safety controller to ask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum McuChoice {
    /// The firmware's library in this process.
    #[default]
    InProcess,
    /// The firmware's binary in QEMU (`cargo xtask setup` installs it, `cargo xtask firmware` builds the binary).
    Emulated,
}

impl McuChoice {
    /// Such a controller, without power.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn link(self) -> Result<Box<dyn McuLink>, LinkError> {
        Ok(match self {
            Self::InProcess => Box::new(InProcess::new()),
            Self::Emulated => Box::new(Emulated::new()?),
        })
    }

    /// Powers up such a controller that has this rig stored.
    ///
    /// # Errors
    /// The controller cannot be started.
    pub fn start(self, rig: &Rig) -> Result<McuSession, LinkError> {
        McuSession::start(self.link()?, rig)
    }
}

/// The controller's verdict, as programs read it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct McuVerdict {
    /// `open` (stopped) or `closed`.
    pub relay: &'static str,
    /// Why it stopped; the restart interlock, which follows every stop, is not told.
    pub causes: Vec<&'static str>,
    /// Longest gap in the stripe, millimetres; 0 if it is whole.
    pub longest_gap_mm: f32,
    /// Highest point of the stripe over the floor, millimetres; `None` if nothing is raised.
    pub highest_mm: Option<f32>,
}

impl McuVerdict {
    /// What a session shows now: contacts, and all causes since they were last armed.
    #[must_use]
    pub fn of(session: &McuSession) -> Self {
        let status = session.status();
        Self {
            relay: relay_name(session.relay_closed()),
            causes: cause_names(status.live_causes.union(status.latched_causes)),
            longest_gap_mm: status.longest_gap.map_or(0.0, |gap| gap.length().get()),
            highest_mm: status.highest.map(|highest| highest.height.get()),
        }
    }

    /// May the machine run?
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.relay == relay_name(true)
    }
}

/// `closed` or `open`.
#[must_use]
pub const fn relay_name(closed: bool) -> &'static str {
    if closed { "closed" } else { "open" }
}

/// The names of causes, without the interlock's.
#[must_use]
pub fn cause_names(causes: StopCauses) -> Vec<&'static str> {
    causes.without(StopCause::Interlock).iter().map(StopCause::name).collect()
}

/// The line-scan of a rig's floor with nothing on it and every column seen at its best.
///
/// # Errors
/// [`GeometryError`] if the rig's picture does not resolve the stripe.
pub fn clean_floor(rig: &Rig) -> Result<Vec<LineScanColumn>, GeometryError> {
    let decimation = Decimation::for_line_scan(rig.image().width);
    let mut geometry = Box::new(StripeGeometry::<LARGEST_COLUMN_COUNT>::empty());
    geometry.fill(rig, decimation)?;
    Ok((0..usize::from(decimation.count()))
        .map(|column| {
            let row = geometry.map(column).and_then(|map| SubpixelRow::from_pixels(map.floor_row));
            row.map_or(LineScanColumn::MISSING, |row| LineScanColumn { row, quality: SignalQuality::BEST })
        })
        .collect())
}

/// Time after power-up or a stop until the button is pressed: self-test, pulse tests, a healthy link.
const BEFORE_RESET: Micros = Micros::from_millis(300);
/// Time from then until the button is certainly up again.
const BUTTON_UP: Micros = Micros::from_millis(400);
/// Time from then in which the contacts must have closed.
const UNTIL_CLOSED: Micros = Micros::from_millis(1000);

/// Shows `columns` and presses the reset button once, until the contacts are closed or would long have been. True if
/// they are.
///
/// # Errors
/// The controller cannot be reached.
pub fn arm(session: &mut McuSession, columns: &[LineScanColumn]) -> Result<bool, LinkError> {
    let started = session.now();
    let mut pressed: Option<Micros> = None;
    loop {
        session.run_columns(columns, FrameFacts::default())?;
        match pressed {
            None if session.now().since(started) >= BEFORE_RESET => {
                session.press_reset();
                pressed = Some(session.now());
            }
            None => {}
            Some(pressed) => {
                let waited = session.now().since(pressed);
                if waited >= UNTIL_CLOSED || (waited >= BUTTON_UP && session.relay_closed()) {
                    return Ok(session.relay_closed());
                }
            }
        }
    }
}

/// Frames that relay contacts need to follow their command.
const CONTACT_FRAMES: usize = 3;

/// A controller that judges pictures one by one: armed on a clean floor each time, then shown the picture until its
/// vote is full and its contacts have followed.
pub struct Examiner {
    choice: McuChoice,
    rig: Rig,
    session: McuSession,
    clean: Vec<LineScanColumn>,
}

impl Examiner {
    /// Powers up a controller for a rig.
    ///
    /// # Errors
    /// The controller cannot be started, or the rig's picture does not resolve the stripe.
    pub fn new(choice: McuChoice, rig: &Rig) -> anyhow::Result<Self> {
        Ok(Self { choice, rig: *rig, session: choice.start(rig)?, clean: clean_floor(rig)? })
    }

    /// The controller's verdict on one picture's line-scan. The host asks for nothing: the verdict is the
    /// controller's own.
    ///
    /// # Errors
    /// The controller cannot be reached.
    pub fn judge(&mut self, columns: &[LineScanColumn]) -> Result<McuVerdict, LinkError> {
        if !arm(&mut self.session, &self.clean)? {
            // A fault that only a power cycle clears must not answer for the next picture.
            self.session = self.choice.start(&self.rig)?;
            arm(&mut self.session, &self.clean)?;
        }
        for _ in 0..VOTE_FRAMES + CONTACT_FRAMES {
            self.session.run_columns(columns, FrameFacts::default())?;
        }
        Ok(McuVerdict::of(&self.session))
    }
}
