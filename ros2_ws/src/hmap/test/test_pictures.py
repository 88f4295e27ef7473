"""The parts of a picture find each other by their stamps, however late a part comes."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from hmap.perception.pictures import KEPT, PictureParts
from hmap_core.scenes import load_scene
from hmap_msgs.msg import InstanceNames
from hmap_msgs_py.images import image_to_message

SHAPE = (3, 4)  # pixels
FOCAL_LENGTH = 5.0  # pixels
FRAME = "camera"


@pytest.fixture
def parts():
    camera = next(iter(load_scene("tunnel", 0).cameras.values()))
    return PictureParts(camera)


def messages(second: int) -> dict[str, object]:
    """The parts of a picture whose pixels hold the second of its stamp."""
    stamp = Time(sec=second)
    header = Header(stamp=stamp, frame_id=FRAME)
    image = image_to_message(np.full(SHAPE, second, np.uint16), "16UC1", FRAME, stamp)
    K = [FOCAL_LENGTH, 0.0, 2.0, 0.0, FOCAL_LENGTH, 1.5, 0.0, 0.0, 1.0]
    names = InstanceNames(header=header, numbers=[second], names=["bar"])
    return {"depth": image, "info": CameraInfo(header=header, k=K), "mask": image, "names": names}


def test_a_mask_that_comes_after_later_depth_images_still_makes_a_picture(parts):
    for second in (1, 2, 3):
        for part in ("depth", "info"):
            assert parts.add(part, messages(second)[part]) is None
    assert parts.add("names", messages(1)["names"]) is None
    picture = parts.add("mask", messages(1)["mask"])
    assert picture is not None and picture.time == 1.0
    assert (picture.mask == 1).all() and picture.names == {"bar": 1}


def test_parts_of_different_stamps_make_no_picture(parts):
    for second, part in enumerate(("depth", "info", "mask", "names"), start=1):
        assert parts.add(part, messages(second)[part]) is None


def test_what_never_becomes_complete_is_forgotten(parts):
    for second in range(1, 2 * KEPT):
        parts.add("depth", messages(second)["depth"])
    for part in ("info", "mask"):
        assert parts.add(part, messages(1)[part]) is None
    assert parts.add("names", messages(1)["names"]) is None  # its depth is gone
    assert len(parts._incomplete) <= KEPT
