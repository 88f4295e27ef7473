"""The list of tasks is read without loading the tasks; it has to say what the files say."""

import pytest

from hmap_core.exceptions import InputError
from hmap_core.scenes import document, list_tasks, resources, task_descriptions

FOLDER = resources.package_path("hmap_scenes") / "tasks"


@pytest.mark.parametrize("name", list_tasks())
def test_one_key_is_read_as_in_the_whole_file(name):
    path = FOLDER / f"{name}.yaml"
    whole = document.read(path).data
    for key in ("schema", "description", "unsolvable", "goal", "robots", "missing"):
        assert document.read_key(path, key) == whole.get(key)


def test_descriptions_are_one_line_each():
    descriptions = task_descriptions()
    assert list(descriptions) == list_tasks()
    assert all(text and "\n" not in text for text in descriptions.values())


def test_unsolvable_tasks_can_be_left_out():
    unsolvable = set(list_tasks()) - set(list_tasks(unsolvable=False))
    assert unsolvable == {
        name for name in list_tasks() if document.read(FOLDER / f"{name}.yaml").data.get("unsolvable")
    }
    assert unsolvable


def test_comments_and_empty_lines_are_left_out(tmp_path):
    file = tmp_path / "task.yaml"
    file.write_text("description: >-\n  one\n\n  two\n# a comment\nother: 1\n")
    assert document.read_key(file, "description") == "one\ntwo"


def test_an_error_names_the_line_in_the_file(tmp_path):
    file = tmp_path / "task.yaml"
    file.write_text("schema: 1\n\ndescription: [1\n")
    with pytest.raises(InputError, match=r"task.yaml:4: not valid YAML"):
        document.read_key(file, "description")
