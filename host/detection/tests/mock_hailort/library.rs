//! A library with HailoRT's C interface and none of its hardware: it says what the "HEF" tells it to.
//!
//! Not part of the crate: the test compiles it by itself into a shared library. The HEF is a line of text, "behaviour
//! side classes"; the answers are made up, a box of class 1 whose score is the mean brightness of the picture.
#![allow(clippy::missing_safety_doc, missing_docs)]

use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;

const SUCCESS: u32 = 0;
const TIMED_OUT: u32 = 4;
const INVALID_HEF: u32 = 26;
const DEVICE_LOST: u32 = 62;
const MOST_A_CLASS: u32 = 5;

struct State {
    behaviour: String,
    side: usize,
    classes: usize,
    pictures: usize,
    brightness: f32,
    /// Handles given out and not yet taken back.
    open: i32,
}

static STATE: Mutex<State> =
    Mutex::new(State { behaviour: String::new(), side: 0, classes: 0, pictures: 0, brightness: 0.0, open: 0 });

fn state<T>(act: impl FnOnce(&mut State) -> T) -> T {
    act(&mut STATE.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
}

fn is(behaviour: &str) -> bool {
    state(|state| state.behaviour == behaviour)
}

/// For the test: handles that nobody released.
#[unsafe(no_mangle)]
pub extern "C" fn mock_open_handles() -> i32 {
    state(|state| state.open)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_get_library_version(version: *mut u32) -> u32 {
    let name = option_env!("MOCK_VERSION").unwrap_or("4");
    unsafe {
        version.write(name.parse().unwrap_or(4));
        version.add(1).write(23);
        version.add(2).write(0);
    }
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_create_vdevice(_: *mut c_void, device: *mut *mut c_void) -> u32 {
    unsafe { device.write(std::ptr::without_provenance_mut(1)) };
    state(|state| state.open += 1);
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_create_hef_file(hef: *mut *mut c_void, path: *const c_char) -> u32 {
    let path = unsafe { CStr::from_ptr(path) }.to_string_lossy().into_owned();
    let Ok(text) = std::fs::read_to_string(path) else { return INVALID_HEF };
    let parts: Vec<&str> = text.split_whitespace().collect();
    let [behaviour, side, classes] = parts[..] else { return INVALID_HEF };
    state(|state| {
        state.behaviour = behaviour.to_owned();
        state.side = side.parse().unwrap_or(0);
        state.classes = classes.parse().unwrap_or(0);
        state.open += 1;
    });
    unsafe { hef.write(std::ptr::without_provenance_mut(2)) };
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_configure_vdevice(
    _: *mut c_void,
    _: *mut c_void,
    _: *mut c_void,
    groups: *mut *mut c_void,
    count: *mut usize,
) -> u32 {
    unsafe {
        groups.write(std::ptr::without_provenance_mut(3));
        count.write(if is("two_groups") { 2 } else { 1 });
    }
    SUCCESS
}

/// Name and parameters: 128 + 28 bytes; the format's kind is their first number, the time-out their fourth.
unsafe fn parameters(kind: u32, list: *mut u8, count: *mut usize) -> u32 {
    unsafe {
        std::ptr::write_bytes(list, 0, 156);
        list.add(128).cast::<u32>().write_unaligned(kind);
        count.write(1);
    }
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_make_input_vstream_params(
    _: *mut c_void,
    _: bool,
    kind: u32,
    list: *mut u8,
    count: *mut usize,
) -> u32 {
    unsafe { parameters(kind, list, count) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_make_output_vstream_params(
    _: *mut c_void,
    _: bool,
    kind: u32,
    list: *mut u8,
    count: *mut usize,
) -> u32 {
    unsafe { parameters(kind, list, count) }
}

/// Bytes in, floats out, and a time-out: what else is asked for is refused.
unsafe fn create(expected_kind: u32, list: *const u8, count: usize, stream: *mut *mut c_void) -> u32 {
    let (kind, timeout) = unsafe {
        (list.add(128).cast::<u32>().read_unaligned(), list.add(140).cast::<u32>().read_unaligned())
    };
    if count != 1 || kind != expected_kind || timeout == 0 || is("no_stream") {
        return 2;
    }
    unsafe { stream.write(std::ptr::without_provenance_mut(4)) };
    state(|state| state.open += 1);
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_create_input_vstreams(
    _: *mut c_void,
    list: *const u8,
    count: usize,
    stream: *mut *mut c_void,
) -> u32 {
    unsafe { create(1, list, count, stream) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_create_output_vstreams(
    _: *mut c_void,
    list: *const u8,
    count: usize,
    stream: *mut *mut c_void,
) -> u32 {
    unsafe { create(3, list, count, stream) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_get_output_vstream_info(_: *mut c_void, info: *mut u8) -> u32 {
    let classes = state(|state| state.classes) as u32;
    unsafe {
        std::ptr::write_bytes(info, 0, 436);
        info.add(396).cast::<u32>().write_unaligned(if is("raw_order") { 1 } else { 22 });
        info.add(404).cast::<u32>().write_unaligned(classes);
        info.add(408).cast::<u32>().write_unaligned(MOST_A_CLASS);
    }
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_get_input_vstream_frame_size(_: *mut c_void, size: *mut usize) -> u32 {
    unsafe { size.write(state(|state| state.side * state.side * 3)) };
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_get_output_vstream_frame_size(_: *mut c_void, size: *mut usize) -> u32 {
    let full = state(|state| state.classes) * (1 + 5 * MOST_A_CLASS as usize) * 4;
    unsafe { size.write(if is("short") { 12 } else { full }) };
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_vstream_write_raw_buffer(_: *mut c_void, bytes: *const u8, size: usize) -> u32 {
    let picture = unsafe { std::slice::from_raw_parts(bytes, size) };
    let mean = picture.iter().map(|byte| f32::from(*byte)).sum::<f32>() / size as f32 / 255.0;
    state(|state| {
        state.brightness = mean;
        state.pictures += 1;
    });
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_vstream_read_raw_buffer(_: *mut c_void, bytes: *mut u8, size: usize) -> u32 {
    let (picture, brightness) = state(|state| (state.pictures, state.brightness));
    // The first answer is always good: the detector asks once when it is opened.
    let behaviour = if picture == 1 { "good".to_owned() } else { state(|state| state.behaviour.clone()) };
    let count = if behaviour == "bad_count" { 1e9 } else { 1.0 };
    let score = if behaviour == "nan" { f32::NAN } else { brightness };
    match behaviour.as_str() {
        "timeout_once" if picture == 2 => return TIMED_OUT,
        "timeout" => return TIMED_OUT,
        "lost" => return DEVICE_LOST,
        "silent" => return SUCCESS,
        _ => {}
    }
    let numbers = [0.0, count, 0.25, 0.25, 0.5, 0.75, score, 0.0];
    for (index, number) in numbers.iter().enumerate().take(size / 4) {
        unsafe { bytes.cast::<f32>().add(index).write_unaligned(*number) };
    }
    SUCCESS
}

fn released(count: usize) -> u32 {
    state(|state| state.open -= count as i32);
    SUCCESS
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_release_input_vstreams(_: *const *mut c_void, count: usize) -> u32 {
    released(count)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_release_output_vstreams(_: *const *mut c_void, count: usize) -> u32 {
    released(count)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_release_hef(_: *mut c_void) -> u32 {
    released(1)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hailo_release_vdevice(_: *mut c_void) -> u32 {
    released(1)
}
