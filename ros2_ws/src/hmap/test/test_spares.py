"""Spare processes become nodes, or end; each test forks from a process of its own."""

import subprocess
import sys
from textwrap import dedent

HEAD = """
    import sys, types
    from pathlib import Path
    from hmap.launcher import spares

    spares.PRELOADED = ()

    def node(main):
        module = types.ModuleType('hmap.nodes.fake')
        module.main = main
        sys.modules['hmap.nodes.fake'] = module

    def says():
        print('I am', *sys.argv)
        return 3
"""


def run(tmp_path, code: str, timeout: float = 60.0) -> str:
    """What a new process prints."""
    script = dedent(HEAD) + dedent(code)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=timeout, check=True
    )
    assert not done.stderr
    return done.stdout


def test_a_spare_becomes_a_node(tmp_path):
    code = """
        node(says)
        print('before', end=' ')
        first, second = spares.fork_spares(2)
        first.run('fake', ['--ros-args', '-p', 'x:=1'], Path('log'))
        print(first.wait(), second.poll())
        second.dismiss()
        print(second.poll())
    """
    assert run(tmp_path, code) == "before 3 None\n0\n"
    assert (tmp_path / "log").read_text() == "I am fake --ros-args -p x:=1\n"


def test_what_a_node_prints_is_in_its_log_where_the_launcher_keeps_its_output_for_results(tmp_path):
    code = """
        import os
        from hmap_core.command_line import keep_for_results

        def loud():
            os.write(1, b'a library\\n')
            return says()

        node(loud)
        os.dup2(os.open('noise', os.O_WRONLY | os.O_CREAT), 2)
        keep_for_results()
        (spare,) = spares.fork_spares(1)
        spare.run('fake', [], Path('log'))
        print(spare.wait())
    """
    assert run(tmp_path, code) == "3\n"
    assert (tmp_path / "log").read_text() == "a library\nI am fake\n" and not (tmp_path / "noise").read_text()


def test_an_error_is_in_the_log(tmp_path):
    code = """
        node(lambda: 1 / 0)
        (spare,) = spares.fork_spares(1)
        spare.run('fake', [], Path('log'))
        print(spare.wait())
    """
    assert run(tmp_path, code) == "1\n"
    assert "ZeroDivisionError" in (tmp_path / "log").read_text()


def test_a_signal_ends_it(tmp_path):
    code = """
        import os, signal, subprocess, time
        node(lambda: time.sleep(60))
        waiting, running = spares.fork_spares(2)
        running.run('fake', [], Path('log'))
        try:
            running.wait(0.2)
        except subprocess.TimeoutExpired:
            print('runs')
        for spare in (waiting, running):
            os.killpg(spare.pid, signal.SIGTERM)
            print(spare.wait())
    """
    assert run(tmp_path, code) == "runs\n-15\n-15\n"


def test_spares_end_with_their_parent(tmp_path):
    code = """
        import os
        spares.fork_spares(3)
        os._exit(0)  # closes the pipes, as a kill would
    """
    # the spares have inherited standard output: that it is closed shows that all have ended
    assert run(tmp_path, code) == ""


def test_a_process_with_threads_is_not_forked(tmp_path):
    code = """
        import threading
        release = threading.Event()
        threading.Thread(target=release.wait).start()
        print(spares.fork_spares(1))
        release.set()
    """
    assert run(tmp_path, code) == "[]\n"
