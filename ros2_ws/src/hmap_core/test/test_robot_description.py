"""Every fault of a robot description is refused before anything is planned, and what is assumed is said."""

import math
import os

import mesh_fixtures as meshes
import numpy as np
import pytest
from robot_fixtures import COLLISION, LIMIT, joint, link, robot, write, write_robot

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics import load_arm
from hmap_core.kinematics.urdf import load_urdf
from hmap_core.robot_description import Severity, load_robot_description
from hmap_core.robot_description.tree import loops, mimic_relations
from hmap_core.robot_setup.guess import guess_robot
from hmap_core.robot_setup.structure import find_structure
from hmap_core.scenes import load_robot_model
from hmap_core.scenes.robots import robot_findings
from hmap_core.validation import urdf as judge

ARM = [joint("shoulder", "base", "upper")]


def elbow(**changes) -> str:
    return robot(joints=[*ARM, joint("elbow", "upper", "tip", **changes)])


def shaped(geometry: str) -> str:
    return robot(link("extra", COLLISION.format(geometry)), joint("mount", "tip", "extra", "fixed"))


MUCH = '<mimic joint="{}" multiplier="10"/>'

ERRORS = {  # what is wrong: description, and what the error says
    "no XML": ("robot: arm", "is not XML"),
    "half a file": ("<robot><link", "is not XML"),
    "empty": ("", "is not XML"),
    "another format": ('<sdf version="1.9"/>', "its root element is <sdf>; convert the SDF file"),
    "no links": ("<robot/>", "has no <link>"),
    "zero axis": (elbow(axis='<axis xyz="0 0 0"/>'), "joint 'elbow', <axis>: xyz=\"0 0 0\" has no direction"),
    "axis of 2": (elbow(axis='<axis xyz="0 1"/>'), 'xyz="0 1": has 2 numbers'),
    "comma": (elbow(axis='<axis xyz="0,5 0 1"/>'), "'0,5' is not a number; write decimal points"),
    "commas": (elbow(axis='<axis xyz="0, 0, 1"/>'), "'0,' is not a number; write decimal points, and spaces"),
    "unexpanded": (elbow(axis='<axis xyz="${x} 0 1"/>'), "<axis>: xyz=\"${x} 0 1\": '${x}' is not expanded"),
    "unexpanded name": (robot(joint("j", "${base}", "tip")), "'${base}' is not expanded; expand the file with xacro"),
    "NaN limit": (elbow(limit='<limit lower="nan" upper="1"/>'), "joint 'elbow', <limit>: lower=\"nan\": must be"),
    "inverted limits": (elbow(limit='<limit lower="1" upper="-1"/>'), 'lower="1" is above upper="-1"'),
    "no limits": (elbow(limit=""), "joint 'elbow': is revolute and has no <limit>"),
    "negative velocity": (elbow(limit='<limit lower="-1" upper="1" velocity="-2"/>'), 'velocity="-2" is negative'),
    "negative effort": (elbow(limit='<limit lower="-1" upper="1" effort="-2"/>'), 'effort="-2" is negative'),
    "unknown type, which leaves links apart": (elbow(kind="Revolute"), "joint 'elbow': type=\"Revolute\" is not known"),
    "soft limits outside": (
        elbow(extra='<safety_controller soft_lower_limit="2" soft_upper_limit="3"/>'),
        "<safety_controller>: its soft limits 2 to 3 leave nothing of the limits -1.5 to 1.5",
    ),
    "a quaternion": (
        elbow().replace('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.3" quat_xyzw="1 0 0 0"/>', 1),
        "joint 'shoulder', <origin>: has the attribute quat_xyzw, which most readers",
    ),
    "other digits": (shaped('<sphere radius="\u0660.\u0665"/>'), "is not a number; write a number"),
    "unknown type": (elbow(kind="hinge"), "joint 'elbow': type=\"hinge\" is not known; allowed: revolute, "),
    "no parent": (elbow().replace('<parent link="upper"/>', ""), "joint 'elbow': has no <parent>"),
    "missing link": (robot(joint("j", "tip", "hand")), "joint 'j': names the link 'hand', which is missing"),
    "two roots": (robot(link("spare")), "has 2 links that are the child of no joint: 'base', 'spare'"),
    "two parents": (robot(joint("j", "base", "tip")), "its child link 'tip' is also the child of joint 'elbow'"),
    "loop": (robot(joint("j", "tip", "base", "fixed")), "the joints 'elbow', 'j', 'shoulder' form a loop"),
    "loop apart": (
        robot(link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")),
        "the joints 'k', 'j' form a loop",
    ),
    "own child": (robot(link("a"), joint("j", "a", "a")), "the joints 'j' form a loop"),
    "link twice": (robot(link("tip")), "link 'tip': a link before has the same name"),
    "joint twice": (robot(link("a"), joint("elbow", "tip", "a")), "joint 'elbow': a joint before has the same name"),
    "no name": (robot("<link/>"), "has no attribute 'name'"),
    "mimics nothing": (elbow(extra='<mimic joint="knee"/>'), "'elbow': mimics 'knee', which is not in the URDF"),
    "mimics itself": (elbow(extra='<mimic joint="elbow"/>'), "'elbow': mimics 'elbow', which follows it in turn"),
    "mimics too much": (
        robot(
            *[link(f"l{k}") for k in range(9)],
            *[
                joint(f"j{k}", f"l{k - 1}" if k else "tip", f"l{k}", extra=MUCH.format(f"j{k - 1}" if k else "elbow"))
                for k in range(9)
            ],
        ),
        "joint 'j6': it moves 1e+07 times as far as 'elbow'",
    ),
    "xacro that includes itself": (
        '<robot name="a" xmlns:xacro="x"><xacro:macro name="m" params="n"><xacro:m n="${n + 1}"/></xacro:macro>'
        '<xacro:m n="0"/></robot>',
        "its macros or files include each other endlessly, or too deeply; look for one that includes itself",
    ),
    "mimic NaN": (elbow(extra='<mimic joint="shoulder" multiplier="nan"/>'), 'multiplier="nan": must be finite'),
    "damping": (elbow(extra='<dynamics damping="-1"/>'), 'damping="-1" is negative'),
    "NaN radius": (shaped('<sphere radius="nan"/>'), "link 'extra', <collision>, <geometry>, <sphere>: radius=\"nan\""),
    "no radius": (shaped("<sphere/>"), "<sphere>: has no attribute 'radius'"),
    "negative size": (shaped('<box size="1 -1 1"/>'), '<box>: size="1 -1 1" must be above 0'),
    "zero length": (shaped('<cylinder radius="1" length="0"/>'), '<cylinder>: length="0" must be above 0'),
    "empty geometry": (shaped(""), "link 'extra', <collision>, <geometry>: is empty"),
    "no geometry": (robot(link("tip", "<collision/>"), links=("base", "upper")), "<collision>: has no <geometry>"),
    "unknown geometry": (shaped('<cone radius="1"/>'), "<cone> is not known; allowed: box, sphere, cylinder"),
    "two shapes": (shaped('<sphere radius="1"/><sphere radius="1"/>'), "<geometry>: has 2 shapes"),
    "no mesh": (shaped('<mesh filename="a.stl"/>'), "mesh 'a.stl' named in arm.urdf does not exist"),
    "no mesh name": (shaped("<mesh/>"), "<mesh>: has no attribute 'filename'"),
    "mesh scale of 2": (shaped('<mesh filename="a.stl" scale="1 1"/>'), 'scale="1 1": has 2 numbers'),
    "mesh scale 0": (shaped('<mesh filename="a.stl" scale="1 0 1"/>'), 'scale="1 0 1" makes the mesh flat'),
    "Gazebo's mesh": (shaped('<mesh filename="model://a/b.stl"/>'), "Gazebo's model:// needs its model path"),
    "a mesh of the web": (shaped('<mesh filename="http://a/b.stl"/>'), "download the file"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_a_fault_is_refused_with_file_and_element(tmp_path, case):
    text, says = ERRORS[case]
    file = write_robot(tmp_path, text)
    description = load_robot_description(tmp_path / "arm.urdf")
    assert any(says in str(finding) for finding in description.errors), [str(each) for each in description.errors]
    with pytest.raises(InputError) as error:
        load_robot_model(str(file))
    assert error.value.code == Code.INVALID_SCENE and "arm.urdf" in error.value.reason
    assert f"{file}:2: urdf" in error.value.reason


def test_a_missing_file_is_refused(tmp_path):
    (finding,) = load_robot_description(tmp_path / "none.urdf").findings
    assert finding.severity is Severity.ERROR and "none.urdf: cannot be read: No such file" in str(finding)


def test_a_good_description_has_no_findings(tmp_path):
    description = load_robot_description(write(tmp_path, robot()))
    assert description.findings == () and description.root == "base" and description.name == "arm"
    assert list(description.links) == ["base", "upper", "tip"] and list(description.joints) == ["shoulder", "elbow"]
    assert description.joints["elbow"].effort == 100.0


WARNINGS = {
    "long axis": (elbow(axis='<axis xyz="0 0 2"/>'), "has the length 2; the vector of length 1 is used"),
    "no effort": (elbow(limit='<limit lower="-1" upper="1" velocity="1"/>'), "<limit>: has no effort"),
    "zero effort": (elbow(limit=LIMIT.replace("100", "0")), 'effort="0" lets the joint drop'),
    "no velocity": (elbow(limit='<limit lower="-1" upper="1" effort="1"/>'), "<limit>: has no velocity"),
    "no upper": (elbow(limit='<limit lower="-1" velocity="1" effort="1"/>'), "has no upper; 0 is used"),
    "planar": (robot(link("a"), joint("j", "tip", "a", "planar")), "joint 'j': type=\"planar\" is not supported"),
    "floating": (robot(link("a"), joint("j", "tip", "a", "floating")), "it is taken for fixed"),
    "fixed mimic": (
        robot(link("a"), joint("j", "tip", "a", "fixed", extra='<mimic joint="elbow"/>')),
        "the joint does not move; it is ignored",
    ),
    "two origins": (elbow(extra='<origin xyz="1 2 3"/>'), "has 2 <origin>; the first counts"),
    "a speck": (shaped('<sphere radius="1e-9"/>'), "is 1e-09 m large; lengths are in metres"),
    "degrees": (elbow(limit=LIMIT.replace("1.5", "170")), "<limit>: allows the joint 170 rad; limits are in radians"),
    "turned in degrees": (
        elbow().replace('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.3" rpy="0 90 0"/>', 1),
        'rpy="0 90 0" is more than a full turn; angles are in radians',
    ),
    "no soft limits": (
        elbow(extra='<safety_controller soft_lower_limit="0" soft_upper_limit="0"/>'),
        "both soft limits are 0; they are ignored",
    ),
    "mimic that leaves its limits": (
        elbow(extra='<mimic joint="shoulder" multiplier="2" offset="0.1"/>'),
        "joint 'elbow': leaves its limits -1.5 to 1.5: 'shoulder', which it mimics, moves it from -2.9 to 3.1",
    ),
    "mimic of the wrong sign": (
        elbow(limit='<limit lower="0" upper="1.5" velocity="2" effort="9"/>', extra='<mimic joint="shoulder"/>'),
        "widen its limits, or narrow those of 'shoulder'",
    ),
    "mimic of a mimic": (
        robot(
            link("a"),
            link("b"),
            joint("j", "tip", "a", extra='<mimic joint="elbow" multiplier="-1"/>'),
            joint("k", "a", "b", extra='<mimic joint="j" multiplier="-1.1"/>'),
        ),
        "joint 'k': leaves its limits -1.5 to 1.5: 'elbow', which it mimics, moves it from -1.65 to 1.65",
    ),
    "mimic of an endless joint": (
        elbow(extra='<mimic joint="shoulder"/>').replace('"revolute"', '"continuous"', 1),
        "moves it from -inf to inf",
    ),
    "millimetres": (shaped('<sphere radius="50"/>'), "is 50 m large; lengths are in metres"),
}


@pytest.mark.parametrize("case", WARNINGS)
def test_what_is_assumed_is_said(tmp_path, case):
    text, says = WARNINGS[case]
    description = load_robot_description(write(tmp_path, text))
    assert not description.errors
    assert [finding for finding in description.warnings if says in str(finding)], description.findings


@pytest.mark.parametrize(
    "mimic",
    ['joint="shoulder"', 'joint="shoulder" multiplier="-1"', 'joint="shoulder" multiplier="0.5" offset="0.7505"'],
)
def test_a_mimic_joint_within_its_limits_is_no_finding(tmp_path, mimic):
    assert not load_robot_description(write(tmp_path, elbow(extra=f"<mimic {mimic}/>"))).findings


def test_of_many_names_a_finding_lists_the_first(tmp_path):
    count = 1000
    apart = robot(*(link(f"l{k}") for k in range(count)), *(joint(f"j{k}", f"l{k}", f"x{k}") for k in range(count)))
    findings = load_robot_description(write(tmp_path, apart)).errors
    assert len(findings) == count and "there are: base, upper, tip, l0, l1" in str(findings[0])
    assert all(len(str(finding)) < 400 and "and 983 more" in str(finding) for finding in findings)


def chain(count: int, extra) -> str:
    """Joints j1, j2, ... one after the other, the k-th with an element ``extra(k)``."""
    links = [f"l{k}" for k in range(count + 1)]
    return robot(
        links=links, joints=[joint(f"j{k}", f"l{k - 1}", f"l{k}", extra=extra(k)) for k in range(1, count + 1)]
    )


LONG = 1500


@pytest.mark.parametrize(
    "extra",
    [
        lambda k: "",
        lambda k: f'<mimic joint="j{k - 1}"/>' if k > 1 else "",
        lambda k: f'<mimic joint="j{k + 1}"/>' if k < LONG else "",
        lambda k: f'<mimic joint="j{k % LONG + 1}"/>',
    ],
    ids=["free", "mimic the last", "mimic the next", "mimic in a ring"],
)
def test_long_chains_are_read_in_linear_time(tmp_path, extra):
    """As many joints are looked at as there are, about; it was their square or cube."""
    description = load_robot_description(write(tmp_path, chain(LONG, extra)))
    looked = []

    class Counted(dict):
        def __getitem__(self, key):
            looked.append(key)
            return super().__getitem__(key)

    mimic_relations(Counted(description.joints))
    list(loops(description.joints.values()))
    assert len(looked) < 5 * LONG
    assert len(description.errors) in (0, LONG)
    if not description.errors:
        assert description.tree.driver(f"j{LONG}")[1:] == (1.0, 0.0)


def test_an_arm_of_a_thousand_joints_is_refused_and_a_long_mount_is_not(tmp_path):
    file = write(tmp_path, chain(1000, lambda k: ""))
    with pytest.raises(
        InputError, match=r"the chain to 'l1000' has 1000 joints that move; an arm may have 100: choose"
    ):
        guess_robot(file)
    names = ", ".join(f"j{k}" for k in range(1, 102))
    with pytest.raises(InputError, match=r"arm.yaml:3: joints = .*: has 101 joints; an arm may have 100"):
        load_robot_model(str(write_robot(tmp_path, chain(101, lambda k: "").replace("l101", "tip"), names)))
    mounted = robot(
        *[f'<link name="m{k}"/>' for k in range(1000)],
        *[joint(f"f{k}", f"m{k - 1}" if k else "tip", f"m{k}", "fixed", limit="") for k in range(1000)],
    )
    model = load_robot_model(str(write_robot(tmp_path, mounted)))
    assert load_arm(model).end_effector(model.home)[2] == pytest.approx(0.6)
    assert [joint.name for joint in find_structure(load_urdf(model.urdf), model.urdf).arm] == ["shoulder", "elbow"]


def test_findings_name_the_line(tmp_path):
    """Also of files with empty lines before the XML declaration, which are no XML strictly."""
    text = '\n\n<?xml version="1.0"?>\n' + elbow(axis='<axis xyz="0 0 0"/>')
    (finding,) = load_robot_description(write(tmp_path, text)).findings
    assert finding.line == 9 and f"{tmp_path / 'arm.urdf'}:9: joint 'elbow'" in str(finding)


def test_a_file_that_changes_is_read_again(tmp_path):
    file = write(tmp_path, robot())
    assert not load_robot_description(file).errors
    write(tmp_path, robot(link("spare")))
    os.utime(file, ns=(1, 1))
    assert load_robot_description(file).errors


def test_axes_are_normalised(tmp_path):
    description = load_robot_description(write(tmp_path, elbow(axis='<axis xyz="0 3 4"/>')))
    np.testing.assert_allclose(description.joints["elbow"].axis, [0, 0.6, 0.8])


@pytest.mark.parametrize("depth", [0, 1, 5])
@pytest.mark.parametrize("inside", ["meshes/ball.stl", "other_name/meshes/ball.stl"])
def test_packages_are_found_in_any_folder_above(tmp_path, depth, inside):
    """Also where the folder of the package has another name."""
    mesh = tmp_path / "arm_package" / inside
    folder = mesh.parent.parent.joinpath(*"abcde"[:depth])
    folder.mkdir(parents=True)
    mesh.parent.mkdir()
    meshes.save(meshes.box(), mesh)
    text = shaped(f'<mesh filename="package://arm_package/{inside}"/>')
    (shape,) = load_robot_description(write(folder, text)).links["extra"].shapes
    assert shape.mesh == mesh


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", None])
def test_packages_are_found_in_the_index_of_ros_or_where_it_is_said(tmp_path, monkeypatch, variable):
    share = tmp_path / "install" / "share"
    mesh = share / "arm_package" / "meshes" / "a ball.stl"
    mesh.parent.mkdir(parents=True)
    meshes.save(meshes.box(), mesh)
    if variable:
        root = share.parent if variable == "AMENT_PREFIX_PATH" else share
        monkeypatch.setenv(variable, os.pathsep.join(["/nowhere", str(root)]))
    folder = tmp_path / "else"
    folder.mkdir()
    file = write(folder, shaped('<mesh filename="package://arm_package/meshes/a%20ball.stl"/>'))
    for packages in [()] if variable else [(share,), (share / "arm_package",)]:
        (shape,) = load_robot_description(file, packages).links["extra"].shapes
        assert shape.mesh == mesh


def test_paths_may_be_relative_absolute_or_urls(tmp_path):
    mesh = tmp_path / "ball.stl"
    meshes.save(meshes.box(), mesh)
    for name in ("ball.stl", str(mesh), f"file://{mesh}", "./ball.stl"):
        (shape,) = load_robot_description(write(tmp_path, shaped(f'<mesh filename="{name}"/>'))).links["extra"].shapes
        assert shape.mesh is not None and shape.mesh.samefile(mesh)


def test_what_is_wrong_with_a_mesh_is_said_with_its_link(tmp_path):
    file = write(tmp_path, shaped('<mesh filename="box.stl"/>'))
    (tmp_path / "box.stl").write_text("solid box")
    (finding,) = load_robot_description(file).findings
    assert finding.severity is Severity.ERROR and "link 'extra', <collision>, <geometry>, <mesh>: " in str(finding)
    assert f"mesh '{tmp_path / 'box.stl'}' is not a mesh" in finding.text
    inside_out = meshes.box()
    inside_out.invert()
    meshes.save(inside_out, tmp_path / "box.stl")
    os.utime(file, ns=(1, 1))
    (finding,) = load_robot_description(file).findings
    assert finding.severity is Severity.WARNING and finding.text.endswith("is inside out: its faces are turned")


def test_a_name_in_the_wrong_case_is_suggested(tmp_path):
    (tmp_path / "Ball.STL").touch()
    description = load_robot_description(write(tmp_path, shaped('<mesh filename="ball.stl"/>')))
    assert f"there is 'Ball.STL' in {tmp_path}" in str(description.errors[0])


def test_xacro_files_are_expanded_or_the_remedy_is_named(tmp_path, monkeypatch):
    text = elbow(axis='<axis xyz="0 ${2 - 1} 0"/>').replace("<robot ", '<robot xmlns:xacro="http://ros.org/xacro" ')
    file = write(tmp_path, text, "arm.urdf.xacro")
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    (finding,) = load_robot_description(file).findings
    assert "is a xacro file, and xacro is not installed; 'pip install xacro'" in str(finding)
    monkeypatch.undo()
    pytest.importorskip("xacro")
    os.utime(file, ns=(1, 1))
    description = load_robot_description(file)
    assert description.findings == ()
    np.testing.assert_allclose(description.joints["elbow"].axis, [0, 1, 0])
    write(tmp_path, text.replace("2 - 1", "height"), "arm.urdf.xacro")
    (finding,) = load_robot_description(file).findings
    assert "xacro cannot expand it" in str(finding) and "height" in str(finding)


# --- robot file against URDF ---


def test_limits_are_those_of_both_files(tmp_path):
    """A limit that is wider in the robot file than in the URDF is one that the arm cannot reach."""
    file = write_robot(tmp_path, elbow(limit='<limit lower="-0.5" upper="1" velocity="1" effort="9"/>'), upper=1.2)
    model = load_robot_model(str(file))
    assert model.position_limits.tolist() == [[-1.5, -0.5], [1.2, 1.0]]
    assert model.velocity_limits.tolist() == [2.0, 1.0]
    said = [str(finding) for finding in robot_findings(str(file))]
    assert f"{file}:6: position_limits.lower[1]: of elbow is beyond that of the URDF, -0.5, which is used" in said
    assert sum("which is used" in text for text in said) == 3


def test_a_home_beyond_the_limits_of_the_urdf_is_refused(tmp_path):
    file = write_robot(tmp_path, elbow(limit=LIMIT.replace("-1.5", "0.5")))
    with pytest.raises(InputError, match=r"home\[1\] = 0: of elbow must be within its limits \[0.5, 1.5\]"):
        load_robot_model(str(file))
    file = write_robot(tmp_path, elbow(limit=LIMIT.replace("-1.5", "1.2")), upper=1, home=1)
    with pytest.raises(InputError, match="of elbow leave no range: the URDF allows 1.2 to 1.5"):
        load_robot_model(str(file))


def test_models_of_one_urdf_have_their_own_limits(tmp_path):
    first = load_arm(load_robot_model(str(write_robot(tmp_path, robot(), upper=1.0))))
    second = load_arm(load_robot_model(str(write_robot(tmp_path, robot(), upper=0.5))))
    assert (first.model.position_limits[1] == 1.0).all() and (second.model.position_limits[1] == 0.5).all()


def test_an_arm_is_that_of_its_file_as_it_is_now(tmp_path):
    before = load_arm(load_robot_model(str(write_robot(tmp_path, robot()))))
    write(tmp_path, robot().replace('"0 0 0.3"', '"0 0 0.4"'))
    os.utime(tmp_path / "arm.urdf", ns=(1, 1))
    after = load_arm(load_robot_model(str(tmp_path / "arm.yaml")))
    assert [np.linalg.norm(arm.p_joint[1]) for arm in (before, after)] == pytest.approx([0.3, 0.4])
    assert judge.load(str(tmp_path / "arm.urdf")).joints[1].origin_p[2] == 0.4


MIMIC = '<mimic joint="shoulder" multiplier="-1"/>'


def test_an_arm_joint_that_mimics_another_is_refused(tmp_path):
    """Named in the robot file it would be planned as free; not named it would stay where it is."""
    with pytest.raises(InputError, match=r"joints\[1\] = 'elbow': mimics shoulder in the URDF; name joints that"):
        load_robot_model(str(write_robot(tmp_path, elbow(extra=MIMIC))))
    with pytest.raises(InputError, match=r"joints\[0\] = 'shoulder': elbow mimics it in the URDF and moves tip"):
        load_robot_model(str(write_robot(tmp_path, elbow(extra=MIMIC), "shoulder")))


def test_a_mimic_joint_that_moves_no_shape_is_no_matter(tmp_path):
    needle = joint("needle", "base", "dial", "continuous", extra=MIMIC)
    model = load_robot_model(str(write_robot(tmp_path, robot(link("dial", ""), needle))))
    assert model.joint_names == ("shoulder", "elbow")


@pytest.mark.parametrize("kind", ["planar", "floating", "fixed"])
def test_joints_that_do_not_move_cannot_be_the_arms(tmp_path, kind):
    with pytest.raises(InputError, match=rf"joints\[1\] = 'elbow': is {kind} and not a moving joint in arm.urdf"):
        load_robot_model(str(write_robot(tmp_path, elbow(kind=kind, limit=""))))


def test_joints_are_named_from_base_to_tip_of_one_chain(tmp_path):
    with pytest.raises(InputError, match=r"is in the wrong place; from base to tip they are shoulder, elbow"):
        load_robot_model(str(write_robot(tmp_path, robot(), "elbow, shoulder")))
    branch = robot(link("side"), joint("swing", "base", "side"))
    with pytest.raises(InputError, match=r"'swing': is not on the chain to end_effector.link, tip; its joints are sho"):
        load_robot_model(str(write_robot(tmp_path, branch, "shoulder, swing")))


def test_joints_that_the_robot_file_does_not_name_are_said(tmp_path):
    wheel = robot(link("wheel"), joint("spin", "base", "wheel", "continuous"))
    said = [str(finding) for finding in robot_findings(str(write_robot(tmp_path, wheel)))]
    assert said == [
        f"{tmp_path / 'arm.urdf'}: joint 'spin': the robot file does not name it; it is taken for fixed, at 0"
    ]
    with pytest.raises(InputError, match="elbow is not one of them and would stay at 0; the URDF allows 0.5 to 1.5"):
        load_robot_model(str(write_robot(tmp_path, elbow(limit=LIMIT.replace("-1.5", "0.5")), "shoulder")))


def test_of_robots_that_come_with_hmap_nothing_is_assumed_but_two_inertias():
    assert [robot_findings(name) for name in ("panda", "iiwa")] == [(), ()]
    said = [str(finding) for finding in robot_findings("xarm6")]
    assert len(said) == 2 and all("has no <inertia> that a body can have" in text for text in said)


def test_soft_limits_count_in_planner_and_judge(tmp_path):
    """Beyond them a controller stops the joint; where one is missing, that of ``<limit>`` counts."""
    text = elbow(extra='<safety_controller soft_lower_limit="-0.5" k_velocity="40"/>')
    ours = load_robot_description(write(tmp_path, text)).require_valid().joints["elbow"]
    (theirs,) = [joint for joint in judge.load(str(tmp_path / "arm.urdf")).joints if joint.name == "elbow"]
    assert (ours.lower, ours.upper) == (theirs.lower, theirs.upper) == (-0.5, 1.5)


def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "arm.urdf")
    with pytest.raises(InputError, match=r"arm.urdf: cannot be read: it is a folder, a pipe or a device"):
        load_robot_description(tmp_path / "arm.urdf").require_valid()


def test_a_folder_with_the_name_of_a_mesh_is_named(tmp_path):
    (tmp_path / "a.stl").mkdir()
    with pytest.raises(InputError, match=r"mesh 'a.stl' named in arm.urdf does not exist; .*/a.stl is a folder"):
        load_robot_description(write(tmp_path, shaped('<mesh filename="a.stl"/>'))).require_valid()


def test_infinite_limits_are_none(tmp_path):
    text = elbow(limit='<limit lower="-inf" upper="1e16" velocity="inf" effort="inf"/>')
    found = load_robot_description(write(tmp_path, text)).require_valid().joints["elbow"]
    assert (found.lower, found.upper, found.velocity, found.effort) == (-math.inf, math.inf, math.inf, None)
