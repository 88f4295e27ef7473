"""The process that runs trials one after another: ``python -m hmap_core.evaluation.worker``.

It reads one line of JSON for each trial from standard input and writes one line of JSON for each result to standard
output. It ends when its input ends, and with the process that started it, in the middle of a trial as well. Output of
libraries goes to standard error.
"""

import faulthandler
import json
import os
import select
import sys
import threading

from hmap_core.command_line import keep_for_results


def end_with_parent() -> None:
    """From now on, end this process as soon as the one that started it has ended."""
    parent = os.pidfd_open(os.getppid())

    def wait() -> None:
        select.select([parent], [], [])
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()


def main() -> int:
    """Runs trials until standard input ends; returns exit code 0."""
    faulthandler.enable()
    end_with_parent()
    keep_for_results()
    from hmap_core.evaluation.run import run_trial, warm_up  # after the redirection: some libraries print on import
    from hmap_core.evaluation.trial import Trial

    warm: set[tuple[str, str, str]] = set()
    for line in sys.stdin:
        trial = Trial(**json.loads(line))
        begun = trial.warm_up or trial.task, trial.planner, trial.proposer
        if begun not in warm:
            warm_up(trial)
            warm.add(begun)
        print(json.dumps(run_trial(trial).to_dict()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
