//! The mount that resolves heights best and meets what a robot demands.

use nearfield_configuration::Configuration;
use nearfield_configuration::budget::{HostTimes, ResponseTime, permitted_speed, stopping_distance};
use serde::Serialize;

use crate::measure::{Measures, measure};
use crate::mount::Mount;

/// What the robot demands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Demand {
    /// Nothing can be mounted higher than this, millimetres.
    pub available_mm: f64,
    /// Width of the zone before the robot, millimetres.
    pub zone_mm: f64,
    /// Distance of the stripe; `None`: as far as the speed needs, millimetres.
    pub distance_mm: Option<f64>,
    /// Greatest speed; `None`: the configuration's, mm/s.
    pub speed_mm_s: Option<f64>,
    /// Narrowest object that must stop the robot, millimetres.
    pub object_mm: f64,
    /// Heights up to this must be measured, millimetres.
    pub tallest_mm: f64,
    /// Lenses to choose from, horizontal field of view in degrees.
    pub views_degrees: Vec<f64>,
    /// The camera's height, if it is fixed, millimetres.
    pub camera_height_mm: Option<f64>,
    /// The laser's height, if it is fixed, millimetres.
    pub laser_height_mm: Option<f64>,
    /// Columns and rows of the picture.
    pub image: [u16; 2],
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recommendation {
    /// The mount.
    pub mount: Mount,
    /// What it resolves.
    pub measures: Measures,
    /// Worst response time by vote, milliseconds.
    pub response_ms: f64,
    /// Distance that the speed needs, millimetres.
    pub stopping_distance_mm: f64,
    /// Speed that the distance permits, mm/s.
    pub permitted_speed_mm_s: f64,
    /// How many mounts were tried and how many met the demand.
    pub tried: usize,
    /// See `tried`.
    pub sufficient: usize,
}

/// Why nothing can be recommended.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoMount {
    /// A demand that makes no sense.
    #[error("{what}: {value} {rule}")]
    Demand {
        /// Which.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        rule: &'static str,
    },
    /// No mount that was tried meets everything.
    #[error("none of {tried} mounts meets the demand; nearest: {nearest}")]
    NoneMeets {
        /// How many were tried.
        tried: usize,
        /// What is missing from the best of them, and what to do.
        nearest: String,
    },
}

/// Heights are tried in these steps, millimetres.
const STEP_MM: f64 = 25.0;
/// Lowest place of camera and laser, millimetres.
const LOWEST_MM: f64 = 75.0;
/// Tilts that are tried, degrees: where tall things would leave the picture.
const TILTS: [f64; 7] = [0.0, 4.0, -4.0, 8.0, -8.0, 12.0, -12.0];
/// The speed's distance is rounded up to this, millimetres.
const DISTANCE_STEP_MM: f64 = 10.0;

/// Tries all mounts.
///
/// # Errors
/// [`NoMount`].
pub fn recommend(demand: &Demand, configuration: &Configuration) -> Result<Recommendation, NoMount> {
    check(demand)?;
    let (_, response_ms) = ResponseTime::of(configuration, &HostTimes::ASSUMED).by_vote();
    let speed = demand.speed_mm_s.unwrap_or(configuration.robot.speed_mm_s);
    let needed = stopping_distance(&configuration.robot, speed, response_ms);
    let distance_mm =
        demand.distance_mm.unwrap_or_else(|| (needed / DISTANCE_STEP_MM).ceil() * DISTANCE_STEP_MM);
    let mut tried = 0;
    let mut sufficient = 0;
    let mut best: Option<(Mount, Measures)> = None;
    let mut nearest: Option<(f64, String)> = None;
    for mount in candidates(demand, distance_mm) {
        tried += 1;
        let measures = measure(&mount);
        if let Some((shortfall, words)) = shortfall(demand, &measures) {
            if nearest.as_ref().is_none_or(|(least, _)| shortfall < *least) {
                nearest = Some((shortfall, words));
            }
            continue;
        }
        sufficient += 1;
        if best.as_ref().is_none_or(|(_, other)| measures.height_sigma_mm < other.height_sigma_mm) {
            best = Some((mount, measures));
        }
    }
    let Some((mount, measures)) = best else {
        let nearest = nearest.map_or_else(|| "no mount was tried".to_owned(), |(_, words)| words);
        return Err(NoMount::NoneMeets { tried, nearest });
    };
    Ok(Recommendation {
        mount,
        measures,
        response_ms,
        stopping_distance_mm: needed,
        permitted_speed_mm_s: permitted_speed(&configuration.robot, distance_mm, response_ms),
        tried,
        sufficient,
    })
}

fn check(demand: &Demand) -> Result<(), NoMount> {
    let rule = |what, value: f64, low: f64, high: f64, rule| {
        if (low..=high).contains(&value) { Ok(()) } else { Err(NoMount::Demand { what, value, rule }) }
    };
    rule("available height", demand.available_mm, 100.0, 3000.0, "mm must be 100 to 3000 mm")?;
    rule("zone", demand.zone_mm, 50.0, 3000.0, "mm must be 50 to 3000 mm")?;
    rule("object", demand.object_mm, 5.0, 200.0, "mm must be 5 to 200 mm; gaps up to 5 mm are allowed")?;
    rule("tallest", demand.tallest_mm, 10.0, 300.0, "mm must be 10 to 300 mm")?;
    if let Some(distance) = demand.distance_mm {
        rule("distance", distance, 100.0, 3000.0, "mm must be 100 to 3000 mm")?;
    }
    if let Some(speed) = demand.speed_mm_s {
        rule("speed", speed, 1.0, 5000.0, "mm/s must be 1 to 5000 mm/s")?;
    }
    for height in demand.camera_height_mm.into_iter().chain(demand.laser_height_mm) {
        rule("fixed height", height, 30.0, demand.available_mm, "mm must be 30 mm to the available height")?;
    }
    for view in &demand.views_degrees {
        rule("view", *view, 20.0, 140.0, "degrees must be 20 to 140 degrees")?;
    }
    Ok(())
}

fn heights(fixed: Option<f64>, available: f64) -> Vec<f64> {
    if let Some(height) = fixed {
        return vec![height];
    }
    let mut all = Vec::new();
    let mut height = LOWEST_MM;
    while height <= available {
        all.push(height);
        height += STEP_MM;
    }
    all
}

fn candidates(demand: &Demand, distance_mm: f64) -> impl Iterator<Item = Mount> + use<'_> {
    let cameras = heights(demand.camera_height_mm, demand.available_mm);
    let lasers = heights(demand.laser_height_mm, demand.available_mm);
    demand.views_degrees.iter().flat_map(move |view| {
        let lasers = lasers.clone();
        cameras.clone().into_iter().flat_map(move |camera| {
            lasers.clone().into_iter().flat_map(move |laser| {
                TILTS.into_iter().map(move |tilt_degrees| Mount {
                    image: demand.image,
                    view_degrees: *view,
                    camera_mm: [0.0, 0.0, camera],
                    tilt_degrees,
                    laser_mm: [0.0, 0.0, laser],
                    distance_mm,
                    zone_mm: demand.zone_mm,
                })
            })
        })
    })
}

/// How far a mount is from the demand (0 = met is `None`), and what to do, for people.
fn shortfall(demand: &Demand, measures: &Measures) -> Option<(f64, String)> {
    let zone = 1.0 - measures.covered_mm / demand.zone_mm;
    let object = measures.narrowest_mm / demand.object_mm - 1.0;
    let tallest = 1.0 - measures.tallest_mm / demand.tallest_mm;
    let worst = zone.max(object).max(tallest);
    if worst <= 0.0 {
        return None;
    }
    let words = format!(
        "it sees {:.0} of {:.0} mm of the zone, objects from {:.1} mm ({:.1} asked for), heights up to {:.0} mm ({:.0} asked for); {}",
        measures.covered_mm,
        demand.zone_mm,
        measures.narrowest_mm,
        demand.object_mm,
        measures.tallest_mm,
        demand.tallest_mm,
        if worst == zone {
            "a wider lens, a higher camera or a second module helps"
        } else if worst == object {
            "a longer lens, a shorter zone or a second module helps"
        } else {
            "a higher laser, a wider lens or a lower demand helps"
        }
    );
    Some((worst, words))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::path::Path;

    fn configuration() -> Configuration {
        Configuration::read("", Path::new("the defaults")).unwrap()
    }

    fn demand() -> Demand {
        Demand {
            available_mm: 500.0,
            zone_mm: 700.0,
            distance_mm: Some(500.0),
            speed_mm_s: None,
            object_mm: 7.0,
            tallest_mm: 100.0,
            views_degrees: vec![66.0, 97.0],
            camera_height_mm: None,
            laser_height_mm: None,
            image: [2304, 1296],
        }
    }

    #[test]
    fn what_is_recommended_meets_the_demand_and_nothing_that_was_tried_is_better() {
        let demand = demand();
        let found = recommend(&demand, &configuration()).unwrap();
        assert!(shortfall(&demand, &found.measures).is_none());
        assert!(found.sufficient > 0 && found.sufficient < found.tried);
        for mount in candidates(&demand, 500.0) {
            let other = measure(&mount);
            assert!(
                shortfall(&demand, &other).is_some()
                    || other.height_sigma_mm >= found.measures.height_sigma_mm
            );
        }
    }

    #[test]
    fn fixed_heights_are_kept() {
        let demand = Demand {
            camera_height_mm: Some(300.0),
            laser_height_mm: Some(120.0),
            views_degrees: vec![97.0],
            ..demand()
        };
        let found = recommend(&demand, &configuration()).unwrap();
        assert_eq!((found.mount.camera_mm[2], found.mount.laser_mm[2]), (300.0, 120.0));
    }

    #[test]
    fn without_a_distance_the_stripe_lies_where_the_speed_needs_it() {
        let demand = Demand {
            distance_mm: None,
            speed_mm_s: Some(600.0),
            object_mm: 12.0,
            zone_mm: 500.0,
            ..demand()
        };
        let found = recommend(&demand, &configuration()).unwrap();
        assert!(found.mount.distance_mm >= found.stopping_distance_mm);
        assert!(found.mount.distance_mm < found.stopping_distance_mm + DISTANCE_STEP_MM);
        assert!(found.permitted_speed_mm_s >= 600.0);
    }

    #[test]
    fn what_cannot_be_met_says_what_is_missing() {
        let narrow = Demand { zone_mm: 2900.0, ..demand() };
        let message = recommend(&narrow, &configuration()).unwrap_err().to_string();
        assert!(message.contains("of 2900 mm of the zone"), "{message}");
        let nonsense = Demand { object_mm: 3.0, ..demand() };
        assert!(recommend(&nonsense, &configuration()).unwrap_err().to_string().contains("5 to 200 mm"));
    }
}
