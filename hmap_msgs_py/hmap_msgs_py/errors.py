"""Conversion of errors to hmap_msgs/ErrorCode."""

from hmap_msgs.msg import ErrorCode
from hmap_msgs_py.checks import ConversionError, PoseError


def error_to_message(error: Exception | None = None) -> ErrorCode:
    """Convert an exception.

    Args:
        error: with ``code``, ``stage`` and ``reason``; an exception without these becomes INTERNAL. None means success.
    """
    if error is None:
        return ErrorCode(code=ErrorCode.SUCCESS)
    if hasattr(error, "code") and hasattr(error, "stage") and hasattr(error, "reason"):
        return ErrorCode(code=int(error.code), stage=str(error.stage), reason=str(error.reason))
    if isinstance(error, ConversionError):
        code = ErrorCode.INVALID_POSE if isinstance(error, PoseError) else ErrorCode.INVALID_INPUT
        return ErrorCode(code=code, stage="input", reason=str(error))
    return ErrorCode(code=ErrorCode.INTERNAL, stage="internal", reason=f"{type(error).__name__}: {error}")
