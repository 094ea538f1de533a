"""A description runs no code: its expressions know numbers, texts, lists and mathematics."""

import contextlib
import math
import os
import time

import pytest

import pinadapt as pa
from pinadapt.description import xacro
from pinadapt.description.xacro import LONGEST, evaluate
from tests.support.descriptions import XMLNS
from tests.support.paths import ARM4

VALUES = {"a": 2, "b": 0.5, "name": "arm", "several": [1, [2, 3]], "of_yaml": {"x": {"y": 4}}}

ORDINARY = [
    "a + b * 3 - 1 / 4 // 1 % 3",
    "-a ** 2",
    "2 ** -1",
    "(-8) ** 3",
    "pi / 2 + math.pi",
    "sin(0.3) + math.cos(b) * radians(90)",
    "atan2(1, a)",
    "a > 1 and not b >= 1 or name == 'arm'",
    "1 if name != 'arm' else 2",
    "0 < b < 1",
    "several[1][0] + several[-1][1]",
    "[1, 2, 3][1:]",
    "of_yaml['x']['y']",
    "name + '_' + str(a)",
    "'ar' in name",
    "{'k': [1, 2]}['k'][1]",
    "max(1, a, b) + min([3, 4]) + len(name) + abs(-1)",
    "list(range(3)) + [round(0.6)]",
    "sum(range(4)) + python.sum([1])",
    "sorted([3, 1]) + list((1, 2))",
    "'ab' * 2",
    "divmod(7, 2)",
    "None is None",
]


class Namespace(dict):
    """What ``math`` and ``python`` are to Python's eval."""

    __getattr__ = dict.__getitem__


@pytest.mark.parametrize("text", ORDINARY)
def test_an_ordinary_expression_has_pythons_value(text):
    names = {**VALUES, "pi": math.pi}
    python = eval(  # what xacro itself does
        text,
        {**vars(math), **names, "math": math, "python": Namespace(sum=sum)},
    )
    found = evaluate(text, names.__getitem__, {})
    assert found == python and type(found) is type(python)


@pytest.mark.parametrize("text", [r"'\d'", "1if 1 else 2", "0x1for 1 in [1]"])
def test_pythons_warnings_about_an_expression_are_not_shown(text, recwarn):
    """To show one, Python would open a file that is named like the source of the expression."""
    with contextlib.suppress(pa.RobotError, SyntaxError):
        evaluate(text, VALUES.__getitem__, {})
    assert not recwarn


def test_items_of_yaml_may_be_written_with_dots():
    assert evaluate("of_yaml.x.y", VALUES.__getitem__, {}) == 4


ATTACKS = [
    "''.__class__",
    "().__class__.__bases__[0].__subclasses__()",
    "(lambda: 1)()",
    "[x for x in [1]]",
    "{x for x in [1]}",
    "(x for x in [1])",
    "f'{a!r:>99999999}'",
    "'%099999999d' % 1",
    "'{0.__class__}'.format(1)",
    "name.upper()",
    "name.upper",
    "math.sin.__self__",
    "math.factorial(10**7)",
    "factorial(99999)",
    "__import__('os').system('true')",
    "open('/etc/passwd')",
    "eval('1')",
    "exec('1')",
    "getattr(a, 'real')",
    "type(a)",
    "vars()",
    "globals()",
    "python.type(a)",
    "python.vars()",
    "sin",
    "[sin][0](1)",
    "list(map(str, [1]))",
    "list(filter(None, [1]))",
    "(a := 3)",
    "several.append",
    "of_yaml.keys",
    "of_yaml.keys()",
    "of_yaml.__class__",
    "*several, 1",
    "{**of_yaml}",
    "print('here')",
    "await a",
    "yield a",
    "a @ a",
    "1 << 10**9",
    "9**9**9",
    "2**100000",
    "10**400 * 10**400",
    "'a' * 10**9",
    "10**9 * [0]",
    "'a' * 99999 * ([0] * 99999)",
    "[0] * 99999 * ((1,) * 99999)",
    "'a' * 1.0",
    "list(range(10**9))",
    "round(10**300, -10**9)",
    "round(1.5, 10**9)",
    "sum([[1]] * 50000, [])",
    "range(10**9)",
    "'a' * 90000 + 'a' * 90000",
    "str([0] * 99999) + str([0] * 99999)",
    "1j",
    "b'x'",
    "...",
    "nothere",
    "nothere.a",
    "xacro",
    "math",
]


@pytest.mark.parametrize("text", ATTACKS)
def test_values_that_are_not_data_or_too_large_are_refused_at_once(text):
    begun = time.process_time()
    with pytest.raises((pa.RobotError, SyntaxError)):
        evaluate(text, VALUES.__getitem__, {})
    assert time.process_time() - begun < 1.0


def test_nested_repetitions_of_lists_are_bounded():
    values = {"l": [0] * 10}
    with pytest.raises(pa.RobotError, match=f"{LONGEST} characters or elements"):
        for _ in range(30):
            values["l"] = evaluate("[l, l]", values.__getitem__, {})


def written(path, content, name="arm.urdf.xacro"):
    """Write a xacro file of the arm with more content; return its path."""
    body = ARM4.read_text().split('<robot name="arm4">')[1]
    path.mkdir(exist_ok=True)
    (path / name).write_text(f'<robot name="arm" {XMLNS}>{content}{body}')
    return path / name


def doubled(pattern, levels=40):
    """Return definitions each of which uses the one before twice."""
    return "".join(pattern.format(this=f"p{k + 1}", last=f"p{k}") for k in range(levels))


HANGS = {
    "macros": (
        '<xacro:macro name="p0"><a/></xacro:macro>'
        + doubled(
            '<xacro:macro name="{this}"><xacro:{last}/><xacro:{last}/></xacro:macro>',
        )
        + "<xacro:p40/>"
    ),
    "texts": (
        '<xacro:property name="p0" value="text"/>'
        + doubled('<xacro:property name="{this}" value="${{{last}}} ${{{last}}}"/>')
        + '<link name="${p40}"/>'
    ),
    "power": '<link name="${9**9**9}"/>',
    "parentheses": '<link name="${' + 400 * "(" + "1" + 400 * ")" + '}"/>',
    "eval": '<link name="$(eval 9**9**9)"/>',
}


@pytest.mark.parametrize("what", HANGS)
def test_a_file_that_grows_without_end_is_refused_within_seconds(what, tmp_path):
    begun = time.process_time()
    with pytest.raises(pa.RobotError, match=r"elements|characters|too large|nested"):
        pa.load(written(tmp_path, HANGS[what]))
    assert time.process_time() - begun < 10.0


def test_an_expansion_has_a_time_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(xacro, "_SECONDS", 0.02)
    slow = '<a b="${len(sorted(list(range(90000))))}"/>'
    with pytest.raises(pa.RobotError, match=r"takes more than 0\.02 s"):
        pa.load(written(tmp_path, 20 * slow))


CODE = {
    "braces": '<link name="${().__class__}"/>',
    "dollar eval": '<link name="$(eval list(map(str, [1])))"/>',
    "property": '<xacro:property name="k" value="${python.vars()}"/><link name="${k}"/>',
    "default of a macro": '<xacro:macro name="m" params="x:=${type(1)}"><a b="${x}"/></xacro:macro>'
    "<xacro:m/>",
    "condition": '<xacro:if value="${(lambda: True)()}"><a/></xacro:if>',
}


@pytest.mark.parametrize("where", CODE)
def test_no_part_of_a_file_runs_code(where, tmp_path):
    path = written(tmp_path, CODE[where])
    with pytest.raises(
        pa.RobotError, match=r"cannot be called|not defined|not available|cannot ex"
    ):
        pa.load(path)


def test_units_of_yaml_files_run_no_code(tmp_path):
    content = '<xacro:property name="y" value="${load_yaml(\'y.yaml\')}"/><a b="${y.angle}"/>'
    path = written(tmp_path, content)
    (tmp_path / "y.yaml").write_text("angle: !degrees ().__class__\n")
    with pytest.raises(pa.RobotError, match="not defined"):
        pa.load(path)


@pytest.mark.parametrize(
    "content",
    [
        '<xacro:include filename="{outside}.xacro"/>',
        '<xacro:include filename="../secret.xacro"/>',
        "<a b=\"${{load_yaml('{outside}.yaml')}}\"/>",
        "<a b=\"${{xacro.load_yaml('../secret.yaml')}}\"/>",
        '<xacro:include filename="link.xacro"/>',
        '<xacro:include filename="$(find etc)/../{outside}.xacro"/>',
    ],
)
def test_only_files_of_the_descriptions_packages_are_read(content, tmp_path):
    outside = tmp_path / "secret"
    outside.with_suffix(".xacro").write_text(f"<robot {XMLNS}/>")
    outside.with_suffix(".yaml").write_text("a: 1\n")
    path = written(tmp_path / "arm", content.format(outside=outside))
    (tmp_path / "arm" / "link.xacro").symlink_to(outside.with_suffix(".xacro"))
    with pytest.raises(pa.RobotError, match="outside of the description's packages"):
        pa.load(path)


def test_the_size_of_an_expansion_is_checked_before_it_is_made(tmp_path):
    path = written(tmp_path, "<a b=\"${load_yaml('y.yaml')}\"/>")
    (tmp_path / "y.yaml").write_text("- 1\n" * 300_000)
    with pytest.raises(pa.RobotError, match="more than 1000000 bytes"):
        pa.load(path)
    path.write_text('<!DOCTYPE robot [<!ENTITY a "aaaa">]>' + path.read_text())
    with pytest.raises(pa.RobotError, match="defines XML entities"):
        pa.load(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize(
    "content", ['<xacro:include filename="pipe"/>', "<a b=\"${load_yaml('pipe')}\"/>"]
)
def test_pipes_and_devices_are_refused_without_waiting(content, tmp_path):
    path = written(tmp_path, content)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(pa.RobotError, match="is no file"):
        pa.load(path)


@pytest.mark.parametrize("name", ["..", ".", "../secret"])
def test_a_path_is_not_accepted_as_a_package_name(name, tmp_path):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret.xacro").write_text(f"<robot {XMLNS}/>")
    path = written(tmp_path / "arm", f'<xacro:include filename="$(find {name})/secret.xacro"/>')
    with pytest.raises(pa.RobotError, match="is not found"):
        pa.load(path)


def test_a_package_is_read_as_a_whole(tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>arm</name></package>")
    (tmp_path / "common.xacro").write_text(f"<robot {XMLNS}/>")
    path = written(tmp_path / "urdf", '<xacro:include filename="../common.xacro"/>')
    assert pa.load(path).model.nv == 4


def test_a_urdf_file_is_never_expanded(tmp_path):
    path = written(tmp_path, '<xacro:property name="k" value="1"/>', name="arm.urdf")
    with pytest.raises(pa.RobotError, match=r"not\s+expanded.*ends in \.xacro"):
        pa.load(path)
