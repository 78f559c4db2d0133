//! The list of mutants, as `cargo mutants --list --json` gives it.

use anyhow::{Context as _, Result};
use serde::Deserialize;
use std::path::Path;

/// One place in the source, and what stands there instead.
#[derive(Debug, Clone, Deserialize)]
pub struct Mutant {
    /// As cargo-mutants calls it: file, place, what is changed.
    pub name: String,
    /// The file, from the repository's root.
    pub file: String,
    /// The package whose tests judge it.
    pub package: String,
    /// What kind of change it is.
    pub genre: Genre,
    /// What stands there instead; empty = nothing.
    pub replacement: String,
    /// The place.
    pub span: Span,
    /// The function that it is in; none = a constant, which the compiler evaluates.
    pub function: Option<Function>,
}

/// A function.
#[derive(Debug, Clone, Deserialize)]
pub struct Function {
    /// With its type.
    #[allow(dead_code, reason = "for people who look at a mutant")]
    pub function_name: String,
}

/// The kinds of changes that cargo-mutants makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
pub enum Genre {
    /// A function's body is a constant.
    FnValue,
    /// An operator between two operands is another one.
    BinaryOperator,
    /// An operator in front of its operand is gone.
    UnaryOperator,
    /// A match arm is gone.
    MatchArm,
    /// A match arm's guard is a constant.
    MatchArmGuard,
    /// A field of a struct expression comes from its base.
    StructField,
}

/// From the first character to behind the last one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
pub struct Span {
    /// The first character.
    pub start: Place,
    /// Behind the last one.
    pub end: Place,
}

/// Both counted from 1; columns are characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
pub struct Place {
    /// The line.
    pub line: usize,
    /// The column.
    pub column: usize,
}

/// Reads the list.
///
/// # Errors
/// The file cannot be read, or is not such a list.
pub fn read_list(path: &Path) -> Result<Vec<Mutant>> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    serde_json::from_str(&text).with_context(|| format!("{}: not a list of mutants", path.display()))
}
