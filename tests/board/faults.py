"""What goes wrong: each function gives or is something that is done to a robot."""

import random

from machine import FLASH, RAM, RAM_SIZE, STACK_RAM

# The relays' command "closed" in memory, see firmware/src/relay.rs.
CLOSED_WORD = 0x5A3C_96E1


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
    robot.machine.erase_flash(0x7_E000, 0x1000)


def close_key(robot):
    robot.key = True


def none(_robot):
    pass


def random_flips(seed, count):
    """Places in the controller's memory, as shares of it, and bits."""
    source = random.Random(seed)
    return [(source.random(), source.randrange(8)) for _ in range(count)]
