"""What every device of the model is: registers that keep what is written to them."""

import copy


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


class Plain(Device):
    """Registers without a meaning here."""

    def __init__(self, name, base, size=0x400):
        self.name, self.base, self.size = name, base, size
        super().__init__()
