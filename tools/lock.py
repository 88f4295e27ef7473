"""Prints the packages that pip installed into this environment, pinned: the content of requirements.lock."""

from importlib.metadata import distributions

HEADER = "# Everything that requirements.txt needs, pinned. Made by `make lock`; do not edit."
UNPINNED = {"pip", "hmap-core", "hmap-scenes", "hmap-msgs-py", "hmap"}


def pins() -> list[str]:
    """Sorted ``name==version`` lines. What a ROS wheel lays beside itself is not pip's and has no index entry."""
    found = {}
    for distribution in distributions():
        if (distribution.read_text("INSTALLER") or "").strip() == "pip":
            found[distribution.metadata["Name"].lower().replace("_", "-")] = distribution.version
    return [f"{name}=={version}" for name, version in sorted(found.items()) if name not in UNPINNED]


if __name__ == "__main__":
    print("\n".join([HEADER, *pins()]))
