//! Hailo's accelerator (Hailo-8L on the Raspberry Pi AI HAT+), through HailoRT 4.
//!
//! HailoRT's library is opened while running; building needs nothing of it. The network comes as a HEF from Hailo's own
//! compiler, with suppression on the Pi, so that its answer is boxes by class. **Built and tested against a mock library;
//! not run on hardware.**

mod library;
mod parser;

use std::path::{Path, PathBuf};

use crate::card::{Card, ModelError};
use crate::detector::{Detection, Unknown};
use crate::network::Network;
use library::{Failure, Session};

/// Names under which HailoRT's library is looked for.
const LIBRARIES: [&str; 2] = ["libhailort.so", "libhailort.so.4.23.0"];
/// An answer takes some 20 ms; after this time there will be none, milliseconds.
const TIMEOUT_MS: u32 = 500;

/// A network on Hailo's accelerator.
pub struct HailoNetwork {
    library: PathBuf,
    hef: PathBuf,
    side: u32,
    classes: usize,
    timeout_ms: u32,
    /// None after a failure: the next picture opens everything anew. A late answer to the last picture might otherwise
    /// be taken for one to the next.
    session: Option<Session>,
    input: Vec<u8>,
    output: Vec<f32>,
}

impl HailoNetwork {
    /// Opens HailoRT, the device and a HEF that must fit the card.
    ///
    /// # Errors
    /// [`ModelError::NoBackend`]: no library, no device; [`ModelError::BadNetwork`]: the HEF does not fit the card.
    pub fn open(hef: &Path, card: &Card) -> Result<Self, ModelError> {
        let mut last = None;
        for name in LIBRARIES {
            match Self::open_with(Path::new(name), hef, card, TIMEOUT_MS) {
                Err(ModelError::NoBackend { what }) => last = Some(what),
                outcome => return outcome,
            }
        }
        let what = last.unwrap_or_default();
        Err(ModelError::NoBackend {
            what: format!("{what}; install HailoRT 4.23 and check `hailortcli scan`"),
        })
    }

    /// As [`HailoNetwork::open`], with a certain library and time-out.
    ///
    /// # Errors
    /// As [`HailoNetwork::open`].
    pub fn open_with(library: &Path, hef: &Path, card: &Card, timeout_ms: u32) -> Result<Self, ModelError> {
        let mut network = Self {
            library: library.to_owned(),
            hef: hef.to_owned(),
            side: card.input_side,
            classes: card.classes.len(),
            timeout_ms,
            session: None,
            input: vec![0; card.input_side as usize * card.input_side as usize * 3],
            output: Vec::new(),
        };
        network.reopen().map_err(|failure| match failure {
            Failure::Unfit(what) => ModelError::BadNetwork { path: hef.to_owned(), what },
            other => ModelError::NoBackend { what: format!("{}: {other}", library.display()) },
        })?;
        Ok(network)
    }

    fn reopen(&mut self) -> Result<(), Failure> {
        // The old one is closed first: the device has room for one.
        self.session = None;
        let session = Session::open(&self.library, &self.hef, self.timeout_ms)?;
        let shape = session.shape();
        if shape.input_bytes != self.input.len() {
            let (side, bytes) = (self.side, shape.input_bytes);
            return Err(Failure::Unfit(format!(
                "it takes {bytes} bytes, not pictures of {side} x {side} x 3"
            )));
        }
        if shape.classes != self.classes {
            return Err(Failure::Unfit(format!("{} classes, the card has {}", shape.classes, self.classes)));
        }
        self.output = vec![0.0; shape.output_numbers];
        self.session = Some(session);
        Ok(())
    }

    fn exchange(&mut self, least_score: f32, found: &mut Vec<Detection>) -> Result<(), Unknown> {
        if self.session.is_none() {
            self.reopen().map_err(|failure| failure.unknown(self.timeout_ms))?;
        }
        let Some(session) = &mut self.session else {
            return Err(Unknown::Failed { what: "no session".to_owned() });
        };
        // What is left from the last picture must not be read as an answer to this one.
        self.output.fill(f32::NAN);
        session
            .exchange(&self.input, &mut self.output)
            .map_err(|failure| failure.unknown(self.timeout_ms))?;
        let most = session.shape().most_a_class;
        parser::boxes_by_class(&self.output, self.classes, most, self.side as f32, |detection| {
            if detection.score >= least_score {
                found.push(detection);
            }
        })
    }
}

impl Failure {
    fn unknown(self, deadline_ms: u32) -> Unknown {
        match self {
            Self::TimedOut => Unknown::Stalled { deadline_ms: deadline_ms.into() },
            other => Unknown::Failed { what: other.to_string() },
        }
    }
}

impl Network for HailoNetwork {
    fn infer(&mut self, input: &[f32], least_score: f32, found: &mut Vec<Detection>) -> Result<(), Unknown> {
        let plane = self.input.len() / 3;
        if input.len() != self.input.len() {
            return Err(Unknown::Failed { what: format!("an input of {} numbers", input.len()) });
        }
        // The accelerator takes bytes, pixel by pixel.
        let (red, rest) = input.split_at(plane);
        let (green, blue) = rest.split_at(plane);
        for (pixel, ((red, green), blue)) in
            self.input.chunks_exact_mut(3).zip(red.iter().zip(green).zip(blue))
        {
            pixel.copy_from_slice(&[red, green, blue].map(|level| (level * 255.0).round() as u8));
        }
        found.clear();
        let outcome = self.exchange(least_score, found);
        if outcome.is_err() {
            found.clear();
            self.session = None;
        }
        outcome
    }
}
