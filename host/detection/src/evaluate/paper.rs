//! The source paper's own figures, to stand beside ours.
//!
//! Its table "Performance of the object detector": YOLOv5m, 5,000 synthetic pictures split by picture (the same items and
//! floors in training and test), 640 pixels. It has no class for people.

/// Precision, recall and F1 of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperFigures {
    /// Canonical name.
    pub class: &'static str,
    /// Right detections of all.
    pub precision: f64,
    /// Objects found of all.
    pub recall: f64,
    /// As printed there.
    pub f1: f64,
}

const fn row(class: &'static str, precision: f64, recall: f64, f1: f64) -> PaperFigures {
    PaperFigures { class, precision, recall, f1 }
}

/// The table, in its order.
pub const TABLE: [PaperFigures; 10] = [
    row("bolt", 0.98, 0.92, 0.95),
    row("nut", 0.97, 0.90, 0.94),
    row("washer", 0.96, 0.88, 0.92),
    row("connector", 0.95, 0.89, 0.92),
    row("wire", 0.94, 0.87, 0.90),
    row("screwdriver", 0.93, 0.85, 0.89),
    row("wrench", 0.94, 0.87, 0.90),
    row("marker", 0.91, 0.82, 0.86),
    row("zip_tie", 0.92, 0.83, 0.87),
    row("allen_key", 0.95, 0.86, 0.90),
];

/// The paper's figures for a class by its canonical name.
#[must_use]
pub fn figures(class: &str) -> Option<&'static PaperFigures> {
    TABLE.iter().find(|row| row.class == class)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_f1_follows_from_its_precision_and_recall() {
        for PaperFigures { class, precision, recall, f1 } in TABLE {
            let harmonic = 2.0 * precision * recall / (precision + recall);
            assert!((harmonic - f1).abs() < 0.0101, "{class}: {harmonic} against {f1}");
            assert_eq!(crate::class::canonical_name(class), class);
        }
    }
}
