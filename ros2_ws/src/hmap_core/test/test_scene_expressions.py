"""Arithmetic and randomised parameters of scene files."""

import pytest

from hmap_core.exceptions import InputError
from hmap_core.scenes.document import Document
from hmap_core.scenes.expressions import ExpressionError, evaluate
from hmap_core.scenes.parameters import draw


@pytest.mark.parametrize(
    ("expression", "value"),
    [("1", 1.0), ("-a", -2.0), ("a + b/2 - 3*(a - b)", 2.0 + 2.0 + 6.0), ("+.5e-3", 0.0005), (" a ", 2.0)],
)
def test_evaluates(expression: str, value: float) -> None:
    assert evaluate(expression, {"a": 2.0, "b": 4.0}) == pytest.approx(value)


@pytest.mark.parametrize(
    "expression",
    [
        "", "a # b", "a +", "c", "a**2", "a//b", "abs(a)", "a.real", "[a]", "'x'", "True", "1j", "a if b else 1",
        "a < b", "lambda: 1", "1/0", "__import__('os')", "(" * 150 + ")" * 150, "a" * 300, "\0",
        "9" * 150 + "*" + "9" * 40 + "e300",
    ],
)  # fmt: skip
def test_refuses_anything_else(expression: str) -> None:
    with pytest.raises(ExpressionError):
        value = evaluate(expression, {"a": 2.0, "b": 4.0})
        if value == float("inf"):  # an overflow to infinity is refused by whoever asked
            raise ExpressionError("infinite")


def _document(parameters: dict, tmp_path) -> Document:
    return Document(tmp_path / "x.yaml", {"parameters": parameters})


def test_draws_are_repeatable_and_independent_of_each_other(tmp_path) -> None:
    ranges = {"a": {"uniform": [0, 1]}, "b": {"uniform": ["a", "a + 1"]}}
    first = draw(_document(ranges, tmp_path), seed=4)
    assert first == draw(_document(ranges, tmp_path), seed=4)
    assert first != draw(_document(ranges, tmp_path), seed=5)
    more = draw(_document({"new": {"uniform": [0, 1]}} | ranges, tmp_path), seed=4)
    assert {name: more[name] for name in first} == first
    assert first["a"] <= first["b"] <= first["a"] + 1.0


def test_later_parameters_may_be_used_and_given_ones_replace_the_file(tmp_path) -> None:
    document = _document({"sum": "a + b", "a": 1, "b": {"choice": [2, 2.0]}}, tmp_path)
    assert draw(document, seed=0) == {"sum": 3.0, "a": 1.0, "b": 2.0}
    assert draw(document, seed=0, given={"a": 5.0})["sum"] == 7.0


def test_uses_of_one_file_draw_apart(tmp_path) -> None:
    document = _document({"a": {"uniform": [0, 1]}}, tmp_path)
    assert draw(document, seed=0, scope="left") != draw(document, seed=0, scope="right")


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"a": "b", "b": "a"}, "refers to itself: a -> b -> a"),
        ({"a": "c", "b": 1}, "unknown parameter 'c'; known: a, b"),
        ({"a": {"uniform": [2, 1]}}, "low not above high"),
        ({"a": {"uniform": [1]}}, "low, high"),
        ({"a": {"uniform": "x"}}, "list of numbers"),
        ({"a": {"normal": [0, 1]}}, "{uniform: [low, high]}"),
        ({"a": {"choice": []}}, "list of numbers"),
        ({"a": None}, "must be a number"),
        ({"a": True}, "must be a number"),
        ({"a": float("nan")}, "finite"),
        ({"a": 10**400}, "finite"),
        ({"a": "1e200*1e200"}, "finite"),
        ({"class": 1}, "a name is"),
        ({"a b": 1}, "a name is"),
        ([1], "must be a mapping"),
    ],
)
def test_wrong_parameters_are_named(parameters, expected: str, tmp_path) -> None:
    with pytest.raises(InputError, match="x.yaml:1: parameters") as error:
        draw(_document(parameters, tmp_path), seed=0)
    assert expected in error.value.reason
