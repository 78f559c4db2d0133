"""Exceptions of a Cortex-M4, which Unicorn leaves out: priorities, stack frames with and without floating-point
registers, the way back. Mixed into the machine."""

import struct

from unicorn import arm_const as arm

STACKED = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3, arm.UC_ARM_REG_R12)
STACKED += (arm.UC_ARM_REG_LR,)
# The lowest address of the stack's memory.
STACK_END = 0x1000_0000


class Exceptions:
    """Of the machine, whose fields it uses."""

    def _take_interrupt(self):
        ready = self.pending & self.enabled
        if not ready or self.uc.reg_read(arm.UC_ARM_REG_PRIMASK) & 1:
            return
        number = min(ready, key=lambda n: (self.priority.get(n, 0), n))
        running = self.active[-1] if self.active else None
        if running is None or (
            running != "hard" and self.priority.get(number, 0) < self.priority.get(running, 0)
        ):
            self._enter(number)

    def _enter(self, number):
        uc = self.uc
        stack = uc.reg_read(arm.UC_ARM_REG_SP)
        control = uc.reg_read(arm.UC_ARM_REG_CONTROL)
        floating = bool(control & 4)
        aligned = (stack >> 2) & 1
        stack -= 4 * aligned
        status = (uc.reg_read(arm.UC_ARM_REG_XPSR) | 1 << 24) & ~0x200 | aligned << 9
        frame = struct.pack("<8I", *[uc.reg_read(register) for register in STACKED], self.pc & ~1, status)
        if floating:
            singles = [uc.reg_read(arm.UC_ARM_REG_S0 + place) for place in range(16)]
            frame += struct.pack("<16I", *singles) + struct.pack("<II", uc.reg_read(arm.UC_ARM_REG_FPSCR), 0)
            uc.reg_write(arm.UC_ARM_REG_CONTROL, control & ~4)
        stack -= len(frame)
        if stack < STACK_END:
            self.stands_still = True
            return
        uc.mem_write(stack, frame)
        uc.reg_write(arm.UC_ARM_REG_SP, stack)
        uc.reg_write(
            arm.UC_ARM_REG_LR, (0xFFFF_FFE1 if floating else 0xFFFF_FFF1) | (0 if self.active else 8)
        )
        self.active.append(number)
        self.pending.discard(number)
        self.pc = self.word(self.vectors + 4 * (16 + number))

    def _leave(self):
        uc = self.uc
        floating = not uc.reg_read(arm.UC_ARM_REG_PC) & 0x10
        stack = uc.reg_read(arm.UC_ARM_REG_SP)
        length = 0x68 if floating else 0x20
        frame = self.read(stack, length)
        words = struct.unpack("<8I", frame[:32])
        for register, word in zip(STACKED, words):
            uc.reg_write(register, word)
        if floating:
            for place in range(16):
                uc.reg_write(arm.UC_ARM_REG_S0 + place, struct.unpack_from("<I", frame, 32 + 4 * place)[0])
            uc.reg_write(arm.UC_ARM_REG_FPSCR, struct.unpack_from("<I", frame, 96)[0])
            uc.reg_write(arm.UC_ARM_REG_CONTROL, uc.reg_read(arm.UC_ARM_REG_CONTROL) | 4)
        uc.reg_write(arm.UC_ARM_REG_SP, stack + length + (4 if words[7] & 0x200 else 0))
        uc.reg_write(arm.UC_ARM_REG_XPSR, words[7] & ~0x1FF)
        self.pc = words[6] | 1
        self.active.pop()
        self.event_flag = True
