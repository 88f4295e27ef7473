"""The paper's ablation: planning with learned contacts against sampling only, on the same tasks and seeds."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import HmapError
from hmap_core.learning.proposer import LearnedContacts
from hmap_core.planner import plan
from hmap_core.planner.components import PlannerComponents, local_components
from hmap_core.scenes import load_scene

SAMPLED, LEARNED = "sampled", "learned"
CONFIDENCE = 0.95
DRAWS = 2000
OnPair = Callable[[str, int], None]  # task, seed


@dataclass(frozen=True)
class Run:
    """One plan.

    Attributes:
        solved: whether the judge accepted a plan.
        cpu_s: processor time of planning with the judge, s.
        contact_s: of it, of searches for contacts, tools and holds, and of the model.
        checked: contacts that were checked in the searches that found some, until the first was feasible.
        learned: feasible contacts that the model proposed.
        duration_s: of the plan; 0 without one.
    """

    solved: bool
    cpu_s: float
    contact_s: float
    checked: int = 0
    learned: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True)
class Comparison:
    """The runs of one task, paired by seed."""

    task: str
    sampled: tuple[Run, ...]
    learned: tuple[Run, ...]

    def ratio(self, name: str, seed: int = 0) -> tuple[float, float, float]:
        """Learned to sampled, of the sums over all seeds, with a bootstrap interval over seeds: ratio, lower, upper."""
        above = np.array([getattr(run, name) for run in self.learned], float)
        below = np.array([getattr(run, name) for run in self.sampled], float)
        index = np.random.default_rng(seed).integers(0, len(above), (DRAWS, len(above)))
        drawn = above[index].sum(axis=1) / np.maximum(below[index].sum(axis=1), 1e-12)
        low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
        return float(above.sum() / max(below.sum(), 1e-12)), float(low), float(high)

    def to_dict(self) -> dict[str, Any]:
        """As plain JSON types, with the ratios."""
        ratios = {name: self.ratio(name) for name in ("cpu_s", "contact_s", "duration_s")}
        runs = {name: [asdict(run) for run in getattr(self, name)] for name in (SAMPLED, LEARNED)}
        return {"task": self.task, "ratios": ratios} | runs


class _Timed:
    """Passes calls on, and adds up their processor time; calls inside of others count once."""

    def __init__(self) -> None:
        self.seconds, self._depth = 0.0, 0

    def method(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, timed."""

        def timed(*arguments: Any, **options: Any) -> Any:
            began = time.process_time()
            self._depth += 1
            try:
                return call(*arguments, **options)
            finally:
                self._depth -= 1
                if self._depth == 0:
                    self.seconds += time.process_time() - began

        return timed

    def part(self, part: Any, *names: str) -> Any:
        """An object with some methods of a part, timed; the others are the part's own."""
        return _Part(part, {name: self.method(getattr(part, name)) for name in names})


class _Part:
    """A part of the planner with some methods replaced."""

    def __init__(self, part: Any, methods: dict[str, Callable[..., Any]]):
        self._part = part
        self.__dict__.update(methods)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._part, name)


def timed_components(weights: str | None) -> tuple[PlannerComponents, _Timed]:
    """The parts of the planner, sampling only or learned, and what times the search for contacts.

    Args:
        weights: a file, empty for the shipped ones; None: contacts are only sampled.
    """
    parts, timed = local_components(proposer=None if weights is None else LearnedContacts(weights)), _Timed()
    parts = replace(
        parts, contacts=timed.part(parts.contacts, "find_contacts"), tools=timed.part(parts.tools, "tool_grasps")
    )
    if parts.ranker is not None:
        parts = replace(parts, ranker=timed.part(parts.ranker, "hand_serves", "hold_serves"))
    return parts, timed


def run_once(task: str, seed: int, weights: str | None, time_limit: float) -> Run:
    """Plan a task once."""
    scene = load_scene(task, seed)
    parts, timed = timed_components(weights)
    began = time.process_time()
    try:
        found = plan(scene, seed=seed, time_limit=time_limit, components=parts)
    except HmapError:
        return Run(False, time.process_time() - began, timed.seconds)
    spent, stats = time.process_time() - began, found.stats
    end = float(found.trajectory.time[-1])
    return Run(True, spent, timed.seconds, stats["contacts_checked"], stats["learned_contacts"], end)


def compare(
    tasks: Sequence[str], seeds: Sequence[int], weights: str, time_limit: float, on_pair: OnPair | None = None
) -> list[Comparison]:
    """Compare both on tasks, in this process, one run after the other; which comes first alternates.

    Args:
        tasks: names or task files.
        seeds: of all tasks.
        weights: of the model; empty: the shipped ones.
        time_limit: s of wall-clock time for each plan.
        on_pair: called after each pair.
    """
    found = []
    for task in tasks:
        for each in (None, weights):
            run_once(task, seeds[0], each, time_limit)  # warm-up
        pairs = []
        for k, seed in enumerate(seeds):
            order = (None, weights) if k % 2 else (weights, None)
            runs = {each: run_once(task, seed, each, time_limit) for each in order}
            pairs.append((runs[None], runs[weights]))
            if on_pair:
                on_pair(task, seed)
        sampled, learned = zip(*pairs, strict=True)
        found.append(Comparison(task, sampled, learned))
    return found


def table(comparisons: Sequence[Comparison]) -> list[str]:
    """The comparisons as a Markdown table."""
    lines = [
        "| task | seeds | solved: sampled / learned | sampled, CPU s | planning time | contact search | duration |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for one in comparisons:
        solved = f"{sum(r.solved for r in one.sampled)} / {sum(r.solved for r in one.learned)}"
        mean = np.mean([run.cpu_s for run in one.sampled])
        cells = [one.task, str(len(one.sampled)), solved, f"{mean:.2f}"]
        cells += ["{:.2f} ({:.2f}-{:.2f})".format(*one.ratio(name)) for name in ("cpu_s", "contact_s", "duration_s")]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def figure(comparisons: Sequence[Comparison], path: Path) -> None:
    """Draw the paper's figure: planning time relative to sampling only, a bar a task, with intervals."""
    from matplotlib.figure import Figure  # slow to import

    drawing = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawing.add_subplot()
    for k, name in enumerate(("cpu_s", "contact_s")):
        ratios = np.array([one.ratio(name) for one in comparisons])
        places = np.arange(len(comparisons)) + 0.38 * (k - 0.5)
        error = np.abs(ratios[:, 1:].T - ratios[:, 0])
        label = "planning time" if name == "cpu_s" else "contact search"
        axes.bar(places, ratios[:, 0], 0.36, yerr=error, capsize=3, label=label)
    axes.axhline(1.0, color="0.4", linewidth=1)
    axes.set_xticks(np.arange(len(comparisons)), [one.task for one in comparisons], rotation=20)
    axes.set_ylabel("learned / sampling only")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    drawing.savefig(path, dpi=150)
