//! Service to a controller in this process: its session, its page, its service key.

use std::sync::{Arc, Mutex, PoisonError};

use nearfield_shared::linescan::LINE_SCAN_LENGTH;
use nearfield_shared::service::{NO_PAGE, PAGE_OFFSET, PageBytes};

use super::client::{ServiceLink, Transaction};
use crate::link::{LinkError, McuSession};

/// The page that a simulated controller's next transaction would carry, to be looked at beside its session.
#[derive(Debug, Clone)]
pub struct PageWatch(Arc<Mutex<PageBytes>>);

impl PageWatch {
    /// No page.
    #[must_use]
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new(NO_PAGE)))
    }

    /// The controller's page is this now.
    pub fn show(&self, page: &PageBytes) {
        // A page is bytes: whoever panicked while holding the lock has left nothing half-done.
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = *page;
    }

    /// The page as it is now.
    #[must_use]
    pub fn look(&self) -> PageBytes {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Default for PageWatch {
    fn default() -> Self {
        Self::new()
    }
}

/// A session as a link for service requests; every transaction takes one frame's period.
pub struct SessionLink<'a> {
    session: &'a mut McuSession,
    page: PageWatch,
}

impl<'a> SessionLink<'a> {
    /// Over a session whose controller shows its page on `page`.
    pub const fn new(session: &'a mut McuSession, page: PageWatch) -> Self {
        Self { session, page }
    }
}

impl ServiceLink for SessionLink<'_> {
    type Error = LinkError;

    fn transact(&mut self, message: Option<&Transaction>) -> Result<Box<Transaction>, LinkError> {
        let mut reply = Box::new([0; LINE_SCAN_LENGTH]);
        for (byte, page) in reply[PAGE_OFFSET..].iter_mut().zip(self.page.look()) {
            *byte = page;
        }
        self.session.run_frame(message.map(|message| message.as_slice()))?;
        Ok(reply)
    }
}
