//! The rig that a configuration works with: its file, or where all is made up anyway, the twin's own.

use std::path::PathBuf;

use nearfield_configuration::{Configuration, LinkKind, Source};
use nearfield_shared::rig::Rig;

use crate::rig_file::{self, RigFileError};
use crate::twin::gallery::CENTRE;

const BUILT_IN: &str = "the twin's own rig";

/// Whether there is no rig file and none is needed: none is named, none lies in the usual place, and neither camera nor controller is
/// real. Whatever looks at a real floor needs its own calibration, and is never given another one.
#[must_use]
pub fn is_built_in(configuration: &Configuration) -> bool {
    let is_made_up = matches!(configuration.camera.source, Source::Twin | Source::TwinLoop)
        && configuration.link.kind != LinkKind::Spi;
    is_made_up && !configuration.rig_is_named && !configuration.rig.exists()
}

/// The rig. The twin's own has the width of the configured pictures.
///
/// # Errors
/// The file cannot be used, see [`RigFileError`].
pub fn of(configuration: &Configuration) -> Result<Rig, RigFileError> {
    if !is_built_in(configuration) {
        return rig_file::load(&configuration.rig);
    }
    let problem = |field: &str, problem: String| RigFileError::Field {
        path: PathBuf::from(BUILT_IN),
        field: field.to_owned(),
        problem,
    };
    let width = configuration.camera.width;
    let width = u16::try_from(width).map_err(|error| problem("image.width", format!("{width}: {error}")))?;
    CENTRE.with_width(width).rig().map_err(|error| problem("rig", error.to_string()))
}

/// What people call it: the file's name, or that there is none.
#[must_use]
pub fn name(configuration: &Configuration) -> String {
    if is_built_in(configuration) { BUILT_IN.to_owned() } else { configuration.rig.display().to_string() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use std::path::Path;

    fn configured(text: &str) -> Configuration {
        Configuration::read(text, Path::new("/nonexistent/nearfield.toml")).unwrap()
    }

    /// Who tries it out needs no rig; the commented defaults are what they try.
    #[test]
    fn the_twin_has_a_rig_of_its_own() {
        for text in ["", Configuration::COMMENTED, "[camera]\nsource = \"twin-loop\"\nwidth = 1152\n"] {
            let configuration = configured(text);
            assert!(is_built_in(&configuration), "{text}");
            let rig = of(&configuration).unwrap();
            assert_eq!(u32::from(rig.image().width), configuration.camera.width);
            assert_eq!(name(&configuration), BUILT_IN);
        }
    }

    /// A real floor is never judged by a rig that nobody calibrated, and a misspelt name is told.
    #[test]
    fn whatever_is_real_or_named_needs_its_file() {
        for text in [
            "[camera]\nsource = \"rpicam-vid\"\n",
            "[camera]\nsource = \"replay\"\ninput = \"pictures\"\n",
            "[link]\nkind = \"spi\"\n",
            "rig = \"robto.toml\"\n",
        ] {
            let configuration = configured(text);
            let told = of(&configuration).unwrap_err().to_string();
            assert!(
                !is_built_in(&configuration) && told.contains("nearfield calibrate rig"),
                "{text}: {told}"
            );
        }
    }
}
