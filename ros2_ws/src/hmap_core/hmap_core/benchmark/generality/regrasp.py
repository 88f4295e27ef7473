"""Families of tasks in which one grasp does not serve at both ends: the object is turned, or placed in between."""

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.everyday import two_spots
from hmap_core.benchmark.generality.family import solvable

CUP_WALL = 0.006  # m


def cup_right_way_up(cell: Cell, draw: Sampler) -> None:
    """Put a square cup the right way up that stands upside down, or lies on its side."""
    width, height = draw.uniform(0.056, 0.068), draw.uniform(0.1, 0.13)
    start, goal = two_spots(draw, 0.22, radius=(0.42, 0.56))
    upside_down = draw.choice((True, False))
    rpy = (180.0, 0.0, draw.angle()) if upside_down else (90.0, 0.0, draw.angle())
    at = {"xyz": [*start, round((height if upside_down else width) / 2, 5)], "rpy_deg": list(rpy)}
    cell.table().panda()
    cell.box("coaster", (0.1, 0.1, 0.02), goal)
    cell.add_body("cup", cup_parts(width, height), at, movable=True, mass=0.15, friction=0.8, color=ORANGE)
    cell.goal("cup", goal, round(0.02 + height / 2, 5), (0, 0, draw.angle()))


def cup_parts(width: float, height: float) -> list[dict]:
    """A square cup of a size in m that is open at the top: a bottom and four walls; the frame is in its middle."""
    side, inner = round((width - CUP_WALL) / 2, 5), round(width - 2 * CUP_WALL, 5)
    tall, z = round(height - CUP_WALL, 5), CUP_WALL / 2
    walls = [
        {"shape": "box", "size": [CUP_WALL, width, tall], "pose": {"xyz": [side, 0.0, z]}},
        {"shape": "box", "size": [CUP_WALL, width, tall], "pose": {"xyz": [-side, 0.0, z]}},
        {"shape": "box", "size": [inner, CUP_WALL, tall], "pose": {"xyz": [0.0, side, z]}},
        {"shape": "box", "size": [inner, CUP_WALL, tall], "pose": {"xyz": [0.0, -side, z]}},
    ]
    bottom = {"xyz": [0.0, 0.0, round((CUP_WALL - height) / 2, 5)]}
    return [{"shape": "box", "size": [width, width, CUP_WALL], "pose": bottom}, *walls]


def book_over_edge(cell: Cell, draw: Sampler) -> None:
    """Bring a flat book that can be gripped only where it sticks out over an edge to a narrow pedestal."""
    book = (draw.uniform(0.1, 0.12), draw.uniform(0.14, 0.16), draw.uniform(0.016, 0.026))
    top, higher, side = draw.uniform(0.16, 0.24), draw.uniform(0.05, 0.12), draw.side()
    start = (draw.uniform(0.46, 0.52), side * draw.uniform(-0.1, -0.02))
    goal = (draw.uniform(0.42, 0.47), side * 0.42)
    cell.table().panda()
    cell.box("slab", (0.4, 0.48, 0.04), (0.57, side * -0.04), top - 0.04, friction=0.5)
    cell.box("foot", (0.2, 0.2, top - 0.04), (0.6, side * -0.04))
    cell.box("pedestal", (book[0] - 0.04, book[1] - 0.04, top + higher), goal)
    mass, friction = draw.uniform(0.15, 0.3), draw.uniform(0.4, 0.6)
    cell.block("book", book, start, top, draw.angle(-8, 8), mass=mass, friction=friction, color=ORANGE)
    cell.goal("book", goal, top + higher + book[2] / 2, tolerance=0.015, degrees=8.0)


def out_of_low_room(cell: Cell, draw: Sampler) -> None:
    """Bring a block from below a roof, where only a level hand fits, into a well, where only a hand from above does."""
    size = (draw.uniform(0.042, 0.055), draw.uniform(0.042, 0.055), draw.uniform(0.09, 0.12))
    ground, side = draw.uniform(0.15, 0.22), draw.side()
    front, y = draw.uniform(0.5, 0.54), side * draw.uniform(0.1, 0.18)
    under = ground + size[2] + draw.uniform(0.03, 0.045)
    cell.table().panda()
    cell.box("platform", (0.44, 1.1, ground), (0.64, 0.0))
    cell.box("roof", (0.16, 0.34, 0.02), (front + 0.08, y), under)
    for name, edge in (("left", 0.16), ("right", -0.16)):
        cell.box(f"side_{name}", (0.16, 0.02, under - ground), (front + 0.08, y + edge), ground)
    cell.box("back", (0.02, 0.3, under - ground), (front + 0.15, y), ground)
    well = (draw.uniform(0.54, 0.58), -side * draw.uniform(0.14, 0.22))
    values = {"span_x": 0.18, "span_y": 0.18, "wall": 0.015, "top": size[2] + draw.uniform(0.0, 0.015)}
    cell.add_object("well", "tray", (*well, ground), values=values)
    at = (front + draw.uniform(0.03, 0.05), y + draw.uniform(-0.02, 0.02))
    cell.block("block", size, at, ground, mass=draw.uniform(0.1, 0.3), friction=0.8, color=ORANGE)
    cell.goal("block", well, ground + size[2] / 2, (0, 0, draw.choice((0, 90))))


def flip_block(cell: Cell, draw: Sampler) -> None:
    """Turn a cube or block by 90 or 180 degrees about a level axis."""
    width = draw.uniform(0.045, 0.06)
    turn = draw.choice((90, -90, 180))
    size = (width, draw.uniform(0.045, 0.06), width)
    start, goal = two_spots(draw, 0.15, radius=(0.42, 0.56), angle=(-40, 40))
    yaw = draw.angle()
    cell.table().panda()
    cell.block("cube", size, start, yaw=yaw, mass=draw.uniform(0.1, 0.25), friction=0.8, color=ORANGE)
    cell.goal("cube", goal, width / 2, (0, turn, draw.angle()))


FAMILIES = solvable(cup_right_way_up, book_over_edge, out_of_low_room, flip_block)
