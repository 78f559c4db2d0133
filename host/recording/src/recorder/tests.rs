#![allow(clippy::unwrap_used)]

use std::io::{self, Write};
use std::sync::atomic::AtomicU64;

use nearfield_fields::Report;
use nearfield_shared::linescan::HostVerdict;
use nearfield_shared::status::STATUS_LENGTH;

use super::*;
use crate::event::REPLY_LENGTH;
use crate::folder::{Folder, Output};
use crate::queue::queue;
use crate::reader::{Record, Recording};
use crate::{Tap, recovery};

fn options(limit: u64) -> Options {
    Options {
        begun: 1_700_000_000_000_000_000,
        module: "front".to_owned(),
        configuration: "rig = \"rig.toml\"".to_owned(),
        rig: vec![1, 2, 3],
        limit,
        before: Duration::from_secs(2),
        after: Duration::from_secs(1),
    }
}

fn decision(second: f64, relay_closed: bool) -> (Micros, Event) {
    let at = Micros::new((second * 1e6) as u64);
    let latency = Duration::from_millis(1);
    let decision = Decision {
        picture: 1,
        exposed: at,
        verdict: HostVerdict::Clear,
        relay_closed,
        latency,
        fields: Report::default(),
        advice: None,
    };
    (at, Event::Decision(decision))
}

fn picture(second: f64) -> (Micros, Event) {
    let exposed = Micros::new((second * 1e6) as u64);
    (exposed, Event::Picture(Arc::new(Picture { exposed, jpeg: vec![7; 900], full_size: (8, 4) })))
}

/// Waits for the recorder's thread, which needs its time on a loaded machine.
fn eventually(mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(120), "it never came");
        std::thread::sleep(Duration::from_millis(5));
    }
}

struct Bench {
    place: tempfile::TempDir,
    recorder: Option<Recorder>,
    tap: Tap,
}

impl Bench {
    fn new(limit: u64) -> Self {
        let place = tempfile::tempdir().unwrap();
        let folder = Folder::open(place.path()).unwrap();
        let (tap, drain) = queue(256);
        let recorder = Recorder::start(options(limit), Box::new(folder), drain).unwrap();
        Self { place, recorder: Some(recorder), tap }
    }

    /// Without a loss, however slow the machine is.
    fn tell(&self, (at, event): (Micros, Event)) {
        eventually(|| self.tap.tell(at, event.clone()));
    }

    fn finish(&mut self) -> State {
        self.recorder.take().unwrap().finish()
    }

    fn recordings(&self) -> Vec<Recording> {
        let folder = Folder::open(self.place.path()).unwrap();
        let paths = folder.entries().unwrap().into_iter().map(|entry| self.place.path().join(entry.name));
        paths.map(|path| Recording::open(&path).unwrap()).collect()
    }
}

fn picture_seconds(recording: &Recording) -> Vec<u64> {
    let of = |(time, record): &(u64, Record)| {
        matches!(record, Record::Picture(_)).then_some((time - 1_700_000_000_000_000_000) / 1_000_000_000)
    };
    recording.records().iter().filter_map(of).collect()
}

#[test]
fn pictures_are_kept_from_before_to_after_a_stop_and_decisions_always() {
    let mut bench = Bench::new(1 << 30);
    for second in 0..20 {
        let second = f64::from(second);
        bench.tell(picture(second));
        bench.tell(decision(second, second < 10.0));
    }
    assert_eq!(bench.finish().problem, None);
    let recordings = bench.recordings();
    let recording = &recordings[0];
    assert!(recording.is_complete() && recordings.len() == 1);
    assert_eq!(picture_seconds(recording), [8, 9, 10, 11], "2 s before to 1 s after the stop at 10 s");
    let count =
        |wanted: fn(&Record) -> bool| recording.records().iter().filter(|(_, record)| wanted(record)).count();
    assert_eq!(count(|record| matches!(record, Record::Decision(_))), 20);
    assert_eq!(count(|record| matches!(record, Record::Log(log) if log.message.starts_with("stop"))), 1);
    let configuration = recording.configuration().unwrap();
    assert_eq!((configuration.segment, configuration.rig.as_str()), (0, "AQID"));
    assert_eq!(configuration.run, "2023-11-14T22:13:20.000Z");
}

#[test]
fn a_remark_keeps_pictures_too() {
    let mut bench = Bench::new(1 << 30);
    for second in 0..8 {
        bench.tell(picture(f64::from(second)));
        if second == 5 {
            bench.tell((Micros::from_millis(5000), Event::Mark("look here".into())));
        }
    }
    bench.finish();
    assert_eq!(picture_seconds(&bench.recordings()[0]), [3, 4, 5, 6]);
}

#[test]
fn bytes_come_back_as_they_went_in() {
    let mut bench = Bench::new(1 << 30);
    let step = LockStep { number: 3, request: [9; 16], reply: [8; REPLY_LENGTH] };
    let payload: Arc<[u8]> = (0..=255).collect();
    bench.tell((Micros::ZERO, Event::PowerUp { step, payload: Arc::clone(&payload) }));
    let line_scan = std::array::from_fn(|index| (index * 7) as u8);
    let status = [5; STATUS_LENGTH];
    bench.tell((Micros::new(3), Event::Exchange { step: Some(step), line_scan: Some(line_scan), status }));
    bench.tell((Micros::new(4), Event::Tick(step)));
    bench.finish();
    let recordings = bench.recordings();
    let records: Vec<&Record> = recordings[0].records().iter().map(|(_, record)| record).collect();
    let [
        _,
        Record::LockStep { payload: Some(told), .. },
        Record::LineScan(scan),
        Record::Status(back),
        rest @ ..,
    ] = &records[..]
    else {
        panic!("{records:?}")
    };
    assert_eq!((&told[..], &scan[..], &back[..]), (&payload[..], &line_scan[..], &status[..]));
    let both = |record: &&Record| matches!(record, Record::LockStep { step: told, payload: None, .. } if *told == step);
    assert!(rest.len() == 2 && rest.iter().all(both));
}

#[test]
fn the_limit_holds_and_the_oldest_segments_give_way() {
    let limit = 400_000;
    let mut bench = Bench::new(limit);
    for number in 0..600 {
        let at = Micros::from_millis(20 * number);
        bench.tell((
            at,
            Event::Exchange { step: None, line_scan: Some([number as u8; 3944]), status: [0; 200] },
        ));
        if number % 100 == 99 {
            // The limit is looked after twice a second.
            std::thread::sleep(Duration::from_millis(600));
        }
    }
    bench.finish();
    let recordings = bench.recordings();
    let segments: Vec<u32> = recordings.iter().map(|one| one.configuration().unwrap().segment).collect();
    assert!(segments[0] > 0 && segments.is_sorted(), "{segments:?}");
    let total: u64 = recordings.iter().map(|one| one.path().metadata().unwrap().len()).sum();
    // What is written between two looks comes on top.
    assert!(total < limit + 700_000, "{total}");
}

/// Takes so many bytes, then none.
struct FullDisk {
    left: Arc<AtomicU64>,
    folder: Folder,
}

struct FullFile {
    left: Arc<AtomicU64>,
    file: Box<dyn Output>,
}

impl Write for FullFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let length = bytes.len() as u64;
        let taken =
            self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(length));
        taken.map_err(|_| io::Error::from(io::ErrorKind::StorageFull))?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Output for FullFile {
    fn sync(&mut self) -> io::Result<()> {
        self.file.sync()
    }
}

impl Store for FullDisk {
    fn create(&mut self, name: &str) -> io::Result<Box<dyn Output>> {
        Ok(Box::new(FullFile { left: Arc::clone(&self.left), file: self.folder.create(name)? }))
    }

    fn make_room(&mut self, limit: u64, keep: &str) -> io::Result<()> {
        self.folder.make_room(limit, keep)
    }

    fn free(&self) -> Option<u64> {
        None
    }
}

#[test]
fn a_full_disk_stops_the_recording_which_says_so_and_what_is_there_stays_readable() {
    let place = tempfile::tempdir().unwrap();
    let folder = Folder::open(place.path()).unwrap();
    let disk = FullDisk { left: Arc::new(AtomicU64::new(1_300_000)), folder: folder.clone() };
    let (tap, drain) = queue(64);
    let recorder = Recorder::start(options(1 << 30), Box::new(disk), drain).unwrap();
    let mut number = 0_u8;
    eventually(|| {
        number = number.wrapping_add(1);
        tap.tell(
            Micros::ZERO,
            Event::Exchange { step: None, line_scan: Some([number; 3944]), status: [0; 200] },
        );
        recorder.state().problem.is_some()
    });
    let state = recorder.state();
    let problem = state.problem.unwrap();
    assert!(problem.contains("no storage space"), "{problem}");
    assert_eq!((state.stops, state.file.as_str()), (1, ""));
    assert!(tap.tell(Micros::ZERO, Event::Mark("goes on".into())), "the queue is still emptied");
    drop(recorder.finish());
    let entries = folder.entries().unwrap();
    let path = place.path().join(&entries[0].name);
    let cut = Recording::open(&path).unwrap();
    assert!(cut.configuration().is_some() && cut.records().len() > 100, "{}", cut.records().len());
    assert!(!cut.is_complete());
    assert_eq!(recovery::complete_all(&folder).unwrap(), std::slice::from_ref(&path));
    let whole = Recording::open(&path).unwrap();
    assert!(whole.is_complete() && whole.records().len() == cut.records().len());
    assert!(recovery::complete_all(&folder).unwrap().is_empty(), "once is enough");
}

#[test]
fn a_recording_that_ends_anywhere_opens_and_keeps_all_whole_chunks() {
    let mut bench = Bench::new(1 << 30);
    for number in 0..400_u64 {
        bench.tell((
            Micros::new(number),
            Event::Exchange { step: None, line_scan: Some([3; 3944]), status: [1; 200] },
        ));
    }
    bench.finish();
    let entry = Folder::open(bench.place.path()).unwrap().entries().unwrap().remove(0);
    let bytes = std::fs::read(bench.place.path().join(&entry.name)).unwrap();
    let path = bench.place.path().join("cut.mcap");
    let (mut counts, step) = (Vec::new(), bytes.len() / 97);
    for length in (0..=bytes.len()).step_by(step).chain([1, 7, 8, 9, bytes.len() - 1]) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let cut = Recording::open(&path).unwrap();
        assert_eq!(cut.is_complete(), length == bytes.len(), "{length} of {}", bytes.len());
        if length % step == 0 {
            counts.push(cut.records().len());
        }
    }
    assert!(counts.is_sorted() && *counts.last().unwrap() >= 700, "{counts:?}");
    // A chunk is at most half a MiB: no prefix loses more messages than fit into one.
    for (index, count) in counts.iter().enumerate() {
        let expected = 800 * index * step / bytes.len();
        assert!(count + 230 >= expected, "{index}: {count} of about {expected}");
    }
}

#[test]
fn what_is_no_recording_is_refused_with_its_name() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("song.mcap");
    std::fs::write(&path, b"la la la la la la").unwrap();
    let told = Recording::open(&path).unwrap_err().to_string();
    assert!(told.contains("song.mcap"), "{told}");
    assert!(
        Recording::open(&place.path().join("none.mcap")).unwrap_err().to_string().contains("cannot read")
    );
}
