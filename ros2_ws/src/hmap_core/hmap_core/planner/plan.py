"""The front door: plan a task with parts that are chosen by name or given as objects."""

from collections.abc import Mapping

import numpy as np

from hmap_core.compile_cache import ensure_compiled
from hmap_core.contacts.camera import Cloud
from hmap_core.deadline import DEFAULT_CPU_LIMIT, DEFAULT_TIME_LIMIT, within_cpu_time
from hmap_core.exceptions import InputError
from hmap_core.planner import plugins
from hmap_core.planner.components import PlannerComponents, local_components
from hmap_core.planner.hmap_planner import HmapPlanner
from hmap_core.planner.interfaces import Progress, ProgressCallback, ToolGrasp
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.planner.protocols import Cancel, ContactProposer, ManipulationPlanner, ObjectPathPlanner, TransitPlanner
from hmap_core.types import Plan, Scene, SceneState


def plan(
    scene: Scene,
    state: SceneState | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    *,
    planner: str | ManipulationPlanner = plugins.DEFAULT_PLANNER,
    object_path: str | ObjectPathPlanner | None = None,
    proposer: str | ContactProposer | None = None,
    transit: str | TransitPlanner | None = None,
    components: PlannerComponents | None = None,
    clouds: Mapping[str, Cloud] | None = None,
    tool_grasp: ToolGrasp | None = None,
    progress: ProgressCallback | None = None,
    cancel: Cancel | None = None,
) -> Plan:
    """Plan a task.

    Args:
        scene: the task.
        state: where everything is; None: where the scene starts.
        seed: the only source of randomness: the same seed gives the same plan.
        time_limit: seconds of wall-clock time; None: 60 s, of which H-MaP computes 10 s at most.
        planner: the method, by name (``hmap plugins`` lists them) or as an object.
        object_path: plans the path of the object, by name or as an object; None: hmap's own search.
        proposer: proposes contacts before they are sampled, by name or as an object; None: ``auto``, the learned one
            where it knows robots and task.
        transit: searches transits where the optimiser finds none, by name or as an object; None: hmap's own trees.
        components: all parts of H-MaP at once, instead of the three above.
        clouds: what cameras measured on each object, in its own frame.
        tool_grasp: the grasp on the tool that a robot holds at the start, if one does.
        progress: called whenever something new begins.
        cancel: asked between two steps; True stops the job.

    Raises:
        InputError: a name is unknown, or an option does not fit the method.
        HmapError: stage, code and reason of the failure; its attribute ``search`` has the search tree, if the method
            keeps one.
    """
    method = create_planner(planner, object_path, proposer, transit, components, clouds, tool_grasp)
    report = progress or (lambda progress: None)
    ensure_compiled(lambda text: report(Progress("starting", text=text)))
    given = time_limit is not None or not isinstance(method, HmapPlanner)
    limit = DEFAULT_TIME_LIMIT if time_limit is None else time_limit
    with within_cpu_time(np.inf if given else DEFAULT_CPU_LIMIT):
        return method.plan(scene, state, seed, limit, progress, cancel)


def create_planner(
    planner: str | ManipulationPlanner = plugins.DEFAULT_PLANNER,
    object_path: str | ObjectPathPlanner | None = None,
    proposer: str | ContactProposer | None = None,
    transit: str | TransitPlanner | None = None,
    components: PlannerComponents | None = None,
    clouds: Mapping[str, Cloud] | None = None,
    tool_grasp: ToolGrasp | None = None,
) -> ManipulationPlanner:
    """Create a method with its parts; the arguments are those of :func:`plan`.

    Raises:
        InputError: a name is unknown, or an option does not fit the method.
    """
    method = plugins.create(plugins.PLANNERS, planner) if isinstance(planner, str) else planner
    given = {
        "object_path": object_path,
        "proposer": proposer,
        "transit": transit,
        "components": components,
        "tool_grasp": tool_grasp,
    }
    if not isinstance(method, HmapPlanner):
        unfit = [name for name, value in given.items() if value is not None]
        if unfit:
            raise InputError(f"the planner {planner!r} has no option {', '.join(unfit)}; only 'hmap' has")
        return method
    if isinstance(planner, str) and ":" in planner and any(part is not None for part in given.values()):
        raise InputError(f"the planner {planner!r} names a contact proposer, so it has no further parts; give 'hmap'")
    if components is None and not object_path is proposer is transit is None:
        components = local_components(
            plugins.resolve(plugins.OBJECT_PATH_PLANNERS, object_path),
            plugins.resolve(plugins.CONTACT_PROPOSERS, proposer or plugins.DEFAULT_PROPOSER),
            segments=KomoSegmentPlanner(plugins.resolve(plugins.TRANSIT_PLANNERS, transit)),
        )
    return HmapPlanner(components or method.components, clouds or method.clouds, tool_grasp or method.tool_grasp)
