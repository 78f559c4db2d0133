//! The controller in lock-step with the host: see `nearfield_firmware::lockstep` for the records.

use crate::board::{self, Watchdog};
use crate::flash::{self, MemoryFlash};
use crate::semihosting::{Access, File};
use crate::target::Controller;
use embassy_futures::block_on;
use nearfield_firmware::lockstep::{REQUEST_HEADER_LENGTH, Reply, Request, RequestHeader, SimulatedTick};
use nearfield_firmware::safety::{Outputs, StartInputs};
use nearfield_firmware::secret::SECRET_LENGTH;
use nearfield_firmware::store::Store;
use nearfield_shared::limits::LARGEST_TRANSFER;
use nearfield_shared::status::ResetCause;
use nearfield_shared::units::Micros;
use static_cell::ConstStaticCell;

static PAYLOAD: ConstStaticCell<[u8; LARGEST_TRANSFER]> = ConstStaticCell::new([0; LARGEST_TRANSFER]);

/// Answers requests until the host goes away.
pub(crate) fn run(controller: &mut Controller, reset_cause: ResetCause) {
    let files = (File::open(c"requests", Access::Read), File::open(c"replies", Access::Write));
    let (Some(mut requests), Some(mut replies)) = files else {
        return crate::semihosting::print("cannot open the FIFOs `requests` and `replies`\n");
    };
    let payload = PAYLOAD.take();
    let mut watchdog: Option<Watchdog> = None;
    let mut store = Store::new(MemoryFlash::take(), 0);
    let mut header = [0; REQUEST_HEADER_LENGTH];
    while requests.read_exact(&mut header) {
        let Ok(record) = RequestHeader::parse(&header) else {
            return crate::semihosting::print("malformed request\n");
        };
        let length = usize::from(record.payload_length);
        let Some(payload) = payload.get_mut(..length) else { return };
        if !requests.read_exact(payload) {
            return;
        }
        let reply = match record.request {
            Request::Start => {
                let reply = start(controller, reset_cause, &record, payload, &mut watchdog);
                flash::put_rig(&mut store, payload.get(SECRET_LENGTH..).unwrap_or(&[]));
                work_on_flash(controller, record.now, &mut store);
                reply
            }
            Request::Tick(record_tick) => {
                tick(controller, record.now, record_tick, watchdog.as_mut(), &mut store)
            }
            Request::Exchange => exchange(controller, record.now, payload),
            Request::Hang => hang(),
            Request::Page => {
                if !replies.write_all(controller.page()) {
                    return;
                }
                continue;
            }
        };
        if !replies.write_all(&reply.to_bytes(record.request)) {
            return;
        }
    }
}

/// Out of reset; the watchdog starts when the rig's maps are filled.
fn start(
    controller: &mut Controller,
    reset_cause: ResetCause,
    record: &RequestHeader,
    payload: &[u8],
    watchdog: &mut Option<Watchdog>,
) -> Reply {
    // A rig that is refused is a cause to stop, and the status says so.
    let (secret, stored_rig) =
        payload.split_first_chunk::<SECRET_LENGTH>().unwrap_or((&[0; SECRET_LENGTH], &[]));
    let _ = controller.start(&StartInputs { reset_cause, stored_rig, secret: *secret });
    board::drive_relays(Outputs::SAFE.relays);
    *watchdog = Some(Watchdog::start());
    Reply { outputs: Outputs::SAFE, fed: false, status: controller.status(record.now) }
}

fn tick(
    controller: &mut Controller,
    now: Micros,
    simulated: SimulatedTick,
    watchdog: Option<&mut Watchdog>,
    store: &mut Store<MemoryFlash>,
) -> Reply {
    let output = controller.tick(now, simulated.inputs(now));
    board::drive_relays(output.outputs.relays);
    work_on_flash(controller, now, store);
    let fed = match (output.permit, watchdog) {
        (Some(permit), Some(watchdog)) => {
            watchdog.feed(permit);
            true
        }
        _ => false,
    };
    Reply { outputs: output.outputs, fed, status: controller.status(now) }
}

fn exchange(controller: &mut Controller, now: Micros, payload: &[u8]) -> Reply {
    let status = controller.status(now);
    let line_scan = (!payload.is_empty()).then_some(payload);
    let outputs = controller.on_exchange(now, line_scan);
    board::drive_relays(outputs.relays);
    Reply { outputs, fed: false, status }
}

/// What runs below the safety task on the board.
fn work_on_flash(controller: &mut Controller, now: Micros, store: &mut Store<MemoryFlash>) {
    if let Some(job) = controller.take_job() {
        let outcome = block_on(store.run(&job));
        controller.finish_job(now, &outcome);
    }
    while let Some(entry) = controller.unsaved_fault() {
        if block_on(store.save_entry(&entry)).is_err() {
            break;
        }
        controller.fault_saved(&entry);
    }
}

/// The injected fault: no way out but the watchdog.
fn hang() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}
