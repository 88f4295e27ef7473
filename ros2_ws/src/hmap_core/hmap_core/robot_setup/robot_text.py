"""Text of a robot file, with each guess named as one."""

import re
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.robot_setup.guess import RobotGuess
from hmap_core.scenes.robots import load_robot_model
from hmap_core.types import RobotModel

PAYLOAD_LINE = "# payload: 3.0  # kg that the arm may carry, see its data sheet; without it no weight is checked"
WIDTH = 118  # characters of a comment's line


def draft_model(guess: RobotGuess) -> RobotModel:
    """The robot model of a guess, before its home and the pairs of links that never collide are known.

    Raises:
        InputError: the guess cannot be loaded, for a reason that the message names.
    """
    try:
        return _draft(guess)
    except InputError as error:
        raise InputError(f"{guess.file}: {error.reason}", error.code) from error


def _draft(guess: RobotGuess) -> RobotModel:
    """As :func:`draft_model`; the reason of an error names no file."""
    home = np.clip(0.0, *guess.limits)
    return load_text(robot_text(guess, str(guess.file.resolve()), home), guess.file.stem)


def with_loadable_gripper(guess: RobotGuess) -> RobotGuess:
    """The guess; without its gripper, and with a note that says why, where the gripper cannot be loaded.

    Raises:
        InputError: the guess cannot be loaded without its gripper either.
    """
    try:
        _draft(guess)
        return guess
    except InputError as error:
        if guess.gripper is None:
            raise InputError(f"{guess.file}: {error.reason}", error.code) from error
        bare = replace(guess, gripper=None, notes=guess.notes | {"gripper": (f"left out: {error.reason}",)})
        draft_model(bare)
        return bare


def load_text(text: str, name: str) -> RobotModel:
    """The robot model in the text of a robot file, which names its URDF by its full path.

    Args:
        text: the text.
        name: of the robot model.

    Raises:
        InputError: as :func:`~hmap_core.scenes.robots.load_robot_model` and
            :func:`~hmap_core.kinematics.arm.load_arm`; the reason names no file.
    """
    with tempfile.TemporaryDirectory(prefix="hmap_robot_") as folder:
        path = Path(folder) / f"{name}.yaml"
        path.write_text(text, encoding="utf-8")
        try:
            model = load_robot_model(str(path))
            load_arm(model)
        except InputError as error:
            line_of_draft = re.compile(rf"{re.escape(str(path))}(:\d+)?: ")
            raise InputError(line_of_draft.sub("", error.reason), error.code) from error
    return model


def robot_text(
    guess: RobotGuess,
    urdf: str,
    home: np.ndarray,
    home_note: str = "",
    pairs: Mapping[tuple[str, str], str] | None = None,
    samples: int = 0,
) -> str:
    """The text of a robot file.

    Args:
        guess: its content.
        urdf: how the file names the URDF.
        home: (n,) home configuration, rad or m.
        home_note: how it was guessed.
        pairs: pairs of links that need no collision check -> reason.
        samples: number of configurations from which these were computed.

    Returns:
        The text.
    """
    lines = [
        f"# Written by `hmap robot new {guess.file.name}`. Check what is marked as a guess.",
        "schema: 1",
        f"description: {_quoted(guess.file.stem)}",
        f"urdf: {_quoted(urdf)}",
        "",
        *_comments(guess, "joints"),
        f"joints: {_names(guess.joint_names)}",
        "",
        *_comments(guess, "end_effector"),
        f"end_effector: {{link: {_quoted(guess.link)}, pose: {{xyz: {_numbers(guess.T_link_ee[:3])}, "
        f"quaternion: {_numbers(guess.T_link_ee[3:], 9)}}}}}",
        "",
        *_comment(home_note),
        f"home: {_numbers(home)}",
        "",
        *_comments(guess, "position_limits"),
        "position_limits:",
        f"  lower: {_numbers(guess.limits[0])}",
        f"  upper: {_numbers(guess.limits[1])}",
        *_comments(guess, "velocity_limits"),
        f"velocity_limits: {_numbers(guess.velocities)}",
        *_comments(guess, "acceleration_limits"),
        f"acceleration_limits: {_numbers(guess.accelerations)}",
        PAYLOAD_LINE,
    ]
    if "gripper" in guess.notes:
        lines += ["", *_comments(guess, "gripper")]
    if guess.gripper is not None:
        lines += ["gripper:", *(f"  {key}: {_value(value)}" for key, value in guess.gripper.entry().items())]
    if pairs:
        lines += ["", *_comment(
            f"Pairs of links that need no collision check, from {samples} random configurations: adjacent links, "
            "links that always overlap or never come near each other, and links of the gripper among themselves."
        ), "ignored_collisions:"]  # fmt: skip
        lines += [f"  - [{_quoted(a)}, {_quoted(b)}]  # {reason}" for (a, b), reason in pairs.items()]
    return "\n".join(lines) + "\n"


def _comments(guess: RobotGuess, key: str) -> list[str]:
    return [line for note in guess.notes.get(key, ()) for line in _comment(note)]


def _comment(text: str) -> list[str]:
    """Comment lines with a text, broken at spaces."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + 1 + len(word) <= WIDTH:
            lines[-1] += f" {word}"
        else:
            lines.append(f"# {word}")
    return lines


def _value(value: object) -> str:
    if isinstance(value, list):
        return _names(value) if value and isinstance(value[0], str) else _numbers(np.array(value))
    return _number(float(value)) if isinstance(value, int | float) else _quoted(str(value))


def _names(names: list[str]) -> str:
    return f"[{', '.join(map(_quoted, names))}]"


def _quoted(text: str) -> str:
    """A text as YAML writes it: in double quotes unless it is a plain word."""
    plain = text and all(c.isalnum() or c in "_-./:" for c in text) and text[0].isalpha() and ": " not in text
    if plain and text.lower() not in ("true", "false", "yes", "no", "on", "off", "null", "y", "n") and text[-1] != ":":
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _numbers(values: np.ndarray, digits: int = 6) -> str:
    return f"[{', '.join(_number(v, digits) for v in np.asarray(values, float))}]"


def _number(value: float, digits: int = 6) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".") if value else "0"
