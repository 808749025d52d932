"""What a message costs: encoding and decoding of a few types, and how it grows with its size."""

from __future__ import annotations

import timeit

from bench.machine import describe_machine
from msbot import HelloWorld, Message
from msbot.ros2 import Header, Imu, LaserScan, Quaternion, Time, Twist, Vector3

ROUNDS = 5


def main() -> None:
    print(f"Messages, {describe_machine()}; best of {ROUNDS}\n")
    print("| message | bytes | encode | decode |\n|---|---|---|---|")
    vector = Vector3(x=1.0, y=2.0, z=3.0)
    header = Header(stamp=Time(sec=1, nanosec=2), frame_id="base_link")
    ranges = [0.5 * i for i in range(360)]
    messages: dict[str, Message] = {
        "HelloWorld": HelloWorld(index=1, message="Publisher A(1) turn-on 3"),
        "Twist": Twist(linear=vector, angular=vector),
        "Imu": Imu(
            header=header,
            orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=[0.0] * 9,
            angular_velocity=vector,
            angular_velocity_covariance=[0.0] * 9,
            linear_acceleration=vector,
            linear_acceleration_covariance=[0.0] * 9,
        ),
        "LaserScan of 360": LaserScan(
            header=header,
            angle_min=0.0,
            angle_max=6.28,
            angle_increment=0.0175,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=12.0,
            ranges=ranges,
            intensities=[],
        ),
    }
    for name, message in messages.items():
        octets = message.encode()
        decode = _us(lambda m=message, o=octets: type(m).decode(o))
        print(f"| {name} | {len(octets)} | {_us(message.encode)} | {decode} |")


def _us(call: object) -> str:
    timer = timeit.Timer(call)  # type: ignore[arg-type]
    count, _ = timer.autorange()
    return f"{min(timer.repeat(ROUNDS, count)) / count * 1e6:.2f} µs"


if __name__ == "__main__":
    main()
