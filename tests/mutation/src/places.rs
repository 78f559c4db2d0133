//! Finds the places of the mutants in a source file.

use crate::mutant::{Genre, Mutant, Place};
use proc_macro2::{LineColumn, Span};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};

/// A place of the source with its mutants, by number. All ranges are bytes of the source.
#[derive(Debug)]
pub enum Node {
    /// A function that gives one of these values instead.
    Function {
        /// All its statements.
        bytes: Range<usize>,
        /// The values.
        values: Vec<(u32, String)>,
    },
    /// Two operands.
    Binary {
        /// The whole expression.
        bytes: Range<usize>,
        /// The left operand.
        left: Range<usize>,
        /// As it is.
        operator: String,
        /// The right operand.
        right: Range<usize>,
        /// As the mutants have it.
        others: Vec<(u32, String)>,
    },
    /// One operand.
    Unary {
        /// The whole expression.
        bytes: Range<usize>,
        /// As it is.
        operator: &'static str,
        /// What is behind it.
        operand: Range<usize>,
        /// The mutant without it.
        number: u32,
    },
    /// A match arm's guard.
    Guard {
        /// The condition.
        bytes: Range<usize>,
        /// The mutant without the arm.
        removed: Option<u32>,
        /// The mutant whose guard is true.
        always: Option<u32>,
        /// The mutant whose guard is false.
        never: Option<u32>,
    },
    /// A match arm without a guard.
    Arm {
        /// Behind its pattern.
        before_arrow: usize,
        /// The mutant without the arm.
        number: u32,
    },
    /// A struct expression with a base.
    Struct {
        /// The whole expression.
        bytes: Range<usize>,
        /// What is left of it without one of its fields.
        without: Vec<(u32, Vec<Range<usize>>)>,
    },
}

/// Finds these mutants; one that is in no place that can be switched is not among the nodes.
///
/// # Errors
/// The file is no Rust.
pub fn find(source: &str, mutants: &BTreeMap<u32, &Mutant>) -> syn::Result<Vec<Node>> {
    let file = syn::parse_file(source)?;
    let mut wanted: HashMap<(Genre, Place), Vec<(u32, String)>> = HashMap::new();
    for (number, mutant) in mutants {
        let key = (mutant.genre, mutant.span.start);
        wanted.entry(key).or_default().push((*number, mutant.replacement.clone()));
    }
    let mut finder = Finder { wanted, nodes: Vec::new() };
    finder.visit_file(&file);
    Ok(finder.nodes)
}

struct Finder {
    wanted: HashMap<(Genre, Place), Vec<(u32, String)>>,
    nodes: Vec<Node>,
}

fn place(LineColumn { line, column }: LineColumn) -> Place {
    Place { line, column: column + 1 }
}

impl Finder {
    fn take(&mut self, genre: Genre, span: Span) -> Vec<(u32, String)> {
        self.wanted.remove(&(genre, place(span.start()))).unwrap_or_default()
    }

    fn first(&mut self, genre: Genre, span: Span) -> Option<u32> {
        self.take(genre, span).first().map(|(number, _)| *number)
    }

    fn function(&mut self, block: &syn::Block) {
        let (Some(first), Some(last)) = (block.stmts.first(), block.stmts.last()) else { return };
        let values = self.take(Genre::FnValue, first.span());
        let bytes = first.span().byte_range().start..last.span().byte_range().end;
        self.nodes.push(Node::Function { bytes, values });
    }
}

/// A condition that binds names cannot be an operand of anything else.
fn binds(expression: &syn::Expr) -> bool {
    match expression {
        syn::Expr::Let(_) => true,
        syn::Expr::Binary(binary) => binds(&binary.left) || binds(&binary.right),
        _ => false,
    }
}

/// Whether both take their operands the same way, so that one can be switched to the other.
fn alike(operator: &str, other: &str) -> bool {
    let kind = |operator: &str| match operator {
        "&&" | "||" => 0,
        "==" | "!=" | "<" | "<=" | ">" | ">=" => 1,
        other if other.ends_with('=') => 2,
        _ => 3,
    };
    kind(operator) == kind(other)
}

impl<'ast> Visit<'ast> for Finder {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.block);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.block);
        visit::visit_impl_item_fn(self, item);
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.function(block);
        }
        visit::visit_trait_item_fn(self, item);
    }

    fn visit_expr_binary(&mut self, binary: &'ast syn::ExprBinary) {
        let span = binary.op.span();
        let operator = span.source_text().unwrap_or_default();
        let mut others = self.take(Genre::BinaryOperator, span);
        others.retain(|(_, other)| alike(&operator, other));
        if !others.is_empty() && !binds(&binary.left) && !binds(&binary.right) {
            self.nodes.push(Node::Binary {
                bytes: binary.span().byte_range(),
                left: binary.left.span().byte_range(),
                operator,
                right: binary.right.span().byte_range(),
                others,
            });
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_expr_unary(&mut self, unary: &'ast syn::ExprUnary) {
        let operator = match unary.op {
            syn::UnOp::Not(_) => Some("!"),
            syn::UnOp::Neg(_) => Some("-"),
            _ => None,
        };
        if let (Some(operator), Some(number)) = (operator, self.first(Genre::UnaryOperator, unary.op.span()))
        {
            let (bytes, operand) = (unary.span().byte_range(), unary.expr.span().byte_range());
            self.nodes.push(Node::Unary { bytes, operator, operand, number });
        }
        visit::visit_expr_unary(self, unary);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        let removed = self.first(Genre::MatchArm, arm.span());
        if let Some((_, guard)) = &arm.guard {
            let mutants = self.take(Genre::MatchArmGuard, guard.span());
            let of = |value: &str| mutants.iter().find(|(_, text)| text == value).map(|(number, _)| *number);
            let (always, never) = (of("true"), of("false"));
            if !binds(guard) {
                self.nodes.push(Node::Guard { bytes: guard.span().byte_range(), removed, always, never });
            }
        } else if let Some(number) = removed {
            self.nodes.push(Node::Arm { before_arrow: arm.pat.span().byte_range().end, number });
        }
        visit::visit_arm(self, arm);
    }

    fn visit_expr_struct(&mut self, item: &'ast syn::ExprStruct) {
        let whole = item.span().byte_range();
        let mut without = Vec::new();
        for pair in item.fields.pairs() {
            let field = pair.value().span();
            let Some(number) = self.first(Genre::StructField, field) else { continue };
            let end = pair.punct().map_or(field, |comma| comma.span()).byte_range().end;
            let kept = vec![whole.start..field.byte_range().start, end..whole.end];
            without.push((number, kept));
        }
        if !without.is_empty() {
            self.nodes.push(Node::Struct { bytes: whole, without });
        }
        visit::visit_expr_struct(self, item);
    }
}
