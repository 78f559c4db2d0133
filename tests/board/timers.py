"""Timers and watchdogs, as registers."""

import copy

from device import Device
from machine import HERTZ

LOW_SPEED_HERTZ = 32_000


class TimeDriver(Device):
    """TIM15: the firmware's clock."""

    name, base = "clock", 0x4001_4000
    INTERRUPT = 24

    def __init__(self):
        super().__init__()
        self.start, self.last = 0, 0

    def reset(self, why):
        super().reset(why)
        self.start = self.last = self.machine.time if self.machine else 0
        self.last = 0

    def _count(self):
        if not self.get(0x00) & 1:
            return 0
        return (self.machine.time - self.start) // (self.get(0x28) + 1)

    def tick(self):
        if not self.get(0x00) & 1:
            return
        now, before = self._count(), self.last
        if now < before:
            before = now
        state = self.get(0x10)
        if now >> 16 != before >> 16:
            state |= 1
        for channel, offset in ((1, 0x34), (2, 0x38)):
            compare = self.get(offset)
            if (now - compare) >> 16 != (before - compare) >> 16:
                state |= 1 << channel
        self.last, self.registers[0x10] = now, state
        if state & self.get(0x0C) & 7:
            self.machine.pending.add(self.INTERRUPT)

    def next_time(self):
        if not self.get(0x00) & 1:
            return None
        now, prescale, times = self._count(), self.get(0x28) + 1, []
        for channel, offset in ((0, None), (1, 0x34), (2, 0x38)):
            if self.get(0x0C) >> channel & 1:
                compare = self.get(offset) if offset else 0
                times.append(self.start + (now + ((compare - now - 1) & 0xFFFF) + 1) * prescale)
        return min(times, default=None)

    def read(self, offset):
        if offset == 0x24:
            return self._count() & 0xFFFF
        if offset == 0x10:
            self.tick()
        return self.get(offset)

    def write(self, offset, value):
        if offset == 0x14:
            self.start, self.last = self.machine.time, 0
            return
        if offset == 0x10:
            value &= self.get(0x10)
        if offset == 0x00 and value & 1 and not self.get(0x00) & 1:
            self.start, self.last = self.machine.time, 0
        if offset == 0x24:
            self.start, self.last = self.machine.time - value * (self.get(0x28) + 1), value
            return
        super().write(offset, value)


class LaserTimer(Device):
    """TIM3: channel 4 is the laser's brightness."""

    name, base = "laser timer", 0x4000_0400

    def __init__(self):
        super().__init__()
        # The timer ignores new levels; the laser's diode or its driver is dead.
        self.stuck, self.dead = False, False

    def duty(self):
        """0 to 1."""
        if self.dead or not (self.get(0x00) & 1 and self.get(0x20) & 1 << 12):
            return 0.0
        return min(1.0, self.get(0x40) / (self.get(0x2C) + 1))

    def write(self, offset, value):
        if self.stuck and offset == 0x40:
            return
        super().write(offset, value)
        self.world.light_changed()

    def save(self):
        return copy.deepcopy(
            {key: value for key, value in self.__dict__.items() if key not in ("machine", "world")}
        )


class LowSpeedCounter(Device):
    """LPTIM1 on the low-speed oscillator, whose frequency a scenario may change."""

    name, base = "low-speed counter", 0x4000_7C00

    def __init__(self):
        super().__init__()
        self.hertz, self.counted, self.since = LOW_SPEED_HERTZ, 0.0, 0

    def reset(self, why):
        super().reset(why)
        self.counted, self.since = 0.0, self.machine.time if self.machine else 0

    def set_hertz(self, hertz):
        self._advance()
        self.hertz = hertz

    def _advance(self):
        if self.get(0x10) & 5 == 5:
            self.counted += (self.machine.time - self.since) * self.hertz / HERTZ
        self.since = self.machine.time

    def read(self, offset):
        if offset == 0x1C:
            self._advance()
            return int(self.counted) & 0xFFFF
        return self.get(offset)

    def write(self, offset, value):
        self._advance()
        super().write(offset, value)


class IndependentWatchdog(Device):
    """IWDG, on the low-speed oscillator."""

    name, base = "independent watchdog", 0x4000_3000
    after_reset = {0x08: 0xFFF}

    def __init__(self):
        super().__init__()
        self.deadline, self.dead = None, False

    def reset(self, why):
        super().reset(why)
        self.deadline = None

    def write(self, offset, value):
        if offset == 0x00:
            if value == 0xCCCC or (value == 0xAAAA and self.deadline is not None):
                hertz = next(d for d in self.machine.devices if d.name == "low-speed counter").hertz
                counts = (self.get(0x08) + 1) * (4 << (self.get(0x04) & 7))
                self.deadline = self.machine.time + int(counts * HERTZ / hertz) if hertz else float("inf")
            return
        super().write(offset, value)

    def next_time(self):
        return None if self.dead or self.deadline is None or self.deadline == float("inf") else self.deadline

    def bites(self):
        return not self.dead and self.deadline is not None and self.machine.time >= self.deadline


class WindowWatchdog(Device):
    """WWDG, on the processor's clock; an early feed bites too."""

    name, base = "window watchdog", 0x4000_2C00
    after_reset = {0x00: 0x7F, 0x04: 0x7F}

    def __init__(self):
        super().__init__()
        self.fed, self.dead = None, False

    def reset(self, why):
        super().reset(why)
        self.fed = None

    def _step(self):
        return 4_096 << (self.get(0x04) >> 11 & 7)

    def write(self, offset, value):
        if offset == 0x00:
            if self.dead:
                return
            now = self.machine.time
            if self.fed is not None:
                counter = (self.get(0x00) & 0x7F) - (now - self.fed) // self._step()
                if counter > (self.get(0x04) & 0x7F):
                    self.fed = -(10**18)
                    return
            if value & 0x80:
                self.fed = now
        super().write(offset, value)

    def next_time(self):
        if self.dead or self.fed is None:
            return None
        return self.fed + ((self.get(0x00) & 0x7F) - 0x3F) * self._step()

    def bites(self):
        return not self.dead and self.fed is not None and self.machine.time >= self.next_time()
