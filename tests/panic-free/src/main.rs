//! Proof by linking that the safety core has no path to a panic.
//!
//! The panic handler calls a symbol that nothing defines. The linker drops functions that nothing reaches, so the
//! program links only if the optimiser has shown that no panic is reachable from any of the entry points below, with
//! overflow checks on. Inputs come from memory that the
//! optimiser knows nothing about.
//! `cargo xtask panic-free` builds it, and then checks with the feature `control` that an added panic path is caught.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("panic-free is a proof by linking for the microcontroller; run `cargo xtask panic-free`");
}

#[cfg(target_os = "none")]
mod proof {
    #![allow(unsafe_code)]
    use core::cell::UnsafeCell;
    use core::hint::black_box;
    use core::panic::PanicInfo;
    use nearfield_firmware::black_box::recorded::{RecordedController, RecorderMemory};
    use nearfield_firmware::flow::FeedPermit;
    use nearfield_firmware::lockstep::{REQUEST_HEADER_LENGTH, Request, RequestHeader, SimulatedTick};
    use nearfield_firmware::safety::{LineScanMonitor, SafetyController, StartInputs};
    use nearfield_firmware::secret::SECRET_LENGTH;
    use nearfield_firmware::selftest::clock::ClockCheck;
    use nearfield_firmware::selftest::memory::{self, Cells, Region};
    use nearfield_firmware::selftest::program::{ImageSeal, ProgramCheck, Progress, SEAL_BYTES};
    use nearfield_firmware::selftest::schedule::Schedule;
    use nearfield_firmware::selftest::stack::StackCheck;
    use nearfield_firmware::selftest::watchdog::{self, Marker, ResetFlags};
    use nearfield_firmware::selftest::{Outcome, Verdict, configuration, processor, random, supply};
    use nearfield_firmware::store::StoreError;
    use nearfield_shared::action::{Category, action_for};
    use nearfield_shared::camera::Pixel;
    use nearfield_shared::columns::Decimation;
    use nearfield_shared::height::SizeClass;
    use nearfield_shared::laser::PaperGeometry;
    use nearfield_shared::linescan::{self, AuditWindow, LINE_SCAN_LENGTH, LineScan, LineScanColumn};
    use nearfield_shared::monitor::StripeMonitor;
    use nearfield_shared::rig::{COMPACT_LENGTH, Rig};
    use nearfield_shared::run_over::RunOverPermit;
    use nearfield_shared::service::{
        FAULT_ENTRY_LENGTH, NO_PAGE, PAGE_LENGTH, Page, Request as ServiceRequest, StopIndex, encode_request,
    };
    use nearfield_shared::status::{ResetCause, STATUS_LENGTH, Status};
    use nearfield_shared::units::{Micros, Millimetres, SignalQuality, SourceId, SubpixelRow};

    unsafe extern "C" {
        fn nearfield_a_panic_path_is_left() -> !;
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        // SAFETY: never runs; nothing defines the symbol, so a program that could get here does not link.
        unsafe { nearfield_a_panic_path_is_left() }
    }

    /// Memory whose content the optimiser must not assume, and whose change it must not drop.
    struct Unknown<T>(UnsafeCell<T>);
    // SAFETY: the proof has one thread and never runs.
    unsafe impl<T> Sync for Unknown<T> {}

    impl<T> Unknown<T> {
        const fn new(value: T) -> Self {
            Self(UnsafeCell::new(value))
        }

        /// The value, as far as the optimiser knows changed by somebody else since the last look.
        #[allow(clippy::mut_from_ref)]
        fn look(&self) -> &mut T {
            // SAFETY: valid and aligned, the cell's own; the proof never runs, so no two references ever live.
            black_box(unsafe { &mut *self.0.get() })
        }

        fn read(&self) -> T
        where
            T: Copy,
        {
            *self.look()
        }

        fn write(&self, value: T) {
            *self.look() = value;
            self.look();
        }
    }

    static MESSAGE: Unknown<[u8; LINE_SCAN_LENGTH]> = Unknown::new([0; LINE_SCAN_LENGTH]);
    static RIG: Unknown<[u8; COMPACT_LENGTH]> = Unknown::new([0; COMPACT_LENGTH]);
    static STATUS: Unknown<[u8; STATUS_LENGTH]> = Unknown::new([0; STATUS_LENGTH]);
    static LENGTH: Unknown<usize> = Unknown::new(0);
    static NUMBER: Unknown<f64> = Unknown::new(0.0);
    static COLUMNS: Unknown<[LineScanColumn; 4]> = Unknown::new([LineScanColumn::MISSING; 4]);
    static SINK: Unknown<u64> = Unknown::new(0);

    static TIME: Unknown<u64> = Unknown::new(0);
    static SECRET: Unknown<[u8; SECRET_LENGTH]> = Unknown::new([0; SECRET_LENGTH]);
    static REQUEST: Unknown<[u8; REQUEST_HEADER_LENGTH]> = Unknown::new([0; REQUEST_HEADER_LENGTH]);
    static CONTROLLER: Unknown<RecordedController<LineScanMonitor, RecorderMemory>> =
        Unknown::new(RecordedController::new(
            SafetyController::new(SourceId::new(1), LineScanMonitor::new()),
            RecorderMemory::new(SourceId::new(1)),
        ));
    static PAGE: Unknown<[u8; PAGE_LENGTH]> = Unknown::new(NO_PAGE);
    static FAULT: Unknown<[u8; FAULT_ENTRY_LENGTH]> = Unknown::new([0; FAULT_ENTRY_LENGTH]);
    static MONITOR: Unknown<StripeMonitor<1152>> = Unknown::new(StripeMonitor::new());

    fn sink(value: bool) {
        SINK.write(u64::from(value));
    }

    #[unsafe(no_mangle)]
    extern "C" fn _start() -> ! {
        loop {
            geometry();
            messages();
            tiers();
            controller();
            service();
            self_tests();
            #[cfg(feature = "control")]
            control();
        }
    }

    #[inline(never)]
    fn geometry() {
        let Ok(rig) = Rig::from_bytes(&RIG.read()) else { return };
        RIG.write(rig.to_bytes());
        sink(rig.calibration_id().get() == 0);
        let pixel = Pixel { u: NUMBER.read(), v: NUMBER.read() };
        if let Some(point) = rig.laser().triangulate(rig.camera(), pixel) {
            NUMBER.write(rig.stripe().coordinate_of(rig.laser().shadow_on_floor(point).unwrap_or(point)));
        }
        let paper = PaperGeometry {
            laser_height: NUMBER.read(),
            camera_height: NUMBER.read(),
            distance: NUMBER.read(),
            focal_length: NUMBER.read(),
        };
        NUMBER.write(paper.height(NUMBER.read(), NUMBER.read()).unwrap_or(0.0));
    }

    #[inline(never)]
    fn messages() {
        let message = MESSAGE.look();
        if let Some(Ok(scan)) = message.get(..LENGTH.read()).map(LineScan::parse) {
            let columns = COLUMNS.read();
            let mut reply = [0; LINE_SCAN_LENGTH];
            for window in scan.audit_windows() {
                sink(
                    linescan::encode(
                        &mut reply,
                        scan.header(),
                        &columns,
                        &scan.brightness(),
                        &[window, window],
                    )
                    .is_ok(),
                );
            }
            let none: [AuditWindow; 0] = [];
            sink(
                linescan::encode(
                    &mut reply,
                    scan.header(),
                    columns.get(..LENGTH.read()).unwrap_or(&[]),
                    &scan.brightness(),
                    &none,
                )
                .is_ok(),
            );
            *MESSAGE.look() = reply;
        }
        let status = STATUS.read();
        if let Some(Ok(status)) = status.get(..LENGTH.read()).map(Status::parse) {
            STATUS.write(status.to_bytes());
            sink(status.latched_causes.iter().any(|cause| cause.name().len() > cause.words().len()));
        }
        let row = SubpixelRow::from_pixels(nearfield_shared::units::narrow(NUMBER.read()));
        sink(row.and_then(SubpixelRow::to_pixels).is_some() && SignalQuality::new(1) > SignalQuality::NONE);
    }

    #[inline(never)]
    fn tiers() {
        let monitor = MONITOR.look();
        if let Ok(rig) = Rig::from_bytes(&RIG.read()) {
            sink(monitor.configure(&rig, Decimation::for_line_scan(rig.image().width)).is_ok());
        }
        let message = MESSAGE.look();
        if let Ok(scan) = LineScan::parse(message) {
            let claim = scan.header().claims.iter().flatten().next();
            let permit = RunOverPermit { stretches: [claim.map(|claim| claim.stretch), None, None, None] };
            let report = monitor.update_with(scan.readings(), &permit, |_| {}, |_| {});
            sink(report.is_cut() || report.is_stripe_missing() || report.size() == Some(SizeClass::Unknown));
        }
        let size = SizeClass::of(Millimetres::new(nearfield_shared::units::narrow(NUMBER.read())));
        for category in Category::ALL {
            SINK.write(action_for(category, size) as u64);
        }
    }

    #[inline(never)]
    fn controller() {
        let controller = CONTROLLER.look();
        let stored_rig = RIG.read();
        let secret = SECRET.read();
        let start = StartInputs { reset_cause: ResetCause::Watchdog, stored_rig: &stored_rig, secret };
        sink(controller.start(&start).is_ok());
        let simulated = match RequestHeader::parse(&REQUEST.read()) {
            Ok(RequestHeader { request: Request::Tick(tick), .. }) => tick,
            Ok(_) | Err(_) => SimulatedTick::default(),
        };
        let output = controller.tick(Micros::new(TIME.read()), simulated.inputs(Micros::new(TIME.read())));
        sink(output.outputs.relays.a && output.permit.as_ref().is_some_and(|_: &FeedPermit| true));
        let message = MESSAGE.look();
        let outputs = controller.on_exchange(Micros::new(TIME.read()), message.get(..LENGTH.read()));
        sink(outputs.relays.b && controller.controller().calibration().is_some());
        STATUS.write(controller.status(Micros::new(TIME.read())));
        PAGE.write(*controller.page());
        controller.fault_log().restore(&FAULT.read());
        if controller.take_job().is_some() {
            let rig = RIG.read();
            let outcome = if rig == [0; COMPACT_LENGTH] { Err(StoreError::Flash) } else { Ok(Some(rig)) };
            controller.finish_job(Micros::new(TIME.read()), &outcome);
        }
        if let Some(entry) = controller.unsaved_fault() {
            FAULT.write(entry.to_bytes());
            controller.fault_saved(&entry);
        }
    }

    #[inline(never)]
    fn service() {
        let message = MESSAGE.look();
        if let Some(request) = message.get(..LENGTH.read()).and_then(ServiceRequest::parse)
            && let Ok(demand) = request.demand
        {
            let mut again = [0; LINE_SCAN_LENGTH];
            encode_request(&mut again, request.source, request.number, &demand);
            sink(again.iter().any(|byte| *byte == 7));
        }
        sink(Page::parse(PAGE.look()).is_ok_and(|page| page.data.len() > page.header.result.words().len()));
        sink(Page::find(MESSAGE.look()).is_ok() && StopIndex::parse(PAGE.look()).is_some());
    }

    /// Memory for the march, as the board's is.
    struct Words<'a>(&'a mut [u32]);

    impl Cells for Words<'_> {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn read(&self, place: usize) -> u32 {
            self.0.get(place).copied().unwrap_or(0)
        }
        fn write(&mut self, place: usize, value: u32) {
            if let Some(word) = self.0.get_mut(place) {
                *word = value;
            }
        }
    }

    static WORDS: Unknown<[u32; 64]> = Unknown::new([0; 64]);

    #[inline(never)]
    fn self_tests() {
        let now = Micros::new(TIME.read());
        let mut cells = Words(WORDS.look());
        let marched = memory::march_all(&mut cells).is_ok() && memory::transparent(&mut cells).is_ok();
        let regions = [Region { address: LENGTH.read(), words: LENGTH.read() }];
        sink(memory::block_of(&regions, LENGTH.read()).is_some() && memory::block_count(&regions) == 3);
        let mut stack = StackCheck::new();
        let [word, complement, ..] = WORDS.read();
        let marker = Marker::from_words([word, complement]);
        let flags = ResetFlags { power: marched, ..ResetFlags::default() };
        let (marker, start) = watchdog::after_reset(marker, flags);
        sink(matches!(start, watchdog::Start::Run { .. }) && marker.is_far_from_running());
        let mut clock = ClockCheck::new();
        clock.step(now, u16::try_from(word & 0xFFFF).unwrap_or(0));
        clock.step(Micros::new(TIME.read()), u16::try_from(complement & 0xFFFF).unwrap_or(0));
        sink(WORDS.look().first_chunk().and_then(random::secret_of).is_some());
        let mut schedule = Schedule::new();
        for outcome in [
            stack.step(&cells_of(WORDS.look())),
            clock.outcome(now),
            supply::check(
                u16::try_from(word >> 16).unwrap_or(0),
                u16::try_from(complement >> 16).unwrap_or(0),
            ),
            configuration::check(&RIG.read(), CONTROLLER.look().controller().calibration()),
            processor::check_registers(processor::CORE_REGISTERS, |seed| seed ^ word),
            processor::check_arithmetic(),
            processor::check_float_arithmetic(),
            program_outcome(),
        ] {
            schedule.record_start(schedule.next(), outcome, now);
            schedule.record(schedule.next(), outcome, now);
        }
        sink(schedule.report().verdict(now) == Verdict::Passed);
    }

    fn cells_of(words: &mut [u32; 64]) -> Words<'_> {
        Words(words)
    }

    fn program_outcome() -> Outcome {
        let seal = STATUS.look().first_chunk().copied().unwrap_or([0; SEAL_BYTES]);
        let mut check = ProgramCheck::new(&seal, u32::try_from(LENGTH.read()).unwrap_or(0));
        sink(check.wanted().is_some());
        let sealed = ImageSeal::of(MESSAGE.look(), &RIG.read()).is_some();
        match check.feed(MESSAGE.look().get(..LENGTH.read()).unwrap_or(&[])) {
            Progress::Intact => Outcome::passed_if(sealed),
            Progress::Underway => Outcome::Pending,
            Progress::Damaged => Outcome::Failed,
        }
    }

    #[cfg(feature = "control")]
    fn control() {
        let columns = COLUMNS.read();
        let index = LENGTH.read();
        sink(columns[index] == LineScanColumn::MISSING);
    }
}
