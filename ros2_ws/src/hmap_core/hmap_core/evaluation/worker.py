"""The process that does trials one after another: ``python -m hmap_core.evaluation.worker``.

A line of JSON for each trial comes in at standard input, a line of JSON for its result goes out at standard output. It
ends with its input. What libraries print goes to standard error.
"""

import faulthandler
import json
import os
import sys


def main() -> int:
    faulthandler.enable()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    from hmap_core.evaluation.run import run_trial, warm_up  # after that: some libraries print when they are loaded
    from hmap_core.evaluation.trial import Trial

    warm: set[str] = set()
    for line in sys.stdin:
        trial = Trial(**json.loads(line))
        if trial.task not in warm:
            warm_up(trial)
            warm.add(trial.task)
        print(json.dumps(run_trial(trial).to_dict()), file=answers, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
