"""What robots and controllers show of themselves in a notebook."""

import pinadapt as pa
from tests.support.paths import ARM4


def test_names_are_escaped(tmp_path):
    path = tmp_path / "evil.urdf"
    evil = "&lt;script&gt;alert(1)&lt;/script&gt;"
    path.write_text(ARM4.read_text().replace('"joint2"', f'"{evil}"'))
    robot = pa.load(path)
    assert robot.joint_names[1] == "<script>alert(1)</script>"
    assert "<script" not in robot._repr_html_() and "&lt;script&gt;" in robot._repr_html_()
