//! A deadline for any detector: it works in a thread of its own, and nobody waits for it longer than agreed.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::Duration;

use crate::detector::{Detection, Detector, Picture, Unknown, plausible};

/// A picture on its way to the thread, with the memory that it lies in.
struct Order {
    number: u64,
    width: u32,
    height: u32,
    rgb: Vec<u8>,
}

/// What came of it; both memories come back to be used again.
struct Answer {
    number: u64,
    rgb: Vec<u8>,
    outcome: Result<(), Unknown>,
    detections: Vec<Detection>,
}

/// Any detector, with a deadline.
///
/// While a late answer is still outstanding, every picture is [`Unknown::Stalled`] at once: the caller's own work goes
/// on at its own pace. The late answer itself is thrown away, since the world has moved on. A detector that panics is
/// gone for good: [`Unknown::Failed`] from then on.
pub struct Watched {
    classes: Vec<String>,
    deadline: Duration,
    orders: SyncSender<Order>,
    answers: Receiver<Answer>,
    number: u64,
    outstanding: bool,
    spare: Option<(Vec<u8>, Vec<Detection>)>,
    detections: Vec<Detection>,
}

impl Watched {
    /// Moves a detector into a thread of its own.
    ///
    /// # Errors
    /// The operating system gives no thread.
    pub fn new(mut detector: impl Detector + 'static, deadline: Duration) -> std::io::Result<Self> {
        let classes = detector.classes().to_vec();
        let (orders, incoming) = sync_channel::<Order>(1);
        let (outgoing, answers) = sync_channel::<Answer>(1);
        thread::Builder::new().name("detector".to_owned()).spawn(move || {
            let mut detections = Vec::new();
            // Ends when the owner is gone: either channel is then closed.
            for Order { number, width, height, rgb } in incoming {
                detections.clear();
                let outcome = Picture::new(width, height, &rgb)
                    .and_then(|picture| detector.detect(picture))
                    .map(|found| detections.extend_from_slice(found));
                let answer = Answer { number, rgb, outcome, detections: std::mem::take(&mut detections) };
                if outgoing.send(answer).is_err() {
                    break;
                }
            }
        })?;
        let (spare, detections) = (None, Vec::new());
        Ok(Self { classes, deadline, orders, answers, number: 0, outstanding: false, spare, detections })
    }

    /// Changes the deadline for the pictures to come.
    pub fn set_deadline(&mut self, deadline: Duration) {
        self.deadline = deadline;
    }

    fn stalled(&self) -> Unknown {
        Unknown::Stalled { deadline_ms: u64::try_from(self.deadline.as_millis()).unwrap_or(u64::MAX) }
    }

    /// Throws a late answer away; `Err` while it is still awaited.
    fn clear_outstanding(&mut self) -> Result<(), Unknown> {
        if !self.outstanding {
            return Ok(());
        }
        match self.answers.try_recv() {
            Ok(late) => {
                self.outstanding = false;
                self.spare = Some((late.rgb, late.detections));
                Ok(())
            }
            Err(TryRecvError::Empty) => Err(self.stalled()),
            Err(TryRecvError::Disconnected) => Err(gone()),
        }
    }
}

fn gone() -> Unknown {
    Unknown::Failed { what: "the detector's thread has ended".to_owned() }
}

impl Detector for Watched {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn detect(&mut self, picture: Picture<'_>) -> Result<&[Detection], Unknown> {
        self.clear_outstanding()?;
        let (mut rgb, old) = self.spare.take().unwrap_or_default();
        self.detections = old;
        self.detections.clear();
        rgb.clear();
        rgb.extend_from_slice(picture.rgb());
        self.number += 1;
        let order = Order { number: self.number, width: picture.width(), height: picture.height(), rgb };
        self.orders.send(order).map_err(|_| gone())?;
        self.outstanding = true;
        let answer = match self.answers.recv_timeout(self.deadline) {
            Ok(answer) => answer,
            Err(RecvTimeoutError::Timeout) => return Err(self.stalled()),
            Err(RecvTimeoutError::Disconnected) => return Err(gone()),
        };
        self.outstanding = false;
        // The previous list's memory goes back with the next order.
        let recycled = std::mem::replace(&mut self.detections, answer.detections);
        self.spare = Some((answer.rgb, recycled));
        if answer.number != self.number {
            return Err(Unknown::Nonsense { what: "an answer to another picture".to_owned() });
        }
        answer.outcome?;
        plausible(&self.detections, self.classes.len())?;
        Ok(&self.detections)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boxes::BoundingBox;

    /// Answers with the picture's width as a box, when it is allowed to.
    struct OnRequest {
        classes: Vec<String>,
        permits: Receiver<()>,
        found: Vec<Detection>,
    }

    impl Detector for OnRequest {
        fn classes(&self) -> &[String] {
            &self.classes
        }

        fn detect(&mut self, picture: Picture<'_>) -> Result<&[Detection], Unknown> {
            self.permits.recv().expect("the test gives permits or ends the thread by a panic");
            let place = BoundingBox { left: 0.0, top: 0.0, right: picture.width() as f32, bottom: 1.0 };
            self.found = vec![Detection { class: 0, score: 0.5, confidence: 0.5, place }];
            Ok(&self.found)
        }
    }

    fn watched(deadline: Duration) -> (Watched, SyncSender<()>) {
        let (permit, permits) = sync_channel(10);
        let detector = OnRequest { classes: vec!["bolt".to_owned()], permits, found: Vec::new() };
        (Watched::new(detector, deadline).unwrap(), permit)
    }

    const PATIENT: Duration = Duration::from_secs(60);

    #[test]
    fn an_answer_in_time_is_passed_on() {
        let (mut watched, permit) = watched(PATIENT);
        for width in [1, 2, 3] {
            permit.send(()).unwrap();
            let rgb = vec![0; width * 3];
            let found = watched.detect(Picture::new(width as u32, 1, &rgb).unwrap()).unwrap();
            assert_eq!(found[0].place.right, width as f32);
        }
    }

    #[test]
    fn while_it_stalls_every_picture_is_unknown_and_the_late_answer_is_not_taken_for_a_new_one() {
        let (mut watched, permit) = watched(Duration::from_millis(1));
        let (first, second) = ([0; 3], [0; 6]);
        for _ in 0..20 {
            let outcome = watched.detect(Picture::new(1, 1, &first).unwrap());
            assert_eq!(outcome, Err(Unknown::Stalled { deadline_ms: 1 }));
        }
        // The detector comes back: its answer to the first picture must not be given to the second.
        watched.set_deadline(PATIENT);
        permit.send(()).unwrap();
        permit.send(()).unwrap();
        let found = loop {
            match watched.detect(Picture::new(2, 1, &second).unwrap()) {
                Ok(found) => break found,
                Err(Unknown::Stalled { .. }) => thread::yield_now(),
                Err(other) => panic!("{other}"),
            }
        };
        assert_eq!(found[0].place.right, 2.0);
    }

    #[test]
    fn a_detector_that_panics_is_failed_for_good() {
        let (mut watched, permit) = watched(PATIENT);
        drop(permit);
        let rgb = [0; 3];
        for _ in 0..3 {
            let outcome = watched.detect(Picture::new(1, 1, &rgb).unwrap());
            assert!(matches!(outcome, Err(Unknown::Failed { .. })), "{outcome:?}");
        }
    }
}
