"""``hmap robot check FILE``: what is read of a robot, what is assumed, and whether it can be used."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.plan import check_writable

HELP = "say whether a robot file or a URDF can be used, what was assumed, and what the robot is"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap robot check``."""
    what = "a robot file (.yaml), a URDF, a xacro file, or the name of a robot that comes with hmap"
    parser.add_argument("file", metavar="FILE", help=what)
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw the robot at home, with its gripper open")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap robot check``; exit code 0 if the robot can be used."""
    if arguments.picture:
        check_writable(arguments.picture)
    from hmap_core.robot_setup.report import report  # slow to import, and not needed to refuse a path

    result = report(arguments.file)
    if arguments.picture and result.model is not None:
        from hmap_core.viz.robot_picture import render_robot  # slow to import, and seldom needed

        render_robot(result.model, arguments.picture)
    if arguments.json:
        print(json.dumps(result.to_dict()))
    else:
        _print(result)
        if arguments.picture and result.model is not None:
            print(f"picture         {arguments.picture}")
    return 0 if result.usable else 1


def _print(result) -> None:
    for finding in result.findings:
        print(f"{finding.severity}: {finding}")
    if result.findings:
        print()
    if result.joints:
        head = ("joint", "type", "role", "lower", "upper", "velocity", "effort")
        print_table([head, *((r.name, r.kind, r.role, *map(_number, (r.lower, r.upper, r.velocity, r.effort)))
                             for r in result.joints)], 3)  # fmt: skip
        print()
    if result.links:
        print_table(
            [("link", "shapes", "mass"), *((r.name, _shapes(r.shapes), _number(r.mass)) for r in result.links)], 2
        )
        print()
    if result.model is not None:
        _print_summary(result)
    errors = sum(finding.severity == "error" for finding in result.findings)
    warnings = len(result.findings) - errors
    counts = f"{errors} error{'' if errors == 1 else 's'}, {warnings} warning{'' if warnings == 1 else 's'}"
    print(f"{'can be used' if result.usable else 'cannot be used'}: {counts}")


def _print_summary(result) -> None:
    model, gripper = result.model, result.model.gripper
    summary = {
        "arm": f"{len(model.joint_names)} joints, reaches {result.reach:.2f} m",
        "mass": f"{sum(row.mass or 0.0 for row in result.links):.2f} kg",
        "payload": "not known" if model.payload is None else f"{model.payload:g} kg",
        "end effector": f"in link {model.end_effector_link}",
        "gripper": "none"
        if gripper is None
        else f"opens {1e3 * gripper.min_opening:.1f} to {1e3 * gripper.open_opening:.1f} mm, grips up to "
        f"{1e3 * gripper.max_opening:.1f} mm with {gripper.force:g} N by {' and '.join(gripper.finger_links)}",
    }
    for name, value in summary.items():
        print(f"{name:<16}{value}")


def print_table(rows: list[tuple[str, ...]], left: int) -> None:
    """Print rows in columns.

    Args:
        rows: all of the same length; the first is the head.
        left: number of columns that are aligned to the left; the others hold numbers.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        print("  ".join(cells).rstrip())


def _number(value: float | None) -> str:
    return "-" if value is None or abs(value) == float("inf") else f"{value:.4g}"


def _shapes(shapes: dict[str, int]) -> str:
    plural = {"box": "boxes", "mesh": "meshes"}
    named = (f"{n} {kind if n == 1 else plural.get(kind, f'{kind}s')}" for kind, n in shapes.items())
    return ", ".join(named) or "-"
