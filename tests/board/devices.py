"""The STM32G474's devices that the firmware uses, as registers: clocks, power, flash, pins, timers, SPI with DMA, both
watchdogs, random numbers, converter, interrupt controller. Written from ST's reference manual RM0440.

A device has plain registers unless a method says otherwise. Faults are fields that a scenario sets.
"""

import copy
import random

from machine import HERTZ

LOW_SPEED_HERTZ = 32_000


class Device:
    """Registers that keep what is written to them."""

    name = "device"
    base = 0
    size = 0x400
    after_reset = {}

    def __init__(self):
        self.machine = None
        self.registers = dict(self.after_reset)

    def power_up(self):
        self.reset("power")

    def reset(self, _why):
        self.registers = dict(self.after_reset)

    def save(self):
        return copy.deepcopy({key: value for key, value in self.__dict__.items() if key != "machine"})

    def load(self, saved):
        self.__dict__.update(copy.deepcopy(saved))

    def get(self, offset):
        return self.registers.get(offset, 0)

    def read(self, offset):
        return self.get(offset)

    def write(self, offset, value):
        self.registers[offset] = value

    def write_sized(self, offset, byte, size, value):
        if size < 4:
            mask = ((1 << 8 * size) - 1) << 8 * byte
            value = self.get(offset) & ~mask | value << 8 * byte & mask
        self.write(offset, value & 0xFFFF_FFFF)

    def tick(self):
        """Called before every slice."""

    def next_time(self):
        """When something happens by itself."""

    def bites(self):
        """Resets the chip now?"""
        return False


class Clocks(Device):
    """RCC: every oscillator starts at once; keeps the reset flags."""

    name, base = "clocks", 0x4002_1000
    after_reset = {0x00: 0x500}
    FLAGS = {"power": 1 << 27, "pin": 0, "independent watchdog": 1 << 29, "window watchdog": 1 << 30, "software": 1 << 28}
    PIN = 1 << 26

    def __init__(self):
        super().__init__()
        self.flags = 0

    def reset(self, why):
        super().reset(why)
        self.flags |= self.FLAGS[why] | self.PIN

    def power_up(self):
        self.flags = 0
        self.reset("power")

    def read(self, offset):
        value = self.get(offset)
        if offset == 0x00:
            # HSI, HSE, PLL: ready when on.
            return value & ~0x0202_0400 | (value & 0x100) << 2 | (value & 0x0101_0000) << 1
        if offset == 0x08:
            return value & ~0xC | (value & 3) << 2
        if offset == 0x94:
            return value & ~0xFF00_0002 | self.flags | (value & 1) << 1
        if offset == 0x98:
            return value & ~2 | (value & 1) << 1
        return value

    def write(self, offset, value):
        if offset == 0x94 and value & 1 << 23:
            self.flags, value = 0, value & ~(1 << 23)
        if offset == 0x38 and value & 1 << 14:
            next(device for device in self.machine.devices if device.name == "link").reset("clocks")
        super().write(offset, value)


class Power(Device):
    """PWR: the voltage detector sees the supply."""

    name, base = "power", 0x4000_7000

    def __init__(self):
        super().__init__()
        self.millivolts = 3_300

    def read(self, offset):
        if offset == 0x14:
            below = self.get(0x04) & 1 and self.millivolts < 2_900
            return 1 << 11 if below else 0
        return self.get(offset)


class Converter(Device):
    """ADC1 with its common registers: channel 18 is the internal reference, 1.212 V."""

    name, base = "converter", 0x5000_0000
    CALIBRATION = 1_655

    def __init__(self):
        super().__init__()
        self.started = None

    def reset(self, why):
        super().reset(why)
        self.started = None

    def _finish(self):
        if self.started is not None and self.machine.time - self.started > 16 * HERTZ // 1_000_000:
            self.started = None
            supply = next(device for device in self.machine.devices if device.name == "power").millivolts
            self.registers[0x40] = min(4_095, 3_000 * self.CALIBRATION // supply)
            self.registers[0x00] = self.get(0x00) | 0xC

    def read(self, offset):
        self._finish()
        return self.get(offset)

    def write(self, offset, value):
        if offset == 0x00:
            value = self.get(0x00) & ~value
        if offset == 0x08:
            if value & 1:
                self.registers[0x00] = self.get(0x00) | 1
            if value & 4:
                self.started = self.machine.time
            value &= ~(1 << 31 | 4)
        super().write(offset, value)


class Flash(Device):
    """Programming and erasing; one bank is like the other."""

    name, base = "flash", 0x4002_2000
    KEYS = [0x4567_0123, 0xCDEF_89AB]
    after_reset = {0x20: 0xFFEF_F8AA}

    def __init__(self):
        super().__init__()
        self.locked, self.keys = True, []

    def reset(self, why):
        super().reset(why)
        self.locked, self.keys = True, []

    def is_programming(self):
        return not self.locked and bool(self.get(0x14) & 1)

    def read(self, offset):
        if offset == 0x14:
            return self.get(offset) & ~(1 << 31 | 1 << 16) | self.locked << 31
        return self.get(offset)

    def write(self, offset, value):
        if offset == 0x08:
            self.keys = self.keys[-1:] + [value]
            self.locked = self.keys != self.KEYS
            return
        if offset == 0x10:
            return
        if offset == 0x14:
            self.locked = self.locked or bool(value >> 31)
            if value & 1 << 16 and value & 2 and not self.locked:
                page, bank = value >> 3 & 0x7F, value >> 11 & 1
                self.machine.erase_flash(page * 2048 + bank * 0x4_0000, 2048)
                value &= ~(1 << 16)
        super().write(offset, value)


class Port(Device):
    """A GPIO port; `inputs` maps a pin to a function of the machine's time, `on_change` is told about outputs."""

    def __init__(self, name, base, modes):
        self.after_reset = {0x00: modes}
        self.name, self.base = name, base
        super().__init__()
        self.log = []

    def save(self):
        return copy.deepcopy({key: value for key, value in self.__dict__.items() if key not in ("machine", "world")})

    def level(self, pin):
        """Of an output; a pin that is none floats, and the external resistor pulls it low."""
        return bool(self.get(0x00) >> 2 * pin & 3 == 1 and self.get(0x14) >> pin & 1)

    def read(self, offset):
        if offset != 0x10:
            return self.get(offset)
        levels = 0
        for pin in range(16):
            driven = self.get(0x00) >> 2 * pin & 3 == 1
            levels |= (self.level(pin) if driven else self.world.input(self.name, pin)) << pin
        return levels

    def write(self, offset, value):
        if offset in (0x18, 0x28):
            high, low = (value & 0xFFFF, value >> 16) if offset == 0x18 else (0, value)
            offset, value = 0x14, self.get(0x14) & ~low | high
        super().write(offset, value)
        self.world.outputs_changed()

    def reset(self, why):
        super().reset(why)
        self.world.outputs_changed()


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
        return copy.deepcopy({key: value for key, value in self.__dict__.items() if key not in ("machine", "world")})


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


class Link(Device):
    """SPI2 as a slave."""

    name, base = "link", 0x4000_3800
    after_reset = {0x04: 0x700}

    def read(self, offset):
        # Transmit FIFO empty, receive FIFO empty, not busy.
        return 2 if offset == 0x08 else self.get(offset)

    def is_listening(self):
        return self.get(0x00) & 0x40 and self.get(0x04) & 1


class DirectMemoryAccess(Device):
    """DMA1: channel 1 feeds the link, channel 2 empties it."""

    name, base = "dma", 0x4002_0000
    INTERRUPTS = {1: 11, 2: 12}

    def channel(self, number, register):
        return 0x08 + 20 * (number - 1) + register

    def is_armed(self):
        return self.get(self.channel(2, 0)) & 1

    def transfer(self, received):
        """A transaction of these bytes; gives what went out."""
        sent = b""
        for number in (1, 2):
            count = self.get(self.channel(number, 4))
            address = self.get(self.channel(number, 12))
            length = min(count, len(received))
            if number == 1:
                sent = self.machine.read(address, length)
            else:
                self.machine.uc.mem_write(address, bytes(received[:length]))
            self.registers[self.channel(number, 4)] = count - length
            if count == length:
                self.registers[0x00] = self.get(0x00) | 3 << 4 * (number - 1)
                if self.get(self.channel(number, 0)) & 2:
                    self.machine.pending.add(self.INTERRUPTS[number])
        return sent

    def write(self, offset, value):
        if offset == 0x04:
            self.registers[0x00] = self.get(0x00) & ~value
            return
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


class RandomNumbers(Device):
    """RNG; `failure`: None, "silent", "seed error", "stuck"."""

    name, base = "random numbers", 0x5006_0800

    def __init__(self):
        super().__init__()
        self.failure, self.source = None, random.Random(20_260_101)

    def read(self, offset):
        if offset == 0x04:
            if not self.get(0x00) & 4 or self.failure == "silent":
                return 0
            return 0x44 if self.failure == "seed error" else 1
        if offset == 0x08:
            return 0x5EED_5EED if self.failure == "stuck" else self.source.getrandbits(32)
        return self.get(offset)


class SystemControl(Device):
    """Interrupt controller, system control block, cycle counter."""

    name, base, size = "system", 0xE000_0000, 0x10_0000

    def read(self, offset):
        machine = self.machine
        if 0xE100 <= offset < 0xE120:
            return sum(1 << bit for bit in range(32) if (offset - 0xE100) * 8 + bit in machine.enabled)
        if offset == 0x1004:
            return machine.time & 0xFFFF_FFFF
        if offset == 0xED00:
            return 0x410F_C241
        if offset == 0xED08:
            return machine.vectors
        return self.get(offset)

    def write_sized(self, offset, byte, size, value):
        if 0xE400 <= offset < 0xE500:
            for place in range(size):
                self.machine.priority[offset - 0xE400 + byte + place] = value >> 8 * place & 0xFF
            return
        super().write_sized(offset, byte, size, value)

    def write(self, offset, value):
        machine = self.machine

        def numbers(start):
            return {(offset - start) * 8 + bit for bit in range(32) if value >> bit & 1}

        if 0xE100 <= offset < 0xE120:
            machine.enabled |= numbers(0xE100)
        elif 0xE180 <= offset < 0xE1A0:
            machine.enabled -= numbers(0xE180)
        elif 0xE200 <= offset < 0xE220:
            machine.pending |= numbers(0xE200)
        elif 0xE280 <= offset < 0xE2A0:
            machine.pending -= numbers(0xE280)
        elif offset == 0xEF00:
            machine.pending.add(value & 0x1FF)
        elif offset == 0xED0C and value & 4:
            machine.request_reset()
        elif offset == 0xED08:
            machine.vectors = value
        else:
            super().write(offset, value)


class Plain(Device):
    """Registers without a meaning here."""

    def __init__(self, name, base, size=0x400):
        self.name, self.base, self.size = name, base, size
        super().__init__()
