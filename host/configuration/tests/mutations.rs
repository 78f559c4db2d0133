//! Whatever becomes of a configuration file, reading it gives a configuration or says what is wrong; it never panics, and what it
//! accepts keeps every bound that the file's comments promise.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use nearfield_configuration::{Configuration, ConfigurationError};
use proptest::prelude::*;

fn read(text: &str) -> Result<Configuration, ConfigurationError> {
    Configuration::read(text, Path::new("robot.toml"))
}

/// The commented file with everything switched on that is commented out.
fn whole() -> String {
    let setting = |line: &str| {
        let bare = line.strip_prefix("# ")?;
        let named = bare.split_once(" = ").is_some_and(|(key, _)| !key.contains(' '));
        (bare.starts_with("[[") || named).then(|| bare.to_owned())
    };
    let text: String = Configuration::COMMENTED
        .lines()
        .map(|line| format!("{}\n", setting(line).unwrap_or_else(|| line.to_owned())))
        .collect();
    text.replace("speed_mm_s = 1000.0", "speed_mm_s = 300.0")
}

/// One thing that happens to a file.
#[derive(Debug, Clone)]
enum Mutation {
    /// Bytes are replaced, from a place on.
    Overwrite(usize, String),
    /// A line is lost.
    DropLine(usize),
    /// A line is there twice.
    RepeatLine(usize),
    /// Two lines change places.
    SwapLines(usize, usize),
    /// The value of a line becomes another one.
    Value(usize, String),
    /// The file ends early.
    Cut(usize),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let any = any::<usize>;
    prop_oneof![
        (any(), "[ -~\\n]{0,6}|\\PC{1,3}").prop_map(|(at, text)| Mutation::Overwrite(at, text)),
        any().prop_map(Mutation::DropLine),
        any().prop_map(Mutation::RepeatLine),
        (any(), any()).prop_map(|(one, other)| Mutation::SwapLines(one, other)),
        (
            any(),
            prop_oneof![
                "-?[0-9]{1,25}(\\.[0-9]{1,20})?(e-?[0-9]{1,4})?",
                "\"\\PC{0,20}\"",
                "-?(nan|inf)|true|\\[\\]|\\{\\}|\\[\\[1\\]\\]|\"127\\.0\\.0\\.1:[0-9]{1,7}\"",
                "0x[0-9a-f]{1,20}|1979-05-27T07:32:00Z|\"[A-J]\"|\\[\"[A-J]\"\\]",
            ]
        )
            .prop_map(|(line, value)| Mutation::Value(line, value)),
        any().prop_map(Mutation::Cut),
    ]
}

fn mutated(text: String, mutation: &Mutation) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    let count = lines.len().max(1);
    let at_character = |place: usize| {
        let mut place = place % (text.len() + 1);
        while !text.is_char_boundary(place) {
            place -= 1;
        }
        place
    };
    let changed;
    match mutation {
        Mutation::Overwrite(at, bytes) => {
            let start = at_character(*at);
            let mut end = (start + bytes.len()).min(text.len());
            while !text.is_char_boundary(end) {
                end += 1;
            }
            return [&text[..start], bytes, &text[end..]].concat();
        }
        Mutation::Cut(at) => return text[..at_character(*at)].to_owned(),
        _ if lines.is_empty() => return text,
        Mutation::DropLine(line) => {
            lines.remove(line % count);
        }
        Mutation::RepeatLine(line) => lines.insert(line % count, lines[line % count]),
        Mutation::SwapLines(one, other) => lines.swap(one % count, other % count),
        Mutation::Value(line, value) => {
            if let Some((key, _)) = lines[line % count].split_once('=') {
                changed = format!("{key}= {value}");
                lines[line % count] = &changed;
            }
        }
    }
    lines.join("\n")
}

/// What the file's comments promise of whatever is accepted.
fn assert_sound(configuration: &Configuration, text: &str) {
    let Configuration { camera, detector, robot, zones, cases, .. } = configuration;
    assert!((50..=10_000).contains(&camera.exposure_us), "{text}");
    assert!((5.0..=240.0).contains(&camera.frames_per_second), "{text}");
    assert!(f64::from(camera.exposure_us) <= 1e6 / camera.frames_per_second, "{text}");
    assert!((10..=2000).contains(&detector.deadline_ms), "{text}");
    assert!(robot.deceleration_mm_s2 >= 10.0 && robot.relay_drop_out_ms >= 0.0, "{text}");
    for zone in zones {
        assert!(zone.start_mm < zone.end_mm && matches!(zone.name.as_bytes(), [b'A'..=b'H']), "{text}");
    }
    assert!(cases.is_sorted_by(|one, other| one.up_to_mm_s < other.up_to_mm_s), "{text}");
    assert!(cases.last().is_none_or(|case| case.up_to_mm_s >= robot.speed_mm_s), "{text}");
    for name in cases.iter().flat_map(|case| case.protective.iter().chain(&case.warning)) {
        assert!(zones.iter().any(|zone| zone.name == *name), "{text}");
    }
    assert!(cases.iter().all(|case| !case.protective.is_empty()), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn a_mutated_file_is_sound_or_told_field_by_field(mutations in prop::collection::vec(mutation(), 1..6)) {
        let text = mutations.iter().fold(whole(), mutated);
        match read(&text) {
            Ok(configuration) => assert_sound(&configuration, &text),
            Err(ConfigurationError::Fields { problems, .. }) => {
                prop_assert!(!problems.is_empty());
                for problem in problems {
                    prop_assert!(!problem.field.is_empty() && !problem.problem.is_empty());
                }
            }
            Err(ConfigurationError::Syntax { message, .. }) => prop_assert!(!message.is_empty()),
            Err(other) => prop_assert!(false, "{}", other),
        }
    }

    #[test]
    fn arbitrary_text_never_breaks_the_reader(text in "\\PC{0,300}|[\\[\\]{}\"'=.,#\\n a-z0-9_-]{0,300}") {
        if let Ok(configuration) = read(&text) {
            assert_sound(&configuration, &text);
        }
    }
}

#[test]
fn what_the_mutations_begin_with_is_sound() {
    assert_sound(&read(&whole()).unwrap(), "the whole file");
}

/// A reader that calls itself for every bracket would end the program here, and not with an error.
#[test]
fn brackets_without_end_are_an_error() {
    for (open, count) in [("[", 100_000), ("{a=", 50_000), ("a.", 50_000)] {
        let told = read(&format!("x = {}", open.repeat(count))).unwrap_err();
        assert!(matches!(told, ConfigurationError::Syntax { .. }), "{open}");
        assert!(told.to_string().len() < 1_000_000, "{open}: a message of {} bytes", told.to_string().len());
    }
    assert!(read(&format!("{}x = 1", "a.".repeat(50_000))).is_err());
}
