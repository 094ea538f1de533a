"""Numbers that the URDF parser would ignore are refused with their place and text."""

import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from tests.support.descriptions import arm4


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<mass value="3.0"/>', '<mass value="3,0"/>', "link 'link1', <mass>: value=\"3,0\""),
        ('<mass value="3.0"/>', '<mass value="nan"/>', "is not 1 finite number"),
        ('<mass value="3.0"/>', '<mass value="3_0"/>', 'value="3_0" is not 1 finite number'),
        ('<mass value="3.0"/>', "<mass/>", '<mass>: value="" is not 1 finite number'),
        ('ixx="0.02" ', "", '<inertia>: ixx="" is not 1 finite number'),
        ('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0"/>', "joint 'joint2', <origin>: xyz=\"0 0\""),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 nan"/>', "joint 'joint1', <axis>"),
        ('lower="-3"', 'lower="-3 rad"', "joint 'joint1', <limit>: lower=\"-3 rad\""),
        ("<limit ", '<dynamics fading="1 s"/><limit ', "joint 'joint1', <dynamics>: fading="),
    ],
)
def test_unreadable_numbers_are_refused(tmp_path, old, new, words, capsys):
    path = arm4(tmp_path, (old, new))
    with pytest.raises(pa.RobotError) as error:
        pa.load(path, frame="tip")
    assert words in str(error.value) and str(path) in str(error.value)
    assert main(["init", str(path)]) == 2
    assert words in capsys.readouterr().err
