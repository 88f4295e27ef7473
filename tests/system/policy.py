"""Reads the SROS2 policy of the nodes, and what nodes of a running graph offer and take, in the same terms."""

from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

from hmap.environment import share_path

INCLUDE = "{http://www.w3.org/2001/XInclude}include"
WAYS = ("publish", "subscribe", "reply", "request")
ACTION = {  # who -> what it does with the topics and services of an action
    "execute": {"reply": ("send_goal", "cancel_goal", "get_result"), "publish": ("feedback", "status")},
    "call": {"request": ("send_goal", "cancel_goal", "get_result"), "subscribe": ("feedback", "status")},
}
Endpoints = dict[str, set[str]]


def policy() -> dict[str, Endpoints]:
    """Enclave -> way -> patterns of whole names; those of all its profiles, as DDS checks them."""
    file = share_path("config/policy.xml")
    found = {}
    for enclave in ElementTree.parse(file).getroot().iter("enclave"):
        allowed = found[enclave.get("path")] = {way: set() for way in WAYS}
        for profile in enclave.iter("profile"):
            for rules in _rules(profile, file.parent):
                _add(allowed, rules, profile.get("node"))
    return found


def _rules(profile: ElementTree.Element, folder: Path) -> Iterator[ElementTree.Element]:
    for child in profile:
        if child.tag == INCLUDE:
            yield from ElementTree.parse(folder / child.get("href")).getroot()
        else:
            yield child


def _add(allowed: Endpoints, rules: ElementTree.Element, node: str) -> None:
    names = {_whole(entry.text, node) for entry in rules}
    for way, value in rules.attrib.items():
        assert value == "ALLOW"
        if rules.tag != "actions":
            allowed[way] |= names
            continue
        for part, ends in ACTION[way].items():
            allowed[part] |= {f"{name}/_action/{end}" for name in names for end in ends}


def _whole(name: str, node: str) -> str:
    if name.startswith("/"):
        return name
    return f"/{node}{name[1:]}" if name.startswith("~") else f"/{name}"


def endpoints(node, names: list[str]) -> Endpoints:
    """What some nodes do, by what the middleware tells a node of them."""
    lists = {
        "publish": node.get_publisher_names_and_types_by_node,
        "subscribe": node.get_subscriber_names_and_types_by_node,
        "reply": node.get_service_names_and_types_by_node,
        "request": node.get_client_names_and_types_by_node,
    }
    return {way: {topic for name in names for topic, _ in tell(name, "/")} for way, tell in lists.items()}


def not_allowed(allowed: Endpoints, done: Endpoints) -> list[str]:
    """What is done without being allowed."""
    return _unmatched(done, allowed, fnmatchcase)


def unused(allowed: Endpoints, done: Endpoints) -> list[str]:
    """What is allowed without being done."""
    return _unmatched(allowed, done, lambda pattern, name: fnmatchcase(name, pattern))


def _unmatched(these: Endpoints, those: Endpoints, fit: Callable[[str, str], bool]) -> list[str]:
    """The entries of one side that fit none of the other side."""
    return sorted(
        f"{way} {entry}"
        for way, entries in these.items()
        for entry in entries
        if not any(fit(entry, other) for other in those[way])
    )
