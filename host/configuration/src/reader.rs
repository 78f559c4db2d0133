//! Reads TOML tables field by field and collects what is wrong, instead of ending at the first error.

use std::cell::RefCell;
use std::net::{Ipv4Addr, SocketAddr};
use std::ops::RangeInclusive;
use std::path::PathBuf;

use toml::{Table, Value};

/// One thing that is wrong with a configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The field's full name, for instance `camera.exposure_us`.
    pub field: String,
    /// What is wrong, and what to do.
    pub problem: String,
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.field, self.problem)
    }
}

/// Where problems are collected.
#[derive(Debug, Default)]
pub(crate) struct Problems(RefCell<Vec<Problem>>);

impl Problems {
    pub(crate) fn add(&self, field: impl Into<String>, problem: impl Into<String>) {
        self.0.borrow_mut().push(Problem { field: field.into(), problem: problem.into() });
    }

    pub(crate) fn take(self) -> Vec<Problem> {
        self.0.into_inner()
    }
}

/// One section of the file; a missing one reads as empty.
pub(crate) struct Section<'a> {
    name: String,
    table: Option<&'a Table>,
    known: RefCell<Vec<&'static str>>,
    problems: &'a Problems,
}

impl<'a> Section<'a> {
    /// The whole file.
    pub(crate) fn root(table: &'a Table, problems: &'a Problems) -> Self {
        Self { name: String::new(), table: Some(table), known: RefCell::default(), problems }
    }

    fn full(&self, key: &str) -> String {
        if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) }
    }

    /// A problem with one of its fields.
    pub(crate) fn object(&self, key: &str, problem: impl Into<String>) {
        self.problems.add(self.full(key), problem);
    }

    fn value(&self, key: &'static str) -> Option<&'a Value> {
        self.known.borrow_mut().push(key);
        self.table?.get(key)
    }

    /// Is the field there?
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.is_some_and(|table| table.contains_key(key))
    }

    /// A section within it.
    pub(crate) fn section(&self, key: &'static str) -> Self {
        let value = self.value(key);
        let table = value.and_then(Value::as_table);
        if value.is_some() && table.is_none() {
            self.object(key, "must be a section, not a value");
        }
        Self { name: self.full(key), table, known: RefCell::default(), problems: self.problems }
    }

    /// The entries of a list of sections, `[[key]]`.
    pub(crate) fn list(&self, key: &'static str) -> Vec<Self> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let Some(list) = value.as_array() else {
            self.object(key, format!("must be a list of sections, `[[{key}]]`"));
            return Vec::new();
        };
        let entry = |(index, value): (usize, &'a Value)| {
            let name = format!("{}[{}]", self.full(key), index + 1);
            let table = value.as_table();
            if table.is_none() {
                self.problems.add(&name, "must be a section, not a value");
            }
            Self { name, table, known: RefCell::default(), problems: self.problems }
        };
        list.iter().enumerate().map(entry).collect()
    }

    /// A number in a range, with its unit for the message.
    pub(crate) fn number(
        &self,
        key: &'static str,
        default: f64,
        range: RangeInclusive<f64>,
        unit: &str,
    ) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "no field has an integer beyond 2^53")]
        let read = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
        match self.value(key).map(read) {
            None => default,
            Some(Some(number)) if range.contains(&number) => number,
            Some(_) => {
                self.object(
                    key,
                    format!("must be a number from {} to {} {unit}", range.start(), range.end()),
                );
                default
            }
        }
    }

    /// A whole number in a range.
    pub(crate) fn whole(
        &self,
        key: &'static str,
        default: u32,
        range: RangeInclusive<u32>,
        unit: &str,
    ) -> u32 {
        match self.value(key).map(|value| value.as_integer().and_then(|whole| u32::try_from(whole).ok())) {
            None => default,
            Some(Some(whole)) if range.contains(&whole) => whole,
            Some(_) => {
                let (low, high) = (range.start(), range.end());
                self.object(key, format!("must be a whole number from {low} to {high} {unit}").trim_end());
                default
            }
        }
    }

    /// True or false.
    pub(crate) fn flag(&self, key: &'static str, default: bool) -> bool {
        match self.value(key).map(Value::as_bool) {
            None => default,
            Some(Some(flag)) => flag,
            Some(None) => {
                self.object(key, "must be true or false");
                default
            }
        }
    }

    /// A text that is not empty.
    pub(crate) fn text(&self, key: &'static str, default: &str) -> String {
        match self.value(key).map(Value::as_str) {
            None => default.to_owned(),
            Some(Some(text)) if !text.trim().is_empty() => text.to_owned(),
            Some(_) => {
                self.object(key, "must be a text in quotation marks, and not empty");
                default.to_owned()
            }
        }
    }

    /// A text; `None` if it is not given.
    pub(crate) fn optional_text(&self, key: &'static str) -> Option<String> {
        Some(self.text(key, "")).filter(|text| !text.is_empty())
    }

    /// A path; `None` if it is not given.
    pub(crate) fn path(&self, key: &'static str) -> Option<PathBuf> {
        self.optional_text(key).map(PathBuf::from)
    }

    /// An address and a port; this computer's own address with this port if it is not given.
    pub(crate) fn address(&self, key: &'static str, port: u16) -> SocketAddr {
        let default = SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port);
        self.text(key, &default.to_string()).parse().unwrap_or_else(|_| {
            self.object(key, format!("must be an address and a port, for instance \"{default}\""));
            default
        })
    }

    /// A list of texts.
    pub(crate) fn names(&self, key: &'static str) -> Vec<String> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let name = |value: &Value| value.as_str().map(str::to_owned);
        let names = value.as_array().map(|list| list.iter().map(name).collect::<Option<Vec<_>>>());
        if let Some(Some(names)) = names {
            return names;
        }
        self.object(key, "must be a list of names in quotation marks");
        Vec::new()
    }

    /// One of some names.
    pub(crate) fn choice<T: Copy>(&self, key: &'static str, default: T, choices: &[(&str, T)]) -> T {
        let Some(value) = self.value(key) else { return default };
        let named = value.as_str().and_then(|text| choices.iter().find(|(name, _)| *name == text));
        if let Some((_, choice)) = named {
            return *choice;
        }
        let names: Vec<_> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        self.object(key, format!("must be one of {}", names.join(", ")));
        default
    }

    /// Whole numbers in a range.
    pub(crate) fn wholes(&self, key: &'static str, range: RangeInclusive<u32>) -> Vec<u32> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let read = |value: &Value| {
            value
                .as_integer()
                .and_then(|whole| u32::try_from(whole).ok())
                .filter(|whole| range.contains(whole))
        };
        let wholes = value.as_array().map(|list| list.iter().map(read).collect::<Option<Vec<_>>>());
        if let Some(Some(wholes)) = wholes {
            return wholes;
        }
        self.object(
            key,
            format!("must be a list of whole numbers from {} to {}", range.start(), range.end()),
        );
        Vec::new()
    }

    /// Names every field that nobody has asked for.
    pub(crate) fn finish(&self) {
        let known = self.known.borrow();
        let Some(table) = self.table else { return };
        for key in table.keys().filter(|key| !known.contains(&key.as_str())) {
            self.object(key, format!("unknown name; remove or correct it (known: {})", known.join(", ")));
        }
    }
}
