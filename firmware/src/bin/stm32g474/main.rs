//! placeholder
#![cfg_attr(target_os = "none", no_std, no_main)]
#[cfg(target_os = "none")]
mod target {
    #[panic_handler]
    fn panic(_info: &core::panic::PanicInfo<'_>) -> ! {
        loop {}
    }
    #[cortex_m_rt::entry]
    fn main() -> ! {
        loop {}
    }
}
#[cfg(not(target_os = "none"))]
fn main() {}
