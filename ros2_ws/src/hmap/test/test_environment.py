"""The environment that launchers pass to nodes, and two processes that talk through it."""

import json
import os
import subprocess
import sys
import textwrap
from importlib.util import find_spec
from pathlib import Path

import pytest

from hmap.environment import DISCOVERY, GUARD, LIBRARIES, PROFILES, ros_environment, share_path

WHEELS = find_spec("ros_wheels_bootstrapper") is not None
TIMEOUT_S = 60.0
POINTS = 400_000  # 9.6 MB: far over the shared memory that Fast DDS takes by default, with which 2 of 30 arrive
CLOUDS = 10  # that have to arrive out of at most SENT in a row
SENT = 20

TALKER = f"""
import time
import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data
from hmap_msgs.msg import ObjectCloud, PlannerStatus
from hmap_msgs_py.clouds import object_cloud_to_message

rclpy.init()
node = rclpy.create_node("talker")
clouds = node.create_publisher(ObjectCloud, "cloud", qos_profile_sensor_data)
status = node.create_publisher(PlannerStatus, "status", 1)
points = np.zeros(({POINTS}, 3), np.float32)
normals = np.tile(np.float32([0, 0, 1]), ({POINTS}, 1))
message = object_cloud_to_message("bar", [0, 0, 0, 0, 0, 0, 1], points, normals)
while True:
    status.publish(PlannerStatus(phase=PlannerStatus.MOTION, waypoint=2))
    message.cloud.header.stamp.sec += 1
    clouds.publish(message)
    time.sleep(0.1)
"""

LISTENER = f"""
import json
import time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from hmap_msgs.msg import ObjectCloud, PlannerStatus

rclpy.init()
node = rclpy.create_node("listener")
numbers, widths, phases = [], set(), set()

def on_cloud(message):
    numbers.append(message.cloud.header.stamp.sec)
    widths.add(message.cloud.width)

node.create_subscription(ObjectCloud, "cloud", on_cloud, qos_profile_sensor_data)
node.create_subscription(PlannerStatus, "status", lambda m: phases.add((m.phase, m.waypoint)), 1)
end = time.monotonic() + {TIMEOUT_S}
while (len(numbers) < {CLOUDS} or not phases) and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
node.destroy_node()
rclpy.shutdown()
print(json.dumps([numbers, list(widths), list(phases)]))
"""


def run(code: str, environment: dict[str, str]) -> str:
    command = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=2 * TIMEOUT_S)
    assert done.returncode == 0, done.stderr
    return done.stdout


def bare() -> dict[str, str]:
    """The environment of a user who has sourced nothing."""
    return {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}


def test_two_processes_talk_with_nothing_sourced():
    environment = ros_environment(bare() | {"ROS_DOMAIN_ID": "87"})
    talker = subprocess.Popen([sys.executable, "-c", TALKER], env=environment, stderr=subprocess.PIPE, text=True)
    try:
        heard = run(LISTENER, environment)
    finally:
        talker.kill()
        errors = talker.communicate()[1]
    numbers, widths, phases = json.loads(heard.strip().splitlines()[-1])
    assert (widths, phases) == ([POINTS], [["motion", 2]]), errors
    assert numbers[CLOUDS - 1] - numbers[0] < SENT


def test_defaults_are_set_only_where_the_user_has_not():
    environment = ros_environment(bare())
    assert environment[DISCOVERY] == "LOCALHOST"
    assert Path(environment[PROFILES]) == share_path("params/fastdds.xml")
    own = {DISCOVERY: "SUBNET", PROFILES: "/own.xml"}
    assert own.items() <= ros_environment(bare() | own).items()


def test_profile_reserves_64_mib():
    assert f"<segment_size>{64 * 1024**2}</segment_size>" in share_path("params/fastdds.xml").read_text()


def test_missing_share_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"params/none\.xml"):
        share_path("params/none.xml")


@pytest.mark.skipif(not WHEELS, reason="a native ROS has its libraries where the loader looks")
def test_environment_of_another_installation_is_put_right():
    """Its mark says that the restart is done, but with the other's directories."""
    other = bare() | {GUARD: "1", LIBRARIES: "/elsewhere/lib"}
    paths = ros_environment(other)[LIBRARIES].split(os.pathsep)
    assert paths[0] == str(Path(sys.prefix) / "lib") and paths[-1] == "/elsewhere/lib"
    code = """
        import os, sys
        print("start", sys.argv[1:])
        sys.stdout.flush()
        from hmap.environment import prepare_process
        prepare_process()
        import rclpy, hmap_msgs.msg
        rclpy.init(); rclpy.create_node("n").destroy_node(); rclpy.shutdown()
        print("ready", os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"])
    """
    assert run(code, other).split() == ["start", "[]", "start", "[]", "ready", "LOCALHOST"]


@pytest.mark.skipif(not WHEELS, reason="a native ROS has its libraries where the loader looks")
def test_process_with_the_environment_is_not_restarted():
    code = 'print("start"); from hmap.environment import prepare_process; prepare_process(); print("ready")'
    assert run(code, ros_environment(bare())).split() == ["start", "ready"]
