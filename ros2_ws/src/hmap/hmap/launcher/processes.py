"""Node processes: each has its own log, is restarted if it dies, and is ended with the others."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hmap.environment import LAUNCHER, ros_environment
from hmap.launcher.shared_memory import remove_dead_segments
from hmap.launcher.spares import Spare
from hmap_core.exceptions import Code, ExecutionError, InputError

RESPAWNABLE = ("perception", "waypoint_planner", "contact_proposer", "komo_optimiser")  # have no state of their own
OPTIONAL = ("recorder", "viewer")  # restarted, too; where that fails, the others go on without
# process -> its nodes, where it has several
COMPOSED = {"composed_planning": ("supervisor", "waypoint_planner", "contact_proposer", "komo_optimiser")}
RESPAWN_PATIENCE = 30.0  # s that the supervisor waits for a node that is started anew, on a busy machine
# their messages have stamps; the others save time
USES_SIM_TIME = ("perception", "supervisor", "recorder", "dynamic_obstacles")
# planning has priority over these if there are few processors
LOW_PRIORITY = ("world", "perception", "recorder", "dynamic_obstacles", "viewer")
NICE = 10  # niceness relative to the planning nodes
MAX_STARTS = 5  # of one node
WATCH_PERIOD = 0.2  # s
STOPPED_LIMIT = 2.0  # s; a node that a signal has stopped for longer is killed, as others take it for dead by then
END_TIMEOUT = 10.0  # s; time limit for the end of a node after SIGINT, and again after SIGTERM
NODE_ARGUMENTS = 3  # index of the first argument in a node's command line
STOPPED = "T"  # state of a process in /proc
LOG_TAIL = 15  # lines of a dead node's log that are shown


@dataclass
class NodeProcess:
    """A node of the graph.

    Attributes:
        name: of the node, or of a process with several.
        parameters: name -> value, in addition to use_sim_time. Those of a process with several nodes are for its
            supervisor, unless their name begins with that of a node, as in "komo_optimiser:warm_up".
        log: file of its output.
        files: with parameters.
        process: the running process.
        starts: number of starts.
        code: exit code of the last process; None while it runs.
        stopped: s of the steady clock since which a signal (SIGSTOP) keeps it from running; None while it runs.
    """

    name: str
    parameters: Mapping[str, object]
    log: Path
    files: Sequence[Path] = ()
    process: subprocess.Popen | Spare | None = None
    starts: int = 0
    code: int | None = None
    stopped: float | None = None

    def start(self, environment: Mapping[str, str], spare: Spare | None = None) -> None:
        """Start the node in a process group of its own, so that Ctrl-C reaches it only through the launcher.

        It does not get a session of its own: Linux first distributes the processors among sessions, and niceness has no
        effect between these.

        Args:
            environment: of a new process.
            spare: the process to use instead of a new one.
        """
        self.starts += 1
        self.code = self.stopped = None
        command = self.command()
        if spare is not None:
            spare.run(self.name, command[NODE_ARGUMENTS:], self.log)
            self.process = spare
        else:
            with self.log.open("ab") as log:
                self.process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    env=dict(environment),
                    process_group=0,
                )
        if self.name in LOW_PRIORITY:
            niceness = os.getpriority(os.PRIO_PROCESS, 0) + NICE
            os.setpriority(os.PRIO_PROCESS, self.process.pid, min(niceness, 19))

    def command(self) -> list[str]:
        """Its command line at this start."""
        prefix = "supervisor:" if self.name in COMPOSED else ""  # of parameters for one node of several
        parameters = {key if ":" in key else prefix + key: value for key, value in self.parameters.items()}
        parameters.setdefault(f"{prefix}use_sim_time", bool(prefix) or self.name in USES_SIM_TIME)
        if self.name == "recorder" and "path" in parameters:
            parameters["path"] = self.bag(self.starts)
        if self.name == "supervisor" or prefix:
            for name in ("service_patience", "state_patience"):
                parameters.setdefault(prefix + name, RESPAWN_PATIENCE)
        return node_command(self.name, assignments(parameters), self.files)

    def bag(self, start: int) -> Path:
        """The folder of the recorder's bag after a start, from 1: every start needs a new one."""
        path = Path(str(self.parameters["path"]))
        return path if start == 1 else path.with_name(f"{path.name}-{start}")

    def tail(self) -> str:
        """The end of its log."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-LOG_TAIL:])


def node_command(name: str, values: Sequence[str] = (), files: Sequence[Path] = ()) -> list[str]:
    """The command line of a node.

    Args:
        name: of the node.
        values: parameters as "name:=value"; they win over those of files.
        files: with parameters.
    """
    arguments = [word for file in files for word in ("--params-file", str(file))]
    arguments += [word for text in values for word in ("-p", text)]
    return [sys.executable, "-m", f"hmap.nodes.{name}", *(["--ros-args", *arguments] if arguments else [])]


def assignments(parameters: Mapping[str, object]) -> list[str]:
    """Parameters as "name:=value", the way ROS arguments have them."""
    texts = {key: str(value).lower() if isinstance(value, bool) else value for key, value in parameters.items()}
    return [f"{key}:={text}" for key, text in texts.items()]


@dataclass
class Graph:
    """The node processes of one run. It is a context manager; all nodes have ended at its exit."""

    folder: Path  # of the logs
    spares: list[Spare] = field(default_factory=list)  # for the nodes that are started first
    nodes: dict[str, NodeProcess] = field(default_factory=dict)
    _ending: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _failure: str = ""
    _notes: list[str] = field(default_factory=list)

    def __enter__(self) -> "Graph":
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_dead_segments()
        self._environment = ros_environment() | {LAUNCHER: str(os.getpid())}
        self._watcher = threading.Thread(target=self._watch, name="processes", daemon=True)
        self._watcher.start()
        return self

    def __exit__(self, *_) -> None:
        self.end()

    def start(self, name: str, parameters: Mapping[str, object] | None = None, files: Sequence[Path] = ()) -> None:
        """Start a node.

        Args:
            name: of the node.
            parameters: name -> value.
            files: with further parameters.
        """
        node = NodeProcess(name, parameters or {}, self.folder / f"{name}.log", files)
        with self._lock:
            self.nodes[name] = node
            node.start(self._environment, self.spares.pop() if self.spares else None)

    def check(self) -> None:
        """Check that all nodes run.

        Raises:
            ExecutionError: NODE_LOST; a node has died and is not restarted.
        """
        with self._lock:
            failure = self._failure
        if failure:
            raise ExecutionError(failure, Code.NODE_LOST)

    def news(self) -> list[str]:
        """What has happened to nodes without ending the run, each told once."""
        with self._lock:
            told, self._notes = self._notes, []
        return told

    def end(self) -> None:
        """End all nodes with SIGINT, then SIGTERM, then SIGKILL; the recorder last, to record the others' end."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._watcher.join()
        while self.spares:
            self.spares.pop().dismiss()
        late = [name for name in self.nodes if name == "recorder"]
        for names in ([name for name in self.nodes if name not in late], late):
            self._end([self.nodes[name] for name in names])
        remove_dead_segments()  # of those that were killed

    def expected(self) -> list[str]:
        """The nodes that run, or have to."""
        with self._lock:
            running = [name for name, node in self.nodes.items() if node.code is None]
        return [name for process in running for name in COMPOSED.get(process, (process,))]

    def bags(self) -> list[Path]:
        """The folders of the recorder's bags: one for each time that it was started."""
        node = self.nodes.get("recorder")
        return [] if node is None else [node.bag(start) for start in range(1, node.starts + 1)]

    def exit_codes(self) -> dict[str, int | None]:
        """Map each node to its exit code, None while it runs."""
        return {name: node.code for name, node in self.nodes.items()}

    def _end(self, nodes: list[NodeProcess]) -> None:
        for node in nodes:
            process = node.process
            # The others have taken it for dead. If it went on, it would wait for those that end at the same time; only
            # the recorder has something to write.
            if process is not None and node.name != "recorder" and _is_stopped(process.pid):
                _send(process, signal.SIGKILL)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            processes = [node.process for node in nodes if node.process is not None]
            running = [process for process in processes if process.poll() is None]
            for process in running:
                _send(process, number)
            until = time.monotonic() + END_TIMEOUT
            for process in running:
                try:
                    process.wait(max(0.0, until - time.monotonic()))
                except subprocess.TimeoutExpired:
                    continue
        for node in nodes:
            node.code = None if node.process is None else node.process.poll()

    def _watch(self) -> None:
        while not self._ending.wait(WATCH_PERIOD):
            with self._lock:
                for node in list(self.nodes.values()):
                    if node.code is None and node.process is not None:
                        node.code = node.process.poll()
                        if node.code is not None:
                            self._died(node)
                        else:
                            self._look_whether_stopped(node, node.process)

    def _look_whether_stopped(self, node: NodeProcess, process: subprocess.Popen | Spare) -> None:
        """Kill a node that a signal has stopped: it would neither work, nor end with the others."""
        if not _is_stopped(process.pid):
            node.stopped = None
        elif node.stopped is None:
            node.stopped = time.monotonic()
        elif time.monotonic() - node.stopped > STOPPED_LIMIT:
            node.stopped = None
            self._notes.append(f"the node {node.name} was stopped by a signal for {STOPPED_LIMIT:g} s; killed")
            _send(process, signal.SIGKILL)

    def _died(self, node: NodeProcess) -> None:
        ended = f"the node {node.name} ended with exit code {node.code}"
        if node.code != 2 and node.name in (*RESPAWNABLE, *OPTIONAL) and node.starts < MAX_STARTS:
            node.start(self._environment)
            self._notes.append(f"{ended}; started anew")
        elif node.name in OPTIONAL:
            self._notes.append(f"{ended}; the others go on without it; its log ends with:\n{node.tail()}")
        else:
            self._failure = f"{ended}; its log ends with:\n{node.tail()}"


def _send(process: subprocess.Popen | Spare, number: int) -> None:
    """Send a signal to a process and its children, also where a signal has stopped them."""
    try:
        os.killpg(process.pid, number)
        os.killpg(process.pid, signal.SIGCONT)
    except ProcessLookupError:
        pass


def _is_stopped(pid: int) -> bool:
    """Whether a signal keeps a process from running."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == STOPPED
    except OSError:  # it has ended
        return False


def output_folder(base: Path, task: str, seed: int) -> Path:
    """Make a new folder ``<task>-<seed>-<time>`` in ``base``.

    Raises:
        InputError: the folder cannot be made.
    """
    stamp = time.strftime("%Y%m%d-%H%M%S")
    name = f"{Path(task).with_suffix('').name if task.endswith(('.yaml', '.yml')) else task.replace('/', '_')}-{seed}"
    for extra in ("", *(f"-{k}" for k in range(2, 100))):
        folder = base / f"{name}-{stamp}{extra}"
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"{folder}: cannot be made: {error}") from error
    raise InputError(f"{base} holds too many runs of this second")
