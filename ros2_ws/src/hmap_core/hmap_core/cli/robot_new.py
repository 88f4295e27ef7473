"""``hmap robot new URDF``: write a first robot file for a URDF."""

import argparse
from pathlib import Path

from hmap_core.cli.main import count
from hmap_core.cli.plan import check_writable
from hmap_core.cli.progress import ProgressLine
from hmap_core.exceptions import InputError

HELP = "write a first robot file for a URDF: arm, tip, gripper and home are guessed, and each guess is named"
SAMPLES = 10_000  # random configurations, as many as of `python -m hmap_core.simulation.collision_pairs`
SUFFIXES = (".yaml", ".yml")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap robot new``."""
    parser.add_argument("urdf", type=Path, metavar="URDF", help="a URDF or xacro file")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the robot file (NAME.yaml in this folder)")
    parser.add_argument("--tip", metavar="LINK", help="the link that carries the fingers or the tool, if guessed wrong")
    samples = f"random configurations from which pairs of links that never collide are computed ({SAMPLES})"
    parser.add_argument("--samples", type=count, default=SAMPLES, metavar="N", help=samples)
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap robot new``; its exit code.

    Raises:
        InputError: a file is missing, exists already or cannot be written, or the URDF cannot be used.
    """
    out = arguments.out or Path(f"{arguments.urdf.name.split('.')[0]}.yaml")
    if out.suffix not in SUFFIXES:
        raise InputError(f"{out}: a robot file ends with {' or '.join(SUFFIXES)}")
    check_writable(out)
    if out.exists() and not arguments.force:
        raise InputError(f"{out} exists; --force replaces it")
    if not arguments.urdf.is_file():
        raise InputError(f"{arguments.urdf}: no such file; a URDF or xacro file is needed")
    with ProgressLine() as line:
        line.show("reading", str(arguments.urdf))
        from hmap_core.robot_setup.guess import guess_robot  # slow to import, and not needed to refuse a path
        from hmap_core.robot_setup.robot_file import robot_file

        guess = guess_robot(arguments.urdf, arguments.tip)
        line.show("computing", f"which links never collide, from {arguments.samples} configurations")
        written = robot_file(guess, out, arguments.samples)
    try:
        out.write_text(written.text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error
    for key, notes in written.guess.notes.items():
        for note in notes:
            if note != "of the URDF":
                print(f"{key}: {note}")
    print(f"robot file      {out}")
    print(f"next            hmap robot check {out} --picture {out.stem}.png")
    return 0
