//! The demo's minute: everything it promises happens over the real path, and a controller that does not keep the
//! promises is found out.

use nearfield_host::demo::script::{Act, minute};
use nearfield_host::demo::view::Nobody;
use nearfield_host::demo::{Engine, Outcome, report};
use nearfield_host::link::{InProcess, LinkError, McuKind, McuLink, Reply, SECRET_LENGTH, SimulatedTick};
use nearfield_host::twin::gallery::CENTRE;
use nearfield_shared::service::PageBytes;
use nearfield_shared::status::Channels;
use nearfield_shared::units::Micros;

#[expect(clippy::unwrap_used, reason = "a test helper")]
fn play(link: Box<dyn McuLink>, acts: Vec<Act>) -> Outcome {
    Engine::with_script(&CENTRE.rig().unwrap(), link, 1, acts).unwrap().play(&mut Nobody).unwrap()
}

fn unmet(outcome: &Outcome) -> Vec<String> {
    let checks = outcome.record.acts.iter().flat_map(|act| act.checks.iter().map(move |check| (act, check)));
    let failed = checks.filter(|(_, check)| !check.met);
    failed.map(|(act, check)| format!("{}: {} -- {}", act.name, check.expected, check.happened)).collect()
}

#[test]
fn the_whole_minute_keeps_its_promises() {
    let outcome = play(Box::new(InProcess::new()), minute());
    assert_eq!(unmet(&outcome), Vec::<String>::new());
    let record = &outcome.record;
    assert!(record.met);
    assert_eq!((record.frames.len(), record.acts.len()), (3000, minute().len()));
    assert_eq!(record.link.watchdog_resets, 1);
    // The heights are the controller's own measurements; the truth is the twin's.
    let at_rest = |name: &str| {
        let act = record.acts.iter().find(|act| act.name == name).unwrap();
        let middle = (act.start_ms + 1400.0) as u32 / 20;
        let frame = &record.frames[middle as usize];
        (f64::from(frame.highest_mm.unwrap()), frame.true_highest_mm.unwrap())
    };
    for name in ["box", "hand", "false_clear"] {
        let (measured, real) = at_rest(name);
        assert!((measured - real).abs() < 3.0, "{name}: measured {measured:.1}, really {real:.1} mm");
    }
}

/// A controller whose relays, once closed, never open again.
struct WeldedShut {
    inner: InProcess,
    closed: bool,
}

impl WeldedShut {
    fn weld(&mut self, reply: Result<Reply, LinkError>) -> Result<Reply, LinkError> {
        let mut reply = reply?;
        self.closed |= reply.outputs.relays == Channels::CLOSED;
        if self.closed {
            reply.outputs.relays = Channels::CLOSED;
        }
        Ok(reply)
    }
}

impl McuLink for WeldedShut {
    fn kind(&self) -> McuKind {
        self.inner.kind()
    }

    fn start(
        &mut self,
        now: Micros,
        secret: [u8; SECRET_LENGTH],
        stored_rig: &[u8],
    ) -> Result<Reply, LinkError> {
        self.inner.start(now, secret, stored_rig)
    }

    fn tick(&mut self, now: Micros, inputs: SimulatedTick) -> Result<Reply, LinkError> {
        let reply = self.inner.tick(now, inputs);
        self.weld(reply)
    }

    fn exchange(&mut self, now: Micros, line_scan: Option<&[u8]>) -> Result<Reply, LinkError> {
        let reply = self.inner.exchange(now, line_scan);
        self.weld(reply)
    }

    fn service_page(&mut self, now: Micros) -> Result<PageBytes, LinkError> {
        self.inner.service_page(now)
    }

    fn hang(&mut self, now: Micros) -> Result<(), LinkError> {
        self.inner.hang(now)
    }
}

#[test]
fn a_controller_that_does_not_open_fails_the_demo() {
    let wanted = ["power_on", "reset", "cable"];
    let outcome = play(Box::new(WeldedShut { inner: InProcess::new(), closed: false }), acts_named(&wanted));
    assert!(!outcome.record.met);
    let unmet = unmet(&outcome);
    assert!(unmet.iter().any(|line| line.contains("cable: relays open within")), "{unmet:?}");
    let page = report::page(&outcome, &acts_named(&wanted));
    assert!(page.contains("promises broken") && !page.contains("All "), "the report says so at its head");
}

fn acts_named(names: &[&str]) -> Vec<Act> {
    minute().into_iter().filter(|act| names.contains(&act.name)).collect()
}

/// The report is read where there is no network, and by people who did not write it.
#[test]
fn the_report_stands_alone_and_tells_every_act() {
    let acts = acts_named(&["power_on", "reset"]);
    let outcome = play(Box::new(InProcess::new()), acts.clone());
    let page = report::page(&outcome, &acts);
    for forbidden in ["http://", "https://", "<script", "url(http", "<link"] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    for act in &outcome.record.acts {
        assert!(page.contains(&format!("id='act-{}'", act.name)) && page.contains(act.title));
        for check in &act.checks {
            let words = check.happened.split(' ').next().unwrap_or_default();
            assert!(!words.is_empty() && page.contains(&words[1..]), "{}", check.happened);
        }
    }
    assert!(
        page.contains("src='data:image/jpeg;base64,") && page.contains("nobody has run it on hardware yet")
    );
    for tag in ["div", "section", "article", "figure", "svg", "table", "ul", "li", "p"] {
        let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
        assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "<{tag}>");
    }
}

#[test]
fn a_controller_that_never_closes_fails_the_demo() {
    let outcome = play(Box::new(InProcess::new()), acts_named(&["power_on", "near_miss"]));
    assert_eq!(unmet(&outcome).len(), 1, "nobody pressed the button, so the near miss is not run through");
}
