"""Reads recorded bags for the page: what was measured, planned and done, over time."""

from pathlib import Path

from hmap.bags.reader import Bag, Message, open_bag
from hmap.conversions import clouds_in_world, plan_from_message, scene_from_message, state_from_message
from hmap_core.exceptions import HmapError, InputError
from hmap_core.types import Scene
from hmap_core.viewer.recording import Recording
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.times import seconds_from_message

TOPICS = ("scene", "world_state", "plan", "planner_status", "object_clouds")
BAG = "bag"  # the folder of the bag in that of a run
PERIOD = 0.04  # s between two states that are kept


def read_bag(path: Path) -> Recording:
    """Read the run of a bag, also of a damaged one; of several tasks in one bag, the last one.

    Args:
        path: a bag's folder, the folder of a run, or one MCAP file.

    Raises:
        InputError: there is no bag, or it has no ``scene`` and ``world_state``.
    """
    bag = open_bag(path / BAG if (path / BAG).is_dir() else path)
    wanted = [topic for topic in _topics(bag) if topic.rpartition("/")[2] in TOPICS]
    recording, problems = None, []
    for message in bag.messages(wanted):
        try:
            recording = _add(recording, path.name, message)
        except (HmapError, ConversionError) as error:
            problems.append(f"{message.topic}: {error}")
    problems += bag.problems
    noted = f"; {problems[0]}" if problems else ""
    if recording is None:
        raise InputError(f"{path}: nothing usable was recorded on `scene`{noted}")
    if not recording.times:
        raise InputError(f"{path}: nothing usable was recorded on `world_state`{noted}")
    return recording


def _topics(bag: Bag) -> list[str]:
    for _ in bag.raw():
        pass
    return list(bag.counts)


def _add(recording: Recording | None, name: str, message: Message) -> Recording | None:
    """The recording with a message added; a scene of another task begins a new one."""
    topic, data = message.topic.rpartition("/")[2], message.data
    if topic == "scene":
        scene = scene_from_message(data)
        if recording is None or not _same(recording.scene, scene):
            return Recording(name, scene)
        recording.scene = scene
    elif recording is None:
        return None
    elif topic == "world_state":
        stamp = seconds_from_message(data.header.stamp)
        recording.began = stamp if recording.began is None else recording.began
        if not recording.times or stamp - recording.began >= recording.duration + PERIOD:
            recording.add(stamp - recording.began, state_from_message(recording.scene, data))
    elif topic == "plan":
        plan = plan_from_message(data)
        recording.plans.append((recording.duration, plan))
        search = plan.stats.get("search")
        if isinstance(search, dict):
            recording.searches.append((recording.duration, search))
    elif topic == "object_clouds":
        recording.clouds.append((recording.duration, clouds_in_world(data)))
    else:
        recording.captions.append((recording.duration, f"{data.phase}: {data.text}"))
    return recording


def _same(one: Scene, other: Scene) -> bool:
    return (one.task, one.seed) == (other.task, other.seed)
