"""The tree of what a search has tried, with the reason of every failure: for people who ask why there is no plan.

The tree of a plan is in ``Plan.stats["search"]``; that of a failure is in ``HmapError.search``. ``hmap plan --explain``
prints it, and the result of the action ``manipulate`` carries it among its statistics.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from hmap_core.exceptions import Code, HmapError
from hmap_core.planner.outcome import Outcome, Solution

MAX_NODES = 5000  # of one tree; later attempts are counted and not kept


@dataclass
class Attempt:
    """A node of the tree.

    Attributes:
        what: what was tried.
        stage, code, reason: the failure; empty where there is none.
        solved: whether it led to a solution.
        tried: what was tried for it, in order.
    """

    what: str
    stage: str = ""
    code: str = ""
    reason: str = ""
    solved: bool = False
    tried: list["Attempt"] = field(default_factory=list)

    def fail(self, stage: str, code: Code, reason: str) -> None:
        """Note the failure of this attempt."""
        self.stage, self.code, self.reason, self.solved = stage, code.name, reason, False

    def succeed(self, text: str = "") -> None:
        """Note that this attempt has led to a solution."""
        self.stage, self.code, self.reason, self.solved = "", "", text, True

    def close(self, outcome: Outcome) -> None:
        """Note the outcome of a strategy (:mod:`hmap_core.planner.outcome`)."""
        if isinstance(outcome, Solution):
            self.succeed()
        elif not self.tried:
            self.fail(outcome.stage, outcome.code, outcome.reason)

    def to_dict(self) -> dict[str, Any]:
        """The tree as plain data for JSON; empty fields are left out."""
        found: dict[str, Any] = {"what": self.what, "solved": self.solved}
        found |= {name: value for name in ("stage", "code", "reason") if (value := getattr(self, name))}
        if self.tried:
            found["tried"] = [attempt.to_dict() for attempt in self.tried]
        return found

    @staticmethod
    def from_dict(data: dict[str, Any]) -> "Attempt":
        """What :meth:`to_dict` wrote."""
        names = ("what", "stage", "code", "reason", "solved")
        fields = {name: data[name] for name in names if name in data}
        return Attempt(**fields, tried=[Attempt.from_dict(child) for child in data.get("tried", ())])

    def lines(self) -> Iterator[str]:
        """The tree as indented lines of text."""
        yield self._line()
        yield from self._below("")

    def _below(self, indent: str) -> Iterator[str]:
        for k, child in enumerate(self.tried):
            last = k == len(self.tried) - 1
            yield f"{indent}{'└─ ' if last else '├─ '}{child._line()}"
            yield from child._below(indent + ("   " if last else "│  "))

    def _line(self) -> str:
        if self.solved:
            return f"{self.what}: solved{f', {self.reason}' if self.reason else ''}"
        code = f"[{self.stage}/{self.code}] " if self.code else ""
        return f"{self.what}: {code}{self.reason}" if code or self.reason else self.what


class SearchTree:
    """Records attempts while a search runs.

    Attributes:
        root: the whole job.
    """

    def __init__(self, what: str):
        self.root = Attempt(what)
        self._open = [self.root]
        self._nodes = 1

    @contextmanager
    def attempt(self, what: str) -> Iterator[Attempt]:
        """Open a node below the present one; an HmapError that passes through becomes its failure."""
        node = Attempt(what)
        if self._nodes < MAX_NODES:
            self._open[-1].tried.append(node)
        self._nodes += 1
        self._open.append(node)
        try:
            yield node
        except HmapError as error:
            node.fail(error.stage, error.code, error.reason)
            raise
        finally:
            self._open.pop()

    def note(self, what: str, error: HmapError) -> None:
        """Add a failed attempt without children below the present node."""
        with self.attempt(what) as node:
            node.fail(error.stage, error.code, error.reason)
