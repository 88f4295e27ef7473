"""The numbers of ErrorCode are those of the core's exceptions."""

from hmap_core.exceptions import Code
from hmap_msgs.msg import ErrorCode


def test_numbers_are_equal():
    constants = {name for name in dir(type(ErrorCode)) if name.isupper() and not name.startswith("_")}
    assert {name: getattr(ErrorCode, name) for name in constants} == {code.name: int(code) for code in Code}
