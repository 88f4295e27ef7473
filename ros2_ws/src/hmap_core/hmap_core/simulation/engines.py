"""The physics engines by name."""

from hmap_core.exceptions import InputError
from hmap_core.simulation.physics_world import PhysicsWorld
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import Scene

PYBULLET, MUJOCO = "pybullet", "mujoco"
ENGINES = (PYBULLET, MUJOCO)


def open_world(scene: Scene, engine: str = PYBULLET, actual: Scene | None = None) -> PhysicsWorld:
    """Puts a scene under dynamics.

    Args:
        scene: as robots and planner know it.
        engine: one of ENGINES.
        actual: as it is, with the same bodies and robots; None: as it is known.

    Returns:
        The world at its start, which has to be closed.

    Raises:
        InputError: there is no such engine, it is not installed, or it cannot simulate the scene.
    """
    if engine not in ENGINES:
        raise InputError(f"engine '{engine}' is not known; there are {', '.join(ENGINES)}")
    world: PhysicsWorld = SimulatedWorld(actual or scene) if engine == PYBULLET else _mujoco_world(actual or scene)
    world.scene = scene
    return world


def check_engine(engine: str) -> None:
    """Raises InputError where an engine is not known or not installed, before anything is planned."""
    if engine not in ENGINES:
        raise InputError(f"engine '{engine}' is not known; there are {', '.join(ENGINES)}")
    if engine == MUJOCO:
        _import_mujoco()


def _mujoco_world(scene: Scene) -> PhysicsWorld:
    _import_mujoco()
    from hmap_core.simulation.mujoco_world import MujocoWorld  # an optional extra

    return MujocoWorld(scene)


def _import_mujoco() -> None:
    try:
        import hmap_core.simulation.mujoco_world  # noqa: F401  an optional extra
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise InputError(
            "engine 'mujoco' needs the package mujoco, which is not installed; "
            "`pip install mujoco` or `pip install 'hmap_core[mujoco]'`"
        ) from error
