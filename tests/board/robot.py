"""What is wired to the board: relays with mirror contacts, driver read-backs, a button, a key, a laser, and a host
that sees the laser's light and clocks a transaction in every 20 ms."""

import bisect
import subprocess

import devices
import supplies
import timers
from machine import HERTZ, Machine, cycles

FRAME = cycles(0.020)
EXPOSURE = cycles(0.004)
# From the middle of the exposure to the transaction.
PICTURE_AGE = cycles(0.020)
# Force-guided relays: this long from the coil to the contacts.
RELAY_TIME = cycles(0.008)
LINK_HERTZ = 16_000_000
STATUS_BYTES = 256


class Host:
    """The other end of the link: the program that encodes line-scans."""

    def __init__(self, program):
        self.process = subprocess.Popen(
            [program, "board-host"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.rig = bytes.fromhex(self.ask("rig"))

    def ask(self, request):
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"the host program ended at the request {request[:60]}")
        return answer.strip()

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=10)


class Told:
    """What a status says, see `cargo xtask board-host`."""

    def __init__(self, words):
        self.state, self.self_test, self.fault = words[0], words[1], words[2]
        self.live, self.latched = set(words[3].split(",")) - {"-"}, set(words[4].split(",")) - {"-"}
        self.reset_cause, self.number = words[5], int(words[6])

    def __str__(self):
        causes = self.live | self.latched
        detail = self.self_test if self.self_test != "-" else ",".join(sorted(causes - {"interlock"}))
        return f"{self.state} {detail or '-'}"


class Robot:
    """A board in its surroundings."""

    def __init__(self, elf_path, host):
        self.host = host
        self.machine = Machine(elf_path)
        attach = self.machine.attach
        attach(supplies.Clocks())
        self.power = attach(supplies.Power())
        attach(supplies.Converter())
        attach(devices.Flash())
        self.ports = {}
        for name, base, modes in (
            ("A", 0x4800_0000, 0xABFF_FFFF),
            ("B", 0x4800_0400, 0xFFFF_FEBF),
            ("C", 0x4800_0800, 0xFFFF_FFFF),
        ):
            port = attach(devices.Port(name, base, modes))
            port.world = self
            self.ports[name] = port
        self.clock = attach(timers.TimeDriver())
        self.laser_timer = attach(timers.LaserTimer())
        self.laser_timer.world = self
        self.low_speed = attach(timers.LowSpeedCounter())
        self.link = attach(devices.Link())
        self.dma = attach(devices.DirectMemoryAccess())
        self.independent = attach(timers.IndependentWatchdog())
        self.window = attach(timers.WindowWatchdog())
        self.random = attach(devices.RandomNumbers())
        attach(devices.SystemControl())
        calibration = supplies.Converter.CALIBRATION.to_bytes(2, "little")
        self.machine.system_memory[0x75AA:0x75AC] = calibration
        self.faults = {}
        self._forget()

    def _forget(self):
        self.coil_log = {"a": [(0, False)], "b": [(0, False)]}
        self.closed_log = [(0, False)]
        self.driven_log = [(0, False)]
        self.light_log = [(0, 0.0)]
        self.pressed_until = 0
        self.key = False
        self.status = None
        self.told = None
        self.scene_log = [(0, "0")]
        self.verdict = "clear"
        self.frames = False
        self.shorten = None
        self.sequence, self.sent, self.answered = 0, 0, 0
        self.next_frame = 0
        self.answer = b""

    WORLD = (
        "coil_log",
        "closed_log",
        "driven_log",
        "light_log",
        "scene_log",
        "pressed_until",
        "key",
        "status",
        "told",
        "verdict",
    )
    WORLD += ("frames", "shorten", "sequence", "sent", "answered", "next_frame")

    def snapshot(self):
        logs = {
            name: list(v) if isinstance(v, list) else v
            for name, v in ((n, getattr(self, n)) for n in self.WORLD)
        }
        logs["coil_log"] = {channel: list(log) for channel, log in self.coil_log.items()}
        return logs, self.machine.snapshot()

    def restore(self, snapshot):
        logs, machine = snapshot
        for name, value in logs.items():
            setattr(self, name, list(value) if isinstance(value, list) else value)
        self.coil_log = {channel: list(log) for channel, log in logs["coil_log"].items()}
        self.faults = {}
        self.machine.restore(machine)

    # ---- wires -----------------------------------------------------------------------------------

    COILS = {"a": 0, "b": 1}

    def coil(self, channel):
        """What the driver of a channel gives out."""
        stuck = self.faults.get(f"driver {channel}")
        if stuck is not None:
            return stuck
        port = self.ports["C"]
        if self.faults.get("drivers shorted"):
            return port.level(0) or port.level(1)
        return port.level(self.COILS[channel])

    def outputs_changed(self):
        if not hasattr(self, "coil_log") or len(self.ports) < 3:
            return
        now = self.machine.time
        for channel, log in self.coil_log.items():
            if log[-1][1] != self.coil(channel):
                log.append((now, self.coil(channel)))
        pins = [self.ports["C"].level(pin) for pin in (0, 1)]
        for log, level in ((self.closed_log, all(pins)), (self.driven_log, any(pins))):
            if log[-1][1] != level:
                log.append((now, level))

    def contact_closed(self, channel):
        """Of the relay: follows its coil when that has kept its level long enough."""
        for since, level in reversed(self.coil_log[channel]):
            end = self.machine.time
            later = [at for at, _ in self.coil_log[channel] if at > since]
            if (later[0] if later else end) - since >= RELAY_TIME:
                return level
        return False

    def input(self, port, pin):
        if port == "C" and pin in (2, 3):
            channel = "ab"[pin - 2]
            stuck = self.faults.get(f"mirror {channel}")
            return (not self.contact_closed(channel)) if stuck is None else stuck
        if port == "C" and pin == 13:
            return self.machine.time < self.pressed_until
        if port == "C" and pin == 8:
            return self.key
        if port == "B" and pin in (0, 1):
            channel = "ab"[pin]
            stuck = self.faults.get(f"read-back {channel}")
            return self.coil(channel) if stuck is None else stuck
        return False

    def light_changed(self):
        duty = self.laser_timer.duty()
        if self.light_log[-1][1] != duty:
            self.light_log.append((self.machine.time, duty))

    def light_at(self, time):
        """Mean brightness over an exposure around this time, 0 to 255."""
        if "light" in self.faults:
            return self.faults["light"]
        begin, end, total = time - EXPOSURE // 2, time + EXPOSURE // 2, 0.0
        place = max(0, bisect.bisect_right([at for at, _ in self.light_log], begin) - 1)
        for index in range(place, len(self.light_log)):
            start, duty = self.light_log[index]
            stop = self.light_log[index + 1][0] if index + 1 < len(self.light_log) else end
            total += duty * max(0, min(stop, end) - max(start, begin))
        return round(255 * total / (end - begin))

    def set_scene(self, height):
        """From now on the floor is this high everywhere, in millimetres; "none" hides the stripe."""
        self.scene_log.append((self.machine.time, height))

    def scene_at(self, time):
        return [height for at, height in self.scene_log if at <= time][-1]

    # ---- the host's side of the link -------------------------------------------------------------

    def transact(self, message):
        """A transaction, if the board is ready for one."""
        ready = self.ports["A"].level(8) and self.link.is_listening() and self.dma.is_armed()
        if not ready:
            return False
        message = message[: self.shorten] if self.shorten else message
        self.machine.at(
            self.machine.time + len(message) * 8 * HERTZ // LINK_HERTZ, "world", "arrive", message
        )
        return True

    def arrive(self, message):
        if not self.dma.is_armed():
            return
        answer = self.dma.transfer(message)
        if len(answer) >= STATUS_BYTES:
            self.answered += 1
            self.answer = answer
            self.status = answer[:STATUS_BYTES].hex() if answer[:4] == b"NFST" else None
            if self.status:
                self.told = Told(self.host.ask(f"status {self.status}").split())

    def send_frame(self):
        """The picture that was exposed 20 ms ago, as an honest host reports it."""
        micros = 1_000_000
        exposed = self.machine.time - PICTURE_AGE
        light, height = self.light_at(exposed), self.scene_at(exposed)
        self.sequence += 1
        times = f"{PICTURE_AGE * micros // HERTZ} {EXPOSURE * micros // HERTZ}"
        picture = f"{self.sequence} {times} {light} {height} {self.verdict}"
        words = self.host.ask(f"scan {picture} {self.status or '-'}").split()
        message = bytes.fromhex(words[7])
        damage = self.faults.get("damage")
        if damage is not None:
            message = message[:damage] + bytes([message[damage] ^ 4]) + message[damage + 1 :]
        self.sent += self.transact(message)

    def run(self, seconds):
        """Lets time pass; with `frames` on, the host sends one every 20 ms."""
        end = self.machine.time + cycles(seconds)
        while self.machine.time < end:
            if self.frames and self.machine.time >= self.next_frame:
                self.send_frame()
                self.next_frame = self.machine.time + FRAME
            target = min(end, self.next_frame) if self.frames else end
            self.machine.run(target, self)

    # ---- for scenarios ---------------------------------------------------------------------------

    @property
    def now(self):
        return self.machine.time / HERTZ

    def closed_since(self, time):
        """Were both relay pins high at any time from then on?"""
        place = bisect.bisect_right([at for at, _ in self.closed_log], time) - 1
        return any(level for _, level in self.closed_log[place:])

    def opened_after(self, time):
        """Seconds from then until both relay pins were low, or None."""
        place = bisect.bisect_right([at for at, _ in self.driven_log], time) - 1
        for at, driven in self.driven_log[place:]:
            if not driven:
                return max(0, at - time) / HERTZ
        return None

    def press_reset(self, seconds=0.2):
        self.pressed_until = self.machine.time + cycles(seconds)

    def run_until(self, condition, most, step=0.001):
        """The time that it took, or None."""
        begin = self.machine.time
        while self.machine.time - begin < cycles(most):
            if condition():
                return (self.machine.time - begin) / HERTZ
            self.run(step)
        return (self.machine.time - begin) / HERTZ if condition() else None
