#![allow(clippy::unwrap_used)]

use std::path::Path;

use nearfield_configuration::Configuration;

use super::*;

/// A Raspberry Pi 5 as it should be.
struct Tree(tempfile::TempDir);

const SOUND: [(&str, &str); 8] = [
    ("proc/device-tree/model", "Raspberry Pi 5 Model B Rev 1.0\0"),
    ("dev/spidev0.0", ""),
    ("sys/module/spidev/parameters/bufsiz", "4096\n"),
    ("proc/self/status", "Name:\tnearfield\nCapEff:\t0000000000800000\n"),
    ("proc/self/limits", "Max locked memory         unlimited            unlimited            bytes\n"),
    ("sys/kernel/realtime", "1\n"),
    ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
    ("sys/class/thermal/thermal_zone0/temp", "51300\n"),
];

impl Tree {
    fn sound() -> Self {
        let tree = Self(tempfile::tempdir().unwrap());
        for (name, text) in SOUND {
            tree.put(name, text);
        }
        tree.put("run/systemd/timesync/synchronized", "");
        tree
    }

    fn put(&self, name: &str, text: &str) {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn remove(&self, name: &str) {
        std::fs::remove_file(self.0.path().join(name)).unwrap();
    }
}

const CAMERAS: &str =
    "Available cameras\n-----------------\n0 : imx708 [4608x2592 10-bit RGGB] (/base/axi/pcie)";

fn answers(throttled: &'static str, cameras: &'static str) -> impl Fn(&str, &[&str]) -> Option<String> {
    move |program, _| match program {
        "vcgencmd" => Some(throttled.to_owned()),
        "rpicam-hello" => Some(cameras.to_owned()),
        _ => None,
    }
}

fn configuration() -> Configuration {
    let text = "[camera]\nsource = \"rpicam-vid\"\n[link]\nkind = \"spi\"\n[recording]\ndirectory = \"/var/lib/nearfield\"\nlimit_mib = 16";
    Configuration::read(text, Path::new("x.toml")).unwrap()
}

fn verdict(checks: &[Check], name: &str) -> Verdict {
    checks.iter().find(|check| check.name == name).unwrap().verdict
}

#[test]
fn a_sound_robot_has_nothing_to_do() {
    let tree = Tree::sound();
    let patient =
        Patient::made_up(tree.0.path(), answers("throttled=0x0", CAMERAS), &["gpio-brcmstb", "pinctrl-rp1"]);
    let checks = examine(&patient, &configuration());
    for check in &checks {
        assert_eq!((check.verdict, check.advice.as_str()), (Verdict::Sound, ""), "{check:?}");
    }
    assert_eq!(exit_code(&checks), 0);
}

/// Each fault changes the one row it should, and that row says what to do.
#[test]
fn every_fault_is_found_by_its_row() {
    type Damage = fn(&Tree);
    let cases: [(&str, Verdict, Damage); 9] = [
        ("computer", Verdict::Warning, |tree| tree.put("proc/device-tree/model", "Raspberry Pi 4 Model B")),
        ("SPI device", Verdict::Problem, |tree| tree.remove("dev/spidev0.0")),
        ("SPI buffer", Verdict::Problem, |tree| tree.put("sys/module/spidev/parameters/bufsiz", "3943")),
        ("real-time rights", Verdict::Warning, |tree| tree.put("proc/self/status", "CapEff:\t00000000")),
        ("real-time rights", Verdict::Warning, |tree| {
            tree.put("proc/self/limits", "Max locked memory 65536 65536 bytes")
        }),
        ("kernel", Verdict::Warning, |tree| tree.remove("sys/kernel/realtime")),
        ("clock", Verdict::Warning, |tree| tree.remove("run/systemd/timesync/synchronized")),
        ("temperature", Verdict::Problem, |tree| tree.put("sys/class/thermal/thermal_zone0/temp", "80000")),
        ("temperature", Verdict::Warning, |tree| tree.put("sys/class/thermal/thermal_zone0/temp", "79999")),
    ];
    for (name, expected, damage) in cases {
        let tree = Tree::sound();
        damage(&tree);
        let patient = Patient::made_up(tree.0.path(), answers("throttled=0x0", CAMERAS), &["pinctrl-rp1"]);
        let checks = examine(&patient, &configuration());
        assert_eq!(verdict(&checks, name), expected, "{checks:?}");
        let changed: Vec<_> = checks.iter().filter(|check| check.verdict != Verdict::Sound).collect();
        assert!(changed.len() == 1 && !changed[0].advice.is_empty(), "{changed:?}");
        assert_eq!(exit_code(&checks), u8::from(expected == Verdict::Problem));
    }
}

#[test]
fn programs_and_chips_are_asked_too() {
    let tree = Tree::sound();
    let examined = |throttled, cameras, chips: &[&str]| {
        examine(&Patient::made_up(tree.0.path(), answers(throttled, cameras), chips), &configuration())
    };
    let sagging = examined("throttled=0x1", CAMERAS, &["pinctrl-rp1"]);
    assert_eq!(verdict(&sagging, "power"), Verdict::Problem);
    let sagged = examined("throttled=0x50000", CAMERAS, &["pinctrl-rp1"]);
    let row = sagged.iter().find(|check| check.name == "power").unwrap();
    assert_eq!(row.verdict, Verdict::Warning);
    assert_eq!(row.found, "under-voltage since power-up, throttled since power-up");
    assert_eq!(verdict(&examined("error", CAMERAS, &[]), "power"), Verdict::Warning);
    let blind = examined("throttled=0x0", "No cameras available!", &["pinctrl-rp1"]);
    assert_eq!((verdict(&blind, "camera"), verdict(&blind, "focus")), (Verdict::Problem, Verdict::Warning));
    let other = examined("throttled=0x0", CAMERAS, &["gpio-brcmstb"]);
    assert_eq!(verdict(&other, "READY line"), Verdict::Problem);
}

#[test]
fn another_computer_says_so_row_by_row_and_is_never_sound() {
    let tree = Tree(tempfile::tempdir().unwrap());
    let checks = examine(&Patient::made_up(tree.0.path(), |_, _| None, &[]), &configuration());
    let rows = checks.iter().filter(|check| check.found == "not a Raspberry Pi").count();
    assert_eq!((rows, exit_code(&checks)), (10, 1), "{checks:?}");
}

#[test]
fn this_computer_can_be_looked_at() {
    let checks = examine(&Patient::this(), &configuration());
    assert_eq!(checks.len(), 13);
    assert!(checks.iter().all(|check| !check.found.is_empty()));
}
