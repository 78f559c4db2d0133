//! Whatever controller is at the other end, as the stripe path sees it: simulated, or the board.

use nearfield_shared::linescan::LineScanColumn;
use nearfield_shared::status::{Challenge, Channels, Status};
use nearfield_shared::units::Micros;

use crate::light::LightReport;
use crate::link::board::{Board, BoardError, Bus, Transaction};
use crate::link::{FrameFacts, LinkError, McuSession};

/// Why a line-scan was not exchanged.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// A simulated controller.
    #[error(transparent)]
    Simulated(#[from] LinkError),
    /// The board. The next picture is another try.
    #[error(transparent)]
    Board(#[from] BoardError),
}

/// A controller that takes one line-scan a picture.
pub trait Controller {
    /// The clock that pictures are stamped with.
    fn now(&self) -> Micros;

    /// The columns that the newest status asks for.
    fn challenge(&self) -> Challenge;

    /// The newest status, if there is one to be believed.
    fn status(&self) -> Option<&Status>;

    /// May the robot move, as far as the controller's contacts tell?
    fn is_circuit_closed(&self) -> bool {
        self.status().is_some_and(|status| status.relay_readback == Channels::CLOSED)
    }

    /// A frame period without a picture: nothing is sent. Simulated time goes on, so that a simulated controller notices.
    ///
    /// # Errors
    /// The controller cannot be reached.
    fn skip(&mut self) -> Result<(), ControllerError>;

    /// The bytes of the last transaction, line-scan and answer, for the recorder; `None` = there is none, or it is told otherwise.
    fn last_transaction(&self) -> Option<(&Transaction, &Transaction)> {
        None
    }

    /// Sends a picture's line-scan.
    ///
    /// # Errors
    /// It was lost.
    fn send(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<(), ControllerError>;
}

impl Controller for McuSession {
    fn now(&self) -> Micros {
        Self::now(self)
    }

    fn challenge(&self) -> Challenge {
        *Self::challenge(self)
    }

    fn status(&self) -> Option<&Status> {
        Some(Self::status(self))
    }

    fn is_circuit_closed(&self) -> bool {
        self.relay_closed()
    }

    fn skip(&mut self) -> Result<(), ControllerError> {
        Ok(self.run_frame(None)?)
    }

    fn send(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<(), ControllerError> {
        Ok(self.run_lit_columns(columns, light, facts)?)
    }
}

impl<B: Bus> Controller for Board<B> {
    fn now(&self) -> Micros {
        Self::now(self)
    }

    fn challenge(&self) -> Challenge {
        Self::challenge(self)
    }

    fn status(&self) -> Option<&Status> {
        Self::status(self)
    }

    fn skip(&mut self) -> Result<(), ControllerError> {
        Ok(())
    }

    fn last_transaction(&self) -> Option<(&Transaction, &Transaction)> {
        Self::last_transaction(self)
    }

    fn send(
        &mut self,
        columns: &[LineScanColumn],
        light: &LightReport,
        facts: FrameFacts,
    ) -> Result<(), ControllerError> {
        Self::send(self, columns, light, facts)?;
        Ok(())
    }
}
