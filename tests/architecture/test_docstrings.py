"""Public functions, classes and methods have a docstring, and it names every exception that they raise themselves."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    ROOT / "ros2_ws" / "src" / "hmap_core" / "hmap_core",
    ROOT / "ros2_ws" / "src" / "hmap" / "hmap",
    ROOT / "hmap_msgs_py" / "hmap_msgs_py",
)
# Modules that do not follow the rule yet. The list may only shrink: a module that follows it must not be on it.
NOT_CONVERTED = {
    "ros2_ws/src/hmap_core/hmap_core/komo/features/base.py",
    "ros2_ws/src/hmap_core/hmap_core/komo/skeleton_problem.py",
}
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def modules() -> list[Path]:
    return [path for package in PACKAGES for path in sorted(package.rglob("*.py"))]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@cache
def error_makers() -> dict[str, str]:
    """Functions that return an exception, such as ``unusable(reason) -> InputError``, with its class."""
    found = {}
    for path in modules():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, FUNCTIONS) and node.returns is not None:
                name = ast.unparse(node.returns).strip("\"'").split(".")[-1]
                if name.endswith(("Error", "Exception")):
                    found[node.name] = name
    return found


def public(tree: ast.Module) -> Iterator[tuple[str, Definition]]:
    """Public classes and functions of a module and public methods of those classes, with their qualified names."""
    for node in tree.body:
        if isinstance(node, Definition) and not node.name.startswith("_"):
            yield node.name, node
            if isinstance(node, ast.ClassDef):
                methods = (m for m in node.body if isinstance(m, FUNCTIONS) and not m.name.startswith("_"))
                yield from ((f"{node.name}.{method.name}", method) for method in methods)


def own_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a function without those of the functions and classes defined inside it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, (*FUNCTIONS, ast.ClassDef, ast.Lambda)):
            yield child
            yield from own_nodes(child)


def raised(function: ast.AST) -> set[str]:
    """Names of the exceptions that a function raises by statements of its own, without those that it passes on."""
    names = set()
    for node in own_nodes(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            name = ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc).split(".")[-1]
            if isinstance(node.exc, ast.Call):
                name = error_makers().get(name, name)
            if name[:1].isupper():
                names.add(name)
    return names


def findings(tree: ast.Module) -> list[str]:
    """What a module lacks, one line each."""
    wrong = []
    for name, node in public(tree):
        text = ast.get_docstring(node)
        if not text:
            wrong.append(f"line {node.lineno}: {name} has no docstring")
        elif isinstance(node, FUNCTIONS):
            missing = sorted(error for error in raised(node) if not re.search(rf"\b{error}\b", text))
            wrong += [f"line {node.lineno}: {name} raises {error}; its docstring does not say so" for error in missing]
    return wrong


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_public_names_are_documented(path):
    name = path.relative_to(ROOT).as_posix()
    wrong = findings(tree_of(path))
    if name in NOT_CONVERTED:
        assert wrong, f"{name} is complete: remove it from NOT_CONVERTED"
    else:
        assert not wrong, "\n".join([name, *wrong])


def test_listed_modules_exist():
    assert {name for name in NOT_CONVERTED if not (ROOT / name).is_file()} == set()


def test_checker_sees_what_it_should():
    source = '''
def plain(): ...
def told():
    """Says nothing of its error."""
    raise ValueError("x")
def complete():
    """Says it.

    Raises:
        ValueError: always.
    """
    def inner():
        raise KeyError
    try:
        raise ValueError("x")
    except ValueError as error:
        raise error
class Open:
    """Has a method."""
    def method(self): ...
    def _own(self): ...
'''
    wrong = findings(ast.parse(source))
    assert [line.split(": ")[1] for line in wrong] == [
        "plain has no docstring",
        "told raises ValueError; its docstring does not say so",
        "Open.method has no docstring",
    ]
