"""A node that is spun, in a context of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node

from hmap.spinning import Spinner


@contextmanager
def spun_node(executor_type: Callable[..., Executor]) -> Iterator[tuple[Node, Executor, Spinner]]:
    """A node, its executor, and what spins it; no callback may raise an exception meanwhile."""
    context = Context()
    context.init()
    node = Node("spun", context=context)
    executor = executor_type(context=context)
    executor.add_node(node)
    errors: list[Exception] = []
    spinner = Spinner(executor, errors.append)
    yield node, executor, spinner
    spinner.stop()
    node.destroy_node()
    context.shutdown()
    assert not errors
