"""Flash, pins, the link with its DMA, random numbers and the interrupt controller, as registers."""

import copy
import random

from device import Device


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
    """A GPIO port; its `world` says what the inputs are and is told about the outputs."""

    def __init__(self, name, base, modes):
        self.after_reset = {0x00: modes}
        self.name, self.base = name, base
        super().__init__()
        self.log = []

    def save(self):
        return copy.deepcopy(
            {key: value for key, value in self.__dict__.items() if key not in ("machine", "world")}
        )

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
