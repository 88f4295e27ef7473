from glob import glob

from setuptools import find_packages, setup

PACKAGE = "hmap"
NODES = (
    "world",
    "perception",
    "waypoint_planner",
    "contact_proposer",
    "komo_optimiser",
    "supervisor",
    "recorder",
    "dynamic_obstacles",
    "viewer",
    "composed_planning",
)
COMMANDS = ("bag", "cell", "compare", "doctor", "evaluate", "run", "up")

setup(
    name=PACKAGE,
    version="0.1.0",
    description="The ROS 2 nodes of hmap.",
    author="The hmap authors",
    license="Apache-2.0",
    python_requires=">=3.11",
    install_requires=["hmap_core", "hmap_msgs_py", "hmap_scenes", "numpy", "rosbags"],
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", glob("config/*.*")),
        (f"share/{PACKAGE}/params", glob("params/*")),
        (f"share/{PACKAGE}/launch", glob("launch/*.py")),
    ],
    entry_points={
        "console_scripts": [f"{node} = hmap.nodes.{node}:main" for node in NODES],
        # sub-commands of the command `hmap`
        "hmap.commands": [f"{name} = hmap.commands.{name}" for name in COMMANDS],
        "hmap.benchmarks": ["graph = hmap.commands.bench_graph"],
        # readers of bags for `hmap view`
        "hmap.recordings": ["mcap = hmap.recordings:read_bag"],
    },
    zip_safe=False,
)
