"""``hmap bench generality``: families of tasks that are generated at random. ``docs/generality.md`` describes them."""
