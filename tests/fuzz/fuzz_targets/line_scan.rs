#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = nearfield_fuzz::fuzz::line_scan(data);
});
