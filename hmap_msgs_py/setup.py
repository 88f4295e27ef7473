from setuptools import find_packages, setup

PACKAGE = "hmap_msgs_py"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="hmap_msgs for Python: conversions between messages and numpy, and the definitions for reading bags.",
    author="The hmap authors",
    license="Apache-2.0",
    python_requires=">=3.11",
    install_requires=["numpy"],
    extras_require={"bags": ["rosbags"]},
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["definitions/**/*", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
)
