"""Runs the board's unmodified binary on a register-level model and injects faults; see README.md beside it."""

import argparse
import json
import sys
import time

import faults
import scenarios
from machine import FLASH, HERTZ
from robot import Host, Robot

# Seconds after the armed snapshot at which a fault comes: at a tick, between two, in a frame, in a symbol of the laser.
MOMENTS = (0.0, 0.0033, 0.0117, 0.0541)


# Bytes of an entry of the fault log, see shared/src/service.
FAULT_ENTRY = 32


class Failed(Exception):
    """A scenario did not end as it must."""


class Bench:
    """Powers a board up, stores a rig, arms it, and keeps snapshots to begin scenarios from."""

    def __init__(self, elf, host_program):
        self.host = Host(host_program)
        self.robot = Robot(elf, self.host)
        machine = self.robot.machine
        machine.seal = next(address for name, (address, _) in machine.symbols.items() if "UNSEALED" in name)
        machine.constants = next(s for s in machine.segments if s[0] > FLASH + 0x1000)[0] - FLASH
        machine.constants = max(a for a, d in machine.segments if len(d) > 0x800) - FLASH + 0x400
        self.timings = {}

    def prepare(self):
        self._store_rig()
        self._power_up()
        self._arm()

    def _boot(self, condition, most):
        machine = self.robot.machine
        machine.long_slices = True
        took = self.robot.run_until(condition, most, 0.005)
        machine.long_slices = False
        if took is None:
            raise Failed(f"not reached within {most} s of virtual time")
        return took

    def _store_rig(self):
        """As a service technician: key closed, the rig sent, read back and acknowledged."""
        robot = self.robot
        robot.machine.power_up()
        self._boot(lambda: robot.ports["A"].level(8), 4)
        if self._ask("store", 1)[0] != "ServiceKeyOpen":
            raise Failed("a rig is taken without the service key")
        robot.key = True
        # The key's pin is read at ticks, every 5 ms.
        robot.run(0.02)
        for number, request in ((2, "store"), (3, "candidate"), (4, "acknowledge")):
            result, data = self._ask(request, number)
            if result != "Done" or (request == "candidate" and data != self.host.rig):
                raise Failed(f"service request {request}: {result}")
        if robot.driven_log != [(0, False)] and robot.closed_since(0):
            raise Failed("the relays closed during service")
        robot.key = False

    def _ask(self, request, number):
        """A service request and what its page says in the end."""
        robot = self.robot
        message = bytes.fromhex(self.host.ask(f"{request} {number}"))
        for _ in range(60):
            robot.transact(message)
            robot.run(0.02)
            page = self.host.ask(f"page {robot.answer.hex()}").split()
            if page[0] == str(number) and page[1] != "Working":
                return page[1], b"" if page[2] == "-" else bytes.fromhex(page[2])
        raise Failed(f"no answer to the service request {request}")

    def _power_up(self):
        """Both watchdogs bite; the moment after the second bite is kept."""
        robot, machine = self.robot, self.robot.machine
        machine.resets.clear()
        machine.power_up(seed=2)
        begin = machine.time
        machine.long_slices = True
        for count, why in ((1, "window watchdog"), (2, "independent watchdog")):
            self._boot(lambda count=count: len(machine.resets) >= count, 2)
            machine.long_slices = True
            if machine.resets[-1][1] != why:
                raise Failed(f"expected a bite of the {why}, got {machine.resets}")
        self.bitten = robot.snapshot()
        self._boot(lambda: robot.window.fed is not None, 6)
        self.timings["power-up to controller running"] = (machine.time - begin) / HERTZ
        self.started = robot.snapshot()

    def _arm(self):
        robot = self.robot
        robot.frames = True
        begin = robot.machine.time
        if robot.run_until(lambda: robot.told and robot.told.state == "interlocked", 2) is None:
            raise Failed(f"never waits for the button: {robot.told}")
        robot.run(0.5)
        if robot.closed_since(begin):
            raise Failed("the relays closed without the button")
        robot.press_reset()
        robot.run(0.2)
        released = robot.machine.time
        if robot.run_until(lambda: robot.closed_log[-1][1], 2) is None:
            raise Failed(f"does not arm: {robot.told} {robot.told.live}")
        self.timings["button released to relays closed"] = (robot.machine.time - released) / HERTZ
        robot.run(0.5)
        if not robot.closed_log[-1][1] or robot.told.state != "running":
            raise Failed(f"does not stay armed: {robot.told}")
        self.armed = robot.snapshot()

    # ---- scenarios -------------------------------------------------------------------------------

    def play(self, scenario):
        if scenario.kind == "control":
            return self._play_control(scenario)
        if scenario.kind == "log":
            return self._play_log(scenario)
        if scenario.kind in ("start", "power-up"):
            return self._play_start(scenario)
        # What takes a whole round of self-tests does not depend on the moment within a frame.
        moments = MOMENTS if scenario.limit < 2 else MOMENTS[:1]
        return max(self._play_running(scenario, moment) for moment in moments)

    def _play_control(self, scenario):
        robot = self.robot
        robot.restore(self.armed)
        begin = robot.machine.time
        robot.run(scenario.limit)
        if robot.opened_after(begin) is not None:
            raise Failed(f"opened after {robot.opened_after(begin):.3f} s: {robot.told} {robot.told.live}")
        return None

    def _play_log(self, scenario):
        """Entries are kept in flash while the relays are open, and read again at the next start."""
        robot = self.robot
        robot.restore(self.armed)
        robot.frames = False
        result, before = self._ask("faults", 10)
        robot.restore(self.armed)
        scenario.inject(robot)
        robot.run(0.5)
        robot.frames = False
        robot.machine.power_up(seed=4)
        self._boot(lambda: robot.ports["A"].level(8), 6)
        result, after = self._ask("faults", 11)
        # At least the stop and the new start were added, behind what was there.
        if result != "Done" or len(after) < len(before) + 2 * FAULT_ENTRY or after[: len(before)] != before:
            raise Failed(f"{result}: {len(before)} bytes of log before the stop, {len(after)} after the power-up")
        return None

    def _play_running(self, scenario, moment):
        robot = self.robot
        robot.restore(self.armed)
        robot.run(moment)
        robot.machine.resets.clear()
        begin = robot.machine.time
        scenario.inject(robot)
        robot.run_until(lambda: robot.opened_after(begin) is not None, scenario.limit + 0.05, 0.002)
        took = robot.opened_after(begin)
        if took is None:
            raise Failed(f"still closed after {scenario.limit + 0.05:.3f} s: {robot.told}")
        if took > scenario.limit:
            raise Failed(f"opened after {took * 1e3:.1f} ms")
        opened = robot.machine.time
        # The host is well again: nothing may close by itself, and the status tells what it was.
        robot.frames, robot.shorten = True, None
        robot.run(scenario.afterwards)
        if robot.closed_since(opened):
            raise Failed("closed again by itself")
        self._check_story(scenario)
        return took

    def _play_start(self, scenario):
        robot = self.robot
        robot.restore(self.bitten)
        scenario.inject(robot)
        if scenario.kind == "power-up":
            robot.machine.power_up(seed=3)
        begin = robot.machine.time
        # The link is served last: until then nothing can close.
        self._boot(lambda: robot.ports["A"].level(8), 6)
        robot.machine.resets.clear()
        robot.frames = True
        robot.run(1.0)
        if scenario.name != "start-no-button":
            robot.press_reset()
        robot.run(1.5)
        if robot.closed_since(begin):
            raise Failed("the relays closed")
        self._check_story(scenario)
        return None

    def _check_story(self, scenario):
        """What the board says, and whether it was reset as it must."""
        robot = self.robot
        resets = [why for _, why in robot.machine.resets]
        if scenario.reset and resets[:1] != [scenario.reset]:
            raise Failed(f"expected a reset by {scenario.reset}, got {resets}")
        if not scenario.reset and resets:
            raise Failed(f"unexpected resets {resets}")
        if not scenario.tells:
            return
        if robot.told is None:
            raise Failed("no status was received")
        told = {robot.told.self_test, robot.told.fault} | robot.told.live | robot.told.latched
        if not told & scenario.tells:
            raise Failed(f"expected one of {sorted(scenario.tells)}, told {sorted(told - {'-'})}")

    def flip_anything(self, seed, count):
        """Single bits of the controller's memory, one at a time; then a demand."""
        robot = self.robot
        address, size = faults.static(robot, "10CONTROLLER")
        at_once, on_demand, slowest = 0, 0, 0.0
        for place, bit in faults.random_flips(seed, count):
            robot.restore(self.armed)
            begin = robot.machine.time
            target = address + int(place * size)
            robot.machine.flip(target, bit)
            robot.run(scenarios.AT_ONCE)
            took = robot.opened_after(begin)
            if took is not None:
                at_once += 1
            else:
                robot.set_scene("none")
                begin = robot.machine.time
                robot.run(2 * scenarios.SEEN)
                took = robot.opened_after(begin)
                on_demand += 1
                if took is None or took > scenarios.SEEN:
                    raise Failed(f"seed {seed}: bit {bit} of {target:#x} hides a stop: {took}")
            slowest = max(slowest, took)
            after = robot.machine.time
            robot.run(0.1)
            if robot.closed_since(after):
                raise Failed(f"seed {seed}: bit {bit} of {target:#x}: closed again by itself")
        return at_once, on_demand, slowest


def arguments():
    parser = argparse.ArgumentParser(prog="cargo xtask board", description=__doc__)
    parser.add_argument("--elf", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--host", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--list", action="store_true", help="name the scenarios and end")
    parser.add_argument(
        "--only", metavar="NAME", action="append", help="play these scenarios only; may be repeated"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a line on standard output")
    parser.add_argument(
        "--flips", type=int, default=24, metavar="N", help="random bits of the controller's memory (24)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the random bits (1)")
    return parser.parse_args()


class Table:
    """Lines for people, or objects for programs."""

    def __init__(self, as_json):
        self.as_json = as_json

    def line(self, name, what, limit, took, result):
        if self.as_json:
            row = {
                "scenario": name,
                "what": what,
                "limit_ms": limit and limit * 1e3,
                "seen_ms": took and took * 1e3,
            }
            print(json.dumps({**row, "result": result}), flush=True)
            return
        bound = f"{limit * 1e3:8.1f}" if limit else "       -"
        seen = (
            f"{took * 1e3:8.1f}"
            if took is not None
            else "   never"
            if result == "ok" and not limit
            else "       -"
        )
        print(f"{name:<22} {what:<58} {bound} {seen}  {result}", flush=True)


def main():
    options = arguments()
    known = scenarios.control() + scenarios.running() + scenarios.start()
    if options.list:
        for scenario in known:
            print(f"{scenario.name:<22} {scenario.what}")
        return 0
    unknown = set(options.only or []) - {scenario.name for scenario in known} - {"flips"}
    if unknown:
        print(f"there is no scenario {', '.join(sorted(unknown))}; --list names them", file=sys.stderr)
        return 2
    began = time.monotonic()
    bench = Bench(options.elf, options.host)
    try:
        bench.prepare()
    except Failed as failure:
        print(f"the board does not come up and arm on the model: {failure}", file=sys.stderr)
        return 1
    table = Table(options.json)
    if not options.json:
        for what, seconds in bench.timings.items():
            print(f"{what}: {seconds:.3f} s of virtual time")
        print(f"\n{'scenario':<22} {'fault':<58} {'limit ms':>8} {'seen ms':>8}")
    failures = 0
    for scenario in known:
        if options.only and scenario.name not in options.only:
            continue
        took = None
        try:
            took, result = bench.play(scenario), "ok"
        except Failed as failure:
            failures, result = failures + 1, f"FAILED: {failure}"
        table.line(scenario.name, scenario.what, scenario.limit, took, result)
    if options.flips and (not options.only or "flips" in options.only):
        what = f"{options.flips} single bits of the controller's memory, seed {options.seed}"
        took = None
        try:
            at_once, on_demand, took = bench.flip_anything(options.seed, options.flips)
            result = "ok"
            what = f"{what}: {at_once} stop at once, {on_demand} on demand"
        except Failed as failure:
            failures, result = failures + 1, f"FAILED: {failure}"
        table.line("flips", what, scenarios.AT_ONCE, took, result)
    bench.host.close()
    seconds = time.monotonic() - began
    print(f"{failures} failures, {seconds:.0f} s; logic, not silicon", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
