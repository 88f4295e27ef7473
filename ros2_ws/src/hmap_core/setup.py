from setuptools import find_packages, setup

PACKAGE = "hmap_core"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="The planner of hmap, free of ROS.",
    author="The hmap authors",
    license="Apache-2.0",
    python_requires=">=3.11",
    # Why each is there is said in requirements.txt, which also has the versions that are known to work.
    install_requires=[
        "casadi",
        "coacd",
        "coal",
        "hmap_scenes",
        "joblib",
        "matplotlib",
        "numba",
        "numpy",
        "ompl>=1.7,<2",
        "open3d-cpu",
        "pillow",
        "pybullet",
        "pycollada",
        "pydantic",
        "ruamel.yaml",
        "scipy",
        "trimesh",
        "viser>=1.1.1,<1.2",
    ],
    extras_require={
        "bench": ["robotic==0.4.2"],
        "dask": ["dask[distributed]"],
        # data sets, training, evaluation; this version of torch is a CPU build on the index that README names
        "learning": ["torch==2.13.0", "pyarrow", "lightgbm"],
        "mujoco": ["mujoco>=3.2,<4"],  # a second physics engine for executions
        "xacro": ["xacro"],
    },
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed", "baselines/*.yaml", "learning/*.toml", "learning/*.safetensors"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    entry_points={"console_scripts": ["hmap = hmap_core.cli:main"]},
    zip_safe=False,
)
