"""Writes the golden bytes of this folder: CDR as an independent implementation encodes it.

pip install rosbags==0.11.9 && python3 make.py

The values are those of ../wire.rs. Message definitions: ROS 2 Jazzy's as rosbags ships them, and our own
ModuleStatus.msg beside the crate's sources.
"""

from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HERE = Path(__file__).parent
MODULE_STATUS = HERE.parent.parent / "nearfield_msgs" / "msg" / "ModuleStatus.msg"

store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg(MODULE_STATUS.read_text(), "nearfield_msgs/msg/ModuleStatus"))
types = store.types


def new(name, *values):
    return types[name](*values)


def header(frame):
    return new("std_msgs/msg/Header", new("builtin_interfaces/msg/Time", 1_700_000_000, 123_456_789), frame)


def floats(*values):
    return np.array(values, dtype=np.float32)


messages = {
    "sensor_msgs/msg/LaserScan": new(
        "sensor_msgs/msg/LaserScan", header("nearfield_front"), -0.5, 0.5, 0.25, 0.0, 0.02, 0.01, 0.75,
        floats(np.inf, 0.5, 0.625, np.inf, 0.01), floats(),
    ),
    "sensor_msgs/msg/PointCloud2": new(
        "sensor_msgs/msg/PointCloud2", header("nearfield_rear_left"), 1, 1,
        [
            new("sensor_msgs/msg/PointField", name, offset, datatype, 1)
            for name, offset, datatype in (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("quality", 12, 2))
        ],
        False, 16, 16, np.frombuffer(floats(0.5, -0.25, 0.125).tobytes() + bytes([200, 0, 0, 0]), dtype=np.uint8), True,
    ),
    "diagnostic_msgs/msg/DiagnosticArray": new(
        "diagnostic_msgs/msg/DiagnosticArray", header(""),
        [
            new(
                "diagnostic_msgs/msg/DiagnosticStatus", 2, "nearfield: front", "the laser is dead", "nearfield source 1",
                [new("diagnostic_msgs/msg/KeyValue", "relay", "open"), new("diagnostic_msgs/msg/KeyValue", "a", "")],
            ),
            new("diagnostic_msgs/msg/DiagnosticStatus", 3, "", "", "", []),
        ],
    ),
    "nearfield_msgs/msg/ModuleStatus": new(
        "nearfield_msgs/msg/ModuleStatus", header("nearfield_front"), "front", 1, "stopped", ["stripe_cut", "host_request"],
        ["stripe_cut"], [], 0.1775, 0.045, float("nan"), 100, 0.0321, ["A"], ["B", "C"], "go_around",
    ),
}

for name, message in messages.items():
    data = bytes(store.serialize_cdr(message, name))
    lines = [data[start : start + 32].hex() for start in range(0, len(data), 32)]
    (HERE / (name.rsplit("/", 1)[1] + ".hex")).write_text("\n".join(lines) + "\n")
    print(name, len(data), "bytes")
