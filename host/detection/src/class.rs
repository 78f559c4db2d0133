//! Names of classes: spellings, synonyms, and which of them are people.

/// Names that mean the same thing; the first of each row is the one this project uses.
const SYNONYMS: [&[&str]; 22] = [
    &["bolt", "screw", "machine_screw", "hex_bolt"],
    &["nut", "hex_nut"],
    &["washer"],
    &["connector", "plug"],
    &["wire"],
    &["screwdriver"],
    &["wrench", "spanner"],
    &["marker", "marker_pen", "pen"],
    &["zip_tie", "cable_tie", "tie_wrap", "ziptie"],
    &["allen_key", "hex_key", "allen_wrench", "allenkey", "hexkey"],
    &["hand"],
    &["foot", "shoe", "boot"],
    &["leg", "knee"],
    &["person", "human", "arm", "lying_person", "person_lying", "body", "pedestrian"],
    &["box", "cardboard_box", "carton"],
    &["extrusion", "aluminium_extrusion", "aluminum_extrusion", "profile"],
    &["pallet", "pallet_corner"],
    &["cone", "traffic_cone"],
    &["glove", "gloves"],
    &["safety_glasses", "glasses", "goggles"],
    &["cable", "cord"],
    &["cart_wheel", "wheel", "castor", "caster"],
];

/// Classes that are people or parts of people. Missing one of these is the worst mistake of tier 3.
const HUMAN: [&str; 4] = ["hand", "foot", "leg", "person"];

/// The project's spelling of a name: small letters, words joined by underscores, synonyms resolved.
///
/// ```
/// use nearfield_detection::class::canonical_name;
/// assert_eq!(canonical_name("Allen Key"), "allen_key");
/// assert_eq!(canonical_name("cable-tie"), "zip_tie");
/// assert_eq!(canonical_name("shoe"), "foot");
/// assert_eq!(canonical_name("Hex Keys"), "allen_key");
/// assert_eq!(canonical_name("teapot"), "teapot");
/// ```
#[must_use]
pub fn canonical_name(name: &str) -> String {
    let mut joined = String::with_capacity(name.len());
    for character in name.trim().chars() {
        if character.is_alphanumeric() {
            joined.extend(character.to_lowercase());
        } else if !joined.ends_with('_') {
            joined.push('_');
        }
    }
    let plain = joined.trim_matches('_');
    let known = |wanted: &str| SYNONYMS.iter().find(|row| row.contains(&wanted)).map(|row| row[0]);
    // A plural is tried last, so that a name that merely ends in s ("glasses") is found as it stands.
    known(plain)
        .or_else(|| plain.strip_suffix("es").and_then(known))
        .or_else(|| plain.strip_suffix('s').and_then(known))
        .map_or_else(|| plain.to_owned(), str::to_owned)
}

/// Does this class stand for a person or a part of one?
#[must_use]
pub fn is_human(name: &str) -> bool {
    HUMAN.contains(&canonical_name(name).as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_stands_in_two_rows() {
        let mut names: Vec<&str> = SYNONYMS.iter().flat_map(|row| row.iter().copied()).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn every_name_is_its_own_spelling() {
        for name in SYNONYMS.iter().map(|row| row[0]) {
            assert_eq!(canonical_name(name), name);
            assert_eq!(canonical_name(&name.replace('_', " ").to_uppercase()), name);
            assert_eq!(canonical_name(&name.replace('_', "-")), name);
        }
    }

    #[test]
    fn people_are_people_in_every_spelling() {
        for name in ["hand", "Foot", "SHOE", "knee", "arm", "Lying Person", "person"] {
            assert!(is_human(name), "{name}");
        }
        for name in ["glove", "bolt", "handle", "teapot"] {
            assert!(!is_human(name), "{name}");
        }
    }
}
