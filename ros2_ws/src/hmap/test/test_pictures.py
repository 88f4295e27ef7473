"""The parts of a picture find each other by their stamps, however late a part comes."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from hmap.perception.pictures import KEPT, PARTS, PictureParts, instance_names
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene
from hmap_msgs.msg import InstanceNames
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.images import image_to_message
from hmap_msgs_py.measurements import ReceiverClock, StampError

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


def add_all(parts, given):
    """The picture once all parts are added."""
    return [parts.add(part, given[part]) for part in PARTS][-1]


def test_picture_that_is_complete_after_a_newer_one_is_left_out(parts):
    assert add_all(parts, messages(2)).time == 2.0
    assert add_all(parts, messages(1)) is None
    assert add_all(parts, messages(2)).time == 2.0  # taken twice in the same instant
    assert add_all(parts, messages(3)).time == 3.0


def test_picture_ahead_of_the_clock_is_refused_and_later_ones_are_taken(parts):
    parts = PictureParts(parts.camera, ReceiverClock(lambda: 10.0, 1.0))
    with pytest.raises(StampError, match=f"picture of camera '{parts.camera.name}' is stamped 3600.00 s ahead"):
        add_all(parts, messages(3610))
    assert add_all(parts, messages(10)).time == 10.0


def test_pictures_of_a_simulation_that_is_started_anew_are_taken(parts):
    now = [100.0]
    parts = PictureParts(parts.camera, ReceiverClock(lambda: now[0], 1.0))
    assert add_all(parts, messages(99)) is not None
    now[0] = 2.0
    assert add_all(parts, messages(2)) is not None


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda m: m["info"].k.__setitem__(0, float("nan")), "matrix in the camera info .* nan"),
        (lambda m: m["info"].k.__setitem__(4, 0.0), "no focal lengths"),
        (lambda m: setattr(m["info"], "width", 640), "camera info 0 x 640; they must be the same"),
        (lambda m: m.update(mask=picture_of((2, 2))), "3 x 4 pixels and the mask 2 x 2"),
        (lambda m: setattr(m["names"], "names", ["bar", "cup"]), "2 values for 1 numbers"),
        (lambda m: m.update(depth=picture_of(SHAPE, "rgb8")), "rgb8"),
    ],
)
def test_malformed_pictures_are_named(parts, spoil, says):
    given = messages(1)
    spoil(given)
    with pytest.raises((InputError, ConversionError), match=says):
        add_all(parts, given)


def picture_of(shape, encoding: str = "16UC1"):
    pixels = np.ones(shape, np.uint16) if encoding == "16UC1" else np.ones((*shape, 3), np.uint8)
    return image_to_message(pixels, encoding, FRAME, Time(sec=1))


def test_names_that_are_not_unique_are_left_out_and_named():
    known, problems = instance_names(["cup", "", "bar", "bar", "lid", "pan"], [1, 2, 3, 4, 5, 5])
    assert known == {"cup": 1}
    assert len(problems) == 4 and any("'bar' has several numbers" in text for text in problems)
    assert instance_names(["cup", "cup"], [1, 1]) == ({"cup": 1}, [])  # the same twice
