"""A view of hmap's bags for Rerun (https://rerun.io): ``python rerun_view.py bag/bag.mcap``.

It needs ``pip install rerun-sdk mcap`` (tried with rerun-sdk 0.41).
"""

import struct
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from rerun.urdf import UrdfTree

SPATIAL = ("/points", "/tf", "/tf_static", "/markers", "/scene_markers", "/planned_path")
JOINTS = "/joint_states"
STATUS = "/planner_status"
ROBOT = "robot_description"  # at the end of a topic


def blueprint(robots: Iterable[str] = ()) -> rrb.Blueprint:
    """The scene with robots at the left, joints and the planner's status at the right."""
    shown = [f"{path}/**" for path in (*SPATIAL, *(f"/{robot}" for robot in robots))]
    scene = rrb.Spatial3DView(name="Scene", origin="/", contents=shown)
    joints = rrb.TimeSeriesView(name="Joints", origin=JOINTS)
    status = rrb.DataframeView(name="Planner", origin=STATUS)
    return rrb.Blueprint(rrb.Horizontal(scene, rrb.Vertical(joints, status), column_shares=[2, 1]))


def descriptions(file: str) -> dict[str, str]:
    """Robot -> its URDF, of a bag."""
    found = {}
    with open(file, "rb") as bag:
        for _, channel, message in make_reader(bag).iter_messages():
            space, _, name = channel.topic.rpartition("/")
            if name == ROBOT:
                (length,) = struct.unpack_from("<I", message.data, 4)  # a string after the header of CDR
                found[space.rpartition("/")[2]] = message.data[8 : 8 + length - 1].decode()
    return found


def log_robots(urdfs: dict[str, str]) -> None:
    """Log the shapes of robots.

    On ``/tf``, the frame of a link is called ``<robot>/<link>``, as several robots may have the same links. All joints
    are there, so those of the URDF are left out.
    """
    for robot, text in urdfs.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{robot}.urdf"
            path.write_text(text)
            tree = UrdfTree.from_file_path(path, entity_path_prefix=robot, frame_prefix=f"{robot}/")
            rr.send_chunks(tree.stream(include_joint_transforms=False))


def main() -> int:
    """Open the bag named on the command line; its exit code."""
    if len(sys.argv) != 2:
        print("usage: python rerun_view.py FILE.mcap", file=sys.stderr)
        return 2
    rr.init("hmap", spawn=True)
    urdfs = descriptions(sys.argv[1])
    rr.send_blueprint(blueprint(urdfs))
    log_robots(urdfs)
    rr.log_file_from_path(sys.argv[1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
