//! The sensor's share of a VDA 5050 state message (version 2.1): `safetyState` and `errors`, for a vehicle's controller to
//! merge into its own.

use nearfield_fields::FIELD_CAUSES;
use nearfield_shared::causes::StopCause;
use serde::Serialize;

use crate::view::Status;

/// The payload.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Payload {
    /// As VDA 5050 has it.
    pub safety_state: SafetyState,
    /// As VDA 5050 has them.
    pub errors: Vec<Error>,
}

/// `safetyState`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct SafetyState {
    /// `NONE`, or `MANUAL`: open relays are closed by the reset button at the vehicle only.
    pub e_stop: &'static str,
    /// Something is in the protective field.
    pub field_violation: bool,
}

/// One of `errors`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Error {
    /// The cause's name.
    pub error_type: String,
    /// Which module.
    pub error_references: Vec<Reference>,
    /// In words.
    pub error_description: String,
    /// `WARNING`: goes away by itself or by the reset button; `FATAL`: somebody must come.
    pub error_level: &'static str,
}

/// One of `errorReferences`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Reference {
    /// What is named.
    pub reference_key: &'static str,
    /// Its name.
    pub reference_value: String,
}

/// Causes that need a person with tools.
const FATAL: [StopCause; 8] = [
    StopCause::Feedback,
    StopCause::ProgramFlow,
    StopCause::SelfTest,
    StopCause::Configuration,
    StopCause::Misaligned,
    StopCause::OutputStage,
    StopCause::CriticalData,
    StopCause::LinkCalibration,
];

/// Of a state.
#[must_use]
pub fn payload(status: &Status) -> Payload {
    let among = |causes: &[StopCause], name: &str| causes.iter().any(|cause| cause.name() == name);
    let reference =
        || vec![Reference { reference_key: "nearfieldModule", reference_value: status.module.clone() }];
    let error = |error_type: &str, description: &str, error_level| Error {
        error_type: error_type.to_owned(),
        error_references: reference(),
        error_description: description.to_owned(),
        error_level,
    };
    let mut errors: Vec<Error> = status
        .live
        .iter()
        .filter(|cause| !among(&FIELD_CAUSES, cause.name) && cause.name != StopCause::Interlock.name())
        .map(|cause| {
            let level = if among(&FATAL, cause.name) { "FATAL" } else { "WARNING" };
            error(cause.name, cause.words, level)
        })
        .collect();
    errors.extend(status.warnings.iter().map(|warning| error(warning.name, warning.words, "WARNING")));
    for zone in status.zones.iter().filter(|zone| zone.role != "named" && zone.finding != "free") {
        let zone_reference =
            Reference { reference_key: "nearfieldZone", reference_value: zone.name.to_string() };
        let told = error(
            if zone.role == "warning" { "warning_field" } else { "protective_field" },
            "something is in a field of the sensor",
            "WARNING",
        );
        errors
            .push(Error { error_references: [told.error_references, vec![zone_reference]].concat(), ..told });
    }
    if status.state.is_empty() {
        errors.push(error("controller_silent", "the safety controller is not heard", "FATAL"));
    }
    if status.state == "lockout" {
        errors.push(error("lockout", "the safety controller has locked itself; service is needed", "FATAL"));
    }
    Payload {
        safety_state: SafetyState {
            e_stop: if status.relay == "closed" { "NONE" } else { "MANUAL" },
            field_violation: status.live.iter().any(|cause| among(&FIELD_CAUSES, cause.name)),
        },
        errors,
    }
}
