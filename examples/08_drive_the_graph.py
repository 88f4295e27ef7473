"""Drive the ROS 2 graph from Python, as nav2's BasicNavigator does for navigation: load, plan, execute, look."""

import tempfile
from pathlib import Path

from hmap.launcher.processes import Graph
from hmap.session import Session
from hmap_core.scenes import SceneBuilder

NODES = ("world", "perception", "supervisor", "waypoint_planner", "contact_proposer", "komo_optimiser")

scene = SceneBuilder("brick").add_robot("arm", "panda").add_box("table", [2, 2, 0.1], [0, 0, -0.05])
scene.add_box("brick", [0.05, 0.05, 0.08], [0.5, -0.2, 0.04], movable=True, mass=0.3)
scene.set_goal("brick", [0.5, 0.2, 0.04])

# `hmap up TASK --keep` or `ros2 launch hmap hmap.launch.py` start the nodes, too; then only the session is needed
with Graph(Path(tempfile.mkdtemp())) as graph, Session() as hmap:
    for name in NODES:
        graph.start(name)
    hmap.wait_until_ready(timeout=600.0, nodes=NODES)
    hmap.load_scene(scene.build(), timeout=120.0)

    hmap.plan(time_limit=300.0, on_feedback=lambda now: print(f"{now.phase}: {now.text}"))  # returns at once
    while not hmap.is_done(timeout=1.0):
        graph.check()
    plan = hmap.result().check().plan  # check() raises what went wrong, with its stage, code and reason
    print(f"planned: {len(plan.segments)} segments, {plan.trajectory.time[-1]:.1f} s")

    hmap.manipulate(object="brick", pose=[0.45, 0.1, 0.04, 0, 0, 0, 1], time_limit=300.0)  # plans and executes
    result = hmap.result()
    print("executed" if result.success else result.error, f"{1e3 * result.position_error:.1f} mm off")
    print("the brick is at", hmap.world_state().poses["brick"].round(3)[:3])

    hmap.manipulate(time_limit=300.0)
    hmap.cancel()  # stops planning, or the robots
    print(hmap.result().error)
