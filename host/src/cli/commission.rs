//! `nearfield commission`: is this sensor, on this robot, what it must be? A protocol to sign.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::Args;
use nearfield_commissioning::{Check, FROM_END_MM, PIECE_MM, Protocol, STILL, Section};
use nearfield_configuration::budget::{HostTimes, ResponseTime};
use nearfield_configuration::{Configuration, LinkKind, Source as SourceKind};
use nearfield_shared::rig::Rig;
use nearfield_shared::status::StateCode;
use nearfield_shared::units::Micros;

use super::mcu::McuChoice;
use super::run::open_source;
use crate::link::McuSession;
use crate::run::checks;
use crate::run::commission::{Hands, Patience, Site};
use crate::run::rig;
use crate::run::source::TwinSource;
use crate::run::supervised::Supervised;
use crate::run::twin_hands::test_piece;
use crate::run::{Controller, StripePath};
use crate::twin::Scene;

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
    #[arg(long, value_name = "MM", default_value_t = PIECE_MM)]
    piece: f64,
    /// How long to wait for each thing that you are asked to do, seconds.
    #[arg(long, value_name = "S", default_value_t = 120)]
    patience: u32,
}

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
        let rig = rig::of(&configuration)?;
        let text = std::fs::read_to_string(&self.config).unwrap_or_default();
        let capability = crate::capability::measure(&rig, None)?;
        let mut protocol = checks::protocol(&configuration, &text, &rig, &capability, self.piece);
        protocol.person.clone_from(&self.person);
        let floor = self.floor(&configuration, &rig)?;
        protocol.sections.push(Section { title: "On the floor".to_owned(), checks: floor });
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
        let source = open_source(configuration, rig, None)?;
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
        let exposure = Micros::new(configuration.camera.exposure_us.into());
        let path = StripePath::new(rig, controller, None)?.with_exposure(exposure);
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
            checks.extend(trial.checks(name, self.piece, worst));
        }
        Ok(checks)
    }
}

fn period(configuration: &Configuration) -> Micros {
    Micros::new((1e6 / configuration.camera.frames_per_second).round() as u64)
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
        let scene = Scene {
            objects: place_mm.map(|place| test_piece(self.piece_mm, place)).into_iter().collect(),
            ..Scene::default()
        };
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
