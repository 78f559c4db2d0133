//! The black box's rules: what is kept of a stop, for how long, and that every byte of it can be read.

use super::*;
use nearfield_shared::causes::StopCause;
use nearfield_shared::service::ExchangeKind;
use nearfield_shared::status::StateCode;

const CUT: StopCauses = StopCauses::NONE.with(StopCause::StripeCut);
const RIG: Option<CalibrationId> = Some(CalibrationId::new(77));

fn summary(number: u64) -> Summary {
    Summary::new(Micros::new(number), StateCode::Running, ExchangeKind::Accepted)
}

/// A scan whose bytes differ from all its neighbours'.
fn scan(number: u64) -> [u8; LINE_SCAN_LENGTH] {
    let mut bytes = [0; LINE_SCAN_LENGTH];
    for (offset, byte) in bytes.iter_mut().enumerate() {
        *byte = (offset as u64 * 31 + number * 7) as u8;
    }
    bytes
}

fn exchanges(black_box: &mut BlackBox, numbers: std::ops::Range<u64>) {
    for number in numbers {
        black_box.line_scan(&scan(number));
        black_box.record(&summary(number));
    }
}

/// Everything that can be read: page by page, as a host puts it together.
fn read(black_box: &BlackBox) -> Option<(StopIndex, Vec<u64>, Vec<Vec<u8>>)> {
    let mut data = [0xEE; PAGE_DATA_LENGTH];
    let first = black_box.page(0, &mut data)?;
    let index = StopIndex::parse(&data[..first.length]).unwrap();
    let mut page = |number: usize| {
        let content = black_box.page(u16::try_from(number).unwrap(), &mut data).unwrap();
        assert_eq!((content.count, content.revision), (first.count, index.stop));
        data[..content.length].to_vec()
    };
    let summaries: Vec<u8> = (1..=SUMMARY_PAGES).flat_map(&mut page).collect();
    let times = summaries
        .chunks(SUMMARY_LENGTH)
        .map(|bytes| Summary::parse(bytes.try_into().unwrap()).unwrap().time.get())
        .collect();
    let scans = (0..usize::from(index.scans))
        .map(|scan| {
            let from = 1 + SUMMARY_PAGES + scan * PAGES_PER_SCAN;
            (from..from + PAGES_PER_SCAN).flat_map(&mut page).collect()
        })
        .collect();
    assert_eq!(usize::from(first.count), 1 + SUMMARY_PAGES + usize::from(index.scans) * PAGES_PER_SCAN);
    let mut unused = [0; PAGE_DATA_LENGTH];
    assert_eq!(black_box.page(first.count, &mut unused), None, "no page behind the last");
    assert_eq!(black_box.page(u16::MAX, &mut unused), None);
    Some((index, times, scans))
}

#[test]
fn nothing_is_kept_before_a_stop_of_an_armed_controller() {
    let mut black_box = BlackBox::default();
    assert_eq!(read(&black_box), None);
    exchanges(&mut black_box, 0..100);
    black_box.stop(Micros::new(5), CUT, RIG);
    assert_eq!(read(&black_box), None, "it was never running");
    black_box.armed();
    assert_eq!(read(&black_box), None, "no stop yet");
}

#[test]
fn a_stop_keeps_the_votes_line_scans_and_one_more_and_the_time_around() {
    let mut black_box = BlackBox::new();
    exchanges(&mut black_box, 0..80);
    black_box.armed();
    exchanges(&mut black_box, 80..100);
    black_box.stop(Micros::new(555), CUT, RIG);
    let (index, times, scans) = read(&black_box).unwrap();
    assert_eq!((index.stop, index.time, index.causes), (1, Micros::new(555), CUT));
    assert_eq!((index.firmware, index.calibration, index.complete), (FIRMWARE_ID, RIG, false));
    assert_eq!((index.summaries, index.summaries_before), (48, 48));
    assert_eq!((index.scans, index.scans_before), (3, 3));
    assert_eq!(times, (52..100).collect::<Vec<_>>(), "also from before it was armed");
    assert_eq!(scans, [97, 98, 99].map(|number| scan(number).to_vec()));

    exchanges(&mut black_box, 100..115);
    let (index, times, scans) = read(&black_box).unwrap();
    assert_eq!((index.summaries, index.summaries_before, index.complete), (63, 48, false));
    assert_eq!((index.scans, index.scans_before), (4, 3));
    assert_eq!(times, (52..115).collect::<Vec<_>>());
    assert_eq!(scans, [97, 98, 99, 100].map(|number| scan(number).to_vec()));

    exchanges(&mut black_box, 115..116);
    let kept = read(&black_box).unwrap();
    assert!(kept.0.complete);
    assert_eq!(kept.1, (52..116).collect::<Vec<_>>());
    exchanges(&mut black_box, 116..400);
    black_box.stop(Micros::new(999), StopCauses::NONE, None);
    assert_eq!(read(&black_box).unwrap(), kept, "frozen until it runs again, whatever comes");
}

#[test]
fn a_kept_stop_is_complete_only_with_its_summaries_and_its_line_scan() {
    let mut black_box = BlackBox::new();
    black_box.armed();
    black_box.stop(Micros::ZERO, CUT, RIG);
    let (index, times, scans) = read(&black_box).unwrap();
    assert_eq!((index.summaries, index.scans, times.len(), scans.len()), (0, 0, 0, 0), "at once");
    for number in 0..20 {
        black_box.record(&summary(number));
    }
    assert!(!black_box.index().unwrap().complete, "no line-scan after the stop yet");
    assert_eq!(black_box.index().unwrap().summaries, 16);
    black_box.line_scan(&scan(1));
    assert!(black_box.index().unwrap().complete);
    black_box.line_scan(&scan(2));
    assert_eq!(read(&black_box).unwrap().2, [scan(1).to_vec()]);
}

#[test]
fn running_again_starts_anew_and_the_next_stop_is_kept() {
    let mut black_box = BlackBox::new();
    black_box.armed();
    exchanges(&mut black_box, 0..10);
    black_box.stop(Micros::new(10), CUT, RIG);
    exchanges(&mut black_box, 10..15);
    black_box.armed();
    assert_eq!(black_box.index(), None);
    exchanges(&mut black_box, 20..22);
    black_box.stop(Micros::new(22), StopCauses::NONE.with(StopCause::LinkTimeout), None);
    let (index, times, scans) = read(&black_box).unwrap();
    assert_eq!((index.stop, index.calibration), (2, None));
    assert_eq!(index.causes, StopCauses::NONE.with(StopCause::LinkTimeout));
    assert_eq!(times, [20, 21], "nothing of the time between the stop and the new run is mixed in");
    assert_eq!(scans, [20, 21].map(|number| scan(number).to_vec()));
    // Armed twice without a stop in between: nothing is thrown away.
    let mut black_box = BlackBox::new();
    black_box.armed();
    exchanges(&mut black_box, 0..3);
    black_box.armed();
    black_box.stop(Micros::new(3), CUT, RIG);
    assert_eq!(read(&black_box).unwrap().1, [0, 1, 2]);
}

#[test]
fn it_takes_no_more_memory_than_promised() {
    assert!(size_of::<BlackBox>() <= 19 * 1024 + 512, "{}", size_of::<BlackBox>());
}
