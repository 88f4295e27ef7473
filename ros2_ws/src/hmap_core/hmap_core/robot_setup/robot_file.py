"""Writes a first robot file, with each guess named as one."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hmap_core.robot_setup.guess import RobotGuess
from hmap_core.robot_setup.home import guess_home
from hmap_core.robot_setup.robot_text import draft_model, load_text, robot_text, with_loadable_gripper
from hmap_core.scenes import resources
from hmap_core.simulation.collision_pairs import ignored_pairs

SEED = 0
FOLDERS_UP = 2  # a URDF within so many folders above the robot file is named by a relative path
POINTING_HOME = "guess: free of collisions, the hand in front of the base, pointing down"
OTHER_HOME = "guess: the best of random configurations"


@dataclass(frozen=True)
class RobotText:
    """The text of a robot file, and the guess that it says; without the gripper where that could not be loaded."""

    text: str
    guess: RobotGuess


def robot_file(guess: RobotGuess, out: Path, samples: int) -> RobotText:
    """Writes the text of a robot file, and checks it by loading it.

    Args:
        guess: its content.
        out: the file that the text will be written to; the URDF is named relative to it.
        samples: configurations from which the ignored pairs of links are computed.

    Returns:
        The text and what it says.

    Raises:
        InputError: the guess cannot be loaded, for a reason that the message names.
    """
    guess = with_loadable_gripper(guess)
    model = draft_model(guess)
    pairs = ignored_pairs(model, samples, np.random.default_rng(SEED))
    home = guess_home(replace(model, ignored_collisions=tuple(pairs)), np.random.default_rng(SEED))
    note = POINTING_HOME if home.pointing_down else OTHER_HOME
    load_text(robot_text(guess, str(guess.file.resolve()), home.q, note, pairs, samples), out.stem)
    text = robot_text(guess, _urdf_name(guess.file, out), home.q, note, pairs, samples)
    return RobotText(text, replace(guess, notes=guess.notes | {"home": (note,)}))


def _urdf_name(urdf: Path, out: Path) -> str:
    """How the robot file names the URDF: by a known package, relative to the file if it is near, or by its path."""
    full, folder = urdf.resolve(), out.absolute().parent.resolve()
    known = resources.portable(full)
    if "://" in known:
        return known
    relative = Path(os.path.relpath(full, folder))
    return relative.as_posix() if relative.parts.count("..") <= FOLDERS_UP else str(full)
