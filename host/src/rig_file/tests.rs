use super::*;

const GOOD: &str = include_str!("../../../tests/pictures/rigs/t2_std.toml");

fn refusal(text: &str) -> String {
    parse(text, Path::new("robot.toml")).unwrap_err().to_string()
}

#[test]
fn writing_and_reading_gives_the_same_rig() {
    let rig = parse(GOOD, Path::new("robot.toml")).unwrap();
    let again = parse(&to_toml(&rig), Path::new("robot.toml")).unwrap();
    assert_eq!(rig, again);
}

#[test]
fn every_missing_field_is_named_with_the_file() {
    for (section, fields) in SECTIONS {
        for field in fields {
            let mut table: Table = GOOD.parse().unwrap();
            table.get_mut(section).unwrap().as_table_mut().unwrap().remove(*field).unwrap();
            let message = refusal(&table.to_string());
            assert_eq!(message, format!("robot.toml: {section}.{field}: is missing; add it"));
        }
        let mut table: Table = GOOD.parse().unwrap();
        table.remove(section).unwrap();
        assert_eq!(refusal(&table.to_string()), format!("robot.toml: {section}: section is missing; add it"));
    }
}

#[test]
fn no_field_takes_a_value_of_another_kind_nor_one_that_is_not_finite() {
    for (section, fields) in SECTIONS {
        for field in fields {
            for bad in ["\"500\"", "nan", "[nan, 0.0, 0.0]", "true", "[]", "[[1, 2], [3, 4]]", "inf"] {
                let mut table: Table = GOOD.parse().unwrap();
                let value = format!("x = {bad}").parse::<Table>().unwrap().remove("x").unwrap();
                table.get_mut(section).unwrap().as_table_mut().unwrap().insert((*field).to_owned(), value);
                let message = refusal(&table.to_string());
                assert!(message.starts_with(&format!("robot.toml: {section}.{field}: ")), "{bad}: {message}");
            }
        }
    }
}

#[test]
fn run_over_is_off_unless_the_file_allows_it_in_so_many_words() {
    let rig = |text: &str| parse(text, Path::new("robot.toml")).unwrap();
    assert!(!rig(GOOD).allows_run_over());
    assert!(!rig(&format!("{GOOD}\n[run_over]\nallowed = false\n")).allows_run_over());
    let allowed = rig(&format!("{GOOD}\n[run_over]\nallowed = true\n"));
    assert!(allowed.allows_run_over());
    assert_eq!(rig(&to_toml(&allowed)), allowed);
    assert_ne!(allowed.calibration_id(), rig(GOOD).calibration_id(), "host and controller must agree on it");
    for bad in ["", "allowed = 1", "allowed = \"true\"", "allow = true"] {
        let message = refusal(&format!("{GOOD}\n[run_over]\n{bad}\n"));
        assert!(message.starts_with("robot.toml: run_over.allow"), "{bad}: {message}");
    }
}

#[test]
fn unknown_names_are_refused_not_ignored() {
    let message = refusal(&GOOD.replace("[laser]", "[laser]\npower = 1.0"));
    assert!(message.starts_with("robot.toml: laser.power: unknown name"), "{message}");
    assert!(refusal(&format!("{GOOD}\n[lens]\n")).starts_with("robot.toml: lens: unknown name"));
}

#[test]
fn a_contradiction_between_sections_names_the_field_to_correct() {
    let table = |edit: &dyn Fn(&mut Table)| {
        let mut table: Table = GOOD.parse().unwrap();
        edit(&mut table);
        refusal(&table.to_string())
    };
    let offset = table(&|table| {
        table["laser"].as_table_mut().unwrap().insert("plane_offset_mm".to_owned(), Value::Float(90.0));
    });
    assert!(offset.starts_with("robot.toml: laser.plane_offset_mm: contradicts laser.origin_mm"), "{offset}");
    let backwards = table(&|table| {
        let end = table["stripe"].as_table_mut().unwrap();
        end.insert("end_mm".to_owned(), Value::Float(-1000.0));
    });
    assert!(backwards.starts_with("robot.toml: stripe.end_mm: "), "{backwards}");
}

#[test]
fn text_that_is_not_toml_says_where() {
    let message = refusal("[image]\nwidth = = 3\n");
    assert!(message.starts_with("robot.toml: not a TOML file: ") && message.contains("line 2"), "{message}");
    let missing = load(Path::new("/nonexistent/robot.toml")).unwrap_err().to_string();
    assert!(missing.contains("cannot read the rig file"), "{missing}");
}

/// What calibration wrote about heights is read back; a file without it tells nothing, and nonsense is refused by name.
#[test]
fn the_heights_uncertainty_is_read_from_the_file_that_calibration_writes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("robot.toml");
    let load = |section: &str| {
        std::fs::write(&path, format!("{GOOD}\n{section}")).unwrap();
        load_deviation(&path)
    };
    assert_eq!(load("").unwrap(), None);
    assert_eq!(load("[uncertainty]\nplane_degrees = 0.1").unwrap(), None);
    let known = load("[uncertainty]\nheights_mm = [[0, 0, 0.5], [0.0, 100.0, 1.5]]").unwrap().unwrap();
    assert!((known.at(0.0, 50.0) - 1.0).abs() < 1e-6);
    for bad in ["heights_mm = 3", "heights_mm = [[1.0, 2.0]]", "heights_mm = [\"a\"]"] {
        let message = load(&format!("[uncertainty]\n{bad}")).unwrap_err().to_string();
        assert!(message.contains("robot.toml: uncertainty.heights_mm: must be a list"), "{message}");
    }
}
