//! Which files of the safety core are mutated together.

/// Files that are mutated together.
pub struct Group {
    /// As `--group` names it.
    pub name: &'static str,
    /// Whose tests judge.
    pub package: &'static str,
    /// From the package's `src`, without their ending.
    pub files: &'static [&'static str],
}

/// The most safety-relevant first.
pub const GROUPS: [Group; 6] = [
    Group {
        name: "permission",
        package: "nearfield-firmware",
        files: &["supervisor/mod", "relay", "output_test", "interlock", "flow", "integrity", "map_check"],
    },
    Group {
        name: "evidence",
        package: "nearfield-firmware",
        files: &[
            "link",
            "evidence",
            "secret",
            "liveness",
            "audit",
            "laser_code",
            "arming",
            "run_over",
            "safety/mod",
            "safety/findings",
            "safety/io",
        ],
    },
    Group {
        name: "judgement",
        package: "nearfield-shared",
        files: &["cutoff", "height", "monitor", "run_over", "light", "audit", "linescan", "status", "wire"],
    },
    Group { name: "health", package: "nearfield-firmware", files: &["health", "lockstep"] },
    Group {
        name: "formats",
        package: "nearfield-shared",
        files: &[
            "causes",
            "condition",
            "units",
            "limits",
            "action",
            "service",
            "service/page",
            "service/summary",
            "service/fault_entry",
            "rig",
            "columns",
            "camera",
            "laser",
        ],
    },
    Group {
        name: "records",
        package: "nearfield-firmware",
        files: &[
            "black_box",
            "black_box/recorded",
            "black_box/ring",
            "fault_log",
            "service",
            "store",
            "store/rig_slots",
            "selftest/mod",
            "selftest/clock",
            "selftest/configuration",
            "selftest/memory",
            "selftest/processor",
            "selftest/program",
            "selftest/random",
            "selftest/schedule",
            "selftest/stack",
            "selftest/supply",
            "selftest/watchdog",
        ],
    },
];

impl Group {
    /// A file's path from the repository's root.
    pub fn file(&self, name: &str) -> String {
        format!("{}/src/{name}.rs", self.package.trim_start_matches("nearfield-"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run;

    /// A new module of the safety core belongs to a group, or it is never mutated.
    #[test]
    fn every_module_of_the_safety_core_is_in_one_group() {
        let mut listed: Vec<String> =
            GROUPS.iter().flat_map(|group| group.files.iter().map(|name| group.file(name))).collect();
        listed.sort();
        let mut found = Vec::new();
        for room in ["shared/src", "firmware/src"] {
            collect(&run::root().join(room), &mut found);
        }
        found.sort();
        assert_eq!(listed, found);
    }

    fn collect(folder: &std::path::Path, found: &mut Vec<String>) {
        const NO_DECISIONS: [&str; 4] = ["lib.rs", "testing.rs", "model_check.rs", "flash_model.rs"];
        for entry in std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        {
            let path = entry.unwrap_or_else(|error| panic!("{}: {error}", folder.display())).path();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            if path.is_dir() && name != "bin" {
                collect(&path, found);
            } else if name.ends_with(".rs") && !name.ends_with("tests.rs") && !NO_DECISIONS.contains(&name) {
                let relative = path.strip_prefix(run::root()).map(|path| path.display().to_string());
                found.extend(relative);
            }
        }
    }
}
