"""Listens to a sensor with an implementation of DDS that is not ours: Eclipse Cyclone DDS.

    pip install cyclonedds==11.0.1
    python3 listener.py --domain 0 --namespace /nearfield/front --seconds 5

Prints one JSON object about what was heard, with the quality of service that nav2's collision monitor subscribes with
(rclcpp::SensorDataQoS: best effort, volatile, the last five). Exit code 1 = scan, heights, status or diagnostics are missing.
"""

import argparse
import json
import math
import os
import time
from dataclasses import dataclass

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--domain", type=int, default=0)
parser.add_argument("--namespace", default="/nearfield/front")
parser.add_argument("--seconds", type=float, default=5.0)
parser.add_argument("--loopback", action="store_true", help="on this computer only, without multicast")
arguments = parser.parse_args()
if arguments.loopback:
    # Read when the library is loaded.
    os.environ["CYCLONEDDS_URI"] = (
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>20</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
        "</Discovery></Domain></CycloneDDS>"
    )

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import float32, int32, sequence, uint8, uint32  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclass
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class ModuleStatus(IdlStruct, typename="nearfield_msgs::msg::dds_::ModuleStatus_"):
    header: Header
    module: str
    relay: uint8
    state: str
    live_causes: sequence[str]
    latched_causes: sequence[str]
    warnings: sequence[str]
    longest_gap: float32
    highest: float32
    lowest: float32
    permitted_speed_percent: uint8
    decision_age: float32
    protective_zones: sequence[str]
    warning_zones: sequence[str]
    advice: str


SENSOR_DATA = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5))
LATCHED = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.Volatile, Policy.History.KeepLast(10))

participant = DomainParticipant(arguments.domain)


def reader(name, kind, qos):
    return DataReader(participant, Topic(participant, "rt" + name, kind), qos=qos)


readers = {
    "scan": reader(arguments.namespace + "/scan", LaserScan, SENSOR_DATA),
    "heights": reader(arguments.namespace + "/heights", PointCloud2, SENSOR_DATA),
    "status": reader(arguments.namespace + "/status", ModuleStatus, LATCHED),
    "diagnostics": reader("/diagnostics", DiagnosticArray, RELIABLE),
}
counts = dict.fromkeys(readers, 0)
newest = {}
ages = []
free = blocked = 0
end = time.monotonic() + arguments.seconds
while time.monotonic() < end:
    for name, one in readers.items():
        for message in one.take(N=50):
            counts[name] += 1
            newest[name] = message
            if name == "scan":
                ages.append(time.time() - message.header.stamp.sec - message.header.stamp.nanosec * 1e-9)
                is_free = all(math.isinf(distance) for distance in message.ranges)
                free, blocked = free + is_free, blocked + (not is_free)
    time.sleep(0.005)

heard = {"messages": counts}
if "scan" in newest:
    scan = newest["scan"]
    heard["scan"] = {
        "frame_id": scan.header.frame_id,
        "beams": len(scan.ranges),
        "first_angle": scan.angle_min,
        "not_a_number": sum(math.isnan(distance) for distance in scan.ranges),
        "free_scans": free,
        "scans_with_obstacles": blocked,
        "median_age_ms": round(1000 * sorted(ages)[len(ages) // 2], 1),
    }
if "heights" in newest:
    cloud = newest["heights"]
    heard["heights"] = {"points": cloud.width, "bytes": len(cloud.data), "fields": [field.name for field in cloud.fields]}
if "status" in newest:
    status = newest["status"]
    heard["status"] = {"module": status.module, "relay": status.relay, "state": status.state, "causes": list(status.live_causes)}
if "diagnostics" in newest:
    diagnosis = newest["diagnostics"].status[0]
    heard["diagnostics"] = {"level": diagnosis.level, "name": diagnosis.name, "message": diagnosis.message}
print(json.dumps(heard))
raise SystemExit(0 if all(counts.values()) else 1)
