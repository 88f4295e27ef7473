"""Arithmetic expressions in scene files, such as ``0.25 + bar/2 + gap``."""

import ast
import operator
from collections.abc import Callable, Mapping

MAX_LENGTH = 200  # characters
_BINARY = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
_UNARY: dict[type[ast.unaryop], Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
ALLOWED = "numbers, parameter names, + - * / and parentheses"


class ExpressionError(ValueError):
    """An expression that cannot be evaluated; the message says why."""


def names(expression: str) -> list[str]:
    """The parameter names that an expression refers to, in order.

    Raises:
        ExpressionError: the expression cannot be parsed.
    """
    return [node.id for node in ast.walk(_parse(expression)) if isinstance(node, ast.Name)]


def evaluate(expression: str, parameters: Mapping[str, float]) -> float:
    """Evaluates an expression of numbers, parameter names, ``+ - * /`` and parentheses.

    Args:
        expression: the text.
        parameters: values of the parameters.

    Returns:
        Its value.

    Raises:
        ExpressionError: other syntax, an unknown name, division by zero or overflow.
    """
    try:
        return _value(_parse(expression), parameters)
    except ZeroDivisionError as error:
        raise ExpressionError("divides by zero") from error
    except OverflowError as error:
        raise ExpressionError("is too large a number") from error


def _parse(expression: str) -> ast.expr:
    if len(expression) > MAX_LENGTH:
        raise ExpressionError(f"is longer than {MAX_LENGTH} characters")
    try:
        if "#" in expression:  # Python would parse the rest as a comment
            raise SyntaxError
        return ast.parse(expression.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ExpressionError(f"is neither a number nor an expression of {ALLOWED}") from error


def _value(node: ast.expr, parameters: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name):
            if name not in parameters:
                known = ", ".join(parameters) or "none"
                raise ExpressionError(f"refers to the unknown parameter {name!r}; known: {known}")
            return parameters[name]
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _BINARY[type(op)](_value(left, parameters), _value(right, parameters))
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            return _UNARY[type(op)](_value(operand, parameters))
    raise ExpressionError(f"may hold only {ALLOWED}")
