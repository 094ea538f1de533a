"""Bodies without inertia get one from their shapes and the mass of the whole robot."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import is_physical
from pinadapt.excitation.allowance import Shapes

CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
CLOSED = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
TETRAHEDRON = 0.3 * 0.2 * 0.1 / 6
SHAPES = {
    "base": '<cylinder radius="0.1" length="0.2"/>',
    "upper": '<box size="0.06 0.08 0.4"/>',
    "fore": '<mesh filename="fore.stl"/>',
    "wrist": None,
    "hand": '<sphere radius="0.03"/>',
}
VOLUMES = {
    "base": np.pi * 0.1**2 * 0.2,
    "upper": 0.06 * 0.08 * 0.4,
    "fore": TETRAHEDRON,
    "wrist": np.pi * (0.05 * 0.4) ** 2 * 0.25,  # a rod, 5 % as thick as the longest body is long
    "hand": 4 / 3 * np.pi * 0.03**3,
}
STEPS = {"upper": 0.3, "fore": 0.4, "wrist": 0.3, "hand": 0.25}  # [m] to the parent, along z


def stl(path, triangles):
    """Write triangles between CORNERS as an STL file."""
    rows = [f"vertex {x} {y} {z}" for triangle in triangles for x, y, z in CORNERS[list(triangle)]]
    facets = ["facet normal 0 0 1\nouter loop", "endloop\nendfacet"]
    body = "\n".join(
        "\n".join([facets[0], *rows[i : i + 3], facets[1]]) for i in range(0, len(rows), 3)
    )
    path.write_text(f"solid s\n{body}\nendsolid s\n")


def arm(folder, *, triangles=CLOSED, **inertials):
    """Write an arm of four joints whose links have shapes, and inertials only where given."""
    text = '<robot name="bare">'
    for index, (link, shape) in enumerate(SHAPES.items()):
        kind = "visual" if link == "upper" else "collision"
        body = f'<{kind}><origin xyz="0 0 0.2"/><geometry>{shape}</geometry></{kind}>'
        text += f'<link name="{link}">{inertials.get(link, "")}{body if shape else ""}</link>'
        if link in STEPS:
            parent = list(STEPS)[index - 2] if index > 1 else "base"
            axis = "0 0 1" if link in ("upper", "hand") else "0 1 0"
            text += (
                f'<joint name="to_{link}" type="revolute"><parent link="{parent}"/>'
                f'<child link="{link}"/><origin xyz="0 0 {STEPS[link]}"/><axis xyz="{axis}"/>'
                '<limit lower="-2" upper="2" effort="90" velocity="4"/></joint>'
            )
    text += '<link name="tip"/><joint name="f" type="fixed"><parent link="hand"/>'
    text += '<child link="tip"/><origin xyz="0.1 0 0.1"/></joint></robot>'
    stl(folder / "fore.stl", triangles)
    path = folder / "bare.urdf"
    path.write_text(text)
    return path


def bodies(robot):
    """Return the inertias of the chain by link."""
    return dict(zip(STEPS, robot.model.inertias[1:], strict=True))


def test_the_mass_is_shared_by_volume_with_the_base_between_uniform_solids(tmp_path):
    with pytest.warns(
        UserWarning, match=r"30 kg distributed .* upper .*; wrist [^;]*, a rod or ball"
    ):
        found = bodies(pa.load(arm(tmp_path), frame="tip", mass=30))
    density = 30 / sum(VOLUMES.values())
    for link, body in found.items():
        assert np.isclose(body.mass, density * VOLUMES[link])
        assert is_physical(body.toDynamicParameters())
    at = np.array([0.0, 0.0, 0.2])
    box = pin.Inertia.FromBox(found["upper"].mass, 0.06, 0.08, 0.4)
    assert found["upper"].isApprox(pin.Inertia(box.mass, at, box.inertia))
    ball = pin.Inertia.FromSphere(found["hand"].mass, 0.03)
    assert found["hand"].isApprox(pin.Inertia(ball.mass, at, ball.inertia))
    rod = pin.Inertia.FromCylinder(found["wrist"].mass, 0.02, 0.25)
    assert found["wrist"].isApprox(pin.Inertia(rod.mass, np.array([0.0, 0.0, 0.125]), rod.inertia))
    # of a tetrahedron: covariance = V (sum of c c^T + 4 x 4 mean mean^T) / 20
    mean = CORNERS.mean(axis=0)
    volume = found["fore"].mass
    second = volume * (CORNERS.T @ CORNERS + 16 * np.outer(mean, mean)) / 20
    about = second - volume * np.outer(mean, mean)
    assert np.allclose(found["fore"].lever, mean + at)
    assert np.allclose(found["fore"].inertia, np.trace(about) * np.eye(3) - about)


def test_a_flat_mesh_has_no_volume_and_is_a_shape_that_motions_avoid(tmp_path):
    with pytest.warns(UserWarning, match=r"fore [^;]*, a rod or ball"):
        robot = pa.load(arm(tmp_path, triangles=CLOSED[:1]), frame="tip", mass=30)
    assert Shapes.of(robot, None, None)


HEAVY = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="12"/>'
    '<inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.1"/></inertial>'
)


@pytest.mark.filterwarnings("ignore:bare")
def test_described_inertias_are_kept_and_counted(tmp_path):
    robot = pa.load(arm(tmp_path, upper=HEAVY), frame="tip", mass=30)
    found = bodies(robot)
    assert np.isclose(found["upper"].mass, 12.0) and np.isclose(found["upper"].inertia[2, 2], 0.1)
    density = 18 / sum(VOLUMES[link] for link in VOLUMES if link != "upper")
    assert np.isclose(found["fore"].mass, density * TETRAHEDRON)
