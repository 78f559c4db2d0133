//! What is ready to be handed out, between the thread that makes it and the one that serves it.

use std::sync::{Arc, Mutex, PoisonError};

use nearfield_recording::Picture;

/// What the server hands out, as bytes: nothing is computed for a client.
#[derive(Debug, Default)]
pub struct Published {
    /// `/api/live`.
    pub live: Vec<u8>,
    /// `/api/status`.
    pub status: Vec<u8>,
    /// `/api/vda5050`.
    pub vda5050: Vec<u8>,
    /// `/metrics`.
    pub metrics: Vec<u8>,
    /// `/api/commission`; empty = there is no plan for one.
    pub commission: Vec<u8>,
    /// `/commission.html`; empty = nobody has begun.
    pub protocol: Vec<u8>,
    /// `/picture.jpg`.
    pub picture: Option<Arc<Picture>>,
}

/// The newest publication, between the model's thread and the server's.
#[derive(Debug, Clone, Default)]
pub struct Board(Arc<Mutex<Arc<Published>>>);

impl Board {
    /// The newest.
    #[must_use]
    pub fn newest(&self) -> Arc<Published> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Puts a newer one in its place.
    pub(crate) fn publish(&self, published: Published) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(published);
    }
}
