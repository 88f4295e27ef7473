"""The results as a table, as JSON, and as a plot."""

from pathlib import Path

from hmap_core.benchmark.measure import Result, Tally

# of a result: the solver's name there, in the plot, and its colour
SIDES = (
    ("hmap", "hmap", "tab:blue"),
    ("rai", "RAI (robotic 0.4.2)", "tab:orange"),
    ("ompl", "OMPL 1.7.0", "tab:green"),
)
COLUMNS = ("median", "p90", "verified", "false")


def to_dict(results: dict[str, Result]) -> dict:
    """The document that ``hmap bench komo --json`` writes; CPU times in milliseconds."""
    return {"problems": {name: result.to_dict() for name, result in results.items()}}


def heading() -> list[str]:
    """The first lines of the table."""
    side = "".join(f"{column:>9}" for column in COLUMNS)
    return [
        f"{'':<20}{'':>4}  {'hmap':>20}{'':16}  {'RAI':>20}",
        f"{'problem':<20}{'n':>4}  {side}  {side}{'ratio':>8}",
    ]


def row(name: str, result: Result) -> str:
    """One line of the table: times in ms, counts, and RAI's median relative to hmap's; a second line for OMPL's."""
    hmap = f"{result.n:>4}  {_cells(result.hmap)}"
    lines = [f"{name:<20}{hmap}  {_cells(result.rai)}{result.ratio:>8.1f}"]
    if result.ompl is not None:
        lines.append(f"{'  with OMPL for RAI':<20}{hmap}  {_cells(result.ompl)}{result.ompl_ratio:>8.1f}")
    return "\n".join(lines)


def _cells(tally: Tally) -> str:
    values = tally.to_dict()
    times = "".join(f"{values[key]:>9.2f}" for key in ("median_ms", "p90_ms"))
    return times + "".join(f"{values[key]:>9}" for key in ("verified", "false_accepts"))


def plot(results: dict[str, Result], file: Path) -> None:
    """Plot all times by problem, on a logarithmic axis, into a file."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9.0, 1.0 + 0.6 * len(results)), layout="constrained")
    for k, (side, label, color) in enumerate(SIDES):
        tallies = {i: getattr(result, side) for i, result in enumerate(results.values())}
        times = {i + 0.25 * k: tally.milliseconds for i, tally in tallies.items() if tally is not None}
        if not times:
            continue
        axes.boxplot(
            list(times.values()), positions=list(times), orientation="horizontal", widths=0.2, whis=(10, 90),
            showfliers=False, patch_artist=True, boxprops={"facecolor": color}, medianprops={"color": "black"},
            label=label,
        )  # fmt: skip
    axes.set(xscale="log", xlabel="processor time, ms (box: quartiles, whiskers: 10 and 90 %)")
    axes.set_yticks([i + 0.25 for i in range(len(results))], list(results))
    axes.invert_yaxis()
    axes.grid(axis="x", alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=150)
    pyplot.close(figure)
