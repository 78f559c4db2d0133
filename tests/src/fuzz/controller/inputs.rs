//! What one byte of an input makes of its frame: how the host behaves, and how the robot.

/// What a frame does otherwise than it should; the low four bits of its byte.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Host {
    Honest,
    Silent,
    Polls,
    WarnsOnly,
    Objects,
    ShowsBox,
    ShowsHole,
    ShowsCut,
    Damages,
    Repeats,
    OtherSource,
    TooOld,
    Skips,
    FreezesLight,
    ShiftsRows,
    Garbage,
}

impl Host {
    pub(super) fn of(byte: u8) -> Self {
        match byte & 15 {
            0 => Self::Honest,
            1 => Self::Silent,
            2 => Self::Polls,
            3 => Self::WarnsOnly,
            4 => Self::Objects,
            5 => Self::ShowsBox,
            6 => Self::ShowsHole,
            7 => Self::ShowsCut,
            8 => Self::Damages,
            9 => Self::Repeats,
            10 => Self::OtherSource,
            11 => Self::TooOld,
            12 => Self::Skips,
            13 => Self::FreezesLight,
            14 => Self::ShiftsRows,
            _ => Self::Garbage,
        }
    }

    /// Would a reader who has not compared it with the messages before take it as proof of a free floor? What only the
    /// vote over three line-scans or the tests of light and pixels find may pass for a few frames.
    pub(super) const fn may_prove_free_floor(self) -> bool {
        matches!(
            self,
            Self::Honest
                | Self::WarnsOnly
                | Self::FreezesLight
                | Self::ShiftsRows
                | Self::ShowsBox
                | Self::ShowsHole
        )
    }
}

/// What the robot does otherwise than it should; the high four bits of a frame's byte.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Robot {
    Healthy,
    ButtonHeld,
    ServiceKey,
    ContactAStuckClosed,
    ContactBStuckOpen,
    DriverAStuckHigh,
    DriversShorted,
    PulseUnread,
    SelfTestPending,
    SelfTestFailed,
    LateTick,
    ClockStands,
    ClockJumpsBack,
    MissedTicks,
    Restart,
    WatchdogRestart,
}

impl Robot {
    pub(super) fn of(byte: u8) -> Self {
        match byte >> 4 {
            0 => Self::Healthy,
            1 => Self::ButtonHeld,
            2 => Self::ServiceKey,
            3 => Self::ContactAStuckClosed,
            4 => Self::ContactBStuckOpen,
            5 => Self::DriverAStuckHigh,
            6 => Self::DriversShorted,
            7 => Self::PulseUnread,
            8 => Self::SelfTestPending,
            9 => Self::SelfTestFailed,
            10 => Self::LateTick,
            11 => Self::ClockStands,
            12 => Self::ClockJumpsBack,
            13 => Self::MissedTicks,
            14 => Self::Restart,
            _ => Self::WatchdogRestart,
        }
    }
}
