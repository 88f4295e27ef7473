"""Deferred modules: nothing of them runs before they are used, and then they are as if they had been imported."""

import subprocess
import sys
from textwrap import dedent

import pytest

PACKAGE = {
    "slow/__init__.py": "print('slow')\nfrom slow.inner import value\nimport slow.other\n",
    "slow/inner.py": "print('inner')\nvalue = 1\n",
    "slow/other.py": "print('other')\n",
    "slow/extra.py": "print('extra')\nimport slow\nnumber = slow.value + 1\n",
    "broken.py": "raise ValueError('broken')\n",
}


def run(tmp_path, code: str) -> list[str]:
    """What a new process prints that runs the code with ``slow`` and ``broken`` deferred."""
    for name, text in PACKAGE.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    head = "from hmap_core.deferred import defer_imports\ndefer_imports(('slow', 'broken', 'missing'))\n"
    done = subprocess.run([sys.executable, "-c", head + dedent(code)], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_an_import_runs_nothing(tmp_path):
    assert run(tmp_path, "import slow\nprint('end')") == ["end"]


def test_the_first_access_loads_once(tmp_path):
    code = """
        import slow
        print('start', slow.value)
        import slow as again
        print(again.value, slow.value, again is not None)
    """
    assert run(tmp_path, code) == ["slow", "inner", "other", "start", "1", "1", "1", "True"]


@pytest.mark.parametrize("code", ["from slow import value", "import slow.inner", "from slow import inner"])
def test_importing_something_from_it_loads_it_once(tmp_path, code):
    assert run(tmp_path, f"import slow\n{code}") == ["slow", "inner", "other"]
    assert run(tmp_path, code) == ["slow", "inner", "other"]


def test_a_module_inside_is_the_one_that_was_loaded(tmp_path):
    code = """
        import slow
        import slow.inner, sys
        assert slow.inner is sys.modules['slow.inner'] and slow.inner.__spec__.loader.get_filename('slow.inner')
        import slow.extra
        print(slow.extra.number)
    """
    assert run(tmp_path, code) == ["slow", "inner", "other", "extra", "2"]


def test_threads_load_it_once(tmp_path):
    code = """
        import slow, threading
        found = []
        threads = [threading.Thread(target=lambda: found.append(slow.value)) for _ in range(8)]
        [thread.start() for thread in threads]
        [thread.join() for thread in threads]
        print(*found)
    """
    assert run(tmp_path, code) == ["slow", "inner", "other", *"11111111"]


def test_a_missing_module_fails_at_its_import(tmp_path):
    code = """
        try:
            import missing
        except ImportError as error:
            print(error.name)
    """
    assert run(tmp_path, code) == ["missing"]


def test_an_error_in_it_comes_at_every_access(tmp_path):
    code = """
        import broken
        for _ in range(2):
            try:
                broken.x
            except ValueError as error:
                print(error)
    """
    assert run(tmp_path, code) == ["broken", "broken"]


def test_an_attribute_that_it_lacks(tmp_path):
    code = """
        import slow
        print(hasattr(slow, 'nothing'), 'value' in dir(slow))
    """
    assert run(tmp_path, code) == ["slow", "inner", "other", "False", "True"]
