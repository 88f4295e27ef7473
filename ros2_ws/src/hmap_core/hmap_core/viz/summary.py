"""Summary of a plan for people."""

from statistics import median

from hmap_core.types import Plan, SegmentKind


def summary(plan: Plan) -> dict[str, str]:
    """Key figures of a plan.

    Returns:
        Name -> value with its unit, in display order.
    """
    stats = plan.stats
    kinds = [segment.kind for segment in plan.segments]
    contacts = sum(kind is not SegmentKind.TRANSIT for kind in kinds)
    lines = {
        "task": f"{plan.scene.task}, seed {plan.scene.seed}",
        "waypoints": str(stats.get("waypoints", len(plan.waypoints))),
        "contacts": str(stats.get("contacts", contacts)),
        "mode switches": str(stats.get("mode_switches", max(0, len(kinds) - 1))),
        "duration": f"{plan.trajectory.time[-1]:.1f} s",
    }
    if "planning_time_s" in stats:
        lines["planning time"] = f"{stats['planning_time_s']:.2f} s"
    if "notes" in stats:
        lines["notes"] = "; ".join(stats["notes"])
    replans = stats.get("obstacle_replans", [])
    if replans:
        lines["new plans"] = f"{len(replans)} because of obstacles"
        for name, key in (("to plan", "planning"), ("with the judge", "with_judge")):
            lines[name] = f"{_median(replans, f'{key}_s')}, cpu {_median(replans, f'{key}_cpu_s')} (median)"
    return lines


def _median(replans: list[dict], key: str) -> str:
    known = [replan[key] for replan in replans if replan[key] is not None]
    return f"{median(known):.2f} s" if known else "-"
