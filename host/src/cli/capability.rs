//! `nearfield capability`: the smallest object that a rig detects, at each place along the stripe.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;

use crate::capability::plot::draw;
use crate::capability::{Capability, measure};
use crate::capture::read_frame;
use crate::rig_file;
use crate::vision::Extractor;

/// The rig does not meet the object size.
const NOT_MET: u8 = 1;

/// Say how small an object may be and still be detected, at each place along the stripe.
///
/// With a picture of the clean floor its noise, offset and gaps are taken into account; without, a floor that is seen
/// well. Widths are those of flat, dark things, heights those of wide things; upright things cast longer shadows and
/// are detected smaller. Exit code 1 if an object of the size asked for is not detected everywhere, 2 for bad input.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield capability --rig robot.toml
  nearfield capability --rig robot.toml --picture clean.png --object 6 --svg map.svg")]
pub struct CapabilityArguments {
    /// The rig.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// A picture of the clean floor with the stripe.
    #[arg(long, value_name = "IMAGE")]
    picture: Option<PathBuf>,
    /// Width and height of the smallest object that must be detected, millimetres. A cut of 5 mm trips; edges that the
    /// lens blurs and columns that are not infinitely fine take a millimetre or two more.
    #[arg(long, default_value_t = 7.0, value_name = "MM", value_parser = size)]
    object: f64,
    /// Draw the map into this file.
    #[arg(long, value_name = "MAP.svg")]
    svg: Option<PathBuf>,
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

fn size(text: &str) -> Result<f64, String> {
    let size = text.parse().ok().filter(|size: &f64| (1.0..=60.0).contains(size));
    size.ok_or("must be 1 to 60 millimetres".to_owned())
}

impl CapabilityArguments {
    /// Runs the command; exit code 1 if the object size is not met.
    ///
    /// # Errors
    /// The rig or the picture cannot be used, or the drawing cannot be written.
    pub fn run(&self) -> anyhow::Result<u8> {
        let rig = rig_file::load(&self.rig)?;
        let name = || self.rig.display().to_string();
        let mut extractor = Extractor::new(&rig).with_context(name)?;
        let clean = match &self.picture {
            Some(path) => {
                let frame = read_frame(path, rig.image())?;
                extractor.extract(&frame.view()).with_context(|| path.display().to_string())?;
                Some(extractor.readings())
            }
            None => None,
        };
        let capability = measure(&rig, clean).with_context(name)?;
        let is_met = capability.detects_everywhere(self.object);
        if let Some(path) = &self.svg {
            draw(&capability, self.object, path)?;
        }
        if self.json {
            let report =
                serde_json::json!({ "object_mm": self.object, "met": is_met, "capability": capability });
            say!("{report}");
        } else {
            say!("{}", self.table(&capability, is_met).trim_end());
        }
        Ok(if is_met { 0 } else { NOT_MET })
    }

    fn table(&self, capability: &Capability, is_met: bool) -> String {
        let verdict = match (is_met, capability.floor_trips) {
            (true, _) => "is detected everywhere",
            (false, true) => "cannot be promised: the clean floor trips by itself",
            (false, false) => {
                "is NOT detected everywhere (marked *): use a finer camera setting or a shorter stripe"
            }
        };
        let mut text = format!(
            "an object {} mm wide and high {verdict}\n     along  mm/column  rows/mm  noise px   seen   width mm  height mm\n",
            self.object
        );
        let shown = |limit: Option<f64>| limit.map_or("none".to_owned(), |limit| format!("{limit:.2}"));
        for place in &capability.places {
            text += &format!(
                "  {:>8.0}  {:>9.3}  {:>7.2}  {:>8.2}  {:>4.0} %  {:>9}  {:>9}{}\n",
                place.place_mm,
                place.millimetres_per_column,
                place.rows_per_millimetre,
                place.row_noise,
                place.seen * 100.0,
                shown(place.smallest_width_mm),
                shown(place.smallest_height_mm),
                if place.detects(self.object) { "" } else { " *" }
            );
        }
        text
    }
}
