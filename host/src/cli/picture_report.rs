//! One picture's findings as programs read them: the JSON of `nearfield inspect`.

use nearfield_shared::height::SizeClass;
use nearfield_shared::units::Millimetres;
use serde::Serialize;

use super::mcu::McuVerdict;
use crate::paper::PaperFinding;
use crate::vision::Analyser;

/// One line of `nearfield inspect --json`. Lengths and heights are millimetres along and over the floor.
#[derive(Debug, Clone, Serialize)]
pub struct PictureReport {
    /// The picture's file name as given.
    pub image: String,
    /// Is any stripe seen?
    pub stripe_found: bool,
    /// Tier 1: is the stripe cut?
    pub cutoff: bool,
    /// Longest gap; 0 if the stripe is whole.
    pub longest_gap_mm: f32,
    /// All gaps.
    pub gaps: Vec<GapReport>,
    /// What takes the stripe off the floor.
    pub objects: Vec<ObjectReport>,
    /// Height along the stripe.
    pub profile: ProfileReport,
    /// The safety controller's own verdict on the line-scan.
    pub mcu: McuVerdict,
    /// Where the time went, microseconds.
    pub timing_us: Timing,
}

/// A gap in the stripe.
#[derive(Debug, Clone, Serialize)]
pub struct GapReport {
    /// Where it begins.
    pub start_mm: f32,
    /// Where it ends.
    pub end_mm: f32,
    /// How long it is.
    pub length_mm: f32,
}

/// An object on the stripe.
#[derive(Debug, Clone, Serialize)]
pub struct ObjectReport {
    /// First laser ray that it stops.
    pub start_mm: f32,
    /// Last laser ray that it stops.
    pub end_mm: f32,
    /// Its height; `None` where no stripe is seen on it.
    pub height_mm: Option<f32>,
    /// One standard deviation of that height: the picture's share, and the rig's as its file tells it under `[uncertainty]`
    /// (a rig file without counts as true). `None` without a height.
    pub height_deviation_mm: Option<f32>,
    /// `small`, `large` (50 mm and more) or `unknown`.
    pub size: &'static str,
}

/// Height along the stripe.
#[derive(Debug, Clone, Serialize)]
pub struct ProfileReport {
    /// Places along the stripe.
    pub s_mm: Vec<f32>,
    /// Height of the stripe there; `None` where it is not seen.
    pub height_mm: Vec<Option<f32>>,
}

/// Microseconds per stage.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Timing {
    /// Reading and decoding the file.
    pub read: u64,
    /// Extraction and both tiers over the whole picture.
    pub vision: u64,
    /// Making the line-scan's columns.
    pub line_scan: u64,
    /// The safety controller in its simulation, arming included.
    pub mcu: u64,
}

/// The class's name.
#[must_use]
pub const fn size_name(size: SizeClass) -> &'static str {
    match size {
        SizeClass::Small => "small",
        SizeClass::Large => "large",
        SizeClass::Unknown => "unknown",
    }
}

/// To hundredths: more digits than the sensor has only make the output longer.
fn rounded(millimetres: f32) -> f32 {
    (millimetres * 100.0).round() / 100.0
}

impl PictureReport {
    /// Tier 1 as the paper's method sees it; the safety controller's verdict stays its own.
    pub fn replace_cutoff(&mut self, finding: &PaperFinding) {
        self.stripe_found = finding.stripe_found;
        self.cutoff = finding.is_cut;
        self.longest_gap_mm = rounded(finding.longest_gap_mm());
        let gaps = finding.gaps.iter().map(|gap| GapReport {
            start_mm: rounded(gap.start_mm),
            end_mm: rounded(gap.end_mm),
            length_mm: rounded(gap.end_mm - gap.start_mm),
        });
        self.gaps = gaps.collect();
    }

    /// Objects and heights as the paper's closed form gives them.
    pub fn replace_heights(&mut self, finding: &PaperFinding) {
        let objects = finding.objects.iter().map(|object| ObjectReport {
            start_mm: rounded(object.start_mm),
            end_mm: rounded(object.end_mm),
            height_mm: Some(rounded(object.height_mm)),
            height_deviation_mm: None,
            size: size_name(SizeClass::of(Millimetres::new(object.height_mm))),
        });
        self.objects = objects.collect();
    }

    /// Gathers what was found in the analyser's last frame.
    #[must_use]
    pub fn new(image: String, analyser: &Analyser, mcu: McuVerdict, timing_us: Timing) -> Self {
        let report = analyser.report();
        let gaps = analyser.gaps().iter().map(|gap| GapReport {
            start_mm: rounded(gap.start.get()),
            end_mm: rounded(gap.end.get()),
            length_mm: rounded(gap.length().get()),
        });
        let objects = analyser.objects().iter().map(|object| ObjectReport {
            start_mm: rounded(object.start.get()),
            end_mm: rounded(object.end.get()),
            height_mm: object.height.map(|height| rounded(height.get())),
            height_deviation_mm: object.uncertainty.map(|deviation| rounded(deviation.get())),
            size: size_name(object.size),
        });
        let (s_mm, height_mm) = analyser
            .profile()
            .values()
            .map(|(place, height)| (place, height.is_finite().then(|| rounded(height))))
            .unzip();
        Self {
            image,
            stripe_found: analyser.is_stripe_found(),
            cutoff: report.is_cut(),
            longest_gap_mm: report.longest_gap().map_or(0.0, |gap| rounded(gap.length().get())),
            gaps: gaps.collect(),
            objects: objects.collect(),
            profile: ProfileReport { s_mm, height_mm },
            mcu,
            timing_us,
        }
    }
}
