//! From a detector's class names to the categories of the action table.
//!
//! Source: the paper's table 1, whose rows name examples. Where an example stands in two rows the more restrictive one is
//! taken: a connector is a small part (stop) rather than a fastener to run over, a wire is a cable (environment, stop).

use nearfield_shared::action::Category;

/// Class names, as `nearfield_detection` spells them, by category.
const NAMES: [(Category, &[&str]); 7] = [
    (Category::Human, &["hand", "foot", "leg", "person"]),
    (
        Category::Tool,
        &[
            "bolt",
            "nut",
            "washer",
            "screwdriver",
            "wrench",
            "marker",
            "allen_key",
            "drill",
            "hammer",
            "pliers",
        ],
    ),
    (
        Category::Material,
        &["zip_tie", "box", "pallet", "plank", "container", "paper", "tape", "film", "strap"],
    ),
    (Category::Part, &["connector", "extrusion", "bracket", "trim_panel", "clip", "fastener"]),
    (Category::Vehicle, &["forklift_tine", "cart_wheel", "cart", "robot", "forklift"]),
    (Category::Environment, &["wire", "cable", "cone", "pipe", "sign", "chair_leg", "table_leg", "phone"]),
    (Category::SafetyItem, &["glove", "safety_glasses", "barrier", "helmet", "vest", "jacket"]),
];

/// The category of a class; a name that nobody knows is unknown, the most restrictive.
///
/// ```
/// use nearfield_fusion::classes::category_of;
/// use nearfield_shared::action::Category;
/// assert_eq!(category_of("washer"), Category::Tool);
/// assert_eq!(category_of("teapot"), Category::Unknown);
/// ```
#[must_use]
pub fn category_of(class: &str) -> Category {
    NAMES
        .iter()
        .find(|(_, names)| names.contains(&class))
        .map_or(Category::Unknown, |(category, _)| *category)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nearfield_shared::action::{Action, action_for};
    use nearfield_shared::height::SizeClass;

    #[test]
    fn no_name_stands_twice() {
        let mut names: Vec<_> = NAMES.iter().flat_map(|(_, names)| names.iter()).collect();
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn people_and_strangers_are_never_run_over() {
        for class in ["hand", "foot", "leg", "person", "other", "teapot", ""] {
            assert_eq!(action_for(category_of(class), SizeClass::Small), Action::StopAndWarn, "{class}");
        }
    }

    #[test]
    fn the_papers_small_tools_may_be_run_over() {
        for class in ["bolt", "nut", "washer", "marker"] {
            assert_eq!(action_for(category_of(class), SizeClass::Small), Action::RunOver, "{class}");
        }
    }
}
