//! `nearfield commission`: is this sensor, on this robot, what it must be? A protocol to sign.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_commissioning::{Check, Protocol, Section};
use nearfield_configuration::budget::{HostTimes, ResponseTime, permitted_speed, stopping_distance};
use nearfield_configuration::{Configuration, LinkKind, Source as SourceKind};
use nearfield_fields::Fields;
use nearfield_shared::rig::Rig;
use nearfield_shared::status::StateCode;
use nearfield_shared::units::Micros;

use super::mcu::McuChoice;
use super::run::open_source;
use crate::link::McuSession;
use crate::rig_file;
use crate::run::commission::{Hands, Patience, Site, Trial};
use crate::run::outlets::distance_of;
use crate::run::source::TwinSource;
use crate::run::supervised::Supervised;
use crate::run::{Controller, StripePath};
use crate::twin::gallery::plain;
use crate::twin::scene::Shape;
use crate::twin::{Scene, SceneObject};

/// Commission a sensor: rig, size and fields, a test piece at three places, a protocol to sign.
///
/// Looks at the calibrated rig (`nearfield calibrate rig` makes it), at response time, stopping distance, permitted speed and zones, and
/// then at the floor: you lay the test piece across the stripe at its near end, middle and far end, take it away and press the reset
/// button, as you are told; every step is seen to be done, nothing has to be confirmed. Writes protocol.md and protocol.html.
/// Exit code 0 = all passed, 1 = not. With the twin and a simulated controller it shows how that goes, and says so in the protocol.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Examples:
  nearfield commission --config /etc/nearfield/nearfield.toml --person \"A. Name\" --out commissioning
  nearfield config print > nearfield.toml && nearfield commission --config nearfield.toml     with the twin")]
pub struct Commission {
    /// The configuration.
    #[arg(long, value_name = "NEARFIELD.toml")]
    config: PathBuf,
    /// Where the protocol goes.
    #[arg(long, value_name = "DIR", default_value = "commissioning")]
    out: PathBuf,
    /// Who does it.
    #[arg(long, value_name = "NAME", default_value = "")]
    person: String,
    /// Diameter of the test piece, a straight rod, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 12.0)]
    piece: f64,
    /// How long to wait for each thing that you are asked to do, seconds.
    #[arg(long, value_name = "S", default_value_t = 120)]
    patience: u32,
}

/// The ends of the stripe are tested so far inside them, millimetres.
const FROM_END_MM: f64 = 60.0;
/// A hand lays a rod as exactly as this, millimetres; farther off another place was tested.
const LAID_WITHIN_MM: f64 = 80.0;
/// The relays must stay as they are for so long.
const STILL: Micros = Micros::from_millis(2000);

impl Commission {
    /// Runs the command.
    ///
    /// # Errors
    /// The configuration, rig, source, controller or folder cannot be used.
    pub fn run(&self) -> anyhow::Result<u8> {
        if !(5.0..=100.0).contains(&self.piece) {
            bail!("--piece {}: a test piece has 5 to 100 mm", self.piece);
        }
        let configuration = Configuration::load(&self.config)?;
        let rig = rig_file::load(&configuration.rig)?;
        let on_hardware = is_on_hardware(&configuration);
        let sections = vec![
            Section { title: "Rig".to_owned(), checks: rig_checks(&rig, self.piece)? },
            Section { title: "Size and fields".to_owned(), checks: field_checks(&configuration, &rig) },
            Section { title: "On the floor".to_owned(), checks: self.floor(&configuration, &rig)? },
        ];
        let protocol = Protocol {
            module: configuration.module.name.clone(),
            version: format!("nearfield {}", env!("CARGO_PKG_VERSION")),
            made: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            person: self.person.clone(),
            equipment: equipment(&configuration),
            on_hardware,
            calibration: format!("{:08x}, {}", rig.calibration_id().get(), configuration.rig.display()),
            sections,
            configuration: std::fs::read_to_string(&self.config).unwrap_or_default(),
        };
        self.write(&protocol)?;
        Ok(u8::from(!protocol.is_passed()))
    }

    fn write(&self, protocol: &Protocol) -> anyhow::Result<()> {
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("{}: cannot make the folder", self.out.display()))?;
        for (name, text) in [("protocol.md", protocol.markdown()), ("protocol.html", protocol.html())] {
            let path = self.out.join(name);
            std::fs::write(&path, text).with_context(|| format!("{}: cannot write", path.display()))?;
            say!("{}", path.display());
        }
        for section in &protocol.sections {
            for check in &section.checks {
                let verdict = if check.passed { "passed" } else { "NOT passed" };
                say!("{verdict:<11} {}: {} (demanded: {})", check.name, check.found, check.demanded);
            }
        }
        say!(
            "{}",
            if protocol.is_passed() { "passed" } else { "NOT passed: the robot must not be released" }
        );
        Ok(())
    }

    fn floor(&self, configuration: &Configuration, rig: &Rig) -> anyhow::Result<Vec<Check>> {
        let source = open_source(configuration, rig)?;
        match configuration.link.kind {
            LinkKind::InProcess => self.simulated(McuChoice::InProcess, configuration, rig, source),
            LinkKind::Emulated => self.simulated(McuChoice::Emulated, configuration, rig, source),
            LinkKind::Spi => self.on_board(configuration, rig, source),
        }
    }

    fn simulated(
        &self,
        choice: McuChoice,
        configuration: &Configuration,
        rig: &Rig,
        source: Supervised,
    ) -> anyhow::Result<Vec<Check>> {
        let mut session = choice.start(rig)?;
        session.set_frame_period(period(configuration));
        let made_up = configuration.camera.source == SourceKind::Twin;
        let hands = Simulated {
            rig: *rig,
            piece_mm: self.piece,
            period: period(configuration),
            made_up,
            pressed: Micros::ZERO,
        };
        self.trials(configuration, rig, session, source, hands)
    }

    #[cfg(target_os = "linux")]
    fn on_board(
        &self,
        configuration: &Configuration,
        rig: &Rig,
        source: Supervised,
    ) -> anyhow::Result<Vec<Check>> {
        let board = super::run::board(configuration, rig);
        self.trials(configuration, rig, board, source, Person { asked: false })
    }

    #[cfg(not(target_os = "linux"))]
    fn on_board(&self, _: &Configuration, _: &Rig, _: Supervised) -> anyhow::Result<Vec<Check>> {
        bail!("the SPI link needs Linux; choose link.kind = \"in-process\" or \"emulated\"")
    }

    fn trials<C: Controller>(
        &self,
        configuration: &Configuration,
        rig: &Rig,
        controller: C,
        source: Supervised,
        mut hands: impl Hands<C>,
    ) -> anyhow::Result<Vec<Check>> {
        let path = StripePath::new(rig, controller, None)?;
        let mut site = Site { path, source, period: None };
        let patience = Patience { hand: Micros::from_millis(u64::from(self.patience) * 1000), still: STILL };
        let armed = site.arm(&mut hands, patience)?;
        let found = if armed { "closed, and stayed closed" } else { "not so" };
        let mut checks =
            vec![Check::new("Clean floor", "relays close after the button, and stay closed", found, armed)];
        let worst = ResponseTime::of(configuration, &HostTimes::ASSUMED).by_vote().1;
        let stripe = rig.stripe();
        for (name, place) in [
            ("near end", stripe.start + FROM_END_MM),
            ("middle", f64::midpoint(stripe.start, stripe.end)),
            ("far end", stripe.end - FROM_END_MM),
        ] {
            let trial = site.trial(&mut hands, place, patience)?;
            checks.extend(self.judged(name, &trial, worst));
        }
        Ok(checks)
    }

    fn judged(&self, name: &str, trial: &Trial, worst_ms: f64) -> [Check; 3] {
        let piece = self.piece;
        let place = trial.wanted_mm;
        let title = |what: &str| format!("Rod of {piece} mm, {name}: {what}");
        let seen = trial
            .seen_mm
            .map_or("no gap".to_owned(), |seen| format!("a gap of {:.1} mm at {seen:.0} mm", trial.gap_mm));
        let there = trial.seen_mm.is_some_and(|seen| (seen - place).abs() <= LAID_WITHIN_MM);
        let took = trial.opened_after.map(|took| took.get() as f64 / 1000.0);
        let words = |good: bool, yes: &str, no: &str| if good { yes.to_owned() } else { no.to_owned() };
        [
            Check::new(
                title("seen"),
                format!("a gap within {LAID_WITHIN_MM} mm of {place:.0} mm"),
                seen,
                there,
            ),
            Check::new(
                title("relays open"),
                format!("at most {worst_ms:.0} ms after the light"),
                took.map_or("they did not open for it".to_owned(), |took| format!("{took:.0} ms")),
                took.is_some_and(|took| took <= worst_ms),
            ),
            Check::new(
                title("taken away"),
                "stay open without the button, close with it",
                format!(
                    "{}, {}",
                    words(trial.stayed_open, "stayed open", "closed by themselves"),
                    words(trial.closed_again, "closed with the button", "did not close with the button")
                ),
                trial.stayed_open && trial.closed_again,
            ),
        ]
    }
}

fn period(configuration: &Configuration) -> Micros {
    Micros::new((1e6 / configuration.camera.frames_per_second).round() as u64)
}

fn is_on_hardware(configuration: &Configuration) -> bool {
    let camera = matches!(
        configuration.camera.source,
        SourceKind::RpicamVid | SourceKind::Libcamera | SourceKind::Command
    );
    camera && configuration.link.kind == LinkKind::Spi
}

fn equipment(configuration: &Configuration) -> String {
    let camera = configuration.camera.source.name();
    let controller = match configuration.link.kind {
        LinkKind::InProcess => "simulated, in process".to_owned(),
        LinkKind::Emulated => "firmware in an emulator".to_owned(),
        LinkKind::Spi => format!("board on {}", configuration.link.device.display()),
    };
    format!("pictures: {camera}; controller: {controller}")
}

fn rig_checks(rig: &Rig, piece_mm: f64) -> anyhow::Result<Vec<Check>> {
    let capability = crate::capability::measure(rig, None)?;
    let blind = capability.places.iter().find(|place| place.smallest_width_mm.is_none());
    let widest = capability
        .places
        .iter()
        .filter_map(|place| Some((place.smallest_width_mm?, place.place_mm)))
        .max_by(|one, other| one.0.total_cmp(&other.0));
    let found = match (blind, widest) {
        (Some(blind), _) => format!("nothing is surely seen at {:.0} mm", blind.place_mm),
        (None, Some((width, place))) => format!("at worst {width:.1} mm, at {place:.0} mm"),
        (None, None) => "no places".to_owned(),
    };
    let passed = blind.is_none() && widest.is_some_and(|(width, _)| width <= piece_mm);
    let stripe = rig.stripe();
    Ok(vec![
        Check::new(
            "Smallest thing that is surely seen",
            format!("{piece_mm} mm, everywhere from {:.0} to {:.0} mm", stripe.start, stripe.end),
            found,
            passed,
        ),
        Check::new(
            "Clean floor",
            "does not trip by itself",
            if capability.floor_trips { "trips" } else { "does not" },
            !capability.floor_trips,
        ),
    ])
}

fn field_checks(configuration: &Configuration, rig: &Rig) -> Vec<Check> {
    let worst = ResponseTime::of(configuration, &HostTimes::ASSUMED).by_vote().1;
    let robot = &configuration.robot;
    let distance = robot.distance_mm.unwrap_or_else(|| distance_of(rig));
    let needed = stopping_distance(robot, robot.speed_mm_s, worst);
    let permitted = permitted_speed(robot, distance, worst);
    let zones = Fields::check(configuration, rig.stripe());
    vec![
        Check::new(
            "Stopping distance",
            format!("at most {distance:.0} mm, the stripe's distance"),
            format!("{needed:.0} mm, with a response time of {worst:.0} ms"),
            needed <= distance,
        ),
        Check::new(
            "Speed",
            format!("at most {permitted:.0} mm/s"),
            format!("{:.0} mm/s", robot.speed_mm_s),
            robot.speed_mm_s <= permitted,
        ),
        Check::new(
            "Zones",
            "within the watched stripe",
            zones.as_ref().map_or_else(ToString::to_string, |()| {
                format!("{} zones, all within", configuration.zones.len())
            }),
            zones.is_ok(),
        ),
    ]
}

/// The twin's hands.
struct Simulated {
    rig: Rig,
    piece_mm: f64,
    period: Micros,
    /// Pictures come from the twin, which can be given another scene; other sources show what they show.
    made_up: bool,
    pressed: Micros,
}

/// From one press of the button to the next.
const PRESS_INTERVAL: Micros = Micros::from_millis(1000);

impl Hands<McuSession> for Simulated {
    fn lay(&mut self, place_mm: Option<f64>) -> anyhow::Result<Option<Supervised>> {
        if !self.made_up {
            return Ok(None);
        }
        let rod = |place: f64| {
            let shape = Shape::Rod { diameter_mm: self.piece_mm, length_mm: 140.0 };
            SceneObject { along_mm: place, yaw_degrees: 90.0, ..plain("test piece", shape, 0.0, "grey_card") }
        };
        let scene = Scene { objects: place_mm.map(rod).into_iter().collect(), ..Scene::default() };
        let rig = self.rig;
        let open = move || -> anyhow::Result<Box<dyn crate::run::source::Source>> {
            Ok(Box::new(TwinSource::new(&rig, &scene, 1)?))
        };
        let period = std::time::Duration::from_micros(self.period.get());
        Ok(Some(Supervised::open(Box::new(open), period)?))
    }

    fn press(&mut self, session: &mut McuSession) {
        let due = session.now().since(self.pressed) >= PRESS_INTERVAL;
        if due && session.status().state == StateCode::Interlocked {
            self.pressed = session.now();
            session.press_reset();
        }
    }

    fn drive(&mut self, session: &mut McuSession, exposed: Micros, exposure: Micros) -> f32 {
        session.mean_laser_drive(exposed, exposure)
    }
}

/// A person's hands: words on standard error.
struct Person {
    asked: bool,
}

impl<C> Hands<C> for Person {
    fn lay(&mut self, place_mm: Option<f64>) -> anyhow::Result<Option<Supervised>> {
        self.asked = false;
        match place_mm {
            Some(place) => eprintln!("lay the test piece across the stripe, {place:.0} mm along it"),
            None => eprintln!("take everything off the stripe, and keep clear of it"),
        }
        Ok(None)
    }

    fn press(&mut self, _: &mut C) {
        if !self.asked {
            self.asked = true;
            eprintln!("press the reset button, for half a second");
        }
    }

    fn drive(&mut self, _: &mut C, _: Micros, _: Micros) -> f32 {
        1.0
    }
}
