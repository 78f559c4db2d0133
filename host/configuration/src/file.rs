//! The whole file.

use std::path::{Path, PathBuf};

use toml::Table;

use crate::interfaces::{self, Fleet, Ros2};
use crate::reader::{Problem, Problems, Section};
use crate::sections::{
    self, Camera, Detector, Field, Module, Page, Profile, RealTime, Recording, Robot, SpeedCase, SpeedInput,
    Spi, Zone,
};

/// Everything that the host is told.
#[derive(Debug, Clone, PartialEq)]
pub struct Configuration {
    /// The rig's file.
    pub rig: PathBuf,
    /// Whether the configuration names it. If not, `rig` is the usual place; with the twin and a simulated controller there need be none.
    pub rig_is_named: bool,
    /// What is used for the decision.
    pub profile: Profile,
    /// Which module this is.
    pub module: Module,
    /// How pictures are taken.
    pub camera: Camera,
    /// The controller.
    pub link: Spi,
    /// Tier 3.
    pub detector: Detector,
    /// What is kept.
    pub recording: Recording,
    /// The operator's page.
    pub page: Page,
    /// What ROS 2 is told.
    pub ros2: Ros2,
    /// The robot and the fleet that the module belongs to.
    pub fleet: Fleet,
    /// What is asked of the operating system.
    pub real_time: RealTime,
    /// The robot.
    pub robot: Robot,
    /// Named stretches of the stripe.
    pub zones: Vec<Zone>,
    /// How fast the robot is, as an input.
    pub speed: SpeedInput,
    /// Zones by speed, slowest first.
    pub cases: Vec<SpeedCase>,
}

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigurationError {
    /// The file could not be read.
    #[error("{}: cannot read the configuration: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{}: not a TOML file: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message with line and column.
        message: String,
    },
    /// Fields are wrong.
    #[error("{}: {} in the configuration:{}", path.display(), counted(problems.len()), listed(problems))]
    Fields {
        /// The file.
        path: PathBuf,
        /// All of them.
        problems: Vec<Problem>,
    },
}

fn counted(count: usize) -> String {
    if count == 1 { "one error".to_owned() } else { format!("{count} errors") }
}

fn listed(problems: &[Problem]) -> String {
    problems.iter().map(|problem| format!("\n  {problem}")).collect()
}

impl Configuration {
    /// The commented file with all defaults.
    pub const COMMENTED: &'static str = include_str!("nearfield.toml");

    /// Reads and checks a file; paths in it are relative to it.
    ///
    /// # Errors
    /// See [`ConfigurationError`]: every wrong field is named.
    pub fn load(path: &Path) -> Result<Self, ConfigurationError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ConfigurationError::Read { path: path.to_path_buf(), source })?;
        let mut configuration = Self::read(&text, path)?;
        if let Some(folder) = path.parent() {
            configuration.rig = folder.join(&configuration.rig);
        }
        Ok(configuration)
    }

    /// Checks a file's text; `path` is only for the messages.
    ///
    /// # Errors
    /// See [`ConfigurationError`].
    pub fn read(text: &str, path: &Path) -> Result<Self, ConfigurationError> {
        let table: Table = text.parse().map_err(|error: toml::de::Error| ConfigurationError::Syntax {
            path: path.to_path_buf(),
            message: error.to_string().trim_end().to_owned(),
        })?;
        let problems = Problems::default();
        let configuration = Self::of(&Section::root(&table, &problems));
        let problems = problems.take();
        if problems.is_empty() {
            Ok(configuration)
        } else {
            Err(ConfigurationError::Fields { path: path.to_path_buf(), problems })
        }
    }

    fn of(root: &Section<'_>) -> Self {
        let rig = root.path("rig");
        let rig_is_named = rig.is_some();
        let rig = rig.unwrap_or_else(|| PathBuf::from("rig.toml"));
        let profile = root.choice(
            "profile",
            Profile::Height,
            &[("cutoff", Profile::Cutoff), ("height", Profile::Height), ("semantics", Profile::Semantics)],
        );
        let zones: Vec<Zone> = root.list("zone").iter().map(sections::zone).collect();
        check_zones(root, &zones);
        let cases: Vec<SpeedCase> =
            root.list("case").iter().map(|case| sections::speed_case(case, &zones)).collect();
        if !cases.is_sorted_by(|one, other| one.up_to_mm_s < other.up_to_mm_s) {
            root.object("case", "speeds must rise from case to case");
        }
        let robot = sections::robot(&root.section("robot"));
        if cases.last().is_some_and(|case| case.up_to_mm_s < robot.speed_mm_s) {
            root.object("case", format!("no case covers the robot's speed of {} mm/s", robot.speed_mm_s));
        }
        let module = sections::module(&root.section("module"));
        let configuration = Self {
            rig,
            rig_is_named,
            profile,
            camera: sections::camera(&root.section("camera")),
            link: sections::link(&root.section("link")),
            detector: sections::detector(&root.section("detector")),
            recording: sections::recording(&root.section("recording")),
            page: sections::page(&root.section("page")),
            ros2: interfaces::ros2(&root.section("ros2"), &module),
            fleet: interfaces::fleet(&root.section("fleet")),
            module,
            real_time: sections::real_time(&root.section("real_time")),
            robot,
            zones,
            speed: sections::speed_input(&root.section("speed")),
            cases,
        };
        root.finish();
        configuration
    }
}

fn check_zones(root: &Section<'_>, zones: &[Zone]) {
    for (index, zone) in zones.iter().enumerate() {
        for other in &zones[index + 1..] {
            if zone.name == other.name {
                root.object("zone", format!("zone {} is defined twice", zone.name));
            }
            let both_stop = (zone.field, other.field) == (Field::Protective, Field::Protective);
            if both_stop && zone.start_mm < other.end_mm && other.start_mm < zone.end_mm {
                root.object("zone", format!("protective zones {} and {} overlap", zone.name, other.name));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::sections::{LinkKind, Source};
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Configuration, ConfigurationError> {
        Configuration::read(text, Path::new("robot.toml"))
    }

    fn problems(text: &str) -> Vec<String> {
        match read(text).unwrap_err() {
            ConfigurationError::Fields { problems, .. } => problems.iter().map(Problem::to_string).collect(),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn the_commented_file_says_what_an_empty_one_means() {
        let commented = read(Configuration::COMMENTED).unwrap();
        assert_eq!(commented, read("").unwrap());
        assert_eq!((commented.camera.source, commented.link.kind), (Source::Twin, LinkKind::InProcess));
        assert!(commented.page.listen.ip().is_loopback());
    }

    #[test]
    fn what_is_commented_out_is_sound_too() {
        let all: String = Configuration::COMMENTED
            .lines()
            .map(|line| {
                let bare = line.strip_prefix("# ").unwrap_or(line);
                let is_setting = bare.starts_with("[[")
                    || bare.split_once(" = ").is_some_and(|(key, _)| !key.contains(' '));
                format!("{}\n", if is_setting { bare } else { line })
            })
            .collect();
        // The one case does not cover the robot's speed: the example is of a slow one.
        let all = all.replace("speed_mm_s = 1000.0", "speed_mm_s = 300.0");
        let configuration = read(&all).unwrap();
        assert_eq!((configuration.zones.len(), configuration.cases.len()), (1, 1));
        assert!(configuration.recording.directory.is_some() && configuration.robot.distance_mm.is_some());
    }

    #[test]
    fn every_error_is_named_at_once() {
        let found = problems(
            "profile = \"all\"\nspeed = 3\n[camera]\nexposure_us = 99000\nwidth = \"wide\"\n[page]\nlisten = \"here\"\n\
             [real_time]\ncores = [1, -2]\nlock_memory = 1\n[module]\nname = \"Front left\"\n[[zone]]\nname = \"Z\"\nstart_mm = 5\nend_mm = 5",
        );
        let fields: Vec<_> = found.iter().map(|problem| problem.split(": ").next().unwrap()).collect();
        assert_eq!(
            fields,
            [
                "profile",
                "zone[1].name",
                "zone[1].end_mm",
                "module.name",
                "camera.width",
                "camera.exposure_us",
                "page.listen",
                "real_time.cores",
                "real_time.lock_memory",
                "speed",
            ]
        );
        let message = read("profile = 1\n[camera]\ngain = 0").unwrap_err().to_string();
        assert!(
            message.starts_with("robot.toml: 2 errors in the configuration:\n  profile: must be one of"),
            "{message}"
        );
    }

    #[test]
    fn limits_hold_on_both_sides() {
        for (text, sound) in [
            ("[camera]\nexposure_us = 10000", true),
            ("[camera]\nexposure_us = 10001", false),
            ("[camera]\nexposure_us = 9000\nframes_per_second = 110", true),
            ("[camera]\nexposure_us = 9100\nframes_per_second = 110", false),
            ("[link]\nhertz = 16000000", true),
            ("[link]\nhertz = 16000001", false),
            ("[detector]\ndeadline_ms = 10", true),
            ("[detector]\ndeadline_ms = 9", false),
            ("[real_time]\npriority = 98", true),
            ("[real_time]\npriority = 99", false),
        ] {
            assert_eq!(read(text).is_ok(), sound, "{text}");
        }
    }

    #[test]
    fn ros_names_follow_the_module_and_are_checked() {
        let ros2 = read("[module]\nname = \"rear_left\"").unwrap().ros2;
        assert_eq!(
            (ros2.namespace.as_str(), ros2.frame_id.as_str()),
            ("/nearfield/rear_left", "nearfield_rear_left")
        );
        assert!(!ros2.publish, "nothing is told on a network unless it is asked for");
        for (namespace, sound) in [
            ("/a", true),
            ("/a/b_2", true),
            ("a", false),
            ("/", false),
            ("/a/", false),
            ("/2", false),
            ("/a__b", false),
        ] {
            assert_eq!(read(&format!("[ros2]\nnamespace = \"{namespace}\"")).is_ok(), sound, "{namespace}");
        }
        assert_eq!(
            problems("[ros2]\ndomain = 233\nnetworks = [\"here\", \"::1\"]\nstamp = \"late\""),
            [
                "ros2.domain: must be a whole number from 0 to 232",
                "ros2.networks: \"here\" is no address, for instance \"192.168.1.20\"",
                "ros2.stamp: must be one of \"exposure\", \"sending\"",
            ]
        );
    }

    #[test]
    fn names_in_a_fleet_are_checked() {
        assert_eq!(read("").unwrap().fleet.carrier, crate::FleetCarrier::None);
        let sound = "[fleet]\nrobot = \"amr-17\"\nmodules = [\"front\", \"rear.2\"]\ncarrier = \"udp\"";
        assert_eq!(read(sound).unwrap().fleet.modules, ["front", "rear.2"]);
        let found =
            problems("[fleet]\nrobot = \"a/b\"\nmodules = [\"\"]\nto = \"there\"\ncarrier = \"mail\"");
        let fields: Vec<_> = found.iter().map(|problem| problem.split(": ").next().unwrap()).collect();
        assert_eq!(fields, ["fleet.carrier", "fleet.to", "fleet.robot", "fleet.modules"]);
    }

    #[test]
    fn zones_and_cases_must_fit_together() {
        let zones = "[[zone]]\nname = \"A\"\nstart_mm = -300\nend_mm = 10\n[[zone]]\nname = \"B\"\nstart_mm = 0\nend_mm = 300\n";
        assert_eq!(problems(zones), ["zone: protective zones A and B overlap"]);
        let apart = zones.replace("start_mm = 0", "start_mm = 10");
        assert!(read(&apart).is_ok());
        let twice = apart.replace("\"B\"", "\"A\"");
        assert_eq!(problems(&twice), ["zone: zone A is defined twice"]);
        let case =
            |up_to: f64, zone: &str| format!("[[case]]\nup_to_mm_s = {up_to}\nprotective = [\"{zone}\"]\n");
        assert!(read(&[&apart, &case(300.0, "A"), &case(1000.0, "B")].map(String::as_str).concat()).is_ok());
        let unknown = problems(&format!("{apart}{}", case(1000.0, "C")));
        assert_eq!(unknown, ["case[1].protective: zone C is not defined; add a [[zone]] with this name"]);
        let falling = problems(&format!("{apart}{}{}", case(1000.0, "A"), case(1000.0, "B")));
        assert_eq!(falling, ["case: speeds must rise from case to case"]);
        let slow = problems(&format!("{apart}{}", case(999.0, "A")));
        assert_eq!(slow, ["case: no case covers the robot's speed of 1000 mm/s"]);
        let empty = problems(&format!("{apart}[[case]]\nup_to_mm_s = 1000.0"));
        assert_eq!(empty, ["case[1].protective: names no zone: nothing would stop in this case"]);
    }

    #[test]
    fn a_replay_needs_its_input_and_paths_are_relative_to_the_file() {
        assert_eq!(
            problems("[camera]\nsource = \"replay\""),
            ["camera.input: is missing; name the folder of pictures to replay"]
        );
        let missing = Configuration::load(Path::new("no/such.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("no/such.toml: cannot read the configuration"), "{missing}");
        assert!(read("rig = ").unwrap_err().to_string().starts_with("robot.toml: not a TOML file"));
    }

    proptest! {
        /// Whatever is written into a field, the answer is a configuration or names the field.
        #[test]
        fn no_value_breaks_the_reader(
            section in "rig|profile|module|camera|link|detector|recording|page|real_time|robot|zone|case",
            key in "name|width|listen|cores|start_mm|up_to_mm_s|protective|input|device",
            value in "-?[0-9]{1,20}|true|\"[a-z:0-9.]{0,12}\"|\\[\\]|\\[1, \"a\"\\]|\\{a = 1\\}|nan|inf|1979-05-27",
            nested in 0_u8..3,
        ) {
            let text = match nested {
                0 => format!("{section} = {value}"),
                1 => format!("[{section}]\n{key} = {value}"),
                _ => format!("[[{section}]]\n{key} = {value}"),
            };
            if let Err(ConfigurationError::Fields { problems, .. }) = read(&text) {
                prop_assert!(problems.iter().all(|problem| !problem.field.is_empty() && !problem.problem.is_empty()));
            }
        }
    }
}
