"""Light commands import no heavy library: it would make them start slowly."""

import subprocess
import sys

import pytest

import hmap_core.scenes

NUMERICAL = {"numpy", "scipy", "numba", "casadi", "pydantic", "trimesh", "pybullet", "open3d", "matplotlib"}
LAZY = (hmap_core.scenes,)  # packages whose exported names are imported when they are used


def loaded(code: str, folder) -> set[str]:
    """The modules that a new process has imported after it has run the code."""
    script = f"{code}\nimport sys\nprint(*sys.modules, sep='\\n', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines())


@pytest.mark.parametrize("arguments", [["tasks"], ["--help"]])
def test_light_commands_import_no_numerical_library(arguments, tmp_path):
    code = f"from hmap_core.cli import main\ntry:\n    main({arguments})\nexcept SystemExit:\n    pass"
    assert loaded(code, tmp_path) & NUMERICAL == set()


@pytest.mark.parametrize("package", LAZY, ids=lambda package: package.__name__)
def test_every_lazy_name_is_found(package):
    for name in package.__all__:
        assert getattr(package, name).__name__ == name
    with pytest.raises(AttributeError, match="nothing"):
        package.nothing  # noqa: B018


UNUSED = {
    "matplotlib",
    "trimesh",
    "torch",
    "ompl",
    "open3d",
    "casadi",
    "pybullet",
    "scipy.optimize",
    "scipy.interpolate",
}


def test_planning_imports_no_library_that_it_seldom_uses(tmp_path):
    """Their contents: an import of some only makes a placeholder, see hmap_core.deferred."""
    code = "from hmap_core import plan_file, planner\nimport sys\nfrom hmap_core.deferred import Placeholder\n"
    code += "for name in [n for n, m in sys.modules.items() if isinstance(m, Placeholder)]:\n    del sys.modules[name]"
    assert loaded(code, tmp_path) & UNUSED == set()
