"""Standard output belongs to the results, and every command reports errors as one line."""

import subprocess
import sys

import pytest
from robot_fixtures import joint, link, robot, write_robot
from ruamel.yaml import YAML

NOISE = (
    "import ctypes, os\n"
    "from hmap_core.command_line import keep_for_results\n"
    "keep_for_results()\n"
    "keep_for_results()\n"
    "print('{')\n"
    "os.write(1, b'from a library\\n')\n"
    "ctypes.CDLL(None).printf(b'when the process ends\\n')\n"
    "print('}')\n"
)


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True)


def test_only_results_are_on_standard_output():
    done = run("-c", NOISE)
    assert done.returncode == 0 and done.stdout == "{\n}\n"
    assert "from a library" in done.stderr and "when the process ends" in done.stderr


FORK = (
    "import os, sys\n"
    "from hmap_core.command_line import keep_for_results, leave_results\n"
    "keep_for_results()\n"
    "if os.fork() == 0:\n"
    "    os.dup2(os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT), 1)\n"
    "    leave_results()\n"
    "    print('a node')\n"
    "    os.write(1, b'')\n"
    "else:\n"
    "    os.wait()\n"
    "    print('{}')\n"
)


def test_a_forked_process_leaves_standard_output_to_the_results(tmp_path):
    done = run("-c", FORK, str(tmp_path / "log"))
    assert done.returncode == 0 and done.stdout == "{}\n"
    assert (tmp_path / "log").read_text() == "a node\n"


COMMANDS = (
    "import os, sys, types\n"
    "from importlib import import_module\n"
    "main = import_module('hmap_core.cli.main')\n"
    "module = types.ModuleType('loud')\n"
    "module.HELP, module.add_arguments = 'prints', lambda parser: None\n"
    "module.run = lambda arguments: (os.write(1, b'from a library'), print('{}'), 0)[-1]\n"
    "sys.modules['loud'] = module\n"
    "main._module_names = lambda: {'loud': 'loud'}\n"
    "sys.exit(main.main(['loud']))\n"
)


def test_commands_of_other_packages_have_it_for_their_results():
    done = run("-c", COMMANDS)
    assert done.returncode == 0 and done.stdout == "{}\n" and "from a library" in done.stderr


def test_pairs_are_yaml_whatever_the_simulation_prints(tmp_path):
    """PyBullet warns of what it does not know, and of links without inertia, on standard output."""
    text = robot(link("frame", "", mass=0), joint("mount", "tip", "frame", "floating"))
    done = run("-m", "hmap_core.simulation.collision_pairs", str(write_robot(tmp_path, text)), "--samples", "5")
    assert done.returncode == 0
    pairs = YAML(typ="safe").load(done.stdout)["ignored_collisions"]
    assert ["base", "upper"] in pairs and ["upper", "tip"] in pairs


@pytest.mark.parametrize(
    ("module", "arguments", "says"),
    [
        ("hmap_core.simulation.collision_pairs", ["{robot}"], "the joints 'elbow', 'j', 'shoulder' form a loop"),
        ("hmap_core.simulation.collision_pairs", ["none"], "unknown robot model 'none'"),
        ("hmap_core.simulation.collision_pairs", ["panda", "--samples", "0"], "samples must be 1 or larger"),
        ("hmap_core.scenes.decompose", ["none.stl"], "mesh 'none.stl'"),
    ],
)
def test_bad_input_is_one_line_and_a_code(tmp_path, module, arguments, says):
    file = write_robot(tmp_path, robot(joint("j", "tip", "base", "fixed")))
    done = run("-m", module, *(argument.format(robot=file) for argument in arguments))
    assert done.returncode == 2 and done.stdout == ""
    (line,) = [text for text in done.stderr.splitlines() if "[input/" in text]
    assert says in line and line.startswith(f"{module.split('.')[-1]}: [input/") and "Traceback" not in done.stderr
