//! The rows, one function each.

use std::path::Path;

use nearfield_configuration::{Configuration, LinkKind, Source};
use nearfield_shared::linescan::LINE_SCAN_LENGTH;

use super::{Check, Patient};

const NOT_A_PI: &str = "not a Raspberry Pi";

/// Degrees Celsius at which a Raspberry Pi 5 begins to slow down, and a margin before it.
const THROTTLING_AT: f64 = 80.0;
const WARM_AT: f64 = 70.0;
/// MiB that the disk of recordings should have left.
const LEAST_FREE_MIB: u64 = 256;

pub(super) fn all(patient: &Patient, configuration: &Configuration) -> Vec<Check> {
    let model = patient.text("/proc/device-tree/model").filter(|model| model.contains("Raspberry Pi"));
    let is_pi = model.is_some();
    let on_pi = |name: &'static str, check: &dyn Fn() -> Check| {
        if is_pi { check() } else { Check::not_here(name, NOT_A_PI) }
    };
    vec![
        computer(model.as_deref()),
        on_pi("camera", &|| camera(patient, configuration)),
        on_pi("focus", &|| focus(patient)),
        on_pi("SPI device", &|| spi_device(patient, configuration)),
        on_pi("SPI buffer", &|| spi_buffer(patient)),
        on_pi("READY line", &|| ready_line(patient, configuration)),
        rights(patient, configuration),
        on_pi("kernel", &|| kernel(patient)),
        on_pi("governor", &|| governor(patient)),
        clock(patient),
        on_pi("temperature", &|| temperature(patient)),
        on_pi("power", &|| power(patient)),
        disk(patient, configuration),
    ]
}

fn computer(model: Option<&str>) -> Check {
    const NAME: &str = "computer";
    match model {
        None => Check::not_here(NAME, NOT_A_PI),
        Some(model) if model.contains("Raspberry Pi 5") => Check::sound(NAME, model),
        Some(model) => Check::warning(
            NAME,
            model,
            "a Raspberry Pi 5 is what the figures are meant for; measure the latency",
        ),
    }
}

fn camera(patient: &Patient, configuration: &Configuration) -> Check {
    const NAME: &str = "camera";
    if !matches!(configuration.camera.source, Source::RpicamVid | Source::Libcamera) {
        return Check::sound(
            NAME,
            "not needed: the configuration takes its pictures elsewhere (camera.source)",
        );
    }
    let Some(list) = patient.ask("rpicam-hello", &["--list-cameras"]) else {
        return Check::problem(
            NAME,
            "rpicam-hello is not there or fails",
            "sudo apt install rpicam-apps-lite",
        );
    };
    let first = list.lines().map(str::trim).find(|line| line.starts_with("0 :"));
    match first {
        Some(camera) => Check::sound(NAME, camera.trim_start_matches("0 :").trim()),
        None => Check::problem(
            NAME,
            "no camera answers",
            "check the ribbon cable (both ends, contacts towards the board) and `dtoverlay` in /boot/firmware/config.txt",
        ),
    }
}

fn focus(patient: &Patient) -> Check {
    const NAME: &str = "focus";
    let list = patient.ask("rpicam-hello", &["--list-cameras"]).unwrap_or_default();
    if list.contains("imx708") {
        Check::sound(NAME, "Camera Module 3: its lens can be held; camera.focus_dioptres is used")
    } else {
        Check::warning(
            NAME,
            "the camera is no Camera Module 3 (imx708), or does not answer",
            "focus the lens by hand at the stripe's distance and lock it",
        )
    }
}

fn spi_device(patient: &Patient, configuration: &Configuration) -> Check {
    const NAME: &str = "SPI device";
    if configuration.link.kind != LinkKind::Spi {
        return Check::sound(NAME, "not needed: the configuration uses a simulated controller (link.kind)");
    }
    let device = &configuration.link.device;
    if !patient.exists(device) {
        let advice = "enable SPI: `sudo raspi-config nonint do_spi 0`, then restart";
        return Check::problem(NAME, format!("{} is not there", device.display()), advice);
    }
    let opened = std::fs::OpenOptions::new().read(true).write(true).open(patient.path(device));
    match opened {
        Ok(_) => Check::sound(NAME, device.display().to_string()),
        Err(error) => {
            let advice = "add the service's user to the group: `sudo adduser nearfield spi`";
            Check::problem(NAME, format!("{}: {error}", device.display()), advice)
        }
    }
}

fn spi_buffer(patient: &Patient) -> Check {
    const NAME: &str = "SPI buffer";
    match patient.text("/sys/module/spidev/parameters/bufsiz").map(|text| text.parse::<usize>()) {
        Some(Ok(size)) if size >= LINE_SCAN_LENGTH => Check::sound(NAME, format!("{size} bytes")),
        Some(Ok(size)) => Check::problem(
            NAME,
            format!("{size} bytes; a line-scan has {LINE_SCAN_LENGTH}"),
            "append spidev.bufsiz=4096 to /boot/firmware/cmdline.txt and restart",
        ),
        _ => Check::warning(
            NAME,
            "the module spidev is not loaded, or does not tell",
            "enable SPI: `sudo raspi-config nonint do_spi 0`, then restart",
        ),
    }
}

fn ready_line(patient: &Patient, configuration: &Configuration) -> Check {
    const NAME: &str = "READY line";
    let label = &configuration.link.chip;
    if patient.chips().contains(label) {
        return Check::sound(NAME, format!("line {} of {label}", configuration.link.ready_line));
    }
    let known = if patient.chips().is_empty() { "none".to_owned() } else { patient.chips().join(", ") };
    Check::problem(
        NAME,
        format!("no GPIO chip is labelled {label} (there are: {known})"),
        "set link.ready_chip to the label that `gpiodetect` shows; add the user to the group `gpio`",
    )
}

/// Bit of CAP_SYS_NICE in a capability mask.
const CAPABILITY_NICE: u32 = 23;

fn rights(patient: &Patient, configuration: &Configuration) -> Check {
    const NAME: &str = "real-time rights";
    let wanted = configuration.real_time.priority;
    if wanted == 0 {
        return Check::warning(
            NAME,
            "real_time.priority = 0",
            "set it to 60: other programs may delay pictures",
        );
    }
    let status = patient.text("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    let limits = patient.text("/proc/self/limits").unwrap_or_default();
    let limit = |name: &str| {
        let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
        let soft = line.split_whitespace().next()?;
        Some(if soft == "unlimited" { u64::MAX } else { soft.parse().ok()? })
    };
    let allowed = mask >> CAPABILITY_NICE & 1 == 1;
    let priority = limit("Max realtime priority").unwrap_or(0);
    let memory = limit("Max locked memory").unwrap_or(0);
    if !allowed && priority < u64::from(wanted) {
        let advice = "run it as the service, or set LimitRTPRIO=99 (`ulimit -r 99`)";
        return Check::warning(
            NAME,
            format!("priority {priority} is the highest allowed, {wanted} is wanted"),
            advice,
        );
    }
    if configuration.real_time.lock_memory && memory != u64::MAX {
        let advice = "run it as the service, or set LimitMEMLOCK=infinity (`ulimit -l unlimited`)";
        return Check::warning(NAME, "locked memory is limited", advice);
    }
    Check::sound(NAME, format!("SCHED_FIFO {wanted} and locked memory are allowed"))
}

fn kernel(patient: &Patient) -> Check {
    const NAME: &str = "kernel";
    if patient.text("/sys/kernel/realtime").as_deref() == Some("1") {
        Check::sound(NAME, "PREEMPT_RT")
    } else {
        Check::warning(
            NAME,
            "no PREEMPT_RT kernel",
            "it works without; `sudo apt install linux-image-rpi-v8-rt` shortens the longest delays",
        )
    }
}

fn governor(patient: &Patient) -> Check {
    const NAME: &str = "governor";
    match patient.text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").as_deref() {
        Some("performance") => Check::sound(NAME, "performance"),
        found => Check::warning(
            NAME,
            found.unwrap_or("unknown"),
            "the clock changes with load; the service sets \"performance\" when it starts",
        ),
    }
}

fn clock(patient: &Patient) -> Check {
    const NAME: &str = "clock";
    if patient.exists(Path::new("/run/systemd/timesync/synchronized"))
        || patient.ask("timedatectl", &["show", "-p", "NTPSynchronized", "--value"]).as_deref() == Some("yes")
    {
        return Check::sound(NAME, "synchronised");
    }
    Check::warning(
        NAME,
        "not synchronised",
        "recordings are named after the time; `timedatectl set-ntp true`, or give the robot a time server",
    )
}

fn temperature(patient: &Patient) -> Check {
    const NAME: &str = "temperature";
    let reading =
        patient.text("/sys/class/thermal/thermal_zone0/temp").and_then(|text| text.parse::<f64>().ok());
    let Some(degrees) = reading.map(|thousandths| thousandths / 1000.0) else {
        return Check::warning(
            NAME,
            "it does not tell",
            "look whether /sys/class/thermal/thermal_zone0 is there",
        );
    };
    let found = format!("{degrees:.0} degrees");
    if degrees >= THROTTLING_AT {
        Check::problem(NAME, found, "it slows itself down: fit the active cooler, or ventilate the housing")
    } else if degrees >= WARM_AT {
        Check::warning(NAME, found, "little margin for a hot day: fit the active cooler")
    } else {
        Check::sound(NAME, found)
    }
}

/// Bits of the firmware's answer, worst first: now, then since power-up.
const THROTTLED: [(u32, bool, &str); 8] = [
    (1 << 0, true, "under-voltage now"),
    (1 << 2, true, "throttled now"),
    (1 << 1, true, "clock capped now"),
    (1 << 3, true, "soft temperature limit now"),
    (1 << 16, false, "under-voltage since power-up"),
    (1 << 18, false, "throttled since power-up"),
    (1 << 17, false, "clock capped since power-up"),
    (1 << 19, false, "soft temperature limit since power-up"),
];

fn power(patient: &Patient) -> Check {
    const NAME: &str = "power";
    let answer = patient.ask("vcgencmd", &["get_throttled"]);
    let bits = answer.as_deref().and_then(|text| text.trim().strip_prefix("throttled=0x"));
    let Some(bits) = bits.and_then(|bits| u32::from_str_radix(bits, 16).ok()) else {
        return Check::warning(NAME, "vcgencmd does not answer", "add the user to the group `video`");
    };
    let held: Vec<_> = THROTTLED.iter().filter(|(mask, ..)| bits & mask != 0).collect();
    let words = held.iter().map(|(_, _, words)| *words).collect::<Vec<_>>().join(", ");
    let advice = "use the 27 W supply or a 5 V, 5 A converter with short cables, and cool it";
    match held.iter().any(|(_, now, _)| *now) {
        true => Check::problem(NAME, words, advice),
        false if held.is_empty() => Check::sound(NAME, "never too low, never throttled"),
        false => Check::warning(NAME, words, advice),
    }
}

fn disk(patient: &Patient, configuration: &Configuration) -> Check {
    const NAME: &str = "disk";
    let Some(folder) = &configuration.recording.directory else {
        return Check::warning(
            NAME,
            "nothing is recorded",
            "set recording.directory to keep what leads to stops",
        );
    };
    // The folder is made when it is needed: look at what is there already.
    let there = folder.ancestors().find(|folder| patient.exists(folder)).unwrap_or(Path::new("/"));
    let Ok(about) = rustix::fs::statvfs(patient.path(there)) else {
        return Check::problem(
            NAME,
            format!("{} cannot be looked at", there.display()),
            "check recording.directory",
        );
    };
    let free = about.f_bavail.saturating_mul(about.f_frsize) >> 20;
    let found = format!("{free} MiB free at {}", there.display());
    if free < LEAST_FREE_MIB {
        Check::problem(NAME, found, "make room: a full disk ends the recording (nothing else)")
    } else if free < u64::from(configuration.recording.limit_mib) {
        let advice = format!("recording.limit_mib = {} will not fit", configuration.recording.limit_mib);
        Check::warning(NAME, found, advice)
    } else {
        Check::sound(NAME, found)
    }
}
