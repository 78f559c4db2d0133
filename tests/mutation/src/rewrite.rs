//! Rewrites a source file so that each of its mutants can be switched on at run time.
//!
//! The text is changed, not the syntax tree, so that a compiler's message can be traced to the mutant that causes it.

use crate::mutant::Mutant;
use crate::places::{self, Node};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// The call that asks the switch.
fn on(number: u32) -> String {
    format!("::mutation_switch::on({number})")
}

/// A rewritten file.
#[derive(Debug, Default)]
pub struct Rewritten {
    /// The text.
    pub text: String,
    /// Where in the text what is whose.
    pub regions: Vec<Region>,
    /// The numbers of the mutants that are in it.
    pub switched: BTreeSet<u32>,
}

/// A piece of the rewritten text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Bytes of the text.
    pub bytes: Range<usize>,
    /// The mutants that it exists for.
    pub numbers: Vec<u32>,
    /// It is what the mutant puts in the original's place, and nothing else.
    pub is_replacement: bool,
}

/// Part of what stands in a place's stead.
#[derive(Debug)]
enum Piece {
    Text(String),
    Source(Range<usize>),
    Replacement(u32, Vec<Piece>),
}

/// What stands in a place's stead.
#[derive(Debug)]
struct Edit {
    bytes: Range<usize>,
    pieces: Vec<Piece>,
    numbers: Vec<u32>,
}

/// Rewrites a file for these mutants of it, by number.
///
/// # Errors
/// The file is no Rust.
pub fn rewrite(source: &str, mutants: &BTreeMap<u32, &Mutant>) -> syn::Result<Rewritten> {
    let mut edits: Vec<Edit> = places::find(source, mutants)?.iter().filter_map(Edit::new).collect();
    // Outer ones first. The sort is stable: a function comes before its only expression, a guard before its condition.
    edits.sort_by_key(|edit| {
        let Range { start, end } = edit.bytes;
        (start, start != end, std::cmp::Reverse(end))
    });
    let mut rewritten = Rewritten::default();
    rewritten.switched.extend(edits.iter().flat_map(|edit| &edit.numbers));
    render(source, &edits, 0, 0..source.len(), &mut rewritten);
    Ok(rewritten)
}

/// Writes this range of the source, with the edits from `first` on that lie in it.
fn render(source: &str, edits: &[Edit], first: usize, range: Range<usize>, out: &mut Rewritten) {
    let mut at = range.start;
    for (number, edit) in edits.iter().enumerate().skip(first) {
        // What is nested in an edit that was written already lies behind `at`.
        if edit.bytes.start < at || edit.bytes.start > range.end || edit.bytes.end > range.end {
            continue;
        }
        out.text.push_str(&source[at..edit.bytes.start]);
        at = edit.bytes.end;
        let start = out.text.len();
        render_pieces(source, edits, number + 1, &edit.pieces, out);
        let bytes = start..out.text.len();
        out.regions.push(Region { bytes, numbers: edit.numbers.clone(), is_replacement: false });
    }
    out.text.push_str(&source[at..range.end]);
}

fn render_pieces(source: &str, edits: &[Edit], first: usize, pieces: &[Piece], out: &mut Rewritten) {
    for piece in pieces {
        match piece {
            Piece::Text(text) => out.text.push_str(text),
            Piece::Source(range) => render(source, edits, first, range.clone(), out),
            Piece::Replacement(number, pieces) => {
                let start = out.text.len();
                render_pieces(source, edits, first, pieces, out);
                let bytes = start..out.text.len();
                out.regions.push(Region { bytes, numbers: vec![*number], is_replacement: true });
            }
        }
    }
}

fn text(text: impl Into<String>) -> Piece {
    Piece::Text(text.into())
}

/// The operators that compare, and take their operands by reference.
const COMPARISONS: [&str; 6] = ["==", "!=", "<", "<=", ">", ">="];

impl Edit {
    fn new(node: &Node) -> Option<Self> {
        let (bytes, pieces, numbers) = match node {
            Node::Function { bytes, values } => {
                let mut pieces = Vec::new();
                for (number, value) in values {
                    pieces.push(text(format!("if {} {{ return ", on(*number))));
                    pieces.push(Piece::Replacement(*number, vec![text(value)]));
                    pieces.push(text("; } "));
                }
                pieces.push(Piece::Source(bytes.clone()));
                (bytes.clone(), pieces, numbers_of(values))
            }
            Node::Binary { bytes, left, operator, right, others } => {
                let pieces = binary(left, operator, right, others);
                (bytes.clone(), pieces, numbers_of(others))
            }
            Node::Unary { bytes, operator, operand, number } => {
                let pieces = vec![
                    text("(match ("),
                    Piece::Source(operand.clone()),
                    text(format!(") {{ mutation_operand => if {} {{ ", on(*number))),
                    Piece::Replacement(*number, vec![text("mutation_operand")]),
                    text(format!(" }} else {{ {operator}mutation_operand }} }})")),
                ];
                (bytes.clone(), pieces, vec![*number])
            }
            Node::Guard { bytes, removed, always, never } => (
                bytes.clone(),
                guard(bytes, *removed, *always, *never),
                numbers(&[*removed, *always, *never]),
            ),
            Node::Arm { before_arrow, number } => {
                (*before_arrow..*before_arrow, vec![text(format!(" if !{} ", on(*number)))], vec![*number])
            }
            Node::Struct { bytes, without } => {
                let mut pieces = vec![text("(")];
                for (number, kept) in without {
                    pieces.push(text(format!("if {} {{ ", on(*number))));
                    let kept = kept.iter().cloned().map(Piece::Source).collect();
                    pieces.push(Piece::Replacement(*number, kept));
                    pieces.push(text(" } else "));
                }
                pieces.extend([text("{ "), Piece::Source(bytes.clone()), text(" })")]);
                (bytes.clone(), pieces, numbers_of(without))
            }
        };
        (!numbers.is_empty()).then_some(Self { bytes, pieces, numbers })
    }
}

fn numbers(of: &[Option<u32>]) -> Vec<u32> {
    of.iter().flatten().copied().collect()
}

fn numbers_of<T>(of: &[(u32, T)]) -> Vec<u32> {
    of.iter().map(|(number, _)| *number).collect()
}

/// Each operand is evaluated once, in order, but for what "and" and "or" do not evaluate.
fn binary(left: &Range<usize>, operator: &str, right: &Range<usize>, others: &[(u32, String)]) -> Vec<Piece> {
    let (left, right) = (|| Piece::Source(left.clone()), || Piece::Source(right.clone()));
    let lazy = matches!(operator, "&&" | "||");
    let assigns = operator.ends_with('=') && !COMPARISONS.contains(&operator);
    let operation = |operator: &str| {
        if lazy {
            vec![text(format!("mutation_left {operator} (")), right(), text(")")]
        } else if assigns {
            vec![left(), text(format!(" {operator} mutation_right"))]
        } else if COMPARISONS.contains(&operator) {
            vec![text(format!("*mutation_left {operator} *mutation_right"))]
        } else {
            vec![text(format!("mutation_left {operator} mutation_right"))]
        }
    };
    let mut pieces = if lazy {
        vec![text("(match ("), left(), text(") { mutation_left => ")]
    } else if assigns {
        vec![text("(match ("), right(), text(") { mutation_right => ")]
    } else {
        let by = if COMPARISONS.contains(&operator) { "&" } else { "" };
        vec![
            text(format!("(match ({by}(")),
            left(),
            text(format!("), {by}(")),
            right(),
            text(")) { (mutation_left, mutation_right) => "),
        ]
    };
    for (number, other) in others {
        pieces.push(text(format!("if {} {{ ", on(*number))));
        // A comparison that becomes something else would need other operands: the caller leaves such mutants out.
        pieces.push(Piece::Replacement(*number, operation(other)));
        pieces.push(text(" } else "));
    }
    pieces.push(text("{ "));
    pieces.extend(operation(operator));
    pieces.push(text(" } })"));
    pieces
}

fn guard(bytes: &Range<usize>, removed: Option<u32>, always: Option<u32>, never: Option<u32>) -> Vec<Piece> {
    let mut pieces = vec![text("(")];
    pieces.extend(removed.map(|number| text(format!("!{} && ", on(number)))));
    pieces.push(text("("));
    pieces.extend(always.map(|number| text(format!("{} || ", on(number)))));
    pieces.extend(never.map(|number| text(format!("!{} && ", on(number)))));
    pieces.extend([text("("), Piece::Source(bytes.clone()), text(")))")]);
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutant::{Genre, Place, Span};

    /// The mutant that puts `replacement` where `original` stands for the first time behind `after`.
    fn mutant(source: &str, after: &str, original: &str, genre: Genre, replacement: &str) -> Mutant {
        let from = source.find(after).map_or(0, |at| at + after.len());
        let at =
            from + source[from..].find(original).unwrap_or_else(|| panic!("no {original} behind {after}"));
        let place = |at: usize| {
            let line_start = source[..at].rfind('\n').map_or(0, |end| end + 1);
            Place { line: source[..at].matches('\n').count() + 1, column: at - line_start + 1 }
        };
        Mutant {
            name: format!("{original} -> {replacement}"),
            file: "shared/src/a.rs".to_owned(),
            package: "nearfield-shared".to_owned(),
            genre,
            replacement: replacement.to_owned(),
            span: Span { start: place(at), end: place(at + original.len()) },
            function: None,
        }
    }

    fn rewritten(source: &str, mutants: &[Mutant]) -> Rewritten {
        let numbered: BTreeMap<u32, &Mutant> = (1..).zip(mutants).collect();
        let rewritten = rewrite(source, &numbered).unwrap_or_else(|error| panic!("{error}"));
        assert!(syn::parse_file(&rewritten.text).is_ok(), "{}", rewritten.text);
        rewritten
    }

    /// Without a mutant, not a byte changes.
    #[test]
    fn a_file_without_mutants_stays_as_it_is() {
        let source = "fn f(a: u8) -> bool {\n    a < 3 && !(a == 1)\n}\n";
        assert_eq!(rewritten(source, &[]).text, source);
    }

    /// Each operand stands once in the text, however deeply operators are nested: else the text would grow without end.
    #[test]
    fn nested_operators_are_switched_one_in_another() {
        let source = "fn f(a: u8, b: u8) -> bool { a + b * 2 < 9 }\n";
        let mutants = [
            mutant(source, "{", "+", Genre::BinaryOperator, "-"),
            mutant(source, "{", "*", Genre::BinaryOperator, "/"),
            mutant(source, "{", "<", Genre::BinaryOperator, "<="),
        ];
        let rewritten = rewritten(source, &mutants);
        assert_eq!(rewritten.switched, BTreeSet::from([1, 2, 3]));
        for call in ["on(1)", "on(2)", "on(3)"] {
            assert_eq!(rewritten.text.matches(call).count(), 1, "{}", rewritten.text);
        }
        assert!(rewritten.text.contains("{ mutation_left - mutation_right }"));
        assert!(rewritten.text.contains("{ *mutation_left <= *mutation_right }"));
    }

    /// What "and" does not evaluate is not evaluated.
    #[test]
    fn and_stays_lazy() {
        let source = "fn f(a: bool) -> bool { a && g() }\n";
        let rewritten = rewritten(source, &[mutant(source, "{", "&&", Genre::BinaryOperator, "||")]);
        let expected = "fn f(a: bool) -> bool { (match (a) { mutation_left => if ::mutation_switch::on(1) \
                        { mutation_left || (g()) } else { mutation_left && (g()) } }) }\n";
        assert_eq!(rewritten.text, expected);
    }

    #[test]
    fn a_function_gives_its_other_value() {
        let source = "const fn f(a: bool) -> bool {\n    a\n}\n";
        let rewritten = rewritten(source, &[mutant(source, "{\n    ", "a", Genre::FnValue, "true")]);
        assert!(
            rewritten.text.contains("if ::mutation_switch::on(1) { return true; } a"),
            "{}",
            rewritten.text
        );
        let replacement =
            rewritten.regions.iter().find(|region| region.is_replacement).unwrap_or_else(|| panic!());
        assert_eq!(&rewritten.text[replacement.bytes.clone()], "true");
    }

    #[test]
    fn arms_guards_and_fields_are_switched() {
        let source = "fn f(a: S) -> S { match a.x { 0 => a, 1 if a.y => S { y: false, ..a }, _ => S { x: -a.x, ..a } } }\n";
        let mutants = [
            mutant(source, "{ match a.x {", "0 => a", Genre::MatchArm, ""),
            mutant(source, "1 if ", "a.y", Genre::MatchArmGuard, "true"),
            mutant(source, "1 if ", "a.y", Genre::MatchArmGuard, "false"),
            mutant(source, "S { ", "y: false", Genre::StructField, ""),
            mutant(source, "x: ", "-", Genre::UnaryOperator, ""),
        ];
        let text = rewritten(source, &mutants).text;
        for part in [
            "0 if !::mutation_switch::on(1)  => a",
            "(::mutation_switch::on(2) || !::mutation_switch::on(3) && (a.y))",
            "if ::mutation_switch::on(4) { S {  ..a } } else { S { y: false, ..a } }",
            "if ::mutation_switch::on(5) { mutation_operand } else { -mutation_operand }",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
    }

    /// A condition that binds a name is no operand: such a mutant is left to cargo-mutants.
    #[test]
    fn what_binds_a_name_is_left_alone() {
        let source = "fn f(a: Option<u8>) -> bool { if let Some(b) = a && b > 1 { true } else { false } }\n";
        let mutants = [
            mutant(source, "{", "&&", Genre::BinaryOperator, "||"),
            mutant(source, "{", ">", Genre::BinaryOperator, "<"),
        ];
        assert_eq!(rewritten(source, &mutants).switched, BTreeSet::from([2]));
    }
}
