"""The faults, each with the time within which both relay pins must be low, and what the board must then say.

`running` begins with the relays closed over a clean floor; `start` begins with a reset after both watchdogs have bitten,
`power-up` with the power, and the relays must never close, whatever button is pressed. `control` injects nothing: the relays must stay closed, or
the other scenarios would show nothing.
"""

import random
from dataclasses import dataclass
from typing import Callable

from machine import FLASH, RAM, RAM_SIZE, STACK_RAM

# Limits in seconds, from the firmware's own (shared/src/limits.rs): a tick is 5 ms, a frame 20 ms.
TICK = 0.005
FRAME = 0.020
TRANSACTION = 0.002
# A picture is 20 ms old when it is sent, its exposure's half 2 ms.
SEEN = 0.022 + FRAME + TRANSACTION
LINK_TIMEOUT = 0.060
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

CLOSED_WORD = 0x5A3C_96E1


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


def fault(name, value):
    return lambda robot: robot.faults.update({name: value})


def attribute(device, name, value):
    return lambda robot: setattr(getattr(robot, device), name, value)


def host(name, value):
    return lambda robot: setattr(robot, name, value)


def scene(height):
    return lambda robot: robot.set_scene(height)


def darken(robot):
    robot.laser_timer.dead = True
    robot.light_changed()


def static(robot, part):
    """Address and size of the largest variable whose name contains this."""
    found = [place for name, place in robot.machine.symbols.items() if part in name and place[1]]
    return max(found, key=lambda place: place[1])


def flip_in(part, offset, bit=3):
    return lambda robot: robot.machine.flip(static(robot, part)[0] + offset, bit)


def flip_relay_command(robot):
    """Of the word that says "closed", wherever it is."""
    address, size = static(robot, "10CONTROLLER")
    content = robot.machine.read(address, size)
    place = content.find(CLOSED_WORD.to_bytes(4, "little"))
    if place < 0:
        raise LookupError("the relays' command is not in the controller's memory")
    robot.machine.flip(address + place + 1, 2)


def flip_constant(robot):
    """In the program's constants."""
    robot.machine.flip(FLASH + robot.machine.constants + 64, 5)


def flip_cold_code(robot):
    """In code that runs at start only."""
    robot.machine.flip(robot.machine.symbols["nearfield_march_ram"][0] & ~1, 6)


def erase_seal(robot):
    start = robot.machine.seal - FLASH
    robot.machine.flash[start : start + 16] = b"\xff" * 16
    robot.machine._poke(FLASH + start, b"\xff" * 16)


def stick_unused(robot):
    robot.machine.stick(RAM + RAM_SIZE - 4096, 3, True)


def stick_stack(robot):
    robot.machine.stick(STACK_RAM + 8 * 1024, 7, False)


def stick_buffer(robot):
    """In the link's buffer, far behind the line-scan's own bytes and the status."""
    address, size = static(robot, "9host_link6BUFFER")
    robot.machine.stick(address + size - 64, 0, True)


def touch_guard(robot):
    robot.machine.flip(STACK_RAM + 1024, 1)


def stop_clock(robot):
    robot.machine.stands_still = True
    robot.window.dead = True


def low_speed(hertz):
    return lambda robot: robot.low_speed.set_hertz(hertz)


def hang(robot):
    robot.machine.hang()


def hang_without_window(robot):
    robot.window.dead = True
    robot.machine.hang()


def flip_pull(robot):
    """The pull-down of a mirror contact's input turns into a pull-up."""
    port = robot.ports["C"]
    port.registers[0x0C] = port.get(0x0C) ^ 0b11 << 4


def flip_prescaler(robot):
    """The independent watchdog's 100 ms become 6 s."""
    robot.independent.registers[0x04] = 6


def lose_output(robot):
    """A relay's pin turns from an output into an input."""
    port = robot.ports["C"]
    port.registers[0x00] = port.get(0x00) & ~0b11
    robot.outputs_changed()


def no_rig(robot):
    robot.machine.erase_flash(0x7_F000, 0x1000)


def close_key(robot):
    robot.key = True


def none(_robot):
    pass


def running():
    """While the relays are closed."""

    def case(name, what, limit, inject, *tells, reset="", afterwards=0.3):
        return Scenario(name, what, limit, inject, frozenset(tells), "running", reset, afterwards)

    return [
        case("stripe-gone", "the stripe disappears", SEEN, scene("none"), "stripe_cut"),
        case("large-object", "something 60 mm high everywhere", SEEN, scene("60"), "large_object"),
        case("host-asks", "the host asks for a stop", FRAME + TRANSACTION + 0.001, host("verdict", "stop"), "host_request"),
        case("host-silent", "no transactions any more", LINK_TIMEOUT + TICK, host("frames", False), "link_timeout"),
        case("short-frames", "SPI transactions end after 1000 bytes", LINK_TIMEOUT + TICK, host("shorten", 1000), "link_timeout"),
        case("damaged-frames", "one wrong bit in every line-scan", 2 * FRAME + TRANSACTION + 0.001, fault("damage", 500), "link_corruption"),
        case("frozen-light", "pictures of constant brightness", LIVENESS, fault("light", 200), "liveness"),
        case("laser-dead", "the laser gives no light", SEEN, darken, "stripe_cut"),
        case("laser-timer-stuck", "the laser's timer ignores new levels", CODE_CHANGE + TICK, attribute("laser_timer", "stuck", True), "registers"),
        case("mirror-a-open", "mirror contact A says open while closed", FEEDBACK + 2 * TICK, fault("mirror a", True), "feedback"),
        case("mirror-b-open", "mirror contact B says open while closed", FEEDBACK + 2 * TICK, fault("mirror b", True), "feedback"),
        case("read-back-a-low", "driver A's read-back stuck low", 3 * TICK, fault("read-back a", False), "output_stage"),
        case("read-back-b-high", "driver B's read-back stuck high", PULSES + 2 * TICK, fault("read-back b", True), "output_stage"),
        case("driver-a-stuck", "driver A stuck on", PULSES + 2 * TICK, fault("driver a", True), "output_stage"),
        case("drivers-shorted", "both drivers' outputs connected", PULSES + 2 * TICK, fault("drivers shorted", True), "output_stage"),
        case("low-speed-fast", "low-speed oscillator 20 % fast", CLOCK_WINDOWS + TICK, low_speed(38_400), "clock"),
        case("low-speed-slow", "... 20 % slow (or the other one fast)", CLOCK_WINDOWS + TICK, low_speed(25_600), "clock"),
        case("low-speed-stops", "low-speed oscillator stops", CLOCK_WINDOWS + TICK, low_speed(0), "clock"),
        case("clock-stops", "the processor's oscillator stops", INDEPENDENT_WATCHDOG + 0.001, stop_clock, reset="independent watchdog"),
        case("hang", "the program hangs, interrupts masked", WINDOW_WATCHDOG, hang, "watchdog_reset", reset="window watchdog", afterwards=1.5),
        case("hang-no-window", "... and the window watchdog is dead", INDEPENDENT_WATCHDOG + 0.001, hang_without_window, reset="independent watchdog"),
        case("stack-overflow", "the stack overflows: the processor locks up", WINDOW_WATCHDOG, lambda robot: robot.machine.overflow_stack(), reset="window watchdog"),
        case("astray", "the program jumps to where no code is", 0.001, lambda robot: robot.machine.go_astray(), reset="software"),
        case("flip-relay-command", "a bit of the relays' command", 2 * TICK, flip_relay_command, "relay_memory", "critical_data"),
        case("flip-maps", "a bit of a column map", 1.0, flip_in("7MONITOR", 4096, 4), "critical_data"),
        case("flip-constant", "a bit of the program's constants in flash", ROUND + TICK, flip_constant, "program"),
        case("flip-cold-code", "a bit of code that is not running", ROUND + TICK, flip_cold_code, "program"),
        case("ram-stuck-unused", "a stuck bit in unused RAM", ROUND + TICK, stick_unused, "memory"),
        case("ram-stuck-stack", "a stuck bit in the stack's memory", ROUND + TICK, stick_stack, "memory", "stack"),
        case("ram-stuck-buffer", "a stuck bit in the link's buffer", ROUND + TICK, stick_buffer, "memory", "link_corruption"),
        case("stack-guard", "something writes to the stack's guard zone", ROUND + TICK, touch_guard, "stack"),
        case("supply-low", "the supply falls to 2.8 V", 2 * TICK, attribute("power", "millivolts", 2_800), "supply"),
        case("supply-high", "the supply rises to 3.7 V", ROUND + TICK, attribute("power", "millivolts", 3_700), "supply"),
        case("pull-flipped", "a pull resistor's setting flips", ROUND + TICK, flip_pull, "registers"),
        case("prescaler-flipped", "the independent watchdog's prescaler flips", ROUND + TICK, flip_prescaler, "registers"),
        case("output-lost", "relay A's pin turns into an input", 3 * TICK + FEEDBACK, lose_output, "output_stage", "feedback", "registers"),
    ]


def start():
    """From a reset on; the relays must never close."""

    def case(name, what, inject, *tells, kind="start"):
        return Scenario(name, what, 0.0, inject, frozenset(tells), kind)

    return [
        case("power-up-window", "the window watchdog does not bite", attribute("window", "dead", True), "watchdog", kind="power-up"),
        case("power-up-independent", "the independent watchdog does not bite", attribute("independent", "dead", True), "watchdog", kind="power-up"),
        case("power-up-key", "the service key is closed", close_key, kind="power-up"),
        case("start-unsealed", "an image without a seal", erase_seal, "program"),
        case("start-flash-flipped", "a bit of the program's constants", flip_constant, "program"),
        case("start-random-silent", "the random number generator does not answer", attribute("random", "failure", "silent"), "random"),
        case("start-random-seed", "... reports a seed error", attribute("random", "failure", "seed error"), "random"),
        case("start-random-stuck", "... repeats itself", attribute("random", "failure", "stuck"), "random"),
        case("start-supply-high", "3.7 V", attribute("power", "millivolts", 3_700), "supply"),
        case("start-clock", "the low-speed oscillator 20 % slow", low_speed(25_600), "clock"),
        case("start-ram-stuck", "a stuck bit in RAM", stick_unused, "memory"),
        case("start-object", "something large on the floor", scene("60"), "large_object"),
        case("start-mirror-welded", "relay A does not drop out: its mirror contact stays open", fault("mirror a", False), "feedback"),
        case("start-driver-stuck", "driver A stuck on", fault("driver a", True), "output_stage"),
        case("start-no-rig", "no rig is stored", no_rig, "configuration"),
        case("start-no-button", "nobody presses the button", none, "interlock"),
    ]


def control():
    """Without a fault."""
    return [Scenario("control", "no fault: closed for longer than a round of self-tests", 12.0, none, kind="control")]


def random_flips(seed, count):
    """Single bits of the controller's memory: each must stop the robot at once, or leave it able to stop on demand."""
    source = random.Random(seed)
    return [(source.random(), source.randrange(8)) for _ in range(count)]
