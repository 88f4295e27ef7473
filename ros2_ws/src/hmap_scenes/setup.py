from setuptools import find_packages, setup

PACKAGE = "hmap_scenes"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Robots, objects and tasks of hmap, as data.",
    author="The hmap authors",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["**/*.yaml", "**/*.json", "**/*.urdf", "**/*.obj", "**/*.stl", "**/*.dae"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
)
