//! The action table: what to do about an object of a known category and size, as one total function.
//!
//! Source: paper, table 1. Its cells contradict each other in places; every conflict is resolved to the more
//! restrictive action:
//!
//! * a glove is a small tool (continue) and a safety item (stop or reroute): safety items never continue;
//! * a cone is environment (stop) and safety (stop or reroute): environment stops;
//! * small humans have no cell (a hand below 50 mm): humans of every size stop;
//! * "stop or reroute": stopping first and then going around satisfies both readings, so [`Action::GoAround`] always
//!   includes the stop, see there;
//! * an unknown category or an unknown size takes the most restrictive cell of its row or table.

use crate::height::SizeClass;

/// The paper's seven categories and the honest eighth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Category {
    /// Any part of a person.
    Human,
    /// Drill, wrench, hammer, screwdriver; small: nuts, bolts, washers, markers.
    Tool,
    /// Boxes, pallets, planks, containers; small: paper, tape, film, straps.
    Material,
    /// Trim panels, brackets, extrusions; small: clips, fasteners, connectors.
    Part,
    /// Forklifts, carts, other robots.
    Vehicle,
    /// Cables, cones, pipes, signage, chair and table legs, portable devices.
    Environment,
    /// Barriers, protective equipment, safety glasses, gloves, jackets.
    SafetyItem,
    /// Not recognised, or not with enough confidence.
    Unknown,
}

impl Category {
    /// All categories.
    pub const ALL: [Self; 8] = [
        Self::Human,
        Self::Tool,
        Self::Material,
        Self::Part,
        Self::Vehicle,
        Self::Environment,
        Self::SafetyItem,
        Self::Unknown,
    ];
}

/// What the robot is advised to do, from the least to the most restrictive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Action {
    /// Continue over it: small debris. Advice only; the relay opens all the same unless the MCU itself has granted a
    /// run-over permit.
    RunOver,
    /// Stop, then go around it once the path planner has another way.
    GoAround,
    /// Stop, warn, and wait until the place is clear.
    StopAndWarn,
}

/// The action for a category and a size.
///
/// ```
/// use nearfield_shared::action::{action_for, Action, Category};
/// use nearfield_shared::height::SizeClass;
/// assert_eq!(action_for(Category::Tool, SizeClass::Small), Action::RunOver);
/// assert_eq!(action_for(Category::Human, SizeClass::Small), Action::StopAndWarn);
/// ```
#[must_use]
pub const fn action_for(category: Category, size: SizeClass) -> Action {
    match (category, size) {
        (Category::Tool | Category::Material, SizeClass::Small) => Action::RunOver,
        (Category::Tool, SizeClass::Large | SizeClass::Unknown)
        | (
            Category::Vehicle | Category::SafetyItem,
            SizeClass::Small | SizeClass::Large | SizeClass::Unknown,
        ) => Action::GoAround,
        (Category::Material, SizeClass::Large | SizeClass::Unknown)
        | (
            Category::Human | Category::Part | Category::Environment | Category::Unknown,
            SizeClass::Small | SizeClass::Large | SizeClass::Unknown,
        ) => Action::StopAndWarn,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Action::{GoAround, RunOver, StopAndWarn};

    /// The paper's table, cell by cell: category, small, large.
    const TABLE: [(Category, Action, Action); 8] = [
        (Category::Human, StopAndWarn, StopAndWarn),
        (Category::Tool, RunOver, GoAround),
        (Category::Material, RunOver, StopAndWarn),
        (Category::Part, StopAndWarn, StopAndWarn),
        (Category::Vehicle, GoAround, GoAround),
        (Category::Environment, StopAndWarn, StopAndWarn),
        (Category::SafetyItem, GoAround, GoAround),
        (Category::Unknown, StopAndWarn, StopAndWarn),
    ];

    #[test]
    fn every_cell_is_the_papers() {
        assert_eq!(TABLE.map(|(category, ..)| category), Category::ALL);
        for (category, small, large) in TABLE {
            assert_eq!(action_for(category, SizeClass::Small), small, "{category:?}");
            assert_eq!(action_for(category, SizeClass::Large), large, "{category:?}");
        }
    }

    #[test]
    fn an_unknown_size_is_never_less_restricted_than_a_known_one() {
        for category in Category::ALL {
            let unknown = action_for(category, SizeClass::Unknown);
            assert!(unknown >= action_for(category, SizeClass::Small), "{category:?}");
            assert!(unknown >= action_for(category, SizeClass::Large), "{category:?}");
        }
    }

    #[test]
    fn an_unknown_category_is_never_less_restricted_than_a_known_one() {
        for size in [SizeClass::Small, SizeClass::Large, SizeClass::Unknown] {
            for category in Category::ALL {
                assert!(action_for(Category::Unknown, size) >= action_for(category, size));
            }
        }
    }
}
