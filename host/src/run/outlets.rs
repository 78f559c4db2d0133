//! What a run tells others: recorder, page, pictures for people. All of it is optional to the stripe's path: what cannot be
//! started is said, and the run goes on without.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use nearfield_configuration::budget::{HostTimes, ResponseTime, permitted_speed, stopping_distance};
use nearfield_configuration::{Configuration, Field, Fleet, FleetCarrier, Profile};
use nearfield_fleet::Carrier;
use nearfield_fleet::carrier::UdpCarrier;
use nearfield_operator::about::{Part, Smallest, ZoneView};
use nearfield_operator::commission::{Hands, Plan};
use nearfield_operator::model::Model;
use nearfield_operator::{About, Page, Settings, Tally};
use nearfield_recording::folder::Folder;
use nearfield_recording::{Options, QUEUE_LENGTH, Recorder, State, Tap, Taps, queue, recovery};
use nearfield_shared::rig::Rig;
use nearfield_shared::units::Micros;

use super::checks;
use super::pictures::PictureTap;
use crate::capability::{Capability, PlaceCapability};

/// The host's clock, for those who may not ask the stripe's path.
#[derive(Debug, Clone, Default)]
pub struct Clock(Arc<AtomicU64>);

impl Clock {
    /// Sets it.
    pub fn set(&self, now: Micros) {
        self.0.store(now.get(), Ordering::Relaxed);
    }

    /// What it shows.
    #[must_use]
    pub fn now(&self) -> Micros {
        Micros::new(self.0.load(Ordering::Relaxed))
    }
}

/// See the module's documentation.
pub struct Outlets {
    /// All that listen.
    pub taps: Taps,
    /// Pictures for people; `None` = nobody looks.
    pub pictures: Option<PictureTap>,
    /// What the run counts.
    pub tally: Arc<Tally>,
    /// The host's clock.
    pub clock: Clock,
    recorder: Option<Recorder>,
    page: Option<Page>,
    fleet: Option<nearfield_fleet::Outlet>,
    #[cfg(feature = "ros2")]
    ros2: Option<nearfield_ros2::Outlet>,
}

/// What a run is, for its outlets.
pub struct Run<'a> {
    /// The configuration.
    pub configuration: &'a Configuration,
    /// Its text.
    pub text: &'a str,
    /// The rig.
    pub rig: &'a Rig,
    /// Where recordings go; `None` = nowhere.
    pub record: Option<&'a Path>,
    /// Shall there be a page?
    pub page: bool,
    /// Hands that do what a commissioning on the page asks; `None` = a person's.
    pub hands: Option<Hands>,
}

impl Outlets {
    /// Starts what the configuration asks for; the second value says what could not be started.
    ///
    /// # Errors
    /// The folder of recordings cannot be used: who asks for a recording wants to know at once.
    pub fn start(run: &Run<'_>) -> anyhow::Result<(Self, Vec<String>)> {
        let begun = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let begun = u64::try_from(begun.as_nanos()).unwrap_or(u64::MAX);
        let mut outlets = Self {
            taps: Taps::default(),
            pictures: None,
            tally: Arc::new(Tally::default()),
            clock: Clock::default(),
            recorder: None,
            page: None,
            fleet: None,
            #[cfg(feature = "ros2")]
            ros2: None,
        };
        let mut said = Vec::new();
        let remarks = match run.record {
            Some(folder) => Some(outlets.start_recorder(run, folder, begun, &mut said)?),
            None => None,
        };
        if run.page
            && let Err(error) = outlets.start_page(run, begun, remarks)
        {
            said.push(format!("{error:#}"));
        }
        let people_look = !outlets.taps.is_empty();
        for outcome in [outlets.start_fleet(run, begun), outlets.start_ros2(run)] {
            if let Err(error) = outcome {
                said.push(format!("{error:#}"));
            }
        }
        if people_look {
            match PictureTap::start(outlets.taps.clone()) {
                Ok(pictures) => outlets.pictures = Some(pictures),
                Err(error) => said.push(format!("no pictures for people: {error}")),
            }
        }
        Ok((outlets, said))
    }

    fn start_recorder(
        &mut self,
        run: &Run<'_>,
        folder: &Path,
        begun: u64,
        said: &mut Vec<String>,
    ) -> anyhow::Result<Tap> {
        let folder = Folder::open(folder)?;
        for path in recovery::complete_all(&folder)? {
            said.push(format!("{}: was cut off, and is completed now", path.display()));
        }
        let settings = &run.configuration.recording;
        let seconds = std::time::Duration::from_secs_f64;
        let options = Options {
            begun,
            module: run.configuration.module.name.clone(),
            configuration: run.text.to_owned(),
            rig: run.rig.to_bytes().to_vec(),
            limit: u64::from(settings.limit_mib) << 20,
            before: seconds(settings.before_s),
            after: seconds(settings.after_s),
        };
        let (tap, drain) = queue(QUEUE_LENGTH);
        let recorder =
            Recorder::start(options, Box::new(folder), drain).context("cannot start the recorder")?;
        self.taps.add(tap.clone());
        self.recorder = Some(recorder);
        Ok(tap)
    }

    fn start_page(&mut self, run: &Run<'_>, begun: u64, remarks: Option<Tap>) -> anyhow::Result<()> {
        let configuration = run.configuration;
        let watch = self.recorder.as_ref().map(Recorder::watch);
        let model = Model::new(&configuration.module.name, begun, run.rig, Arc::clone(&self.tally), watch)?;
        let model = if configuration.profile == Profile::Cutoff { model.without_heights() } else { model };
        let capability = crate::capability::measure(run.rig, None).ok();
        let model = match &capability {
            Some(capability) => {
                let plan = checks::plan(configuration, run.text, run.rig, capability);
                model.with_commissioning(Plan { hands: run.hands.clone(), ..plan })
            }
            None => model,
        };
        let clock = self.clock.clone();
        let settings = Settings {
            listen: configuration.page.listen,
            token_file: configuration.page.token_file.clone(),
            recordings: run.record.map(Path::to_path_buf),
            remarks,
            about: about(configuration, run.rig, capability.as_ref()),
            clock: Box::new(move || clock.now()),
        };
        let (tap, drain) = queue(QUEUE_LENGTH);
        let page = Page::start(settings, model, drain)?;
        self.taps.add(tap);
        self.page = Some(page);
        Ok(())
    }

    fn start_fleet(&mut self, run: &Run<'_>, begun: u64) -> anyhow::Result<()> {
        let fleet = &run.configuration.fleet;
        let Some(carrier) = fleet_carrier(fleet)? else { return Ok(()) };
        let module = &run.configuration.module.name;
        let reporter = nearfield_fleet::outlet::Reporter::new(&fleet.robot, module, &fleet.modules, begun);
        let (tap, drain) = queue(QUEUE_LENGTH);
        self.fleet = Some(nearfield_fleet::Outlet::start(reporter, carrier, drain)?);
        self.taps.add(tap);
        Ok(())
    }

    #[cfg(feature = "ros2")]
    fn start_ros2(&mut self, run: &Run<'_>) -> anyhow::Result<()> {
        use nearfield_configuration::Ros2Stamp;
        use nearfield_ros2::{About, Outlet, Reporter, Settings, Stamp};
        let configuration = run.configuration;
        let ros2 = &configuration.ros2;
        if !ros2.publish {
            return Ok(());
        }
        let about = About {
            module: configuration.module.name.clone(),
            frame_id: ros2.frame_id.clone(),
            scan_time: (1.0 / configuration.camera.frames_per_second) as f32,
            tells_heights: configuration.profile != Profile::Cutoff,
        };
        let settings = Settings {
            domain: u16::try_from(ros2.domain)?,
            networks: ros2.networks.clone(),
            namespace: ros2.namespace.clone(),
            stamp: match ros2.stamp {
                Ros2Stamp::Exposure => Stamp::Exposure,
                Ros2Stamp::Sending => Stamp::Sending,
            },
        };
        let (tap, drain) = queue(QUEUE_LENGTH);
        self.ros2 = Some(Outlet::start(settings, Reporter::new(run.rig, about)?, drain)?);
        self.taps.add(tap);
        Ok(())
    }

    #[cfg(not(feature = "ros2"))]
    fn start_ros2(&mut self, run: &Run<'_>) -> anyhow::Result<()> {
        anyhow::ensure!(
            !run.configuration.ros2.publish,
            "ros2.publish = true, but this program was built without ROS 2; build it with `--features ros2`"
        );
        Ok(())
    }

    /// Where the page is.
    #[must_use]
    pub fn page_address(&self) -> Option<std::net::SocketAddr> {
        self.page.as_ref().map(Page::address)
    }

    /// Ends all of it; tells how the recording went.
    pub fn finish(mut self) -> Option<State> {
        self.pictures = None;
        self.page = None;
        self.fleet = None;
        #[cfg(feature = "ros2")]
        {
            self.ros2 = None;
        }
        self.recorder.take().map(Recorder::finish)
    }
}

/// What the module's reports travel with; `None` = it makes none.
fn fleet_carrier(fleet: &Fleet) -> anyhow::Result<Option<Box<dyn Carrier>>> {
    Ok(match fleet.carrier {
        FleetCarrier::None => None,
        FleetCarrier::Udp => Some(Box::new(UdpCarrier::new(fleet.to)?)),
        #[cfg(feature = "zenoh")]
        FleetCarrier::Zenoh => {
            use nearfield_fleet::zenoh_carrier::{Settings, ZenohCarrier};
            let connect = fleet.connect.clone();
            let settings = Settings { listen: Vec::new(), scout: connect.is_empty(), connect };
            Some(Box::new(ZenohCarrier::new(&settings)?))
        }
        #[cfg(not(feature = "zenoh"))]
        FleetCarrier::Zenoh => anyhow::bail!(
            "fleet.carrier = \"zenoh\", but this program was built without it; build it with `--features zenoh`"
        ),
    })
}

fn about(configuration: &Configuration, rig: &Rig, capability: Option<&Capability>) -> About {
    let response = ResponseTime::of(configuration, &HostTimes::ASSUMED);
    let (_, worst) = response.by_vote();
    let robot = &configuration.robot;
    let distance = robot.distance_mm.unwrap_or_else(|| distance_of(rig));
    let part = |part: &nearfield_configuration::budget::Part| Part {
        name: part.name.to_owned(),
        typical_ms: part.typical_ms,
        worst_ms: part.worst_ms,
    };
    let zone = |zone: &nearfield_configuration::Zone| ZoneView {
        name: zone.name.clone(),
        start_mm: zone.start_mm,
        end_mm: zone.end_mm,
        field: if zone.field == Field::Protective { "protective" } else { "warning" },
    };
    let smallest =
        |place: &PlaceCapability| Smallest { place_mm: place.place_mm, width_mm: place.smallest_width_mm };
    let places = capability.map_or(&[][..], |capability| &capability.places);
    let capability = places.iter().map(smallest).collect();
    let stripe = rig.stripe();
    About {
        module: configuration.module.name.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        stripe_mm: [stripe.start, stripe.end],
        response: response.parts.iter().map(part).collect(),
        vote_ms: response.vote_ms,
        response_worst_ms: worst,
        stopping_distance_mm: stopping_distance(robot, robot.speed_mm_s, worst),
        distance_mm: distance,
        permitted_speed_mm_s: permitted_speed(robot, distance, worst),
        capability,
        zones: configuration.zones.iter().map(zone).collect(),
        cases: configuration.cases.len(),
        takes_remarks: false,
        takes_orders: false,
    }
}

/// From the robot's edge (y = 0) to the nearer end of the watched stripe, millimetres.
#[must_use]
pub fn distance_of(rig: &Rig) -> f64 {
    let stripe = rig.stripe();
    stripe.at(stripe.start).y.min(stripe.at(stripe.end).y)
}

/// The folder that a run records into: the command line's, or the configuration's.
#[must_use]
pub fn recording_folder(given: Option<&Path>, configuration: &Configuration) -> Option<PathBuf> {
    given.map(Path::to_path_buf).or_else(|| configuration.recording.directory.clone())
}
