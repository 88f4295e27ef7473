"""The tables of the data set: one row a contact, one a query, one a scene."""

import pyarrow as pa

from hmap_core.learning import features, hold_features

VERSION = 1
SPLITS = ("train", "validation", "test")
_POSE = pa.list_(pa.float32(), 7)
_POINT = pa.list_(pa.float32(), 3)

CONTACTS = pa.schema(
    [
        ("scene", pa.int32()),
        ("query", pa.int16()),
        ("candidate", pa.int16()),
        ("family", pa.string()),
        ("robot", pa.string()),
        ("with_tool", pa.bool_()),
        ("on_tool", pa.bool_()),
        ("source", pa.string()),
        ("rank", pa.int16()),
        ("kind", pa.string()),
        ("T_obj_ee", _POSE),
        ("point", _POINT),
        ("normal", _POINT),
        ("approach", _POINT),
        ("opening", pa.float32()),
        ("score", pa.float32()),
        ("poses", pa.int16()),
        ("bound", pa.int16()),
        ("reach", pa.int16()),
        ("arm_evaluated", pa.bool_()),
        ("stage", pa.int8()),
        ("stage_name", pa.string()),
        ("reason", pa.string()),
        ("position_error", pa.float32()),
        ("rotation_error", pa.float32()),
        ("features", pa.list_(pa.float32(), features.WIDTH)),
    ]
)
QUERIES = pa.schema(
    [
        ("scene", pa.int32()),
        ("query", pa.int16()),
        ("family", pa.string()),
        ("robot", pa.string()),
        ("robot_model", pa.string()),
        ("object", pa.string()),
        ("tool", pa.string()),
        ("on_tool", pa.bool_()),
        ("T_tool_ee", pa.list_(pa.float32())),
        ("start", pa.int16()),
        ("object_poses", pa.list_(pa.float32())),
        ("object_cloud", pa.list_(pa.float32())),
        ("around", pa.list_(pa.float32())),
        ("T_world_base", _POSE),
        ("contacts", pa.int16()),
        ("best_bound", pa.int16()),
        ("best_reach", pa.int16()),
        ("features", pa.list_(pa.float32(), hold_features.WIDTH)),
    ]
)
SCENES = pa.schema(
    [
        ("scene", pa.int32()),
        ("family", pa.string()),
        ("seed", pa.int32()),
        ("split", pa.string()),
        ("status", pa.string()),
        ("contacts", pa.int32()),
        ("task", pa.string()),
    ]
)
DESCRIPTIONS = {
    "scene": "number of the scene, a key of the table `scenes`",
    "query": "number of the query in its scene; (scene, query) is the key of the table `queries`",
    "candidate": "number of the contact in its query",
    "family": "family of the scene, for family-level splits",
    "robot": "name of the robot in its scene",
    "robot_model": "the robot's model",
    "with_tool": "a held tool touches the object",
    "on_tool": "the object of the query is a tool that is to be picked",
    "source": "`ranked`: among the first of hmap's sampler; `uniform`: drawn uniformly from what it generates",
    "rank": "place in the order of the sampler; -1 for uniform contacts",
    "kind": "touch, grasp, push or press",
    "T_obj_ee": "6-D contact: pose of the end effector in the object's frame, m and quaternion xyzw",
    "point": "contact position, object frame, m",
    "normal": "outward normal there, object frame",
    "approach": "direction of the final approach, end-effector frame",
    "opening": "of the gripper, m",
    "score": "of hmap's sampler",
    "poses": "index of the last pose of the object's path",
    "bound": "last pose that the rigid hand serves; -1: it cannot come to the contact",
    "reach": "last pose that the arm serves; -1: none, or not evaluated",
    "arm_evaluated": "whether stages after `hand_serves` were evaluated where the contact came that far",
    "stage": "number of the last stage reached",
    "stage_name": "its name",
    "reason": "why the contact came no further",
    "position_error": "of the object after execution, m; null where it was not executed",
    "rotation_error": "rad",
    "features": "what hmap's model sees, rounded to 11 significant bits",
    "object": "name of the object",
    "tool": "name of the held tool; empty for a bare hand",
    "T_tool_ee": "pose of the end effector in the tool's frame; empty for a bare hand",
    "start": "index of the pose of the scene's path at which the object stands",
    "object_poses": "(M, 7) path of the object from there, world frame, row by row",
    "object_cloud": "(N, 3) points of the object's surface, object frame, m, row by row",
    "around": "(S, 15) boxes round what stands near: rotation matrix, centre, half extents; world frame, row by row",
    "T_world_base": "pose of the robot's base",
    "contacts": "number of contacts",
    "best_bound": "largest `bound` of them, and of the rest of the first batch of the sampler, which has no rows",
    "best_reach": "largest `reach` of them",
    "seed": "of the scene's family",
    "split": "train, validation or test",
    "status": "`made`, `no scene` (drawn in vain), `no path` (the object has none) or `nothing to remove` (relaxed)",
    "task": "the task file of the scene",
}
