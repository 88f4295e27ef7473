"""Bags survive a kill but for their last moments, are split and compressed, and say what is wrong with them."""

import shutil

import pytest
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from std_msgs.msg import Float64, String

from hmap.bags.check import check_bag, repair
from hmap.bags.reader import open_bag
from hmap.bags.writer import BagWriter
from hmap_core.exceptions import InputError
from hmap_msgs_py.definitions import typestore

SECOND = 10**9
COUNT = 200  # messages; one every 10 ms


def fill(writer: BagWriter, count: int = COUNT, first: int = 0) -> None:
    types = typestore()
    if first == 0:
        fill.value = writer.add("/value", "std_msgs/msg/Float64", types)
        fill.text = writer.add("/text", "std_msgs/msg/String", types)
    for k in range(first, first + count):
        writer.write(fill.value, k * SECOND // 100, serialize_message(Float64(data=float(k))))
        writer.write(fill.text, k * SECOND // 100, serialize_message(String(data=f"{k} " * 50)))


def values(path) -> list[float]:
    return [message.data.data for message in open_bag(path).messages(["/value"])]


def killed(folder, tmp_path):
    """What is on the disk of a bag that is still open."""
    return shutil.copytree(folder, tmp_path / "killed")


@pytest.mark.parametrize("compress", [False, True])
def test_a_kill_costs_what_came_since_the_last_flush(tmp_path, compress):
    writer = BagWriter(tmp_path / "bag", compress=compress)
    fill(writer)
    writer.flush()
    fill(writer, 7, COUNT)
    path = killed(tmp_path / "bag", tmp_path)
    assert values(path) == list(range(COUNT))
    report = check_bag(open_bag(path))
    assert not report.sound and report.counts == {"/value": COUNT, "/text": COUNT}
    assert any("metadata.yaml is missing" in text for text in report.damaged)
    assert any("no end and no index" in text for text in report.damaged)
    writer.close()
    assert values(tmp_path / "bag") == list(range(COUNT + 7))


def test_a_chunk_that_is_cut_off_or_damaged_costs_itself_alone(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    for part in range(3):
        fill(writer, 50, 50 * part)
        writer.flush()
    path = killed(tmp_path / "bag", tmp_path)
    file = path / "bag.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[:-5000])  # within the last chunk
    assert values(path) == list(range(100))
    assert any("cut off" in text for text in check_bag(open_bag(path)).damaged)
    middle = len(whole) // 2
    file.write_bytes(whole[:middle] + bytes(3000) + whole[middle + 3000 :])
    found = values(path)
    assert {*range(50), *range(100, 150)} <= set(found) and len(found) < 150 and check_bag(open_bag(path)).damaged
    file.write_bytes(b"no bag")
    assert values(path) == []


def test_a_copy_of_what_can_be_read_is_sound(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    fill(writer)
    writer.flush()
    path = killed(tmp_path / "bag", tmp_path)
    assert repair(open_bag(path), tmp_path / "copy") == 2 * COUNT
    with AnyReader([tmp_path / "copy"]) as reader:
        assert sum(1 for _ in reader.messages()) == 2 * COUNT
    assert not check_bag(open_bag(tmp_path / "copy")).damaged
    with pytest.raises(InputError, match="exists already"):
        repair(open_bag(path), tmp_path / "copy")


@pytest.mark.parametrize("options", [{"split_duration": 0.5}, {"split_size": 10_000}])
def test_a_bag_is_split_on_request(tmp_path, options):
    writer = BagWriter(tmp_path / "bag", **options)
    fill(writer)
    assert writer.files >= 3
    path = killed(tmp_path / "bag", tmp_path)
    assert len(values(path)) >= 2 * COUNT // 3 and values(path) == list(range(len(values(path))))
    writer.close()
    assert values(tmp_path / "bag") == list(range(COUNT))
    assert len(list((tmp_path / "bag").glob("bag_*.mcap"))) == writer.files
    with AnyReader([tmp_path / "bag"]) as reader:
        assert sum(1 for _ in reader.messages()) == 2 * COUNT
        assert {connection.msgtype for connection in reader.connections} == {
            "std_msgs/msg/Float64",
            "std_msgs/msg/String",
        }


@pytest.mark.parametrize("name", ["bag", "run_1"])
def test_a_kill_while_the_bag_is_split_costs_nothing_of_the_files_before(tmp_path, name):
    writer = BagWriter(tmp_path / name)
    fill(writer)
    writer._split()
    path = shutil.copytree(tmp_path / name, tmp_path / "killed" / name)
    fill(writer, 50, COUNT)
    writer.flush()
    assert values(path) == list(range(COUNT))
    assert any(f"{name}.mcap: it is empty" in text for text in check_bag(open_bag(path)).damaged)
    path.joinpath(f"{name}.mcap").unlink()  # the moment before the next file was begun
    assert values(path) == list(range(COUNT))
    assert values(tmp_path / name) == list(range(COUNT + 50))
    writer._split()
    assert values(tmp_path / name) == list(range(COUNT + 50))
    writer.close()


def test_compression_makes_a_bag_smaller(tmp_path):
    sizes = []
    for compress in (False, True):
        writer = BagWriter(tmp_path / str(compress), compress=compress)
        fill(writer)
        writer.close()
        sizes.append(sum(file.stat().st_size for file in (tmp_path / str(compress)).iterdir()))
        assert values(tmp_path / str(compress)) == list(range(COUNT))
    assert sizes[1] < 0.5 * sizes[0]


def test_what_is_no_bag_is_refused_with_a_suggestion(tmp_path):
    with pytest.raises(InputError, match="there is no such bag"):
        open_bag(tmp_path / "none")
    (tmp_path / "run" / "bag").mkdir(parents=True)
    (tmp_path / "run" / "bag" / "bag.mcap").write_bytes(b"")
    with pytest.raises(InputError, match=r"is no bag.*did you mean .*run/bag\?"):
        open_bag(tmp_path / "run")
    assert check_bag(open_bag(tmp_path / "run" / "bag")).damaged
