"""Clocks, power and the converter that measures it, as registers."""

from device import Device
from machine import HERTZ


class Clocks(Device):
    """RCC: every oscillator starts at once; keeps the reset flags."""

    name, base = "clocks", 0x4002_1000
    after_reset = {0x00: 0x500}
    FLAGS = {
        "power": 1 << 27,
        "pin": 0,
        "independent watchdog": 1 << 29,
        "window watchdog": 1 << 30,
        "software": 1 << 28,
    }
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
