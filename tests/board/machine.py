"""The processor of an STM32G474 and its memory, around Unicorn's Cortex-M4 core.

Unicorn executes instructions. This adds what it leaves out: exceptions with their priorities and stack frames,
sleep, memory-mapped devices, virtual time, resets that keep RAM, and snapshots.

Time is counted in cycles of 170 MHz, one instruction a cycle, and moves on in slices: whatever happens between
two devices is exact to about 12 microseconds. It proves logic, not timing to the cycle, and not silicon.
"""

import copy
import heapq
import struct

from elftools.elf.elffile import ELFFile
from unicorn import (
    UC_ARCH_ARM,
    UC_HOOK_CODE,
    UC_HOOK_MEM_FETCH_UNMAPPED,
    UC_HOOK_MEM_READ,
    UC_HOOK_MEM_READ_UNMAPPED,
    UC_HOOK_MEM_WRITE_PROT,
    UC_HOOK_MEM_WRITE_UNMAPPED,
    UC_MODE_MCLASS,
    UC_MODE_THUMB,
    UC_PROT_ALL,
    UC_PROT_EXEC,
    UC_PROT_READ,
    Uc,
    UcError,
)
from unicorn import arm_const as arm

from exceptions import Exceptions

HERTZ = 170_000_000
FLASH, FLASH_SIZE = 0x0800_0000, 0x8_0000
RAM, RAM_SIZE = 0x2000_0000, 0x1_8000
STACK_RAM, STACK_RAM_SIZE = 0x1000_0000, 0x8000
SYSTEM_MEMORY, SYSTEM_MEMORY_SIZE = 0x1FFF_0000, 0x1_0000
DEVICES = ((0x4000_0000, 0x3_0000), (0x4800_0000, 0x2000), (0x5000_0000, 0x7_0000), (0xE000_0000, 0x10_0000))

# The safety task's interrupt (UART5's number): its frame does not fit an overflown stack.
TICK_EXCEPTION = 53

SLICE = 2_000
LONG_SLICE = 40_000

CORE = [arm.UC_ARM_REG_R0 + place for place in range(13)] + [
    arm.UC_ARM_REG_SP,
    arm.UC_ARM_REG_LR,
    arm.UC_ARM_REG_XPSR,
]
CORE += [arm.UC_ARM_REG_PRIMASK, arm.UC_ARM_REG_BASEPRI, arm.UC_ARM_REG_CONTROL, arm.UC_ARM_REG_FPSCR]
CORE += [arm.UC_ARM_REG_S0 + place for place in range(32)]
FIRST_EXCEPTION_RETURN = 0xFFFF_FF00
WAIT_FOR_EVENT, YIELD, SEND_EVENT = b"\x20\xbf", b"\x10\xbf", b"\x40\xbf"


class Crash(Exception):
    """The processor did what no model of it can go on from, and no fault handler took it."""


def cycles(seconds):
    return int(seconds * HERTZ)


class Machine(Exceptions):
    """The chip; `devices` are added by `attach`, then `power_up` starts it."""

    def __init__(self, elf_path):
        with open(elf_path, "rb") as file:
            elf = ELFFile(file)
            self.segments = [
                (segment["p_paddr"], segment.data())
                for segment in elf.iter_segments()
                if segment["p_type"] == "PT_LOAD" and segment["p_filesz"]
            ]
            symbols = elf.get_section_by_name(".symtab")
            self.symbols = {
                symbol.name: (symbol["st_value"], symbol["st_size"]) for symbol in symbols.iter_symbols()
            }
            text = elf.get_section_by_name(".text")
            self.text_start, self.text = text["sh_addr"], text.data()
        self.devices = []
        self.by_page = {}
        self.time = 0
        self.events = []
        self.event_count = 0
        self.instructions = 0
        self.flash = bytearray(b"\xff" * FLASH_SIZE)
        for address, data in self.segments:
            self.flash[address - FLASH : address - FLASH + len(data)] = data
        self.ram = bytearray(RAM_SIZE)
        self.stack_ram = bytearray(STACK_RAM_SIZE)
        self.system_memory = bytearray(SYSTEM_MEMORY_SIZE)
        self.resets = []
        self.long_slices = False
        self.uc = None
        # The processor's own oscillator has stopped.
        self.stands_still = False
        self.stuck = None

    # ---- set-up ----------------------------------------------------------------------------------

    def attach(self, device):
        device.machine = self
        self.devices.append(device)
        for page in range(device.base >> 10, (device.base + device.size + 0x3FF) >> 10):
            self.by_page.setdefault(page, []).append(device)
        return device

    def power_up(self, seed=1):
        """Power comes on: memory holds anything."""
        state = seed
        for memory in (self.ram, self.stack_ram):
            for place in range(0, len(memory), 4):
                state = (state * 1_664_525 + 1_013_904_223) & 0xFFFF_FFFF
                struct.pack_into("<I", memory, place, state)
        for device in self.devices:
            device.power_up()
        self._boot()

    def reset(self, why):
        """A reset: RAM keeps its content, devices forget."""
        self.save_memory()
        self.resets.append((self.time / HERTZ, why))
        self.stands_still = False
        self.events = [event for event in self.events if event[2] == "world"]
        heapq.heapify(self.events)
        for device in self.devices:
            device.reset(why)
        self._boot()

    def _boot(self):
        if self.uc is None:
            self._make_core()
        self._load_memory()
        for register in CORE:
            self.uc.reg_write(register, 0)
        self.uc.reg_write(arm.UC_ARM_REG_XPSR, 1 << 24)
        self.pending, self.enabled, self.priority, self.active = set(), set(), {}, []
        self.event_flag, self.stop = False, None
        self.vectors = FLASH
        stack, entry = struct.unpack_from("<II", self.flash, 0)
        self.uc.reg_write(arm.UC_ARM_REG_SP, stack)
        self.pc = entry | 1

    def _make_core(self):
        self.uc = uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        uc.mem_map(FLASH, FLASH_SIZE, UC_PROT_READ | UC_PROT_EXEC)
        uc.mem_map(RAM, RAM_SIZE)
        uc.mem_map(STACK_RAM, STACK_RAM_SIZE)
        uc.mem_map(SYSTEM_MEMORY, SYSTEM_MEMORY_SIZE, UC_PROT_READ)
        for start, size in DEVICES:
            uc.mmio_map(start, size, self._on_read, start, self._on_write, start)
        for place in range(0, len(self.text) - 1, 2):
            opcode = self.text[place : place + 2]
            if opcode in (WAIT_FOR_EVENT, YIELD, SEND_EVENT):
                hook = {WAIT_FOR_EVENT: self._on_wait, YIELD: self._on_yield, SEND_EVENT: self._on_send}[
                    opcode
                ]
                address = self.text_start + place
                uc.hook_add(UC_HOOK_CODE, hook, begin=address, end=address)
        uc.hook_add(UC_HOOK_MEM_WRITE_PROT, self._on_flash_write)
        uc.hook_add(UC_HOOK_MEM_FETCH_UNMAPPED, self._on_fetch)
        uc.hook_add(UC_HOOK_MEM_READ_UNMAPPED | UC_HOOK_MEM_WRITE_UNMAPPED, self._on_unmapped)

    def _load_memory(self):
        for start, content in (
            (FLASH, self.flash),
            (RAM, self.ram),
            (STACK_RAM, self.stack_ram),
            (SYSTEM_MEMORY, self.system_memory),
        ):
            self._poke(start, bytes(content))
        if self.stuck is not None:
            self.uc.hook_del(self.stuck)
            self.stuck = None

    def _poke(self, address, data):
        protected = FLASH <= address < FLASH + FLASH_SIZE
        if protected:
            self.uc.mem_protect(FLASH, FLASH_SIZE, UC_PROT_ALL)
        self.uc.mem_write(address, data)
        self.uc.ctl_remove_cache(address, address + len(data))
        if protected:
            self.uc.mem_protect(FLASH, FLASH_SIZE, UC_PROT_READ | UC_PROT_EXEC)

    def save_memory(self):
        self.ram[:] = self.uc.mem_read(RAM, RAM_SIZE)
        self.stack_ram[:] = self.uc.mem_read(STACK_RAM, STACK_RAM_SIZE)

    # ---- memory, from outside -----------------------------------------------------------

    def read(self, address, length):
        return bytes(self.uc.mem_read(address, length))

    def word(self, address):
        return struct.unpack("<I", self.read(address, 4))[0]

    def flip(self, address, bit=0):
        """A bit of RAM or flash turns over by itself."""
        value = bytes([self.read(address, 1)[0] ^ (1 << bit)])
        if FLASH <= address < FLASH + FLASH_SIZE:
            self.flash[address - FLASH] = value[0]
        self._poke(address, value)

    def stick(self, address, bit, high):
        """A cell of RAM that keeps one level, whatever is written to it."""

        def before_read(_uc, _access, at, size, _value, _data):
            for place in range(at, at + size):
                if place == address:
                    byte = self.read(place, 1)[0]
                    byte = byte | 1 << bit if high else byte & ~(1 << bit)
                    self.uc.mem_write(place, bytes([byte]))

        word = address & ~3
        self.stuck = self.uc.hook_add(UC_HOOK_MEM_READ, before_read, begin=word, end=word + 3)

    def hang(self):
        """The program goes round in circles with interrupts masked."""
        place = RAM + RAM_SIZE - 16
        self.uc.mem_write(place, b"\xfe\xe7")
        self.uc.reg_write(arm.UC_ARM_REG_PRIMASK, 1)
        self.pc = place | 1

    def overflow_stack(self):
        """The stack pointer is at the end of the stack's memory."""
        self.uc.reg_write(arm.UC_ARM_REG_SP, STACK_RAM + 8)
        self.pending.add(TICK_EXCEPTION)

    def go_astray(self):
        """The program jumps to where no code is."""
        self.pc = 0x0600_0001

    def program_flash(self, offset, data):
        for place, byte in enumerate(data):
            self.flash[offset + place] &= byte
        self._poke(FLASH + offset, bytes(self.flash[offset : offset + len(data)]))

    def erase_flash(self, offset, length):
        self.flash[offset : offset + length] = b"\xff" * length
        self._poke(FLASH + offset, b"\xff" * length)

    # ---- snapshots -------------------------------------------------------------------------------

    FIELDS = (
        "time",
        "events",
        "event_count",
        "instructions",
        "flash",
        "ram",
        "stack_ram",
        "resets",
        "pending",
    )
    FIELDS += ("enabled", "priority", "active", "event_flag", "vectors", "pc")

    def snapshot(self):
        self.save_memory()
        fields = {name: copy.deepcopy(getattr(self, name)) for name in self.FIELDS}
        return (
            fields,
            [self.uc.reg_read(register) for register in CORE],
            [device.save() for device in self.devices],
        )

    def restore(self, snapshot):
        fields, core, devices = snapshot
        for name in self.FIELDS:
            setattr(self, name, copy.deepcopy(fields[name]))
        self._load_memory()
        for register, value in zip(CORE, core):
            self.uc.reg_write(register, value)
        self.stop, self.stands_still, self.long_slices = None, False, False
        for device, saved in zip(self.devices, devices):
            device.load(saved)

    # ---- hooks -----------------------------------------------------------------------------------

    def _on_wait(self, uc, address, _size, _data):
        if self.event_flag:
            self.event_flag = False
            uc.reg_write(arm.UC_ARM_REG_PC, (address + 2) | 1)
            return
        self.stop = "wait"
        uc.emu_stop()

    def _on_yield(self, uc, _address, _size, _data):
        self.stop = "yield"
        uc.emu_stop()

    def _on_send(self, _uc, _address, _size, _data):
        self.event_flag = True

    def _on_flash_write(self, _uc, _access, address, size, value, _data):
        for device in self.devices:
            if device.name == "flash" and device.is_programming():
                self.program_flash(address - FLASH, (value & ((1 << 8 * size) - 1)).to_bytes(size, "little"))
                return True
        self.stop = "fault"
        return False

    def _on_fetch(self, uc, _access, address, _size, _value, _data):
        self.stop = "return" if address >= FIRST_EXCEPTION_RETURN else "fault"
        uc.emu_stop()
        return False

    def _on_unmapped(self, _uc, _access, _address, _size, _value, _data):
        self.stop = "fault"
        return False

    # ---- devices ---------------------------------------------------------------------------------

    def _device(self, address):
        for device in self.by_page.get(address >> 10, ()):
            if device.base <= address < device.base + device.size:
                return device
        return None

    def _on_read(self, _uc, offset, size, start):
        address = start + offset
        aligned = address & ~3
        device = self._device(aligned)
        value = device.read(aligned - device.base) if device else 0
        return (value >> (8 * (address & 3))) & ((1 << (8 * size)) - 1)

    def _on_write(self, _uc, offset, size, value, start):
        address = start + offset
        device = self._device(address & ~3)
        if device:
            device.write_sized((address & ~3) - device.base, address & 3, size, value)

    def request_reset(self):
        self.stop = "reset"
        self.uc.emu_stop()

    # ---- time ------------------------------------------------------------------------------------

    def at(self, time, owner, method, *arguments):
        """Calls `owner.method(*arguments)` at this time; `world` events outlive a reset."""
        self.event_count += 1
        heapq.heappush(self.events, (int(time), self.event_count, owner, method, arguments))

    def _run_events(self, world):
        while self.events and self.events[0][0] <= self.time:
            _, _, owner, method, arguments = heapq.heappop(self.events)
            target = world if owner == "world" else next(d for d in self.devices if d.name == owner)
            getattr(target, method)(*arguments)

    def _next_time(self, until):
        times = [until]
        if self.events:
            times.append(self.events[0][0])
        for device in self.devices:
            next_time = device.next_time()
            if next_time is not None:
                times.append(next_time)
        return min(times)

    def run(self, until, world=None):
        """Runs until this time, in cycles."""
        while self.time < until:
            for device in self.devices:
                device.tick()
            self._run_events(world)
            if self._bitten():
                continue
            self._take_interrupt()
            self._slice(until)

    def _bitten(self):
        for device in self.devices:
            if device.bites():
                self.reset(device.name)
                return True
        return False

    def _slice(self, until):
        if self.stands_still:
            self.time = self._next_time(until)
            return
        self.stop = None
        most = LONG_SLICE if self.long_slices else SLICE
        count = max(16, min(most, self._next_time(until) - self.time))
        try:
            self.uc.emu_start(self.pc | 1, 0xFFFF_FFFE, count=count)
        except UcError as error:
            if self.uc.reg_read(arm.UC_ARM_REG_PC) >= FIRST_EXCEPTION_RETURN:
                self.stop = "return"
            if self.stop != "return":
                self._fault(error)
                return
        self.instructions += count
        if self.stop == "reset":
            self.reset("software")
        elif self.stop == "return":
            self._leave()
            # How much of the slice was run is not known; a quarter is the mean of the short handlers.
            self.time += count // 4
        elif self.stop == "fault":
            self._fault(None)
        else:
            self.pc = self.uc.reg_read(arm.UC_ARM_REG_PC)
            if self.stop in ("yield", "wait"):
                self.pc += 2
            if self.stop == "wait":
                if not self.pending & self.enabled:
                    self.time = max(self.time + 100, self._next_time(until))
            else:
                self.time += count

    def _fault(self, error):
        """A hard fault: the firmware's handler opens the relays and resets."""
        if "hard" in self.active:
            raise Crash(f"{error} at {self.uc.reg_read(arm.UC_ARM_REG_PC):#x}, {self.time / HERTZ:.4f} s")
        self.pc = self.uc.reg_read(arm.UC_ARM_REG_PC)
        self.active.append("hard")
        stack = self.uc.reg_read(arm.UC_ARM_REG_SP) & ~7
        if not (STACK_RAM + 64 < stack <= STACK_RAM + STACK_RAM_SIZE):
            # No room for the fault's own frame: the processor locks up, and only a watchdog leads out.
            self.stands_still = True
            return
        self.uc.reg_write(arm.UC_ARM_REG_SP, stack - 32)
        self.pc = self.word(self.vectors + 4 * 3)
        self.time += 16
