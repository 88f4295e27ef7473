"""Spare processes: forked from one that has imported what the nodes need, so that each node starts at once.

Seven nodes that import the same libraries take seven times as long as one. A fork of a process with threads is not
safe, so spares are forked before ROS is initialised, and wait until they are told which node to run.
"""

import gc
import json
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from hmap.environment import LAUNCHER
from hmap_core.command_line import leave_results

PRELOADED = ("supervisor", "perception", "waypoint_planner", "contact_proposer", "komo_optimiser")  # nodes
POLL = 0.02  # s
FAILED = 1  # exit code


class Spare:
    """A process that waits to become a node; then, what :class:`subprocess.Popen` is for the launcher.

    Attributes:
        pid: of the process.
        returncode: exit code as :class:`subprocess.Popen` has it, None as long as it is not known to have ended.
    """

    def __init__(self, pid: int, pipe: int):
        """
        Args:
            pid: of the process.
            pipe: file descriptor; what is written there is what it waits for.
        """
        self.pid, self._pipe = pid, pipe
        self.returncode: int | None = None

    def run(self, node: str, arguments: Sequence[str], log: Path) -> None:
        """Make it a node.

        Args:
            node: its name.
            arguments: of its command line.
            log: file to which it adds what it prints.
        """
        order = {"node": node, "arguments": list(arguments), "log": str(log.absolute())}
        with os.fdopen(self._pipe, "w") as pipe:
            json.dump(order, pipe)

    def dismiss(self) -> None:
        """End it; it is not needed."""
        os.close(self._pipe)
        self.wait()

    def poll(self) -> int | None:
        """Its exit code, None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = float("inf")) -> int:
        """Wait until it has ended.

        Args:
            timeout: s.

        Raises:
            subprocess.TimeoutExpired: it has not ended in that time.
        """
        until = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(POLL)
        return code


def fork_spares(count: int) -> list[Spare]:
    """Imports what the nodes need, and forks this process.

    Call it before a thread is started.

    Returns:
        The spares; none where this process has threads already, as a program may have that calls the command.
    """
    if threading.active_count() > 1:
        return []
    for name in PRELOADED:
        import_module(f"hmap.nodes.{name}")
    gc.freeze()  # the collector would write to memory that the processes share
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    spares: list[Spare] = []
    pipes: list[int] = []
    launcher = str(os.getpid())
    for _ in range(count):
        receiving, sending = os.pipe()
        pid = os.fork()
        if pid == 0:
            for pipe in (*pipes, sending):  # else it would keep the others waiting when the launcher is gone
                os.close(pipe)
            os.environ[LAUNCHER] = launcher
            _wait_for_order(receiving)
        os.close(receiving)
        pipes.append(sending)
        spares.append(Spare(pid, sending))
    return spares


def _wait_for_order(pipe: int) -> NoReturn:
    """What a spare does; it must not return into what its parent was doing."""
    code = FAILED
    try:
        # A process group of its own, as the launcher alone passes Ctrl-C on.
        os.setpgid(0, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        with os.fdopen(pipe) as orders:
            text = orders.read()
        code = _run_node(**json.loads(text)) if text else 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else FAILED
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _run_node(node: str, arguments: list[str], log: str) -> int:
    with open(os.devnull, "rb") as nothing, open(log, "ab") as output:
        for number, file in enumerate((nothing, output, output)):
            os.dup2(file.fileno(), number)
    leave_results()
    Path("/proc/self/comm").write_text(node)  # the name that `ps` and `top` show
    sys.argv = [node, *arguments]
    return import_module(f"hmap.nodes.{node}").main()
