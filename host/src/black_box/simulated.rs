//! Service to a simulated controller: its session, its page, its service key.

use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::service::PAGE_OFFSET;

use super::client::{ServiceLink, Transaction};
use crate::link::{LinkError, McuSession};

/// A session as a link for service requests; every transaction takes one frame's period.
pub struct SessionLink<'a> {
    session: &'a mut McuSession,
}

impl<'a> SessionLink<'a> {
    /// Over a session with any controller.
    pub const fn new(session: &'a mut McuSession) -> Self {
        Self { session }
    }
}

impl ServiceLink for SessionLink<'_> {
    type Error = LinkError;

    fn transact(&mut self, message: Option<&Transaction>) -> Result<Box<Transaction>, LinkError> {
        let mut reply = Box::new([0; LINE_SCAN_LENGTH]);
        for (byte, page) in reply[PAGE_OFFSET..].iter_mut().zip(self.session.service_page()?) {
            *byte = page;
        }
        self.session.run_frame(message.map(|message| message.as_slice()))?;
        Ok(reply)
    }
}
