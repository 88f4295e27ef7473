"""Plan a task that comes with hmap, ask the judge about the plan, and save it. The same as ``hmap plan bolt``."""

from hmap_core import plan_file, planner
from hmap_core.scenes import load_scene
from hmap_core.validation import check

scene = load_scene("bolt", seed=1)  # or load_scene("my/task.yaml")
plan = planner.plan(scene, seed=1, time_limit=120.0, progress=lambda now: print(f"{now.phase}: {now.text}"))

for segment in plan.segments:
    print(f"{segment.start:6.2f} to {segment.end:6.2f} s: {segment.robot}, {segment.kind}, {segment.object or '-'}")

report = check(plan_file.to_dict(plan))
print("the judge says:", "valid" if report.valid else report)
plan_file.save(plan, "bolt.json")  # `hmap check`, `hmap execute` and hmap_core.plan_file.load read it
