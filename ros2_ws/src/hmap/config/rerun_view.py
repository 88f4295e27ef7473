"""A view of hmap's bags for Rerun (https://rerun.io): ``python rerun_view.py bag/bag_0.mcap``, with ``rerun-sdk``."""

import sys

import rerun as rr
import rerun.blueprint as rrb

SPATIAL = ("/points", "/tf", "/tf_static", "/markers", "/scene_markers", "/planned_path")
JOINTS = "/joint_states"
STATUS = "/planner_status"


def blueprint() -> rrb.Blueprint:
    """The scene at the left, joints and the planner's status at the right."""
    scene = rrb.Spatial3DView(name="Scene", origin="/", contents=[f"{topic}/**" for topic in SPATIAL])
    joints = rrb.TimeSeriesView(name="Joints", origin=JOINTS)
    status = rrb.DataframeView(name="Planner", origin=STATUS)
    return rrb.Blueprint(rrb.Horizontal(scene, rrb.Vertical(joints, status), column_shares=[2, 1]))


def main() -> int:
    """Open the bag named on the command line; its exit code."""
    if len(sys.argv) != 2:
        print("usage: python rerun_view.py FILE.mcap", file=sys.stderr)
        return 2
    rr.init("hmap", spawn=True)
    rr.send_blueprint(blueprint())
    rr.log_file_from_path(sys.argv[1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
