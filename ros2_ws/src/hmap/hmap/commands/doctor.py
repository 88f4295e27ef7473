"""``hmap doctor``: looks at a running graph before anything moves."""

import argparse
import json
from dataclasses import asdict

from hmap.environment import prepare_process
from hmap_core.cli.main import positive
from hmap_core.command_line import keep_for_results

HELP = "look at the running graph: what is missing, stale, or of the wrong type, quality of service or frame"
RESTARTS = True  # see hmap_core.cli.main
SECONDS = 2.0  # of listening
YES, NO = 0, 1  # exit codes
NODE_NAME = "hmap_doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    text = f"for which messages are waited for ({SECONDS:g})"
    parser.add_argument("--seconds", type=positive, default=SECONDS, metavar="S", help=text)
    parser.add_argument("--namespace", default="/", metavar="NS", help="of the graph (/)")
    parser.add_argument("--all", action="store_true", help="print what is in order, too")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Look at the graph; exit code 0 if a robot may move, else 1. Nothing is sent to any controller."""
    prepare_process()
    keep_for_results()
    findings = examine(arguments.seconds, arguments.namespace)
    failed = [finding for finding in findings if finding.level == "FAIL"]
    if arguments.json:
        print(json.dumps({"ok": not failed, "findings": [asdict(finding) for finding in findings]}))
        return NO if failed else YES
    for finding in findings:
        if finding.level != "OK" or arguments.all:
            print(f"{finding.level:<5}{finding.what}: {finding.text}".removesuffix(": "))
    warned = sum(finding.level == "WARN" for finding in findings)
    print(f"{len(findings)} things looked at: {len(failed)} wrong, {warned} to know")
    return NO if failed else YES


def examine(seconds: float, namespace: str = "/"):
    """The findings on the graph of a namespace, with a node and a context of their own."""
    import rclpy  # slow to import, as is all of ROS
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    from hmap.doctor.examination import Examination
    from hmap.spinning import Spinner

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node(NODE_NAME, namespace=namespace, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinner = Spinner(executor, lambda error: node.get_logger().error(repr(error)))
    try:
        return Examination(node, seconds).run()
    finally:
        spinner.stop()
        node.destroy_node()
        rclpy.shutdown(context=context, uninstall_handlers=False)
