"""The faults, each with the time within which both relay pins must be low, and what the board must then say.

`running` begins with the relays closed over a clean floor; `start` begins with a reset after both watchdogs
have bitten, `power-up` with the power, and the relays must never close, whatever button is pressed. `control`
injects nothing: the relays must stay closed, or the other scenarios would show nothing.
"""

from dataclasses import dataclass
from typing import Callable

import faults

# Limits in seconds, from the firmware's own (shared/src/limits.rs): a tick is 5 ms, a frame 20 ms.
TICK = 0.005
FRAME = 0.020
TRANSACTION = 0.002
# A picture is 20 ms old when it is sent, its exposure's half 2 ms.
SEEN = 0.022 + FRAME + TRANSACTION
LINK_TIMEOUT = 0.060
# A transaction that was under way when the host fell silent still counts.
SILENCE = TRANSACTION + LINK_TIMEOUT + TICK + 0.001
FEEDBACK = 0.050
PULSES = 2 * 0.500
ROUND = 10.0
CLOCK_WINDOWS = 2 * 0.250
LIVENESS = 0.270
WINDOW_WATCHDOG = 0.0915
INDEPENDENT_WATCHDOG = 0.100
CODE_CHANGE = 0.080

# A damaged controller that stops by itself does so within this.
AT_ONCE = 0.080


@dataclass
class Scenario:
    name: str
    what: str
    limit: float
    inject: Callable
    # Any one of these must be told: a cause, a fault, or a failed self-test.
    tells: frozenset = frozenset()
    kind: str = "running"
    # Whether a reset of the chip must follow, and which.
    reset: str = ""
    # How long the board is watched after it has opened.
    afterwards: float = 0.3


def running():
    """While the relays are closed."""

    def case(name, what, limit, inject, *tells, reset="", afterwards=0.3):
        return Scenario(name, what, limit, inject, frozenset(tells), "running", reset, afterwards)

    return [
        case("stripe-gone", "the stripe disappears", SEEN, faults.scene("none"), "stripe_cut"),
        case("large-object", "something 60 mm high everywhere", SEEN, faults.scene("60"), "large_object"),
        case(
            "host-asks",
            "the host asks for a stop",
            FRAME + TRANSACTION + 0.001,
            faults.host("verdict", "stop"),
            "host_request",
        ),
        case(
            "host-silent",
            "no transactions any more",
            SILENCE,
            faults.host("frames", False),
            "link_timeout",
        ),
        case(
            "short-frames",
            "SPI transactions end after 1000 bytes",
            SILENCE,
            faults.host("shorten", 1000),
            "link_timeout",
        ),
        case(
            "damaged-frames",
            "one wrong bit in every line-scan",
            2 * FRAME + TRANSACTION + 0.001,
            faults.fault("damage", 500),
            "link_corruption",
        ),
        case(
            "frozen-light",
            "pictures of constant brightness",
            LIVENESS,
            faults.fault("light", 200),
            "liveness",
        ),
        case("laser-dead", "the laser gives no light", SEEN, faults.darken, "stripe_cut"),
        case(
            "laser-timer-stuck",
            "the laser's timer ignores new levels",
            CODE_CHANGE + TICK,
            faults.attribute("laser_timer", "stuck", True),
            "registers",
        ),
        case(
            "mirror-a-open",
            "mirror contact A says open while closed",
            FEEDBACK + 2 * TICK,
            faults.fault("mirror a", True),
            "feedback",
        ),
        case(
            "mirror-b-open",
            "mirror contact B says open while closed",
            FEEDBACK + 2 * TICK,
            faults.fault("mirror b", True),
            "feedback",
        ),
        case(
            "read-back-a-low",
            "driver A's read-back stuck low",
            3 * TICK,
            faults.fault("read-back a", False),
            "output_stage",
        ),
        case(
            "read-back-b-high",
            "driver B's read-back stuck high",
            PULSES + 2 * TICK,
            faults.fault("read-back b", True),
            "output_stage",
        ),
        case(
            "driver-a-stuck",
            "driver A stuck on",
            PULSES + 2 * TICK,
            faults.fault("driver a", True),
            "output_stage",
        ),
        case(
            "drivers-shorted",
            "both drivers' outputs connected",
            PULSES + 2 * TICK,
            faults.fault("drivers shorted", True),
            "output_stage",
        ),
        case(
            "low-speed-fast",
            "low-speed oscillator 20 % fast",
            CLOCK_WINDOWS + TICK,
            faults.low_speed(38_400),
            "clock",
        ),
        case(
            "low-speed-slow",
            "... 20 % slow (or the other one fast)",
            CLOCK_WINDOWS + TICK,
            faults.low_speed(25_600),
            "clock",
        ),
        case(
            "low-speed-stops",
            "low-speed oscillator stops",
            CLOCK_WINDOWS + TICK,
            faults.low_speed(0),
            "clock",
        ),
        case(
            "clock-stops",
            "the processor's oscillator stops",
            INDEPENDENT_WATCHDOG + 0.001,
            faults.stop_clock,
            reset="independent watchdog",
        ),
        case(
            "hang",
            "the program hangs, interrupts masked",
            WINDOW_WATCHDOG,
            faults.hang,
            "watchdog_reset",
            reset="window watchdog",
            afterwards=1.5,
        ),
        case(
            "hang-no-window",
            "... and the window watchdog is dead",
            INDEPENDENT_WATCHDOG + 0.001,
            faults.hang_without_window,
            reset="independent watchdog",
        ),
        case(
            "stack-overflow",
            "the stack overflows: the processor locks up",
            WINDOW_WATCHDOG,
            lambda robot: robot.machine.overflow_stack(),
            reset="window watchdog",
        ),
        case(
            "astray",
            "the program jumps to where no code is",
            0.001,
            lambda robot: robot.machine.go_astray(),
            reset="software",
        ),
        case(
            "flip-relay-command",
            "a bit of the relays' command",
            2 * TICK,
            faults.flip_relay_command,
            "relay_memory",
            "critical_data",
        ),
        case("flip-maps", "a bit of a column map", 1.0, faults.flip_in("7MONITOR", 4096, 4), "critical_data"),
        case(
            "flip-constant",
            "a bit of the program's constants in flash",
            ROUND + TICK,
            faults.flip_constant,
            "program",
        ),
        case(
            "flip-cold-code",
            "a bit of code that is not running",
            ROUND + TICK,
            faults.flip_cold_code,
            "program",
        ),
        case("ram-stuck-unused", "a stuck bit in unused RAM", ROUND + TICK, faults.stick_unused, "memory"),
        case(
            "ram-stuck-stack",
            "a stuck bit in the stack's memory",
            ROUND + TICK,
            faults.stick_stack,
            "memory",
            "stack",
        ),
        case(
            "ram-stuck-buffer",
            "a stuck bit in the link's buffer",
            ROUND + TICK,
            faults.stick_buffer,
            "memory",
            "link_corruption",
        ),
        case(
            "stack-guard",
            "something writes to the stack's guard zone",
            ROUND + TICK,
            faults.touch_guard,
            "stack",
        ),
        case(
            "supply-low",
            "the supply falls to 2.8 V",
            2 * TICK,
            faults.attribute("power", "millivolts", 2_800),
            "supply",
        ),
        case(
            "supply-high",
            "the supply rises to 3.7 V",
            ROUND + TICK,
            faults.attribute("power", "millivolts", 3_700),
            "supply",
        ),
        case("pull-flipped", "a pull resistor's setting flips", ROUND + TICK, faults.flip_pull, "registers"),
        case(
            "prescaler-flipped",
            "the independent watchdog's prescaler flips",
            ROUND + TICK,
            faults.flip_prescaler,
            "registers",
        ),
        case(
            "output-lost",
            "relay A's pin turns into an input",
            3 * TICK + FEEDBACK,
            faults.lose_output,
            "output_stage",
            "feedback",
            "registers",
        ),
    ]


def start():
    """From a reset on; the relays must never close."""

    def case(name, what, inject, *tells, kind="start"):
        return Scenario(name, what, 0.0, inject, frozenset(tells), kind)

    return [
        case(
            "power-up-window",
            "the window watchdog does not bite",
            faults.attribute("window", "dead", True),
            "watchdog",
            kind="power-up",
        ),
        case(
            "power-up-independent",
            "the independent watchdog does not bite",
            faults.attribute("independent", "dead", True),
            "watchdog",
            kind="power-up",
        ),
        case("power-up-key", "the service key is closed", faults.close_key, kind="power-up"),
        case("start-unsealed", "an image without a seal", faults.erase_seal, "program"),
        case("start-flash-flipped", "a bit of the program's constants", faults.flip_constant, "program"),
        case(
            "start-random-silent",
            "the random number generator does not answer",
            faults.attribute("random", "failure", "silent"),
            "random",
        ),
        case(
            "start-random-seed",
            "... reports a seed error",
            faults.attribute("random", "failure", "seed error"),
            "random",
        ),
        case(
            "start-random-stuck",
            "... repeats itself",
            faults.attribute("random", "failure", "stuck"),
            "random",
        ),
        case("start-supply-high", "3.7 V", faults.attribute("power", "millivolts", 3_700), "supply"),
        case("start-clock", "the low-speed oscillator 20 % slow", faults.low_speed(25_600), "clock"),
        case("start-ram-stuck", "a stuck bit in RAM", faults.stick_unused, "memory"),
        case("start-object", "something large on the floor", faults.scene("60"), "large_object"),
        case(
            "start-mirror-welded",
            "relay A does not drop out: its mirror contact stays open",
            faults.fault("mirror a", False),
            "feedback",
        ),
        case("start-driver-stuck", "driver A stuck on", faults.fault("driver a", True), "output_stage"),
        case("start-no-rig", "no rig is stored", faults.no_rig, "configuration"),
        case("start-no-button", "nobody presses the button", faults.none, "interlock"),
    ]


def control():
    """Without a fault."""
    return [
        Scenario(
            "control",
            "no fault: closed for longer than a round of self-tests",
            12.0,
            faults.none,
            kind="control",
        ),
        Scenario(
            "fault-log",
            "a stop is still told by the fault log after the next power-up",
            0.0,
            faults.scene("none"),
            kind="log",
        ),
    ]
