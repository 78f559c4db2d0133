//! The unit tests of the safety core that take most of their time.

/// Tests that take most of the unit tests' time and judge few mutants: left out at first, never for a survivor.
const SLOW_TESTS: [(&str, &[&str]); 2] = [
    (
        "nearfield-firmware",
        &[
            "model_check::every_reachable_state_keeps_the_rules",
            "safety::run_over_tests::only_a_low_thing_that_is_claimed_as_debris_passes",
            "safety::tests::damaged_memory_locks_out",
            "store::tests::a_power_cut_at_any_byte_costs_at_most_the_entry_that_was_being_written",
            "store::tests::a_power_cut_at_any_byte_leaves_the_old_rig_or_the_new_one",
            "store::tests::a_second_power_cut_after_the_first_leaves_a_whole_rig_too",
        ],
    ),
    (
        "nearfield-shared",
        &[
            "tier_tests::losing_columns_never_heals_a_cut",
            "tier_tests::no_reading_panics",
            "wire::tests::every_pattern_of_up_to_five_wrong_bits_is_found",
        ],
    ),
];

/// Arguments for the test program of this package that leave its slow tests out.
pub fn left_out(package: &str) -> Vec<&'static str> {
    of(package).flat_map(|test| ["--skip", test]).collect()
}

/// The slow tests of this package.
pub fn of(package: &str) -> impl Iterator<Item = &'static str> {
    let slow = SLOW_TESTS.iter().filter(move |(name, _)| *name == package);
    slow.flat_map(|(_, tests)| tests.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run;
    use anyhow::Result;
    use std::path::Path;

    /// A slow test that is renamed would be run again unnoticed; one that is misspelt never left out.
    #[test]
    fn the_slow_tests_exist() -> Result<()> {
        for (package, tests) in SLOW_TESTS {
            let mut files = Vec::new();
            let room = run::root().join(package.trim_start_matches("nearfield-")).join("src");
            every_file(&room, &mut files)?;
            for test in tests {
                let name = test.rsplit("::").next().unwrap_or(test);
                let function = format!("fn {name}(");
                assert!(files.iter().any(|source| source.contains(&function)), "{package}: {test}");
            }
        }
        Ok(())
    }

    fn every_file(folder: &Path, sources: &mut Vec<String>) -> Result<()> {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                every_file(&path, sources)?;
            } else {
                sources.push(std::fs::read_to_string(&path)?);
            }
        }
        Ok(())
    }
}
