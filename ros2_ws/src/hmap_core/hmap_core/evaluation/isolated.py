"""A trial in a process of its own kind: when it crashes or hangs, only this trial is lost, and its result says so."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict

from hmap_core.evaluation.trial import Trial, TrialResult

COMMAND = (sys.executable, "-m", "hmap_core.evaluation.worker")
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
TOLD = 300  # characters of the last line on standard error that a result repeats


class Worker:
    """A process with one thread that does trials one after another, and is started anew when it was lost."""

    def __init__(self, command: Sequence[str] = COMMAND):
        """
        Args:
            command: what to start; see :mod:`hmap_core.evaluation.worker` for what it has to do.
        """
        self.command = tuple(command)
        self._process: subprocess.Popen | None = None
        self._errors = tempfile.TemporaryFile()

    def run(self, trial: Trial, limit: float) -> TrialResult:
        """Do a trial; after ``limit`` seconds of wall-clock time it is ended."""
        if self._process is None:
            self._start()
        process = self._process
        try:
            process.stdin.write(json.dumps(asdict(trial)).encode() + b"\n")
            process.stdin.flush()
        except BrokenPipeError:
            return self._lost(trial)
        if not select.select([process.stdout], [], [], limit)[0]:
            self.close()
            return TrialResult(trial.seed, reason=f"ended after {limit:g} s without a result")
        answer = process.stdout.readline()
        if not answer.endswith(b"\n"):
            return self._lost(trial)
        return TrialResult(**json.loads(answer))

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _start(self) -> None:
        self._errors.seek(0)
        self._errors.truncate()
        self._process = subprocess.Popen(
            self.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=os.environ | {name: "1" for name in ONE_THREAD},
        )

    def _lost(self, trial: Trial) -> TrialResult:
        process, self._process = self._process, None
        process.communicate()
        code = process.returncode
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        self._errors.seek(0)
        lines = [line for line in self._errors.read().decode(errors="replace").splitlines() if line.strip()]
        fatal = [line for line in lines if line.startswith("Fatal Python error")] or lines
        last = f": {fatal[-1].strip()[:TOLD]}" if fatal else ""
        return TrialResult(trial.seed, reason=f"the process of the trial ended with {how}{last}")


_workers = threading.local()  # each thread has its own


def run_isolated(trial: Trial, limit: float, command: Sequence[str] = COMMAND) -> TrialResult:
    """Do a trial in this thread's worker process, which stays for the next one and ends with this process."""
    worker = getattr(_workers, "worker", None)
    if worker is None or worker.command != tuple(command):
        if worker is not None:
            worker.close()
        worker = _workers.worker = Worker(command)
    return worker.run(trial, limit)
