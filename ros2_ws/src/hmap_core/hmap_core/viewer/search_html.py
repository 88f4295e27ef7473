"""The state of Algorithm 1 as a tree in HTML: waypoints, tries at each, and why a try failed."""

from collections.abc import Mapping
from html import escape
from typing import Any

STYLE = "font-size: 12px; line-height: 1.35; max-height: 340px; overflow: auto; padding: 4px 8px;"
INDENT = "border-left: 1px solid #ccc; padding-left: 10px;"
GREEN, RED = "#1a9e40", "#c02020"
MOST = 800  # entries; a page with more is slow


def search_html(search: Mapping[str, Any] | None) -> str:
    """A search tree (:meth:`hmap_core.planner.search_tree.Attempt.to_dict`) as HTML; what has failed is open.

    Args:
        search: the tree; None where there is none.
    """
    if not search:
        return f'<div style="{STYLE}">no search yet</div>'
    left = [MOST]
    text = _entry(search, left, 0)
    more = "" if left[0] > 0 else f"<div>more than {MOST} attempts: `hmap plan --explain` prints all</div>"
    return f'<div style="{STYLE}" class="hmap-search">{text}{more}</div>'


def _entry(attempt: Mapping[str, Any], left: list[int], depth: int) -> str:
    left[0] -= 1
    if left[0] <= 0:
        return ""
    tried = attempt.get("tried", ())
    code, reason = attempt.get("code", ""), str(attempt.get("reason", ""))
    solved = bool(attempt.get("solved")) or (bool(tried) and _has_solution(attempt))
    mark = f'<span style="color:{GREEN}">&#10003;</span>' if solved else ""
    if code:
        mark = f'<span style="color:{RED}">&#10007;</span>'
        reason = f"[{attempt.get('stage', '')}/{code}] {reason}"
    why = f' <span style="color:{RED if code else "#666"}">{escape(reason)}</span>' if reason else ""
    line = f"{mark} {escape(str(attempt.get('what', '')))}{why}"
    if not tried:
        return f"<div>{line}</div>"
    inside = "".join(_entry(child, left, depth + 1) for child in tried)
    is_open = " open" if depth < 6 else ""
    return f'<details{is_open}><summary>{line}</summary><div style="{INDENT}">{inside}</div></details>'


def _has_solution(attempt: Mapping[str, Any]) -> bool:
    """Whether the last thing that was tried led to a solution."""
    tried = attempt.get("tried", ())
    return bool(attempt.get("solved")) if not tried else _has_solution(tried[-1])


def live_search(steps: list[tuple[int, int, int, str]], phase: str) -> dict[str, Any]:
    """A tree of what was told of a search while it runs.

    Args:
        steps: number of the waypoint, number of waypoints, number of the try, text; in the order in which they came.
        phase: the present phase.
    """
    root: dict[str, Any] = {"what": phase, "tried": []}
    last: dict[str, Any] | None = None
    for i, count, attempt, text in steps:
        what = f"waypoint at pose {i} of {count}" if count else "path of the object"
        if last is None or last["what"] != what:
            last = {"what": what, "tried": []}
            root["tried"].append(last)
        last["tried"].append({"what": f"try {attempt}: {text}" if attempt else text})
    return root
