//! Tier 3 in a thread of its own: takes the newest picture, asks the detector, leaves the answer.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use nearfield_fusion::Sighting;
use nearfield_machine::real_time::step_back;
use nearfield_recording::{Detections, Event, Sighting as ToldSighting, Taps};
use nearfield_shared::action::Category;
use nearfield_shared::units::Micros;

use crate::capture::Frame;

use super::mailbox::{Fetched, Mailbox, Reader, Writer};

/// What people and programs read.
const fn category_name(category: Category) -> &'static str {
    match category {
        Category::Human => "human",
        Category::Tool => "tool",
        Category::Material => "material",
        Category::Part => "part",
        Category::Vehicle => "vehicle",
        Category::Environment => "environment",
        Category::SafetyItem => "safety_item",
        Category::Unknown => "unknown",
    }
}

/// An answer as recorder and page are told.
fn told(exposed: Micros, sightings: Option<&[Sighting]>, reason: &str) -> Detections {
    let one = |sighting: &Sighting| ToldSighting {
        category: category_name(sighting.category).to_owned(),
        confidence: sighting.confidence,
        pixels: [sighting.seen.left, sighting.seen.top, sighting.seen.right, sighting.seen.bottom],
    };
    let seen = sightings.map(|sightings| sightings.iter().map(one).collect());
    Detections { exposed, seen: seen.ok_or_else(|| reason.to_owned()) }
}

/// A picture for tier 3, in the camera's own layout: it is converted in tier 3's thread, not in the stripe's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SemanticPicture {
    /// The picture; it has no pixels before the first one.
    pub frame: Frame,
    /// Time of exposure, the host's clock.
    pub exposed: Micros,
}

impl Default for SemanticPicture {
    fn default() -> Self {
        Self { frame: Frame::empty(), exposed: Micros::ZERO }
    }
}

/// What tier 3 has said of one picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SemanticAnswer {
    /// What it saw; `None` = it does not know, which is never "nothing there".
    pub sightings: Option<Vec<Sighting>>,
    /// Why it does not know.
    pub reason: String,
    /// Time of exposure of its picture.
    pub exposed: Micros,
}

/// Whatever looks at pictures for tier 3.
pub trait Eye: Send {
    /// Everything that it sees, in pixels of the picture, or why it does not know.
    ///
    /// # Errors
    /// The reason, in words.
    fn look(&mut self, picture: &SemanticPicture) -> Result<Vec<Sighting>, String>;
}

/// The thread and both mailboxes.
pub struct Semantics {
    pictures: Writer<SemanticPicture>,
    answers: Reader<SemanticAnswer>,
    /// Kept so that its panic, if any, can be told; never joined while the robot runs.
    thread: JoinHandle<()>,
}

impl Semantics {
    /// Starts the thread.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn start(eye: impl Eye + 'static) -> std::io::Result<Self> {
        Self::start_told(eye, Taps::default())
    }

    /// As [`Self::start`]; every answer is told.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn start_told(mut eye: impl Eye + 'static, taps: Taps) -> std::io::Result<Self> {
        let (pictures, mut incoming) = Mailbox::pair::<SemanticPicture>();
        let (mut outgoing, answers) = Mailbox::pair::<SemanticAnswer>();
        let thread = std::thread::Builder::new().name("semantics".to_owned()).spawn(move || {
            step_back();
            loop {
                let picture = match incoming.wait(Duration::from_secs(1)) {
                    Fetched::New(picture) => picture,
                    Fetched::Nothing => continue,
                    Fetched::Closed => return,
                };
                let (sightings, reason) = match eye.look(picture) {
                    Ok(sightings) => (Some(sightings), String::new()),
                    Err(reason) => (None, reason),
                };
                let exposed = picture.exposed;
                if !taps.is_empty() {
                    taps.tell(
                        exposed,
                        Event::Detections(Arc::new(told(exposed, sightings.as_deref(), &reason))),
                    );
                }
                let answer = SemanticAnswer { sightings, reason, exposed };
                // The stripe path fetches for an instant only: the next try goes through.
                while !outgoing.offer(|slot| slot.clone_from(&answer)) {
                    std::thread::yield_now();
                }
            }
        })?;
        Ok(Self { pictures, answers, thread })
    }

    /// Offers a picture; never waits. It is lost if the thread is busy and another one comes before it is free.
    pub fn show(&mut self, fill: impl FnOnce(&mut SemanticPicture)) {
        self.pictures.offer(fill);
    }

    /// The newest answer, if there is one that was not fetched yet.
    pub fn newest(&mut self) -> Option<&SemanticAnswer> {
        self.answers.newest().map(|answer| &*answer)
    }

    /// Has the thread ended (its detector has panicked)?
    #[must_use]
    pub fn is_dead(&self) -> bool {
        self.thread.is_finished()
    }
}
